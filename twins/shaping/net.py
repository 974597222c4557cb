"""Net: a closed triangle mesh that is changed edge by edge: split, collapse, flip.

Half-edge 3 f + k runs from corner k of face f to the next one; `across` is the one that runs against it. What is
taken away stays as a gap (a face with corners -1, a vertex without half-edge) until `packed` closes the gaps.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

from twins.half_edges import opposite_half_edges

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

FREE, CREASE, CORNER = 0, 1, 2
"""Vertices that may go anywhere on the surface, that belong to a kept edge, and that stay."""


class Net(NamedTuple):
    """A closed mesh with room to grow.

    Attributes:
        points: shape (n, 3), mm.
        corner: the vertex each half-edge starts in, -1 in gaps; shape (3 m,).
        across: shape (3 m,).
        sharp: half-edges of kept edges, shape (3 m,).
        out: a half-edge that starts in each vertex, or -1; shape (n,).
        kind: FREE, CREASE or CORNER, shape (n,).
        locked: vertices whose edges do nothing but split, shape (n,).
        used: how many vertices and faces there are, gaps included; shape (2,).
    """

    points: Array
    corner: Indices
    across: Indices
    sharp: Flags
    out: Indices
    kind: npt.NDArray[np.int8]
    locked: Flags
    used: Indices


def net_of(points: Array, faces: Indices, sharp: Flags) -> Net:
    """The net of a closed 2-manifold; `sharp` marks half-edges in pairs, shape (3 m,)."""
    corner = np.ascontiguousarray(faces, dtype=np.int64).reshape(-1)
    out = np.full(len(points), -1, np.int64)
    out[corner] = np.arange(len(corner))
    return Net(
        np.array(points, dtype=np.float64),
        corner.copy(),
        opposite_half_edges(faces, len(points)).astype(np.int64),
        sharp.copy(),
        out,
        np.zeros(len(points), np.int8),
        np.zeros(len(points), np.bool_),
        np.array([len(points), len(faces)]),
    )


def packed(net: Net, room: int = 0) -> Net:
    """The net without its gaps, in arrays of its own, with room for as many more vertices."""
    kept = np.flatnonzero(net.out[: net.used[0]] >= 0)
    faces = net.corner[: 3 * net.used[1]].reshape(-1, 3)
    alive = np.flatnonzero(faces[:, 0] >= 0)
    vertex = np.full(len(net.points), -1, np.int64)
    vertex[kept] = np.arange(len(kept))
    half = np.full(3 * net.used[1], -1, np.int64)
    old = (3 * alive[:, None] + np.arange(3)).reshape(-1)
    half[old] = np.arange(len(old))
    n, m = len(kept), len(old)
    new = Net(
        np.zeros((n + room, 3)),
        np.full(m + 6 * room, -1, np.int64),
        np.full(m + 6 * room, -1, np.int64),
        np.zeros(m + 6 * room, np.bool_),
        np.full(n + room, -1, np.int64),
        np.zeros(n + room, np.int8),
        np.zeros(n + room, np.bool_),
        np.array([n, len(alive)]),
    )
    new.points[:n], new.kind[:n], new.locked[:n] = net.points[kept], net.kind[kept], net.locked[kept]
    new.out[:n] = half[net.out[kept]]
    new.corner[:m], new.across[:m], new.sharp[:m] = (
        vertex[net.corner[old]],
        half[net.across[old]],
        net.sharp[old],
    )
    return new


def mesh_of(net: Net) -> tuple[Array, Indices]:
    """Vertices and faces of a packed net."""
    return net.points[: net.used[0]].copy(), net.corner[: 3 * net.used[1]].reshape(-1, 3).copy()


@nb.njit(cache=True, nogil=True, inline="always")
def following(h: int) -> int:
    return h - 2 if h % 3 == 2 else h + 1


@nb.njit(cache=True, nogil=True, inline="always")
def preceding(h: int) -> int:
    return h + 2 if h % 3 == 0 else h - 1


@nb.njit(cache=True, nogil=True)
def round_about(net: Net, v: int, ring: Indices) -> int:
    """The half-edges that start in v, in order, put into `ring`; how many, or -1 where they are more than fit."""
    h = first = net.out[v]
    count = 0
    while True:
        if count == len(ring):
            return -1
        ring[count] = h
        count += 1
        h = net.across[preceding(h)]
        if h == first:
            return count


@nb.njit(cache=True, nogil=True)
def split(net: Net, h: int) -> int:
    """Put a vertex into the middle of an edge; its number. There must be room for a vertex and two faces."""
    t = net.across[h]
    nh, pt = following(h), preceding(t)
    a, b, c, d = net.corner[h], net.corner[nh], net.corner[preceding(h)], net.corner[pt]
    m, f = net.used[0], net.used[1]
    net.used[0] += 1
    net.used[1] += 2
    for k in range(3):
        net.points[m, k] = 0.5 * (net.points[a, k] + net.points[b, k])
    x, y = net.across[nh], net.across[pt]
    i, j = 3 * f, 3 * f + 3
    net.corner[i], net.corner[i + 1], net.corner[i + 2] = m, b, c
    net.corner[j], net.corner[j + 1], net.corner[j + 2] = b, m, d
    net.corner[nh] = m
    net.corner[t] = m
    net.sharp[i] = net.sharp[j] = net.sharp[h]
    net.sharp[i + 1], net.sharp[j + 2] = net.sharp[nh], net.sharp[pt]
    net.sharp[i + 2] = net.sharp[nh] = net.sharp[j + 1] = net.sharp[pt] = False
    _pair(net, i, j)
    _pair(net, i + 1, x)
    _pair(net, i + 2, nh)
    _pair(net, j + 1, pt)
    _pair(net, j + 2, y)
    net.out[m], net.out[b] = nh, i + 1
    net.kind[m] = CREASE if net.sharp[h] else FREE
    net.locked[m] = net.locked[a] and net.locked[b]
    return int(m)


@nb.njit(cache=True, nogil=True, inline="always")
def _pair(net: Net, h: int, t: int) -> None:
    net.across[h] = t
    net.across[t] = h


@nb.njit(cache=True, nogil=True)
def flip(net: Net, h: int) -> None:
    """Turn an edge between its two faces; the corners that it then joins must not have an edge yet."""
    t = net.across[h]
    nh, ph, nt, pt = following(h), preceding(h), following(t), preceding(t)
    a, b, c, d = net.corner[h], net.corner[t], net.corner[ph], net.corner[pt]
    x, y = net.across[nt], net.across[nh]
    net.sharp[h], net.sharp[t] = net.sharp[nt], net.sharp[nh]
    net.sharp[nh] = net.sharp[nt] = False
    net.corner[nh], net.corner[nt] = d, c
    _pair(net, h, x)
    _pair(net, t, y)
    _pair(net, nh, nt)
    net.out[a], net.out[b], net.out[c], net.out[d] = h, t, ph, pt


@nb.njit(cache=True, nogil=True)
def collapse(net: Net, h: int, ring: Indices) -> None:
    """Draw the vertex that h starts in to the one where it ends; `ring` has room for the half-edges around it."""
    t = net.across[h]
    nh, ph, nt, pt = following(h), preceding(h), following(t), preceding(t)
    a, b = net.corner[h], net.corner[t]
    for i in range(round_about(net, a, ring)):
        net.corner[ring[i]] = b
    x, y, u, v = net.across[nh], net.across[ph], net.across[nt], net.across[pt]
    net.sharp[x] = net.sharp[y] = net.sharp[nh] or net.sharp[ph]
    net.sharp[u] = net.sharp[v] = net.sharp[nt] or net.sharp[pt]
    net.out[net.corner[x]], net.out[net.corner[u]] = x, u
    net.out[b] = y
    net.out[a] = -1
    _pair(net, x, y)
    _pair(net, u, v)
    for k in (h, nh, ph, t, nt, pt):
        net.corner[k] = -1
