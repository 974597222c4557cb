"""One frame at a time in plain numbers, for the controller's cycle: arrays of one are slow.

A frame is twelve numbers: the columns x, y and z of its rotation and its origin, in mm.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    import numpy.typing as npt

Numbers = tuple[float, ...]

UNTURNED: Numbers = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
"""The base's own frame."""


def frame_of(pose: npt.NDArray[np.float64]) -> Numbers:
    """A pose matrix, shape (4, 4), as a frame."""
    (xx, yx, zx, px), (xy, yy, zy, py), (xz, yz, zz, pz), _ = pose.tolist()
    return (xx, xy, xz, yx, yy, yz, zx, zy, zz, px, py, pz)


def compose(a: Numbers, b: Numbers) -> Numbers:
    """Frame b, given in frame a, in what frame a is given in."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz, ox, oy, oz = a
    p, q, r, s, t, u, v, w, k, x, y, z = b
    return (
        *(xx * p + yx * q + zx * r, xy * p + yy * q + zy * r, xz * p + yz * q + zz * r),
        *(xx * s + yx * t + zx * u, xy * s + yy * t + zy * u, xz * s + yz * t + zz * u),
        *(xx * v + yx * w + zx * k, xy * v + yy * w + zy * k, xz * v + yz * w + zz * k),
        *(xx * x + yx * y + zx * z + ox, xy * x + yy * y + zy * z + oy, xz * x + yz * y + zz * z + oz),
    )


def frame_at(pose: Sequence[float]) -> Numbers:
    """The frame at a pose: mm and a rotation vector in rad."""
    x, y, z, rx, ry, rz = pose
    return (*_rotation(rx, ry, rz), x, y, z)


def pose_numbers(frame: Numbers) -> Numbers:
    """A frame as a pose: mm and a rotation vector in rad."""
    return (*frame[9:12], *turn(_quaternion(frame)))


def inverse(frame: Numbers) -> Numbers:
    """The frame in which the other stands where this one stands in it."""
    xx, yx, zx, xy, yy, zy, xz, yz, zz, px, py, pz = frame
    origin = (-(xx * px + yx * py + zx * pz), -(xy * px + yy * py + zy * pz), -(xz * px + yz * py + zz * pz))
    return (xx, xy, xz, yx, yy, yz, zx, zy, zz, *origin)


def rotation_between(a: Numbers, b: Numbers) -> Numbers:
    """The rotation vector, rad, that turns a frame's axes into another's, in the axes that both are given in."""
    if a[:9] == b[:9]:
        return (0.0, 0.0, 0.0)
    # The sum of the cross products of like axes is twice the sine of the angle along the rotation's axis.
    ax, ay, az, bx, by, bz, cx, cy, cz = a[:9]
    px, py, pz, qx, qy, qz, rx, ry, rz = b[:9]
    x = ay * pz - az * py + by * qz - bz * qy + cy * rz - cz * ry
    y = az * px - ax * pz + bz * qx - bx * qz + cz * rx - cx * rz
    z = ax * py - ay * px + bx * qy - by * qx + cx * ry - cy * rx
    cosine = ax * px + ay * py + az * pz + bx * qx + by * qy + bz * qz + cx * rx + cy * ry + cz * rz - 1.0
    if cosine <= 0.0:  # the sine is a poor measure of large angles
        return _large_rotation(a, b)
    sine = math.sqrt(x * x + y * y + z * z)
    if sine < 1e-15:
        return (0.0, 0.0, 0.0)
    factor = math.atan2(sine, cosine) / sine
    return (x * factor, y * factor, z * factor)


def _large_rotation(a: Numbers, b: Numbers) -> Numbers:
    (ax, ay, az, aw), (bx, by, bz, bw) = _quaternion(a), _quaternion(b)
    return turn(
        (
            -bw * ax + bx * aw - by * az + bz * ay,
            -bw * ay + by * aw - bz * ax + bx * az,
            -bw * az + bz * aw - bx * ay + by * ax,
            bw * aw + bx * ax + by * ay + bz * az,
        )
    )


def speed_between(a: Numbers, b: Numbers, seconds: float) -> Numbers:
    """Mean speed that takes a frame to another: mm/s and rad/s."""
    moved = (b[9] - a[9], b[10] - a[10], b[11] - a[11], *rotation_between(a, b))
    return tuple([m / seconds for m in moved])


def turned(frame: Numbers, vector: Sequence[float]) -> Numbers:
    """A frame turned about its origin by a rotation vector, rad, given in the same axes as the frame."""
    if not any(vector):
        return frame
    turning = (*_rotation(*vector), 0.0, 0.0, 0.0)
    return compose(turning, (*frame[:9], 0.0, 0.0, 0.0))[:9] + frame[9:]


def _rotation(x: float, y: float, z: float) -> Numbers:
    """The columns of a rotation vector's matrix."""
    angle = math.hypot(x, y, z)
    if angle == 0.0:
        return UNTURNED[:9]
    x, y, z = x / angle, y / angle, z / angle
    c, s = math.cos(angle), math.sin(angle)
    r = 1.0 - c
    xy, xz, yz = r * x * y, r * x * z, r * y * z
    sx, sy, sz = s * x, s * y, s * z
    return (r * x * x + c, xy + sz, xz - sy, xy - sz, r * y * y + c, yz + sx, xz + sy, yz - sx, r * z * z + c)


def turn(quaternion: Sequence[float]) -> Numbers:
    """The rotation vector, rad, of a quaternion (x, y, z, w) of any length."""
    x, y, z, w = quaternion
    sine = math.sqrt(x * x + y * y + z * z)
    if sine < 1e-15:
        return (0.0, 0.0, 0.0)
    if abs(w) < 1e-9 * sine:  # half a turn, as of a tool that points down: rounding must not choose its sense
        tiny = 1e-9 * sine
        w = math.copysign(w, x if abs(x) > tiny else y if abs(y) > tiny else z)
    factor = math.copysign(2.0 * math.atan2(sine, abs(w)) / sine, w)
    return (x * factor, y * factor, z * factor)


def _quaternion(frame: Numbers) -> Numbers:
    """(x, y, z, w), from its largest component."""
    xx, yx, zx, xy, yy, zy, xz, yz, zz = frame[:9]
    squares = (1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz, 1.0 + xx + yy + zz)
    largest = squares.index(max(squares))
    size = 2.0 * math.sqrt(squares[largest])
    part = 0.25 * size
    if largest == 0:
        return (part, (yx + xy) / size, (zx + xz) / size, (zy - yz) / size)
    if largest == 1:
        return ((yx + xy) / size, part, (zy + yz) / size, (xz - zx) / size)
    if largest == 2:
        return ((zx + xz) / size, (zy + yz) / size, part, (yx - xy) / size)
    return ((zy - yz) / size, (xz - zx) / size, (yx - xy) / size, part)


def metres(mm: Sequence[float]) -> Numbers:
    """A pose or a speed of the tool with its lengths in metres."""
    x, y, z, rx, ry, rz = mm
    return (x / 1000.0, y / 1000.0, z / 1000.0, rx, ry, rz)


def millimetres(m: Sequence[float]) -> Numbers:
    """A pose or a speed of the tool, given in metres, with its lengths in mm."""
    x, y, z, rx, ry, rz = m
    return (x * 1000.0, y * 1000.0, z * 1000.0, rx, ry, rz)
