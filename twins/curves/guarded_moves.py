"""Moves of single points of a layer that keep its curves on their permitted side, and apart.

A move takes point i from a to b, and with it the segments to its neighbours p and q, which sweep the triangles
(p, a, b) and (a, q, b). While moves are made one after the other and each is checked, these hold at any time:

- No place of a curve, on a segment or at a point, is on the locked side of the curve as it was given (its *rest*)
  by more than `DEPTH`.
- Segments that did not touch do not touch, and no curve has jumped over another.

Points are linked by `before` and `after` (see `smoothing_step.py`); the curves at rest by arrays of the same kind.
"""

from __future__ import annotations

from typing import Final

import numba as nb
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
Buckets = tuple[Indices, Indices, float]

DEPTH: Final = 2e-7
"""How far a point may be on the locked side, mm: well above rounding, well below anything that matters."""

GAP: Final = 1e-9
"""How close segments may come that did not touch, mm: so that the rounding of a point put between two is no matter."""


@nb.njit(cache=True, nogil=True)
def file_segments(points: Array, after: Indices, cell: float, skin: float) -> Buckets:
    """Segments in the hashed cells that they come within `skin` of: starts of the buckets, segments, cell size."""
    n = len(points)
    buckets = 2 * n + 1
    count = np.zeros(buckets + 1, np.int64)
    filed = np.empty(0, np.int64)
    for filling in (False, True):
        for i in range(n):
            j = after[i]
            if j < 0:
                continue
            x0 = int(np.floor((min(points[i, 0], points[j, 0]) - skin) / cell))
            x1 = int(np.floor((max(points[i, 0], points[j, 0]) + skin) / cell))
            y0 = int(np.floor((min(points[i, 1], points[j, 1]) - skin) / cell))
            y1 = int(np.floor((max(points[i, 1], points[j, 1]) + skin) / cell))
            for x in range(x0, x1 + 1):
                for y in range(y0, y1 + 1):
                    bucket = (x * 73856093 ^ y * 19349663) % buckets
                    if filling:
                        count[bucket] -= 1
                        filed[count[bucket]] = i
                    else:
                        count[bucket] += 1
        if not filling:
            count = np.cumsum(count)
            filed = np.empty(count[-1], np.int64)
    return count, filed, cell


@nb.njit(cache=True, nogil=True)
def _cells(
    low_x: float, low_y: float, high_x: float, high_y: float, cell: float
) -> tuple[int, int, int, int]:
    return (
        int(np.floor(low_x / cell)),
        int(np.floor(low_y / cell)),
        int(np.floor(high_x / cell)),
        int(np.floor(high_y / cell)),
    )


@nb.njit(cache=True, nogil=True)
def _cross(ox: float, oy: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Twice the area of the triangle o, a, b; positive where it turns left."""
    return (ax - ox) * (by - oy) - (ay - oy) * (bx - ox)


@nb.njit(cache=True, nogil=True)
def _project_to_side(
    x: float,
    y: float,
    reach: float,
    curve: int,
    side: int,
    rest: Array,
    rest_before: Indices,
    rest_after: Indices,
    owner: Indices,
    buckets: Buckets,
) -> tuple[float, float]:
    """A place, put back to the nearest one of its curve at rest if it is on the locked side by more than `DEPTH`.

    `reach` is a distance that it cannot be further than from the rest if it is there.
    """
    starts, filed, cell = buckets
    x0, y0, x1, y1 = _cells(x - reach, y - reach, x + reach, y + reach, cell)
    least, fx, fy = reach * reach, x, y
    locked = False
    for cx in range(x0, x1 + 1):
        for cy in range(y0, y1 + 1):
            bucket = (cx * 73856093 ^ cy * 19349663) % (len(starts) - 1)
            for m in range(starts[bucket], starts[bucket + 1]):
                i = filed[m]
                if owner[i] != curve:
                    continue
                j = rest_after[i]
                dx, dy = rest[j, 0] - rest[i, 0], rest[j, 1] - rest[i, 1]
                square = dx * dx + dy * dy
                t = 0.0
                if square > 0.0:
                    t = ((x - rest[i, 0]) * dx + (y - rest[i, 1]) * dy) / square
                t = min(1.0, max(0.0, t))
                px, py = rest[i, 0] + t * dx, rest[i, 1] + t * dy
                far = (x - px) ** 2 + (y - py) ** 2
                if far >= least:
                    continue
                least, fx, fy = far, px, py
                if 0.0 < t < 1.0:
                    locked = side * _cross(rest[i, 0], rest[i, 1], rest[j, 0], rest[j, 1], x, y) < 0.0
                    continue
                k = i if t == 0.0 else j
                h, j = rest_before[k], rest_after[k]
                if h < 0 or j < 0:
                    locked = False
                    continue
                turn = _cross(rest[h, 0], rest[h, 1], rest[k, 0], rest[k, 1], rest[j, 0], rest[j, 1])
                first = _cross(rest[h, 0], rest[h, 1], rest[k, 0], rest[k, 1], x, y) >= 0.0
                second = _cross(rest[k, 0], rest[k, 1], rest[j, 0], rest[j, 1], x, y) >= 0.0
                left = (first and second) if turn > 0.0 else (first or second)
                locked = left != (side > 0)
    if locked and least > DEPTH * DEPTH:
        return fx, fy
    return x, y


@nb.njit(cache=True, nogil=True)
def _takes_in(
    px: float, py: float, ax: float, ay: float, bx: float, by: float, cx: float, cy: float, sign: int
) -> bool:
    """Whether c was on the locked side of the segment p-a, or on it, and is now on the other side of p-b.

    `sign` is 1 where the left of the way from p is permitted. The triangle p, a, b is wider by `DEPTH` on all sides.
    """
    if sign * _cross(px, py, ax, ay, bx, by) >= 0.0:
        return False  # swept away from the locked side
    if sign * _cross(px, py, bx, by, cx, cy) <= DEPTH * np.hypot(bx - px, by - py):
        return False
    if sign * _cross(px, py, ax, ay, cx, cy) > DEPTH * np.hypot(ax - px, ay - py):
        return False
    inwards = 1.0 if _cross(ax, ay, bx, by, px, py) > 0.0 else -1.0
    return bool(inwards * _cross(ax, ay, bx, by, cx, cy) > -DEPTH * np.hypot(bx - ax, by - ay))


@nb.njit(cache=True, nogil=True)
def _keeps_side(
    p: Array,
    a: Array,
    b: Array,
    q: Array,
    curve: int,
    side: int,
    rest: Array,
    owner: Indices,
    buckets: Buckets,
) -> bool:
    """Whether no corner of the curve at rest comes to be in front of the segments p-b and b-q."""
    starts, filed, cell = buckets
    x0, y0, x1, y1 = _cells(
        min(p[0], a[0], b[0], q[0]) - DEPTH,
        min(p[1], a[1], b[1], q[1]) - DEPTH,
        max(p[0], a[0], b[0], q[0]) + DEPTH,
        max(p[1], a[1], b[1], q[1]) + DEPTH,
        cell,
    )
    for cx in range(x0, x1 + 1):
        for cy in range(y0, y1 + 1):
            bucket = (cx * 73856093 ^ cy * 19349663) % (len(starts) - 1)
            for m in range(starts[bucket], starts[bucket + 1]):
                i = filed[m]
                if owner[i] == curve and (
                    _takes_in(p[0], p[1], a[0], a[1], b[0], b[1], rest[i, 0], rest[i, 1], side)
                    or _takes_in(q[0], q[1], a[0], a[1], b[0], b[1], rest[i, 0], rest[i, 1], -side)
                ):
                    return False
    return True


@nb.njit(cache=True, nogil=True)
def _turn(o: Array, a: Array, b: Array, gap: float) -> int:
    """1 where o, a, b turn left, -1 right, 0 within rounding (Shewchuk's first filter) or `gap` of the line o-a."""
    left = (o[0] - b[0]) * (a[1] - b[1])
    right = (o[1] - b[1]) * (a[0] - b[0])
    rounding = 4e-16 * (abs(left) + abs(right))
    if abs(left - right) <= rounding + gap * np.hypot(a[0] - o[0], a[1] - o[1]):
        return 0
    return 1 if left > right else -1


@nb.njit(cache=True, nogil=True)
def _may_touch(a: Array, b: Array, c: Array, d: Array, shared: bool, gap: float) -> bool:
    """Whether segments a-b and c-d perhaps touch; with `shared` b and c are one point, where they may."""
    if shared:
        back = (a[0] - b[0]) * (d[0] - b[0]) + (a[1] - b[1]) * (d[1] - b[1])
        return back > 0.0 and _turn(a, b, d, gap) == 0
    for k in range(2):
        if max(a[k], b[k]) + gap < min(c[k], d[k]) or max(c[k], d[k]) + gap < min(a[k], b[k]):
            return False
    if _turn(a, b, c, gap) * _turn(a, b, d, gap) > 0:
        return False
    return _turn(c, d, a, gap) * _turn(c, d, b, gap) <= 0


@nb.njit(cache=True, nogil=True)
def _within(c: Array, p: Array, a: Array, b: Array) -> bool:
    first, second, third = _turn(p, a, c, 0.0), _turn(a, b, c, 0.0), _turn(b, p, c, 0.0)
    return first != 0 and first == second and second == third


@nb.njit(cache=True, nogil=True)
def _keeps_apart(
    points: Array, before: Indices, after: Indices, i: int, b: Array, removing: bool, buckets: Buckets
) -> bool:
    """Whether moving point i to b lets no segments touch that did not, and jumps over no point.

    With `removing` b is the place of the point before i, and only the segment from there to the one after i is new.
    """
    h, j = before[i], after[i]
    p, a, q = points[h], points[i], points[j]
    starts, filed, cell = buckets
    x0, y0, x1, y1 = _cells(
        min(p[0], a[0], b[0], q[0]),
        min(p[1], a[1], b[1], q[1]),
        max(p[0], a[0], b[0], q[0]),
        max(p[1], a[1], b[1], q[1]),
        cell,
    )
    if not removing and _may_touch(p, b, b, q, True, GAP) and not _may_touch(p, a, a, q, True, 0.0):
        return False
    for cx in range(x0, x1 + 1):
        for cy in range(y0, y1 + 1):
            bucket = (cx * 73856093 ^ cy * 19349663) % (len(starts) - 1)
            for m in range(starts[bucket], starts[bucket + 1]):
                c = filed[m]
                d = after[c]
                if d < 0 or i in (c, d):
                    continue
                s, e = points[c], points[d]
                if c not in (h, j) and (_within(s, p, a, b) or _within(s, a, q, b)):
                    return False
                if d == h:
                    new = not removing and _may_touch(s, e, p, b, True, GAP)
                    old = new and _may_touch(s, e, p, a, True, 0.0)
                else:
                    new = not removing and _may_touch(p, b, s, e, False, GAP)
                    old = new and _may_touch(p, a, s, e, False, 0.0)
                if new and not old:
                    return False
                if c == j:
                    new = _may_touch(b, q, s, e, True, GAP)
                    old = new and _may_touch(a, q, s, e, True, 0.0)
                elif removing and d == h:
                    new = _may_touch(s, e, p, q, True, GAP)
                    old = new and _may_touch(s, e, p, a, True, 0.0)
                else:
                    new = _may_touch(b, q, s, e, False, GAP)
                    old = new and (
                        _may_touch(a, q, s, e, False, 0.0)
                        or (removing and _may_touch(p, a, s, e, False, 0.0))
                    )
                if new and not old:
                    return False
    return True


@nb.njit(cache=True, nogil=True)
def try_move(
    points: Array,
    before: Indices,
    after: Indices,
    i: int,
    x: float,
    y: float,
    side: int,
    rest: tuple[Array, Indices, Indices],
    owner: Indices,
    at_rest: Buckets,
    present: Buckets,
) -> int:
    """Move point i towards (x, y) as far as both conditions allow: 0 not at all, 1 a part of the way, 2 there.

    Args:
        rest: points, `before` and `after` of the curves as they were given.
        owner: the curve of each point.
        at_rest, present: segments of `rest` and of the points as they are, filed.
    """
    a = points[i].copy()
    b = np.empty(2)
    for trial in range(3):
        b[0], b[1] = a[0] + 0.25**trial * (x - a[0]), a[1] + 0.25**trial * (y - a[1])
        done = 2 if trial == 0 else 1
        if side != 0:
            p, q = points[before[i]], points[after[i]]
            if side * _cross(p[0], p[1], a[0], a[1], b[0], b[1]) < 0.0 or (
                side * _cross(a[0], a[1], q[0], q[1], b[0], b[1]) < 0.0
            ):
                reach = np.hypot(b[0] - a[0], b[1] - a[1]) + 2.0 * DEPTH
                bx, by = _project_to_side(
                    b[0], b[1], reach, owner[i], side, rest[0], rest[1], rest[2], owner, at_rest
                )
                if bx != b[0] or by != b[1]:
                    b[0], b[1] = bx, by
                    done = 1
                if not _keeps_side(p, a, b, q, owner[i], side, rest[0], owner, at_rest):
                    continue
        if _keeps_apart(points, before, after, i, b, False, present):
            points[i] = b
            return done
    return 0


@nb.njit(cache=True, nogil=True)
def try_removal(
    points: Array,
    before: Indices,
    after: Indices,
    i: int,
    side: int,
    rest: tuple[Array, Indices, Indices],
    owner: Indices,
    at_rest: Buckets,
    present: Buckets,
) -> bool:
    """Take point i out of its curve if both conditions allow; arguments as `try_move`."""
    h, j = before[i], after[i]
    p, q = points[h], points[j]
    if side != 0 and not _keeps_side(p, points[i], p, q, owner[i], side, rest[0], owner, at_rest):
        return False
    if not _keeps_apart(points, before, after, i, p, True, present):
        return False
    after[h], before[j] = j, h
    before[i], after[i] = -2, -2
    return True
