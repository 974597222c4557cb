"""Measures of slabs and surfaces: what a slab holds, how it hangs together, and how the surface there does."""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

from .overlay import Slab
from .triangulation import Region

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


def triangle_areas(region: Region) -> Array:
    """Of a region's triangles, mm², shape (k,)."""
    return 0.5 * _double_areas(region.points, region.triangles)


def region_area(region: Region) -> float:
    """mm²."""
    return float(triangle_areas(region).sum())


def slab_volume(lower: Region, upper: Region, slab: Slab) -> float:
    """Volume of a slab of height 1 mm, mm³."""
    points = np.concatenate([lower.points, upper.points])
    return _volume(points, slab.tets, slab.lower)


def region_characteristic(region: Region) -> int:
    """Euler characteristic of a region: parts less holes."""
    return (len(region) - len(region.triangles)) // 2


def slab_characteristic(lower: Region, upper: Region, slab: Slab) -> int:
    """Euler characteristic of the solid between two regions, both included."""
    if not len(lower) or not len(upper):
        return region_characteristic(lower) + region_characteristic(upper)
    # Points, edges and triangles in the two sections, then what lies between them.
    flat = region_characteristic(lower) + region_characteristic(upper)
    edges = _cross_edges(slab.tets, slab.lower)
    open_faces = len(slab.sides) + int(slab.under.sum()) + int(slab.over.sum())
    faces = (4 * len(slab.tets) + open_faces) // 2 - int(slab.under.sum()) - int(slab.over.sum())
    return flat - edges + faces - len(slab.tets)


def slab_sheets(lower: Region, upper: Region, slab: Slab) -> int:
    """The number of pieces of a slab's boundary between its sections; parts of sections left bare belong to it."""
    n = slab.lower
    bare = [lower.triangles[~slab.under], upper.triangles[~slab.over] + n]
    return int(_sheets(np.concatenate([slab.sides, *bare]), n + len(upper)))


@nb.njit(cache=True, nogil=True)
def _root(parent: Indices, i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@nb.njit(cache=True, nogil=True)
def _sheets(faces: Indices, points: int) -> int:
    """The number of sets of faces that edges link."""
    parent = np.arange(len(faces))
    start = np.zeros(points + 1, np.int64)
    for f in range(len(faces)):
        for k in range(3):
            start[min(faces[f, k], faces[f, (k + 1) % 3]) + 1] += 1
    for v in range(points):
        start[v + 1] += start[v]
    fill = start[:-1].copy()
    waiting = np.empty((3 * len(faces), 2), np.int64)
    for f in range(len(faces)):
        for k in range(3):
            a, b = faces[f, k], faces[f, (k + 1) % 3]
            low, high = min(a, b), max(a, b)
            for slot in range(start[low], fill[low]):
                if waiting[slot, 0] == high:
                    parent[_root(parent, f)] = _root(parent, waiting[slot, 1])
            waiting[fill[low], 0], waiting[fill[low], 1] = high, f
            fill[low] += 1
    count = 0
    for f in range(len(faces)):
        count += parent[f] == f
    return count


@nb.njit(cache=True, nogil=True)
def sheets_of_surface(faces: Indices, across: Indices, level: Indices, gaps: int) -> Indices:
    """For each gap between heights the number of pieces of a surface in it; level[v] is the gap of a vertex."""
    m = len(faces)
    low = np.empty(m, np.int64)
    start = np.empty(m + 1, np.int64)
    start[0] = 0
    for f in range(m):
        a, b, c = level[faces[f, 0]], level[faces[f, 1]], level[faces[f, 2]]
        low[f] = min(a, b, c)
        start[f + 1] = start[f] + max(a, b, c) - low[f] + 1
    parent = np.arange(start[m])
    for h in range(3 * m):
        if across[h] < h:
            continue
        f, g = h // 3, across[h] // 3
        a, b = level[faces[f, h % 3]], level[faces[f, (h % 3 + 1) % 3]]
        for gap in range(min(a, b), max(a, b) + 1):
            parent[_root(parent, start[f] + gap - low[f])] = _root(parent, start[g] + gap - low[g])
    count = np.zeros(gaps, np.int64)
    for f in range(m):
        for i in range(start[f], start[f + 1]):
            if parent[i] == i:
                count[low[f] + i - start[f]] += 1
    return count


@nb.njit(cache=True, nogil=True)
def _double_areas(points: Array, triangles: Indices) -> Array:
    areas = np.empty(len(triangles))
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        areas[t] = (points[b, 0] - points[a, 0]) * (points[c, 1] - points[a, 1]) - (
            points[b, 1] - points[a, 1]
        ) * (points[c, 0] - points[a, 0])
    return areas


@nb.njit(cache=True, nogil=True)
def _volume(points: Array, tets: Indices, lower: int) -> float:
    total = 0.0
    corner = np.empty((4, 3))
    for t in range(len(tets)):
        for k in range(4):
            v = tets[t, k]
            corner[k, 0], corner[k, 1], corner[k, 2] = points[v, 0], points[v, 1], 0.0 if v < lower else 1.0
        for k in range(1, 4):
            for d in range(3):
                corner[k, d] -= corner[0, d]
        a, b, c = corner[1], corner[2], corner[3]
        total += (
            a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
        )
    return total / 6.0


@nb.njit(cache=True, nogil=True)
def _cross_edges(tets: Indices, lower: int) -> int:
    """The number of edges between the two layers of a slab."""
    start = np.zeros(lower + 1, np.int64)
    for t in range(len(tets)):
        for i in range(4):
            for j in range(4):
                if tets[t, i] < lower <= tets[t, j]:
                    start[tets[t, i] + 1] += 1
    for v in range(lower):
        start[v + 1] += start[v]
    fill = start[:-1].copy()
    seen = np.empty(start[lower], np.int64)
    count = 0
    for t in range(len(tets)):
        for i in range(4):
            for j in range(4):
                v, w = tets[t, i], tets[t, j]
                if v < lower <= w:
                    known = False
                    for slot in range(start[v], fill[v]):
                        if seen[slot] == w:
                            known = True
                            break
                    if not known:
                        seen[fill[v]] = w
                        fill[v] += 1
                        count += 1
    return count


@nb.njit(cache=True, nogil=True)
def vertex_indices(faces: Indices, rank: Indices) -> Array:
    """Banchoff's index of each vertex by a height that no two share."""
    index = np.ones(len(rank))
    for f in range(len(faces)):
        a, b, c = rank[faces[f, 0]], rank[faces[f, 1]], rank[faces[f, 2]]
        middle = 0 if (a > b) != (a > c) else (1 if (b > a) != (b > c) else 2)
        index[faces[f, middle]] -= 0.5
    return index
