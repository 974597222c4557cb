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


def frame_of(pose: npt.NDArray[np.float64]) -> Numbers:
    """A pose matrix, shape (4, 4), as a frame."""
    rows: list[list[float]] = pose.tolist()
    return tuple(rows[i][j] for j in range(4) for i in range(3))


def compose(a: Numbers, b: Numbers) -> Numbers:
    """Frame b, given in frame a, in what frame a is given in."""
    ax, ay, az, ao = a[0:3], a[3:6], a[6:9], a[9:12]
    columns = []
    for j in (0, 3, 6):
        u, v, w = b[j : j + 3]
        columns += [ax[i] * u + ay[i] * v + az[i] * w for i in (0, 1, 2)]
    u, v, w = b[9:12]
    return (*columns, *(ax[i] * u + ay[i] * v + az[i] * w + ao[i] for i in (0, 1, 2)))


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
    angle = math.hypot(*vector)
    if angle == 0.0:
        return frame
    kx, ky, kz = (v / angle for v in vector)
    c, s = math.cos(angle), math.sin(angle)
    columns: list[float] = []
    for j in (0, 3, 6):
        x, y, z = frame[j : j + 3]
        along = (kx * x + ky * y + kz * z) * (1.0 - c)
        columns += (
            x * c + (ky * z - kz * y) * s + kx * along,
            y * c + (kz * x - kx * z) * s + ky * along,
            z * c + (kx * y - ky * x) * s + kz * along,
        )
    return (*columns, *frame[9:12])


def turn(quaternion: Sequence[float]) -> Numbers:
    """The rotation vector, rad, of a quaternion (x, y, z, w) of any length."""
    x, y, z, w = quaternion
    sine = math.sqrt(x * x + y * y + z * z)
    if sine < 1e-15:
        return (0.0, 0.0, 0.0)
    if abs(w) < 1e-9 * sine:  # half a turn, as of a tool that points down: rounding must not choose its sense
        w = math.copysign(w, next(v for v in (x, y, z) if abs(v) > 1e-9 * sine))
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


def metres(mm: Numbers) -> Numbers:
    """A pose or a speed of the tool with its lengths in metres."""
    x, y, z, rx, ry, rz = mm
    return (x / 1000.0, y / 1000.0, z / 1000.0, rx, ry, rz)


def millimetres(m: Numbers) -> Numbers:
    """A pose or a speed of the tool, given in metres, with its lengths in mm."""
    x, y, z, rx, ry, rz = m
    return (x * 1000.0, y * 1000.0, z * 1000.0, rx, ry, rz)
