"""The shape of a path: straight moves from target to target, rounded where a target has a blend radius.

The path leaves a line at the blend radius from its target and joins the next at the same distance beyond, on the
arc that touches both; so it stays within the radius of the target. A real controller's blend is a curve of its own
within the same bounds. A blend takes at most half of a move, so that two never overlap. Orientation turns evenly
along each move.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

SPACING = 2.0  # mm between samples
TURN_LENGTH = 100.0  # mm of travel that a turn by one radian counts as
REST_STEPS = 8  # samples, at least, on a move that begins or ends at rest
STANDING = 1e-6  # mm
NO_STEP = 1e-9  # mm
STRAIGHT = 1e-6  # rad, below which a corner is none
REVERSAL = np.pi - 1e-3  # rad, beyond which a corner cannot be rounded


@dataclass(frozen=True, eq=False)
class Target:
    """Where a move leads, and how.

    Attributes:
        pose: shape (4, 4), mm.
        speed: mm/s.
        acceleration: mm/s².
        blend: radius, mm.
        flowing: as a `movep` does, go straight on through the target even without a blend.
        mark: what the program reports when the move begins, or -1.
    """

    pose: Array
    speed: float
    acceleration: float
    blend: float = 0.0
    flowing: bool = False
    mark: int = -1


@dataclass(frozen=True, eq=False)
class Path:
    """A sampled path.

    Attributes:
        positions: shape (n, 3), mm.
        rotations: n rotations.
        step: distance from each sample to the next, shape (n - 1,), mm.
        speed: largest speed on the way to the next sample, shape (n - 1,), mm/s.
        acceleration: shape (n - 1,), mm/s².
        rest: whether the tool comes to rest at a sample, shape (n,).
        marks: sample index and mark, in order.
    """

    positions: Array
    rotations: Rotation
    step: Array
    speed: Array
    acceleration: Array
    rest: npt.NDArray[np.bool_]
    marks: list[tuple[int, int]]


def path_through(start: Array, targets: Sequence[Target]) -> Path:
    """The path from a pose, shape (4, 4), mm, through all targets."""
    marks = [(0, targets[0].mark)]
    asked = np.array([start, *(target.pose for target in targets)])
    moving = np.flatnonzero(_steps(asked[:, :3, 3], Rotation.from_matrix(asked[:, :3, :3])) > STANDING)
    moves = [_strictest(targets[i:j]) for i, j in pairwise([*moving.tolist(), len(targets)])]
    poses = asked[[0, *(moving + 1)]]
    if not moves:
        return _standing(start, marks)

    corners = poses[:, :3, 3]
    leg = np.diff(corners, axis=0)
    length = np.linalg.norm(leg, axis=1)
    along = leg / np.maximum(length, 1e-9)[:, None]
    frames = Rotation.from_matrix(poses[:, :3, :3])
    turns = (frames[:-1].inv() * frames[1:]).as_rotvec().reshape(-1, 3)
    radius, bend, rest = _corners(length, along, moves)

    which: list[Array] = []  # the move that a sample belongs to
    share: list[Array] = []  # how far along it, for the orientation
    points: list[Array] = []
    resting = [0]
    total = 1
    for k in range(len(moves)):
        first, last = radius[k] / max(length[k], 1e-9), 1.0 - radius[k + 1] / max(length[k], 1e-9)
        weight = max(length[k], TURN_LENGTH * float(np.linalg.norm(turns[k])))
        fewest = REST_STEPS if rest[k] or rest[k + 1] else 1
        count = max(fewest, int(np.ceil((last - first) * weight / SPACING)))
        if last - first > 1e-9:
            u = np.linspace(first, last, count + 1)[0 if k == 0 else 1 :]
            which.append(np.full(len(u), k))
            share.append(u)
            points.append(corners[k] + u[:, None] * leg[k])
            total += len(u) - (k == 0)
        if k + 1 < len(moves) and radius[k + 1] > 0.0:
            arc, u = _arc(corners[k + 1], along[k], along[k + 1], radius[k + 1], bend[k + 1])
            half = len(u) // 2
            which.append(np.concatenate([np.full(half, k), np.full(half, k + 1)]))
            share.append(
                np.concatenate(
                    [
                        1.0 - (1.0 - u[:half]) * radius[k + 1] / length[k],
                        u[half:] * radius[k + 1] / length[k + 1],
                    ]
                )
            )
            points.append(arc)
            marks.append((total + half - 1, moves[k + 1].mark))
            total += len(u)
        elif k + 1 < len(moves):
            marks.append((total - 1, moves[k + 1].mark))
        if rest[k + 1]:
            resting.append(total - 1)
    owner = np.concatenate(which).astype(np.int64)
    positions = np.concatenate(points)
    rotations = frames[owner] * Rotation.from_rotvec(np.concatenate(share)[:, None] * turns[owner])
    step = _steps(positions, rotations)
    kept = np.concatenate([[True], step > NO_STEP])  # a tiny blend may have samples on one another
    place = np.cumsum(kept) - 1
    owner = owner[kept]
    return Path(
        positions=positions[kept],
        rotations=rotations[kept],
        step=step[kept[1:]],
        speed=np.array([move.speed for move in moves])[owner[1:]],
        acceleration=np.array([move.acceleration for move in moves])[owner[1:]],
        rest=np.isin(np.arange(len(owner)), place[resting]),
        marks=[(int(place[i]), mark) for i, mark in marks],
    )


def _strictest(targets: Sequence[Target]) -> Target:
    """A target with those after it that ask to go where the tool then is: it comes as near as any of them asks."""
    blend = min(target.blend for target in targets)
    return replace(targets[0], blend=blend, flowing=all(target.flowing for target in targets))


def _corners(length: Array, along: Array, moves: list[Target]) -> tuple[Array, Array, list[bool]]:
    """Blend radius, corner angle and whether the tool rests, at the start and at every target."""
    n = len(moves)
    radius, bend = np.zeros(n + 1), np.zeros(n + 1)
    rest = [True] * (n + 1)
    across = np.linalg.norm(np.cross(along[:-1], along[1:]), axis=1)
    bend[1:-1] = np.arctan2(across, (along[:-1] * along[1:]).sum(axis=1))
    for k, move in enumerate(moves[:-1], start=1):
        shorter = min(length[k - 1], length[k])
        if shorter < STANDING:
            continue  # a turn on the spot has no direction to blend with
        if bend[k] < STRAIGHT:
            rest[k] = move.blend <= 0.0 and not move.flowing
        elif bend[k] < REVERSAL and move.blend > STANDING:
            radius[k] = min(move.blend, shorter / 2.0)
            rest[k] = False
    return radius, bend, rest


def _arc(corner: Array, before: Array, after: Array, radius: float, bend: float) -> tuple[Array, Array]:
    """Samples of a blend without its first point, shape (2m, 3), and their share of each half, from 0 to 1."""
    curvature_radius = radius / np.tan(bend / 2.0)
    half = max(2, int(np.ceil(bend / 0.1)), int(np.ceil(curvature_radius * bend / SPACING)))
    f = np.arange(1, 2 * half + 1) / (2.0 * half)
    inward = (after - np.cos(bend) * before) / np.sin(bend)
    sine, rise = np.sin(f * bend)[:, None], (1.0 - np.cos(f * bend))[:, None]
    arc = corner - radius * before + curvature_radius * (sine * before + rise * inward)
    return arc, np.concatenate([2.0 * f[:half], 2.0 * f[half:] - 1.0])


def _steps(positions: Array, rotations: Rotation) -> Array:
    turned = (rotations[1:] * rotations[:-1].inv()).magnitude()
    step: Array = np.maximum(np.linalg.norm(np.diff(positions, axis=0), axis=1), TURN_LENGTH * turned)
    return step


def _standing(pose: Array, marks: list[tuple[int, int]]) -> Path:
    return Path(
        positions=pose[None, :3, 3],
        rotations=Rotation.from_matrix(pose[None, :3, :3]),
        step=np.empty(0),
        speed=np.empty(0),
        acceleration=np.empty(0),
        rest=np.ones(1, dtype=np.bool_),
        marks=marks,
    )
