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

TURN = 2.0 * math.pi

if TYPE_CHECKING:
    from collections.abc import Sequence

    from planning import Arm


def flange_frame(arm: Arm, joints: Sequence[float]) -> Numbers:
    """The flange's frame for joint angles in rad, as `Arm.forward` gives it."""
    q1, q2, q3, q4, q5, q6 = joints
    forearm = q2 + q3
    c1, s1 = math.cos(q1), math.sin(q1)
    c, s = math.cos(forearm + q4), math.sin(forearm + q4)
    c5, s5, c6, s6 = math.cos(q5), math.sin(q5), math.cos(q6), math.sin(q6)
    yx, yy = -s * c1, -s * s1
    flat = c5 * c
    xx, xy, xz = flat * c1 + s5 * s1, flat * s1 - s5 * c1, c5 * s
    flat = s5 * c
    zx, zy, zz = c5 * s1 - flat * c1, -c5 * c1 - flat * s1, -s5 * s
    out = arm.a2 * math.cos(q2) + arm.a3 * math.cos(forearm)
    up = arm.d1 + arm.a2 * math.sin(q2) + arm.a3 * math.sin(forearm)
    return (
        *(c6 * xx + s6 * yx, c6 * xy + s6 * yy, c6 * xz + s6 * c),
        *(c6 * yx - s6 * xx, c6 * yy - s6 * xy, c6 * c - s6 * xz),
        *(zx, zy, zz),
        out * c1 + arm.d4 * s1 - arm.d5 * yx + arm.d6 * zx,
        out * s1 - arm.d4 * c1 - arm.d5 * yy + arm.d6 * zy,
        up - arm.d5 * c + arm.d6 * zz,
    )


def joint_solutions(arm: Arm, flange: Numbers) -> list[Numbers]:
    """Every solution that `Arm.inverse` gives for the flange's frame, in rad, without the missing ones."""
    heading, shoulder = _shoulder(arm, flange)
    found: list[Numbers] = []
    if shoulder < 0.0:
        return found
    for side in (shoulder, -shoulder):
        q1 = heading + math.atan2(arm.d4, side)
        normal = _along_normal(flange, q1)
        if math.hypot(normal[0], normal[1]) <= ANGLE_TOLERANCE:
            return _from_arrays(arm, flange)  # joint 6 is a matter of choice; there is one place for that
        for wrist in (1.0, -1.0):
            for elbow in (1.0, -1.0):
                joints = _posture(arm, flange, q1, normal, wrist, elbow)
                if joints is not None:
                    found.append(joints)
    return found


def nearby_joints(arm: Arm, flange: Numbers, near: Sequence[float]) -> Numbers | None:
    """The solution in the posture of joint angles nearby, with its turns near theirs, if it is surely the nearest.

    Every other posture differs in joint 1, 3 or 5 by twice its distance from where two postures meet. While no joint
    is further from `near` than that distance, no other posture is nearer.
    """
    heading, shoulder = _shoulder(arm, flange)
    if shoulder < 0.0:
        return None
    side = shoulder if math.cos(near[0] - heading) > 0.0 else -shoulder
    q1 = heading + math.atan2(arm.d4, side)
    normal = _along_normal(flange, q1)
    if math.hypot(normal[0], normal[1]) <= ANGLE_TOLERANCE:
        return None
    wrist = math.copysign(1.0, math.sin(near[4]))
    joints = _posture(arm, flange, q1, normal, wrist, math.copysign(1.0, math.sin(near[2])))
    if joints is None:
        return None
    elbow, bend = abs(joints[2]), abs(joints[4])
    apart = min(math.atan2(shoulder, arm.d4), elbow, math.pi - elbow, bend, math.pi - bend)
    gaps = [angle - to for angle, to in zip(joints, near, strict=True)]
    if max(gaps) <= apart and min(gaps) >= -apart:
        return joints
    turned = []
    for angle, gap in zip(joints, gaps, strict=True):
        if abs(gap) > apart:
            turns = TURN * round(gap / TURN)
            if abs(gap - turns) > apart:
                return None
            turned.append(angle - turns)
        else:
            turned.append(angle)
    return tuple(turned)


def _shoulder(arm: Arm, flange: Numbers) -> tuple[float, float]:
    """Direction of the wrist, rad, and how far it stands along the arm's plane, mm; below 0 if out of reach."""
    wx, wy = flange[9] - arm.d6 * flange[6], flange[10] - arm.d6 * flange[7]
    reach = math.hypot(wx, wy)
    if reach < arm.d4 - LENGTH_TOLERANCE:
        return 0.0, -1.0
    return math.atan2(wy, wx), math.sqrt(max((reach - arm.d4) * (reach + arm.d4), 0.0))


def _along_normal(flange: Numbers, q1: float) -> Numbers:
    """The flange's axes along the normal of the arm's plane."""
    c1, s1 = math.cos(q1), math.sin(q1)
    return (
        flange[0] * s1 - flange[1] * c1,
        flange[3] * s1 - flange[4] * c1,
        flange[6] * s1 - flange[7] * c1,
    )


def _posture(
    arm: Arm, flange: Numbers, q1: float, normal: Numbers, wrist: float, elbow: float
) -> Numbers | None:
    """The solution with given signs of the sines of joints 5 and 3, rad."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz, px, py, pz = flange
    nx, ny, nz = normal
    c1, s1 = math.cos(q1), math.sin(q1)
    sine = math.hypot(nx, ny)
    s5, s6, c6 = wrist * sine, -wrist * ny / sine, wrist * nx / sine
    x5 = (c6 * xx - s6 * yx, c6 * xy - s6 * yy, c6 * xz - s6 * yz)
    y5 = (s6 * xx + c6 * yx, s6 * xy + c6 * yy, s6 * xz + c6 * yz)
    flat = (nz * x5[0] - s5 * zx) * c1 + (nz * x5[1] - s5 * zy) * s1
    pitch = math.atan2(nz * x5[2] - s5 * zz, flat)
    out = (px - arm.d6 * zx + arm.d5 * y5[0]) * c1 + (py - arm.d6 * zy + arm.d5 * y5[1]) * s1
    up = pz - arm.d6 * zz + arm.d5 * y5[2] - arm.d1
    # Near a wrist in line rounding moves the end of the arm by more.
    slack = LENGTH_TOLERANCE + min(ROUNDING * abs(arm.d5) / sine, MOST_SLACK)
    a2, a3 = arm.a2, arm.a3
    distance = math.hypot(out, up)
    if not abs(a2 - a3) - slack <= distance <= abs(a2 + a3) + slack:
        return None
    cosine = (distance * distance - a2 * a2 - a3 * a3) / (2.0 * a2 * a3)
    s3 = elbow * math.sqrt(max((1.0 - cosine) * (1.0 + cosine), 0.0))
    q3 = math.atan2(s3, cosine)
    q2 = math.atan2(up, out) - math.atan2(a3 * s3, a2 + a3 * cosine)
    return (q1, q2, q3, pitch - q2 - q3, math.atan2(s5, nz), math.atan2(s6, c6))


def _from_arrays(arm: Arm, flange: Numbers) -> list[Numbers]:
    pose = np.eye(4)
    pose[:3] = np.array(flange).reshape(4, 3).T
    solutions = arm.inverse(pose[None])[0]
    return [tuple(row) for row in solutions[~np.isnan(solutions).any(axis=1)].tolist()]
