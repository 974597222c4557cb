"""Moves: edges of a net split, collapsed and flipped, and vertices spread, until all edges are about as long as wanted.

The four steps are those of Botsch and Kobbelt (2004): A Remeshing Approach to Multiresolution Modeling. Beyond them,
every move is tried first, and is made only where the mesh stays a 2-manifold and its faces fit (`fitting.py`); edges
are collapsed in `collapses.py`.
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

from .facing_points import FaceTree, facing_point
from .fitting import MOST_AROUND, SLIVER, apart, dot, face, near, ring_fits
from .net import CREASE, Net, flip, following, preceding, round_about, split

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

STILL = 0.02
"""Vertices nearer to their place than this share of the longest edge stay."""


@nb.njit(cache=True, nogil=True)
def split_long(net: Net, longest: float) -> bool:
    """Halve edges until none is longer, the long ones first; False where room ran out before."""
    most = 0.0
    for h in range(3 * net.used[1]):
        if net.corner[h] >= 0:
            most = max(most, apart(net.points, net.corner[h], net.corner[following(h)]))
    while most > longest:
        most = max(0.75 * most, longest)
        h = 0
        while h < 3 * net.used[1]:
            if net.corner[h] >= 0 and h < net.across[h]:
                while apart(net.points, net.corner[h], net.corner[following(h)]) > most:
                    if net.used[0] >= len(net.points) or 3 * net.used[1] + 6 > len(net.corner):
                        return False
                    split(net, h)
            h += 1
    return True


@nb.njit(cache=True, nogil=True)
def flip_edges(net: Net, longest: float, tree: FaceTree, reach: float, flat: float, even: bool) -> int:
    """Flip edges: towards six edges a vertex (`even`), or towards larger least angles; how many were.

    Args:
        flat: least cosine between the normals of the two faces before and of those after.
    """
    ring = np.empty(MOST_AROUND, np.int64)
    done = 0
    for h in range(3 * net.used[1]):
        if net.corner[h] < 0 or net.sharp[h] or h > net.across[h]:
            continue
        t = net.across[h]
        a, b, c, d = net.corner[h], net.corner[t], net.corner[preceding(h)], net.corner[preceding(t)]
        if c == d or (net.locked[a] and net.locked[b]):
            continue
        pa, pb, pc, pd = net.points[a], net.points[b], net.points[c], net.points[d]
        one, two = face(pa, pb, pc), face(pb, pa, pd)
        three, four = face(pa, pd, pc), face(pb, pc, pd)
        worst, best = min(one[1], two[1]), min(three[1], four[1])
        if even and not (worst < 0.05 < best) and not _evens(net, ring, a, b, c, d):
            continue
        if even and best < 0.5 * worst:
            continue
        if not even and best <= worst + 1e-9:
            continue
        if best < SLIVER and best <= worst:
            continue
        if dot(three[0], four[0]) < flat:
            continue
        if one[1] > 0.02 and min(dot(one[0], three[0]), dot(one[0], four[0])) < flat:
            continue
        if two[1] > 0.02 and min(dot(two[0], three[0]), dot(two[0], four[0])) < flat:
            continue
        length = apart(net.points, c, d)
        if length > longest and length > apart(net.points, a, b):
            continue
        count = round_about(net, c, ring)
        joined = count < 0
        for i in range(count):
            joined = joined or net.corner[following(ring[i])] == d
        # A vertex keeps three edges at least.
        if joined or round_about(net, a, ring) <= 3 or round_about(net, b, ring) <= 3:
            continue
        n = (three[0][0] + four[0][0], three[0][1] + four[0][1], three[0][2] + four[0][2])
        if not (
            near(tree, n, reach, pc, pd, pa, 0.0)
            and near(tree, three[0], reach, pa, pd, pc, 1.0)
            and near(tree, four[0], reach, pb, pc, pd, 1.0)
        ):
            continue
        flip(net, h)
        done += 1
    return done


@nb.njit(cache=True, nogil=True)
def _evens(net: Net, ring: Indices, a: int, b: int, c: int, d: int) -> bool:
    """Whether a flip from a–b to c–d brings the numbers of edges nearer to six."""
    change = 0
    for v, more in ((a, -1), (b, -1), (c, 1), (d, 1)):
        count = round_about(net, v, ring)
        if count < 0:
            return False
        change += (count + more - 6) ** 2 - (count - 6) ** 2
    return change < 0


@nb.njit(cache=True, nogil=True)
def spread(net: Net, longest: float, tree: FaceTree, reach: float) -> None:
    """Draw each vertex towards the middle of its neighbours, along the surface or the straight line it is kept on."""
    ring = np.empty(MOST_AROUND, np.int64)
    goal = np.empty(3)
    for v in range(net.used[0]):
        if net.out[v] < 0 or net.locked[v] or net.kind[v] > CREASE:
            continue
        count = round_about(net, v, ring)
        if count < 0:
            continue
        if net.kind[v] == CREASE:
            if _along_crease(net, ring, count, goal) and ring_fits(
                net, ring, count, (-1, -1), goal, longest, tree, reach, True
            ):
                net.points[v] = goal
            continue
        p = net.points[v]
        mx, my, mz, nx, ny, nz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(count):
            q, r = net.points[net.corner[following(ring[i])]], net.points[net.corner[preceding(ring[i])]]
            mx, my, mz = mx + q[0] / count, my + q[1] / count, mz + q[2] / count
            ux, uy, uz, wx, wy, wz = (
                q[0] - p[0],
                q[1] - p[1],
                q[2] - p[2],
                r[0] - p[0],
                r[1] - p[1],
                r[2] - p[2],
            )
            nx, ny, nz = nx + uy * wz - uz * wy, ny + uz * wx - ux * wz, nz + ux * wy - uy * wx
        size = np.sqrt(nx * nx + ny * ny + nz * nz)
        if size == 0.0:
            continue
        n = (nx / size, ny / size, nz / size)
        mx, my, mz = mx - p[0], my - p[1], mz - p[2]
        up = mx * n[0] + my * n[1] + mz * n[2]
        if mx * mx + my * my + mz * mz - up * up < (STILL * longest) ** 2:
            continue
        share = 1.0
        for _ in range(2):
            aim = (
                p[0] + share * (mx - up * n[0]),
                p[1] + share * (my - up * n[1]),
                p[2] + share * (mz - up * n[2]),
            )
            away, x, y, z = facing_point(tree, aim, n, 4.0 * reach, 0.0)
            if away <= 4.0 * reach:
                goal[0], goal[1], goal[2] = x, y, z
                if ring_fits(net, ring, count, (-1, -1), goal, longest, tree, reach, True):
                    net.points[v] = goal
                    break
            share *= 0.5


@nb.njit(cache=True, nogil=True)
def _along_crease(net: Net, ring: Indices, count: int, goal: Array) -> bool:
    """Put into `goal` the place half-way between a vertex's neighbours on a kept line, if that is straight there."""
    ends = (-1, -1)
    for i in range(count):
        if net.sharp[ring[i]]:
            ends = (ends[1], net.corner[following(ring[i])])
    if ends[0] < 0:
        return False
    p, q, r = net.points[net.corner[ring[0]]], net.points[ends[0]], net.points[ends[1]]
    one, two = p - q, r - p
    size = np.sqrt((one * one).sum() * (two * two).sum())
    if (one * two).sum() < (1.0 - 1e-6) * size:
        return False
    goal[:] = 0.5 * (q + r)
    return True
