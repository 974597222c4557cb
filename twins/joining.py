"""Joining: the boundary of a tetrahedral solid that touches itself becomes a 2-manifold.

The boundary of a set of tetrahedra is closed, but where the solid touches itself in an edge or a vertex more than
two faces meet in that edge, or more than one fan of faces in that vertex. The solid is *joined* there, as if
thickened a little:

- At an edge with four or more faces, each two faces that bound the same wedge of *outside* space get a midpoint of
  their own, moved by epsilon into that wedge.
- At a vertex with several fans that belong to one piece of the solid, each fan gets its own copy of the vertex,
  moved slightly along the fan. Where two pieces of the solid touch in a vertex alone, both tips are cut and bridged.

Pairing faces by the outside keeps the solid's connectivity: the Euler characteristic of the result is twice
that of the solid.

Only faces at such points take part. They fall into clusters that share no face and are joined one by one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numba as nb
import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .errors import ToolpathError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Triangle = tuple[int, int, int]
Face = list[int]
Edge = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Join:
    """The faces of one cluster after joining; points from the number given on are new.

    Attributes:
        points: new points, shape (n, 3).
        faces: shape (k, 3).
    """

    points: Array
    faces: Indices


def clusters(faces: Indices, crowded: npt.NDArray[np.bool_]) -> list[Indices]:
    """Groups of faces, as row numbers, that are linked by crowded points; every face has at least one."""
    marked = crowded[faces]
    row, column = np.nonzero(marked)
    points, local = np.unique(faces[row, column], return_inverse=True)
    graph = coo_matrix(
        (np.ones(len(row)), (row, len(faces) + local.reshape(-1))),
        shape=(2 * (len(faces) + len(points)),) * 2,
    )
    _, label = connected_components(graph, directed=False)
    order = np.argsort(label[: len(faces)], kind="stable")
    cuts = np.flatnonzero(np.diff(label[order])) + 1
    return [np.sort(group) for group in np.split(order, cuts)] if len(faces) else []


def join(
    points: Array, faces: Indices, crowded: Indices, pieces: Callable[[int], int], epsilon: float
) -> Join:
    """Make one cluster of faces manifold at its crowded points.

    Args:
        points: shape (n, 3), mm.
        faces: turned outwards, shape (k, 3); all that the crowded points have.
        crowded: points to be put right, shape (c,).
        pieces: the number of pieces of the solid at a point, where pieces that share an edge or face there are one.
        epsilon: how far points are moved, mm.

    Raises:
        ToolpathError: it cannot be done; names the place.
    """
    given = len(points)
    shift = epsilon
    for _ in range(4):
        before = len(points)
        points, faces = _split_edges(points, faces, set(crowded.tolist()), shift)
        watched = np.concatenate([crowded, np.arange(before, len(points))])
        before = len(points)
        points, faces = _split_vertices(points, faces, watched, pieces, shift)
        crowded = np.concatenate([watched, np.arange(before, len(points))])
        left = _faulty(faces, crowded)
        if not left:
            return Join(points[given:], faces)
        shift *= 0.5
    raise ToolpathError(
        f"the surface could not be made manifold near {np.round(points[left[0]], 3)} (layer coordinates); sample finer"
    )


def _edges_of(faces: Indices) -> dict[Edge, list[tuple[int, int]]]:
    """For each edge, low point first, its faces and which of their edges it is."""
    edges: dict[Edge, list[tuple[int, int]]] = {}
    for f, face in enumerate(faces.tolist()):
        for k in range(3):
            a, b = face[k], face[(k + 1) % 3]
            edges.setdefault((min(a, b), max(a, b)), []).append((f, k))
    return edges


def _split_edges(points: Array, faces: Indices, at: set[int], epsilon: float) -> tuple[Array, Indices]:
    around = {
        edge: sides
        for edge, sides in _edges_of(faces).items()
        if len(sides) > 2 and edge[0] in at and edge[1] in at
    }
    if not around:
        return points, faces
    added: list[Array] = []
    middle: dict[tuple[int, int], int] = {}
    for (u, v), sides in around.items():
        along = points[v] - points[u]
        along = along / np.linalg.norm(along)
        first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
        first = first / np.linalg.norm(first)
        second = np.cross(along, first)
        turned = []
        for f, k in sides:
            out = points[faces[f, (k + 2) % 3]] - points[u]
            turned.append((float(np.arctan2(out @ second, out @ first)), bool(faces[f, k] == u), f, k))
        turned.sort()
        for i, (angle, forward, face, side) in enumerate(turned):
            # Seen along u -> v the outside begins, counter-clockwise, behind a face that runs u -> v.
            next_angle, next_forward, g, m = turned[(i + 1) % len(turned)]
            if not forward or next_forward:
                continue
            between = angle + 0.5 * ((next_angle - angle) % (2.0 * np.pi))
            at_middle = 0.5 * (points[u] + points[v])
            aside = np.cos(between) * first + np.sin(between) * second
            middle[face, side] = middle[g, m] = len(points) + len(added)
            added.append(at_middle + epsilon * aside)
    touched = sorted({f for f, _ in middle})
    keep = np.ones(len(faces), np.bool_)
    keep[touched] = False
    pieces = [piece for f in touched for piece in _divided(faces[f], [middle.get((f, k)) for k in range(3)])]
    return (
        np.vstack([points, np.array(added).reshape(-1, 3)]),
        np.vstack([faces[keep], np.array(pieces, np.int64).reshape(-1, 3)]),
    )


def _divided(face: Indices, middle: list[int | None]) -> list[Triangle]:
    """A face cut at the midpoints that some of its edges have."""
    cut = [k for k in range(3) if middle[k] is not None]
    corners = [int(v) for v in face]
    if len(cut) == 3:
        x, y, z = (m for m in middle if m is not None)
        a, b, c = corners
        return [(a, x, z), (x, b, y), (z, y, c), (x, y, z)]
    k = cut[0] if len(cut) == 1 else next(i for i in range(3) if i not in cut)
    p, q, r = corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]
    on, after, before = middle[k], middle[(k + 1) % 3], middle[(k + 2) % 3]
    if on is not None:
        return [(p, on, r), (on, q, r)]
    assert after is not None
    assert before is not None
    return [(p, q, after), (p, after, before), (before, after, r)]


Fan = tuple[list[int], list[int]]
"""The ring of vertices around a vertex, in order, and the faces between each and the next."""


def _fans(v: int, around: list[int], triangles: list[Face | None]) -> list[Fan]:
    step: dict[int, tuple[int, int]] = {}
    for f in around:
        face = triangles[f]
        if face is not None and v in face:
            k = face.index(v)
            step[face[(k + 1) % 3]] = (face[(k + 2) % 3], f)
    fans: list[Fan] = []
    while step:
        start = next(iter(step))
        ring, between = [], []
        vertex = start
        while vertex in step:
            ring.append(vertex)
            vertex, f = step.pop(vertex)
            between.append(f)
        fans.append((ring, between))
    return fans


def _faulty(faces: Indices, at: Indices) -> list[int]:
    """Those of the given points whose faces are not one closed fan."""
    triangles: list[Face | None] = [list(face) for face in faces.tolist()]
    around = _faces_at(at, triangles)
    return [v for v, found in around.items() if found and not _is_disc(v, found, triangles)]


def _is_disc(v: int, around: list[int], triangles: list[Face | None]) -> bool:
    fans = _fans(v, around, triangles)
    return len(fans) == 1 and len(fans[0][0]) == len(around)


def _faces_at(at: Indices, triangles: list[Face | None]) -> dict[int, list[int]]:
    around: dict[int, list[int]] = {int(v): [] for v in at}
    for f, face in enumerate(triangles):
        for v in face or ():
            if v in around:
                around[v].append(f)
    return around


def _split_vertices(
    points: Array, faces: Indices, watched: Indices, pieces: Callable[[int], int], epsilon: float
) -> tuple[Array, Indices]:
    triangles: list[Face | None] = [list(face) for face in faces.tolist()]
    places = list(points)
    around = _faces_at(watched, triangles)
    for v, at in around.items():
        fans = _fans(v, at, triangles)
        if len(fans) < 2:
            continue
        if len(fans) == 2 and v < len(points) and pieces(v) == 2:
            _bridge(v, fans, triangles, places, around, epsilon)
        else:
            _copy(v, fans, triangles, places, epsilon)
    kept = np.array([t for t in triangles if t is not None], np.int64)
    return np.array(places), kept


def _copy(v: int, fans: list[Fan], triangles: list[Face | None], places: list[Array], epsilon: float) -> None:
    """Give each fan but the flattest a copy of the vertex, moved along the fan."""

    def direction(fan: Fan) -> Array:
        arms = np.array([places[w] - places[v] for w in fan[0]])
        return np.asarray((arms / np.linalg.norm(arms, axis=1)[:, None]).mean(axis=0), dtype=np.float64)

    for fan in sorted(fans, key=lambda fan: float(np.linalg.norm(direction(fan))))[1:]:
        along = direction(fan)
        shortest = min(float(np.linalg.norm(places[w] - places[v])) for w in fan[0])
        size = float(np.linalg.norm(along))
        unit = along / size if size > 1e-12 else np.zeros(3)
        places.append(places[v] + unit * min(0.3 * epsilon, 0.05 * shortest))
        for f in fan[1]:
            face = triangles[f]
            if face is not None:
                face[face.index(v)] = len(places) - 1


def _bridge(
    v: int,
    fans: list[Fan],
    triangles: list[Face | None],
    places: list[Array],
    around: dict[int, list[int]],
    epsilon: float,
) -> None:
    """Cut the tips of two fans at epsilon and join them by a tube."""

    def add(face: Face) -> None:
        for w in face:
            if w in around:
                around[w].append(len(triangles))
        triangles.append(face)

    rims: list[list[int]] = []
    for ring, between in fans:
        rim = []
        for w in ring:
            arm = places[w] - places[v]
            places.append(places[v] + arm * min(0.3, epsilon / float(np.linalg.norm(arm))))
            rim.append(len(places) - 1)
        for i, f in enumerate(between):
            j = (i + 1) % len(ring)
            triangles[f] = None
            add([rim[i], ring[i], ring[j]])
            add([rim[i], ring[j], rim[j]])
        rims.append(rim)
    one, two = rims[0], rims[1][::-1]
    nearest = int(np.argmin([np.linalg.norm(places[one[0]] - places[w]) for w in two]))
    two = two[nearest:] + two[:nearest]
    i = j = 0
    while i < len(one) or j < len(two):
        if j == len(two) or (i < len(one) and (i + 1) * len(two) <= (j + 1) * len(one)):
            add([one[i % len(one)], one[(i + 1) % len(one)], two[j % len(two)]])
            i += 1
        else:
            add([two[(j + 1) % len(two)], two[j % len(two)], one[i % len(one)]])
            j += 1


@nb.njit(cache=True, nogil=True)
def pieces_at(points: Indices, tets: Indices) -> Indices:
    """Number of pieces of the solid at points: of the parts of each one's link, by the tetrahedra that have it.

    Args:
        points: numbers of different points, shape (n,).
        tets: all tetrahedra at them, and any others, shape (m, 4).
    """
    size = 0
    for v in points:
        size = max(size, v + 1)
    for t in range(len(tets)):
        for k in range(4):
            size = max(size, tets[t, k] + 1)
    place = np.full(size, -1, np.int64)
    for i, v in enumerate(points):
        place[v] = i
    start = np.zeros(len(points) + 1, np.int64)
    for t in range(len(tets)):
        for k in range(4):
            i = place[tets[t, k]]
            if i >= 0:
                start[i + 1] += 1
    for i in range(len(points)):
        start[i + 1] += start[i]
    fill = start[:-1].copy()
    at = np.empty(start[-1], np.int64)
    for t in range(len(tets)):
        for k in range(4):
            i = place[tets[t, k]]
            if i >= 0:
                at[fill[i]] = t
                fill[i] += 1
    pieces = np.zeros(len(points), np.int64)
    parent = np.full(size, -1, np.int64)
    for i, v in enumerate(points):
        for t in at[start[i] : start[i + 1]]:
            first = -1
            for k in range(4):
                x = tets[t, k]
                if x == v:
                    continue
                if parent[x] < 0:  # a corner of the link that is new
                    parent[x] = x
                    pieces[i] += 1
                while parent[x] != x:
                    parent[x] = parent[parent[x]]
                    x = parent[x]
                if first < 0:
                    first = x
                elif x != first:
                    parent[x] = first
                    pieces[i] -= 1
        for t in at[start[i] : start[i + 1]]:
            for k in range(4):
                parent[tets[t, k]] = -1
    return pieces
