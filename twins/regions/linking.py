"""Linking: two closed curves become one, at places where they are near to one another.

Both are cut open over a bead width and linked across: by a U-turn, two parallel links a bead width apart, or by a
crossing, two links that change sides. In a U-turn both curves keep their direction and the joined curve does not
cross itself; the strip between the links leaves the region, or joins it. In a crossing the second curve runs
backwards and the joined curve crosses itself once.

The bead stays whole: the links' own beads, half a width to both sides, cover what was cut.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import shapely

from twins.toolpath import Curve

from .outlines import without_repeats

Array = npt.NDArray[np.float64]
LinkKind = Literal["u-turn", "crossing"]

TRIES = 60
"""Places that are tried for a link, from the nearest on."""

SLACK = 0.05
"""Links that are longer than the shortest by less than this share of a width count as equally short."""

LONGEST_CUT = 3.0
"""A curve is cut open over at most this many widths to either side of the link's middle."""


@dataclass(frozen=True, eq=False)
class Link:
    """Two curves joined.

    Attributes:
        curve: the joined one; it begins where the first curve began, if that point is left.
        ends: of the line midway between the two links, on the first curve and on the second, shape (2, 2), mm.
    """

    curve: Curve
    ends: Array

    @property
    def length(self) -> float:
        """Of one of the two links, mm."""
        return float(np.hypot(*(self.ends[1] - self.ends[0])))


def link(
    first: Curve,
    second: Curve,
    width: float,
    kind: LinkKind,
    others: Sequence[Curve] = (),
    near: Array | None = None,
) -> Link | None:
    """Join two closed curves that do not cross, at their closest points or the next place where a link fits.

    Args:
        first, second: they must run in opposite directions where they are nearest, as an outer wall and its hole,
            two holes, or two outer walls do.
        width: of the bead, mm: distance of the links. Curves without widths get it if the other one has widths.
        others: curves that no link may touch.
        near: (u, v); of equally short links the one nearest to it is taken. Default the first curve's beginning.

    Returns:
        None where no link fits: others are in the way, or the curves are too narrow.
    """
    rims = [
        shapely.LinearRing(other.points) if other.closed else shapely.LineString(other.points)
        for other in others
    ]
    obstacles = shapely.union_all(rims) if rims else shapely.MultiLineString()
    for p, q in _places(first, second, width, first.points[0] if near is None else near):
        joined = _joined(first, second, p, q, width, kind, obstacles)
        if joined is not None:
            return Link(joined, np.stack([p, q]))
    return None


def _places(first: Curve, second: Curve, width: float, near: Array) -> Iterator[tuple[Array, Array]]:
    """Places on both curves where they could be linked, the nearest first; at most TRIES that differ."""
    rims = [shapely.LinearRing(curve.points) for curve in (first, second)]
    pairs = [shapely.get_coordinates(shapely.shortest_line(*rims))[None]]
    for at, (rim, other) in enumerate((rims, rims[::-1])):
        here = shapely.get_coordinates(shapely.segmentize(rim, 0.5 * width))[:-1]
        pair = np.stack([here, _nearest_on(other, here)], axis=1)
        pairs.append(pair if at == 0 else pair[:, ::-1])
    ends = np.concatenate(pairs)
    length = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    short = length <= length.min() + SLACK * width
    away = np.hypot(*(ends[:, 0] - near).T)
    order = np.lexsort([np.where(short, away, length), ~short])
    waiting = ends[order]
    for _ in range(TRIES):
        if not len(waiting):
            return
        place = waiting[0]
        yield place[0], place[1]
        waiting = waiting[(np.abs(waiting - place) > 0.3 * width).any(axis=(1, 2))]


def _nearest_on(rim: shapely.LinearRing, points: Array) -> Array:
    """The point of a rim that is nearest to each point, shape (n, 2)."""
    corners = shapely.get_coordinates(rim)
    a, along = corners[:-1], np.diff(corners, axis=0)
    edges = np.asarray(shapely.linestrings(np.stack([a, corners[1:]], axis=1)), dtype=np.object_)
    at, edge = shapely.STRtree(edges).query_nearest(shapely.points(points), all_matches=False)
    edge = edge[np.argsort(at)]
    square = np.maximum((along[edge] ** 2).sum(axis=1), 1e-300)
    share = np.clip(((points - a[edge]) * along[edge]).sum(axis=1) / square, 0.0, 1.0)
    return np.asarray(a[edge] + share[:, None] * along[edge], dtype=np.float64)


def _joined(
    first: Curve,
    second: Curve,
    p: Array,
    q: Array,
    width: float,
    kind: LinkKind,
    obstacles: shapely.Geometry,
) -> Curve | None:
    along = q - p
    length = float(np.hypot(*along))
    if length < 1e-6 * width:
        return None
    across = np.array([-along[1], along[0]]) / length
    wide = (first.width is None) != (second.width is None)
    cut = [_opened(curve, place, across, width, wide) for curve, place in ((first, p), (second, q))]
    if cut[0] is None or cut[1] is None:
        return None
    (one, one_ahead), (two, two_ahead) = cut[0], cut[1]
    if one_ahead == two_ahead:
        if kind == "u-turn":
            return None  # they run the same way: one of them would have to be turned round
        two = two[::-1]
    # From the end of the first curve to the beginning of the second, and back.
    strip = shapely.Polygon(np.stack([one[-1, :2], two[0, :2], two[-1, :2], one[0, :2]]))
    if not strip.is_valid or strip.intersects(obstacles):
        return None
    paths = shapely.MultiLineString([one[:, :2], two[:, :2]])
    turned = np.vstack([one, two])
    if shapely.intersection(strip, paths).length > 1e-6 * width:
        return None
    if kind == "u-turn" and not shapely.LinearRing(turned[:, :2]).is_simple:
        return None
    rows = turned if kind == "u-turn" else np.vstack([one, two[::-1]])
    started = np.flatnonzero((rows[:, :2] == first.points[0]).all(axis=1))
    rows = np.roll(rows, -int(started[0]), axis=0) if len(started) else rows
    has_width = first.width is not None or second.width is not None
    return Curve(rows[:, :2], width=rows[:, 2] if has_width else None)


def _opened(curve: Curve, place: Array, across: Array, width: float, wide: bool) -> tuple[Array, bool] | None:
    """A closed curve cut open over a width about a place.

    Args:
        curve: to be cut.
        place: on it, shape (2,), mm.
        across: the direction in which the cut is measured, shape (2,).
        width: of the cut and, if `wide`, of the curve where it has none, mm.

    Returns:
        the rest, from the end of the cut round to its beginning, rows (u, v, width), and whether the rest begins on
        the side that `across` points to; None if the curve does not leave the strip near by, or leaves it on one side.
    """
    own = np.full(len(curve.points), width if wide else 1.0) if curve.width is None else curve.width
    rows = np.column_stack([curve.points, own])
    n = len(rows)
    along = np.roll(curve.points, -1, axis=0) - curve.points
    square = np.maximum((along**2).sum(axis=1), 1e-300)
    shares = np.clip(((place - curve.points) * along).sum(axis=1) / square, 0.0, 1.0)
    edge = int(np.argmin(((curve.points + shares[:, None] * along - place) ** 2).sum(axis=1)))
    share = shares[edge]
    middle = rows[edge] + share * (rows[(edge + 1) % n] - rows[edge])
    # From the middle of the cut all the way round and back to it.
    path = np.vstack([middle, np.roll(rows, -(edge + 1), axis=0), middle])
    path = path[np.r_[True, np.hypot(*np.diff(path[:, :2], axis=0).T) > 0.0]]
    ahead = _leaves(path, across, width)
    back = _leaves(path[::-1], across, width)
    if ahead is None or back is None:
        return None
    i, start, upwards = ahead
    j, end, also_upwards = back
    j = len(path) - 1 - j  # the first of the points that are cut off at the end
    if upwards == also_upwards or i > j:
        return None
    rest = np.vstack([start, path[i : j + 1], end])
    loose = 1e-3 * width
    inner = rest[1:-1]
    kept = (np.hypot(*(inner - start)[:, :2].T) > loose) & (np.hypot(*(inner - end)[:, :2].T) > loose)
    rest = np.vstack([start, inner[kept], end])
    return (rest, upwards) if len(rest) >= 3 and len(without_repeats(rest[:, :2])) >= 3 else None


def _leaves(path: Array, across: Array, width: float) -> tuple[int, Array, bool] | None:
    """Where a path first is half a width off its first point, measured across: next point, place, on which side."""
    off = (path[:, :2] - path[0, :2]) @ across
    out = np.flatnonzero(np.abs(off) >= 0.5 * width)
    if not len(out):
        return None
    i = int(out[0])
    aim = np.copysign(0.5 * width, off[i])
    share = (aim - off[i - 1]) / (off[i] - off[i - 1])
    place = path[i - 1] + share * (path[i] - path[i - 1])
    way = np.hypot(*np.diff(np.vstack([path[:i], place])[:, :2], axis=0).T).sum()
    return (i, place, bool(aim > 0)) if way <= LONGEST_CUT * width else None
