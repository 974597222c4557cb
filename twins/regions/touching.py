"""Touching: curves that touch or nearly so are joined or parted, for reconstruction refuses them.

Booleans and offsets make them: corners that meet in a point, edges that almost coincide. Whether a layer can be
triangulated is tried, and only if it cannot are the places mended where two pieces of its curves come nearer than a
gap: what lies between them is filled, or cut out. Slivers and clefts thinner than the gap go at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from twins.errors import ToolpathError
from twins.extrusion import rings
from twins.toolpath import Curve
from twins.triangulation import Lattice, triangulate

from .outlines import outlines, without_repeats

Array = npt.NDArray[np.float64]
How = Literal["join", "part"]

GAP = 1e-3
"""The gap that is mended at first, as a share of the resolution."""

TRIES = 5


@dataclass(frozen=True)
class Settled:
    """The curves of a region, kept apart.

    Attributes:
        curves: interior left.
        mended: by how much the region's area was changed for that, mm².
        remark: what had to be done, and where; "" if nothing.
    """

    curves: tuple[Curve, ...]
    mended: float
    remark: str


def settled(
    region: BaseGeometry, resolution: float, how: How, where: str, sources: Sequence[Curve] = ()
) -> Settled:
    """The curves of a region such that reconstruction accepts them.

    Args:
        region: a valid geometry; only its polygons count.
        resolution: L_R with which the layer will be reconstructed, mm.
        how: "join" fills the places where curves nearly touch, "part" cuts them out.
        where: names the layer in the remark.
        sources: the curves that the region was made from, see `outlines`.

    Returns:
        the exact curves where these are accepted, or where nothing helps (the remark says so).
    """
    exact, remarks = region, []
    region, slivers = without_slivers(region, GAP * resolution, how)
    if slivers:
        what = "clefts were filled" if how == "join" else "slivers were dropped"
        remarks.append(f"{where}: {slivers} {what} that are thinner than {GAP * resolution:.2g} mm")
    curves = outlines(region, sources)
    if not accepted(curves, resolution):
        for attempt in range(TRIES):
            gap = GAP * resolution * 2.7**attempt
            mended, place = _mended(region, gap, how)
            trial = outlines(mended, sources)
            if accepted(trial, resolution):
                what = "steps shorter than" if place is None else "curves nearer than"
                done = "evened out" if place is None else f"{how}ed near ({place[0]:.3f}, {place[1]:.3f})"
                remarks.append(f"{where}: {what} {gap:.2g} mm were {done}")
                curves, region = trial, mended
                break
        else:
            remarks.append(f"{where}: curves nearly touch, and reconstruction will refuse them")
    change = region.area - exact.area if remarks else 0.0
    if change:
        remarks[-1] += f"; that changes the area by {change:+.3g} mm²"
    return Settled(curves, change, "; ".join(remarks))


def without_slivers(region: BaseGeometry, gap: float, how: How) -> tuple[BaseGeometry, int]:
    """The region without pieces or, to join, holes whose mean thickness is below a gap, and how many there were."""
    parts, dropped = [], 0
    for part in shapely.get_parts(region):
        if part.geom_type != "Polygon" or part.is_empty:
            continue
        if how == "part" and 2.0 * part.area < gap * part.length:
            dropped += 1
            continue
        holes = [hole for hole in part.interiors if 2.0 * shapely.Polygon(hole).area >= gap * hole.length]
        if how == "join" and len(holes) < len(part.interiors):
            dropped += len(part.interiors) - len(holes)
            part = shapely.Polygon(part.exterior, holes)  # noqa: PLW2901 - the filled part stands for it
        parts.append(part)
    return (shapely.union_all(parts) if dropped else region), dropped


def accepted(curves: Sequence[Curve], resolution: float) -> bool:
    """Whether the closed curves of a layer can be reconstructed."""
    if not curves:
        return True
    points = np.concatenate([curve.points for curve in curves])
    lattice = Lattice.around(points.min(axis=0), points.max(axis=0))
    try:
        # In a toolpath the layer lies on another lattice: a margin of two is left for that.
        triangulate([curve.points for curve in curves], lattice, 2.0 * resolution, "")
    except ToolpathError:
        return False
    return True


def _mended(region: BaseGeometry, gap: float, how: How) -> tuple[BaseGeometry, Array | None]:
    """The region without places nearer than `gap`, and the first such place."""
    places = near_places(rings(region), gap)
    patch = shapely.union_all(places)
    mended = shapely.union(region, patch) if how == "join" else shapely.difference(region, patch)
    return _thinned(mended, 0.5 * gap), (
        shapely.get_coordinates(shapely.centroid(places[0]))[0] if len(places) else None
    )


def _thinned(region: BaseGeometry, apart: float) -> BaseGeometry:
    """The region with points nearer than `apart` made one: no triangulation can follow steps so short."""
    parts = []
    for part in shapely.get_parts(region):
        loops = [without_repeats(loop, apart) for loop in rings(part)]
        if loops and len(loops[0]) >= 3:
            drawn = shapely.Polygon(loops[0], [loop for loop in loops[1:] if len(loop) >= 3])
            parts.append(drawn if drawn.is_valid else shapely.make_valid(drawn, method="structure"))
    return shapely.union_all(parts)


@np.errstate(all="ignore")  # GEOS leaves flags of its own
def near_places(loops: Sequence[Array], gap: float) -> npt.NDArray[np.object_]:
    """Patches over all places where two pieces of closed polygons come nearer than `gap` and do not belong together.

    Pieces of one polygon do where the way between them along it is below four times their distance.
    """
    if not loops:
        return np.zeros(0, np.object_)
    start = np.concatenate(loops)
    end = np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
    loop_of = np.repeat(np.arange(len(loops)), [len(loop) for loop in loops])
    length = np.hypot(*(end - start).T)
    before = np.concatenate([[0.0], np.cumsum(length)])
    around = np.array([length[loop_of == k].sum() for k in range(len(loops))])
    segments = np.asarray(shapely.linestrings(np.stack([start, end], axis=1)), dtype=np.object_)
    i, j = shapely.STRtree(segments).query(segments, predicate="dwithin", distance=gap)
    i, j = i[i < j], j[i < j]
    # The shorter of the two ways between the pieces, from end to start.
    way = before[j] - before[i + 1]
    way = np.minimum(way, around[loop_of[i]] - length[i] - length[j] - way)
    # Along a curve pieces come near one another too, but the way between them is then hardly longer.
    far = (loop_of[i] != loop_of[j]) | (way > 4.0 * shapely.distance(segments[i], segments[j]))
    a, b = segments[i[far]], segments[j[far]]
    # With an end across, where pieces part at a small angle: a cut along either would leave a sliver.
    near_a = shapely.intersection(a, shapely.buffer(b, gap, quad_segs=2))
    near_b = shapely.intersection(b, shapely.buffer(a, gap, quad_segs=2))
    between = shapely.convex_hull(shapely.union(near_a, near_b))
    # Few corners, for a step much shorter than the gap cannot be triangulated.
    patches = shapely.buffer(between, 1.0 * gap, cap_style="square", join_style="mitre", mitre_limit=2.0)
    return np.asarray(patches, dtype=np.object_)
