"""The slab between two layers: the Delaunay tetrahedra that lie in both regions' neighbourhood.

The 3D Delaunay tetrahedra of points in two parallel planes are the cells of the overlay of the two layers'
Voronoi diagrams. A tetrahedron with three points in one layer is a Delaunay triangle there and, in the other, the
point nearest to the triangle's circumcentre; one with two points in each is a pair of Delaunay edges whose Voronoi
edges cross. Only those are made that touch a region.

Each tetrahedron has a merge threshold f(T) as in the seed paper, Section 2.2.1, decided by where the centre
of its empty sphere lies: inside both regions 0; inside one region 1, or 2 if both its edges are segments of curves.
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from .triangulation import Region

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


def slab_tetrahedra(lower: Region, upper: Region, cell: float) -> Indices:
    """Tetrahedra of the solid between two layers.

    Args:
        lower, upper: regions of neighbouring layers, in a common frame.
        cell: width of the search grid, mm; about the resolution.

    Returns:
        shape (m, 4); indices below len(lower) are the lower layer's points, the others, less len(lower), the upper's.
    """
    if not len(lower) or not len(upper):
        return np.zeros((0, 4), np.int64)
    n = len(lower)
    above = np.asarray(cKDTree(upper.jittered).query(lower.centers)[1], dtype=np.int64)
    below = np.asarray(cKDTree(lower.jittered).query(upper.centers)[1], dtype=np.int64)
    up = _in_sector(upper.jittered, upper.following, upper.previous, above, lower.centers)
    down = _in_sector(lower.jittered, lower.following, lower.previous, below, upper.centers)
    corner = np.minimum(lower.jittered.min(axis=0), upper.jittered.min(axis=0)) - cell
    extent = np.maximum(lower.jittered.max(axis=0), upper.jittered.max(axis=0)) + cell - corner
    edges, threshold = _crossings(
        lower.edges, lower.duals, lower.native, lower.border,
        upper.edges, upper.duals, upper.native, upper.border,
        corner, extent, cell,
    )  # fmt: skip
    edges[:, 2:] += n
    tets = np.concatenate(
        [np.column_stack([lower.triangles, above + n]), np.column_stack([upper.triangles + n, below]), edges]
    )
    thresholds = np.concatenate([np.where(up, 0, 1), np.where(down, 0, 1), threshold]).astype(np.int8)
    return np.ascontiguousarray(tets[merge(thresholds, neighbours(tets, n + len(upper)))])


def neighbours(tets: Indices, points: int) -> Indices:
    """For each tetrahedron and corner the tetrahedron across the face opposite to it, or -1; shape (m, 4)."""
    faces = np.sort(tets[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    key = (faces[:, 0] * points + faces[:, 1]) * points + faces[:, 2]
    order = np.argsort(key, kind="stable")
    twin = np.flatnonzero(key[order[1:]] == key[order[:-1]])
    across = np.full(len(key), -1, np.int64)
    across[order[twin]] = order[twin + 1] // 4
    across[order[twin + 1]] = order[twin] // 4
    return across.reshape(-1, 4)


@nb.njit(cache=True)
def merge(threshold: npt.NDArray[np.int8], across: Indices) -> npt.NDArray[np.bool_]:
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


@nb.njit(cache=True)
def _in_sector(
    points: Array, following: Indices, previous: Indices, vertex: Indices, places: Array
) -> npt.NDArray[np.bool_]:
    """Whether each place lies in the interior sector at its vertex ("covers", seed paper, Figure 4).

    Exact for the vertex nearest to the place, since with Gabriel edges only its own two segments bound the
    region inside its Voronoi cell.
    """
    result = np.empty(len(places), np.bool_)
    for i in range(len(places)):
        v = vertex[i]
        ax, ay = points[following[v], 0] - points[v, 0], points[following[v], 1] - points[v, 1]
        cx, cy = points[previous[v], 0] - points[v, 0], points[previous[v], 1] - points[v, 1]
        bx, by = places[i, 0] - points[v, 0], places[i, 1] - points[v, 1]
        left_of_following = ax * by - ay * bx >= 0
        right_of_previous = bx * cy - by * cx >= 0
        if ax * cy - ay * cx > 0:
            result[i] = left_of_following and right_of_previous
        else:
            result[i] = left_of_following or right_of_previous
    return result


@nb.njit(cache=True)
def _clip(dual: Array, extent: Array) -> tuple[float, float]:
    """The part [t0, t1] of a segment inside the box from (0, 0) to `extent`; t0 > t1 if there is none."""
    t0, t1 = 0.0, 1.0
    for axis in range(2):
        start, step = dual[axis], dual[axis + 2] - dual[axis]
        if step == 0.0:
            if start < 0.0 or start > extent[axis]:
                return 1.0, 0.0
            continue
        enter, leave = -start / step, (extent[axis] - start) / step
        if enter > leave:
            enter, leave = leave, enter
        t0, t1 = max(t0, enter), min(t1, leave)
    return t0, t1


@nb.njit(cache=True)
def _cells(dual: Array, t0: float, t1: float, cell: float, nx: int, ny: int, out: Indices) -> int:
    """Grid cells that a segment's part [t0, t1] passes, row by row, with a margin; returns their number."""
    ax, ay = dual[0] + t0 * (dual[2] - dual[0]), dual[1] + t0 * (dual[3] - dual[1])
    bx, by = dual[0] + t1 * (dual[2] - dual[0]), dual[1] + t1 * (dual[3] - dual[1])
    if ay > by:
        ax, ay, bx, by = bx, by, ax, ay
    margin = 1e-6 * cell
    count = 0
    rise = by - ay
    for row in range(max(0, int((ay - margin) / cell)), min(ny - 1, int((by + margin) / cell)) + 1):
        if rise < 1e-9 * cell:
            left, right = min(ax, bx), max(ax, bx)
        else:
            enter = max(0.0, (row * cell - margin - ay) / rise)
            leave = min(1.0, ((row + 1) * cell + margin - ay) / rise)
            left, right = ax + enter * (bx - ax), ax + leave * (bx - ax)
            if left > right:
                left, right = right, left
        for column in range(
            max(0, int((left - margin) / cell)), min(nx - 1, int((right + margin) / cell)) + 1
        ):
            out[count] = row * nx + column
            count += 1
    return count


@nb.njit(cache=True)
def _crossings(
    edges_a: Indices, duals_a: Array, native_a: npt.NDArray[np.bool_], border_a: Array,
    edges_b: Indices, duals_b: Array, native_b: npt.NDArray[np.bool_], border_b: Array,
    corner: Array, extent: Array, cell: float,
) -> tuple[Indices, npt.NDArray[np.int8]]:  # fmt: skip
    """Pairs of edges whose Voronoi edges cross, shape (m, 4), and their merge thresholds; outside both: never."""
    nx, ny = int(extent[0] / cell) + 1, int(extent[1] / cell) + 1
    shift = np.array([corner[0], corner[1], corner[0], corner[1]])
    A, B = duals_a - shift, duals_b - shift
    passed = np.empty(4 * (nx + ny) + 64, np.int64)
    start = np.zeros(nx * ny + 1, np.int64)
    for b in range(len(B)):
        t0, t1 = _clip(B[b], extent)
        if t0 <= t1:
            for k in range(_cells(B[b], t0, t1, cell, nx, ny, passed)):
                start[passed[k] + 1] += 1
    for k in range(nx * ny):
        start[k + 1] += start[k]
    fill = start[:-1].copy()
    listed = np.empty(start[-1], np.int64)
    for b in range(len(B)):
        t0, t1 = _clip(B[b], extent)
        if t0 <= t1:
            for k in range(_cells(B[b], t0, t1, cell, nx, ny, passed)):
                listed[fill[passed[k]]] = b
                fill[passed[k]] += 1
    capacity = 4 * (len(A) + len(B)) + 64
    pairs = np.empty((capacity, 4), np.int64)
    threshold = np.empty(capacity, np.int8)
    seen = np.full(len(B), -1, np.int64)
    m = 0
    for a in range(len(A)):
        t0, t1 = _clip(A[a], extent)
        if t0 > t1:
            continue
        px, py, rx, ry = A[a, 0], A[a, 1], A[a, 2] - A[a, 0], A[a, 3] - A[a, 1]
        for k in range(_cells(A[a], t0, t1, cell, nx, ny, passed)):
            for slot in range(start[passed[k]], start[passed[k] + 1]):
                b = listed[slot]
                if seen[b] == a:
                    continue
                seen[b] = a
                qx, qy, sx, sy = B[b, 0], B[b, 1], B[b, 2] - B[b, 0], B[b, 3] - B[b, 1]
                d = rx * sy - ry * sx
                if d == 0.0:
                    continue
                t = ((qx - px) * sy - (qy - py) * sx) / d
                u = ((qx - px) * ry - (qy - py) * rx) / d
                if t < 0.0 or t >= 1.0 or u < 0.0 or u >= 1.0:
                    continue
                in_a, in_b = t < border_a[a], u < border_b[b]
                both_native = native_a[a] and native_b[b]
                if both_native and not in_a and not in_b:
                    continue
                if m == capacity:
                    capacity *= 2
                    more = np.empty((capacity, 4), np.int64)
                    more[:m] = pairs
                    pairs = more
                    wider = np.empty(capacity, np.int8)
                    wider[:m] = threshold
                    threshold = wider
                pairs[m, 0], pairs[m, 1] = edges_a[a, 0], edges_a[a, 1]
                pairs[m, 2], pairs[m, 3] = edges_b[b, 0], edges_b[b, 1]
                threshold[m] = 0 if in_a and in_b else (2 if both_native else 1)
                m += 1
    return pairs[:m].copy(), threshold[:m].copy()
