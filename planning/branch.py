"""Branch: one continuous set of joint angles for a whole job.

An arm reaches a pose with up to eight postures. A job stays in one of them: changing it on the way would swing
the arm through the part.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .kinematics import Arm

Array = npt.NDArray[np.float64]


def continuous_branch(arm: Arm, flange: Array, home: Array, limit: Array) -> Array:
    """Joint angles along a path.

    Of the eight branches the one is taken that reaches the most poses, then keeps joint limits most often, then turns
    its joints least between waypoints, then starts nearest to `home`.

    Args:
        arm: the robot model.
        flange: flange poses, shape (n, 4, 4), mm, base frame.
        home: joint angles at rest, shape (6,), rad.
        limit: joint limits either way, shape (6,), rad.

    Returns:
        shape (n, 6), rad; NaN where no posture of the branch reaches the pose.
    """
    solutions = arm.inverse(flange)
    best: tuple[tuple[int, int, float, float], Array] | None = None
    for k in range(solutions.shape[1]):
        joints = _unwound(solutions[:, k], home, limit)
        reached = ~np.isnan(joints).any(axis=1)
        if not reached.any():
            continue
        found = joints[reached]
        beyond = int((np.abs(found) > limit + 1e-9).any(axis=1).sum())
        turning = float(np.abs(np.diff(found, axis=0)).max()) if len(found) > 1 else 0.0
        rank = (int((~reached).sum()), beyond, round(turning, 2), float(np.abs(found[0] - home).sum()))
        if best is None or rank < best[0]:
            best = (rank, joints)
    return best[1] if best else np.full((len(flange), 6), np.nan)


def branch_from(arm: Arm, flange: Array, start: Array) -> Array:
    """Joint angles along a path, in the posture that the arm is in where the path begins.

    Args:
        arm: the robot model.
        flange: flange poses, shape (n, 4, 4), mm, base frame.
        start: joint angles that reach the first of them, shape (6,), rad.

    Returns:
        shape (n, 6), rad; NaN where that posture does not reach the pose.
    """
    solutions = arm.inverse(flange)
    away = np.abs(np.mod(solutions[0] - start + np.pi, 2.0 * np.pi) - np.pi).max(axis=1)
    joints = np.vstack([start, solutions[:, int(np.nanargmin(away))]])
    reached = ~np.isnan(joints).any(axis=1)
    joints[reached] = np.unwrap(joints[reached], axis=0)
    return joints[1:]


def _unwound(joints: Array, home: Array, limit: Array) -> Array:
    """Joint angles without jumps of whole turns, the whole path shifted as near to home as its limits allow."""
    joints = joints.copy()
    reached = ~np.isnan(joints).any(axis=1)
    if not reached.any():
        return joints
    path = np.unwrap(joints[reached], axis=0)
    for j in range(path.shape[1]):
        turns = 2.0 * np.pi * np.arange(-2, 3)
        excess = [max(0.0, float(np.abs(path[:, j] + turn).max()) - limit[j]) for turn in turns]
        away = [abs(float(path[:, j].mean()) + turn - home[j]) for turn in turns]
        path[:, j] += turns[min(range(len(turns)), key=lambda i: (round(excess[i], 9), away[i]))]
    joints[reached] = path
    return joints
