"""Plane order: slicing planes must not cross inside the part.

A bounding box settles it for nearly all pairs of neighbouring planes; for the others the corners of faces and then the
points of the cuts are looked at, which is exact, since a plane's height over another is linear.
"""

from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np
import numpy.typing as npt

from .errors import PlanesError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[Any]
"""Whole numbers: int32, or int64 where the mesh or its cuts are too many for that."""

_BLOCK = 128
"""Faces that share one bounding box."""


def refuse_crossing(plane: int, x: float, y: float, z: float) -> None:
    if plane >= 0:
        raise PlanesError(
            f"the slicing planes of layers {plane} and {plane + 1} cross inside the part: at "
            f"({x:.3f}, {y:.3f}, {z:.3f}) plane {plane + 1} is below plane {plane}; order the planes from the bed up "
            "and tilt them so that they meet outside the part, or slice the part in pieces"
        )


@nb.njit(cache=True, nogil=True)
def height_over(planes: Array, k: int, x: float, y: float, z: float) -> float:
    """The one evaluation of a point's height over plane k that everything is decided by, mm."""
    return float(planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z - planes[k, 3])


@nb.njit(cache=True, nogil=True)
def face_boxes(vertices: Array, faces: Indices) -> Array:
    """Least and greatest coordinates of every _BLOCK faces, shape (blocks, 2, 3), mm."""
    boxes = np.empty((-(-len(faces) // _BLOCK), 2, 3))
    boxes[:, 0], boxes[:, 1] = np.inf, -np.inf
    for f in range(len(faces)):
        box = boxes[f // _BLOCK]
        for e in range(3):
            for axis in range(3):
                value = vertices[faces[f, e], axis]
                box[0, axis] = min(box[0, axis], value)
                box[1, axis] = max(box[1, axis], value)
    return boxes


@nb.njit(cache=True, nogil=True)
def _least(box: Array, x: float, y: float, z: float) -> float:
    """Least scalar product of (x, y, z) with a point of a box."""
    least_x, least_y = min(x * box[0, 0], x * box[1, 0]), min(y * box[0, 1], y * box[1, 1])
    return float(least_x + least_y + min(z * box[0, 2], z * box[1, 2]))


@nb.njit(cache=True, nogil=True)
def vertex_out_of_order(
    vertices: Array, faces: Indices, boxes: Array, planes: Array, doubtful: Indices
) -> tuple[int, float, float, float]:
    """A vertex on or above plane k + 1 but below plane k, for the k that are in doubt: k and the place, or -1."""
    rise = planes[:-1] - planes[1:]
    for i in range(len(boxes)):
        box = boxes[i]
        for k in doubtful:
            if (
                _least(box, rise[k, 0], rise[k, 1], rise[k, 2]) > rise[k, 3]
                or _least(box, planes[k, 0], planes[k, 1], planes[k, 2]) >= planes[k, 3]
                or _least(box, -planes[k + 1, 0], -planes[k + 1, 1], -planes[k + 1, 2]) > -planes[k + 1, 3]
            ):
                continue
            for f in range(i * _BLOCK, min(len(faces), (i + 1) * _BLOCK)):
                for e in range(3):
                    v = faces[f, e]
                    x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
                    if height_over(planes, k, x, y, z) < 0.0 <= height_over(planes, k + 1, x, y, z):
                        return k, x, y, z
    return -1, 0.0, 0.0, 0.0


@nb.njit(cache=True, nogil=True)
def point_out_of_order(
    points: Array,
    start: Indices,
    origin: Array,
    u: Array,
    v: Array,
    planes: Array,
    doubtful: Indices,
    rounding: float,
) -> tuple[int, float, float, float]:
    """A cut point of plane k above plane k + 1, or of plane k + 1 below plane k: k and the place, or -1.

    With no vertex out of order, planes that cross in the part cross in a face: on its boundary one of its cuts has
    a point on the wrong side of the other plane.
    """
    for k in doubtful:
        for own, other, sign in ((k, k + 1, 1.0), (k + 1, k, -1.0)):
            for s in range(start[own], start[own + 1]):
                a, b = points[s, 0], points[s, 1]
                x = origin[own, 0] + a * u[own, 0] + b * v[own, 0]
                y = origin[own, 1] + a * u[own, 1] + b * v[own, 1]
                z = origin[own, 2] + a * u[own, 2] + b * v[own, 2]
                if sign * height_over(planes, other, x, y, z) > rounding:
                    return k, x, y, z
    return -1, 0.0, 0.0, 0.0
