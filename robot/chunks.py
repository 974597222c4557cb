"""Chunks: the pieces in which a program is sent to the controller.

The controller runs a path as one uploaded script and stands still while the next one is loaded. So a chunk ends
only where the tool is clear of the part and the pump is off: it runs from a travel, through approach and bead, to
the end of the retract, and its waypoints are one continuous motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planning import Program, SegmentKind
from planning.program import MOVES_MAX

from .errors import ArmError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

SAME_PLACE = 1e-6
"""Waypoints nearer than this are one, mm."""

CONTINUITY = 1e-2
"""Largest gap between the end of a segment and the start of the next, mm."""

_BORDERS = {
    (SegmentKind.RETRACT, SegmentKind.TRAVEL),
    (SegmentKind.RETRACT, SegmentKind.APPROACH),
    (SegmentKind.RETRACT, SegmentKind.WAIT),
    (SegmentKind.TRAVEL, SegmentKind.WAIT),
}
"""Neighbouring kinds of segments between which the tool is clear of the part and the pump is off."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """One uninterrupted motion: m moves, each from waypoint `target - 1` to waypoint `target`.

    Attributes:
        index: its place among the program's chunks.
        wait: process time to stand still before it starts, s.
        start: waypoint where it begins.
        target: waypoint that each move goes to, shape (m,); may be empty.
        segment: the program's segment that each move belongs to, shape (m,).
        printing: whether a move lays a bead, shape (m,).
        blend: blend radius at the end of each move, shape (m,), mm; 0 where the tool has to stand.
    """

    index: int
    wait: float
    start: int
    target: Indices
    segment: Indices
    printing: Mask
    blend: Array

    def __len__(self) -> int:
        return len(self.target)


def split(program: Program) -> tuple[Chunk, ...]:
    """The chunks of a program, in order; together they hold every move of it.

    Raises:
        ArmError: the program cannot be executed as it is: no waypoints, a kind of segment that this version does
            not run, a gap between segments, blends that overlap, a speed that is not positive, or a bead with
            more than `MOVES_MAX` moves. The message names the waypoint.
    """
    if not len(program):
        raise ArmError("the program has no waypoints; plan a part with at least one curve")
    _check(program)
    groups: list[list[int]] = []
    before: SegmentKind | None = None
    for k, segment in enumerate(program.segments):
        if before is None or (before, segment.kind) in _BORDERS:
            groups.append([])
        groups[-1].append(k)
        before = segment.kind
    return tuple(_chunk(program, index, group) for index, group in enumerate(groups))


def _chunk(program: Program, index: int, group: list[int]) -> Chunk:
    segments = [program.segments[k] for k in group]
    targets = np.concatenate([np.arange(s.start + 1, s.stop, dtype=np.int64) for s in segments])
    numbers = np.concatenate(
        [np.full(s.stop - s.start - 1, k, dtype=np.int64) for k, s in zip(group, segments, strict=True)]
    )
    kept = ~_stands(program, targets)
    targets, numbers = targets[kept], numbers[kept]
    kinds = np.array([s.kind is SegmentKind.PRINT for s in program.segments])
    printing = kinds[numbers]
    blend = program.blend[targets].copy()
    last = np.append(printing[1:] != printing[:-1], [True] * min(len(targets), 1))
    blend[last] = 0.0  # the tool stands where a bead begins and ends, and at the end of the chunk
    chunk = Chunk(
        index=index,
        wait=sum(
            float(program.time[s.stop - 1] - program.time[s.start])
            for s in segments
            if s.kind is SegmentKind.WAIT
        ),
        start=segments[0].start,
        target=targets,
        segment=numbers,
        printing=printing,
        blend=blend,
    )
    _check_length(program, chunk)
    _check_blends(program, chunk)
    return chunk


def _stands(program: Program, targets: Indices) -> Mask:
    """Which moves end where they start; the controller refuses a path with such entries."""
    way = np.linalg.norm(program.positions[targets] - program.positions[targets - 1], axis=1)
    turn = np.abs(program.poses[targets, :3, :3] - program.poses[targets - 1, :3, :3]).max(
        axis=(1, 2), initial=0.0
    )
    return np.asarray((way < SAME_PLACE) & (turn < 1e-9), dtype=np.bool_)


def _check(program: Program) -> None:
    for name in ("poses", "joints", "speed", "blend", "flow", "time"):
        values = getattr(program, name).reshape(len(program), -1)
        unknown = ~np.isfinite(values).all(axis=1)
        if unknown.any():
            raise ArmError(f"waypoint {np.argmax(unknown)} has no {name}; 'twincell check' says why")
    if program.external_axes.size:
        raise ArmError(
            "the program moves external axes, which this version does not drive; plan it without them"
        )
    for k, segment in enumerate(program.segments):
        if segment.kind in (SegmentKind.PRIME, SegmentKind.PURGE):
            raise ArmError(
                f"segment {k} is '{segment.kind}', which this version does not run; prime and purge by hand"
            )
        if k:
            before = program.segments[k - 1].kind
            if segment.kind is SegmentKind.WAIT and before in (SegmentKind.PRINT, SegmentKind.APPROACH):
                raise ArmError(
                    f"segment {k} waits right after '{before}', at the bead; let it wait after a retract"
                )
            gap = float(
                np.linalg.norm(program.positions[segment.start] - program.positions[segment.start - 1])
            )
            if gap > CONTINUITY:
                raise ArmError(
                    f"waypoint {segment.start} begins segment {k} ({segment.kind}) {gap:.3g} mm away from the end of "
                    "the one before; plan the program again"
                )


def _check_length(program: Program, chunk: Chunk) -> None:
    if len(chunk) > MOVES_MAX:
        waypoint = int(chunk.target[int(np.argmax(chunk.printing))])
        raise ArmError(
            f"layer {program.layer[waypoint]}, curve {program.curve[waypoint]}: {len(chunk)} moves without a travel, "
            f"but a controller takes at most {MOVES_MAX} in one script; coarsen or divide the curve"
        )
    slow = ~(program.speed[chunk.target - 1] + program.speed[chunk.target] > 0)
    if slow.any():
        raise ArmError(f"waypoint {chunk.target[np.argmax(slow)]}: the speed must be above 0 mm/s")


def _check_blends(program: Program, chunk: Chunk) -> None:
    length = np.linalg.norm(program.positions[chunk.target] - program.positions[chunk.target - 1], axis=1)
    both = chunk.blend + np.concatenate([[0.0], chunk.blend[:-1]])
    overlap = (both > 0) & (both >= length)
    if overlap.any():
        i = int(np.argmax(overlap))
        raise ArmError(
            f"waypoint {chunk.target[i]}: blend radii of {both[i]:.4g} mm in total overlap on the {length[i]:.4g} mm "
            "before it, and the controller would skip it; plan with a smaller blend"
        )
