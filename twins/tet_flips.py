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
def _lies_flat(X: Array, a: int, b: int, c: int, d: int, tolerance: float) -> bool:
    """Whether edges a b and c d are the diagonals of a quadrilateral that is flat to within the tolerance."""
    n = np.empty((4, 3))
    corner = ((a, b, d), (a, c, b), (a, c, d), (b, d, c))
    for f in range(4):
        p, q, r = corner[f]
        ux, uy, uz = X[q, 0] - X[p, 0], X[q, 1] - X[p, 1], X[q, 2] - X[p, 2]
        vx, vy, vz = X[r, 0] - X[p, 0], X[r, 1] - X[p, 1], X[r, 2] - X[p, 2]
        n[f, 0], n[f, 1], n[f, 2] = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
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
def remove_edge(M: Mesh, t: int, i: int, j: int, tolerance: float) -> bool:
    """Remove the edge between corners i and j of t if the mesh gets better."""
    T, X, plane = M.T, M.X, M.plane
    tets, points = np.empty(RING, np.int64), np.empty(RING + 1, np.int64)
    held, closed = ring(M, t, i, j, tets, points)
    if held == 0:
        return False
    a, b = T[t, i], T[t, j]
    worst = np.inf
    for k in range(held):
        worst = min(worst, M.q[tets[k]])
    least = GAIN * max(worst, 1e-12)
    in_plane = plane[a] >= 0 and plane[a] == plane[b]
    best, cut = np.empty((RING + 1, RING + 1)), np.empty((RING + 1, RING + 1), np.int64)
    new, layers = np.empty((4 * RING, 4), np.int64), np.empty(4 * RING, np.int64)
    if closed and not in_plane:
        if held < 3 or not _best_triangles(X, a, b, points, held, least, best, cut):
            return False
        m = _add_triangles(a, b, points, held, cut, M.layer[t], new, layers, 0)
        return replace(M, tets, held, new, layers, m)
    if closed:
        one = two = -1
        for k in range(held):
            if plane[points[k]] == plane[a]:
                if one < 0:
                    one = k
                elif two < 0:
                    two = k
                else:
                    return False
        if two < 0 or two - one < 2 or held - two + one < 2:
            return False
        upper, lower = np.empty(RING + 1, np.int64), np.empty(RING + 1, np.int64)
        n = two - one + 1
        for k in range(n):
            upper[k] = points[one + k]
        n_lower = held - two + one + 1
        for k in range(n_lower):
            lower[k] = points[(two + k) % held]
        if not _best_triangles(X, a, b, upper, n, least, best, cut):
            return False
        m = _add_triangles(a, b, upper, n, cut, M.layer[tets[one]], new, layers, 0)
        if not _best_triangles(X, a, b, lower, n_lower, least, best, cut):
            return False
        m = _add_triangles(a, b, lower, n_lower, cut, M.layer[tets[two]], new, layers, m)
        return replace(M, tets, held, new, layers, m)
    c, d = points[0], points[held]
    for k in range(held + 1):
        if in_plane and (plane[points[k]] == plane[a]) != (k == 0 or k == held):  # noqa: PLR1714
            return False
    if M.pinched[a] or M.pinched[b] or M.pinched[c] or M.pinched[d]:
        return False
    if not _lies_flat(X, a, b, c, d, tolerance):
        return False
    if held == 1:
        return worst < 0.1 and _peel(M, t, i, j)
    if not _best_triangles(X, a, b, points, held + 1, least, best, cut):
        return False
    if _joined(M, c, d):
        return False
    m = _add_triangles(a, b, points, held + 1, cut, M.layer[t], new, layers, 0)
    return replace(M, tets, held, new, layers, m)


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
def _peel(M: Mesh, t: int, i: int, j: int) -> bool:
    """Take away a tetrahedron that lies flat on the boundary with two faces."""
    if M.N[t, i] < 0 or M.N[t, j] < 0:
        return False
    c, d = third(i, j)
    tets, points = np.empty(RING, np.int64), np.empty(RING + 1, np.int64)
    held, closed = ring(M, t, c, d, tets, points)
    if held == 0 or not closed:
        return False
    tets[0] = t
    return replace(M, tets, 1, np.empty((1, 4), np.int64), np.empty(1, np.int64), 0)


@nb.njit(cache=True, nogil=True)
def drop(M: Mesh, t: int, volume: float) -> bool:
    """Take away a tetrahedron with a boundary face and less than some volume; the part may touch itself there."""
    X, T = M.X, M.T
    a, b, c, d = T[t, 0], T[t, 1], T[t, 2], T[t, 3]
    bare = 0
    for k in range(4):
        bare += M.N[t, k] == NONE
    if bare == 0 or np.linalg.det(np.stack((X[b] - X[a], X[c] - X[a], X[d] - X[a]))) > 6.0 * volume:
        return False
    if not replace(M, np.full(1, t), 1, np.empty((1, 4), np.int64), np.empty(1, np.int64), 0):
        return False
    for v in (a, b, c, d):
        M.wall[v] = M.pinched[v] = True
    return True


@nb.njit(cache=True, nogil=True)
def swap_face(M: Mesh, t: int, k: int) -> bool:
    """Put three tetrahedra around a new edge in the place of t and its neighbour across face k, if better."""
    T, X, plane = M.T, M.X, M.plane
    u = M.N[t, k]
    if u < 0 or M.layer[u] != M.layer[t]:
        return False
    a, b, c = T[t, (k + 1) & 3], T[t, (k + 2) & 3], T[t, (k + 3) & 3]
    if k & 1 == 0:  # so that (a, b, c, d) is positive
        b, c = c, b
    d = T[t, k]
    e = T[u, 0] + T[u, 1] + T[u, 2] + T[u, 3] - a - b - c
    least = GAIN * max(min(M.q[t], M.q[u]), 1e-12)
    if shape(X, e, d, a, b) <= least or shape(X, e, d, b, c) <= least or shape(X, e, d, c, a) <= least:
        return False
    if plane[d] >= 0 and plane[d] == plane[e]:
        return False
    new = np.array(((e, d, a, b), (e, d, b, c), (e, d, c, a)))
    return replace(M, np.array((t, u)), 2, new, np.full(3, M.layer[t]), 3)


@nb.njit(cache=True, nogil=True)
def flip_at(M: Mesh, t: int, tolerance: float) -> bool:
    """The first flip that betters a tetrahedron and its surroundings."""
    for i in range(4):
        for j in range(i + 1, 4):
            if remove_edge(M, t, i, j, tolerance):
                return True
    for k in range(4):  # noqa: SIM110 - numba has no generators in any()
        if swap_face(M, t, k):
            return True
    return False
