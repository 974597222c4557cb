"""Kept edges: lines along which a surface turns sharply, and where they end, meet or turn themselves."""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from twins.half_edges import opposite_half_edges

from .net import CORNER, CREASE, Net, following, preceding

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

TURN_DEG = 50.0
"""A kept line that turns more than this within an edge length has a corner there, which stays."""


def sharp_edges(points: Array, faces: Indices, degrees: float, least: float) -> Flags:
    """Half-edges whose faces turn by more than the degrees, in lines of at least a length; shape (3 m,).

    Shorter ones are the jags of a surface, not its edges.
    """
    across = opposite_half_edges(faces, len(points)).astype(np.int64)
    corners = points[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, size, out=np.zeros_like(normal), where=size > 0.0)
    cosine = np.einsum("ij,ij->i", np.repeat(normal, 3, axis=0), normal[across // 3])
    sharp = np.asarray(cosine < np.cos(np.radians(degrees)), dtype=np.bool_)
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    half = np.flatnonzero(sharp)
    n = len(points)
    _, line = connected_components(coo_matrix((np.ones(len(half)), (start[half], end[half])), shape=(n, n)))
    # Every edge counts once for each of its two half-edges.
    lengths = 0.5 * np.bincount(
        line[start[half]], np.linalg.norm(points[start[half]] - points[end[half]], axis=1), minlength=n
    )
    sharp[half] = lengths[line[start[half]]] >= least
    return sharp


def name_kinds(net: Net, edge_length: float) -> None:
    """Mark vertices of kept edges as of a line or as its corners; sharp half-edges must be marked already."""
    _name_kinds(net, edge_length, float(np.cos(np.radians(TURN_DEG))))


@nb.njit(cache=True, nogil=True)
def _name_kinds(net: Net, reach: float, straight: float) -> None:
    for v in range(net.used[0]):
        first = h = net.out[v]
        if h < 0:
            continue
        number, one, two = 0, first, first
        while True:
            if net.sharp[h]:
                number, one, two = number + 1, two, h
            h = net.across[preceding(h)]
            if h == first:
                break
        if number == 2:
            a, b = _far_along(net, one, reach) - net.points[v], net.points[v] - _far_along(net, two, reach)
            turn = (a * b).sum()
            net.kind[v] = CREASE if turn >= straight * np.sqrt((a * a).sum() * (b * b).sum()) else CORNER
        elif number > 0:
            net.kind[v] = CORNER


@nb.njit(cache=True, nogil=True)
def _far_along(net: Net, h: int, reach: float) -> Array:
    """The point that lies about as far along a kept line, or its end."""
    start = net.points[net.corner[h]]
    first = h
    while True:
        end: Array = net.points[net.corner[following(h)]]
        if ((end - start) ** 2).sum() >= reach * reach:
            return end
        h, count, back = following(h), 0, h
        # On to the one other sharp edge of the vertex, if there is just one.
        turn, onward = h, -1
        while True:
            if net.sharp[turn] and net.across[turn] != back:
                count, onward = count + 1, turn
            turn = net.across[preceding(turn)]
            if turn == h:
                break
        if count != 1 or onward == first:
            return end
        h = onward
