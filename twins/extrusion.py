"""Extrusion: the printed volume M' of a toolpath (seed paper, Section 2.2.2).

The bead along a curve covers half its width on both sides. The region that a layer's beads cover together, bounded
by curves with the interior on the left, is the pseudo-toolpath TP'; reconstructing it gives M'. For a printed shell
that is cast full, only the outer halves are added to what the curves enclose.

Reconstruction refuses curves that nearly touch, and beads laid side by side do just that. So beads are drawn a
little too wide and their union is drawn back by as much: clefts narrower than twice that close and everything else
stays. Whether a layer can be triangulated is tried at once, and if it cannot, a wider cleft is closed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import Literal

import numpy as np
import numpy.typing as npt
import shapely
import trimesh
from shapely.geometry.base import BaseGeometry

from .entrances import checks_kinds
from .errors import ToolpathError
from .memo import Memo
from .reconstruction import reconstruct
from .sampling import sample_layer
from .toolpath import Curve, Layer, Toolpath
from .triangulation import Lattice, triangulate

Array = npt.NDArray[np.float64]
Side = Literal["both", "outer"]

QUAD_SEGS = 12
"""Segments of a quarter circle; its chords stay within 0.11 % of the bead's width."""

CLEFT = 2.5e-3
"""Half the width of the clefts that are closed at first, as a share of the resolution or, if more, of a width."""

TRIES = 5

NUDGES = (1e-9, 1e-7, 1e-5)
"""How much wider a bead is drawn that came out crossing itself, as shares of its radius."""


@checks_kinds
def extrude(
    toolpath: Toolpath,
    width: float,
    resolution: float | None = None,
    side: Side = "both",
    executor: Executor | None = None,
) -> trimesh.Trimesh:
    """The volume M' that a toolpath prints: a closed, outward oriented 2-manifold.

    Args:
        toolpath: open or closed curves.
        width: bead width where a curve has none of its own, mm.
        resolution: L_R of the result, mm; default the layer thickness.
        side: "outer" for a printed shell together with what is cast into it.
        executor: works on layers side by side.

    Raises:
        ToolpathError: as `bead_outlines`.
    """
    step = toolpath.thickness if resolution is None else float(resolution)
    return reconstruct(bead_outlines(toolpath, width, step, side, executor), step, executor=executor)


@checks_kinds
def bead_outlines(
    toolpath: Toolpath,
    width: float,
    resolution: float,
    side: Side = "both",
    executor: Executor | None = None,
) -> Toolpath:
    """The pseudo-toolpath TP': the outlines of all beads of each layer, interior left, sampled at `resolution`.

    With `side` "outer" the region within half a width of what a layer's curves enclose: the outlines run along the
    outer, right side of the curves.

    Raises:
        ToolpathError: the width is not above 0, or there are no curves; with "outer", a layer has open curves, or
            ones that do not enclose a region on their left.
    """
    if not width > 0 or not np.isfinite(width):
        raise ToolpathError(f"the bead width must be above 0 mm, not {width}")
    if not resolution > 0 or not np.isfinite(resolution):
        raise ToolpathError(f"the resolution must be above 0 mm, not {resolution}")
    if side not in ("both", "outer"):
        raise ToolpathError(f"a toolpath is extruded on side 'both' or 'outer', not {side!r}")
    if not any(layer.curves for layer in toolpath.layers):
        raise ToolpathError("the toolpath has no curves: there is nothing to extrude")
    calls = [(layer.curves, width, resolution, side, i) for i, layer in enumerate(toolpath.layers)]
    outlines = Memo().map(_layer_outlines, calls, executor)
    return Toolpath(
        toolpath.base,
        tuple(
            Layer(layer.slicing, layer.nozzle, tuple(Curve(points) for points in loops))
            for layer, loops in zip(toolpath.layers, outlines, strict=True)
        ),
        toolpath.thickness,
    )


def _layer_outlines(
    curves: Sequence[Curve], width: float, resolution: float, side: Side, layer: int
) -> list[Array]:
    if not curves:
        return []
    where = f"layer {layer}"
    core = enclosed_region(curves, where) if side == "outer" else shapely.Polygon()

    def outlines(cleft: float) -> list[Array]:
        grown = shapely.union(core, bead_region(curves, width, cleft))
        with np.errstate(all="ignore"):  # GEOS leaves flags of its own
            drawn = grown.buffer(-cleft, join_style="mitre")
        return sample_layer(rings(drawn), resolution)

    # Wider than the gaps that chords leave where arcs touch.
    widest = max(width if curve.width is None else float(curve.width.max()) for curve in curves)
    return triangulable(outlines, CLEFT * max(resolution, widest), resolution, where)


def triangulable(
    outlines: Callable[[float], list[Array]], cleft: float, resolution: float, where: str
) -> list[Array]:
    """The first curves that reconstruction accepts, drawn with clefts of half a width from `cleft` upwards closed.

    Raises:
        ToolpathError: it accepts none; names the layer.
    """
    for attempt in range(TRIES):
        # Not by powers of two: the next cleft is no multiple of one that happened to close in a point.
        curves = outlines(cleft * 2.7**attempt)
        if not curves:
            return []
        points = np.concatenate(curves)
        lattice = Lattice.around(points.min(axis=0), points.max(axis=0))
        try:
            # Reconstruction puts a layer on another lattice: a margin of two is left for that.
            triangulate(curves, lattice, 2.0 * resolution, where)
        except ToolpathError as error:
            reason = error
        else:
            return curves
    raise ToolpathError(
        f"{where}: the beads cannot be outlined at a resolution of {resolution:.6g} mm; choose a finer one ({reason})"
    )


def enclosed_region(curves: Sequence[Curve], where: str) -> BaseGeometry:
    """What closed curves have on their left.

    Raises:
        ToolpathError: open curves, or curves that cross or enclose nothing on their left; names the layer.
    """
    if not all(curve.closed for curve in curves):
        raise ToolpathError(f"{where}: an open curve has no outer side; close it, or extrude both sides")
    closed = [np.vstack([curve.points, curve.points[:1]]) for curve in curves]
    region = shapely.build_area(shapely.MultiLineString(closed))
    area, length = sum(curve.signed_area for curve in curves), sum(curve.length for curve in curves)
    # Where curves cross, or run the other way, what they bound has another area.
    if region.is_valid and abs(region.area - area) <= 1e-6 * length**2:
        return region
    raise ToolpathError(
        f"{where}: curves cross or enclose nothing on their left; outer curves run counter-clockwise, inner ones "
        "clockwise"
    )


def bead_region(curves: Sequence[Curve], width: float, extra: float) -> BaseGeometry:
    """The region that beads cover, drawn wider by `extra` on each side, mm; `width` where a curve has none."""
    lines: list[Array] = []
    beads: list[BaseGeometry] = []
    for curve in curves:
        points = np.vstack([curve.points, curve.points[:1]]) if curve.closed else curve.points
        if curve.width is not None:
            radii = 0.5 * (np.r_[curve.width, curve.width[:1]] if curve.closed else curve.width) + extra
            beads += _tapering(points, radii, closed=curve.closed)
        elif curve.closed:
            # In halves: GEOS offsets a ring as if it did not cross itself, and loses the rest of the bead.
            half = len(points) // 2
            lines += [points[: half + 1], points[half:]]
        else:
            lines.append(points)
    if lines:
        beads += _buffered(lines, 0.5 * width + extra)
    return shapely.union_all(beads)


def _buffered(lines: Sequence[Array], radius: float) -> list[BaseGeometry]:
    """The discs along paths. GEOS now and then draws a buffer that crosses itself; a trifle wider it does not."""
    paths = np.array([shapely.LineString(line) for line in lines])
    found = shapely.buffer(paths, radius, quad_segs=QUAD_SEGS)
    for nudge in NUDGES:
        crossed = ~shapely.is_valid(found)
        if not crossed.any():
            break
        found[crossed] = shapely.buffer(paths[crossed], radius * (1.0 + nudge), quad_segs=QUAD_SEGS)
    return list(found)


def _tapering(points: Array, radii: Array, *, closed: bool) -> list[BaseGeometry]:
    """Polygons that together cover a bead: for each segment the convex hull of the discs at its ends.

    Hulls are uneven: where a disc lies inside the hull of the segment before, or after, coarse chords do. What they
    cut off is covered there, because the point of the path that is nearest to a place, less the radius at it, is
    one where the place is seen at a tangent's angle, or at a vertex outside the tangents of both its segments.

    Args:
        points: of a path, shape (n, 2), mm; a closed one repeats its first.
        radii: shape (n,), mm.
        closed: whether the ends are no ends.
    """
    a, b, r, s = points[:-1], points[1:], radii[:-1], radii[1:]
    x, y = (b - a).T
    length = np.hypot(x, y)
    direction = np.arctan2(y, x)
    # The common tangents touch both discs at this angle from the direction a -> b: 0 where the disc at a holds the
    # other, pi where that at b does.
    repeated = length == 0.0
    cosine = np.where(repeated, np.sign(r - s), (r - s) / np.where(repeated, 1.0, length))
    tangent = np.arccos(np.clip(cosine, -1.0, 1.0))
    behind, ahead = 2.0 * np.pi - 2.0 * tangent, 2.0 * tangent
    corners = 4 * QUAD_SEGS
    back = np.maximum(np.ceil(behind / (2.0 * np.pi) * corners), 1.0)[:, None]
    k = np.arange(corners + 3)[None, :]
    on_a = k <= back
    turned = np.where(
        on_a,
        behind[:, None] * k / back,
        behind[:, None] + ahead[:, None] * (k - back - 1) / (corners + 1 - back),
    )
    angle = (direction + tangent)[:, None] + turned
    radius = np.where(on_a, r[:, None], s[:, None])
    center = np.where(on_a[:, :, None], a[:, None], b[:, None])
    rim = center + radius[:, :, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    # On the disc at a only what the segment before has ahead of its tangents can be seen, and nothing at b.
    from_before = (angle - np.roll(direction, 1)[:, None] + np.pi) % (2.0 * np.pi) - np.pi
    seen = on_a & (np.abs(from_before) <= np.roll(tangent, 1)[:, None])
    seen |= repeated[:, None] | (np.roll(repeated, 1)[:, None] & on_a)  # repeated points have no direction
    if not closed:
        seen[0] |= on_a[0]
        seen[-1] |= ~on_a[-1]
    beside = np.roll(seen, 1, axis=1) | np.roll(seen, -1, axis=1)
    kept = seen | beside | (k % (QUAD_SEGS // 2) == 0) | (k == back) | (k == back + 1) | (k == corners + 2)
    owner = np.nonzero(kept)[0]
    hulls = shapely.polygons(shapely.linearrings(rim[kept], indices=owner))
    one_disc = np.abs(cosine) > 1.0 - 1e-6  # its rim meets itself, within rounding
    hulls[one_disc | repeated] = shapely.convex_hull(hulls[one_disc | repeated])
    return list(hulls)


def rings(region: BaseGeometry) -> list[Array]:
    """Rings of a region, interior left, without the repeated last point."""
    loops = []
    for part in shapely.get_parts(region):
        if part.geom_type == "Polygon" and not part.is_empty:
            oriented = shapely.geometry.polygon.orient(part)
            loops += [np.asarray(ring.coords)[:-1] for ring in (oriented.exterior, *oriented.interiors)]
    return loops
