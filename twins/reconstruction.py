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

from .boundary import Block, Faces, Seam, block, block_faces, seam, slab_faces
from .errors import ToolpathError
from .frames import Frames
from .interior import interior_points
from .joining import Join, clusters, join
from .memo import Memo
from .overlay import Slab, slab_between
from .refinement import Section, Truth, refine
from .surface import make_surface
from .toolpath import Curve, Plane, Toolpath
from .triangulation import Lattice, Region, triangulate

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

BUNDLE = 16
"""Sections put together at a time."""

EPSILON = 2e-3
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
        joins: places at which the solid touched itself and points were added or moved, by at most 0.003 t; (k, 3), mm.
        unresolved: gaps (low, high; w in mm) in which M does not hang together as the surface does.
        solid: whose boundary M is.
    """

    surface: trimesh.Trimesh
    joins: Array
    unresolved: tuple[tuple[float, float], ...]
    solid: Solid


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
    step = toolpath.thickness if resolution is None else float(resolution)
    memo = Memo() if memo is None else memo
    try:
        body, unresolved = _solid(toolpath, step, surface, edited, interior, memo, executor)
        mesh, joins = _boundary(body, EPSILON * toolpath.thickness, memo, executor)
    except BaseException:
        memo.abandon_round()
        raise
    memo.end_round()
    return ToolpathMesh(mesh, joins, tuple(unresolved), body)


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
    boxes = memo.map(_bounds, [(layer.curves, i) for i, layer in enumerate(toolpath.layers) if layer.curves])
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


def _boundary(
    body: Solid, epsilon: float, memo: Memo, executor: Executor | None
) -> tuple[trimesh.Trimesh, Array]:
    blocks, frames = body.blocks, body.frames
    beside = [None, *body.slabs, None]
    size = [0, *(len(b.points) for b in blocks), 0]
    seams = memo.map(
        seam, [(b, beside[i], beside[i + 1], size[i], size[i + 2]) for i, b in enumerate(blocks)], executor
    )
    none = Faces(np.zeros((0, 3), np.int64), np.zeros((0, 3), np.int64))
    between = [i for i, s in enumerate(body.slabs) if s is not None]
    sides = [none] * len(blocks)
    found = memo.map(slab_faces, [(body.slabs[i], seams[i], seams[i + 1]) for i in between])
    for i, side in zip(between, found, strict=True):
        sides[i] = side
    own = memo.map(block_faces, list(zip(blocks, seams, strict=True)))
    points = memo.map(_places, list(zip(blocks, seams, [frames] * len(blocks), strict=True)))
    bundles = memo.map(
        _bundled,
        [
            (*points[i : i + BUNDLE], *own[i : i + BUNDLE], *sides[i : i + BUNDLE])
            for i in range(0, len(blocks), BUNDLE)
        ],
    )
    places = [bundle.points for bundle in bundles]
    start = np.cumsum([0, *(len(p) for p in places)]).tolist()
    rows = [(start[k], bundle.free) for k, bundle in enumerate(bundles)]
    held = [bundle.crowded + start[k] for k, bundle in enumerate(bundles) if len(bundle.crowded)]
    joins = np.zeros((0, 3))
    if held:
        first = np.cumsum([0, *(len(s.kept) for s in seams)])
        pieces = np.concatenate([s.pieces for s in seams])
        joined, added = _joined(np.concatenate(held), body, seams, first, pieces, epsilon, memo)
        rows += [(0, join_faces) for join_faces in joined]
        places.append(frames.to_world(np.concatenate(added)))
        joins = np.concatenate(
            [*(p.points[s.pieces > 0] for p, s in zip(points, seams, strict=True)), places[-1]]
        )
    faces = np.empty((sum(len(part) for _, part in rows), 3), np.int64)
    end = 0
    for offset, part in rows:
        begin, end = end, end + len(part)
        np.add(part, offset, out=faces[begin:end])
    vertices = np.concatenate(places)
    if held:
        vertices, faces = _compact(vertices, faces)
    return make_surface(vertices, faces), joins


@dataclass(frozen=True, eq=False)
class Bundle:
    """Points and faces of several neighbouring sections, with the slabs above them, numbered from their first point."""

    points: Array
    free: Indices
    crowded: Indices


def _bundled(*parts: Places | Faces) -> Bundle:
    """Bundle the places, own faces and upper sides of sections, given in three groups in this order.

    A long stack is put together from few bundles, so that an edit copies little piece by piece.
    """
    count = len(parts) // 3
    places = [part.points for part in parts[:count] if isinstance(part, Places)]
    faces = [part for part in parts[count:] if isinstance(part, Faces)]
    start = np.cumsum([0, *(len(p) for p in places)]).tolist()
    offset = start[:count] * 2
    return Bundle(
        np.concatenate(places),
        np.concatenate([part.free + k for k, part in zip(offset, faces, strict=True)]),
        np.concatenate([part.crowded + k for k, part in zip(offset, faces, strict=True)]),
    )


def _joined(
    held: Indices,
    body: Solid,
    seams: Sequence[Seam],
    first: Indices,
    pieces: npt.NDArray[np.int8],
    epsilon: float,
    memo: Memo,
) -> tuple[list[Indices], list[Array]]:
    """The faces at crowded points after joining, and the points added behind all others (u, v, w)."""
    corners, local = np.unique(held, return_inverse=True)
    owner = np.searchsorted(first, corners, side="right") - 1
    coordinates = np.array(
        [body.blocks[b].points[seams[b].kept[i]] for b, i in zip(owner, corners - first[owner], strict=True)]
    )
    count = pieces[corners]
    local = local.reshape(held.shape)
    calls, numbers = [], []
    for group in clusters(local, count > 0):
        own, small = np.unique(local[group], return_inverse=True)
        numbers.append(corners[own])
        calls.append(
            (coordinates[own].tobytes(), small.astype(np.int64).tobytes(), count[own].tobytes(), epsilon)
        )
    faces, added = [], []
    total = len(pieces)
    for number, result in zip(numbers, memo.map(_join, calls), strict=True):
        rows = np.concatenate([number, np.arange(total, total + len(result.points))])[result.faces]
        faces.append(rows)
        added.append(result.points)
        total += len(result.points)
    return faces, added


def _join(points: bytes, faces: bytes, pieces: bytes, epsilon: float) -> Join:
    count = np.frombuffer(pieces, np.int8)
    return join(
        np.frombuffer(points).reshape(-1, 3),
        np.frombuffer(faces, np.int64).reshape(-1, 3),
        np.flatnonzero(count),
        lambda v: int(count[v]) if v < len(count) else 1,
        epsilon,
    )


def _compact(points: Array, faces: Indices) -> tuple[Array, Indices]:
    """Without the points that joining has cut off."""
    used = np.zeros(len(points), np.bool_)
    used[faces.reshape(-1)] = True
    if used.all():
        return points, faces
    number = np.cumsum(used) - 1
    return points[used], number[faces]


@dataclass(frozen=True, eq=False)
class Places:
    """World places of points, shape (n, 3), mm."""

    points: Array


def _places(here: Block, at: Seam, frames: Frames) -> Places:
    """World places of a block's kept points."""
    return Places(frames.to_world(here.points[at.kept]))


def _frames(step: float, *planes: Plane) -> Frames:
    return Frames(planes, step)


def _bounds(curves: Sequence[Curve], layer: int) -> tuple[float, float, float, float]:
    """The box around a layer's curves: least u, v and greatest u, v."""
    for curve in curves:
        if not curve.closed:
            raise ToolpathError(f"layer {layer}: an open curve bounds no solid; close it first")
    points = np.concatenate([curve.points for curve in curves])
    (a, b), (c, d) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
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
