"""Widths of curves that come out of an operation: taken from the curves that they were made from.

A point that a curve has as well keeps that curve's width to the bit; any other takes the width of the nearest place
of the curves. Where that curve has none, the bead is as wide as the caller says it nominally is or else, which is
reported, as the new curve's known widths on both sides say, linear along it in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import shapely

from twins.errors import ToolpathError
from twins.toolpath import Curve

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

ON_CURVE = 1e-6
"""Places of curves that are this near to being equally near to a point count as that, mm."""


def check_width(width: float | None) -> float | None:
    """A nominal bead width as a number above 0, or None.

    Raises:
        ToolpathError: it is none.
    """
    if width is not None and not (width > 0 and np.isfinite(width)):
        raise ToolpathError(f"the bead width must be above 0 mm, not {width}")
    return None if width is None else float(width)


def with_widths(
    made: Sequence[Curve], sources: Sequence[Curve], width: float | None, where: str
) -> tuple[list[Curve], str]:
    """Give new curves the widths of those that they were made from.

    Args:
        made: curves; those that are among the sources stay the same objects.
        sources: with widths or without.
        width: nominal, of curves that have none of their own, mm.
        where: names the layer in the remark.

    Returns:
        the curves, and a remark if a width had to be found in between, otherwise "". A curve that takes all its
        points from sources without widths has none.
    """
    if all(source.width is None for source in sources):
        return list(made), ""
    old = {id(source) for source in sources}
    given: list[Curve] = []
    guessed = 0.0
    for curve in made:
        found = None if id(curve) in old else nearest_widths(curve.points, sources)
        unknown = np.isnan(found) if found is not None else np.ones(1, np.bool_)
        if found is None or unknown.all():
            given.append(curve)
            continue
        if unknown.any() and width is not None:
            found[unknown] = width
        elif unknown.any():
            place, step = _along(curve)
            guessed += float(step[unknown].sum())
            period = float(place[-1]) if curve.closed else None
            at = place[: len(unknown)]
            found[unknown] = np.interp(at[unknown], at[~unknown], found[~unknown], period=period)
        given.append(replace(curve, width=found))
    if not guessed:
        return given, ""
    return given, (
        f"{where}: {guessed:.4g} mm of new curves come from curves without bead widths, and took them from beside; "
        "give a width for curves that have none"
    )


def nearest_widths(points: Array, sources: Sequence[Curve]) -> Array:
    """The width of the nearest place of curves at each point, shape (n,), mm; NaN where that curve has none.

    Of places equally near those of curves with widths come first, and of these the earliest curve's.
    """
    segments, owner, first = _segments(sources)
    has_width = np.array([source.width is not None for source in sources])
    rank = owner + np.where(has_width[owner], 0, len(sources))
    tree, places = shapely.STRtree(segments), shapely.points(points)
    (nearest, _), least = tree.query_nearest(places, all_matches=False, return_distance=True)
    away = np.zeros(len(points))
    away[nearest] = least
    at, on = tree.query(places, predicate="dwithin", distance=away + ON_CURVE)
    last = np.lexsort([-rank[on], at])  # the one that counts comes last of each point's
    chosen = np.zeros(len(points), np.int64)
    chosen[at[last]] = on[last]
    width = np.full(len(points), np.nan)
    for j, source in enumerate(sources):
        mine = np.flatnonzero(owner[chosen] == j)
        if source.width is None or not len(mine):
            continue
        i = first[chosen[mine]]
        k = (i + 1) % len(source.points)
        a, along = source.points[i], source.points[k] - source.points[i]
        square = np.maximum((along**2).sum(axis=1), 1e-300)
        share = np.clip(((points[mine] - a) * along).sum(axis=1) / square, 0.0, 1.0)
        # To the bit where the point is one of the curve's.
        share[(points[mine] == a).all(axis=1)] = 0.0
        share[(points[mine] == source.points[k]).all(axis=1)] = 1.0
        width[mine] = (1.0 - share) * source.width[i] + share * source.width[k]
    return width


def _along(curve: Curve) -> tuple[Array, Array]:
    """How far along a curve each point lies, of a closed one its length last; and half the segments beside it, mm."""
    points = np.vstack([curve.points, curve.points[:1]]) if curve.closed else curve.points
    lengths = np.hypot(*np.diff(points, axis=0).T)
    before = np.roll(lengths, 1) if curve.closed else np.r_[0.0, lengths]
    after = lengths if curve.closed else np.r_[lengths, 0.0]
    return np.concatenate([[0.0], np.cumsum(lengths)]), 0.5 * (before + after)


def _segments(sources: Sequence[Curve]) -> tuple[npt.NDArray[np.object_], Indices, Indices]:
    """The segments of curves, the curve of each, and the index of its first point."""
    ends, owner, place = [], [], []
    for j, curve in enumerate(sources):
        count = len(curve.points) if curve.closed else len(curve.points) - 1
        ends.append(np.stack([curve.points[:count], np.roll(curve.points, -1, axis=0)[:count]], axis=1))
        owner.append(np.full(count, j))
        place.append(np.arange(count))
    lines = np.asarray(shapely.linestrings(np.concatenate(ends)), dtype=np.object_)
    return lines, np.concatenate(owner), np.concatenate(place)
