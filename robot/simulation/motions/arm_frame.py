"""The arm's kinematics for one frame in plain numbers: `planning.Arm` for the controller's cycle.

The formulas are those of `planning/kinematics.py`; see there for what they mean.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from planning.kinematics import ANGLE_TOLERANCE, LENGTH_TOLERANCE

from .frame import Numbers

ROUNDING = 1e-15
"""Of a direction's components."""

MOST_SLACK = 1e-4
"""By which a straight arm may miss a place for rounding, mm."""

if TYPE_CHECKING:
    from collections.abc import Sequence

    from planning import Arm


def flange_frame(arm: Arm, joints: Sequence[float]) -> Numbers:
    """The flange's frame for joint angles in rad, as `Arm.forward` gives it."""
    q1, q2, q3, q4, q5, q6 = joints
    c1, s1 = math.cos(q1), math.sin(q1)
    c, s = math.cos(q2 + q3 + q4), math.sin(q2 + q3 + q4)
    c5, s5, c6, s6 = math.cos(q5), math.sin(q5), math.cos(q6), math.sin(q6)
    y5 = (-s * c1, -s * s1, c)
    x5 = (c5 * c * c1 + s5 * s1, c5 * c * s1 - s5 * c1, c5 * s)
    z5 = (c5 * s1 - s5 * c * c1, -c5 * c1 - s5 * c * s1, -s5 * s)
    out = arm.a2 * math.cos(q2) + arm.a3 * math.cos(q2 + q3)
    up = arm.d1 + arm.a2 * math.sin(q2) + arm.a3 * math.sin(q2 + q3)
    return (
        *(c6 * x5[i] + s6 * y5[i] for i in (0, 1, 2)),
        *(c6 * y5[i] - s6 * x5[i] for i in (0, 1, 2)),
        *z5,
        out * c1 + arm.d4 * s1 - arm.d5 * y5[0] + arm.d6 * z5[0],
        out * s1 - arm.d4 * c1 - arm.d5 * y5[1] + arm.d6 * z5[1],
        up - arm.d5 * y5[2] + arm.d6 * z5[2],
    )


def joint_solutions(arm: Arm, flange: Numbers) -> list[Numbers]:
    """Every solution that `Arm.inverse` gives for the flange's frame, in rad, without the missing ones."""
    xx, yx, zx, xy, yy, zy, xz, yz, zz, px, py, pz = flange
    wx, wy = px - arm.d6 * xz, py - arm.d6 * yz
    reach = math.hypot(wx, wy)
    if reach < arm.d4 - LENGTH_TOLERANCE:
        return []
    heading = math.atan2(wy, wx)
    shoulder = math.sqrt(max((reach - arm.d4) * (reach + arm.d4), 0.0))
    found: list[Numbers] = []
    for side in (shoulder, -shoulder):
        q1 = heading + math.atan2(arm.d4, side)
        c1, s1 = math.cos(q1), math.sin(q1)
        nx, ny, nz = (
            xx * s1 - yx * c1,
            xy * s1 - yy * c1,
            xz * s1 - yz * c1,
        )  # the flange's axes along the normal
        sine = math.hypot(nx, ny)
        if sine <= ANGLE_TOLERANCE:
            return _from_arrays(arm, flange)  # joint 6 is a matter of choice; there is one place for that
        for sign in (1.0, -1.0):
            q5 = math.atan2(sign * sine, nz)
            c5, s5, c6, s6 = nz, sign * sine, sign * nx / sine, -sign * ny / sine
            q6 = math.atan2(s6, c6)
            x5 = (c6 * xx - s6 * xy, c6 * yx - s6 * yy, c6 * zx - s6 * zy)
            y5 = (s6 * xx + c6 * xy, s6 * yx + c6 * yy, s6 * zx + c6 * zy)
            flat = (c5 * x5[0] - s5 * xz) * c1 + (c5 * x5[1] - s5 * yz) * s1
            pitch = math.atan2(c5 * x5[2] - s5 * zz, flat)
            out = (wx + arm.d5 * y5[0]) * c1 + (wy + arm.d5 * y5[1]) * s1
            up = pz - arm.d6 * zz + arm.d5 * y5[2] - arm.d1
            # Near a wrist in line rounding moves the end of the arm by more.
            slack = LENGTH_TOLERANCE + min(ROUNDING * abs(arm.d5) / sine, MOST_SLACK)
            found += _elbows(arm, out, up, pitch, (q1, q5, q6), slack)
    return found


def _elbows(arm: Arm, out: float, up: float, pitch: float, outer: Numbers, slack: float) -> list[Numbers]:
    """Both ways to bend the arm so that it ends at (out, up) in its plane, or within `slack` of its reach, mm."""
    a2, a3 = arm.a2, arm.a3
    distance = math.hypot(out, up)
    if not abs(a2 - a3) - slack <= distance <= abs(a2 + a3) + slack:
        return []
    cosine = (distance * distance - a2 * a2 - a3 * a3) / (2.0 * a2 * a3)
    sine = math.sqrt(max((1.0 - cosine) * (1.0 + cosine), 0.0))
    direction = math.atan2(up, out)
    q1, q5, q6 = outer
    found: list[Numbers] = []
    for s3 in (sine, -sine):
        q3 = math.atan2(s3, cosine)
        q2 = direction - math.atan2(a3 * s3, a2 + a3 * cosine)
        found.append((q1, q2, q3, pitch - q2 - q3, q5, q6))
    return found


def _from_arrays(arm: Arm, flange: Numbers) -> list[Numbers]:
    pose = np.eye(4)
    pose[:3] = np.array(flange).reshape(4, 3).T
    solutions = arm.inverse(pose[None])[0]
    return [tuple(row) for row in solutions[~np.isnan(solutions).any(axis=1)].tolist()]
