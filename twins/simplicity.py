"""Simplicity: whether curves keep apart from one another and inside one another.

An answer of yes is certain; where rounding leaves it open the answer is no, and shapely is asked.
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@nb.njit(cache=True, nogil=True)
def are_apart(points: Array, starts: Indices, cell: float) -> bool:
    """Whether closed polylines surely neither cross nor touch, themselves or one another; False: perhaps they do.

    Segments are compared within the cells of a hashed grid. Each comparison is exact: a sign within the rounding
    of its determinant (Shewchuk's first filter) counts as touching.
    """
    n = len(points)
    following = np.arange(1, n + 1)
    for loop in range(len(starts) - 1):
        following[starts[loop + 1] - 1] = starts[loop]
    buckets = 2 * n
    count = np.zeros(buckets + 1, np.int64)
    filed = np.empty(0, np.int64)
    for filling in (False, True):
        for i in range(n):
            j = following[i]
            x0 = np.floor(min(points[i, 0], points[j, 0]) / cell)
            x1 = np.floor(max(points[i, 0], points[j, 0]) / cell)
            y0 = np.floor(min(points[i, 1], points[j, 1]) / cell)
            y1 = np.floor(max(points[i, 1], points[j, 1]) / cell)
            if (x1 - x0 + 1) * (y1 - y0 + 1) > 1e6:
                return False
            for x in range(int(x0), int(x1) + 1):
                for y in range(int(y0), int(y1) + 1):
                    bucket = (x * 73856093 ^ y * 19349663) % buckets
                    if filling:
                        count[bucket] -= 1
                        filed[count[bucket]] = i
                    else:
                        count[bucket] += 1
        if not filling:
            count = np.cumsum(count)
            filed = np.empty(count[-1], np.int64)
    for bucket in range(buckets):
        for k in range(count[bucket], count[bucket + 1]):
            for m in range(k + 1, count[bucket + 1]):
                i, j = filed[k], filed[m]
                if i != j and _may_touch(points, i, following[i], j, following[j]):
                    return False
    return True


@nb.njit(cache=True, nogil=True)
def _may_touch(points: Array, a: int, b: int, c: int, d: int) -> bool:
    if b == c or d == a:
        if b != c:
            a, b, d = c, d, b
        # Neighbours share a point: they touch elsewhere only where the second runs back along the first.
        back = (points[a, 0] - points[b, 0]) * (points[d, 0] - points[b, 0])
        back += (points[a, 1] - points[b, 1]) * (points[d, 1] - points[b, 1])
        return back > 0.0 and _side(points, a, b, d) == 0
    for axis in range(2):
        if max(points[a, axis], points[b, axis]) < min(points[c, axis], points[d, axis]):
            return False
        if max(points[c, axis], points[d, axis]) < min(points[a, axis], points[b, axis]):
            return False
    if _side(points, a, b, c) * _side(points, a, b, d) > 0:
        return False
    return _side(points, c, d, a) * _side(points, c, d, b) <= 0


@nb.njit(cache=True, nogil=True)
def _side(points: Array, a: int, b: int, c: int) -> int:
    """1 where a, b, c turn left, -1 right, 0 within rounding."""
    left = (points[a, 0] - points[c, 0]) * (points[b, 1] - points[c, 1])
    right = (points[a, 1] - points[c, 1]) * (points[b, 0] - points[c, 0])
    if abs(left - right) <= 4e-16 * (abs(left) + abs(right)):
        return 0
    return 1 if left > right else -1


@nb.njit(cache=True, nogil=True)
def moved(polygons: Array, starts: Indices, points: Array, sampled: Indices) -> bool:
    """Whether any sampled curve lies inside another one that its polygon does not lie in, or the reverse."""
    loops = len(starts) - 1
    for i in range(loops):
        x, y = points[sampled[i], 0], points[sampled[i], 1]
        for j in range(loops):
            if i != j and _inside(polygons[starts[j] : starts[j + 1]], x, y) != _inside(
                points[sampled[j] : sampled[j + 1]], x, y
            ):
                return True
    return False


@nb.njit(cache=True, nogil=True)
def _inside(polygon: Array, x: float, y: float) -> bool:
    inside = False
    for i in range(len(polygon)):
        ax, ay, bx, by = polygon[i - 1, 0], polygon[i - 1, 1], polygon[i, 0], polygon[i, 1]
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            inside = not inside
    return inside
