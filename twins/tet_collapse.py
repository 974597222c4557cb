"""Collapse: a point is moved onto a neighbour and vanishes, with the tetrahedra at their edge.

A point of a nozzle plane can only go along its plane. A point of the boundary can only go along an edge of the
boundary, over faces that are flat enough; what it strays there is added up from collapse to collapse.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from .tet_star import MOST, NONE, Indices, Mesh, shape, star, strays


@nb.njit(cache=True, nogil=True)
def collapse(
    M: Mesh, v: int, u: int, tets: Indices, held: int, good: float, longest: float, tolerance: float
) -> bool:
    """Move v onto u.

    Args:
        tets, held: the star of v.
        good: shape that is good enough; anything better than before is so as well.
        longest: edges must not become longer than this, unless they were, mm.
        tolerance: how far the boundary may stray, mm.
    """
    T, N, X, plane = M.T, M.N, M.X, M.plane
    if plane[v] >= 0 and plane[u] != plane[v]:
        return False
    if M.wall[v] and (not M.wall[u] or M.pinched[v] or M.pinched[u]):
        return False
    worst = np.inf
    for n in range(held):
        worst = min(worst, M.q[tets[n]])
    least = max(min(good, 1.02 * worst), 1e-9)
    bare = 0
    for n in range(held):
        t = tets[n]
        at_v, at_u = 0, NONE
        for k in range(4):
            if T[t, k] == v:
                at_v = k
            elif T[t, k] == u:
                at_u = k
        if at_u == NONE:
            a, b, c, d = T[t, 0], T[t, 1], T[t, 2], T[t, 3]
            a = u if at_v == 0 else a
            b = u if at_v == 1 else b
            c = u if at_v == 2 else c
            d = u if at_v == 3 else d
            if shape(X, a, b, c, d) <= least:
                return False
        else:
            if N[t, at_v] == NONE and N[t, at_u] == NONE:
                return False
            for k in range(4):
                bare += k != at_v and k != at_u and N[t, k] == NONE  # noqa: PLR1714 - a tuple would be built in the kernel
    limit = longest * longest
    for n in range(held):
        t = tets[n]
        for k in range(4):
            w = T[t, k]
            if w != v and w != u:  # noqa: PLR1714 - a tuple would be built in the kernel
                new = (X[w, 0] - X[u, 0]) ** 2 + (X[w, 1] - X[u, 1]) ** 2 + (X[w, 2] - X[u, 2]) ** 2
                if new > limit:
                    was = (X[w, 0] - X[v, 0]) ** 2 + (X[w, 1] - X[v, 1]) ** 2 + (X[w, 2] - X[v, 2]) ** 2
                    if new > was:
                        return False
    if M.wall[v]:
        if bare != 2:
            return False
        far = strays(M, v, u, X[v, 0], X[v, 1], X[v, 2], X[u, 0], X[u, 1], X[u, 2], tets, held)
        if far + M.strayed[v] > tolerance or not _may_pinch(M, v, u, tets, held):
            return False
        M.strayed[u] = max(M.strayed[u], far + M.strayed[v])
    _carry_out(M, v, u, tets, held)
    return True


@nb.njit(cache=True, nogil=True)
def _may_pinch(M: Mesh, v: int, u: int, tets: Indices, held: int) -> bool:
    """Whether the boundary stays a disc: points joined to both v and u lie around their edge (the link condition)."""
    T = M.T
    around = np.empty(MOST, np.int64)
    count = star(M, u, around)
    if count == 0:
        return False
    now = M.tops[1]
    for n in range(count):
        for k in range(4):
            M.seen[T[around[n], k]] = now
    M.tops[1] += 1
    after = M.tops[1]
    for n in range(held):  # points around the edge
        t = tets[n]
        joins = False
        for k in range(4):
            joins |= T[t, k] == u
        if joins:
            for k in range(4):
                M.seen[T[t, k]] = after
    for n in range(held):
        for k in range(4):
            if M.seen[T[tets[n], k]] == now and T[tets[n], k] != v:
                return False
    return True


@nb.njit(cache=True, nogil=True)
def _carry_out(M: Mesh, v: int, u: int, tets: Indices, held: int) -> None:
    T, N, X = M.T, M.N, M.X
    for n in range(held):
        t = tets[n]
        at_v, at_u = 0, NONE
        for k in range(4):
            if T[t, k] == v:
                at_v = k
            elif T[t, k] == u:
                at_u = k
        if at_u == NONE:
            continue
        one, two = N[t, at_v], N[t, at_u]
        for k in range(4):
            w = T[t, k]
            M.degree[w] -= 1
            if w != v:
                M.at[w] = NONE
        for r in range(2):
            here, there = (one, two) if r == 0 else (two, one)
            if here >= 0:
                for k in range(4):
                    if N[here, k] == t:
                        N[here, k] = there
        T[t, 0] = NONE
        M.q[t] = np.inf
        M.unused[M.tops[0]] = t
        M.tops[0] += 1
    for n in range(held):
        t = tets[n]
        if T[t, 0] == NONE:
            continue
        for k in range(4):
            if T[t, k] == v:
                T[t, k] = u
        M.q[t] = shape(X, T[t, 0], T[t, 1], T[t, 2], T[t, 3])
        M.settled[t] = False
        M.degree[u] += 1
        M.degree[v] -= 1
        for k in range(4):
            M.at[T[t, k]] = t
    M.at[v] = NONE


@nb.njit(cache=True, nogil=True)
def coarsen(M: Mesh, shortest: float, good: float, longest: float, tolerance: float) -> int:
    """Collapse edges shorter than `shortest`, the shortest of each point first; returns how many went."""
    X, T = M.X, M.T
    tets = np.empty(MOST, np.int64)
    near, length = np.empty(64, np.int64), np.empty(64)
    gone = 0
    for v in range(len(M.at)):
        if M.at[v] < 0 or (M.wall[v] and M.pinched[v]):
            continue
        held = star(M, v, tets)
        if held == 0:
            continue
        now = M.tops[1]
        M.seen[v] = now
        n = 0
        for i in range(held):
            for k in range(4):
                u = T[tets[i], k]
                if M.seen[u] == now:
                    continue
                M.seen[u] = now
                d = np.sqrt((X[u, 0] - X[v, 0]) ** 2 + (X[u, 1] - X[v, 1]) ** 2 + (X[u, 2] - X[v, 2]) ** 2)
                if d < shortest and n < len(near):
                    place = n
                    while place > 0 and length[place - 1] > d:
                        near[place], length[place] = near[place - 1], length[place - 1]
                        place -= 1
                    near[place], length[place] = u, d
                    n += 1
        for i in range(n):
            if collapse(M, v, near[i], tets, held, good, longest, tolerance):
                gone += 1
                break
    return gone


@nb.njit(cache=True, nogil=True)
def collapse_at(M: Mesh, t: int, longest: float, tolerance: float) -> bool:
    """The first collapse of an edge of t that betters it and its surroundings."""
    tets = np.empty(MOST, np.int64)
    for k in range(4):
        v = M.T[t, k]
        held = star(M, v, tets)
        if held == 0:
            continue
        for j in range(4):
            if j != k and collapse(M, v, M.T[t, j], tets, held, np.inf, longest, tolerance):
                return True
    return False
