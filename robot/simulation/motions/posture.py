"""Which of the arm's postures is meant by a pose: the one nearest to where the joints are."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from planning import ReachError

from .arm_frame import joint_solutions

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from planning import Arm

    from .frame import Numbers

    Array = npt.NDArray[np.float64]

BLOCK = 256  # poses at a time, so that planning in a thread does not hold up the controller's cycle
LARGEST_STEP = 0.5  # rad between neighbouring samples of a path; more is a jump to another posture
TURN = 2.0 * np.pi


def joints_along(arm: Arm, flanges: Array, start: Array, limit: Array) -> Array:
    """Joint angles along a path of flange poses, in the posture that the arm starts in.

    Args:
        arm: the kinematics.
        flanges: shape (n, 4, 4), mm.
        start: joint angles where the path begins, shape (6,), rad.
        limit: largest angle of each joint either way, shape (6,), rad.

    Returns:
        Shape (n, 6), rad, continuous from `start`.

    Raises:
        ReachError: the path leaves the arm's reach or a joint's limits, or passes through a singularity.
    """
    solutions = np.concatenate(
        [arm.inverse(flanges[i : i + BLOCK]) for i in range(0, len(flanges), BLOCK)] or [np.empty((0, 8, 6))]
    )
    joints = solutions[:, _branch(solutions[0], start)]
    lost = np.flatnonzero(np.isnan(joints).any(axis=1))
    if len(lost):
        at = flanges[lost[0], :3, 3]
        raise ReachError(f"no inverse kinematics at flange position {at.round(1)} mm")
    joints = np.unwrap(np.vstack([start, joints]), axis=0)[1:]
    step = np.abs(np.diff(joints, axis=0, prepend=start[None])).max(axis=1)
    if step.max() > LARGEST_STEP:
        at = flanges[int(step.argmax()), :3, 3]
        raise ReachError(f"a singularity near flange position {at.round(1)} mm makes a joint jump")
    if (np.abs(joints) > limit + 1e-9).any():
        joint = int((np.abs(joints) - limit).max(axis=0).argmax())
        raise ReachError(f"the path takes joint {joint + 1} over its limit")
    return joints


def nearest_joints(
    arm: Arm, flange: Numbers, near: Sequence[float], limit: Sequence[float]
) -> Numbers | None:
    """Joint angles for one frame of the flange, nearest to others, all in rad.

    None where there are none within the limits.
    """
    best, least = None, math.inf
    for solution in joint_solutions(arm, flange):
        joints = tuple([_turned_near(q, n, most) for q, n, most in zip(solution, near, limit, strict=True)])
        turn = max([abs(q - n) for q, n in zip(joints, near, strict=True)])
        if turn < least:  # never so where a joint is beyond its limit
            best, least = joints, turn
    return best


def _turned_near(angle: float, near: float, most: float) -> float:
    """The angle with as many whole turns as bring it near another, but within its limit."""
    angle += TURN * round((near - angle) / TURN)
    if abs(angle) > most + 1e-9:
        angle -= math.copysign(TURN, angle)
    return angle if abs(angle) <= most + 1e-9 else math.inf


def _branch(solutions: Array, near: Array) -> int:
    """Index of the solution, of shape (8, 6), whose largest joint turn from `near` is least."""
    turn = np.abs(np.pi - np.mod(np.pi - (solutions - near), TURN)).max(axis=1)
    return int(np.where(np.isnan(turn), np.inf, turn).argmin())
