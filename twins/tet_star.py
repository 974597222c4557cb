"""A tetrahedral mesh that is being changed: its neighbourhoods, and how a few of its tetrahedra are replaced.

The mesh is held in flat arrays, so that compiled kernels can change it in place. Tetrahedra (a, b, c, d) are
positively oriented: d sees a, b, c turn left from above.

Compilation takes its time, as each kernel compiles anew all that it calls. A constant integer as an argument has the
callee compiled for it alone; assigning to a slice or a row, np.stack and the like take seconds: hence plain loops.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

from .overlay import neighbours

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

NONE = -1
MOST = 1024
"""Tetrahedra at one point: more are left as they are."""

RING = 9
"""Tetrahedra around one edge, likewise."""


class Mesh(NamedTuple):
    """Tetrahedra with room for more, and the points they join.

    Attributes:
        X: places, shape (n, 3), mm.
        plane: number of the nozzle plane that a point must stay in, or NONE; shape (n,).
        wall: whether a point lies on the boundary, shape (n,).
        pinched: whether the boundary is no disc there, so that it must not be changed, shape (n,).
        strayed: how far the boundary at a point may be from where it was, shape (n,), mm.
        at: a tetrahedron of each point, shape (n,).
        degree: their number, shape (n,).
        T: corners, shape (m, 4); NONE where a row is unused.
        N: the tetrahedron across the face opposite to each corner, or NONE, shape (m, 4).
        layer: shape (m,).
        q: shape measure, see `shape_of`, shape (m,).
        settled: whether improving it has failed since it last changed, shape (m,).
        unused: stack of unused rows; its height is `tops[0]`.
        stamped, seen: when a tetrahedron and a point were last visited; the time is `tops[1]`.
        tops: both, shape (2,).
    """

    X: Array
    plane: Indices
    wall: Flags
    pinched: Flags
    strayed: Array
    at: Indices
    degree: Indices
    T: Indices
    N: Indices
    layer: Indices
    q: Array
    settled: Flags
    unused: Indices
    stamped: Indices
    seen: Indices
    tops: Indices


def make_mesh(points: Array, plane: Indices, tets: Indices, layer: Indices) -> Mesh:
    """A mesh of tetrahedra that share no face three times."""
    n, m = len(points), len(tets)
    room = m + m // 4 + 64
    T, N = np.full((room, 4), NONE), np.full((room, 4), NONE)
    T[:m], N[:m] = tets, neighbours(tets, n)
    layers = np.zeros(room, np.int64)
    layers[:m] = layer
    at = np.full(n, NONE)
    at[tets] = np.arange(m)[:, None]
    corners = np.arange(4)
    wall = np.zeros(n, np.bool_)
    for k in range(4):
        wall[tets[N[:m, k] == NONE][:, corners != k]] = True
    mesh = Mesh(
        X=np.array(points),
        plane=np.asarray(plane, dtype=np.int64),
        wall=wall,
        pinched=np.zeros(n, np.bool_),
        strayed=np.zeros(n),
        at=at,
        degree=np.bincount(tets.ravel(), minlength=n),
        T=T,
        N=N,
        layer=layers,
        q=np.full(room, np.inf),
        settled=np.zeros(room, np.bool_),
        unused=np.arange(room - 1, -1, -1),
        stamped=np.zeros(room, np.int64),
        seen=np.zeros(n, np.int64),
        tops=np.array([room - m, 0]),
    )
    _survey(mesh, m)
    return mesh


@nb.njit(cache=True, nogil=True)
def shape_of(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float,
    cx: float, cy: float, cz: float, dx: float, dy: float, dz: float,
) -> float:  # fmt: skip
    """Mean ratio to the power 3/2, signed: 1 where regular, 0 where flat; quicker to compute than the mean ratio."""
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = cx - ax, cy - ay, cz - az
    wx, wy, wz = dx - ax, dy - ay, dz - az
    det = wx * (uy * vz - uz * vy) + wy * (uz * vx - ux * vz) + wz * (ux * vy - uy * vx)
    s = ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz + wx * wx + wy * wy + wz * wz
    ux, uy, uz = cx - bx, cy - by, cz - bz
    vx, vy, vz = dx - cx, dy - cy, dz - cz
    wx, wy, wz = bx - dx, by - dy, bz - dz
    s += ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz + wx * wx + wy * wy + wz * wz
    return 20.784609690826528 * det / (s * np.sqrt(s)) if s > 0.0 else 0.0


@nb.njit(cache=True, nogil=True, forceinline=True)  # an array handed over is counted, unless inlined
def shape(X: Array, a: int, b: int, c: int, d: int) -> float:
    """`shape_of` four points."""
    return shape_of(
        X[a, 0], X[a, 1], X[a, 2], X[b, 0], X[b, 1], X[b, 2],
        X[c, 0], X[c, 1], X[c, 2], X[d, 0], X[d, 1], X[d, 2],
    )  # fmt: skip


@nb.njit(cache=True, nogil=True)
def star(M: Mesh, v: int, out: Indices) -> int:
    """The tetrahedra at a point that hang together by faces; their number, or 0 if there are too many or others."""
    M.tops[1] += 1
    now = M.tops[1]
    T, N, stamped = M.T, M.N, M.stamped
    first = M.at[v]
    most = M.degree[v]
    if first < 0 or most > len(out):
        return 0
    if T[first, 0] != v and T[first, 1] != v and T[first, 2] != v and T[first, 3] != v:
        return 0
    out[0] = first
    stamped[first] = now
    held, done = 1, 0
    while done < held:
        t = out[done]
        done += 1
        for k in range(4):
            if T[t, k] != v:
                u = N[t, k]
                if u >= 0 and stamped[u] != now:
                    stamped[u] = now
                    out[held] = u
                    held += 1
    return held if held == most else 0


@nb.njit(cache=True, nogil=True)
def _survey(M: Mesh, m: int) -> None:
    """Measure the first m tetrahedra, and mark boundary points whose link is no disc, by its Euler characteristic."""
    for t in range(m):
        M.q[t] = shape(M.X, M.T[t, 0], M.T[t, 1], M.T[t, 2], M.T[t, 3])
    out = np.empty(MOST, np.int64)
    for v in range(len(M.at)):
        if M.at[v] < 0 or not M.wall[v]:
            continue
        held = star(M, v, out)
        M.pinched[v] = held == 0 or not _is_disc(M, v, out, held)


@nb.njit(cache=True, nogil=True)
def _is_disc(M: Mesh, v: int, tets: Indices, held: int) -> bool:
    now = M.tops[1]
    points = bare = 0
    for i in range(held):
        for k in range(4):
            u = M.T[tets[i], k]
            if u == v:
                continue
            bare += M.N[tets[i], k] == NONE
            if M.seen[u] != now:
                M.seen[u] = now
                points += 1
    return 2 * points - held - bare == 2


@nb.njit(cache=True, nogil=True)
def replace(M: Mesh, old: Indices, k: int, new: Indices, layer: Indices, m: int) -> bool:
    """Put `m` tetrahedra in the place of `k` others; False, and nothing done, where there is no room."""
    T, N = M.T, M.N
    if m - k > M.tops[0]:
        return False
    M.tops[1] += 1
    now = M.tops[1]
    for i in range(k):
        M.stamped[old[i]] = now
    rim = np.empty((4 * k + 4 * m, 5), np.int64)
    rims = 0
    for i in range(k):
        t = old[i]
        for f in range(4):
            M.degree[T[t, f]] -= 1
            u = N[t, f]
            if u >= 0 and M.stamped[u] == now:
                continue
            a, b, c = T[t, (f + 1) & 3], T[t, (f + 2) & 3], T[t, (f + 3) & 3]
            low, high = min(a, b, c), max(a, b, c)
            rim[rims, 0], rim[rims, 1], rim[rims, 2] = low, a + b + c - low - high, high
            rim[rims, 3] = u
            if u >= 0:
                for j in range(4):
                    w = T[u, j]
                    if w != a and w != b and w != c:  # noqa: PLR1714 - a tuple would be built in the kernel
                        rim[rims, 4] = j
                N[u, rim[rims, 4]] = NONE
                M.at[a] = u
                M.at[b] = u
                M.at[c] = u
            rims += 1
    for i in range(k):
        T[old[i], 0] = NONE
        M.q[old[i]] = np.inf
        M.unused[M.tops[0]] = old[i]
        M.tops[0] += 1
    for i in range(m):
        M.tops[0] -= 1
        t = M.unused[M.tops[0]]
        for f in range(4):
            T[t, f] = new[i, f]
            N[t, f] = NONE
            M.at[new[i, f]] = t
            M.degree[new[i, f]] += 1
        M.layer[t] = layer[i]
        M.settled[t] = False
        M.q[t] = shape(M.X, new[i, 0], new[i, 1], new[i, 2], new[i, 3])
        for f in range(4):
            a, b, c = T[t, (f + 1) & 3], T[t, (f + 2) & 3], T[t, (f + 3) & 3]
            low, high = min(a, b, c), max(a, b, c)
            middle = a + b + c - low - high
            found = False
            for r in range(rims):
                if rim[r, 0] == low and rim[r, 1] == middle and rim[r, 2] == high:
                    u = rim[r, 3]
                    if u >= 0:
                        N[t, f], N[u, rim[r, 4]] = u, t
                    rims -= 1
                    for j in range(5):
                        rim[r, j] = rim[rims, j]
                    found = True
                    break
            if not found:
                rim[rims, 0], rim[rims, 1], rim[rims, 2], rim[rims, 3], rim[rims, 4] = low, middle, high, t, f
                rims += 1
    return True


@nb.njit(cache=True, nogil=True)
def ring(M: Mesh, t: int, i: int, j: int, tets: Indices, points: Indices) -> tuple[int, bool]:
    """The tetrahedra around the edge from corner i to corner j of t, turning left, and the points between them.

    Returns:
        the number of tetrahedra, 0 if there are too many, and whether they close up; if they do not, the ring has
        one point more than tetrahedra, and begins and ends on the boundary.
    """
    T, N = M.T, M.N
    a, b = T[t, i], T[t, j]
    c, d = third(i, j)
    start, x = t, T[t, c]
    step, face = t, d
    for _ in range(RING + 1):  # back to the boundary, or once around
        u = N[step, face]
        if u < 0 or u == t:
            break
        y = x
        s = 0
        for k in range(4):
            s += T[u, k]
        x = s - a - b - y
        for k in range(4):
            if T[u, k] == y:
                face = k
        step = u
        start = u
    else:
        return 0, False
    closed = u == t
    if closed:
        start, x = t, T[t, c]
    points[0] = x
    held, step = 0, start
    while True:
        if held == RING:
            return 0, False
        s = 0
        for k in range(4):
            s += T[step, k]
        y = s - a - b - x
        tets[held] = step
        held += 1
        points[held] = y
        face = 0
        for k in range(4):
            if T[step, k] == x:
                face = k
        x = y
        step = N[step, face]
        if step < 0 or step == start:
            return held, closed


@nb.njit(cache=True, nogil=True)
def third(i: int, j: int) -> tuple[int, int]:
    """The corners k, l for which (i, j, k, l) is an even order."""
    c = 0
    while c == i or c == j:  # noqa: PLR1714, SIM109 - a tuple would be built in the kernel
        c += 1
    d = 6 - i - j - c
    # Inversions of (i, j, c, d) with c < d.
    odd = (i > j) ^ (i > c) ^ (i > d) ^ (j > c) ^ (j > d)
    return (d, c) if odd else (c, d)


@nb.njit(cache=True, nogil=True)
def strays(
    M: Mesh, v: int, u: int, vx: float, vy: float, vz: float, ux: float, uy: float, uz: float,
    tets: Indices, held: int,
) -> float:  # fmt: skip
    """How far the place of v is from the planes of its boundary faces after v moves onto u, or a place of its own.

    Faces at the edge of v and u vanish. Infinite where a face turns by 30° or more.

    Args:
        v, u: the point that moves and the one it moves onto, or itself.
        vx, vy, vz, ux, uy, uz: where it is and where it goes, mm.
        tets, held: the star of v.
    """
    T, N, X = M.T, M.N, M.X
    far = 0.0
    for n in range(held):
        t = tets[n]
        for k in range(4):
            if N[t, k] != NONE or T[t, k] == v:
                continue
            b = c = NONE
            for j in range(4):
                w = T[t, j]
                if j != k and w != v:
                    if b == NONE:
                        b = w
                    else:
                        c = w
            if b == u or c == u:  # noqa: PLR1714 - a tuple would be built in the kernel
                continue
            ex, ey, ez = X[c, 0] - X[b, 0], X[c, 1] - X[b, 1], X[c, 2] - X[b, 2]
            px, py, pz = vx - X[b, 0], vy - X[b, 1], vz - X[b, 2]
            sx, sy, sz = ux - X[b, 0], uy - X[b, 1], uz - X[b, 2]
            mx, my, mz = ey * pz - ez * py, ez * px - ex * pz, ex * py - ey * px
            nx, ny, nz = ey * sz - ez * sy, ez * sx - ex * sz, ex * sy - ey * sx
            size = np.sqrt(nx * nx + ny * ny + nz * nz)
            was = np.sqrt(mx * mx + my * my + mz * mz)
            if mx * nx + my * ny + mz * nz <= 0.87 * size * was:
                return np.inf
            far = max(far, abs(px * nx + py * ny + pz * nz) / size)
    return far
