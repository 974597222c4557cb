"""The region of one layer: its Delaunay triangles, and the Voronoi edges that cross them.

The 2D Delaunay triangulation of a layer is computed once and serves the slabs above and below it, so that
neighbouring slabs agree on the layer between them. Segments of curves ("native" edges) are halved until no other
point lies in the circle over them (Gabriel's condition): they are then Delaunay edges, and a triangle is inside or
outside by the direction of any native edge that it has, carried on over all other edges. No point is ever
tested against a polygon.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba as nb
import numpy as np
import numpy.typing as npt
from scipy.spatial import Delaunay, cKDTree

from .errors import ToolpathError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

JITTER = 1e-5
"""Displacement, as a share of the resolution, that keeps identical layers in general position."""

_ROUNDS = 24
_FAR = 1e7


@dataclass(frozen=True, eq=False)
class Region:
    """One layer's region, n points.

    Attributes:
        points: shape (n, 2), mm.
        jittered: the points as the connectivity sees them, shape (n, 2).
        following, previous: neighbour on the curve, interior left, shape (n,).
        triangles: inside the region, corners counter-clockwise, shape (m, 3).
        centers: circumcentres of the triangles, shape (m, 2).
        edges: Delaunay edges inside or on the border, shape (k, 2).
        duals: their Voronoi edges, shape (k, 4): from (x, y), inside, to (x, y).
        native: whether an edge is a segment of a curve, shape (k,).
        border: where along its dual a native edge is crossed; beyond it is outside; shape (k,).
    """

    points: Array
    jittered: Array
    following: Indices
    previous: Indices
    triangles: Indices
    centers: Array
    edges: Indices
    duals: Array
    native: npt.NDArray[np.bool_]
    border: Array

    def __len__(self) -> int:
        return len(self.points)


def triangulate(curves: Sequence[Array], resolution: float, seed: int, where: str) -> Region:
    """The region to the left of closed curves.

    Args:
        curves: each of shape (n, 2), mm, outer ones counter-clockwise, inner ones clockwise.
        resolution: L_R, mm; sets how far segments are halved and the size of the jitter.
        seed: of the jitter; different for neighbouring layers.
        where: names the layer in messages.

    Raises:
        ToolpathError: curves touch, cross, or do not enclose a region on their left.
    """
    if not curves:
        nothing = np.zeros((0, 2))
        none = np.zeros(0, np.int64)
        pairs, triples = np.zeros((0, 2), np.int64), np.zeros((0, 3), np.int64)
        return Region(
            nothing,
            nothing,
            none,
            none,
            triples,
            nothing,
            pairs,
            np.zeros((0, 4)),
            np.zeros(0, bool),
            np.zeros(0),
        )
    curves = halve_encroached(curves, resolution)
    points = np.vstack(curves)
    n = len(points)
    ends = np.cumsum([len(curve) for curve in curves])
    following = np.arange(1, n + 1)
    following[ends - 1] = np.r_[0, ends[:-1]]
    previous = np.empty(n, np.int64)
    previous[following] = np.arange(n)
    jitter = np.random.default_rng(seed).uniform(-1.0, 1.0, points.shape)
    jittered = points + JITTER * resolution * jitter
    delaunay = Delaunay(jittered)
    triangles, neighbours = _counter_clockwise(
        jittered, delaunay.simplices.astype(np.int64), delaunay.neighbors.astype(np.int64)
    )
    inside, missing, mixed = _classify(triangles, neighbours, following)
    if missing or mixed or not inside.any():
        fault = points[missing - 1] if missing else points[mixed - 1] if mixed else points[0]
        what = "touch or cross" if missing or mixed else "enclose nothing on their left"
        raise ToolpathError(
            f"{where}: curves {what} near ({fault[0]:.3f}, {fault[1]:.3f}) in the plane; "
            "unite bodies that overlap, or sample finer where walls nearly touch"
        )
    centers = _circumcenters(jittered, triangles)
    edges, duals, native, border = _duals(jittered, triangles, neighbours, inside, centers, following)
    return Region(
        points,
        jittered,
        following,
        previous,
        triangles[inside],
        centers[inside],
        edges,
        duals,
        native,
        border,
    )


def halve_encroached(curves: Sequence[Array], resolution: float) -> list[Array]:
    """Insert midpoints until no point lies inside the circle over any segment (or segments are very short)."""
    loops = [np.asarray(curve, dtype=np.float64) for curve in curves]
    shortest = 1e-3 * resolution
    for _ in range(_ROUNDS):
        tree = cKDTree(np.vstack(loops))
        changed = False
        for i, loop in enumerate(loops):
            after = np.roll(loop, -1, axis=0)
            middle = 0.5 * (loop + after)
            radius = 0.5 * np.linalg.norm(after - loop, axis=1)
            nearest, _ = tree.query(middle)
            halve = np.flatnonzero((nearest < radius * (1.0 - 1e-4)) & (radius > shortest))
            if len(halve):
                changed = True
                loops[i] = np.insert(loop, halve + 1, middle[halve], axis=0)
        if not changed:
            break
    return loops


def _counter_clockwise(points: Array, triangles: Indices, neighbours: Indices) -> tuple[Indices, Indices]:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    turned = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) < (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    triangles[turned] = triangles[turned][:, [0, 2, 1]]
    neighbours[turned] = neighbours[turned][:, [0, 2, 1]]
    return triangles, neighbours


def _circumcenters(points: Array, triangles: Indices) -> Array:
    a = points[triangles[:, 0]]
    b = points[triangles[:, 1]] - a
    c = points[triangles[:, 2]] - a
    d = 2.0 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    d = np.where(d == 0.0, 1e-300, d)
    bb, cc = (b * b).sum(axis=1), (c * c).sum(axis=1)
    return a + np.column_stack([c[:, 1] * bb - b[:, 1] * cc, b[:, 0] * cc - c[:, 0] * bb]) / d[:, None]


@nb.njit(cache=True)
def _classify(
    triangles: Indices, neighbours: Indices, following: Indices
) -> tuple[npt.NDArray[np.bool_], int, int]:
    """Which triangles are inside; 1 + a point whose native edge is missing, 1 + a point where sides disagree."""
    m = len(triangles)
    side = np.zeros(m, np.int8)
    found = np.zeros(len(following), np.bool_)
    stack = np.empty(m, np.int64)
    top = 0
    mixed = 0
    for t in range(m):
        for k in range(3):
            i, j = triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
            here = 0
            if following[i] == j:
                here = 1
                found[i] = True
            elif following[j] == i:
                here = 2
                found[j] = True
            if here:
                if side[t] and side[t] != here:
                    mixed = i + 1
                side[t] = here
        if side[t]:
            stack[top] = t
            top += 1
    while top:
        top -= 1
        t = stack[top]
        for k in range(3):
            i, j = triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
            if following[i] == j or following[j] == i:
                continue
            u = neighbours[t, k]
            if u < 0:
                continue
            if side[u] == 0:
                side[u] = side[t]
                stack[top] = u
                top += 1
            elif side[u] != side[t]:
                mixed = i + 1
    missing = 0
    for i in range(len(following)):
        if not found[i]:
            missing = i + 1
    return side == 1, missing, mixed


@nb.njit(cache=True)
def _duals(
    points: Array,
    triangles: Indices,
    neighbours: Indices,
    inside: npt.NDArray[np.bool_],
    centers: Array,
    following: Indices,
) -> tuple[Indices, Array, npt.NDArray[np.bool_], Array]:
    most = 3 * len(triangles)
    edges = np.empty((most, 2), np.int64)
    duals = np.empty((most, 4))
    native = np.zeros(most, np.bool_)
    border = np.full(most, 2.0)
    n = 0
    for t in range(len(triangles)):
        if not inside[t]:
            continue
        for k in range(3):
            u = neighbours[t, k]
            i, j = triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
            is_native = following[i] == j or following[j] == i
            if not is_native and (u < t or u < 0):
                continue  # an interior edge is taken once, from the triangle with the lower index
            edges[n, 0], edges[n, 1] = i, j
            duals[n, 0], duals[n, 1] = centers[t, 0], centers[t, 1]
            if u >= 0:
                duals[n, 2], duals[n, 3] = centers[u, 0], centers[u, 1]
            else:
                dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
                size = np.sqrt(dx * dx + dy * dy)
                duals[n, 2] = centers[t, 0] + _FAR * dy / size
                duals[n, 3] = centers[t, 1] - _FAR * dx / size
            if is_native:
                native[n] = True
                ex, ey = duals[n, 2] - duals[n, 0], duals[n, 3] - duals[n, 1]
                size2 = ex * ex + ey * ey
                mx, my = 0.5 * (points[i, 0] + points[j, 0]), 0.5 * (points[i, 1] + points[j, 1])
                border[n] = ((mx - duals[n, 0]) * ex + (my - duals[n, 1]) * ey) / size2 if size2 > 0 else 1.0
            n += 1
    return edges[:n].copy(), duals[:n].copy(), native[:n].copy(), border[:n].copy()
