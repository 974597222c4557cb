"""Reconstruction: a toolpath becomes a surface, the toolpath mesh M (seed paper, Section 2.2).

The solid between two layers is a set of tetrahedra (`overlay.py`); the first and last layer of each body are carried
straight on by half a layer, to the base or nozzle plane; and M is the boundary of all of them (`boundary.py`). Caps
come out by themselves, and closure does not depend on which tetrahedra were chosen. Where the solid touches itself
in an edge or vertex the boundary is pulled apart (`joining.py`). Where the surface is known that the toolpath was
sliced from, sections are added until M hangs together as the surface does (`refinement.py`).

Connectivity is found in layer coordinates, as if all layers were parallel; `Frames` carries them to the world.
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

from .assembly import assemble
from .boundary import Block, block
from .entrances import checks_kinds
from .errors import ToolpathError
from .frames import Frames
from .interior import interior_points
from .memo import Memo
from .overlay import Slab, slab_between
from .refinement import Section, Truth, refine
from .slab_measures import triangle_areas
from .slicing import check_resolution
from .toolpath import Curve, Layer, Plane, Toolpath
from .triangulation import Lattice, Region, triangulate

Array = npt.NDArray[np.float64]

EPSILON = 7.5e-4
"""How far joins move points, as a share of the layer thickness."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A stack of sections with what lies between them: a conforming tetrahedral mesh of the part.

    Attributes:
        sections: from the bottom up.
        blocks: one a section.
        slabs: between sections; None beside an empty one.
        frames: to the world.
    """

    sections: tuple[Section, ...]
    blocks: tuple[Block, ...]
    slabs: tuple[Slab | None, ...]
    frames: Frames


@dataclass(frozen=True, eq=False)
class ToolpathMesh:
    """The toolpath mesh M and how it came about.

    Attributes:
        surface: closed, oriented outwards, every edge with two faces, every vertex with one fan.
        joins: places at which the solid touched itself and points were added or moved, there M is within 0.003 t of
            the curves; (k, 3), mm.
        unresolved: gaps (low, high; w in mm) in which M does not hang together as the surface does.
        left_out: sections (w in mm) and the area of theirs, mm², that M leaves out: it sticks out of the sections
            above and below so far that neither reaches over it.
        solid: whose boundary M is.
    """

    surface: trimesh.Trimesh
    joins: Array
    unresolved: tuple[tuple[float, float], ...]
    left_out: tuple[tuple[float, float], ...]
    solid: Solid

    @property
    def remarks(self) -> tuple[str, ...]:
        """A sentence for each layer whose curves M does not follow, or in which it differs from the surface."""
        t = self.solid.frames.thickness
        apart = sorted({int(low / t) for low, _ in self.unresolved})
        bare: dict[int, float] = {}
        for w, area in self.left_out:
            bare[int(w / t)] = max(bare.get(int(w / t), 0.0), area)
        return (
            *(
                f"layer {i}: M does not hang together there as the surface does; slice finer to show it"
                for i in apart
            ),
            *(
                f"layer {i}: M leaves out {area:.3g} mm² of it that sticks out of the layers above and below; "
                "use thinner layers there, or give the surface if it is known"
                for i, area in bare.items()
            ),
        )


@checks_kinds
def reconstruct(
    toolpath: Toolpath,
    resolution: float | None = None,
    surface: trimesh.Trimesh | None = None,
    executor: Executor | None = None,
) -> trimesh.Trimesh:
    """The toolpath mesh M: a closed, outward oriented 2-manifold through the curves.

    Args:
        toolpath: closed curves, interior left.
        resolution: L_R that the curves were sampled with, mm; default the layer thickness.
        surface: that the toolpath was sliced from, if it is known.
        executor: works on layers side by side.

    Raises:
        ToolpathError: no curves, open curves, or curves of a layer that touch or cross.
    """
    return toolpath_mesh(toolpath, resolution, surface, executor=executor).surface


@checks_kinds
def toolpath_mesh(
    toolpath: Toolpath,
    resolution: float | None = None,
    surface: trimesh.Trimesh | None = None,
    *,
    edited: AbstractSet[int] = frozenset(),
    interior: float | None = None,
    memo: Memo | None = None,
    executor: Executor | None = None,
) -> ToolpathMesh:
    """M with its solid and its joins.

    Args:
        toolpath, resolution, surface, executor: see `reconstruct`.
        edited: layers that are no longer sections of the surface.
        interior: spacing of points to be added inside the regions, mm; they do not change M but refine its solid.
        memo: with it, only what has changed since the last call is built again.
    """
    check_resolution(resolution)
    step = toolpath.thickness if resolution is None else float(resolution)
    memo = Memo() if memo is None else memo
    try:
        body, unresolved = _solid(toolpath, step, surface, edited, interior, memo, executor)
        t = toolpath.thickness
        levels = [section.w / t for section in body.sections]
        mesh, joins = assemble(body.blocks, body.slabs, levels, body.frames, EPSILON * t, memo, executor)
    except BaseException:
        memo.abandon_round()
        raise
    memo.end_round()
    left_out = [
        (section.w, float(triangle_areas(section.region)[block.left_out].sum()))
        for section, block in zip(body.sections, body.blocks, strict=True)
        if len(block.left_out)
    ]
    return ToolpathMesh(mesh, joins, tuple(unresolved), tuple(left_out), body)


def _solid(
    toolpath: Toolpath,
    resolution: float,
    surface: trimesh.Trimesh | None,
    edited: AbstractSet[int],
    interior: float | None,
    memo: Memo,
    executor: Executor | None,
) -> tuple[Solid, list[tuple[float, float]]]:
    t = toolpath.thickness
    planes = (plane for layer in toolpath.layers for plane in (layer.slicing, layer.nozzle))
    frames = memo.map(_frames, [(0.5 * t, toolpath.base, *planes)])[0]
    boxes = memo.map(
        _bounds, [(layer, toolpath.floor_of(i), i) for i, layer in enumerate(toolpath.layers) if layer.curves]
    )
    if not boxes:
        raise ToolpathError("the toolpath has no curves: there is nothing to reconstruct")
    truth = None if surface is None else memo.map(Truth, [(surface, frames)])[0]
    extent = np.array(boxes if truth is None else [*boxes, truth.box])
    lattice = Lattice.around(extent[:, :2].min(axis=0), extent[:, 2:].max(axis=0))
    u, v = lattice.origin
    regions = memo.map(
        _region,
        [
            (layer.curves, u, v, lattice.unit, resolution, i, interior)
            for i, layer in enumerate(toolpath.layers)
        ],
        executor,
    )
    sections = [Section((i + 0.5) * t, region) for i, region in enumerate(regions)]
    unresolved: list[tuple[float, float]] = []
    if truth is not None:
        sections, unresolved = refine(sections, edited, truth, lattice, resolution, memo, executor)
    slabs = _slabs(sections, memo, executor)
    beside = [None, *slabs, None]
    w = [section.w for section in sections]
    down = [0.0, *((a + b) / 2.0 for a, b in pairwise(w))]
    up = [*((a + b) / 2.0 for a, b in pairwise(w)), frames.top]
    blocks = memo.map(
        block,
        [(s.region, s.w, down[i], up[i], beside[i], beside[i + 1]) for i, s in enumerate(sections)],
        executor,
    )
    return Solid(tuple(sections), tuple(blocks), tuple(slabs), frames), unresolved


def _slabs(sections: Sequence[Section], memo: Memo, executor: Executor | None) -> list[Slab | None]:
    pairs = list(pairwise(section.region for section in sections))
    full = [i for i, (lower, upper) in enumerate(pairs) if len(lower) and len(upper)]
    slabs: list[Slab | None] = [None] * len(pairs)
    for i, slab in zip(full, memo.map(slab_between, [pairs[i] for i in full], executor), strict=True):
        slabs[i] = slab
    return slabs


def _frames(step: float, *planes: Plane) -> Frames:
    return Frames(planes, step)


def _bounds(layer: Layer, floor: Plane, number: int) -> tuple[float, float, float, float]:
    """The box around a layer's curves: least u, v and greatest u, v. There the layer's planes must be in order."""
    for curve in layer.curves:
        if not curve.closed:
            raise ToolpathError(
                f"layer {number}: an open curve bounds no solid; close it first (`close_within` of wrap)"
            )
    points = np.concatenate([curve.points for curve in layer.curves])
    (a, b), (c, d) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    corners = np.array([[a, b], [c, b], [c, d], [a, d]])
    middle, top = layer.slicing.to_world(corners), layer.nozzle.to_world(corners)
    if floor.height_of(middle).min() <= 0.0 or layer.slicing.height_of(top).min() <= 0.0:
        raise ToolpathError(
            f"layer {number}: its planes are not above those of the layer below; "
            "layers run from the bed up, each with its slicing plane below its nozzle plane"
        )
    return a, b, c, d


def _region(
    curves: Sequence[Curve],
    u: float,
    v: float,
    unit: float,
    resolution: float,
    layer: int,
    interior: float | None,
) -> Region:
    lines = [curve.points for curve in curves]
    inner = None if interior is None else interior_points(lines, interior, shifted=layer % 2 == 1)
    return triangulate(lines, Lattice((u, v), unit), resolution, f"layer {layer}", inner)
