"""Delaunay triangulation of the points of closed curves, exact, with every segment of a curve among its edges.

Points are inserted one by one along a Hilbert curve, in rounds of growing size; each carves out the triangles
whose circle holds it and fills the hole with a fan. All tests are exact on the integer lattice, so the result is a
Delaunay triangulation even of cocircular and collinear points, and depends on the points alone.

A segment of a curve ("native" edge) whose diametral circle holds another point is halved, by the same
insertion, until none is left (Gabriel's condition). Next to an acute corner the cut lies at a power of two from the
corner, so that the cuts on both sides of it end at the same distance and do not chase each other.

Beyond each hull edge lies a triangle whose third corner is -1.
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

from .predicates import in_circle, turn

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

OUTSIDE = -1
"""The corner of a triangle beyond a hull edge; always its last."""

FINE, COINCIDENT, TOO_CLOSE, FLAT, FULL = range(5)


@nb.njit(cache=True, nogil=True)
def _hilbert(x: int, y: int) -> int:
    """Place of a lattice point along a Hilbert curve of 2^15 x 2^15 cells over the lattice."""
    x, y = (x + (1 << 29)) >> 15, (y + (1 << 29)) >> 15
    place = 0
    side = 1 << 14
    while side > 0:
        right = 1 if (x & side) else 0
        up = 1 if (y & side) else 0
        place = place * 4 + ((3 * right) ^ up)
        if up == 0:
            if right:
                x, y = (2 * side - 1) - (x & (2 * side - 1)), (2 * side - 1) - (y & (2 * side - 1))
            x, y = y, x
        side >>= 1
    return place


@nb.njit(cache=True, nogil=True)
def _insertion_keys(P: Indices) -> Indices:
    """Ascending: few scattered points first, then more and more, each round along the Hilbert curve."""
    n = len(P)
    key = np.empty(n, np.int64)
    rounds = 0
    while (16 << (2 * rounds)) < n:
        rounds += 1
    for i in range(n):
        mixed = (P[i, 0] * 2654435761 + P[i, 1] * 40503) & 0x7FFFFFFFFFFF
        mixed = (mixed ^ (mixed >> 21)) * 2246822519 & 0x7FFFFFFFFFFF
        mixed = (mixed ^ (mixed >> 17)) & 0xFFFFF
        level = rounds
        while level > 0 and (mixed & 3) == 0:
            mixed >>= 2
            level -= 1
        key[i] = (level << 40) | _hilbert(P[i, 0], P[i, 1])
    return key


@nb.njit(cache=True, nogil=True)
def _dot(P: Indices, p: int, a: int, b: int) -> int:
    """Dot product of a - p and b - p."""
    return int((P[a, 0] - P[p, 0]) * (P[b, 0] - P[p, 0]) + (P[a, 1] - P[p, 1]) * (P[b, 1] - P[p, 1]))


@nb.njit(cache=True, nogil=True)
def _conflicts(P: Indices, tri: Indices, t: int, p: int) -> bool:
    """Whether the circle of a triangle holds p; of one beyond a hull edge, whether p lies beyond it or on it."""
    a, b, c = tri[t, 0], tri[t, 1], tri[t, 2]
    if c != OUTSIDE:
        return bool(in_circle(P, a, b, c, p) > 0)
    side = turn(P, a, b, p)
    if side != 0:
        return bool(side > 0)
    return _dot(P, p, a, b) < 0


@nb.njit(cache=True, nogil=True)
def _locate(P: Indices, tri: Indices, across: Indices, start: int, p: int) -> int:
    """A triangle that holds p, or one beyond the hull edge that p lies beyond."""
    t = start
    if tri[t, 2] == OUTSIDE:
        t = across[t, 2]
    came = -1
    while True:
        moved = False
        for k in range(3):
            u = across[t, k]
            if u == came:
                continue
            if turn(P, tri[t, (k + 1) % 3], tri[t, (k + 2) % 3], p) < 0:
                came, t = t, u
                moved = True
                break
        if not moved or tri[t, 2] == OUTSIDE:
            return t


@nb.njit(cache=True, nogil=True)
def _insert(
    P: Indices, p: int, tri: Indices, across: Indices, count: int, start: int,
    at: Indices, mark: Indices, cavity: Indices, rim: Indices, fan: Indices,
) -> tuple[int, int, int]:  # fmt: skip
    """Insert p. Returns the number of triangles, of fan triangles (in `fan`), and the equal point or -1.

    at[v] holds a triangle of v; `mark` is -1 for all triangles on entry and on return.
    """
    t = _locate(P, tri, across, start, p)
    for k in range(3):
        v = tri[t, k]
        if v >= 0 and P[v, 0] == P[p, 0] and P[v, 1] == P[p, 1]:
            return count, 0, v
    held = 1
    cavity[0] = t
    mark[t] = 0
    rims = 0
    done = 0
    while done < held:
        t = cavity[done]
        done += 1
        for k in range(3):
            u = across[t, k]
            if mark[u] == 0:
                continue
            if mark[u] != 1 and _conflicts(P, tri, u, p):
                mark[u] = 0
                cavity[held] = u
                held += 1
            else:
                rim[rims, 0], rim[rims, 1], rim[rims, 2] = tri[t, (k + 1) % 3], tri[t, (k + 2) % 3], u
                rims += 1
    for i in range(held):
        mark[cavity[i]] = -1
    for i in range(rims):
        t = cavity[i] if i < held else count + i - held
        fan[i] = t
        x, y, u = rim[i, 0], rim[i, 1], rim[i, 2]
        # `at` holds meanwhile the fan triangle that starts at a rim vertex; at[-1] is the one that starts outside.
        at[x] = t
        opposite = 2  # the corner opposite to the rim edge is p
        if x == OUTSIDE:
            tri[t, 0], tri[t, 1], tri[t, 2] = y, p, OUTSIDE
            opposite = 1
        elif y == OUTSIDE:
            tri[t, 0], tri[t, 1], tri[t, 2] = p, x, OUTSIDE
            opposite = 0
        else:
            tri[t, 0], tri[t, 1], tri[t, 2] = x, y, p
        across[t, opposite] = u
        for k in range(3):
            if tri[u, k] != x and tri[u, k] != y:
                across[u, k] = t
    for i in range(rims):
        t = fan[i]
        y = rim[i, 1]
        after = at[y]
        for k in range(3):
            if tri[t, k] == rim[i, 0]:
                across[t, k] = after
        for k in range(3):
            v = tri[after, k]
            if v != y and v != p:  # noqa: PLR1714 - a tuple would be built in the kernel
                across[after, k] = t
    at[p] = fan[0]
    return count + rims - held, rims, -1


@nb.njit(cache=True, nogil=True)
def _native_triangle(tri: Indices, across: Indices, at: Indices, a: int, b: int) -> int:
    """The triangle that has the edge a -> b, or -1."""
    first = at[a]
    t = first
    while True:
        k = 0
        while tri[t, k] != a:
            k += 1
        if tri[t, (k + 1) % 3] == b:
            return int(t)
        t = across[t, (k + 1) % 3]
        if t == first:
            return -1


@nb.njit(cache=True, nogil=True)
def _sees_at_right_angle_or_more(P: Indices, c: int, a: int, b: int) -> bool:
    if c < 0:
        return False
    return _dot(P, c, a, b) <= 0


@nb.njit(cache=True, nogil=True)
def _cut_share(P: Indices, a: int, b: int, acute_a: bool, acute_b: bool) -> float:
    """Where to cut a segment: in the middle, or at a power of two from its only acute end."""
    if acute_a == acute_b:
        return 0.5
    length = np.sqrt(float((P[b, 0] - P[a, 0]) ** 2 + (P[b, 1] - P[a, 1]) ** 2))
    share = 2.0 ** np.round(np.log2(0.5 * length)) / length
    return float(share if acute_a else 1.0 - share)


def conforming_delaunay(
    X: Array, following: Indices, origin: Array, unit: float, shortest: float
) -> tuple[int, int, Array, Indices, Indices, Indices, Indices, Indices]:
    """Triangulate the points of closed curves, halving segments until all are Gabriel edges.

    Args:
        X: shape (n, 2), mm.
        following: the next point on the curve, shape (n,); a point that follows itself belongs to none.
        origin, unit: of the lattice, mm.
        shortest: segments are not cut below this length, mm.

    Returns:
        a state and the point where it arose (FINE; COINCIDENT: a point lies on another; TOO_CLOSE: a segment would
        have to be cut below `shortest`; FLAT: all points on one line); then points (mm), points (lattice), following,
        triangles (m, 3) that turn left, the triangles across from their corners (m, 3), a triangle at each point.
    """
    P = np.round((X - origin) / unit).astype(np.int64)
    order = np.argsort(_insertion_keys(P), kind="stable")
    capacity = 2 * len(X) + 64
    while True:
        result = _conforming(X, P, order, following, origin, unit, shortest, capacity)
        if result[0] != FULL:
            return result
        capacity *= 2


@nb.njit(cache=True, nogil=True)
def _conforming(
    X: Array, given: Indices, order: Indices, following: Indices, origin: Array, unit: float, shortest: float,
    capacity: int,
) -> tuple[int, int, Array, Indices, Indices, Indices, Indices, Indices]:  # fmt: skip
    """See `conforming_delaunay`; FULL where there would be more points than `capacity`."""
    n = len(X)
    most = 64 * n + 4096
    places = np.empty((capacity, 2))
    P = np.empty((capacity, 2), np.int64)
    after = np.empty(capacity, np.int64)
    before = np.empty(capacity, np.int64)
    for i in range(n):
        for k in range(2):
            places[i, k] = X[i, k]
            P[i, k] = given[i, k]
        after[i] = following[i]
        before[following[i]] = i
    acute = np.zeros(capacity, np.bool_)
    for i in range(n):
        b, c = before[i], after[i]
        acute[i] = (P[b, 0] - P[i, 0]) * (P[c, 0] - P[i, 0]) + (P[b, 1] - P[i, 1]) * (P[c, 1] - P[i, 1]) > 0
    tri = np.empty((2 * capacity + 8, 3), np.int64)
    across = np.empty((2 * capacity + 8, 3), np.int64)
    mark = np.full(2 * capacity + 8, -1, np.int64)
    cavity = np.empty(2 * capacity + 8, np.int64)
    rim = np.empty((2 * capacity + 8, 3), np.int64)
    fan = np.empty(2 * capacity + 8, np.int64)
    at = np.full(capacity + 1, -1, np.int64)
    # The first triangle: the first two points, and the first one beside their line.
    second, third = 1, -1
    while second < n and P[order[second], 0] == P[order[0], 0] and P[order[second], 1] == P[order[0], 1]:
        second += 1
    for i in range(second + 1, n):
        if turn(P, order[0], order[second], order[i]) != 0:
            third = i
            break
    if third < 0:
        return FLAT, order[0], places[:n], P[:n], after[:n], tri[:0], across[:0], at[:n]
    if second > 1:
        return COINCIDENT, order[0], places[:n], P[:n], after[:n], tri[:0], across[:0], at[:n]
    a, b, c = order[0], order[1], order[third]
    if turn(P, a, b, c) < 0:
        b, c = c, b
    tri[0, 0], tri[0, 1], tri[0, 2] = a, b, c
    tri[1, 0], tri[1, 1], tri[1, 2] = c, b, OUTSIDE
    tri[2, 0], tri[2, 1], tri[2, 2] = a, c, OUTSIDE
    tri[3, 0], tri[3, 1], tri[3, 2] = b, a, OUTSIDE
    for k in range(3):
        across[0, k] = k + 1
        across[k + 1, 2] = 0
        across[k + 1, 0] = (k + 2) % 3 + 1
        across[k + 1, 1] = (k + 1) % 3 + 1
    at[a], at[b], at[c] = 0, 0, 0
    last = at[a]
    count = 4 + last  # 4, but no constant: each constant in a call would be compiled on its own
    for i in range(2, n):
        if i == third:
            continue
        p = order[i]
        count, rims, equal = _insert(P, p, tri, across, count, last, at, mark, cavity, rim, fan)
        if equal >= 0:
            return COINCIDENT, p, places[:n], P[:n], after[:n], tri[:0], across[:0], at[:n]
        last = at[p]
    # Segments that wait for their check; each is named by its first point.
    waiting = np.empty(capacity, np.int64)
    queued = np.zeros(capacity, np.bool_)
    top = 0
    for i in range(n - 1, -1, -1):
        waiting[top] = i
        queued[i] = True
        top += 1
    least = shortest / unit
    while top > 0:
        top -= 1
        a = waiting[top]
        queued[a] = False
        b = after[a]
        if b == a:
            continue
        t = _native_triangle(tri, across, at, a, b)
        if t >= 0:
            k = 0
            while tri[t, k] != a:
                k += 1
            left = tri[t, (k + 2) % 3]
            u = across[t, (k + 2) % 3]
            right = OUTSIDE
            for m in range(3):
                if tri[u, m] != a and tri[u, m] != b:
                    right = tri[u, m]
            if not _sees_at_right_angle_or_more(P, left, a, b) and not _sees_at_right_angle_or_more(
                P, right, a, b
            ):
                continue
        length = np.sqrt(float((P[b, 0] - P[a, 0]) ** 2 + (P[b, 1] - P[a, 1]) ** 2))
        if length < max(2.0 * least, 8.0) or n >= most:
            return TOO_CLOSE, a, places[:n], P[:n], after[:n], tri[:0], across[:0], at[:n]
        if n == capacity:
            return FULL, a, places[:n], P[:n], after[:n], tri[:0], across[:0], at[:n]
        share = _cut_share(P, a, b, acute[a], acute[b])
        for k in range(2):
            places[n, k] = places[a, k] + share * (places[b, k] - places[a, k])
            P[n, k] = int(np.round((places[n, k] - origin[k]) / unit))
        after[n], before[n] = b, a
        after[a], before[b] = n, n
        p = n
        n += 1
        count, rims, equal = _insert(P, p, tri, across, count, at[a], at, mark, cavity, rim, fan)
        if equal >= 0:
            return TOO_CLOSE, p, places[:n], P[:n], after[:n], tri[:0], across[:0], at[:n]
        # Whatever the new point may have come too near to, or cut off, starts or ends at the rim or at p.
        for i in range(-1, rims):
            v = p if i < 0 else rim[i, 0]
            if v < 0:
                continue
            for w in (v, before[v]):
                if not queued[w]:
                    queued[w] = True
                    waiting[top] = w
                    top += 1
    return (
        FINE, 0, places[:n].copy(), P[:n].copy(), after[:n].copy(),
        tri[:count].copy(), across[:count].copy(), at[:n].copy(),
    )  # fmt: skip
