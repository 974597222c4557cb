"""Where curves of a layer come too close to one another, or to themselves (seed paper, Section 4.2).

The spacing at a point is its distance from the nearest place of another run: of another curve, or of its own curve at
least (pi / 2) d away along it, which is the way around a turn that just keeps the distance d from itself. Places
between sample points count: two runs have the same spacing whether their points lie opposite one another or not.

Pairs are found in a grid of cells. A list of them can be made wider than needed and used again until points have
moved by half of what it is wider.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numba as nb
import numpy as np
import numpy.typing as npt

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.toolpath import Curve, Toolpath

from .dividing import divided

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

ALONG: Final = 0.5 * np.pi
"""Points nearer than this many minimal distances along their own curve are not too close."""

CLOSE: Final = 0.95
"""Share of the minimal distance below which spacing counts as overfill."""

SAMPLES: Final = 4
"""Segments to a minimal distance, at least: coarser sampling misses places."""


@dataclass(frozen=True, eq=False)
class Runs:
    """The curves of a layer as arrays.

    Attributes:
        points: shape (n, 2), mm, curve after curve.
        previous, following: shape (n,), the point before and after each; the ends of open curves are their own.
        curve: shape (n,), which curve a point belongs to.
        starts: shape (curves + 1,), where each curve begins.
        closed: shape (curves,).
    """

    points: Array
    previous: Indices
    following: Indices
    curve: Indices
    starts: Indices
    closed: Flags

    @classmethod
    def of(cls, curves: Sequence[Curve]) -> Runs:
        """The curves of a layer; there may be none."""
        sizes = np.array([len(curve.points) for curve in curves], dtype=np.int64)
        starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        n = int(starts[-1])
        previous, following = np.arange(-1, n - 1), np.arange(1, n + 1)
        closed = np.array([curve.closed for curve in curves], dtype=bool)
        first, last = starts[:-1], starts[1:] - 1
        previous[first] = np.where(closed, last, first)
        following[last] = np.where(closed, first, last)
        points = np.concatenate([curve.points for curve in curves]) if curves else np.empty((0, 2))
        return cls(points, previous, following, np.repeat(np.arange(len(sizes)), sizes), starts, closed)

    @property
    def share(self) -> Array:
        """The length of curve that each point stands for: half of each segment that ends in it; shape (n,), mm."""
        to_next = np.linalg.norm(self.points[self.following] - self.points, axis=1)
        to_last = np.linalg.norm(self.points[self.previous] - self.points, axis=1)
        return np.asarray(0.5 * (to_next + to_last), dtype=np.float64)


@dataclass(frozen=True)
class Spacing:
    """How close the curves of a toolpath, or of a layer, come to one another.

    Attributes:
        length: of all curves, mm.
        close: length of curve with a spacing below 0.95 of the minimal distance, mm.
        least: the smallest spacing, mm; infinite where nothing is nearer than the minimal distance.
    """

    length: float
    close: float
    least: float

    @classmethod
    def total(cls, layers: Sequence[Spacing]) -> Spacing:
        """Of several layers together."""
        return cls(
            sum(layer.length for layer in layers),
            sum(layer.close for layer in layers),
            min((layer.least for layer in layers), default=float("inf")),
        )


def check_distance(distance: float) -> float:
    """The minimal distance as a number above 0.

    Raises:
        ToolpathError: it is none.
    """
    if not distance > 0 or not np.isfinite(distance):
        raise ToolpathError(f"the minimal distance between curves must be above 0 mm, not {distance}")
    return float(distance)


@checks_kinds
def spacing(toolpath: Toolpath, min_distance: float) -> tuple[Spacing, ...]:
    """How close the curves of each layer come to one another.

    Curves are divided as `relieve_overfill` divides them, into segments of at most a quarter of the distance.

    Args:
        toolpath: open or closed curves.
        min_distance: d, mm, between the middles of neighbouring beads: the bead width, or a little less.

    Raises:
        ToolpathError: the distance is not above 0.
    """
    d = check_distance(min_distance)
    return tuple(
        spacing_of(Runs.of([divided(curve, d / SAMPLES)[0] for curve in layer.curves]), d)
        for layer in toolpath.layers
    )


def spacing_of(runs: Runs, min_distance: float) -> Spacing:
    """How close the curves of one layer come to one another, as they are sampled."""
    if not len(runs.points):
        return Spacing(0.0, 0.0, float("inf"))
    nearest = nearest_runs(runs, min_distance)[0]
    share = runs.share
    close = float(share[nearest < CLOSE * min_distance].sum())
    return Spacing(float(share.sum()), close, float(nearest.min()))


def nearest_runs(
    runs: Runs, reach: float, near: float | None = None
) -> tuple[Array, Array, Array, Indices, Indices]:
    """Spacing of each point, as far as `reach`, and on its left and on its right.

    Args:
        runs: the curves of a layer.
        reach: how far to look, mm.
        near: own places nearer than this along the curve do not count, mm; default (pi / 2) times the reach. Neither
            do those nearer along it than (pi / 2) times their distance, which are around a bend but not beside it.

    Returns:
        the distance of the nearest place; of the nearest on the left, and on the right, shape (n,), mm, infinite
        where there is none within reach; the points at the start of the segments that the latter two lie on, -1
        where there is none.
    """
    start, found = near_segments(runs.points, runs.following, reach)
    place, total = places(runs.points, runs.following, runs.starts)
    sides, segments = _nearest(
        runs.points, runs.previous, runs.following, runs.curve, runs.closed, place, total, start, found, reach,
        ALONG * reach if near is None else near,
    )  # fmt: skip
    return sides.min(axis=1), sides[:, 0], sides[:, 1], segments[:, 0], segments[:, 1]


@nb.njit(cache=True, nogil=True)
def places(points: Array, following: Indices, starts: Indices) -> tuple[Array, Array]:
    """How far along its curve each point lies, and the length of each curve."""
    place = np.zeros(len(points))
    total = np.zeros(len(starts) - 1)
    for c in range(len(starts) - 1):
        along = 0.0
        for i in range(starts[c], starts[c + 1]):
            place[i] = along
            j = following[i]
            along += np.sqrt((points[j, 0] - points[i, 0]) ** 2 + (points[j, 1] - points[i, 1]) ** 2)
        total[c] = along
    return place, total


@nb.njit(cache=True, nogil=True)
def near_segments(points: Array, following: Indices, reach: float) -> tuple[Indices, Indices]:
    """For every point the segments that may be within `reach`, given by their first points.

    Segments that start or end in the point are left out. All that are within reach are found, and few others: those
    whose middle is no further than reach and half their length.

    Returns:
        start, shape (n + 1,), and found: those of point i are found[start[i] : start[i + 1]].
    """
    n = len(points)
    middle = np.empty((n, 2))
    half = np.empty(n)
    longest = 0.0
    low_x, low_y = points[0, 0], points[0, 1]
    high_x, high_y = low_x, low_y
    for j in range(n):
        k = following[j]
        middle[j, 0] = 0.5 * (points[j, 0] + points[k, 0])
        middle[j, 1] = 0.5 * (points[j, 1] + points[k, 1])
        half[j] = 0.5 * np.sqrt((points[k, 0] - points[j, 0]) ** 2 + (points[k, 1] - points[j, 1]) ** 2)
        longest = max(longest, half[j])
        low_x, high_x = min(low_x, points[j, 0]), max(high_x, points[j, 0])
        low_y, high_y = min(low_y, points[j, 1]), max(high_y, points[j, 1])
    # Not many more cells than points, however far apart those are.
    cell = max(reach + longest, np.sqrt((high_x - low_x) * (high_y - low_y) / (16.0 * n + 64.0)))
    cell = max(cell, max(high_x - low_x, high_y - low_y) / (16.0 * n + 64.0), 1e-9)
    columns = int((high_x - low_x) / cell) + 1
    rows = int((high_y - low_y) / cell) + 1
    first = np.zeros(columns * rows + 1, np.int64)
    in_cell = np.empty(n, np.int64)
    for j in range(n):
        in_cell[j] = int((middle[j, 1] - low_y) / cell) * columns + int((middle[j, 0] - low_x) / cell)
        first[in_cell[j]] += 1
    for c in range(columns * rows):
        first[c + 1] += first[c]
    # Filed from the back, each cell's count running down to where the cell begins.
    filed = np.empty(n, np.int64)
    for j in range(n):
        first[in_cell[j]] -= 1
        filed[first[in_cell[j]]] = j
    start = np.zeros(n + 1, np.int64)
    found = np.empty(32 * n, np.int64)
    count = 0
    for i in range(n):
        x, y = points[i, 0], points[i, 1]
        column, row = int((x - low_x) / cell), int((y - low_y) / cell)
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            # The cells of a row are filed one after another.
            begin = first[r * columns + max(column - 1, 0)]
            end = first[r * columns + min(column + 1, columns - 1) + 1]
            if count + end - begin > len(found):
                larger = np.empty(2 * len(found) + end - begin, np.int64)
                for f in range(count):
                    larger[f] = found[f]
                found = larger
            for f in range(begin, end):
                j = filed[f]
                away = (x - middle[j, 0]) ** 2 + (y - middle[j, 1]) ** 2
                if away <= (reach + half[j]) ** 2 and j != i and following[j] != i:
                    found[count] = j
                    count += 1
        start[i + 1] = count
    return start, found[:count]


@nb.njit(cache=True, nogil=True)
def admissible(
    same: bool, closed: bool, at: float, total: float, begin: float, length: float, near: float
) -> tuple[float, float]:
    """The part of a segment that is at least `near` away along the curve, as shares from, to; from > to: none."""
    if not same:
        return 0.0, 1.0
    low, high = begin - at, begin - at + length
    if closed:
        if low < 0.0:
            low, high = low + total, high + total
        # The segment that ends where the curve begins may end a rounding beyond it.
        from_, to = max(low, near), min(high, total - near)
    elif low >= 0.0:
        from_, to = max(low, near), high
    else:
        from_, to = low, min(high, -near)
    if from_ > to:
        return 1.0, 0.0
    if length == 0.0:
        return 0.0, 1.0
    return (from_ - low) / length, (to - low) / length


@nb.njit(cache=True, nogil=True)
def closest_share(x: float, y: float, bx: float, by: float) -> float:
    """Where on the way from (0, 0) to (bx, by) the place nearest to (x, y) lies, from 0 to 1."""
    along = x * bx + y * by
    if along <= 0.0:
        return 0.0
    square = bx * bx + by * by
    return 1.0 if along >= square else along / square


@nb.njit(cache=True, nogil=True)
def _nearest(
    points: Array,
    previous: Indices,
    following: Indices,
    curve: Indices,
    closed: Flags,
    place: Array,
    total: Array,
    start: Indices,
    found: Indices,
    reach: float,
    near: float,
) -> tuple[Array, Indices]:
    n = len(points)
    nearest = np.full((n, 2), np.inf)
    segment = np.full((n, 2), -1, np.int64)
    for i in range(n):
        x, y = points[i, 0], points[i, 1]
        before, after = previous[i], following[i]
        tx, ty = points[after, 0] - points[before, 0], points[after, 1] - points[before, 1]
        c = curve[i]
        for f in range(start[i], start[i + 1]):
            j = found[f]
            k = following[j]
            bx, by = points[k, 0] - points[j, 0], points[k, 1] - points[j, 1]
            length = np.sqrt(bx * bx + by * by)
            low, high = admissible(curve[j] == c, closed[c], place[i], total[c], place[j], length, near)
            if low > high:
                continue
            t = min(max(closest_share(x - points[j, 0], y - points[j, 1], bx, by), low), high)
            px, py = points[j, 0] + t * bx - x, points[j, 1] + t * by - y
            away = np.sqrt(px * px + py * py)
            if curve[j] == c:
                along = abs(place[j] + t * length - place[i])
                along = min(along, total[c] - along) if closed[c] else along
                if along < ALONG * away:
                    continue
            side = 0 if tx * py - ty * px >= 0.0 else 1
            if away < reach and away < nearest[i, side]:
                nearest[i, side], segment[i, side] = away, j
    return nearest, segment
