"""Whether a net may be changed: the faces that a move would make against those that were there, and the surface.

A change fits where

- no face that is changed turns round, nor folds onto its neighbour, nor becomes a sliver;
- middles of changed faces and edges stay within reach of the surface before all moves, on its same side.
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

from .facing_points import FaceTree, Point, facing_point
from .net import Net, following, preceding

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

TURNED = 0.4
"""Least cosine between a face's normals before and after a move."""

FOLDED = -0.2
"""Least cosine between the normals of neighbours, except where they fold more already."""

SLIVER = 0.25
"""Twice a face's area over its longest edge squared; a face below this must not become worse."""

HARDLY = 0.97
"""Cosine between a face's normals before and after a move that hardly turns it."""

MOST_AROUND = 1024
"""Vertices with more edges than this are left as they are."""

_EMPTY_FACE = 1e-9


@nb.njit(cache=True, nogil=True, inline="always")
def apart(points: Array, a: int, b: int) -> float:
    return float(
        np.sqrt(
            (points[a, 0] - points[b, 0]) ** 2
            + (points[a, 1] - points[b, 1]) ** 2
            + (points[a, 2] - points[b, 2]) ** 2
        )
    )


@nb.njit(cache=True, nogil=True)
def face(p: Array, q: Array, r: Array) -> tuple[Point, float]:
    """Unit normal of a triangle, 0 where it has no area, and its shape: twice its area over longest edge²."""
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    wx, wy, wz = vx - ux, vy - uy, vz - uz
    longest = max(ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz)
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    twice = np.sqrt(x * x + y * y + z * z)
    if longest == 0.0 or twice <= _EMPTY_FACE * longest:
        return (0.0, 0.0, 0.0), 0.0
    return (x / twice, y / twice, z / twice), twice / longest


@nb.njit(cache=True, nogil=True, inline="always")
def dot(a: Point, b: Point) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@nb.njit(cache=True, nogil=True)
def near(tree: FaceTree, n: Point, reach: float, a: Array, b: Array, c: Array, thirds: float) -> bool:
    """Whether (a + b + thirds c) / (2 + thirds) is within reach of the surface."""
    share = 1.0 / (2.0 + thirds)
    p = (
        share * (a[0] + b[0] + thirds * c[0]),
        share * (a[1] + b[1] + thirds * c[1]),
        share * (a[2] + b[2] + thirds * c[2]),
    )
    return facing_point(tree, p, n, reach, reach)[0] <= reach


@nb.njit(cache=True, nogil=True)
def _face_fits(
    net: Net,
    edge: int,
    before: tuple[Point, float],
    p: Array,
    q: Array,
    r: Array,
    tree: FaceTree,
    reach: float,
    lazy: bool,
) -> bool:
    """Whether a face may become (p, q, r), of which the edge q–r is the half-edge `edge` and stays where it is."""
    old, was = before
    new, shape = face(p, q, r)
    if shape < SLIVER and shape < was + 1e-12:
        return False
    if was > 0.02 and dot(old, new) < TURNED:
        return False
    t = net.across[edge]
    outer, _ = face(
        net.points[net.corner[t]], net.points[net.corner[following(t)]], net.points[net.corner[preceding(t)]]
    )
    folded = dot(new, outer)
    if folded < FOLDED and folded < dot(old, outer):
        return False
    if lazy and dot(old, new) > HARDLY:
        return True
    return near(tree, new, reach, p, q, r, 1.0) and (lazy or near(tree, new, reach, p, q, r, 0.0))


@nb.njit(cache=True, nogil=True)
def ring_fits(
    net: Net,
    ring: Indices,
    count: int,
    gone: tuple[int, int],
    goal: Array,
    longest: float,
    tree: FaceTree,
    reach: float,
    lazy: bool,
) -> bool:
    """Whether the vertex that `count` half-edges of `ring` start in may go to `goal`, without the faces `gone`.

    Lazily, faces that hardly turn are not measured against the surface.
    """
    v = net.corner[ring[0]]
    for i in range(count):
        h = ring[i]
        if h // 3 == gone[0] or h // 3 == gone[1]:
            continue
        b, c = net.corner[following(h)], net.corner[preceding(h)]
        length = np.sqrt(
            (goal[0] - net.points[b, 0]) ** 2
            + (goal[1] - net.points[b, 1]) ** 2
            + (goal[2] - net.points[b, 2]) ** 2
        )
        if length > longest and length > apart(net.points, v, b):
            return False
        before = face(net.points[v], net.points[b], net.points[c])
        if not _face_fits(net, following(h), before, goal, net.points[b], net.points[c], tree, reach, lazy):
            return False
    return True
