"""Sampling: polygons become curves of nearly equal segments (seed paper, Section 2.2).

A curve of length L gets about L / L_R points, L_R the resolution. What holds everywhere:

- No segment is longer than L_R, and every curve has at least six.
- Corners (a turn of more than 30 deg) are points of the curve, but of corners closer than L_R / 4 only the
  sharpest need be.
- The curve is nowhere further from its polygon than L_R² / (8 R), the sagitta of an arc of radius R under a chord
  of L_R. R is the polygon's own radius of curvature: L_R over the absolute turning Θ in one L_R about the chord's
  middle. A vertex turns in equal parts along the halves of its two edges; corners that are kept do not count.
- Below 1e-3 L_R (10 µm for a bead of 10 mm) nothing is followed: coordinates of a scan or of a single-precision STL
  are no better, and where the polygon is straight, R is infinite.

For a loop shorter than 6 L_R, a sixth of its length stands for L_R.

A polygon is divided at its corners; each piece gets equal segments; where a vertex deviates more than the bound
says, it is kept too (the worst first) and its piece is divided anew. The layer is sampled finer where curves cross
or a hole leaves its outline, in the last resort down to the polygons themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numba as nb
import numpy as np
import numpy.typing as npt
import shapely

from .errors import ToolpathError
from .simplicity import are_apart, moved

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

CORNER: Final = float(np.radians(30.0))
"""Turning of a polygon from which a vertex is a corner, rad."""

MIN_POINTS: Final = 6

FLOOR: Final = 1e-3
"""Deviation that is always allowed, as a share of the resolution."""

_NOISE = 1e-5  # vertices this much of L_R apart are one: the direction of so short an edge is rounding
_MOST_POINTS = 10_000_000  # on one layer


@dataclass(frozen=True)
class DroppedLoop:
    """A polygon that encloses nothing that could be printed.

    Attributes:
        index: of the polygon in the layer.
        center: mean of its vertices, mm.
        length: of the polygon, mm.
        reason: why it was dropped.
    """

    index: int
    center: tuple[float, float]
    length: float
    reason: str

    def __str__(self) -> str:
        x, y = self.center
        return (
            f"loop {self.index} at ({x:.3f}, {y:.3f}), {self.length:.3g} mm long, was dropped: {self.reason}"
        )


def sample_layer(polygons: Sequence[Array], resolution: float) -> list[Array]:
    """Points along the closed polygons of one layer at distances of at most `resolution`.

    Args:
        polygons: each of shape (n, 2), mm; the first point is not repeated.
        resolution: L_R, mm.

    Returns:
        for each polygon that encloses an area, in order, points of shape (m, 2), m >= 6, that turn the same way.
        If no polygons cross or touch, no curves do, and each lies inside the curves whose polygons its own lies
        in. (Only where walls are closer than rounding is a polygon of 3 to 5 vertices returned as it is.)

    Raises:
        ToolpathError: the resolution is not above 0, or so fine that a layer would have over ten million points.
    """
    return sample_layer_reporting(polygons, resolution)[0]


def sample_layer_reporting(
    polygons: Sequence[Array], resolution: float
) -> tuple[list[Array], list[DroppedLoop]]:
    """`sample_layer`, and the polygons that it leaves out: those without three points, an area or an extent."""
    if not resolution > 0 or not np.isfinite(resolution):
        raise ToolpathError(f"the resolution must be above 0 mm, not {resolution}")
    loops: list[Array] = []
    dropped: list[DroppedLoop] = []
    length = 0.0
    for index, polygon in enumerate(polygons):
        loop = _without_repeats(np.ascontiguousarray(polygon, dtype=np.float64))
        around, area = _length_and_area(loop)
        if reason := _why_not(loop, around, area, resolution):
            x, y = polygon.mean(axis=0) if len(polygon) else (np.nan, np.nan)
            dropped.append(DroppedLoop(index, (float(x), float(y)), around, reason))
        else:
            loops.append(loop)
            length += around
    if length > _MOST_POINTS * resolution:
        raise ToolpathError(
            f"a layer has {length:.6g} mm of curves: a resolution of {resolution:.6g} mm would put more than "
            f"{_MOST_POINTS} points on it; choose a coarser one"
        )
    return (_sample(loops, resolution) if loops else []), dropped


def _why_not(loop: Array, length: float, area: float, resolution: float) -> str:
    if len(loop) < 3:
        return "it has fewer than 3 distinct points"
    if not float(np.ptp(loop, axis=0).max()) >= 1e-6 * resolution:
        return "it is smaller than a millionth of the resolution"
    if not abs(area) >= 1e-9 * length**2:
        return "it encloses no area"
    return ""


def _sample(loops: list[Array], resolution: float) -> list[Array]:
    for finer in (1, 2, 4, 8, 16, 32):
        sampled = [_divided(loop, resolution / finer) for loop in loops]
        if _keeps_order(loops, sampled, resolution / finer):
            return sampled
        if finer == 1 and not _are_simple(loops, resolution):
            return sampled  # what crosses or touches in the input may do so in the result
    sampled = [divide(loop, resolution, True) for loop in loops]
    # Walls closer than the rounding of a point between two vertices stay as they are.
    return sampled if _keeps_order(loops, sampled, resolution) else loops


def _keeps_order(loops: list[Array], sampled: list[Array], cell: float) -> bool:
    return _are_simple(sampled, cell) and (len(loops) == 1 or not moved(*_joined(loops), *_joined(sampled)))


def _divided(loop: Array, resolution: float) -> Array:
    """A loop sampled so that it turns the way it did: with all its vertices if nothing less keeps that."""
    points = divide(loop, resolution, False)
    length, area = _length_and_area(points)
    before = _length_and_area(loop)[1]
    if (area > 0) == (before > 0) and abs(area) >= 1e-9 * length**2:
        return points
    return np.asarray(divide(loop, resolution, True))


def _are_simple(loops: list[Array], cell: float) -> bool:
    if are_apart(*_joined(loops), cell):
        return True
    # Touching or nearly so: GEOS decides.
    return bool(shapely.MultiLineString([np.vstack([loop, loop[:1]]) for loop in loops]).is_simple)


def _joined(loops: list[Array]) -> tuple[Array, Indices]:
    return np.concatenate(loops), np.cumsum([0, *map(len, loops)])


@nb.njit(cache=True, nogil=True)
def _without_repeats(polygon: Array) -> Array:
    scale = 1.0
    for i in range(len(polygon)):
        scale = max(scale, abs(polygon[i, 0]), abs(polygon[i, 1]))
    kept = np.empty_like(polygon)
    n = 0
    for i in range(len(polygon)):
        if np.hypot(polygon[i, 0] - polygon[i - 1, 0], polygon[i, 1] - polygon[i - 1, 1]) > 1e-12 * scale:
            kept[n, 0], kept[n, 1] = polygon[i, 0], polygon[i, 1]
            n += 1
    return kept[:n]


@nb.njit(cache=True, nogil=True)
def _length_and_area(polygon: Array) -> tuple[float, float]:
    length, area = 0.0, 0.0
    for i in range(len(polygon)):
        x0, y0 = polygon[i - 1, 0] - polygon[0, 0], polygon[i - 1, 1] - polygon[0, 1]
        x1, y1 = polygon[i, 0] - polygon[0, 0], polygon[i, 1] - polygon[0, 1]
        length += np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2)
        area += 0.5 * (x0 * y1 - y0 * x1)
    return length, area


@nb.njit(cache=True, nogil=True)
def divide(polygon: Array, resolution: float, keep_all: bool) -> Array:
    """Points along one closed polygon of distinct points, shape (n, 2); see the head of this file.

    `keep_all` keeps every vertex and only divides the edges between them.
    """
    length, area = _length_and_area(polygon)
    step = min(resolution, length / MIN_POINTS)
    vertices = polygon
    if not keep_all:
        vertices = _thinned(polygon, _NOISE * step)
        if len(vertices) < 3 or (_length_and_area(vertices)[1] > 0) != (area > 0):
            vertices = polygon
        step = min(resolution, _length_and_area(vertices)[0] / MIN_POINTS)
    corner, bend = _corners(vertices, 0.25 * step)
    n = len(vertices)
    first = 0
    while first < n - 1 and not corner[first]:
        first += 1
    if not corner[first]:
        first = 0
    # From here on the polygon starts at a corner, if it has one, and repeats its first vertex at the end.
    around = np.empty((n + 1, 2))
    kept = np.empty(n + 1, np.bool_)
    turn = np.empty(n + 1)
    place = np.zeros(n + 1)
    for i in range(n + 1):
        at = (first + i) % n
        around[i, 0], around[i, 1] = vertices[at, 0], vertices[at, 1]
        kept[i] = corner[at]
        turn[i] = 0.0 if corner[at] else abs(bend[at])
        if i > 0:
            place[i] = place[i - 1] + np.hypot(
                around[i, 0] - around[i - 1, 0], around[i, 1] - around[i - 1, 1]
            )
    vertices = around
    # The turning from the start to each vertex and to the middle of each edge; in between it grows evenly.
    along = np.empty(2 * n + 1)
    turned = np.empty(2 * n + 1)
    along[0], turned[0] = 0.0, 0.0
    for i in range(n):
        along[2 * i + 1] = 0.5 * (place[i] + place[i + 1])
        along[2 * i + 2] = place[i + 1]
        turned[2 * i + 1] = turned[2 * i] + 0.5 * turn[i]
        turned[2 * i + 2] = turned[2 * i + 1] + 0.5 * turn[i + 1]

    waiting = np.empty((n + 1, 2), np.int64)
    pieces = np.empty((n, 3), np.int64)
    count, depth = 0, 0
    end = n
    for i in range(n - 1, -1, -1):
        if i == 0 or keep_all or kept[i]:
            waiting[depth, 0], waiting[depth, 1] = i, end
            depth += 1
            end = i
    total = 0
    while depth > 0:
        depth -= 1
        i, j = waiting[depth, 0], waiting[depth, 1]
        parts = max(1, int(np.ceil((place[j] - place[i]) / step - 1e-9)))
        worst, excess = _worst(vertices, place, along, turned, i, j, parts, step)
        if worst >= 0 and excess < 1.25 and parts > 1:
            # A smooth piece just above the bound: a little finer keeps its segments equal.
            closer = int(np.ceil(parts * np.sqrt(excess)))
            if _worst(vertices, place, along, turned, i, j, closer, step)[0] < 0:
                parts, worst = closer, -1
        if worst >= 0:
            waiting[depth, 0], waiting[depth, 1] = worst, j
            waiting[depth + 1, 0], waiting[depth + 1, 1] = i, worst
            depth += 2
        else:
            pieces[count, 0], pieces[count, 1], pieces[count, 2] = i, j, parts
            count += 1
            total += parts
    points = np.empty((total, 2))
    n = 0
    for piece in range(count):
        i, j, parts = pieces[piece, 0], pieces[piece, 1], pieces[piece, 2]
        at = i
        for k in range(parts):
            s = place[i] + k * (place[j] - place[i]) / parts
            while place[at + 1] <= s:
                at += 1
            points[n, 0], points[n, 1] = _point(vertices, place, at, s)
            n += 1
    return points


@nb.njit(cache=True, nogil=True)
def _worst(
    vertices: Array, place: Array, along: Array, turned: Array, i: int, j: int, parts: int, step: float
) -> tuple[int, float]:
    """The vertex between i and j furthest beyond the bound if the piece has `parts` chords, or -1; deviation/bound."""
    worst, excess = -1, 1.0
    at = i
    ax, ay = vertices[i, 0], vertices[i, 1]
    end = place[i]
    for k in range(parts):
        start = end
        end = place[i] + (k + 1) * (place[j] - place[i]) / parts
        first = at + 1
        if k == parts - 1:
            end = place[j]
            at = j - 1
            bx, by = vertices[j, 0], vertices[j, 1]
        else:
            while place[at + 1] <= end:
                at += 1
            bx, by = _point(vertices, place, at, end)
        if first <= at:
            middle = 0.5 * (start + end)
            theta = _turning(along, turned, middle + 0.5 * step) - _turning(
                along, turned, middle - 0.5 * step
            )
            allowed = max(step * theta / 8.0, FLOOR * step) - _NOISE * step
            dx, dy = bx - ax, by - ay
            square = dx * dx + dy * dy
            for v in range(first, at + 1):
                px, py = vertices[v, 0] - ax, vertices[v, 1] - ay
                share = 0.0 if square == 0.0 else min(1.0, max(0.0, (px * dx + py * dy) / square))
                far = np.sqrt((px - share * dx) ** 2 + (py - share * dy) ** 2)
                if far > excess * allowed:
                    worst, excess = v, far / allowed
        ax, ay = bx, by
    return worst, excess


@nb.njit(cache=True, nogil=True)
def _turning(along: Array, turned: Array, s: float) -> float:
    """Turning of a closed polygon from its start to place s, which may lie beyond either end."""
    rounds = np.floor(s / along[-1])
    s -= rounds * along[-1]
    k = min(int(np.searchsorted(along, s, side="right")), len(along) - 1) - 1
    share = (s - along[k]) / (along[k + 1] - along[k])
    return float(rounds * turned[-1] + turned[k] + share * (turned[k + 1] - turned[k]))


@nb.njit(cache=True, nogil=True)
def _point(vertices: Array, place: Array, edge: int, s: float) -> tuple[float, float]:
    share = (s - place[edge]) / (place[edge + 1] - place[edge])
    x = vertices[edge, 0] + share * (vertices[edge + 1, 0] - vertices[edge, 0])
    y = vertices[edge, 1] + share * (vertices[edge + 1, 1] - vertices[edge, 1])
    return x, y


@nb.njit(cache=True, nogil=True)
def _thinned(polygon: Array, distance: float) -> Array:
    """A polygon without the vertices closer than `distance` to the one kept before them."""
    kept = np.empty_like(polygon)
    kept[0, 0], kept[0, 1] = polygon[0, 0], polygon[0, 1]
    n = 1
    for i in range(1, len(polygon)):
        if np.hypot(polygon[i, 0] - kept[n - 1, 0], polygon[i, 1] - kept[n - 1, 1]) > distance:
            kept[n, 0], kept[n, 1] = polygon[i, 0], polygon[i, 1]
            n += 1
    if n > 1 and np.hypot(kept[n - 1, 0] - kept[0, 0], kept[n - 1, 1] - kept[0, 1]) <= distance:
        n -= 1
    return kept[:n]


@nb.njit(cache=True, nogil=True)
def _corners(polygon: Array, apart: float) -> tuple[npt.NDArray[np.bool_], Array]:
    """Which vertices are corners, and the turning at each vertex; of corners closer than `apart` the sharpest."""
    n = len(polygon)
    turn = np.empty(n)
    place = np.zeros(n + 1)
    for i in range(n):
        following = i + 1 if i + 1 < n else 0
        ax, ay = polygon[i, 0] - polygon[i - 1, 0], polygon[i, 1] - polygon[i - 1, 1]
        bx, by = polygon[following, 0] - polygon[i, 0], polygon[following, 1] - polygon[i, 1]
        turn[i] = np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
        place[i + 1] = place[i] + np.hypot(bx, by)
    kept = np.zeros(n, np.bool_)
    sharp = np.empty(n, np.int64)
    free = 0
    for i in range(n):
        if abs(turn[i]) > CORNER:
            sharp[free] = i
            free += 1
    while free > 0:
        sharpest = sharp[0]
        for k in range(1, free):
            if abs(turn[sharp[k]]) > abs(turn[sharpest]):
                sharpest = sharp[k]
        kept[sharpest] = True
        left = 0
        for k in range(free):
            gap = abs(place[sharp[k]] - place[sharpest])
            if min(gap, place[n] - gap) > apart:
                sharp[left] = sharp[k]
                left += 1
        free = left
    return kept, turn
