"""Interior left: curves of a layer turned so that what they enclose is on their left.

A curve inside an even number of others is an outer one and runs counter-clockwise, otherwise it is a hole and runs
clockwise. An open curve counts as if its ends were joined, unless it would then cross itself or another curve: such
a one encloses nothing and runs as it was drawn. Whether an open wall was opened for a door or stands around a court
cannot be told, so closed curves that would run the other way without it are named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from twins.errors import ToolpathError
from twins.regions.outlines import turned_round
from twins.toolpath import Curve

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Turned:
    """Curves of a layer with their interior on the left.

    Attributes:
        curves: in the order in which they were given.
        as_drawn: names of open ones that enclose nothing.
        by_open: names of closed ones that would run the other way if open ones enclosed nothing.
    """

    curves: tuple[Curve, ...]
    as_drawn: tuple[int, ...]
    by_open: tuple[int, ...]


def interior_left(curves: Sequence[Curve], names: Sequence[int], where: str, tolerance: float) -> Turned:
    """The curves with their interior on the left.

    Args:
        curves: of one layer.
        names: their numbers, for messages.
        where: the layer, for messages.
        tolerance: curves that overlap by no more only touch, mm.

    Raises:
        ToolpathError: closed curves that cross or repeat one another, cross themselves, or enclose nothing.
    """
    shapes = np.array([shapely.Polygon(c.points) if len(c.points) > 2 else shapely.Polygon() for c in curves])
    area, length = shapely.area(shapes), shapely.length(shapes)
    whole = shapely.is_valid(shapes) & (area > tolerance * length)
    for curve, name, shape, is_whole in zip(curves, names, shapes, whole, strict=True):
        if curve.closed and not is_whole:
            why = shapely.is_valid_reason(shape)
            raise ToolpathError(
                f"{where}: curve {name} encloses nothing; leave it out, or draw it open"
                if why == "Valid Geometry"
                else f"{where}: curve {name} touches or crosses itself ({why[:1].lower()}{why[1:]}); draw it without"
            )
    closed = np.array([curve.closed for curve in curves])
    counted = whole.copy()
    for i, j in _meeting(shapes, whole):
        overlap = float(shapely.area(shapely.intersection(shapes[i], shapes[j])))
        rounding = tolerance * float(length[i] + length[j])
        small = float(min(area[i], area[j]))
        if overlap <= rounding:
            continue
        same = overlap >= max(area[i], area[j]) - rounding
        if overlap >= small - rounding and not same:
            continue
        if closed[i] and closed[j]:
            raise ToolpathError(
                f"{where}: curves {names[i]} and {names[j]} "
                + ("lie on one another; leave one out" if same else "cross; draw them apart, or unite them")
            )
        counted[[i, j]] &= closed[[i, j]]
    depth = _depth(shapes, area, counted)
    by_open = closed & ((depth - _depth(shapes, area, counted & closed)) % 2 == 1)
    turned = tuple(
        turned_round(curve) if counted[k] and (_turning(curve) > 0) != (depth[k] % 2 == 0) else curve
        for k, curve in enumerate(curves)
    )
    return Turned(
        turned,
        tuple(name for name, counts in zip(names, counted, strict=True) if not counts),
        tuple(name for name, turns in zip(names, by_open, strict=True) if turns),
    )


def _meeting(shapes: npt.NDArray[np.object_], whole: Flags) -> list[tuple[int, int]]:
    """Pairs whose outlines meet."""
    at = np.flatnonzero(whole)
    rings = shapely.get_exterior_ring(shapes[at])
    i, j = shapely.STRtree(rings).query(rings, predicate="intersects")
    return [(int(at[a]), int(at[b])) for a, b in zip(i, j, strict=True) if a < b]


def _depth(
    shapes: npt.NDArray[np.object_], area: npt.NDArray[np.float64], counted: Flags
) -> npt.NDArray[np.int64]:
    """How many of the shapes that count each one lies in."""
    depth = np.zeros(len(shapes), dtype=np.int64)
    at = np.flatnonzero(counted)
    places = shapely.point_on_surface(shapes[at])
    i, j = shapely.STRtree(shapes[at]).query(places, predicate="within")
    # Walls inside the shape are around its place too, if they are smaller.
    np.add.at(depth, at[i], area[at[j]] > area[at[i]])
    return depth


def _turning(curve: Curve) -> float:
    return curve.signed_area if curve.closed else Curve(curve.points).signed_area
