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
from .slab_measures import (
    region_area,
    region_characteristic,
    sheets_of_surface,
    slab_characteristic,
    slab_sheets,
    slab_volume,
    vertex_indices,
)
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
        self._height = self._as_cut(frames.height_of(vertices), frames)
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
        index = vertex_indices(self._faces, rank)[order]
        self._sorted = self._height[order]
        self._sum = np.concatenate([[0.0], np.cumsum(index)])
        self._critical = self._sorted[index != 0.0]
        self.low, self.high = float(self._sorted[0]), float(np.nextafter(self._sorted[-1], np.inf))

    def _as_cut(self, height: Array, frames: Frames) -> Array:
        """Heights on the side of each slicing plane on which the cutter has the vertex."""
        w = frames.slicing
        rows = frames.at(w)
        level = self._cutter.levels(rows[:, 0], rows[:, 1], rows[:, 2])
        least = np.append(-np.inf, w)[level]
        below = np.append(np.nextafter(w, -np.inf), np.inf)[level]
        return np.asarray(np.clip(height, least, below), dtype=np.float64)

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
        return sheets_of_surface(self._faces, self._across, level, len(heights) + 1)[1:-1]

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
