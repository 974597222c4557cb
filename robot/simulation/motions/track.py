"""A track: a planned motion as a table, from which the controller's cycle reads without planning.

Sampled joints and tool poses stand against the distance run and the time of arrival. Distance is the tool's in mm
for moves of the tool, and the leading joint's in rad for moves of the joints. Speeds come from one pass forward and
one backward over the samples, so that every speed limit and every stop ahead is met with the given acceleration.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from .path import Target, path_through
from .posture import joints_along

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from planning import Arm

    Array = npt.NDArray[np.float64]

JOINT_SPACING = 0.004  # rad of the leading joint between samples


@dataclass(frozen=True, eq=False)
class Track:
    """n samples; plain lists, because the cycle reads one entry at a time.

    Attributes:
        time: of arrival at a sample, s.
        distance: run until a sample.
        speed: distance per second at a sample.
        joints: rad.
        positions: of the tool, mm.
        rotations: of the tool, quaternions (x, y, z, w) without changes of sign.
        joint_slope, slope, spin: change of joints, position and orientation per distance, to the next sample.
        limit, acceleration: on the way to the next sample.
        rest: whether the motion rests at a sample.
        marks: distance at which a mark is passed, and the mark.
    """

    time: list[float]
    distance: list[float]
    speed: list[float]
    joints: list[tuple[float, ...]]
    positions: list[tuple[float, ...]]
    rotations: list[tuple[float, ...]]
    joint_slope: list[tuple[float, ...]]
    slope: list[tuple[float, ...]]
    spin: list[tuple[float, ...]]
    limit: list[float]
    acceleration: list[float]
    rest: list[bool]
    marks: list[tuple[float, int]]

    @property
    def throttle_rate(self) -> float:
        """How fast the speed slider may act, 1/s, without asking for more than the motion's acceleration."""
        return min(self.acceleration) / max(self.limit) if self.limit else 1.0


def tool_track(
    arm: Arm, tool: Array, start: Array, targets: Sequence[Target], limit: Array, start_speed: float = 0.0
) -> Track:
    """Moves of the tool.

    Args:
        arm: the kinematics.
        tool: in the flange frame, shape (4, 4), mm.
        start: joint angles, shape (6,), rad.
        targets: where to, one after another.
        limit: largest joint angles, shape (6,), rad.
        start_speed: of the tool along the first move, mm/s.

    Raises:
        ReachError: the arm cannot follow.
    """
    path = path_through(arm.forward(start[None])[0] @ tool, targets)
    poses = np.tile(np.eye(4), (len(path.positions), 1, 1))
    poses[:, :3, :3] = path.rotations.as_matrix()
    poses[:, :3, 3] = path.positions
    joints = joints_along(arm, poses @ np.linalg.inv(tool), start, limit)
    distance = np.concatenate([[0.0], np.cumsum(path.step)])
    return _tabulate(
        distance=distance,
        joints=joints,
        positions=path.positions,
        rotations=path.rotations,
        limit=path.speed,
        acceleration=path.acceleration,
        rest=path.rest,
        marks=[(float(distance[i]), mark) for i, mark in path.marks],
        start_speed=start_speed,
    )


def joint_track(
    arm: Arm, tool: Array, start: Array, end: Array, speed: float, acceleration: float, mark: int = -1
) -> Track:
    """A move of the joints, all together; `speed` in rad/s and `acceleration` in rad/s² are the leading joint's."""
    span = float(np.abs(end - start).max())
    count = max(16, int(np.ceil(span / JOINT_SPACING))) if span > 1e-9 else 0
    share = np.linspace(0.0, 1.0, count + 1)
    joints = start + share[:, None] * (end - start)
    poses = arm.forward(joints) @ tool
    return _tabulate(
        distance=share * span,
        joints=joints,
        positions=poses[:, :3, 3],
        rotations=Rotation.from_matrix(poses[:, :3, :3]),
        limit=np.full(count, speed),
        acceleration=np.full(count, acceleration),
        rest=(share == 0.0) | (share == 1.0),
        marks=[(0.0, mark)],
        start_speed=0.0,
    )


def rest_of(track: Track, index: int, distance: float) -> Track:
    """What is left of a track from a distance behind sample `index`, beginning at rest."""
    at = distance - track.distance[index]
    along = at / max(track.distance[index + 1] - track.distance[index], 1e-12)

    def tail(samples: list[tuple[float, ...]]) -> Array:
        a, b = np.array(samples[index]), np.array(samples[index + 1])
        return np.vstack([a + along * (b - a), np.array(samples[index + 1 :])])

    rotations = Rotation.from_quat(tail(track.rotations))
    distances = np.array([distance, *track.distance[index + 1 :]])
    if len(distances) > 2 and distances[1] - distances[0] < 1e-9:
        distances[0] -= 1e-9
    return _tabulate(
        distance=distances,
        joints=tail(track.joints),
        positions=tail(track.positions),
        rotations=rotations,
        limit=np.array(track.limit[index:]),
        acceleration=np.array(track.acceleration[index:]),
        rest=np.array([True, *track.rest[index + 1 :]]),
        marks=[(at, mark) for at, mark in track.marks if at > distance],
        start_speed=0.0,
    )


def _tabulate(
    *,
    distance: Array,
    joints: Array,
    positions: Array,
    rotations: Rotation,
    limit: Array,
    acceleration: Array,
    rest: npt.NDArray[np.bool_],
    marks: list[tuple[float, int]],
    start_speed: float,
) -> Track:
    step = np.diff(distance)
    speed = _speeds(step.tolist(), limit.tolist(), acceleration.tolist(), rest.tolist(), start_speed)
    mean = 0.5 * (speed[1:] + speed[:-1])
    quaternions = rotations.as_quat().reshape(-1, 4)
    flips = np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    quaternions[1:] *= np.cumprod(flips)[:, None]
    spin = (rotations[1:] * rotations[:-1].inv()).as_rotvec().reshape(-1, 3)
    return Track(
        time=[0.0, *np.cumsum(step / mean).tolist()],
        distance=distance.tolist(),
        speed=speed.tolist(),
        joints=_rows(joints),
        positions=_rows(positions),
        rotations=_rows(quaternions),
        joint_slope=_rows(np.diff(joints, axis=0) / step[:, None]),
        slope=_rows(np.diff(positions, axis=0) / step[:, None]),
        spin=_rows(spin / step[:, None]),
        limit=limit.tolist(),
        acceleration=acceleration.tolist(),
        rest=rest.tolist(),
        marks=marks,
    )


def _rows(values: Array) -> list[tuple[float, ...]]:
    return [tuple(row) for row in values.tolist()]


def _speeds(
    step: list[float], limit: list[float], acceleration: list[float], rest: list[bool], start_speed: float
) -> Array:
    """Speed at each sample: as fast as the limits, the stops and the accelerations let it be."""
    n = len(rest)
    cap = [0.0, *(0.0 if rest[i + 1] else min(a, b) for i, (a, b) in enumerate(pairwise(limit))), 0.0][:n]
    gain = [2.0 * a * way for a, way in zip(acceleration, step, strict=True)]
    speed = [start_speed] + [0.0] * (n - 1)
    for i in range(n - 2):  # a start that is too fast for its limit cannot but brake down to it
        braked = max(speed[0] ** 2 - sum(gain[: i + 1]), 0.0) ** 0.5
        if braked <= cap[i + 1] or rest[i + 1]:
            break
        cap[i + 1] = braked
    for i in range(n - 1):
        speed[i + 1] = min(cap[i + 1], (speed[i] * speed[i] + gain[i]) ** 0.5)
    for i in range(n - 2, 0, -1):
        speed[i] = min(speed[i], (speed[i + 1] * speed[i + 1] + gain[i]) ** 0.5)
    return np.array(speed)
