"""Moves: edges of a net split, collapsed and flipped, and vertices spread, until all edges are about as long as wanted.

The four steps are those of Botsch and Kobbelt (2004): A Remeshing Approach to Multiresolution Modeling. Beyond them,
every move is tried first, and is made only where

- the mesh stays a 2-manifold of the same holes and bodies (link condition);
- no face that is changed turns round, nor folds onto its neighbour, nor becomes a sliver;
- middles of changed faces and edges stay within reach of the surface before all moves, on its same side.
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

from .facing_points import FaceTree, Point, facing_point, on_triangle
from .net import CREASE, FREE, Net, collapse, flip, following, preceding, round_about, split

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

TURNED = 0.4
"""Least cosine between a face's normals before and after a move."""

FOLDED = -0.2
"""Least cosine between the normals of neighbours, except where they fold more already."""

SLIVER = 0.25
"""Twice a face's area over its longest edge squared; a face below this must not become worse."""

HARDLY = 0.97
"""Cosine between a face's normals before and after a move that hardly turns it."""

STILL = 0.02
"""Vertices nearer to their place than this share of the longest edge stay."""

MOST_AROUND = 1024
"""Vertices with more edges than this are left as they are."""

_EMPTY_FACE = 1e-9


@nb.njit(cache=True, nogil=True, inline="always")
def _apart(points: Array, a: int, b: int) -> float:
    return float(
        np.sqrt(
            (points[a, 0] - points[b, 0]) ** 2
            + (points[a, 1] - points[b, 1]) ** 2
            + (points[a, 2] - points[b, 2]) ** 2
        )
    )


@nb.njit(cache=True, nogil=True)
def _face(p: Array, q: Array, r: Array) -> tuple[Point, float]:
    """Unit normal of a triangle, 0 where it has no area, and its shape: twice its area over longest edge²."""
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    wx, wy, wz = vx - ux, vy - uy, vz - uz
    longest = max(ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz)
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    twice = np.sqrt(x * x + y * y + z * z)
    if longest == 0.0 or twice <= _EMPTY_FACE * longest:
        return (0.0, 0.0, 0.0), 0.0
    return (x / twice, y / twice, z / twice), twice / longest


@nb.njit(cache=True, nogil=True, inline="always")
def _dot(a: Point, b: Point) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@nb.njit(cache=True, nogil=True)
def _near(tree: FaceTree, n: Point, reach: float, a: Array, b: Array, c: Array, thirds: float) -> bool:
    """Whether (a + b + thirds c) / (2 + thirds) is within reach of the surface."""
    share = 1.0 / (2.0 + thirds)
    p = (
        share * (a[0] + b[0] + thirds * c[0]),
        share * (a[1] + b[1] + thirds * c[1]),
        share * (a[2] + b[2] + thirds * c[2]),
    )
    return facing_point(tree, p, n, reach, reach)[0] <= reach


@nb.njit(cache=True, nogil=True)
def _face_fits(
    net: Net,
    edge: int,
    before: tuple[Point, float],
    p: Array,
    q: Array,
    r: Array,
    tree: FaceTree,
    reach: float,
    lazy: bool,
) -> bool:
    """Whether a face may become (p, q, r), of which the edge q–r is the half-edge `edge` and stays where it is."""
    old, was = before
    new, shape = _face(p, q, r)
    if shape < SLIVER and shape < was + 1e-12:
        return False
    if was > 0.02 and _dot(old, new) < TURNED:
        return False
    t = net.across[edge]
    outer, _ = _face(
        net.points[net.corner[t]], net.points[net.corner[following(t)]], net.points[net.corner[preceding(t)]]
    )
    folded = _dot(new, outer)
    if folded < FOLDED and folded < _dot(old, outer):
        return False
    if lazy and _dot(old, new) > HARDLY:
        return True
    return _near(tree, new, reach, p, q, r, 1.0) and (lazy or _near(tree, new, reach, p, q, r, 0.0))


@nb.njit(cache=True, nogil=True)
def _ring_fits(
    net: Net,
    ring: Indices,
    count: int,
    gone: tuple[int, int],
    goal: Array,
    longest: float,
    tree: FaceTree,
    reach: float,
    lazy: bool,
) -> bool:
    """Whether the vertex that `count` half-edges of `ring` start in may go to `goal`, without the faces `gone`.

    Lazily, faces that hardly turn are not measured against the surface.
    """
    v = net.corner[ring[0]]
    for i in range(count):
        h = ring[i]
        if h // 3 == gone[0] or h // 3 == gone[1]:
            continue
        b, c = net.corner[following(h)], net.corner[preceding(h)]
        length = np.sqrt(
            (goal[0] - net.points[b, 0]) ** 2
            + (goal[1] - net.points[b, 1]) ** 2
            + (goal[2] - net.points[b, 2]) ** 2
        )
        if length > longest and length > _apart(net.points, v, b):
            return False
        before = _face(net.points[v], net.points[b], net.points[c])
        if not _face_fits(net, following(h), before, goal, net.points[b], net.points[c], tree, reach, lazy):
            return False
    return True


@nb.njit(cache=True, nogil=True)
def split_long(net: Net, longest: float) -> bool:
    """Halve edges until none is longer, the long ones first; False where room ran out before."""
    most = 0.0
    for h in range(3 * net.used[1]):
        if net.corner[h] >= 0:
            most = max(most, _apart(net.points, net.corner[h], net.corner[following(h)]))
    while most > longest:
        most = max(0.75 * most, longest)
        h = 0
        while h < 3 * net.used[1]:
            if net.corner[h] >= 0 and h < net.across[h]:
                while _apart(net.points, net.corner[h], net.corner[following(h)]) > most:
                    if net.used[0] >= len(net.points) or 3 * net.used[1] + 6 > len(net.corner):
                        return False
                    split(net, h)
            h += 1
    return True


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
        if _apart(net.points, net.corner[h], net.corner[t]) >= shortest:
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
            n, _ = _face(*_corners(net, f))
            ux, uy, uz = ux + n[0], uy + n[1], uz + n[2]
        goal[:] = 0.5 * (net.points[a] + net.points[b])
        away, x, y, z = facing_point(tree, (goal[0], goal[1], goal[2]), (ux, uy, uz), 2.0 * reach, 0.0)
        if away <= 2.0 * reach:
            goal[0], goal[1], goal[2] = x, y, z
            if (
                _ring_fits(net, ring, count, gone, goal, longest, tree, reach, False)
                and _ring_fits(net, other, around, gone, goal, longest, tree, reach, False)
            ):  # fmt: skip
                net.points[b] = goal
                collapse(net, h, ring)
                return True
    goal[:] = net.points[b]
    if net.kind[a] == CREASE and not _crease_stays(net, h, ring, count, goal, crease_reach):
        return False
    if not _ring_fits(net, ring, count, gone, goal, longest, tree, reach, False):
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
        one, two = _face(pa, pb, pc), _face(pb, pa, pd)
        three, four = _face(pa, pd, pc), _face(pb, pc, pd)
        worst, best = min(one[1], two[1]), min(three[1], four[1])
        if even and not (worst < 0.05 < best) and not _evens(net, ring, a, b, c, d):
            continue
        if even and best < 0.5 * worst:
            continue
        if not even and best <= worst + 1e-9:
            continue
        if best < SLIVER and best <= worst:
            continue
        if _dot(three[0], four[0]) < flat:
            continue
        if one[1] > 0.02 and min(_dot(one[0], three[0]), _dot(one[0], four[0])) < flat:
            continue
        if two[1] > 0.02 and min(_dot(two[0], three[0]), _dot(two[0], four[0])) < flat:
            continue
        length = _apart(net.points, c, d)
        if length > longest and length > _apart(net.points, a, b):
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
            _near(tree, n, reach, pc, pd, pa, 0.0)
            and _near(tree, three[0], reach, pa, pd, pc, 1.0)
            and _near(tree, four[0], reach, pb, pc, pd, 1.0)
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
            if _along_crease(net, ring, count, goal) and _ring_fits(
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
                if _ring_fits(net, ring, count, (-1, -1), goal, longest, tree, reach, True):
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
