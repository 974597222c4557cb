"""The region of one layer: the exact union of its Delaunay triangles to the left of its curves.

The 2D Delaunay triangulation of a layer is computed once and serves the slabs above and below it, so that
neighbouring slabs agree on the layer between them. Segments of curves are Gabriel edges of it (`delaunay.py`), so a
triangle is inside or outside by the direction of any of them that it has, carried on over all other edges. No
point is ever tested against a polygon.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba as nb
import numpy as np
import numpy.typing as npt

from .delaunay import COINCIDENT, FINE, FLAT, conforming_delaunay
from .errors import ToolpathError
from .predicates import LATTICE_BITS, Diagram, circumcenters

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

SHORTEST = 2e-4
"""Segments are not halved below this share of the resolution: walls nearer than that count as touching."""


@dataclass(frozen=True)
class Lattice:
    """The integer lattice that decides the connectivity of a toolpath; points are never moved to it.

    Attributes:
        origin: shape (2,), mm.
        unit: a power of two, mm; the toolpath lies within 2^29 units of the origin.
    """

    origin: tuple[float, float]
    unit: float

    @classmethod
    def around(cls, low: Array, high: Array) -> Lattice:
        """For points between two corners, shape (2,), mm; the same for all boxes of nearly that size and place."""
        half = max(float(np.max(high - low)), 1e-300)
        step = 2.0 ** np.ceil(np.log2(half))
        middle = np.round((low + high) / 2.0 / (0.125 * step)) * (0.125 * step)
        return cls((float(middle[0]), float(middle[1])), float(step * 2.0**-LATTICE_BITS))


@dataclass(frozen=True, eq=False)
class Region:
    """One layer's region, n points.

    Attributes:
        points: of the curves, halved segments included, shape (n, 2), mm.
        diagram: their triangulation.
        triangles: those inside the region, turning left, shape (k, 3).
    """

    points: Array
    diagram: Diagram
    triangles: Indices

    def __len__(self) -> int:
        return len(self.points)


def triangulate(
    curves: Sequence[Array], lattice: Lattice, resolution: float, where: str, interior: Array | None = None
) -> Region:
    """The region to the left of closed curves.

    Args:
        curves: each of shape (n, 2), mm, outer ones counter-clockwise, inner ones clockwise.
        lattice: common to all layers of a toolpath.
        resolution: L_R, mm.
        where: names the layer in messages.
        interior: more points, inside and away from the curves, shape (k, 2), mm.

    Raises:
        ToolpathError: curves touch, cross, or do not enclose a region on their left.
    """
    if not curves:
        return region_of(np.zeros((0, 2)), Lattice((0.0, 0.0), 1.0))
    points = np.ascontiguousarray(np.vstack(curves), dtype=np.float64)
    ends = np.cumsum([len(curve) for curve in curves])
    following = np.arange(1, len(points) + 1)
    following[ends - 1] = np.r_[0, ends[:-1]]
    if interior is not None and len(interior):
        following = np.concatenate([following, np.arange(len(points), len(points) + len(interior))])
        points = np.concatenate([points, interior])
    if float(np.abs(points - np.array(lattice.origin)).max()) > lattice.unit * 2.0**LATTICE_BITS:
        raise ToolpathError(f"{where}: a curve reaches beyond the toolpath's lattice")
    state, at, points, P, following, triangles, across, corner = conforming_delaunay(
        points, following, np.array(lattice.origin), lattice.unit, SHORTEST * resolution
    )
    if state == FLAT:
        raise ToolpathError(f"{where}: all points lie on one line and enclose nothing")
    if state != FINE:
        place = f"near ({points[at, 0]:.3f}, {points[at, 1]:.3f}) in the plane"
        if state == COINCIDENT:
            raise ToolpathError(
                f"{where}: two points coincide {place}; remove curves that are there twice and points that repeat, "
                "also a last point that repeats the first of a closed curve"
            )
        raise ToolpathError(
            f"{where}: curves touch or cross {place}; a curve must not cross itself, bodies that overlap must be "
            "united, and walls that nearly touch sampled finer"
        )
    inside, disagreement = _classify(triangles, across, following)
    if disagreement or not inside.any():
        place = points[max(disagreement - 1, 0)]
        raise ToolpathError(
            f"{where}: curves enclose nothing on their left near ({place[0]:.3f}, {place[1]:.3f}) in the plane; outer "
            "curves run counter-clockwise, inner ones clockwise"
        )
    return _region(points, P, following, triangles, across, corner, inside)


def region_of(points: Array, lattice: Lattice) -> Region:
    """All Delaunay triangles of points that lie on no curve, shape (n, 2), mm."""
    if not len(points):
        pairs, triples, none = np.zeros((0, 2)), np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
        return _region(pairs, pairs.astype(np.int64), none, triples, triples, none, np.zeros(0, np.bool_))
    state, at, _, P, following, triangles, across, corner = conforming_delaunay(
        np.ascontiguousarray(points, dtype=np.float64),
        np.arange(len(points)), np.array(lattice.origin), lattice.unit, 0.0,
    )  # fmt: skip
    if state != FINE:
        raise ToolpathError(f"point {at} lies on another, or all points lie on one line")
    return _region(points, P, following, triangles, across, corner, triangles[:, 2] >= 0)


def _region(
    points: Array, P: Indices, following: Indices, triangles: Indices, across: Indices, at: Indices,
    inside: npt.NDArray[np.bool_],
) -> Region:  # fmt: skip
    inner = np.flatnonzero(inside)
    centers, bounds = circumcenters(P, triangles)
    diagram = Diagram(P, following, triangles, across, at, inside, inner, centers, bounds)
    return Region(points, diagram, triangles[inner])


@nb.njit(cache=True, nogil=True)
def _classify(triangles: Indices, across: Indices, following: Indices) -> tuple[npt.NDArray[np.bool_], int]:
    """Which triangles are inside, and 1 + a point at which two sides disagree, or 0."""
    m = len(triangles)
    side = np.zeros(m, np.int8)
    stack = np.empty(m, np.int64)
    top = 0
    disagreement = 0
    for t in range(m):
        here = 2 if triangles[t, 2] < 0 else 0
        for k in range(3):
            i, j = triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
            if i < 0 or j < 0:
                continue
            now = 1 if following[i] == j else (2 if following[j] == i else 0)
            if now:
                if here and here != now:
                    disagreement = i + 1
                here = now
        side[t] = here
        if here:
            stack[top] = t
            top += 1
    while top:
        top -= 1
        t = stack[top]
        for k in range(3):
            i, j = triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
            if i >= 0 and j >= 0 and (following[i] == j or following[j] == i):
                continue
            u = across[t, k]
            if side[u] == 0:
                side[u] = side[t]
                stack[top] = u
                top += 1
            elif side[u] != side[t]:
                disagreement = max(i, j) + 1
    return side == 1, disagreement
