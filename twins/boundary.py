"""The boundary of a stack of slabs, section by section.

Two slabs meet in a section's region. A triangle of it that only one of them rests against belongs to the boundary, as
do the slabs' own sides. Where nothing joins a part of a region from below or above, it is carried straight on, by
prisms, to the next base or nozzle plane (F_ver and F_cap of the seed paper, Section 2.2.2).

Points of a section form a block: those of the region, then their copies carried down, then those carried up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
import numpy.typing as npt

from .joining import pieces_at
from .overlay import Slab
from .triangulation import Region

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Block:
    """What one section adds to the solid.

    Attributes:
        points: (u, v, w), shape (n, 3), mm: the region's, then those carried down and up.
        faces: of the boundary, in the section and on prisms, turned outwards, shape (k, 3).
        prisms: tetrahedra of the prisms, positively oriented, shape (m, 4).
        left_out: triangles of the region, in parts that a slab does reach, over and under which nothing was found;
            they belong to no solid; shape (r,).
    """

    points: Array
    faces: Indices
    prisms: Indices
    left_out: Indices


def block(
    region: Region, w: float, down_to: float, up_to: float, below: Slab | None, above: Slab | None
) -> Block:
    """The block of a section at height w.

    Args:
        region: the section's.
        w, down_to, up_to: heights of the section and of where it would be carried to, mm.
        below, above: the slabs beside it; None where the neighbouring region is empty or missing.
    """
    n = len(region)
    T = region.triangles
    rests_below = below.over if below is not None else np.zeros(len(T), np.bool_)
    rests_above = above.under if above is not None else np.zeros(len(T), np.bool_)
    everything = np.ones(len(T), np.bool_)
    down = everything if below is None else _untouched(T, below.held[below.lower :])
    up = everything if above is None else _untouched(T, above.held[: above.lower])
    points = [np.column_stack([region.points, np.full(n, w)])]
    covered_below, covered_above = rests_below | down, rests_above | up
    faces = [T[covered_below & ~covered_above], T[covered_above & ~covered_below][:, [0, 2, 1]]]
    prisms = []
    total = n
    for carried, height in ((down, down_to), (up, up_to)):
        if not carried.any():
            continue
        corners, local = np.unique(T[carried], return_inverse=True)
        copy = local.reshape(-1, 3) + total
        points.append(np.column_stack([region.points[corners], np.full(len(corners), height)]))
        total += len(corners)
        upwards = height > w
        faces.append(copy if upwards else copy[:, [0, 2, 1]])
        tets = _prisms(T[carried], copy)
        prisms.append(tets if upwards else tets[:, [0, 2, 1, 3]])
        faces.append(_walls(T[carried], copy, upwards=upwards))
    return Block(
        np.concatenate(points),
        np.concatenate(faces),
        np.concatenate(prisms) if prisms else np.zeros((0, 4), np.int64),
        np.flatnonzero(~covered_below & ~covered_above),
    )


def _untouched(T: Indices, touched: Flags) -> Flags:
    """Triangles of parts of the region that a slab does not reach at any point."""
    if not len(T) or touched.all():
        return np.zeros(len(T), np.bool_)
    label = np.arange(len(touched))
    while True:  # label propagation over triangles; parts are few and small
        low = label[T].min(axis=1)
        spread = label.copy()
        np.minimum.at(spread, T, low[:, None])
        if (spread == label).all():
            break
        label = spread[spread]
    reached = np.zeros(len(touched), np.bool_)
    np.logical_or.at(reached, label, touched)
    return np.asarray(~reached[label[T[:, 0]]], dtype=np.bool_)


def _prisms(bottom: Indices, top: Indices) -> Indices:
    """Prisms between triangles that turn left and their copies above, three tetrahedra each.

    Every wall is cut from its lower-numbered bottom corner to the other's copy, so that neighbours conform.
    """
    order = np.argsort(bottom, axis=1)
    a, b, c = np.take_along_axis(bottom, order, axis=1).T
    d, e, f = np.take_along_axis(top, order, axis=1).T
    odd = (np.argmin(bottom, axis=1) * 3 + np.argmax(bottom, axis=1))[:, None]
    # Even orders of (a, b, c) within the triangle: lowest first and highest last, or turned.
    even = np.isin(odd, (2, 3, 7))
    tets = [np.column_stack(q) for q in ((a, b, c, f), (a, b, f, e), (a, e, f, d))]
    return np.concatenate([np.where(even, tet, tet[:, [0, 2, 1, 3]]) for tet in tets])


def _walls(bottom: Indices, top: Indices, *, upwards: bool) -> Indices:
    """The prisms' walls along the border of the carried triangles, turned outwards."""
    pairs = np.concatenate([bottom[:, [0, 1]], bottom[:, [1, 2]], bottom[:, [2, 0]]])
    above = np.concatenate([top[:, [0, 1]], top[:, [1, 2]], top[:, [2, 0]]])
    size = int(bottom.max()) + 1
    key, back = pairs[:, 0] * size + pairs[:, 1], pairs[:, 1] * size + pairs[:, 0]
    border = ~np.isin(key, back)
    (p, q), (r, s) = pairs[border].T, above[border].T
    rising = (p < q)[:, None]
    one = np.where(rising, np.column_stack([p, q, s]), np.column_stack([p, q, r]))
    two = np.where(rising, np.column_stack([p, s, r]), np.column_stack([q, s, r]))
    walls = np.concatenate([one, two])
    return walls if upwards else walls[:, [0, 2, 1]]


@dataclass(frozen=True, eq=False)
class Seam:
    """How the boundary passes through a block's points.

    Attributes:
        kept: points that the boundary has, shape (k,).
        number: their places in `kept`, or -1, shape (n,).
        pieces: for each kept point the number of pieces of the solid there if the boundary is not a disc, else 0; (k,).
    """

    kept: Indices
    number: Indices
    pieces: npt.NDArray[np.int8]


def seam(here: Block, below: Slab | None, above: Slab | None, size_below: int, size_above: int) -> Seam:
    """Find where the boundary is not a disc: points with more than one fan of faces, or with crowded edges.

    Args:
        here: the section's block.
        below, above: the slabs beside it.
        size_below, size_above: number of points of the neighbouring blocks.
    """
    n = len(here.points)
    faces, tets = [here.faces + size_below], [here.prisms + size_below]
    if below is not None:
        faces.append(_renumbered(below.sides, below.lower, 0, size_below))
    if above is not None:
        faces.append(_renumbered(above.sides, above.lower, size_below, size_below + n))
    used, crowded = _crowded(np.concatenate(faces), size_below, n, size_below + n + size_above)
    pieces = crowded.astype(np.int8)
    if crowded.any():
        if below is not None:
            tets.append(_renumbered(below.tets, below.lower, 0, size_below))
        if above is not None:
            tets.append(_renumbered(above.tets, above.lower, size_below, size_below + n))
        all_tets = np.concatenate(tets)
        where = np.flatnonzero(crowded)
        pieces[where] = np.minimum(pieces_at(where + size_below, all_tets), 100)
    kept = np.flatnonzero(used)
    number = np.full(n, -1, np.int64)
    number[kept] = np.arange(len(kept))
    return Seam(kept, number, pieces[kept])


def _renumbered(rows: Indices, lower: int, first: int, second: int) -> Indices:
    """Rows of a slab's points, with its lower points numbered from `first` and its upper ones from `second`."""
    if second - first == lower:
        return rows + first if first else rows
    return np.where(rows < lower, rows + first, rows + (second - lower))


@nb.njit(cache=True, nogil=True)
def _crowded(faces: Indices, first: int, n: int, points: int) -> tuple[Flags, Flags]:
    """Which of the points from `first` on have faces, and at which of them the faces are not one closed fan."""
    start = np.zeros(n + 1, np.int64)
    for f in range(len(faces)):
        for k in range(3):
            v = faces[f, k] - first
            if 0 <= v < n:
                start[v + 1] += 1
    for v in range(n):
        start[v + 1] += start[v]
    fill = start[:-1].copy()
    link = np.empty((start[n], 2), np.int64)
    for f in range(len(faces)):
        for k in range(3):
            v = faces[f, k] - first
            if 0 <= v < n:
                link[fill[v], 0], link[fill[v], 1] = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
                fill[v] += 1
    after = np.full(points, -1, np.int64)
    crowded = np.zeros(n, np.bool_)
    for v in range(n):
        low, high = start[v], start[v + 1]
        if low == high:
            continue
        for i in range(low, high):
            if after[link[i, 0]] >= 0:
                crowded[v] = True
            after[link[i, 0]] = link[i, 1]
        x, steps = link[low, 0], 0
        while x >= 0 and steps < high - low:
            x = after[x]
            steps += 1
            if x == link[low, 0]:
                break
        if x != link[low, 0] or steps != high - low:
            crowded[v] = True
        for i in range(low, high):
            after[link[i, 0]] = -1
    return start[1:] > start[:-1], crowded


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces of a slab or block, apart: those away from crowded points, and those at them; shape (k, 3)."""

    free: Indices
    crowded: Indices


def slab_faces(slab: Slab, lower: Seam, upper: Seam) -> Faces:
    """The sides of a slab, numbered through the kept points of the lower block and then of the upper one."""
    sides = _renumbered(slab.sides, slab.lower, 0, len(lower.number))
    number = np.concatenate([lower.number, upper.number + len(lower.kept)])
    return _apart(number[sides], np.concatenate([lower.pieces, upper.pieces]))


def block_faces(here: Block, at: Seam) -> Faces:
    """The faces of a block, numbered through its kept points."""
    return _apart(at.number[here.faces], at.pieces)


def _apart(faces: Indices, pieces: npt.NDArray[np.int8]) -> Faces:
    if not pieces.any():
        return Faces(faces, faces[:0])
    crowded = (pieces[faces] > 0).any(axis=1)
    return Faces(faces[~crowded], faces[crowded])
