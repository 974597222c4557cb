"""Which of the arm's postures is meant by a pose: the one nearest to where the joints are."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from .arm_frame import TURN, joint_solutions, nearby_joints

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from planning import Arm

    from .frame import Numbers

    Array = npt.NDArray[np.float64]


def nearest_joints(
    arm: Arm, flange: Numbers, near: Sequence[float], limit: Sequence[float]
) -> Numbers | None:
    """Joint angles for one frame of the flange, nearest to others, all in rad.

    None where there are none within the limits.
    """
    nearby = nearby_joints(arm, flange, near)
    if nearby is not None and all(map(float.__le__, map(abs, nearby), limit)):
        return nearby
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
