"""Extrusion: the printed volume M' of a toolpath (seed paper, Section 2.2.2).

The bead along a curve covers half its width on both sides. The region that a layer's beads cover together, bounded
by curves with the interior on the left, is the pseudo-toolpath TP'; reconstructing it gives M'.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely
import trimesh

from .errors import ToolpathError
from .reconstruction import reconstruct
from .sampling import sample_layer
from .toolpath import Curve, Layer, Toolpath

Array = npt.NDArray[np.float64]


def extrude(toolpath: Toolpath, width: float, resolution: float | None = None) -> trimesh.Trimesh:
    """The volume M' that a toolpath prints: a closed, outward oriented 2-manifold.

    Args:
        toolpath: open or closed curves.
        width: bead width where a curve has none of its own, mm.
        resolution: L_R of the result, mm; default the layer thickness.

    Raises:
        ToolpathError: the width is not above 0, or there are no curves.
    """
    step = toolpath.thickness if resolution is None else float(resolution)
    return reconstruct(bead_outlines(toolpath, width, step), step)


def bead_outlines(toolpath: Toolpath, width: float, resolution: float) -> Toolpath:
    """The pseudo-toolpath TP': the outlines of all beads of each layer, interior left, sampled at `resolution`."""
    if not width > 0 or not np.isfinite(width):
        raise ToolpathError(f"the bead width must be above 0 mm, not {width}")
    if not any(layer.curves for layer in toolpath.layers):
        raise ToolpathError("the toolpath has no curves: there is nothing to extrude")
    layers = []
    for layer in toolpath.layers:
        outlines = sample_layer(_loops(_covered(layer, width)), resolution)
        layers.append(Layer(layer.slicing, layer.nozzle, tuple(Curve(points) for points in outlines)))
    return Toolpath(toolpath.base, tuple(layers), toolpath.thickness)


def _covered(layer: Layer, width: float) -> shapely.Geometry:
    beads: list[shapely.Geometry] = []
    for curve in layer.curves:
        points = np.vstack([curve.points, curve.points[:1]]) if curve.closed else curve.points
        if curve.width is None:
            beads.append(shapely.LineString(points).buffer(0.5 * width, cap_style="round"))
            continue
        radius = 0.5 * (np.r_[curve.width, curve.width[:1]] if curve.closed else curve.width)
        discs = [shapely.Point(p).buffer(r) for p, r in zip(points, radius, strict=True)]
        beads += [shapely.union(a, b).convex_hull for a, b in pairwise(discs)]
    return shapely.union_all(beads)


def _loops(region: shapely.Geometry) -> list[Array]:
    """Rings of a region, interior left, without the repeated last point."""
    loops = []
    for part in shapely.get_parts(region):
        oriented = shapely.geometry.polygon.orient(part)
        loops += [np.asarray(ring.coords)[:-1] for ring in (oriented.exterior, *oriented.interiors)]
    return loops
