"""The visualization mesh M_vis: the printed look, beads with rounded flanks (seed paper, Figure 5e).

A squeezed bead of height h bulges sideways in half circles. At the relative height zeta in [-1, 1] about the middle
of its layer the outline lies (h / 2) (1 - sqrt(1 - zeta²)) inside the outline that M' has there, so a layer becomes a
few sections instead of one, and M_vis is the reconstruction of all of them: one closed 2-manifold, by the same
construction as M'. Neighbouring layers meet in their insets, close to the nozzle plane between them; the step that is
left there is a layer line.

- The inset is that of a layer's region, not of single beads: beads that overlap are one, without tunnels between them.
- h is the nominal thickness, or nine tenths of the narrowest bead's width where that is less: a flank is half a circle
  or half an ellipse. Where layers are rotary the sections lie in blended frames, so flanks stretch with the layer.
- Sections are offset from the sampled outline point by point, not sampled anew, so that flanks stay even.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely
import trimesh
from shapely.geometry.base import BaseGeometry

from .entrances import checks_kinds
from .errors import ToolpathError
from .extrusion import CLEFT, Side, bead_outlines, enclosed_region, rings, triangulable
from .frames import Frames
from .memo import Memo
from .reconstruction import reconstruct
from .sampling import divide
from .toolpath import Curve, Layer, Plane, Toolpath

Array = npt.NDArray[np.float64]

LEVELS: Final = (-0.95, -0.6, 0.0, 0.6, 0.95)
"""Relative heights of a layer's sections about its middle."""

SLIVER: Final = 0.05
"""Half the width below which layers do not count as resting on one another, as a share of the resolution."""

_MITRE = 1.15  # an inset goes around a sharp notch at up to this many times its distance


@checks_kinds
def visual_mesh(
    toolpath: Toolpath,
    width: float,
    resolution: float | None = None,
    side: Side = "both",
    levels: Sequence[float] = LEVELS,
    executor: Executor | None = None,
) -> trimesh.Trimesh:
    """What a printed toolpath looks like, M_vis: a closed, outward oriented 2-manifold.

    Args:
        toolpath: open or closed curves.
        width: bead width where a curve has none of its own, mm.
        resolution: L_R of the outlines, mm; default the layer thickness, or half the width if that is less.
        side: as in `extrude`.
        levels: relative heights of the sections of a layer, ascending, between -1 and 1; fewer are faster.
        executor: works on layers side by side.

    Raises:
        ToolpathError: as `bead_outlines`; or the levels do not ascend between -1 and 1.
    """
    if not levels or not all(a < b for a, b in pairwise([-1.0, *levels, 1.0])):
        raise ToolpathError(f"levels must ascend between -1 and 1, not {tuple(levels)}")
    step = min(toolpath.thickness, 0.5 * width) if resolution is None else float(resolution)
    outlines = bead_outlines(toolpath, width, step, side, executor)
    memo = Memo()
    calls = [
        (drawn.curves, _insets(layer, width, toolpath.thickness, levels), step, i)
        for i, (layer, drawn) in enumerate(zip(toolpath.layers, outlines.layers, strict=True))
    ]
    sections = memo.map(_sections, calls, executor)
    pairs = [(below[-1], above[0], step, i) for i, (below, above) in enumerate(pairwise(sections))]
    contacts = memo.map(_contact, pairs, executor)
    return reconstruct(_stacked(toolpath, sections, contacts, levels), step, executor=executor)


def _insets(layer: Layer, width: float, thickness: float, levels: Sequence[float]) -> tuple[float, ...]:
    """How far inside its outline a layer's section lies at each level, mm."""
    narrowest = min(
        (width if curve.width is None else float(curve.width.min()) for curve in layer.curves), default=width
    )
    bulge = 0.5 * min(thickness, 0.9 * narrowest)
    return tuple(bulge * (1.0 - float(np.sqrt(1.0 - level**2))) for level in levels)


def _sections(
    outlines: Sequence[Curve], insets: Sequence[float], resolution: float, layer: int
) -> list[tuple[Curve, ...]]:
    """The outlines at each inset of a layer; levels above and below the middle share them."""
    if not outlines:
        return [()] * len(insets)
    region = enclosed_region(outlines, f"layer {layer}")
    drawn: dict[float, tuple[Curve, ...]] = {0.0: tuple(outlines)}
    for inset in insets:
        if inset not in drawn:
            # Outlines sampled too coarsely may be narrower than their bead.
            found = (
                _inset(region, share * inset, resolution, f"layer {layer}") for share in (1.0, 0.5, 0.25)
            )
            drawn[inset] = next((curves for curves in found if curves), tuple(outlines))
    return [drawn[inset] for inset in insets]


def _inset(
    region: BaseGeometry, distance: float, resolution: float, where: str, neck: float = CLEFT
) -> tuple[Curve, ...]:
    """Outlines of what is left of a region `distance` inside it, without necks of twice `neck` times the resolution."""

    def outlines(cleft: float) -> list[Array]:
        # Drawn further in and back: here necks narrower than a cleft go, instead of clefts.
        with np.errstate(all="ignore"):  # GEOS leaves flags of its own
            shrunk = region.buffer(-distance - cleft, join_style="mitre", mitre_limit=_MITRE)
            shrunk = shrunk.buffer(cleft, join_style="mitre", mitre_limit=_MITRE)
        spaced = [_spaced(ring, 1e-2 * resolution) for ring in rings(shrunk)]
        return [divide(ring, resolution, True) for ring in spaced if len(ring) >= 3]

    return tuple(Curve(points) for points in triangulable(outlines, neck * resolution, resolution, where))


def _spaced(ring: Array, distance: float) -> Array:
    """A closed polygon without points nearer than `distance` to the one kept before them."""
    line = shapely.LineString(np.vstack([ring, ring[:1]]))
    return np.asarray(shapely.remove_repeated_points(line, distance).coords)[:-1]


def _contact(
    below: Sequence[Curve], above: Sequence[Curve], resolution: float, layer: int
) -> tuple[Curve, ...]:
    """Outlines of where a layer rests on the one below it, `layer`."""
    if not below or not above:
        return ()
    where = f"layer {layer}"
    touching = enclosed_region(below, where).intersection(enclosed_region(above, where))
    return _inset(touching, 0.0, resolution, where, SLIVER)


def _stacked(
    toolpath: Toolpath,
    sections: Sequence[Sequence[tuple[Curve, ...]]],
    contacts: Sequence[tuple[Curve, ...]],
    levels: Sequence[float],
) -> Toolpath:
    """A toolpath of which every section, and every contact between them, is a layer of its own."""
    t = toolpath.thickness
    planes = (plane for layer in toolpath.layers for plane in (layer.slicing, layer.nozzle))
    frames = Frames([toolpath.base, *planes], 0.5 * t)
    heights: list[float] = []
    curves: list[tuple[Curve, ...]] = []
    for i, section in enumerate(sections):
        heights += [(i + 0.5 + 0.5 * level) * t for level in levels]
        curves += section
        if i < len(contacts):
            heights.append((i + 1) * t)
            curves.append(contacts[i])
    ceilings = [*((a + b) / 2.0 for a, b in pairwise(heights)), frames.top]
    layers = [
        Layer(Plane(*slicing), Plane(*nozzle), section)
        for slicing, nozzle, section in zip(frames.at(heights), frames.at(ceilings), curves, strict=True)
    ]
    return Toolpath(toolpath.base, tuple(layers), t / len(levels))
