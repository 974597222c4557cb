"""Preflight: what would go wrong if this program were printed on this cell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from twins import Toolpath

from .branch import branch_from
from .buildability import buildability
from .cell import Cell
from .errors import ProgramError
from .finding import Finding, Severity
from .kinematics import arm
from .mix import Mix
from .pose import rotation_from_vector, vector_from_rotation
from .program import MOVES_MAX, Program, SegmentKind

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


MOVES_AROUND = 3
"""Moves of travel, approach and retract that go out with a bead."""

MOST_OF_A_KIND = 5
"""Findings of one kind that are listed; a part that is too large would give two a layer."""

BETWEEN = 10.0
"""Distance at which moves between beads are looked at, mm."""

JUMP = 0.5
"""Turn of a joint between two such places that means another posture or a singular one, rad."""


def check(program: Program, cell: Cell, mix: Mix, toolpath: Toolpath) -> list[Finding]:
    """Findings about a program; an empty list means that nothing speaks against printing it.

    One finding a kind and run of neighbouring waypoints, at its worst waypoint.

    Raises:
        ProgramError: the program was planned for another robot or toolpath.
    """
    if program.robot != cell.robot.model:
        raise ProgramError(
            f"the program is for a {program.robot}, the cell has a {cell.robot.model}; plan it again"
        )
    layers = int(program.layer.max(initial=-1)) + 1
    if layers > len(toolpath.layers):
        raise ProgramError(
            f"the program prints layer {layers - 1}, the toolpath ends at {len(toolpath.layers) - 1}"
        )
    findings = [
        *_reach(program, cell),
        *_way_between(program, cell),
        *_joint_limits(program, cell),
        *_joint_speed(program, cell),
        *_work_volume(program, cell),
        *_blend_overlap(program),
        *_pump_range(program, cell),
        *_bead_width(program, cell),
        *_bead_length(program),
        *_layer_interval(program, mix),
        *_open_time(program, mix),
        *buildability(program, cell, mix, toolpath),
    ]
    return [folded for kind in dict.fromkeys(f.kind for f in findings) for folded in _folded(findings, kind)]


def _folded(findings: list[Finding], kind: str) -> list[Finding]:
    """The findings of a kind; of many the first few, the last of which says how many more there are."""
    found = [finding for finding in findings if finding.kind == kind]
    if len(found) <= MOST_OF_A_KIND:
        return found
    kept, more = found[:MOST_OF_A_KIND], len(found) - MOST_OF_A_KIND
    return [*kept[:-1], replace(kept[-1], message=f"{kept[-1].message} (and {more} more places like this)")]


def _runs(bad: Mask) -> Iterator[tuple[int, int]]:
    """Runs [start, stop) of True."""
    edges = np.flatnonzero(np.diff(np.r_[False, bad, False].astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _where(program: Program, i: int) -> str:
    x, y, z = program.positions[i]
    layer = f"layer {program.layer[i]}, " if program.layer[i] >= 0 else ""
    return f"{layer}at ({x:.0f}, {y:.0f}, {z:.0f}) mm from the robot's base"


def _reach(program: Program, cell: Cell) -> Iterator[Finding]:
    unreached = np.asarray(np.isnan(program.joints).any(axis=1), dtype=np.bool_)
    distance = np.linalg.norm(program.positions, axis=1)
    farthest = float(distance[~unreached].max(initial=0.0))
    for start, stop in _runs(unreached):
        i = start + int(np.argmax(distance[start:stop]))
        yield Finding(
            "reach",
            Severity.ERROR,
            i,
            round(float(distance[i]), 1),
            round(farthest, 1),
            "mm from the base (limit: farthest reached)",
            f"the {cell.robot.model} cannot take this pose, {_where(program, i)} ({stop - start} waypoints in a row)",
            "move the part on the bed, make it smaller, or tilt the top plane less",
        )


def _way_between(program: Program, cell: Cell) -> Iterator[Finding]:
    """Moves without a bead are straight and long: what the arm can do at both ends, it must do all the way."""
    model = arm(cell.robot.model)
    flange = np.linalg.inv(program.tool)
    for segment in program.segments:
        if segment.kind is SegmentKind.PRINT:
            continue
        for i in range(segment.start + 1, segment.stop):
            ends = program.poses[[i - 1, i]]
            count = int(np.ceil(np.linalg.norm(ends[1, :3, 3] - ends[0, :3, 3]) / BETWEEN))
            if count < 2 or np.isnan(program.joints[[i - 1, i]]).any():
                continue
            share = np.linspace(0.0, 1.0, count + 1)
            poses = np.tile(np.eye(4), (count + 1, 1, 1))
            turned = vector_from_rotation(ends[0, :3, :3].T @ ends[1, :3, :3])
            poses[:, :3, :3] = ends[0, :3, :3] @ rotation_from_vector(share[:, None] * turned)
            poses[:, :3, 3] = ends[0, :3, 3] + share[:, None] * (ends[1, :3, 3] - ends[0, :3, 3])
            joints = branch_from(model, poses @ flange, program.joints[i - 1])
            lost = np.isnan(joints).any(axis=1)
            turn = np.abs(np.diff(joints, axis=0)).max(axis=1)
            if (
                lost.any()
                or float(turn.max()) > JUMP
                or float(np.abs(joints[-1] - program.joints[i]).max()) > JUMP
            ):
                yield Finding(
                    "way between beads",
                    Severity.ERROR,
                    i,
                    round(100.0 * float(lost.mean()), 1),
                    0.0,
                    "% of the way out of reach",
                    f"the arm cannot follow the straight {segment.kind} to here without leaving its reach or its "
                    f"posture, {_where(program, i)}",
                    "move the part on the bed, or print its bodies as separate jobs",
                )


def _joint_limits(program: Program, cell: Cell) -> Iterator[Finding]:
    limit = np.radians(cell.robot.joint_limit_deg)
    for joint in range(6):
        angle = np.abs(program.joints[:, joint])
        for start, stop in _runs(np.nan_to_num(angle) > limit[joint] + 1e-9):
            i = start + int(np.argmax(angle[start:stop]))
            yield Finding(
                "joint limit",
                Severity.ERROR,
                i,
                round(float(np.degrees(angle[i])), 2),
                cell.robot.joint_limit_deg[joint],
                "deg",
                f"joint {joint + 1} would turn to {np.degrees(program.joints[i, joint]):.1f}°, {_where(program, i)}",
                "turn the tool's heading or the part on the bed",
            )


def _joint_speed(program: Program, cell: Cell) -> Iterator[Finding]:
    duration = np.diff(program.time)
    step = np.abs(np.diff(program.joints, axis=0))
    speed = np.zeros_like(program.joints)
    moving = duration > 1e-9
    speed[1:][moving] = np.nan_to_num(step[moving] / duration[moving, None])
    for joint in range(6):
        limit = cell.robot.joint_speed_deg[joint]
        for start, stop in _runs(np.degrees(speed[:, joint]) > limit):
            i = start + int(np.argmax(speed[start:stop, joint]))
            yield Finding(
                "joint speed",
                Severity.ERROR,
                i,
                round(float(np.degrees(speed[i, joint])), 1),
                limit,
                "deg/s",
                f"joint {joint + 1} would have to turn at {np.degrees(speed[i, joint]):.0f}°/s, {_where(program, i)}",
                "print slower there, or move the part away from the arm's singular postures",
            )


def _work_volume(program: Program, cell: Cell) -> Iterator[Finding]:
    place = cell.bed.plane.to_frame(np.asarray(program.positions))
    half = 0.5 * np.array(cell.bed.size)
    over = np.column_stack([np.abs(place[:, :2]) - half, place[:, 2] - cell.bed.height, -place[:, 2]])
    names = ("the bed's x extent", "the bed's y extent", "the bed's height", "the bed from below")
    limits = (half[0], half[1], cell.bed.height, 0.0)
    for k, name in enumerate(names):
        for start, stop in _runs(over[:, k] > 1e-6):
            i = start + int(np.argmax(over[start:stop, k]))
            yield Finding(
                "work volume",
                Severity.ERROR,
                i,
                round(float(over[i, k] + limits[k]), 2),
                float(limits[k]),
                "mm",
                f"the nozzle would leave {name} by {over[i, k]:.1f} mm, {_where(program, i)}",
                "move the part on the bed, make it smaller, or enlarge [bed] in the cell file",
            )


def _blend_overlap(program: Program) -> Iterator[Finding]:
    length = np.linalg.norm(np.diff(program.positions, axis=0), axis=1)
    together = program.blend[1:] + program.blend[:-1]
    for start, stop in _runs((together >= length) & (together > 0)):
        i = start + int(np.argmax(together[start:stop] - length[start:stop])) + 1
        yield Finding(
            "blend overlap",
            Severity.ERROR,
            i,
            round(float(together[i - 1]), 3),
            round(float(length[i - 1]), 3),
            "mm",
            f"the blends of two neighbouring waypoints overlap, {_where(program, i)}; the controller would skip one",
            "lower [print] blend, or sample the curves coarser",
        )


def _pump_range(program: Program, cell: Cell) -> Iterator[Finding]:
    for start, stop in _runs(program.flow > cell.pump.flow_max):
        i = start + int(np.argmax(program.flow[start:stop]))
        yield Finding(
            "pump range",
            Severity.ERROR,
            i,
            round(float(program.flow[i]), 1),
            cell.pump.flow_max,
            "mm³/s",
            f"the bead needs {program.flow[i]:.0f} mm³/s, more than the pump gives, {_where(program, i)}",
            "print slower, narrower or in thinner layers",
        )
    # Ramps pass through all flows; what counts is the steady part of each bead.
    for segment in program.segments:
        if segment.kind is SegmentKind.PRINT:
            i = segment.start + int(np.argmax(program.flow[segment.start : segment.stop]))
            if program.flow[i] < cell.pump.flow_min:
                yield Finding(
                    "pump range",
                    Severity.ERROR,
                    i,
                    round(float(program.flow[i]), 1),
                    cell.pump.flow_min,
                    "mm³/s",
                    f"the bead needs only {program.flow[i]:.0f} mm³/s, less than the pump holds, {_where(program, i)}",
                    "print faster, wider or in thicker layers",
                )


def _bead_width(program: Program, cell: Cell) -> Iterator[Finding]:
    printing = program.of_kind(SegmentKind.PRINT)
    for limit, beyond in (
        (cell.tool.width_min, printing & (program.width < cell.tool.width_min - 1e-9)),
        (cell.tool.width_max, printing & (program.width > cell.tool.width_max + 1e-9)),
    ):
        if beyond.any():
            i = int(np.flatnonzero(beyond)[0])
            yield Finding(
                "bead width",
                Severity.ERROR,
                i,
                float(program.width[i]),
                limit,
                "mm",
                f"the nozzle cannot lay a bead {program.width[i]:.1f} mm wide, {_where(program, i)}",
                "change [print] width, or the nozzle's width_min and width_max in the cell file",
            )


def _bead_length(program: Program) -> Iterator[Finding]:
    for segment in program.segments:
        moves = segment.stop - segment.start - 1
        if segment.kind is SegmentKind.PRINT and moves > MOVES_MAX - MOVES_AROUND:
            yield Finding(
                "bead length",
                Severity.ERROR,
                segment.start,
                moves,
                MOVES_MAX - MOVES_AROUND,
                "moves",
                f"one bead has {moves} moves, more than a controller takes at once, {_where(program, segment.start)}",
                "sample the curves coarser ([slicing] resolution), or divide the part",
            )


def _open_time(program: Program, mix: Mix) -> Iterator[Finding]:
    if program.duration > mix.open_time_s:
        yield Finding(
            "open time",
            Severity.WARNING,
            -1,
            round(program.duration, 1),
            mix.open_time_s,
            "s",
            f"the print takes {program.duration:.0f} s, longer than one batch of {mix.name} stays open",
            "mix in several batches",
        )


def _layer_interval(program: Program, mix: Mix) -> Iterator[Finding]:
    starts: dict[int, int] = {}
    for segment in program.segments:
        if segment.kind is SegmentKind.PRINT:
            starts.setdefault(segment.layer, segment.start)
    layers = sorted(starts)
    for low, high in pairwise(layers):
        i = starts[high]
        interval = float(program.time[i] - program.time[starts[low]])
        for bad, limit, what, remedy in (
            (interval < mix.layer_interval_min_s, mix.layer_interval_min_s, "before the layer below can carry it",
             "print slower, or several parts at a time"),
            (interval > mix.layer_interval_max_s, mix.layer_interval_max_s, "after the layer below has gone cold",
             "print faster, or a smaller part"),
        ):  # fmt: skip
            if bad:
                yield Finding(
                    "layer interval",
                    Severity.WARNING,
                    i,
                    round(interval, 2),
                    limit,
                    "s",
                    f"layer {high} starts {interval:.0f} s after layer {low}, {what}",
                    remedy,
                )
