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
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .errors import ToolpathError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Triangle = tuple[int, int, int]


def resolve(points: Array, jittered: Array, tets: Indices, epsilon: float) -> tuple[Array, Indices]:
    """The boundary of positively oriented tetrahedra as a closed, oriented 2-manifold.

    Args:
        points: shape (n, 3), mm.
        jittered: the points in general position, shape (n, 3); decides the order of faces around an edge.
        tets: shape (m, 4).
        epsilon: how far joins move vertices, mm.

    Returns:
        points, those given first, and faces, shape (k, 3).
    """
    faces = boundary_faces(tets)
    for _ in range(4):
        points, jittered, faces = _split_edges(points, jittered, faces, epsilon)
        points, faces = _split_vertices(points, faces, tets, epsilon)
        jittered = np.vstack([jittered, points[len(jittered) :]])
        if not len(crowded_edges(faces)) and not len(_pinched_vertices(faces)):
            return points, faces
        epsilon *= 0.5
    place = points[
        crowded_edges(faces).ravel()[0] if len(crowded_edges(faces)) else _pinched_vertices(faces)[0]
    ]
    raise ToolpathError(
        f"the surface could not be made manifold near {np.round(place, 3)} (layer coordinates)"
    )


def boundary_faces(tets: Indices) -> Indices:
    """Faces that only one tetrahedron has, turned outwards for positive tetrahedra; shape (k, 3)."""
    faces = np.concatenate([tets[:, [1, 2, 3]], tets[:, [0, 3, 2]], tets[:, [0, 1, 3]], tets[:, [0, 2, 1]]])
    _, index, count = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
    return np.ascontiguousarray(faces[count[index.reshape(-1)] == 1])


def crowded_edges(faces: Indices) -> Indices:
    """Edges with more than two faces, low vertex first; shape (k, 2)."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    found, count = np.unique(edges, axis=0, return_counts=True)
    return np.asarray(found[count > 2], dtype=np.int64)


def _pinched_vertices(faces: Indices) -> Indices:
    """Vertices whose faces form more than one fan (where all edges have two faces)."""
    corner = np.arange(3 * len(faces)).reshape(-1, 3)
    owner = faces.reshape(-1)
    start = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    at_start = np.concatenate([corner[:, 0], corner[:, 1], corner[:, 2]])
    at_end = np.concatenate([corner[:, 1], corner[:, 2], corner[:, 0]])
    key = np.sort(start, axis=1)
    order = np.lexsort((key[:, 1], key[:, 0]))
    same = np.flatnonzero((key[order[1:]] == key[order[:-1]]).all(axis=1))
    a, b = order[same], order[same + 1]
    # The two faces of an edge run along it in opposite directions: start meets end.
    corners = 3 * len(faces)
    pairs = np.concatenate(
        [np.column_stack([at_start[a], at_end[b]]), np.column_stack([at_end[a], at_start[b]])]
    )
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(corners, corners))
    _, label = connected_components(graph, directed=False)
    fans = np.unique(np.column_stack([owner, label]), axis=0)[:, 0]
    found, count = np.unique(fans, return_counts=True)
    return np.asarray(found[count > 1], dtype=np.int64)


def _split_edges(
    points: Array, jittered: Array, faces: Indices, epsilon: float
) -> tuple[Array, Array, Indices]:
    crowded = crowded_edges(faces)
    if not len(crowded):
        return points, jittered, faces
    wanted = {(int(u), int(v)) for u, v in crowded}
    around: dict[tuple[int, int], list[tuple[int, int]]] = {edge: [] for edge in wanted}
    near = np.flatnonzero(np.isin(faces, crowded).sum(axis=1) >= 2)
    for f in near.tolist():
        for k in range(3):
            a, b = int(faces[f, k]), int(faces[f, (k + 1) % 3])
            edge = (min(a, b), max(a, b))
            if edge in wanted:
                around[edge].append((f, k))
    added: list[Array] = []
    middle: dict[tuple[int, int], int] = {}
    for (u, v), sides in around.items():
        along = jittered[v] - jittered[u]
        along = along / np.linalg.norm(along)
        first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
        first = first / np.linalg.norm(first)
        second = np.cross(along, first)
        turned = []
        for f, k in sides:
            out = jittered[faces[f, (k + 2) % 3]] - jittered[u]
            turned.append((float(np.arctan2(out @ second, out @ first)), bool(faces[f, k] == u), f, k))
        turned.sort()
        for i, (angle, forward, face, side) in enumerate(turned):
            # Seen along u -> v the outside begins, counter-clockwise, behind a face that runs u -> v.
            next_angle, next_forward, g, m = turned[(i + 1) % len(turned)]
            if not forward or next_forward:
                continue
            between = angle + 0.5 * ((next_angle - angle) % (2.0 * np.pi))
            at = 0.5 * (points[u] + points[v]) + epsilon * (
                np.cos(between) * first + np.sin(between) * second
            )
            middle[face, side] = middle[g, m] = len(points) + len(added)
            added.append(at)
    touched = sorted({f for f, _ in middle})
    keep = np.ones(len(faces), np.bool_)
    keep[touched] = False
    pieces = [piece for f in touched for piece in _divided(faces[f], [middle.get((f, k)) for k in range(3)])]
    new = np.array(added).reshape(-1, 3)
    return (
        np.vstack([points, new]),
        np.vstack([jittered, new]),
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


def _split_vertices(points: Array, faces: Indices, tets: Indices, epsilon: float) -> tuple[Array, Indices]:
    pinched = _pinched_vertices(faces)
    if not len(pinched):
        return points, faces
    triangles: list[list[int] | None] = [[int(v) for v in face] for face in faces]
    places = list(points)
    at: dict[int, set[int]] = {int(v): set() for v in pinched}
    for f in np.flatnonzero(np.isin(faces, pinched).any(axis=1)):
        for v in faces[f]:
            if int(v) in at:
                at[int(v)].add(int(f))
    near = tets[np.isin(tets, pinched).any(axis=1)]
    for v, around in at.items():
        fans = _fans(v, around, triangles)
        if len(fans) < 2:
            continue
        if len(fans) == 2 and _pieces(v, near) == 2:
            _bridge(v, fans, triangles, places, at, epsilon)
        else:
            _copy(v, fans, triangles, places, epsilon)
    kept = np.array([t for t in triangles if t is not None], np.int64)
    return np.array(places), kept


Fan = tuple[list[int], list[int]]
"""The ring of vertices around a vertex, in order, and the faces between each and the next."""


def _fans(v: int, around: set[int], triangles: list[list[int] | None]) -> list[Fan]:
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


def _pieces(v: int, tets: Indices) -> int:
    """Number of pieces of the solid at a vertex, where pieces that share an edge or face there count as one."""
    parent: dict[int, int] = {}

    def root(x: int) -> int:
        while parent.setdefault(x, x) != x:
            x = parent[x]
        return x

    for tet in tets[(tets == v).any(axis=1)]:
        a, b, c = (int(x) for x in tet if x != v)
        parent[root(a)] = root(b)
        parent[root(a)] = root(c)
    return len({root(x) for x in list(parent)})


def _copy(
    v: int, fans: list[Fan], triangles: list[list[int] | None], places: list[Array], epsilon: float
) -> None:
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
    triangles: list[list[int] | None],
    places: list[Array],
    at: dict[int, set[int]],
    epsilon: float,
) -> None:
    """Cut the tips of two fans at epsilon and join them by a tube."""

    def add(face: list[int]) -> None:
        for w in face:
            if w in at:
                at[w].add(len(triangles))
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
