"""Sampling: polygons become curves of nearly equal segments (seed paper, Section 2.2).

A curve of length L gets about L / L_R points. Corners of the polygon are kept: the curve is divided there, and
each piece is sampled by itself. A loop too short for its corners keeps at least six points, so that none is
dropped for being small.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import shapely

Array = npt.NDArray[np.float64]

CORNER = np.radians(30.0)
"""Turning of a polygon from which a vertex is a corner, rad."""

MIN_POINTS = 6


def sample_layer(polygons: Sequence[Array], resolution: float) -> list[Array]:
    """Points along the closed polygons of one layer at distances of about `resolution`.

    Where neighbours lie so close that coarse segments would cross, the whole layer is sampled finer.

    Args:
        polygons: each of shape (n, 2), mm; the first point is not repeated.
        resolution: L_R, mm.

    Returns:
        for each polygon that encloses an area, points of shape (m, 2), m >= 6, that turn the same way; together
        they do not cross unless the input does.
    """
    loops = [loop for polygon in polygons if (loop := _proper(polygon)) is not None]
    if not loops:
        return []
    crossing = not _are_simple(loops)
    for finer in (1, 2, 4, 8, 16, 32):
        sampled = [_sample(loop, resolution / finer) for loop in loops]
        turned = any((_area(a) > 0) != (_area(b) > 0) for a, b in zip(sampled, loops, strict=True))
        if not turned and (crossing or _are_simple(sampled)):
            return sampled
    return loops


def _proper(polygon: Array) -> Array | None:
    polygon = _without_repeats(polygon)
    if len(polygon) < 3:
        return None
    length = float(np.linalg.norm(np.roll(polygon, -1, axis=0) - polygon, axis=1).sum())
    return polygon if abs(_area(polygon)) >= 1e-9 * length**2 else None


def _are_simple(loops: Sequence[Array]) -> bool:
    return bool(shapely.MultiLineString([np.vstack([loop, loop[:1]]) for loop in loops]).is_simple)


def _sample(polygon: Array, resolution: float) -> Array:
    corners = _corners(polygon, resolution)
    if len(corners) == 0:
        corners = np.array([0])
    closed = np.vstack([polygon, polygon[:1]])
    place = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))]
    total = float(place[-1])
    start = place[corners]
    end = np.r_[start[1:], start[0] + total]
    step = min(resolution, total / MIN_POINTS)
    places = np.concatenate(
        [
            np.linspace(a, b, max(1, round((b - a) / step)), endpoint=False)
            for a, b in zip(start, end, strict=True)
        ]
    )
    if len(places) < MIN_POINTS:
        places = np.unique(np.r_[places, np.linspace(start[0], start[0] + total, MIN_POINTS, endpoint=False)])
    places = np.mod(places, total)
    return np.column_stack([np.interp(places, place, closed[:, k]) for k in range(2)])


def _corners(polygon: Array, resolution: float) -> npt.NDArray[np.int64]:
    """Vertices where the polygon turns by more than CORNER, ascending."""
    following = np.roll(polygon, -1, axis=0) - polygon
    size = np.linalg.norm(following, axis=1)
    before = np.roll(following, 1, axis=0)
    turn = np.arctan2(
        before[:, 0] * following[:, 1] - before[:, 1] * following[:, 0], (before * following).sum(axis=1)
    )
    sharp = np.flatnonzero(np.abs(turn) > CORNER)
    if len(sharp) < 2:
        return sharp
    # Of corners closer than a quarter segment only the sharpest stays: cut triangles can split one corner in two.
    place = np.r_[0.0, np.cumsum(size)[:-1]]
    total = float(size.sum())
    apart = min(0.25 * resolution, total / (4 * MIN_POINTS))
    kept: list[int] = []
    for i in sharp[np.argsort(-np.abs(turn[sharp]), kind="stable")]:
        gaps = [abs(place[i] - place[j]) for j in kept]
        if all(min(gap, total - gap) > apart for gap in gaps):
            kept.append(int(i))
    return np.sort(np.array(kept, dtype=np.int64))


def _without_repeats(polygon: Array) -> Array:
    scale = float(np.abs(polygon).max(initial=1.0))
    step = np.linalg.norm(polygon - np.roll(polygon, 1, axis=0), axis=1)
    return np.asarray(polygon[step > 1e-12 * scale], dtype=np.float64)


def _area(polygon: Array) -> float:
    x, y = (polygon - polygon[0]).T
    return float(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)))
