"""Reconstruction: a toolpath becomes a surface, the toolpath mesh M (seed paper, Section 2.2).

The solid between two layers is a set of tetrahedra (`overlay.py`); the first and last layer of each body are
carried straight on by half a layer, to the base or nozzle plane (F_ver); and M is the boundary of all of them.
Caps come out by themselves, and closure does not depend on which tetrahedra were chosen. Where the
solid touches itself in an edge or vertex the boundary is pulled apart (`joining.py`).

Connectivity is found as if all layers were parallel at the nominal thickness: points are (u, v) of their layer's
frame, and a third coordinate w counts layers. `Frames` carries them to the world.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import trimesh

from .errors import ToolpathError
from .joining import resolve
from .overlay import slab_tetrahedra
from .surface import make_surface
from .toolpath import Curve, Plane, Toolpath
from .triangulation import Region, triangulate

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Solid:
    """A conforming tetrahedral mesh between the base and the last nozzle plane of a toolpath.

    Attributes:
        points: (u, v, w) with w in mm at the nominal thickness, shape (n, 3).
        jittered: the same as the connectivity sees them, shape (n, 3).
        tets: positively oriented in `jittered`, shape (m, 4).
    """

    points: Array
    jittered: Array
    tets: Indices


def reconstruct(toolpath: Toolpath, resolution: float | None = None) -> trimesh.Trimesh:
    """The toolpath mesh M: a closed, outward oriented 2-manifold through the curves.

    Args:
        toolpath: closed curves, interior left.
        resolution: L_R that the curves were sampled with, mm; default the layer thickness.

    Raises:
        ToolpathError: no curves, open curves, or curves of a layer that touch or cross.
    """
    step = toolpath.thickness if resolution is None else float(resolution)
    body = solid(toolpath, step)
    points, faces = resolve(body.points, body.jittered, body.tets, 3e-3 * toolpath.thickness)
    used, index = np.unique(faces, return_inverse=True)
    return make_surface(Frames(toolpath).to_world(points[used]), index.reshape(-1, 3))


def solid(toolpath: Toolpath, resolution: float) -> Solid:
    """The tetrahedra whose boundary M is, in the toolpath's (u, v, w) space."""
    t = toolpath.thickness
    regions = [
        triangulate([_closed(c, i) for c in layer.curves], resolution, seed=i, where=f"layer {i}")
        for i, layer in enumerate(toolpath.layers)
    ]
    if not any(len(region) for region in regions):
        raise ToolpathError("the toolpath has no curves: there is nothing to reconstruct")
    first = np.cumsum([0, *(len(region) for region in regions)])
    points = [_raised(region.points, (i + 0.5) * t) for i, region in enumerate(regions)]
    jittered = [_raised(region.jittered, (i + 0.5) * t) for i, region in enumerate(regions)]
    tets: list[Indices] = []
    held = [np.zeros(len(region), np.bool_) for region in regions]
    for i, (lower, upper) in enumerate(pairwise(regions)):
        slab = slab_tetrahedra(lower, upper, resolution)
        tets.append(slab + first[i])
        for layer, offset, count in ((i, 0, len(lower)), (i + 1, len(lower), len(upper))):
            used = slab[(slab >= offset) & (slab < offset + count)] - offset
            held[layer][used] = True
    total = int(first[-1])
    for i, region in enumerate(regions):
        if not len(region):
            continue
        below = i == 0 or not len(regions[i - 1])
        above = i == len(regions) - 1 or not len(regions[i + 1])
        alone = _untouched(region, held[i])
        for carried, height in ((below, i * t), (above, (i + 1.0) * t)):
            triangles = region.triangles if carried else region.triangles[alone]
            if not len(triangles):
                continue
            corners, local = np.unique(triangles, return_inverse=True)
            points.append(_raised(region.points[corners], height))
            jittered.append(_raised(region.jittered[corners], height))
            tets.append(_prisms(triangles + first[i], local.reshape(-1, 3) + total))
            total += len(corners)
    J = np.vstack(jittered)
    return Solid(np.vstack(points), J, _positive(J, np.vstack(tets)))


class Frames:
    """The map from (u, v, w) to the world: at w = k t the base or nozzle planes, at (k + 1/2) t the slicing planes."""

    def __init__(self, toolpath: Toolpath) -> None:
        planes: list[Plane] = [toolpath.base]
        for layer in toolpath.layers:
            planes += [layer.slicing, layer.nozzle]
        self._origins = np.array([plane.origin for plane in planes])
        self._axes = np.array([[plane.x_axis, plane.y_axis] for plane in planes])
        self._step = 0.5 * toolpath.thickness

    def to_world(self, points: Array) -> Array:
        """World places of points (u, v, w), shape (n, 3), mm; between planes linear."""
        level = points[:, 2] / self._step
        low = np.clip(np.floor(level + 1e-9).astype(np.int64), 0, len(self._origins) - 2)
        share = (level - low)[:, None]
        share = np.where(np.abs(share) < 1e-9, 0.0, share)

        def place(plane: Indices) -> Array:
            shifted = np.einsum("nk,nkd->nd", points[:, :2], self._axes[plane])
            return np.asarray(self._origins[plane] + shifted, dtype=np.float64)

        return np.asarray((1.0 - share) * place(low) + share * place(low + 1), dtype=np.float64)


def _closed(curve: Curve, layer: int) -> Array:
    if not curve.closed:
        raise ToolpathError(f"layer {layer}: an open curve bounds no solid; close it first")
    return curve.points


def _raised(points: Array, height: float) -> Array:
    return np.column_stack([points, np.full(len(points), height)])


def _untouched(region: Region, held: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Triangles of parts of the region that no tetrahedron reaches: islands of a single layer."""
    label = np.arange(len(region))
    while True:  # label propagation over triangles; parts are few and small
        low = label[region.triangles].min(axis=1)
        spread = label.copy()
        np.minimum.at(spread, region.triangles, low[:, None])
        if (spread == label).all():
            break
        label = spread[spread]
    touched = np.zeros(len(region), np.bool_)
    np.logical_or.at(touched, label, held)
    return np.asarray(~touched[label[region.triangles[:, 0]]], dtype=np.bool_)


def _prisms(bottom: Indices, top: Indices) -> Indices:
    """Prisms between triangles and their copies, three tetrahedra each, cut by vertex order so that they conform."""
    order = np.argsort(bottom, axis=1)
    a, b, c = np.take_along_axis(bottom, order, axis=1).T
    d, e, f = np.take_along_axis(top, order, axis=1).T
    return np.concatenate([np.column_stack(q) for q in ((a, b, c, f), (a, b, e, f), (a, d, e, f))])


def _positive(points: Array, tets: Indices) -> Indices:
    a, b, c, d = (points[tets[:, k]] for k in range(4))
    negative = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0
    tets = tets.copy()
    tets[negative] = tets[negative][:, [0, 2, 1, 3]]
    return tets
