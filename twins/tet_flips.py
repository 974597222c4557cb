"""Flips: the same points joined otherwise.

An edge is removed by joining the ring of points around it to triangles, and these to the edge's two ends; of all ways
to do so the one whose worst tetrahedron is best is found by dynamic programming (Shewchuk, "Two discrete optimization
algorithms for the topological improvement of tetrahedral meshes", 2002). An edge in a nozzle plane has a ring of two
halves, one above the plane and one below, joined by the other diagonal. An edge of the boundary has an open ring:
where its two faces lie in one plane, the other diagonal closes it. The inverse is the swap of a face between two
tetrahedra for an edge between three.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from .tet_star import MOST, NONE, RING, Array, Indices, Mesh, replace, ring, shape, star, third

GAIN = 1.02
"""A flip must improve the worst tetrahedron by this factor."""


@nb.njit(cache=True, nogil=True)
def _best_triangles(
    X: Array, a: int, b: int, p: Indices, n: int, least: float, best: Array, cut: Indices
) -> bool:
    """Whether the polygon p[:n] around the edge a b can be filled better than `least`; `cut` tells how."""
    for i in range(n - 1):
        best[i, i + 1] = np.inf
    for width in range(2, n):
        for i in range(n - width):
            j = i + width
            top, at = least, NONE
            for k in range(i + 1, j):
                worst = min(best[i, k], best[k, j])
                if worst <= top:
                    continue
                worst = min(worst, shape(X, p[i], p[k], p[j], b))
                if worst <= top:
                    continue
                worst = min(worst, shape(X, p[i], p[j], p[k], a))
                if worst > top:
                    top, at = worst, k
            best[i, j] = top if at >= 0 else -np.inf
            cut[i, j] = at
    return bool(best[0, n - 1] > least)


@nb.njit(cache=True, nogil=True)
def _add_triangles(
    a: int, b: int, p: Indices, n: int, cut: Indices, layer: int, new: Indices, layers: Indices, m: int
) -> int:
    stack = np.empty((RING + 2, 2), np.int64)
    stack[0, 0], stack[0, 1] = 0, n - 1
    top = 1
    while top:
        top -= 1
        i, j = stack[top, 0], stack[top, 1]
        if j - i < 2:
            continue
        k = cut[i, j]
        new[m, 0], new[m, 1], new[m, 2], new[m, 3] = p[i], p[k], p[j], b
        new[m + 1, 0], new[m + 1, 1], new[m + 1, 2], new[m + 1, 3] = p[i], p[j], p[k], a
        layers[m] = layers[m + 1] = layer
        m += 2
        stack[top, 0], stack[top, 1] = i, k
        stack[top + 1, 0], stack[top + 1, 1] = k, j
        top += 2
    return m


@nb.njit(cache=True, nogil=True)
def _put_normal(X: Array, p: int, q: int, r: int, n: Array) -> None:
    ux, uy, uz = X[q, 0] - X[p, 0], X[q, 1] - X[p, 1], X[q, 2] - X[p, 2]
    vx, vy, vz = X[r, 0] - X[p, 0], X[r, 1] - X[p, 1], X[r, 2] - X[p, 2]
    n[0], n[1], n[2] = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@nb.njit(cache=True, nogil=True)
def _lies_flat(X: Array, a: int, b: int, c: int, d: int, tolerance: float) -> bool:
    """Whether edges a b and c d are the diagonals of a quadrilateral that is flat to within the tolerance."""
    n = np.empty((4, 3))
    _put_normal(X, a, b, d, n[0])
    _put_normal(X, a, c, b, n[1])
    _put_normal(X, a, c, d, n[2])
    _put_normal(X, b, d, c, n[3])
    for f in range(2):
        for g in range(2, 4):
            dot = n[f, 0] * n[g, 0] + n[f, 1] * n[g, 1] + n[f, 2] * n[g, 2]
            size = (n[f, 0] ** 2 + n[f, 1] ** 2 + n[f, 2] ** 2) * (n[g, 0] ** 2 + n[g, 1] ** 2 + n[g, 2] ** 2)
            if dot <= 0.0 or dot * dot < 0.5 * size:
                return False
    ux, uy, uz = X[b, 0] - X[a, 0], X[b, 1] - X[a, 1], X[b, 2] - X[a, 2]
    vx, vy, vz = X[d, 0] - X[c, 0], X[d, 1] - X[c, 1], X[d, 2] - X[c, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    height = (X[c, 0] - X[a, 0]) * nx + (X[c, 1] - X[a, 1]) * ny + (X[c, 2] - X[a, 2]) * nz
    return bool(abs(height) <= tolerance * np.sqrt(nx * nx + ny * ny + nz * nz))


@nb.njit(cache=True, nogil=True)
def _around_edge(
    M: Mesh, t: int, i: int, j: int, tolerance: float,
    old: Indices, points: Indices, new: Indices, layers: Indices,
) -> tuple[int, int]:  # fmt: skip
    """Find better tetrahedra without the edge between corners i and j of t.

    Returns:
        how many there are in `old`, 0 if it cannot be bettered, and how many in `new`.
    """
    T, X, plane = M.T, M.X, M.plane
    held, closed = ring(M, t, i, j, old, points)
    if held == 0:
        return 0, 0
    a, b = T[t, i], T[t, j]
    worst = np.inf
    for k in range(held):
        worst = min(worst, M.q[old[k]])
    least = GAIN * max(worst, 1e-12)
    in_plane = plane[a] >= 0 and plane[a] == plane[b]
    around = held if closed else held + 1
    one = two = NONE
    if closed and in_plane:
        for k in range(held):
            if plane[points[k]] == plane[a]:
                if one < 0:
                    one = k
                elif two < 0:
                    two = k
                else:
                    return 0, 0
        if two < 0 or two - one < 2 or held - two + one < 2:
            return 0, 0
    elif closed:
        if held < 3:
            return 0, 0
    else:
        c, d = points[0], points[held]
        for k in range(held + 1):
            if in_plane and (plane[points[k]] == plane[a]) != (k == 0 or k == held):  # noqa: PLR1714
                return 0, 0
        if M.pinched[a] or M.pinched[b] or M.pinched[c] or M.pinched[d]:
            return 0, 0
        if not _lies_flat(X, a, b, c, d, tolerance):
            return 0, 0
        if held == 1:
            peels = worst < 0.1 and _may_peel(M, t, i, j, old, points)
            old[0] = t
            return (1 if peels else 0), 0
    polygon = np.empty(RING + 1, np.int64)
    best, cut = np.empty((RING + 1, RING + 1)), np.empty((RING + 1, RING + 1), np.int64)
    m = int(np.int64(0))  # no constant: see tet_star.py
    for half in range(1 if two < 0 else 2):
        start, n = 0, around
        if two >= 0:
            start, n = (one, two - one + 1) if half == 0 else (two, held - two + one + 1)
        for k in range(n):
            at = start + k
            polygon[k] = points[at - around if at >= around else at]
        if not _best_triangles(X, a, b, polygon, n, least, best, cut):
            return 0, 0
        m = _add_triangles(a, b, polygon, n, cut, M.layer[old[start]], new, layers, m)
    if not closed and _joined(M, points[0], points[held]):
        return 0, 0
    return held, int(m)


@nb.njit(cache=True, nogil=True)
def _joined(M: Mesh, c: int, d: int) -> bool:
    """Whether two points share a tetrahedron, or too many meet to tell."""
    out = np.empty(MOST, np.int64)
    held = star(M, c, out)
    for k in range(held):
        for corner in range(4):
            if M.T[out[k], corner] == d:
                return True
    return held == 0


@nb.njit(cache=True, nogil=True)
def _may_peel(M: Mesh, t: int, i: int, j: int, tets: Indices, points: Indices) -> bool:
    """Whether a tetrahedron that lies flat on the boundary with two faces can be taken away."""
    if M.N[t, i] < 0 or M.N[t, j] < 0:
        return False
    c, d = third(i, j)
    held, closed = ring(M, t, c, d, tets, points)
    return held > 0 and closed


@nb.njit(cache=True, nogil=True)
def _across_face(M: Mesh, t: int, k: int, old: Indices, new: Indices, layers: Indices) -> bool:
    """Find three tetrahedra around a new edge, better than t and its neighbour across face k."""
    T, X, plane = M.T, M.X, M.plane
    u = M.N[t, k]
    if u < 0 or M.layer[u] != M.layer[t]:
        return False
    a, b, c = T[t, (k + 1) & 3], T[t, (k + 2) & 3], T[t, (k + 3) & 3]
    if k & 1 == 0:  # so that (a, b, c, d) is positive
        b, c = c, b
    d = T[t, k]
    e = T[u, 0] + T[u, 1] + T[u, 2] + T[u, 3] - a - b - c
    if plane[d] >= 0 and plane[d] == plane[e]:
        return False
    least = GAIN * max(min(M.q[t], M.q[u]), 1e-12)
    for n in range(3):
        if shape(X, e, d, a, b) <= least:
            return False
        new[n, 0], new[n, 1], new[n, 2], new[n, 3] = e, d, a, b
        layers[n] = M.layer[t]
        a, b, c = b, c, a
    old[0], old[1] = t, u
    return True


@nb.njit(cache=True, nogil=True)
def flip_at(M: Mesh, t: int, tolerance: float) -> bool:
    """The first flip that betters a tetrahedron and its surroundings."""
    old, points = np.empty(RING, np.int64), np.empty(RING + 1, np.int64)
    new, layers = np.empty((4 * RING, 4), np.int64), np.empty(4 * RING, np.int64)
    two, three = int(np.int64(2)), int(np.int64(3))  # no constants: see tet_star.py
    for i in range(4):
        for j in range(i + 1, 4):
            k, m = _around_edge(M, t, i, j, tolerance, old, points, new, layers)
            if k > 0 and replace(M, old, k, new, layers, m):
                return True
    for k in range(4):  # noqa: SIM110 - numba has no generators in any()
        if _across_face(M, t, k, old, new, layers) and replace(M, old, two, new, layers, three):
            return True
    return False


@nb.njit(cache=True, nogil=True)
def drop(M: Mesh, t: int, volume: float) -> bool:
    """Take away a tetrahedron with a boundary face and less than some volume; the part may touch itself there."""
    X, T, N = M.X, M.T, M.N
    a, b, c, d = T[t, 0], T[t, 1], T[t, 2], T[t, 3]
    bare = 0
    for k in range(4):
        bare += N[t, k] == NONE
    ux, uy, uz = X[b, 0] - X[a, 0], X[b, 1] - X[a, 1], X[b, 2] - X[a, 2]
    vx, vy, vz = X[c, 0] - X[a, 0], X[c, 1] - X[a, 1], X[c, 2] - X[a, 2]
    wx, wy, wz = X[d, 0] - X[a, 0], X[d, 1] - X[a, 1], X[d, 2] - X[a, 2]
    det = wx * (uy * vz - uz * vy) + wy * (uz * vx - ux * vz) + wz * (ux * vy - uy * vx)
    if bare == 0 or det > 6.0 * volume:
        return False
    for k in range(4):
        v, u = T[t, k], N[t, k]
        M.degree[v] -= 1
        M.wall[v] = M.pinched[v] = True
        if u >= 0:
            for j in range(4):
                if N[u, j] == t:
                    N[u, j] = NONE
                if j != k:
                    M.at[T[t, j]] = u
    T[t, 0] = NONE
    M.q[t] = np.inf
    M.unused[M.tops[0]] = t
    M.tops[0] += 1
    return True
