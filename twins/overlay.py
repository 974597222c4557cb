"""The slab between two layers: the Delaunay tetrahedra between their regions.

The 3D Delaunay tetrahedra of points in two parallel planes are the cells of the overlay of the two layers' Voronoi
diagrams. One with three points in a layer is a Delaunay triangle there with, in the other layer, the point nearest
to the triangle's circumcentre; one with two points in each is a pair of Delaunay edges whose Voronoi edges cross.

The overlay is *walked*: from the centre of a triangle inside one layer's region along its Voronoi edges, from cell to
cell of the other layer's diagram, to the region's border. So only what lies over a region is ever looked at, the
cost is that of the crossings found, and the only question asked is to which of two points a centre is nearer, which
`predicates.py` answers exactly.

Each tetrahedron has a merge threshold f(T) as in the seed paper, Section 2.2.1, decided by where the centre
of its empty sphere lies: inside both regions 0; inside one region 1, or 2 if both its edges are segments of curves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
import numpy.typing as npt

from .predicates import Diagram, center_side, crossing_side, nearer, nearer_exactly
from .triangulation import Region

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Slab:
    """The solid between two layers; points of the upper layer are numbered on from the lower's.

    Attributes:
        lower: number of points of the lower layer.
        tets: positively oriented, shape (m, 4).
        under, over: which triangles of the lower and of the upper region the solid rests against, shape (k,).
        sides: its other faces, turned outwards, shape (s, 3).
        held: which points the solid holds, shape (n,).
    """

    lower: int
    tets: Indices
    under: Flags
    over: Flags
    sides: Indices
    held: Flags


def slab_between(lower: Region, upper: Region) -> Slab:
    """The solid that joins the regions of two neighbouring layers; both on the same lattice."""
    if not len(lower) or not len(upper):
        return _nothing_between(lower, upper)
    tets, threshold = overlay_tetrahedra(lower, upper)
    points = len(lower) + len(upper)
    across = neighbours(tets, points)
    inside = merge(threshold, across)
    a, b = len(lower.triangles), len(upper.triangles)
    kept, sides, held = _interior(tets, across, inside, len(lower), points)
    return Slab(len(lower), kept, inside[:a], inside[a : a + b], sides, held)


def _nothing_between(lower: Region, upper: Region) -> Slab:
    under, over = np.zeros(len(lower.triangles), np.bool_), np.zeros(len(upper.triangles), np.bool_)
    held = np.zeros(len(lower) + len(upper), np.bool_)
    return Slab(len(lower), np.zeros((0, 4), np.int64), under, over, np.zeros((0, 3), np.int64), held)


def overlay_tetrahedra(lower: Region, upper: Region) -> tuple[Indices, npt.NDArray[np.int8]]:
    """All Delaunay tetrahedra that touch a region, positively oriented, shape (m, 4), and their merge thresholds.

    First those on the triangles of the lower region, in their order, then those under the upper's, then the others.
    """
    return _overlay(lower.diagram, upper.diagram, 1, 0)


@nb.njit(cache=True, nogil=True)
def _nearest_of_all(X: Diagram, Y: Diagram, shift: int) -> Indices:
    """For each triangle of X inside its region the point of Y nearest to its centre; elsewhere -1.

    Found downhill from the answer for a neighbouring triangle.
    """
    P, triangles, across, centers, bounds, inside = X.P, X.triangles, X.across, X.centers, X.bounds, X.inside
    Q, triangles_q, across_q, at_q = Y.P, Y.triangles, Y.across, Y.at
    nearest = np.full(len(triangles), -1, np.int64)
    stack = np.empty(len(triangles), np.int64)
    hint = 0
    for seed in X.inner:
        if nearest[seed] >= 0:
            continue
        nearest[seed] = hint
        stack[0] = seed
        top = 1
        while top:
            top -= 1
            t = stack[top]
            better = nearest[t]
            v = better
            while better >= 0:
                v, better = better, -1
                u = first = at_q[v]
                while True:
                    k = 1 if triangles_q[u, 0] == v else (2 if triangles_q[u, 1] == v else 0)
                    w = triangles_q[u, k + 1 if k < 2 else 0]
                    if w >= 0:
                        sign = nearer(
                            centers[t, 0], centers[t, 1], bounds[t], Q[v, 0], Q[v, 1], Q[w, 0], Q[w, 1]
                        )
                        if sign == 0:
                            sign = nearer_exactly(P, triangles, across, t, Q, v, w, shift)
                        if sign > 0:
                            better = w
                            break
                    u = across_q[u, k]
                    if u == first:
                        break
            nearest[t] = hint = v
            for k in range(3):
                u = across[t, k]
                if inside[u] and nearest[u] < 0:
                    nearest[u] = v
                    stack[top] = u
                    top += 1
    return nearest


@nb.njit(cache=True, nogil=True)
def _in_sector(
    P: Indices, triangles: Indices, t: int, Q: Indices, v: int, after: int, before: int, shift: int
) -> bool:
    """Whether the centre of a triangle of P lies in the interior sector at v, the point of Q nearest to it.

    That decides whether it lies in Q's region ("covers", seed paper, Figure 4), since with Gabriel edges only the two
    segments at v bound the region inside v's Voronoi cell.
    """
    if after == v:
        return True
    left_of_after = center_side(P, triangles, t, Q, v, after, shift) > 0
    right_of_before = center_side(P, triangles, t, Q, v, before, shift) < 0
    ax, ay = Q[after, 0] - Q[v, 0], Q[after, 1] - Q[v, 1]
    bx, by = Q[before, 0] - Q[v, 0], Q[before, 1] - Q[v, 1]
    if ax * by - ay * bx > 0:
        return left_of_after and right_of_before
    return left_of_after or right_of_before


@nb.njit(cache=True, nogil=True)
def _grown(tets: Indices, threshold: npt.NDArray[np.int8]) -> tuple[Indices, npt.NDArray[np.int8]]:
    more, wider = np.empty((2 * len(tets) + 64, 4), np.int64), np.empty(2 * len(tets) + 64, np.int8)
    more[: len(tets)], wider[: len(tets)] = tets, threshold
    return more, wider


@nb.njit(cache=True, nogil=True)
def _crossings(
    X: Diagram,
    Y: Diagram,
    nearest: Indices,
    shift: int,
    n: int,
    m: int,
    tets: Indices,
    threshold: npt.NDArray[np.int8],
) -> tuple[Indices, npt.NDArray[np.int8], int]:
    """Walk the Voronoi edges of X inside X's region and add the tetrahedra of the crossings met.

    From the lower layer (shift 1) all crossings count, from the upper (-1) those that do not lie inside the lower's
    region as well; n is the number of points of the lower layer.
    """
    P, triangles, across, inside, following = X.P, X.triangles, X.across, X.inside, X.following
    Q, triangles_q, across_q, at_q = Y.P, Y.triangles, Y.across, Y.at
    centers_q, bounds_q, inside_q, following_q = Y.centers, Y.bounds, Y.inside, Y.following
    for t in X.inner:
        for corner in range(3):
            other = across[t, corner]
            a = triangles[t, corner + 1 if corner < 2 else 0]
            b = triangles[t, corner - 1 if corner > 0 else 2]
            native = following[a] == b
            p, goal = nearest[t], -1
            if not native and inside[other]:
                goal = nearest[other]
                if other < t:
                    continue
            ax, ay, bx, by = P[a, 0], P[a, 1], P[b, 0], P[b, 1]
            u = at_q[p]
            searching = True
            while p != goal:
                # Around the cell of p, whose corners are the centres of its triangles, to the side where they change
                # from nearer to a to nearer to b: there the Voronoi edge leaves it.
                start, was = u, searching
                q = -1
                before = behind = u
                while True:
                    k = 1 if triangles_q[u, 0] == p else (2 if triangles_q[u, 1] == p else 0)
                    before, behind = u, across_q[u, k]
                    sign = nearer(
                        centers_q[behind, 0], centers_q[behind, 1], bounds_q[behind], ax, ay, bx, by
                    )
                    if sign == 0:
                        sign = nearer_exactly(Q, triangles_q, across_q, behind, P, a, b, -shift)
                    if sign > 0 and not was:
                        q = triangles_q[u, k + 1 if k < 2 else 0]
                        break
                    u, was = behind, sign > 0
                    if u == start:
                        if not searching:
                            break
                        searching = False
                if q < 0 or (native and crossing_side(P, a, b, Q, p, q, shift) < 0):
                    break
                u, searching = before, False
                if inside_q[before] or inside_q[behind]:
                    ahead, back = following_q[p] == q, following_q[q] == p
                    in_q = True
                    if ahead:
                        in_q = crossing_side(Q, p, q, P, a, b, -shift) > 0
                    elif back:
                        in_q = crossing_side(Q, q, p, P, a, b, -shift) > 0
                    if shift > 0 or not in_q:
                        if m == len(tets):
                            tets, threshold = _grown(tets, threshold)
                        if shift > 0:
                            tets[m, 0], tets[m, 1], tets[m, 2], tets[m, 3] = a, b, p + n, q + n
                        else:
                            tets[m, 0], tets[m, 1], tets[m, 2], tets[m, 3] = p, q, a + n, b + n
                        ex, ey = P[b, 0] - P[a, 0], P[b, 1] - P[a, 1]
                        gx, gy = Q[q, 0] - Q[p, 0], Q[q, 1] - Q[p, 1]
                        if shift * (ex * gy - ey * gx) > 0:
                            tets[m, 2], tets[m, 3] = tets[m, 3], tets[m, 2]
                        threshold[m] = 0 if in_q else (2 if native and (ahead or back) else 1)
                        m += 1
                p = q
    return tets, threshold, m


@nb.njit(cache=True, nogil=True)
def _overlay(A: Diagram, B: Diagram, shift: int, m: int) -> tuple[Indices, npt.NDArray[np.int8]]:
    # The shift, always 1, and m, always 0, come from outside: each constant in a call would be compiled on its own.
    above = _nearest_of_all(A, B, shift)
    below = _nearest_of_all(B, A, -shift)
    before_a, before_b = np.empty(len(A.P), np.int64), np.empty(len(B.P), np.int64)
    before_a[A.following] = np.arange(len(A.P))
    before_b[B.following] = np.arange(len(B.P))
    n = len(A.P)
    capacity = 4 * (len(A.inner) + len(B.inner)) + 64
    tets, threshold = np.empty((capacity, 4), np.int64), np.empty(capacity, np.int8)
    for t in A.inner:
        v = above[t]
        for k in range(3):
            tets[m, k] = A.triangles[t, k]
        tets[m, 3] = v + n
        threshold[m] = 0 if _in_sector(A.P, A.triangles, t, B.P, v, B.following[v], before_b[v], shift) else 1
        m += 1
    for t in B.inner:
        v = below[t]
        tets[m, 0], tets[m, 1], tets[m, 2] = (
            B.triangles[t, 0] + n,
            B.triangles[t, 2] + n,
            B.triangles[t, 1] + n,
        )
        tets[m, 3] = v
        threshold[m] = (
            0 if _in_sector(B.P, B.triangles, t, A.P, v, A.following[v], before_a[v], -shift) else 1
        )
        m += 1
    tets, threshold, m = _crossings(A, B, above, shift, n, m, tets, threshold)
    tets, threshold, m = _crossings(B, A, below, -shift, n, m, tets, threshold)
    return tets[:m].copy(), threshold[:m].copy()


@nb.njit(cache=True, nogil=True)
def neighbours(tets: Indices, points: int) -> Indices:
    """For each tetrahedron and corner the tetrahedron across the face opposite to it, or -1; shape (m, 4)."""
    m = len(tets)
    start = np.zeros(points + 1, np.int64)
    faces = np.empty((4 * m, 3), np.int64)
    for i in range(m):
        for k in range(4):
            a, b, c = tets[i, (k + 1) % 4], tets[i, (k + 2) % 4], tets[i, (k + 3) % 4]
            low, high = min(a, b, c), max(a, b, c)
            f = 4 * i + k
            faces[f, 0], faces[f, 1], faces[f, 2] = low, a + b + c - low - high, high
            start[low + 1] += 1
    for v in range(points):
        start[v + 1] += start[v]
    fill = start[:-1].copy()
    waiting = np.empty(4 * m, np.int64)
    across = np.full((m, 4), -1, np.int64)
    for f in range(4 * m):
        low = faces[f, 0]
        found = False
        for slot in range(start[low], fill[low]):
            g = waiting[slot]
            if faces[g, 1] == faces[f, 1] and faces[g, 2] == faces[f, 2]:
                across[f // 4, f % 4], across[g // 4, g % 4] = g // 4, f // 4
                fill[low] -= 1
                waiting[slot] = waiting[fill[low]]
                found = True
                break
        if not found:
            waiting[fill[low]] = f
            fill[low] += 1
    return across


@nb.njit(cache=True, nogil=True)
def merge(threshold: npt.NDArray[np.int8], across: Indices) -> Flags:
    """Grow the interior from tetrahedra of threshold 0 over those with enough interior neighbours."""
    m = len(threshold)
    interior = np.zeros(m, np.bool_)
    count = np.zeros(m, np.int8)
    stack = np.empty(m, np.int64)
    top = 0
    for t in range(m):
        if threshold[t] == 0:
            interior[t] = True
            stack[top] = t
            top += 1
    while top:
        top -= 1
        t = stack[top]
        for k in range(4):
            u = across[t, k]
            if u >= 0 and not interior[u]:
                count[u] += 1
                if count[u] >= threshold[u]:
                    interior[u] = True
                    stack[top] = u
                    top += 1
    return interior


@nb.njit(cache=True, nogil=True)
def _interior(
    tets: Indices, across: Indices, inside: Flags, lower: int, points: int
) -> tuple[Indices, Indices, Flags]:
    """The tetrahedra inside, their faces that lie in neither layer, turned outwards, and the points they hold."""
    kept = np.empty((len(tets), 4), np.int64)
    sides = np.empty((4 * len(tets), 3), np.int64)
    held = np.zeros(points, np.bool_)
    m = s = 0
    for t in range(len(tets)):
        if not inside[t]:
            continue
        for k in range(4):
            kept[m, k] = tets[t, k]
            held[tets[t, k]] = True
            u = across[t, k]
            if u >= 0 and inside[u]:
                continue
            a, b, c = tets[t, (k + 1) & 3], tets[t, (k + 2) & 3], tets[t, (k + 3) & 3]
            if (a < lower) == (b < lower) and (b < lower) == (c < lower):
                continue
            if k & 1 == 0:  # the three corners after an even one turn inwards seen from it
                sides[s, 0], sides[s, 1], sides[s, 2] = a, b, c
            else:
                sides[s, 0], sides[s, 1], sides[s, 2] = a, c, b
            s += 1
        m += 1
    return kept[:m].copy(), sides[:s].copy(), held
