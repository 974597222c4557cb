"""Regions: what a layer's curves enclose, as polygons with holes, and back (seed paper, Section 2).

A region is one connected interior: an outer wall and its holes. Outer curves run counter-clockwise, holes
clockwise, so that the interior is on the left of either. A curve that comes out of an operation as it went in stays
the same object: a twin builds again only what has changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from twins.entrances import checks_kinds
from twins.extrusion import enclosed_region, rings
from twins.toolpath import Curve, Layer, Toolpath

Array = npt.NDArray[np.float64]

REPEATED = 1e-8
"""Points of a ring closer than this share of its extent are one: they are rounding of one crossing."""


def regions_of(layer: Layer, where: str = "the layer") -> tuple[shapely.Polygon, ...]:
    """The regions of a layer: polygons with holes in (u, v), exteriors counter-clockwise; open curves bound none.

    Raises:
        ToolpathError: curves that cross, or enclose nothing on their left; `where` names the layer.
    """
    parts = shapely.get_parts(region_within(layer.curves, where))
    return tuple(shapely.geometry.polygon.orient(part) for part in parts if not part.is_empty)


def region_within(curves: Sequence[Curve], where: str) -> BaseGeometry:
    """All that the closed curves of a layer enclose, as one geometry; open ones are passed over.

    Raises:
        ToolpathError: as `regions_of`.
    """
    closed = [curve for curve in curves if curve.closed]
    return enclosed_region(closed, where) if closed else shapely.Polygon()


def walls(curves: Sequence[Curve], where: str) -> list[tuple[int, tuple[int, ...]]]:
    """For each region the index of its outer curve and those of its inner ones.

    Raises:
        ToolpathError: as `regions_of`.
    """
    region_within(curves, where)
    outer = [j for j, curve in enumerate(curves) if curve.signed_area > 0]
    inner = [j for j, curve in enumerate(curves) if curve.signed_area < 0]
    if not inner:
        return [(j, ()) for j in outer]
    areas = np.array([curves[j].signed_area for j in outer])
    around = np.array([shapely.Polygon(curves[j].points) for j in outer])
    holes = np.array([shapely.Polygon(curves[k].points) for k in inner])
    # A hole may touch its outer wall, so it is asked about with a place inside it.
    inside = shapely.contains(around[:, None], shapely.point_on_surface(holes)[None, :])
    # Walls inside the hole are around its place too, if they are smaller than the hole.
    inside &= areas[:, None] > shapely.area(holes)[None, :]
    parent = np.where(inside, areas[:, None], np.inf).argmin(axis=0)
    return [
        (j, tuple(k for k, at in zip(inner, parent, strict=True) if at == i)) for i, j in enumerate(outer)
    ]


def outlines(region: BaseGeometry, sources: Sequence[Curve] = ()) -> tuple[Curve, ...]:
    """The curves around a region, closed, interior left.

    Args:
        region: of polygons; what else a collection holds is left out.
        sources: the curves that the region was made from.

    Returns:
        first the sources that are unchanged, as the same objects and in their order, then the new curves. A new
        curve begins at the earliest point of a source that it has. It carries widths if all of it runs along
        sources that have them: those of the sources' points, in between interpolated (where two sources meet, the
        earlier one's). Otherwise it has none, and the print settings decide.
    """
    known = {_key(curve.points): j for j, curve in reversed(list(enumerate(sources))) if curve.closed}
    kept: set[int] = set()
    new = []
    for ring in rings(region):
        j = known.get(_key(ring))
        if j is not None:
            kept.add(j)
            continue
        points = without_repeats(ring)
        if len(points) >= 3:
            new.append(Curve(_begun(points, sources)))
    return (*(sources[j] for j in sorted(kept)), *new)


@checks_kinds
def oriented(toolpath: Toolpath) -> Toolpath:
    """The toolpath with the interior on the left of every closed curve, whichever way it was drawn.

    A curve inside an even number of others is an outer one, otherwise a hole. For curves that were drawn by hand;
    curves must not cross.
    """
    layers = []
    for layer in toolpath.layers:
        loops = [curve for curve in layer.curves if curve.closed]
        shapes = np.array([shapely.Polygon(curve.points) for curve in loops], dtype=object)
        curves: list[Curve] = []
        for curve in layer.curves:
            if not curve.closed:
                curves.append(curve)
                continue
            place = shapely.Point(curve.points[0])
            depth = sum(
                bool(shape.contains(place))
                for other, shape in zip(loops, shapes, strict=True)
                if other is not curve
            )
            curves.append(curve if (curve.signed_area > 0) == (depth % 2 == 0) else turned_round(curve))
        layers.append(with_curves(layer, curves))
    return with_layers(toolpath, layers)


def turned_round(curve: Curve) -> Curve:
    """The curve run the other way; a closed one still begins at its first point."""

    def backwards(values: Array) -> Array:
        return np.roll(values[::-1], 1, axis=0) if curve.closed else values[::-1]

    width = None if curve.width is None else backwards(curve.width)
    return Curve(backwards(curve.points), curve.closed, width)


def with_curves(layer: Layer, curves: Sequence[Curve]) -> Layer:
    """The layer with other curves; the same object if they are the same ones."""
    same = len(curves) == len(layer.curves) and all(a is b for a, b in zip(curves, layer.curves, strict=True))
    return layer if same else replace(layer, curves=tuple(curves))


def with_layers(toolpath: Toolpath, layers: Sequence[Layer]) -> Toolpath:
    """The toolpath with other layers; the same object if they are the same ones."""
    same = len(layers) == len(toolpath.layers) and all(
        a is b for a, b in zip(layers, toolpath.layers, strict=True)
    )
    return toolpath if same else replace(toolpath, layers=tuple(layers))


def without_repeats(ring: Array, apart: float = 0.0) -> Array:
    """A ring, shape (n, 2), without the points nearer to the one kept before them than `apart`, or than rounding."""
    least = max(apart, REPEATED * float(np.ptp(ring, axis=0).max()))
    steps = np.hypot(*(ring - np.roll(ring, 1, axis=0)).T)
    if (steps > least).all():
        return ring
    kept = [0]
    for i in range(1, len(ring)):
        if np.hypot(*(ring[i] - ring[kept[-1]])) > least:
            kept.append(i)
    while len(kept) > 1 and np.hypot(*(ring[kept[-1]] - ring[0])) <= least:
        kept.pop()
    return np.asarray(ring[kept], dtype=np.float64)


def _key(ring: Array) -> bytes:
    """The same for two rings that differ only in where they begin."""
    first = np.lexsort(ring.T[::-1])[0]
    return (np.roll(ring, -first, axis=0) + 0.0).tobytes()


def _begun(ring: Array, sources: Sequence[Curve]) -> Array:
    """The ring begun at the earliest point of a source that it has, so that seams stay."""
    if not sources:
        return ring
    rank: dict[bytes, int] = {}
    for point in np.concatenate([curve.points for curve in sources]) + 0.0:
        rank.setdefault(point.tobytes(), len(rank))
    order = [rank.get(point.tobytes(), len(rank)) for point in ring + 0.0]
    return np.roll(ring, -int(np.argmin(order)), axis=0)
