"""Refinement: more sections where the layers alone do not show how the part hangs together.

Two layers cannot tell a hollow that lies between them, or an arm that leaves a wall there. The surface can: by Morse's
count, the Euler characteristic of the solid between two sections is half the sum of the sections' and of the indices of
the vertices between them (Banchoff's index of a vertex: 1 less half the number of its triangles in which it is the
middle one by height). Where the slab found has another one, true sections of the surface are inserted.

So they are where a slab holds much less or more than its two regions let expect, because a thin wall leans by nearly
its width from layer to layer, if they make a difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import pairwise

import numba as nb
import numpy as np
import numpy.typing as npt
import trimesh

from .cutter import SurfaceCutter
from .errors import ToolpathError
from .frames import Frames
from .half_edges import opposite_half_edges
from .memo import Memo
from .overlay import Slab, slab_between
from .sampling import sample_layer
from .triangulation import Lattice, Region, triangulate

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

DEPTH = 7
"""How often a gap between two layers is divided at most."""

ASIDE = (-0.01, 0.01, -0.1, 0.1)
"""Where else a section is tried, from where it was wanted, as shares of the gap that it divides."""

LEAN = 0.01
"""Deviation of a slab's volume from the mean of its regions from which a section is tried, as a share."""

LEAN_DEPTH = 3
"""How often a gap is divided at most for its volume."""


@dataclass(frozen=True, eq=False)
class Section:
    """A region at a height.

    Attributes:
        w: mm at the nominal thickness.
        region: may be empty.
    """

    w: float
    region: Region


class Truth:
    """What a surface says about the solid between two heights.

    Attributes:
        low, high: heights between which all of the surface lies, w in mm.
        top: height of the last nozzle plane, w in mm.
        box: least u, v and greatest u, v of the surface, mm: its sections may reach further than the layers.
    """

    def __init__(self, surface: trimesh.Trimesh, frames: Frames) -> None:
        vertices = np.asarray(surface.vertices, dtype=np.float64)
        self._frames = frames
        self.top = frames.top
        self._cutter = SurfaceCutter(vertices, surface.faces)
        self._faces = np.ascontiguousarray(surface.faces, dtype=np.int64)
        self._across = np.asarray(opposite_half_edges(self._faces, len(vertices)), dtype=np.int64)
        self._height = frames.height_of(vertices)
        rows = frames.at(self._height)
        shifted = vertices - rows[:, 0]
        uv = np.einsum("nk,nak->na", shifted, rows[:, 1:]) / np.einsum(
            "nak,nak->na", rows[:, 1:], rows[:, 1:]
        )
        (a, b), (c, d) = uv.min(axis=0).tolist(), uv.max(axis=0).tolist()
        self.box: tuple[float, float, float, float] = (a, b, c, d)
        order = np.argsort(self._height, kind="stable")
        rank = np.empty(len(order), np.int64)
        rank[order] = np.arange(len(order))
        index = _vertex_indices(self._faces, rank)[order]
        self._sorted = self._height[order]
        self._sum = np.concatenate([[0.0], np.cumsum(index)])
        self._critical = self._sorted[index != 0.0]
        self.low, self.high = float(self._sorted[0]), float(np.nextafter(self._sorted[-1], np.inf))

    def characteristic(self, lower: Section, upper: Section) -> float:
        """Euler characteristic of the solid between two sections of the surface, both included."""
        low, high = np.searchsorted(self._sorted, [lower.w, upper.w])
        between = self._sum[high] - self._sum[low]
        return 0.5 * float(
            between + region_characteristic(lower.region) + region_characteristic(upper.region)
        )

    def sheets(self, heights: Sequence[float]) -> Indices:
        """The number of pieces of the surface between each two neighbouring heights, ascending; shape (k - 1,)."""
        level = np.searchsorted(np.asarray(heights), self._height, side="right")
        return _sheets_of_surface(self._faces, self._across, level, len(heights) + 1)[1:-1]

    def divide(self, low: float, high: float) -> float:
        """Where to cut next between two heights: amid the critical vertices, or in the middle."""
        critical = self._critical[slice(*np.searchsorted(self._critical, [low, high]))]
        middle = 0.5 * (low + high)
        if len(critical) < 2:
            return middle
        gaps = np.diff(critical)
        # Far from vertices at which sections would nearly touch, and near the median, to end soon.
        share = (np.arange(len(gaps)) + 1.0) / len(critical)
        best = int(np.argmax(gaps * share * (1.0 - share)))
        found = 0.5 * (critical[best] + critical[best + 1])
        margin = 0.02 * (high - low)
        return float(found) if low + margin < found < high - margin else middle

    def sections(
        self, heights: Sequence[float], margins: Sequence[float], lattice: Lattice, resolution: float
    ) -> list[Section | None]:
        """True sections of the surface, sampled, at ascending heights.

        Where a section's curves touch, one a little below or above is taken, within the margin; None if none is found.
        """
        rows = self._frames.at(np.asarray(heights))
        stack = self._cutter.cut_frames(rows[:, 0], rows[:, 1], rows[:, 2])
        found: list[Section | None] = []
        for w, margin, polygons in zip(heights, margins, stack, strict=True):
            section = _section(w, polygons, lattice, resolution)
            for share in ASIDE:
                if section is not None:
                    break
                row = self._frames.at(w + share * margin)
                section = _section(
                    w + share * margin, self._cutter.cut_frames(*row[0])[0], lattice, resolution
                )
            found.append(section)
        return found


def _section(w: float, polygons: Sequence[Array], lattice: Lattice, resolution: float) -> Section | None:
    try:
        return Section(w, triangulate(sample_layer(polygons, resolution), lattice, resolution, ""))
    except ToolpathError:
        return None


Gap = tuple[Section, Section]


@dataclass(frozen=True, eq=False)
class Insertion:
    """What one gap between two layers needs.

    Attributes:
        sections: to be inserted.
        unresolved: gaps (low, high) in which the slabs still do not hang together as the surface does.
    """

    sections: tuple[Section, ...]
    unresolved: tuple[tuple[float, float], ...]


def refine(
    sections: Sequence[Section],
    edited: AbstractSet[int],
    truth: Truth,
    lattice: Lattice,
    resolution: float,
    memo: Memo,
    executor: Executor | None,
) -> tuple[list[Section], list[tuple[float, float]]]:
    """Sections with more between them until all slabs hang together as the surface does.

    Args:
        sections: those of the layers.
        edited: which of them are no longer sections of the surface; gaps beside them are left alone.
        truth: about the surface.
        lattice, resolution: see `triangulate`.
        memo: remembers what each gap needed.
        executor: works on gaps side by side.

    Returns:
        the sections, and the gaps (low, high; w in mm) in which they still do not.
    """
    nothing = memo.map(triangulate_nothing, [()])[0]
    inner = [
        (s, i in edited) for i, s in enumerate(sections) if truth.low < s.w < truth.high or len(s.region)
    ]
    # Above the last plane and below the base the part is cut off: there is nothing to be compared there.
    rounding = 1e-6 * truth.top
    bottom = [(Section(truth.low, nothing), False)] if truth.low >= -rounding else []
    top = [(Section(truth.high, nothing), False)] if truth.high <= truth.top + rounding else []
    chain = [*bottom, *inner, *top]
    gaps = [(a, b) for (a, p), (b, q) in pairwise(chain) if not (p or q)]
    keys = [(a.region, b.region, a.w, b.w, truth, lattice, resolution) for a, b in gaps]
    unknown = [i for i, key in enumerate(keys) if not memo.knows("insertion", key)]
    needed = _insertions([gaps[i] for i in unknown], truth, lattice, resolution, memo, executor)
    for i, insertion in zip(unknown, needed, strict=True):
        memo.store("insertion", keys[i], insertion)
    found: list[Insertion] = [memo.recall("insertion", key) for key in keys]
    inserted = [section for insertion in found for section in insertion.sections]
    unresolved = [gap for insertion in found for gap in insertion.unresolved]
    return sorted([*sections, *inserted], key=lambda section: section.w), unresolved


def _insertions(
    layers: Sequence[Gap],
    truth: Truth,
    lattice: Lattice,
    resolution: float,
    memo: Memo,
    executor: Executor | None,
) -> list[Insertion]:
    """Divide gaps between layers, all together, until nothing is wrong or their depth is spent."""
    kept: list[list[Section]] = [[] for _ in layers]
    unresolved: list[list[tuple[float, float]]] = [[] for _ in layers]
    gaps = list(enumerate(layers))
    for depth in range(DEPTH + 1):
        slabs = memo.map(slab_between, [(a.region, b.region) for _, (a, b) in gaps], executor)
        heights = sorted({s.w for _, gap in gaps for s in gap})
        sheets = dict(zip(heights, truth.sheets(heights).tolist(), strict=False))
        wrong: list[tuple[int, Gap]] = []
        lean: list[tuple[int, Gap]] = []
        for (owner, (a, b)), slab in zip(gaps, slabs, strict=True):
            if truth.characteristic(a, b) != slab_characteristic(a.region, b.region, slab) or (
                sheets[a.w] != slab_sheets(a.region, b.region, slab)
            ):
                wrong.append((owner, (a, b)))
            elif depth < LEAN_DEPTH and _is_lean(a, b, slab):
                lean.append((owner, (a, b)))
        if depth == DEPTH:
            for owner, (a, b) in wrong:
                unresolved[owner].append((a.w, b.w))
            break
        if not wrong and not lean:
            break
        at = [truth.divide(a.w, b.w) for _, (a, b) in wrong] + [0.5 * (a.w + b.w) for _, (a, b) in lean]
        order = np.argsort(at)
        margins = [b.w - a.w for _, (a, b) in [*wrong, *lean]]
        cuts = truth.sections([at[i] for i in order], [margins[i] for i in order], lattice, resolution)
        found = dict(zip(order.tolist(), cuts, strict=True))
        gaps = []
        for i, (owner, (a, b)) in enumerate([*wrong, *lean]):
            cut = found[i]
            if cut is None:
                unresolved[owner] += [(a.w, b.w)] if i < len(wrong) else []
            elif i < len(wrong) or _matters(a, cut, b, memo):
                kept[owner].append(cut)
                gaps += [(owner, (a, cut)), (owner, (cut, b))]
    return [Insertion(tuple(k), tuple(u)) for k, u in zip(kept, unresolved, strict=True)]


def triangulate_nothing() -> Region:
    """The empty region."""
    return triangulate([], Lattice((0.0, 0.0), 1.0), 1.0, "")


def _is_lean(lower: Section, upper: Section, slab: Slab) -> bool:
    """Whether a slab's volume is far from the mean of its regions' areas times its height."""
    if not len(lower.region) or not len(upper.region):
        return False
    expected = 0.5 * (region_area(lower.region) + region_area(upper.region))
    return abs(slab_volume(lower.region, upper.region, slab) - expected) > LEAN * expected


def _matters(lower: Section, middle: Section, upper: Section, memo: Memo) -> bool:
    """Whether two slabs with a section between them hold another volume than the one without."""
    one, two, slab = memo.map(
        slab_between,
        [(lower.region, middle.region), (middle.region, upper.region), (lower.region, upper.region)],
    )
    halves = 0.5 * (
        slab_volume(lower.region, middle.region, one) + slab_volume(middle.region, upper.region, two)
    )
    expected = 0.5 * (region_area(lower.region) + region_area(upper.region))
    return abs(halves - slab_volume(lower.region, upper.region, slab)) > 0.5 * LEAN * expected


def region_area(region: Region) -> float:
    """mm²."""
    return float(_double_areas(region.points, region.triangles).sum()) * 0.5


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
def _sheets_of_surface(faces: Indices, across: Indices, level: Indices, gaps: int) -> Indices:
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
def _vertex_indices(faces: Indices, rank: Indices) -> Array:
    """Banchoff's index of each vertex by a height that no two share."""
    index = np.ones(len(rank))
    for f in range(len(faces)):
        a, b, c = rank[faces[f, 0]], rank[faces[f, 1]], rank[faces[f, 2]]
        middle = 0 if (a > b) != (a > c) else (1 if (b > a) != (b > c) else 2)
        index[faces[f, middle]] -= 0.5
    return index
