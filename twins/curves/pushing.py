"""Steps of overfill optimisation, in loops over the points of a layer (seed paper, Section 4.2, equation 4)."""

from __future__ import annotations

from typing import Final

import numba as nb
import numpy as np
import numpy.typing as npt

from .close_points import SAMPLES, admissible, closest_share, near_segments, places
from .fairing import fair

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_SKIN: Final = (
    0.25  # share of d_min by which lists of pairs reach further than needed, to be used for several steps
)
_STILL: Final = 1e-5  # share of d_min per step below which a point stays exactly where it is
_SLIDE: Final = 0.25  # share of the way to the middle between its neighbours that a point slides in a step
_LONGEST: Final = 0.45  # share of d_min that a point may move in a step
_HELD: Final = 0.5  # share of its distance from a segment by which a point may approach it in a step
_FLOOR: Final = 0.02  # share of d_min below which points and segments do not come nearer to one another
_TRIES: Final = 20  # rounds of shortening before points stay


@nb.njit(cache=True, nogil=True)
def pushed_apart(
    begun: Array,
    origin: Array,
    previous: Indices,
    following: Indices,
    curve: Indices,
    starts: Indices,
    closed: Flags,
    free: Flags,
    d: float,
    near: float,
    strength: float,
    steps: int,
    fairing: float,
    leash: Array,
    to_points: bool,
) -> tuple[Array, int, int]:
    """Points after at most `steps` steps; how many were taken; how many points the last one held back.

    They begin where they are in `begun`; how far they have gone is measured from `origin`. `to_points` is for `pushes`.
    """
    n = len(begun)
    points, listed = begun.copy(), begun.copy()
    skin = _SKIN * d
    start, found = near_segments(points, following, d + skin)
    taken, held = 0, 0
    while taken < steps:
        furthest = 0.0
        for i in range(n):
            furthest = max(furthest, (points[i, 0] - listed[i, 0]) ** 2 + (points[i, 1] - listed[i, 1]) ** 2)
        if furthest > 0.25 * skin * skin:
            for i in range(n):
                listed[i, 0], listed[i, 1] = points[i, 0], points[i, 1]
            start, found = near_segments(points, following, d + skin)
        place, total = places(points, following, starts)
        step, away = pushes(
            points, following, curve, closed, place, total, start, found, d, near, strength, to_points
        )
        # Less and less of it, so that the last steps only part what is still too close.
        share = fairing * max(0.0, 1.0 - 1.5 * taken / steps)
        fair(step, points, origin, previous, following, starts, free, share, d / SAMPLES)
        if not _settled(step, points, origin, previous, following, free, d, leash):
            break
        held = _hold_back(step, points, following, start, found, away, d)
        for i in range(n):
            points[i, 0] += step[i, 0]
            points[i, 1] += step[i, 1]
        taken += 1
    return points, taken, held


@nb.njit(cache=True, nogil=True)
def pushes(
    points: Array,
    following: Indices,
    curve: Indices,
    closed: Flags,
    place: Array,
    total: Array,
    start: Indices,
    found: Indices,
    d: float,
    near: float,
    strength: float,
    to_points: bool,
) -> tuple[Array, Array]:
    """Equation 4 for each point, shape (n, 2); and the square of each pair's distance, shape (pairs,)."""
    push = np.zeros_like(points)
    away = np.empty(len(found))
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        c = curve[i]
        gx, gy, count = 0.0, 0.0, 0
        for f in range(start[i], start[i + 1]):
            j = found[f]
            k = following[j]
            ax, ay = points[j, 0], points[j, 1]
            bx, by = points[k, 0] - ax, points[k, 1] - ay
            rx, ry = x - ax, y - ay
            t = closest_share(rx, ry, bx, by)
            away[f] = (rx - t * bx) ** 2 + (ry - t * by) ** 2
            if away[f] >= d * d:
                continue
            square = away[f]
            if to_points or curve[j] == c:
                length = 0.0 if to_points else np.sqrt(bx * bx + by * by)
                low, high = admissible(curve[j] == c, closed[c], place[i], total[c], place[j], length, near)
                if low > high:
                    continue
                t = 0.0 if to_points else min(max(t, low), high)
                square = (rx - t * bx) ** 2 + (ry - t * by) ** 2
            if 0.0 < square < d * d:
                missing = d / np.sqrt(square) - 1.0
                gx += missing * (rx - t * bx)
                gy += missing * (ry - t * by)
                count += 1
        if count > 0:
            push[i, 0], push[i, 1] = strength * gx / count, strength * gy / count
    return push, away


@nb.njit(cache=True, nogil=True)
def _settled(
    step: Array,
    points: Array,
    origin: Array,
    previous: Indices,
    following: Indices,
    free: Flags,
    d: float,
    leash: Array,
) -> bool:
    """Displacements that slide points towards equal segments as well and keep them on the leash; False: all are 0."""
    moves = False
    for i in range(len(step)):
        if step[i, 0] ** 2 + step[i, 1] ** 2 < (_STILL * d) ** 2:
            step[i, 0], step[i, 1] = 0.0, 0.0
            continue
        p, f = previous[i], following[i]
        tx, ty = points[f, 0] - points[p, 0], points[f, 1] - points[p, 1]
        square = tx * tx + ty * ty
        # Beside a point that stays a curve may have to step aside at once: there equal segments would fold it.
        if i not in (p, f) and free[p] and free[f] and square > 0.0:
            mx = 0.5 * (points[p, 0] + points[f, 0]) - points[i, 0]
            my = 0.5 * (points[p, 1] + points[f, 1]) - points[i, 1]
            along = _SLIDE * (mx * tx + my * ty) / square
            step[i, 0] += along * tx
            step[i, 1] += along * ty
        x, y = points[i, 0] + step[i, 0] - origin[i, 0], points[i, 1] + step[i, 1] - origin[i, 1]
        gone = np.sqrt(x * x + y * y)
        if gone > leash[i]:
            step[i, 0] = origin[i, 0] + leash[i] / gone * x - points[i, 0]
            step[i, 1] = origin[i, 1] + leash[i] / gone * y - points[i, 1]
        # Pairs that are not listed are further apart than d: with steps of less than half of that they cannot meet.
        way = np.sqrt(step[i, 0] ** 2 + step[i, 1] ** 2)
        if way > _LONGEST * d:
            step[i, 0] *= _LONGEST * d / way
            step[i, 1] *= _LONGEST * d / way
        moves = moves or step[i, 0] ** 2 + step[i, 1] ** 2 >= (_STILL * d) ** 2
    return moves


@nb.njit(cache=True, nogil=True)
def _hold_back(
    step: Array, points: Array, following: Indices, start: Indices, found: Indices, away: Array, d: float
) -> int:
    """Shorten displacements until no point can reach a segment, or come all too near; the number of points held back.

    All move evenly along their displacements, so a point's way as seen from a segment is at most the larger of those
    seen from its two ends: while that is less than their distance they do not meet.
    """
    largest = 0.0
    for i in range(len(step)):
        largest = max(largest, np.sqrt(step[i, 0] ** 2 + step[i, 1] ** 2))
    safe = (2.0 * largest / _HELD) ** 2
    floor = (_FLOOR * d) ** 2
    is_held = np.zeros(len(step), np.bool_)
    kept = np.ones(len(step))
    tries = 0
    shortened = True
    while shortened:
        shortened = False
        tries += 1
        for i in range(len(step)):
            for f in range(start[i], start[i + 1]):
                if away[f] >= safe:
                    continue
                j = found[f]
                k = following[j]
                way = max(
                    np.sqrt((step[i, 0] - step[j, 0]) ** 2 + (step[i, 1] - step[j, 1]) ** 2),
                    np.sqrt((step[i, 0] - step[k, 0]) ** 2 + (step[i, 1] - step[k, 1]) ** 2),
                )
                if way == 0.0:
                    continue
                share = 1.0
                if way > _HELD * np.sqrt(away[f]):
                    share = 0.99 * _HELD * np.sqrt(away[f]) / way
                if away[f] < floor / (1.0 - _HELD) ** 2:
                    # Step after step by a share of what is left would end in the rounding.
                    ax, ay = points[j, 0] + step[j, 0], points[j, 1] + step[j, 1]
                    bx, by = points[k, 0] + step[k, 0] - ax, points[k, 1] + step[k, 1] - ay
                    rx, ry = points[i, 0] + step[i, 0] - ax, points[i, 1] + step[i, 1] - ay
                    t = closest_share(rx, ry, bx, by)
                    if (rx - t * bx) ** 2 + (ry - t * by) ** 2 < min(away[f], floor):
                        share = min(share, 0.5)
                if share < 1.0:
                    # If shortening here makes too much of a way there, again and again, those points stay.
                    share = share if tries < _TRIES else 0.0
                    for m in (i, j, k):
                        kept[m] = min(kept[m], share)
                    shortened = True
        # All at once, so that what moves alike goes on doing so.
        for i in range(len(step)):
            if kept[i] < 1.0:
                step[i, 0] *= kept[i]
                step[i, 1] *= kept[i]
                is_held[i] = True
                kept[i] = 1.0
    count = 0
    for i in range(len(step)):
        count += is_held[i]
    return count
