"""Moves that collapse short edges of a net.

An edge is collapsed only where the mesh stays a 2-manifold of the same holes and bodies (link condition), where what is
kept stays in place, and where the faces around fit.
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

from .facing_points import FaceTree, facing_point, on_triangle
from .fitting import MOST_AROUND, apart, face, ring_fits
from .net import CREASE, FREE, Net, collapse, following, preceding, round_about

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@nb.njit(cache=True, nogil=True)
def collapse_short(
    net: Net,
    edges: Indices,
    shortest: float,
    longest: float,
    tree: FaceTree,
    reach: float,
    crease_reach: float,
) -> int:
    """Collapse those of the given half-edges that are short; how many were."""
    ring, other = np.empty(MOST_AROUND, np.int64), np.empty(MOST_AROUND, np.int64)
    goal = np.empty(3)
    done = 0
    for h in edges:
        if net.corner[h] < 0:
            continue
        t = net.across[h]
        if apart(net.points, net.corner[h], net.corner[t]) >= shortest:
            continue
        for e in (h, t):
            if _try_collapse(net, e, ring, other, goal, longest, tree, reach, crease_reach):
                done += 1
                break
    return done


@nb.njit(cache=True, nogil=True)
def _try_collapse(
    net: Net,
    h: int,
    ring: Indices,
    other: Indices,
    goal: Array,
    longest: float,
    tree: FaceTree,
    reach: float,
    crease_reach: float,
) -> bool:
    t = net.across[h]
    a, b = net.corner[h], net.corner[t]
    if net.locked[a] or net.kind[a] > CREASE or (net.kind[a] == CREASE and not net.sharp[h]):
        return False
    nh, ph, nt, pt = following(h), preceding(h), following(t), preceding(t)
    # Two kept edges must not become one.
    if (net.sharp[nh] and net.sharp[ph]) or (net.sharp[nt] and net.sharp[pt]):
        return False
    count, around = round_about(net, a, ring), round_about(net, b, other)
    if count < 0 or around < 0 or not _link(net, ring, count, other, around, net.corner[ph], net.corner[pt]):
        return False
    gone = (h // 3, t // 3)
    if net.kind[a] == FREE and net.kind[b] == FREE and not net.locked[b] and h < t:
        ux, uy, uz = 0.0, 0.0, 0.0
        for f in gone:
            n, _ = face(*_corners(net, f))
            ux, uy, uz = ux + n[0], uy + n[1], uz + n[2]
        goal[:] = 0.5 * (net.points[a] + net.points[b])
        away, x, y, z = facing_point(tree, (goal[0], goal[1], goal[2]), (ux, uy, uz), 2.0 * reach, 0.0)
        if away <= 2.0 * reach:
            goal[0], goal[1], goal[2] = x, y, z
            if (
                ring_fits(net, ring, count, gone, goal, longest, tree, reach, False)
                and ring_fits(net, other, around, gone, goal, longest, tree, reach, False)
            ):  # fmt: skip
                net.points[b] = goal
                collapse(net, h, ring)
                return True
    goal[:] = net.points[b]
    if net.kind[a] == CREASE and not _crease_stays(net, h, ring, count, goal, crease_reach):
        return False
    if not ring_fits(net, ring, count, gone, goal, longest, tree, reach, False):
        return False
    if not _still_covered(net, ring, count, gone, goal, reach):
        return False
    collapse(net, h, ring)
    return True


@nb.njit(cache=True, nogil=True)
def _corners(net: Net, f: int) -> tuple[Array, Array, Array]:
    return (
        net.points[net.corner[3 * f]],
        net.points[net.corner[3 * f + 1]],
        net.points[net.corner[3 * f + 2]],
    )


@nb.njit(cache=True, nogil=True)
def _link(net: Net, ring: Indices, count: int, other: Indices, around: int, c: int, d: int) -> bool:
    """Whether two vertices have no neighbours in common but c and d, and neither of these loses its last faces."""
    if c == d:
        return False
    for i in range(count):
        v = net.corner[following(ring[i])]
        for j in range(around):
            if net.corner[following(other[j])] == v and v not in (c, d):
                return False
    if count <= 3 or around <= 3:
        return False
    for v in (c, d):
        h = net.out[v]
        second = net.across[preceding(net.across[preceding(h)])]
        if net.across[preceding(second)] == h:
            return False
    return True


@nb.njit(cache=True, nogil=True)
def _crease_stays(net: Net, h: int, ring: Indices, count: int, goal: Array, reach: float) -> bool:
    """Whether the start of h stays within reach of the kept line when that is drawn straight past it."""
    p = net.points[net.corner[h]]
    for i in range(count):
        if net.sharp[ring[i]] and ring[i] != h:
            q = net.points[net.corner[following(ring[i])]]
            x, y, z = on_triangle(q, goal, goal, (p[0], p[1], p[2]))
            return bool((p[0] - x) ** 2 + (p[1] - y) ** 2 + (p[2] - z) ** 2 <= reach * reach)
    return False


@nb.njit(cache=True, nogil=True)
def _still_covered(
    net: Net, ring: Indices, count: int, gone: tuple[int, int], goal: Array, reach: float
) -> bool:
    """Whether the place of a vertex is within reach of its faces once they are drawn to `goal`."""
    v = net.points[net.corner[ring[0]]]
    p = (v[0], v[1], v[2])
    for i in range(count):
        h = ring[i]
        if h // 3 == gone[0] or h // 3 == gone[1]:
            continue
        b, c = net.points[net.corner[following(h)]], net.points[net.corner[preceding(h)]]
        x, y, z = on_triangle(goal, b, c, p)
        if (p[0] - x) ** 2 + (p[1] - y) ** 2 + (p[2] - z) ** 2 <= reach * reach:
            return True
    return False
