"""Smoothing: points move to where the worst tetrahedron around them is best.

First towards the mean of the neighbours, then up the gradient of the worst shapes. A point in a nozzle plane moves in
it; a point of the boundary along it, as far as the boundary may stray; others move freely.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from .tet_star import MOST, NONE, Array, Indices, Mesh, shape, star, strays


@nb.njit(cache=True, nogil=True)
def _worst_at(M: Mesh, tets: Indices, held: int, least: float) -> float:
    """The worst shape, or any at or below `least` as soon as there is one."""
    worst = np.inf
    for i in range(held):
        t = tets[i]
        worst = min(worst, shape(M.X, M.T[t, 0], M.T[t, 1], M.T[t, 2], M.T[t, 3]))
        if worst <= least:
            break
    return worst


@nb.njit(cache=True, nogil=True)
def _allow(M: Mesh, v: int, axes: Array, tets: Indices, held: int, along: Array) -> None:
    """Turn a direction into one in which v may go: in its nozzle plane, and along the boundary."""
    T, N, X = M.T, M.N, M.X
    k = M.plane[v]
    px, py, pz = axes[k, 0, 0], axes[k, 0, 1], axes[k, 0, 2]
    qx, qy, qz = axes[k, 1, 0], axes[k, 1, 1], axes[k, 1, 2]
    if not M.wall[v]:
        if k >= 0:
            p = along[0] * px + along[1] * py + along[2] * pz
            q = along[0] * qx + along[1] * qy + along[2] * qz
            along[0], along[1], along[2] = p * px + q * qx, p * py + q * qy, p * pz + q * qz
        return
    nx = ny = nz = 0.0
    for n in range(held):
        t = tets[n]
        for f in range(4):
            if N[t, f] != NONE or T[t, f] == v:
                continue
            a, b, c = T[t, (f + 1) & 3], T[t, (f + 2) & 3], T[t, (f + 3) & 3]
            if k >= 0 and M.plane[a] == k and M.plane[b] == k and M.plane[c] == k:
                continue
            sign = 1.0 if f & 1 == 0 else -1.0
            ux, uy, uz = X[b, 0] - X[a, 0], X[b, 1] - X[a, 1], X[b, 2] - X[a, 2]
            vx, vy, vz = X[c, 0] - X[a, 0], X[c, 1] - X[a, 1], X[c, 2] - X[a, 2]
            nx += sign * (uy * vz - uz * vy)
            ny += sign * (uz * vx - ux * vz)
            nz += sign * (ux * vy - uy * vx)
    if k < 0:
        square = nx * nx + ny * ny + nz * nz
        if square > 0.0:
            share = (along[0] * nx + along[1] * ny + along[2] * nz) / square
            along[0] -= share * nx
            along[1] -= share * ny
            along[2] -= share * nz
        return
    # In the plane, at a right angle to the boundary's normal; anywhere in it amid a flat top.
    p, q = nx * px + ny * py + nz * pz, nx * qx + ny * qy + nz * qz
    one = along[0] * px + along[1] * py + along[2] * pz
    two = along[0] * qx + along[1] * qy + along[2] * qz
    square = p * p + q * q
    if square > 0.0:
        share = (one * p + two * q) / square
        one -= share * p
        two -= share * q
    along[0], along[1], along[2] = one * px + two * qx, one * py + two * qy, one * pz + two * qz


@nb.njit(cache=True, nogil=True)
def smooth(M: Mesh, v: int, axes: Array, rounds: int, tolerance: float) -> bool:
    """Move one point; axes[k] are two unit vectors along nozzle plane k, at right angles."""
    if M.at[v] < 0 or (M.wall[v] and M.pinched[v]):
        return False
    tets = np.empty(MOST, np.int64)
    held = star(M, v, tets)
    if held == 0:
        return False
    X, T = M.X, M.T
    start = scale = np.inf
    along = np.zeros(3)
    for i in range(held):
        t = tets[i]
        start = min(start, M.q[t])
        for k in range(4):
            u = T[t, k]
            if u != v:
                dx, dy, dz = X[u, 0] - X[v, 0], X[u, 1] - X[v, 1], X[u, 2] - X[v, 2]
                along[0] += dx / (3.0 * held)
                along[1] += dy / (3.0 * held)
                along[2] += dz / (3.0 * held)
                scale = min(scale, dx * dx + dy * dy + dz * dz)
    scale = np.sqrt(scale)
    worst, step = start, 1.0
    for r in range(rounds):
        if r > 0:
            _gradient(M, v, tets, held, worst, along)
            step = 0.5
        _allow(M, v, axes, tets, held, along)
        size = np.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
        if size < 1e-9:
            continue
        if r > 0:
            step = 0.5 * scale / size
        x, y, z = X[v, 0], X[v, 1], X[v, 2]
        moved = False
        for _ in range(4):
            X[v, 0], X[v, 1], X[v, 2] = x + step * along[0], y + step * along[1], z + step * along[2]
            now = _worst_at(M, tets, held, worst * 1.01)
            if now > worst * 1.01:
                far = 0.0
                if M.wall[v]:
                    far = strays(M, v, v, x, y, z, X[v, 0], X[v, 1], X[v, 2], tets, held)
                if far + M.strayed[v] <= tolerance:
                    M.strayed[v] += far
                    worst, moved = now, True
                    break
            step *= 0.4
        if not moved:
            X[v, 0], X[v, 1], X[v, 2] = x, y, z
            if r > 0:
                break
    if worst <= start:
        return False
    for i in range(held):
        t = tets[i]
        M.settled[t] = False
        M.q[t] = shape(X, T[t, 0], T[t, 1], T[t, 2], T[t, 3])
    return True


@nb.njit(cache=True, nogil=True)
def _gradient(M: Mesh, v: int, tets: Indices, held: int, worst: float, g: Array) -> None:
    """A direction in which all the worst tetrahedra get better, if their gradients' sum is one."""
    X, T = M.X, M.T
    g[0] = g[1] = g[2] = 0.0
    h = 1e-4
    for i in range(held):
        t = tets[i]
        a, b, c, d = T[t, 0], T[t, 1], T[t, 2], T[t, 3]
        if shape(X, a, b, c, d) > worst + 0.1 * abs(worst) + 1e-12:
            continue
        for k in range(3):
            x = X[v, k]
            X[v, k] = x + h
            up = shape(X, a, b, c, d)
            X[v, k] = x - h
            g[k] += up - shape(X, a, b, c, d)
            X[v, k] = x
