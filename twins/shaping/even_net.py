"""Even net: rounds of moves that bring the edges of a closed surface to one length, each round checked as a whole.

Moves look at the surface around them only. Where a round let distant parts of the surface cut one another, or left
points of the surface before uncovered, it is undone, the mesh around those places is locked, and it is made again.
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from twins.crossings import find_cuts

from .collapses import collapse_short
from .facing_points import FaceTree, face_tree, facing_point
from .kept_edges import name_kinds, sharp_edges
from .moves import flip_edges, split_long, spread
from .net import Net, mesh_of, net_of, packed

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

ROUNDS = 6
"""Rounds of splitting, collapsing, flipping and spreading; more change little."""

SHORTEST, LONGEST = 0.8, 4.0 / 3.0
"""Edges between these, as shares of the length, are left (Botsch and Kobbelt): a split gives none to be collapsed."""

REACH = 0.2
"""How far a move may take middles of faces and edges from the surface before, as a share of the edge length."""

STRAYED = 0.3
"""How far middles of faces may be from the surface before after a round, as a share of the edge length."""

COVERED = 0.4
"""How far vertices of the surface before may be left behind, as a share of the edge length."""

CREASE_REACH = 0.1
"""How far a kept line may be drawn from its points in one move, as a share of the edge length."""

FLAT = 0.8
"""Least cosine between the faces about an edge that is flipped."""

ATTEMPTS = 6
"""How often a round is made again with more locked; the last time everything is."""


def even_net(
    points: Array, faces: Indices, edge_length: float, keep_edges_deg: float | None
) -> tuple[Array, Indices]:
    """Vertices and faces of the same surface with even edges.

    Args:
        points, faces: closed 2-manifold, shape (n, 3), mm, and (m, 3).
        edge_length: mm.
        keep_edges_deg: edges that turn by more stay; None: none is kept.
    """
    sharp = np.zeros(3 * len(faces), dtype=np.bool_)
    if keep_edges_deg is not None:
        sharp = sharp_edges(points, faces, keep_edges_deg, 2.0 * edge_length)
    before = face_tree(points, faces)
    net = net_of(points, faces, sharp)
    name_kinds(net, edge_length)
    at_first = _cut_faces_places(points, faces)
    length = edge_length
    for number in range(ROUNDS):
        net = _round(net, length, edge_length, before, points, at_first, even=number < ROUNDS - 2)
        if 1 <= number < ROUNDS - 1:
            # What cannot be made longer or shorter is made up for by the others.
            length *= float(np.clip(edge_length / _mean_edge(net), 0.93, 1.07))
            length = float(np.clip(length, 0.8 * edge_length, 1.2 * edge_length))
    return mesh_of(net)


def _round(
    start: Net,
    length: float,
    edge_length: float,
    before: FaceTree,
    covered: Array,
    at_first: Array,
    *,
    even: bool,
) -> Net:
    radius = 1.5 * edge_length
    for attempt in range(ATTEMPTS):
        net = packed(start)
        reach = REACH * edge_length
        # Needles divided as they are would become crowds of them: they go, or are turned into better faces, on the way.
        _collapse(net, length, edge_length, before, np.inf)
        longest = _longest_edge(net)
        while longest > LONGEST * length:
            longest = max(0.6 * longest, LONGEST * length)
            while not split_long(net, longest):
                net = packed(net, room=len(net.points))
            for _ in range(2):
                flip_edges(net, longest, before, reach, FLAT, False)
        _collapse(net, length, edge_length, before, LONGEST * length)
        flip_edges(net, LONGEST * length, before, reach, FLAT, even)
        for _ in range(2):
            spread(net, LONGEST * length, before, reach)
        if not even:
            flip_edges(net, LONGEST * length, before, reach, FLAT, False)
        net = packed(net)
        places = _faults(net, before, covered, at_first, edge_length)
        if len(places) == 0:
            return net
        if attempt == ATTEMPTS - 2:
            start.locked[:] = True
        away, _ = cKDTree(places).query(start.points[: start.used[0]], distance_upper_bound=radius)
        start.locked[: start.used[0]] |= np.isfinite(away)
        radius *= 2.0
    return start


def _collapse(net: Net, length: float, edge_length: float, before: FaceTree, longest: float) -> None:
    """Collapse short edges, the shortest first, where that makes none too long."""
    corner = net.corner[: 3 * net.used[1]]
    half = np.flatnonzero((corner >= 0) & (np.arange(len(corner)) < net.across[: len(corner)]))
    lengths = np.linalg.norm(net.points[corner[half]] - net.points[corner[net.across[half]]], axis=1)
    short = lengths < SHORTEST * length
    collapse_short(
        net,
        half[short][np.argsort(lengths[short], kind="stable")],
        SHORTEST * length,
        longest,
        before,
        REACH * edge_length,
        CREASE_REACH * edge_length,
    )


def _longest_edge(net: Net) -> float:
    half = np.flatnonzero(net.corner[: 3 * net.used[1]] >= 0)
    ends = net.points[net.corner[half]] - net.points[net.corner[net.across[half]]]
    return float(np.linalg.norm(ends, axis=1).max())


def _faults(net: Net, before: FaceTree, covered: Array, at_first: Array, edge_length: float) -> Array:
    """Where a net cuts itself beyond the cuts there were at first, or leaves points of the surface before; (k, 3)."""
    points, faces = mesh_of(net)
    tree = face_tree(points, faces)
    left = _uncovered(tree, covered, COVERED * edge_length)
    middles = points[faces].mean(axis=1)
    strayed = _uncovered(before, middles, STRAYED * edge_length)
    places = [covered[left], middles[strayed]]
    cuts = _cut_faces_places(points, faces)
    if len(cuts) and len(at_first):
        cuts = cuts[cKDTree(at_first).query(cuts)[0] > 2.0 * edge_length]
    return np.concatenate([*places, cuts])


@nb.njit(cache=True, nogil=True)
def _uncovered(tree: FaceTree, points: Array, reach: float) -> npt.NDArray[np.bool_]:
    left = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        p = (points[i, 0], points[i, 1], points[i, 2])
        left[i] = facing_point(tree, p, (0.0, 0.0, 0.0), reach, reach)[0] > reach
    return left


def _cut_faces_places(points: Array, faces: Indices) -> Array:
    """Corners of faces that cut one another, shape (k, 3)."""
    cuts = find_cuts(points, faces, np.zeros(len(faces), dtype=np.int64), 1)
    if cuts.number == 0:
        return np.zeros((0, 3))
    tree = face_tree(points, faces)
    found = _pierced(tree, faces)
    return np.concatenate([np.asarray(cuts.place)[None], points[np.unique(faces[found])]])


@nb.njit(cache=True, nogil=True)
def _pierced(tree: FaceTree, faces: Indices) -> npt.NDArray[np.bool_]:
    """Faces with an edge through another one, and those others."""
    found = np.zeros(len(faces), np.bool_)
    stack = np.empty(256, np.int64)
    for i in range(len(faces)):
        for k in range(3):
            p, q = tree.corners[i, k], tree.corners[i, (k + 1) % 3]
            if faces[i, k] > faces[i, (k + 1) % 3]:
                continue
            stack[0] = 0
            held = 1
            while held:
                held -= 1
                node = stack[held]
                box = tree.boxes[node]
                apart = False
                for x in range(3):
                    apart = apart or min(p[x], q[x]) > box[3 + x] or max(p[x], q[x]) < box[x]
                if apart:
                    continue
                begin, end, second = tree.spans[node]
                if second:
                    stack[held], stack[held + 1] = node + 1, second
                    held += 2
                    continue
                for s in range(begin, end):
                    j = tree.order[s]
                    shared = False
                    for x in range(3):
                        shared = shared or faces[j, x] == faces[i, 0] or faces[j, x] == faces[i, 1]
                        shared = shared or faces[j, x] == faces[i, 2]
                    if not shared and _goes_through(p, q, tree.corners[j]):
                        found[i] = found[j] = True
    return found


@nb.njit(cache=True, nogil=True)
def _goes_through(p: Array, q: Array, corner: Array) -> bool:
    """Whether a segment meets a triangle (Möller and Trumbore 1997)."""
    d, u, v, w = q - p, corner[1] - corner[0], corner[2] - corner[0], p - corner[0]
    h = np.array([d[1] * v[2] - d[2] * v[1], d[2] * v[0] - d[0] * v[2], d[0] * v[1] - d[1] * v[0]])
    a = (u * h).sum()
    if a == 0.0:
        return False
    s = (w * h).sum() / a
    g = np.array([w[1] * u[2] - w[2] * u[1], w[2] * u[0] - w[0] * u[2], w[0] * u[1] - w[1] * u[0]])
    t, along = (d * g).sum() / a, (v * g).sum() / a
    return bool(s >= 0.0 and t >= 0.0 and s + t <= 1.0 and 0.0 <= along <= 1.0)


def _mean_edge(net: Net) -> float:
    corner = net.corner[: 3 * net.used[1]]
    end = net.corner[net.across[: len(corner)]]
    return float(np.linalg.norm(net.points[corner] - net.points[end], axis=1).mean())
