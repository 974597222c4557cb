"""The layered mesh: tetrahedra of the printed volume M', each within one layer.

The solid that M' bounds is a tetrahedral mesh already, but a slab of it lies between two slicing planes, the middles
of two layers. Here every tetrahedron of a slab is cut at the nozzle plane midway: one with three points in a layer
into a tetrahedron and a prism, one with two and two into two wedges. Edges are cut in the middle, once each, and
quadrilaterals along the diagonal at their lowest corner, so that neighbours fit without knowing of each other. Then
`tet_quality.py` improves the mesh without moving nozzle planes or the boundary.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
import numpy.typing as npt
import shapely

from .entrances import checks_kinds
from .extrusion import bead_outlines
from .reconstruction import Solid, toolpath_mesh
from .tet_quality import improve, mean_ratios
from .toolpath import Toolpath

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


INTERIOR = 1.1
"""Spacing of points inside the beads, as a share of the resolution."""


@dataclass(frozen=True, eq=False)
class LayeredMesh:
    """Tetrahedra of a printed volume, each within one layer.

    Attributes:
        points: in the world, shape (n, 3), mm.
        tets: positively oriented, shape (m, 4).
        layer: index of the layer that each lies in, shape (m,).
        curve: index within its layer of the curve nearest to its centroid, shape (m,).
    """

    points: Array
    tets: Indices
    layer: Indices
    curve: Indices

    @property
    def volumes(self) -> Array:
        """Of each tetrahedron, shape (m,), mm³."""
        a, b, c, d = self.points[self.tets].transpose(1, 0, 2)
        return np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0, dtype=np.float64)

    @property
    def volume(self) -> float:
        """mm³."""
        return float(self.volumes.sum())

    def quality(self) -> Array:
        """Mean ratio 12 (3 V)^(2/3) / Σ l² of each tetrahedron, shape (m,): 1 where regular, 0 where flat."""
        return mean_ratios(self.points, self.tets)


@checks_kinds
def layered_mesh(toolpath: Toolpath, width: float, resolution: float | None = None) -> LayeredMesh:
    """Tetrahedra of the volume that a toolpath prints.

    Args:
        toolpath: open or closed curves.
        width: bead width where a curve has none of its own, mm.
        resolution: L_R of the outlines, mm; default the layer thickness.

    Raises:
        ToolpathError: the width is not above 0, or there are no curves.
    """
    step = toolpath.thickness if resolution is None else float(resolution)
    solid = toolpath_mesh(bead_outlines(toolpath, width, step), step, interior=INTERIOR * step).solid
    points, plane, tets, layer = split_solid(solid)
    world = solid.frames.to_world(points)
    levels = np.arange(len(solid.sections) + 1) * toolpath.thickness
    axes = solid.frames.at(levels)[:, 1:]
    world, tets, layer = improve(world, plane, axes, tets, layer, toolpath.thickness)
    return LayeredMesh(world, tets, layer, _nearest_curves(toolpath, world, tets, layer))


def split_solid(solid: Solid) -> tuple[Array, Indices, Indices, Indices]:
    """A solid with one section a layer, cut at the nozzle planes.

    Returns:
        points (u, v, w), shape (n, 3), mm; the number of the nozzle plane each lies in, 0 the base, or -1, shape (n,);
        tetrahedra, positively oriented save where flat, shape (m, 4); and their layers, shape (m,).
    """
    sizes = [len(block.points) for block in solid.blocks]
    first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    points = [block.points for block in solid.blocks]
    plane = [
        _planes_of(block.points[:, 2], s.w, i)
        for i, (block, s) in enumerate(zip(solid.blocks, solid.sections, strict=True))
    ]
    tets = [block.prisms + first[i] for i, block in enumerate(solid.blocks)]
    layer = [np.full(len(block.prisms), i) for i, block in enumerate(solid.blocks)]
    total = int(first[-1])
    for i, slab in enumerate(solid.slabs):
        if slab is None or not len(slab.tets):
            continue
        below, above = solid.blocks[i].points, solid.blocks[i + 1].points
        lower = np.where(slab.tets < slab.lower, slab.tets, -1)
        upper = np.where(slab.tets < slab.lower, -1, slab.tets - slab.lower)
        keys = lower[:, :, None] * len(above) + upper[:, None, :]
        crossing = (lower[:, :, None] >= 0) & (upper[:, None, :] >= 0)
        edges, number = np.unique(keys[crossing], return_inverse=True)
        middle = np.full(crossing.shape, -1)
        middle[crossing] = number + total
        middle = np.maximum(middle, middle.transpose(0, 2, 1))
        p, q = below[edges // len(above)], above[edges % len(above)]
        points.append(0.5 * (p + q))
        plane.append(np.full(len(edges), i + 1))
        total += len(edges)
        corners = np.where(lower >= 0, lower + first[i], upper + first[i + 1])
        halves, high = _split(corners, lower >= 0, middle)
        tets.append(halves)
        layer.append(i + high)
    return np.concatenate(points), np.concatenate(plane), np.concatenate(tets), np.concatenate(layer)


def _planes_of(w: Array, middle: float, layer: int) -> Indices:
    """Points carried down lie on the nozzle plane below, those carried up on the one above."""
    return np.where(w < middle, layer, np.where(w > middle, layer + 1, -1))


@nb.njit(cache=True, nogil=True)
def _put(out: Indices, m: int, a: int, b: int, c: int, d: int) -> None:
    out[m, 0], out[m, 1], out[m, 2], out[m, 3] = a, b, c, d


@nb.njit(cache=True, nogil=True)
def _add_prism(out: Indices, m: int, a: int, b: int, c: int, d: int, e: int, f: int) -> int:
    """Three tetrahedra of the prism a b c below d e f (a b c turns left seen from d e f)."""
    for _ in range(3):
        if min(b, c, d, e, f) < a and min(a, b, c) < min(d, e, f):
            a, b, c, d, e, f = b, c, a, e, f, d
    if min(d, e, f) < min(a, b, c):
        a, b, c, d, e, f = d, f, e, a, c, b
        for _ in range(3):
            if min(b, c) < a:
                a, b, c, d, e, f = b, c, a, e, f, d
    _put(out, m, a, e, f, d)
    if min(b, f) < min(c, e):
        _put(out, m + 1, a, b, c, f)
        _put(out, m + 2, a, b, f, e)
    else:
        _put(out, m + 1, a, b, c, e)
        _put(out, m + 2, a, e, c, f)
    return m + 3


@nb.njit(cache=True, nogil=True)
def _split(corners: Indices, low: npt.NDArray[np.bool_], middle: Indices) -> tuple[Indices, Indices]:
    """Tetrahedra cut in the middles of edges, with 0 for those below the cut and 1 for those above."""
    out = np.empty((6 * len(corners), 4), np.int64)
    high = np.zeros(6 * len(corners), np.int64)
    m = int(np.int64(0))  # no constant: see tet_star.py
    for t in range(len(corners)):
        count = 0
        for k in range(4):
            count += low[t, k]
        # An even order of the corners with the lower ones first.
        a, b, c, d = 0, 1, 2, 3
        if count == 3:
            while low[t, d]:
                a, b, c, d = (
                    (b, a, d, c) if not low[t, c] else (d, c, b, a) if not low[t, a] else (c, d, a, b)
                )
        elif count == 1:
            while not low[t, a]:
                a, b, c, d = (b, a, d, c) if low[t, b] else (c, d, a, b) if low[t, c] else (d, c, b, a)
        else:
            if not low[t, a]:
                a, b, c, d = (b, a, d, c) if low[t, b] else (c, d, a, b)
            if not low[t, b]:
                a, b, c, d = (a, c, d, b) if low[t, c] else (a, d, b, c)
        A, B, C, D = corners[t, a], corners[t, b], corners[t, c], corners[t, d]
        if count == 3:
            p, q, r = middle[t, a, d], middle[t, b, d], middle[t, c, d]
            m = _add_prism(out, m, A, B, C, p, q, r)
            _put(out, m, p, q, r, D)
            high[m] = 1
            m += 1
        elif count == 1:
            p, q, r = middle[t, a, b], middle[t, a, c], middle[t, a, d]
            _put(out, m, A, p, q, r)
            m += 1
            high[m] = high[m + 1] = high[m + 2] = 1
            m = _add_prism(out, m, p, q, r, B, C, D)
        else:
            p, q, r, s = middle[t, a, c], middle[t, a, d], middle[t, b, c], middle[t, b, d]
            m = _add_prism(out, m, A, p, q, B, r, s)
            high[m] = high[m + 1] = high[m + 2] = 1
            m = _add_prism(out, m, C, p, r, D, q, s)
    return out[:m].copy(), high[:m].copy()


def _nearest_curves(toolpath: Toolpath, points: Array, tets: Indices, layer: Indices) -> Indices:
    """For each tetrahedron the curve of its layer nearest to its centroid."""
    nearest = np.zeros(len(tets), np.int64)
    order = np.argsort(layer, kind="stable")
    ends = np.searchsorted(layer[order], np.arange(len(toolpath.layers) + 1))
    for i, here in enumerate(toolpath.layers):
        rows = order[ends[i] : ends[i + 1]]
        if len(here.curves) < 2 or not len(rows):
            continue
        segments, owner = [], []
        for j, curve in enumerate(here.curves):
            start = curve.points if curve.closed else curve.points[:-1]
            end = np.roll(curve.points, -1, axis=0) if curve.closed else curve.points[1:]
            segments.append(np.stack([start, end], axis=1))
            owner.append(np.full(len(start), j))
        tree = shapely.STRtree([shapely.LineString(ends) for ends in np.concatenate(segments)])
        centroids = here.slicing.to_frame(points[tets[rows]].mean(axis=1))[:, :2]
        nearest[rows] = np.concatenate(owner)[tree.nearest(shapely.points(centroids))]
    return nearest
