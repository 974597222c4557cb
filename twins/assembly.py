"""Assembly: the boundaries of sections and slabs, put together as one mesh.

A long stack is put together from *bundles*, the sections of some layers with the slabs above them. One that an edit
does not touch is looked up and copied as a whole. Bundles end at fixed heights, so that a section more or less does
not move the others from one bundle to the next.

What the boundary has at crowded points is joined (`joining.py`) cluster by cluster and put behind.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import trimesh

from .boundary import Block, Seam, block_faces, seam, slab_faces
from .frames import Frames
from .joining import Join, clusters, join
from .memo import Memo
from .overlay import Slab
from .surface import make_surface

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

BUNDLE = 16
"""Layers in a bundle."""


@dataclass(frozen=True, eq=False)
class Bundle:
    """The boundary of neighbouring sections and the slabs above them, numbered from their first point.

    Attributes:
        points: world places, shape (n, 3), mm.
        free: faces away from crowded points, shape (k, 3).
        crowded: faces at them, shape (k, 3).
    """

    points: Array
    free: Indices
    crowded: Indices


def assemble(
    blocks: Sequence[Block],
    slabs: Sequence[Slab | None],
    levels: Sequence[float],
    frames: Frames,
    epsilon: float,
    memo: Memo,
    executor: Executor | None,
) -> tuple[trimesh.Trimesh, Array]:
    """The boundary of a stack as a closed 2-manifold, and the places at which it was joined, shape (k, 3), mm.

    Args:
        blocks: one a section, from the bottom up.
        slabs: between sections; None beside an empty one.
        levels: heights of the sections, in layers.
        frames: to the world.
        epsilon: how far joins move points, mm.
        memo: with what is known from before.
        executor: works on sections side by side.

    Raises:
        ToolpathError: the boundary cannot be made manifold; names the place.
    """
    beside = [None, *slabs, None]
    size = [0, *(len(b.points) for b in blocks), 0]
    seams = memo.map(
        seam, [(b, beside[i], beside[i + 1], size[i], size[i + 2]) for i, b in enumerate(blocks)], executor
    )
    bundles = memo.map_parts(
        _bundle,
        {
            k: (tuple(blocks[i:j]), tuple(slabs[i:j]), tuple(seams[i : j + 1]), frames)
            for k, (i, j) in enumerate(_spans(levels))
            if i < j
        },
    )
    places = [bundle.points for bundle in bundles]
    start = np.cumsum([0, *map(len, places)]).tolist()
    faces = [(first, bundle.free) for first, bundle in zip(start, bundles, strict=False)]
    held = [bundle.crowded + first for first, bundle in zip(start, bundles, strict=False)]
    if not any(map(len, held)):
        return make_surface(np.concatenate(places), _renumbered(faces)), np.zeros((0, 3))
    joined, added = _joined(np.concatenate(held), blocks, seams, epsilon, memo)
    points = np.concatenate([*places, frames.to_world(added)])
    moved = np.concatenate([*(s.pieces > 0 for s in seams), np.ones(len(added), np.bool_)])
    return make_surface(*_compact(points, _renumbered([*faces, (0, joined)]))), points[moved]


def _spans(levels: Sequence[float]) -> Iterator[tuple[int, int]]:
    """The first section of each bundle and the one after its last."""
    ends = np.arange(0.0, levels[-1] + BUNDLE, BUNDLE)
    return pairwise(np.searchsorted(levels, ends).tolist())


def _bundle(
    memo: Memo,
    blocks: Sequence[Block],
    slabs: Sequence[Slab | None],
    seams: Sequence[Seam],
    frames: Frames,
) -> Bundle:
    """The bundle of some sections; `seams` has that of the section above them, too, if there is one."""
    places = memo.map(_places, [(b, s, frames) for b, s in zip(blocks, seams, strict=False)])
    start = np.cumsum([0, *(len(p.points) for p in places)]).tolist()
    own = memo.map(block_faces, list(zip(blocks, seams, strict=False)))
    above = [i for i, slab in enumerate(slabs) if slab is not None]
    sides = memo.map(slab_faces, [(slabs[i], seams[i], seams[i + 1]) for i in above])
    faces = [
        *zip(start, own, strict=False),
        *((start[i], side) for i, side in zip(above, sides, strict=True)),
    ]
    return Bundle(
        np.concatenate([p.points for p in places]),
        _renumbered([(first, part.free) for first, part in faces]),
        _renumbered([(first, part.crowded) for first, part in faces]),
    )


def _renumbered(parts: Sequence[tuple[int, Indices]]) -> Indices:
    """Faces put together, each part with the number that its first point gets."""
    faces = np.empty((sum(len(part) for _, part in parts), 3), np.int64)
    end = 0
    for first, part in parts:
        begin, end = end, end + len(part)
        np.add(part, first, out=faces[begin:end])
    return faces


@dataclass(frozen=True, eq=False)
class Places:
    """World places of points, shape (n, 3), mm."""

    points: Array


def _places(here: Block, at: Seam, frames: Frames) -> Places:
    """World places of a block's kept points."""
    return Places(frames.to_world(here.points[at.kept]))


def _joined(
    held: Indices, blocks: Sequence[Block], seams: Sequence[Seam], epsilon: float, memo: Memo
) -> tuple[Indices, Array]:
    """The faces at crowded points after joining, and the points added behind all others (u, v, w)."""
    pieces = np.concatenate([s.pieces for s in seams])
    first = np.cumsum([0, *(len(s.kept) for s in seams)])
    corners, local = np.unique(held, return_inverse=True)
    local = local.reshape(held.shape)
    cuts = np.searchsorted(corners, first).tolist()
    coordinates = np.concatenate(
        [
            b.points[s.kept[corners[i:j] - k]]
            for b, s, k, (i, j) in zip(blocks, seams, first.tolist(), pairwise(cuts), strict=False)
            if i < j
        ]
    )
    count = pieces[corners]
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
        faces.append(np.concatenate([number, np.arange(total, total + len(result.points))])[result.faces])
        added.append(result.points)
        total += len(result.points)
    return np.concatenate(faces), np.concatenate(added)


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
