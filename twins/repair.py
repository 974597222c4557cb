"""Repair: a mesh is put right where that can be done in one way only, and what was done is said.

A *body* is what hangs together by edges. Bodies may lie in one another: around a point the bodies that contain it
are counted, outward ones as +1, cavities as -1, and where the sum is 1 or more there is material. A repair is made
only where this leaves one reading; everything else is refused.
"""

from __future__ import annotations

import manifold3d
import numba as nb
import numpy as np
import numpy.typing as npt
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .crossings import TOUCHING, find_cuts, refuse_cuts
from .entrances import checks_kinds
from .errors import SurfaceError
from .holes import boundary_loops, hole_at, number_of_cuts, with_holes_closed
from .mesh_edges import arrays_of, directed_edges, edge_faults, equal_rows
from .surface import check_edges, check_surface, make_surface, signed_volume, welded

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_MOST_BODIES = 5000


@checks_kinds
def repair_surface(surface: trimesh.Trimesh) -> tuple[trimesh.Trimesh, list[str]]:
    """Put right what can be put right without a choice, and say so.

    - Vertices at equal points are merged. Duplicate faces are dropped, and both sides of a wall between two bodies
      or of a fin without thickness; a face without an area where the surface is closed without it.
    - Faces of one body are turned the same way; holes are closed by a fan to the middle of their rim,
      or, where a fan would cut the surface, by the patch of least area.
    - Where an edge has four or more faces, those with the solid between them belong together: this tells bodies
      that meet there apart.
    - A body that is inside out is flipped, with the bodies in it if they are all inside out too. A body that lies
      wholly in the material of another one adds nothing and is dropped.
    - Bodies that overlap, or touch in more than an edge, are united.

    Returns:
        the surface, without vertices that no face uses, and one sentence for each thing that was changed.

    Raises:
        SurfaceError: what remains does not bound a solid: it is open or twisted, bodies touch along an edge, one cuts
            itself, or it has no one inside. The message names the place.
    """
    vertices, faces = arrays_of(surface)
    if len(faces) == 0 or not np.isfinite(vertices).all():
        check_surface(surface)
    said: list[str] = []
    merged = welded(vertices, faces)
    if len(merged.vertices) < len(np.unique(faces)) or len(merged.faces) < len(faces):
        said.append("merged vertices at equal points")
        vertices, faces = arrays_of(merged)
    faces = _without_doubles(vertices, faces, said)
    _, _, twisted = edge_faults(faces)
    if len(twisted):
        mesh = make_surface(vertices, faces)
        trimesh.repair.fix_winding(mesh)  # type: ignore[no-untyped-call]
        faces = np.asarray(mesh.faces, dtype=np.int64)
        said.append(f"turned faces at {len(twisted)} edges to one orientation")
    rims = boundary_loops(faces)
    if rims:
        vertices, faces = with_holes_closed(vertices, faces, rims)
        said.extend(f"closed a {hole_at(vertices, rim)}" for rim in rims)
    vertices, faces = _parted(vertices, faces)
    check_edges(vertices, faces)
    vertices, faces = _settled(vertices, faces, said)
    # Bodies that were told apart but still meet along an edge meet there in every file: welding shows it.
    repaired = welded(*_used(vertices, faces))
    check_surface(repaired)
    return repaired, said


def _used(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    used, index = np.unique(faces, return_inverse=True)
    return vertices[used], index.reshape(-1, 3)


def _without_doubles(vertices: Array, faces: Faces, said: list[str]) -> Faces:
    """Faces without repeats, walls and fins without thickness, and faces without an area that close nothing."""
    first, group, size = equal_rows(np.sort(faces, axis=1))
    if len(first) < len(faces):
        ascending = (faces < np.roll(faces, -1, axis=1)).sum(axis=1) == 2
        two_sided = (np.bincount(group, np.where(ascending, 1.0, -1.0)) == 0.0) & (size > 1)
        single = faces[np.sort(first)]
        thick = faces[np.sort(first[~two_sided])]
        before, after = edge_faults(single), edge_faults(thick)
        # Both sides go where one side alone would be a third face at an edge, and nothing opens without it.
        if len(after[1]) < len(before[1]) and len(after[0]) <= len(before[0]):
            said.append(f"dropped both sides of walls without thickness: {two_sided.sum()} pairs of faces")
            repeats = int((size - 1)[~two_sided].sum())
            single = thick
        else:
            repeats = len(faces) - len(first)
        if repeats:
            said.append(f"dropped {repeats} duplicate faces")
        faces = single
    corners = vertices[faces]
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    twice = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    flat = twice <= 1e-12 * edges.max(axis=1, initial=0.0) ** 2
    if flat.any():
        _, index, count = equal_rows(np.sort(directed_edges(faces), axis=1))
        idle = flat & (count[index.reshape(3, -1)] > 2).all(axis=0)
        if idle.any() and len(edge_faults(faces[~idle])[0]) <= len(edge_faults(faces)[0]):
            said.append(f"dropped {idle.sum()} faces without an area")
            faces = faces[~idle]
    return faces


def _parted(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    """Sheets that meet in an edge told apart: each gets vertices of its own there, at the same places."""
    crowded = edge_faults(faces)[1]
    if len(crowded) == 0:
        return vertices, faces
    m = len(faces)
    directed = directed_edges(faces)
    _, index, count = equal_rows(np.sort(directed, axis=1))
    order = np.argsort(index, kind="stable")
    start = np.r_[0, np.cumsum(count)]
    double = start[:-1][count == 2]
    pairs = [np.column_stack([order[double], order[double + 1]])]
    for k in np.flatnonzero(count > 2):
        rows = order[start[k] : start[k + 1]]
        pairs.append(rows[_pairs_around(vertices, directed[rows], faces[rows % m, (rows // m + 2) % 3])])
    one, two = np.concatenate(pairs).T
    # Corners of paired faces at either end of their edge are one vertex.
    rows = np.arange(3 * m)
    tail, head = 3 * (rows % m) + rows // m, 3 * (rows % m) + (rows // m + 1) % 3
    alike = directed[one, 0] == directed[two, 0]
    i = np.concatenate([tail[one], head[one]])
    j = np.concatenate([np.where(alike, tail[two], head[two]), np.where(alike, head[two], tail[two])])
    _, fan = connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(3 * m, 3 * m)))
    corners = faces.reshape(-1).copy()
    here = np.flatnonzero(np.isin(corners, crowded))
    _, at, inverse = np.unique(fan[here], return_index=True, return_inverse=True)
    owner = corners[here][at]
    names = np.arange(len(vertices), len(vertices) + len(owner))
    _, keeps = np.unique(owner, return_index=True)
    names[keeps] = owner[keeps]
    corners[here] = names[inverse.reshape(-1)]
    return np.concatenate([vertices, vertices[owner]]), corners.reshape(-1, 3)


def _pairs_around(vertices: Array, edges: Faces, opposite: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Which of the half-edges of one edge belong together, shape (k, 2): those with the solid between them.

    Where they do not alternate around the edge, all hang together.
    """
    u, v = edges[0]
    along = (vertices[v] - vertices[u]) / max(float(np.linalg.norm(vertices[v] - vertices[u])), 1e-300)
    away = vertices[opposite] - vertices[u]
    away = away - np.outer(away @ along, along)
    across = np.cross(along, away[0])
    angle = np.arctan2(away @ across, (away @ away[0]) * np.linalg.norm(along)) % (2.0 * np.pi)
    order = np.argsort(angle, kind="stable")
    gap = np.roll(angle[order], -1) - angle[order]
    gap[-1] += 2.0 * np.pi
    order = np.roll(order, -(int(np.argmax(gap)) + 1))
    group = np.cumsum(np.r_[0, np.roll(gap, -(int(np.argmax(gap)) + 1))[:-1] > 1e-6])
    # A face that runs u → v ends a solid, counter-clockwise; in one direction a solid ends before the next begins.
    ends = (edges[:, 0] == u)[order]
    order = order[np.lexsort([~ends, group])]
    ends = (edges[:, 0] == u)[order]
    if (ends == np.roll(ends, 1)).any():
        return np.column_stack([order, np.roll(order, -1)])
    begin = np.flatnonzero(~ends)
    return np.column_stack([order[begin], order[(begin + 1) % len(order)]])


def _settled(vertices: Array, faces: Faces, said: list[str]) -> tuple[Array, Faces]:
    """Bodies turned outwards, redundant ones dropped, overlapping ones united."""
    label = _bodies(faces)
    count = int(label.max()) + 1
    if count > _MOST_BODIES:
        raise SurfaceError(
            f"the surface has {count} separate bodies, more than {_MOST_BODIES}: keep those to print"
        )
    cuts = find_cuts(vertices, faces, label, count)
    refuse_cuts(cuts)
    crossing = cuts.crossing
    bodies = np.split(faces[np.argsort(label, kind="stable")], np.cumsum(np.bincount(label))[:-1])
    volume = np.array([signed_volume(make_surface(*_used(vertices, body))) for body in bodies])
    for body, value in zip(bodies, volume, strict=True):
        if abs(value) < 1e-12 * np.ptp(vertices[body].reshape(-1, 3), axis=0).max() ** 3:
            raise SurfaceError(
                f"{_body(vertices, body)} encloses no volume; delete it, or give it a thickness"
            )
    sign = np.sign(volume)
    inside = _nesting(vertices, bodies, crossing)
    sign, flipped = _turned(vertices, bodies, sign, inside, crossing)
    if flipped.all():
        said.append("flipped all faces: they pointed inwards")
    else:
        said.extend(
            f"flipped {_body(vertices, bodies[k])}: it was inside out" for k in np.flatnonzero(flipped)
        )
    bodies = [body[:, ::-1] if turn else body for body, turn in zip(bodies, flipped, strict=True)]
    around = inside @ sign
    useful = (around >= 1) != (around + sign >= 1)
    said.extend(
        f"dropped {_body(vertices, bodies[k])}: it lies inside solid material"
        for k in np.flatnonzero(~useful)
    )
    kept = np.flatnonzero(useful)
    parent = np.arange(count)
    for k in kept[sign[kept] < 0]:
        holders = np.flatnonzero(inside[k] & useful)
        parent[k] = holders[np.argmax(inside[holders].sum(axis=1))]
    meets = useful & crossing[:, useful].any(axis=1)
    owners = np.unique(parent[meets])
    if len(owners) == 0:
        return vertices, np.concatenate([bodies[k] for k in kept])
    solids = [np.concatenate([bodies[k] for k in kept if parent[k] == owner]) for owner in owners]
    x, y, z = cuts.meeting
    local, frame = _straightened(vertices, faces[cuts.face])
    points, triangles = _united(local, solids)
    points = points @ frame.T
    if number_of_cuts(points, triangles):
        raise SurfaceError(
            f"{len(owners)} bodies overlap or touch, the first at ({x:.3f}, {y:.3f}, {z:.3f}), and cannot be united; "
            "make one solid of them, or let them overlap more than by a hair"
        )
    said.append(
        f"united {len(owners)} bodies that overlap or touch, the first at ({x:.3f}, {y:.3f}, {z:.3f})"
    )
    rest = [bodies[k] for k in kept if parent[k] not in owners]
    return np.concatenate([vertices, points]), np.concatenate([*rest, triangles + len(vertices)])


def _bodies(faces: Faces) -> npt.NDArray[np.int64]:
    """The body of each face of a closed surface, shape (m,)."""
    m = len(faces)
    edges = np.sort(directed_edges(faces), axis=1)
    pairs = (np.lexsort(edges.T) % m).reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(m, m))
    return np.asarray(connected_components(graph)[1], dtype=np.int64)


def _turned(
    vertices: Array, bodies: list[Faces], sign: Array, inside: Flags, crossing: Flags
) -> tuple[Array, Flags]:
    """The sign of each body once those inside out are flipped, from the outside in; and which ones are."""
    sign = sign.copy()
    flipped = np.zeros(len(bodies), dtype=np.bool_)
    for k in np.argsort(inside.sum(axis=1), kind="stable"):
        if sign[k] > 0 or inside[k] @ sign > 0:
            continue
        tree = inside[:, k].copy()
        tree[k] = True
        depth = inside[np.ix_(tree, tree)].sum(axis=1)
        if crossing[k].any() or (sign[tree] != np.where(depth % 2 == 0, -1.0, 1.0)).any():
            what = "cuts another body" if crossing[k].any() else "so are bodies in it, but not all"
            raise SurfaceError(
                f"{_body(vertices, bodies[k])} is inside out and {what}: whether it is a solid or a cavity cannot "
                "be told; turn its faces outwards if it is solid"
            )
        sign[tree] *= -1.0
        flipped |= tree
    return sign, flipped


def _nesting(vertices: Array, bodies: list[Faces], crossing: Flags) -> Flags:
    """Whether body a lies in body b: shape (k, k), by the winding number of b around points of a."""
    low = np.array([vertices[body].reshape(-1, 3).min(axis=0) for body in bodies])
    high = np.array([vertices[body].reshape(-1, 3).max(axis=0) for body in bodies])
    inside = np.zeros((len(bodies), len(bodies)), dtype=np.bool_)
    for b, body in enumerate(bodies):
        within = (low >= low[b]).all(axis=1) & (high <= high[b]).all(axis=1) & ~crossing[b]
        within[b] = False
        for a in np.flatnonzero(within):
            some = bodies[a][np.linspace(0, len(bodies[a]) - 1, 8).astype(np.int64)]
            winding = np.abs(_winding(vertices[some].mean(axis=1), vertices[body]))
            yes, no = (winding > 0.9).any(), (winding < 0.1).any()
            if yes == no:
                raise SurfaceError(
                    f"{_body(vertices, bodies[a])} touches another one: whether it lies in it cannot be told; make one "
                    "solid of the two"
                )
            inside[a, b] = yes
    return inside


def _straightened(vertices: Array, face: npt.NDArray[np.int64]) -> tuple[Array, Array]:
    """Vertices in the frame of a face, where coordinates equal within rounding become equal; and the frame's axes.

    Bodies that touch in a plane which is not one of the axes' touch only nearly, and would leave slivers there.
    """
    a, b, c = vertices[face]
    x = (b - a) / np.linalg.norm(b - a)
    z = np.cross(x, c - a)
    z = z / np.linalg.norm(z)
    frame = np.column_stack([x, np.cross(z, x), z])
    local = vertices @ frame
    tolerance = TOUCHING * float(np.abs(vertices).max())
    for axis in range(3):
        order = np.argsort(local[:, axis])
        _level(local[:, axis], order, tolerance)
    return local, frame


def _united(vertices: Array, solids: list[Faces]) -> tuple[Array, Faces]:
    parts = []
    for solid in solids:
        points, triangles = _used(vertices, solid)
        mesh = manifold3d.Mesh64(
            np.ascontiguousarray(points), np.ascontiguousarray(triangles, dtype=np.uint64)
        )
        part = manifold3d.Manifold(mesh)
        if part.status() != manifold3d.Error.NoError or part.is_empty():
            raise SurfaceError(
                f"{_body(vertices, solid)} cannot be united with those it overlaps; make one solid of them"
            )
        parts.append(part)
    mesh = manifold3d.Manifold.batch_boolean(parts, manifold3d.OpType.Add).to_mesh64()
    return np.asarray(mesh.vert_properties)[:, :3].astype(np.float64), np.asarray(mesh.tri_verts).astype(
        np.int64
    )


def _body(vertices: Array, body: Faces) -> str:
    points = vertices[body].reshape(-1, 3)
    x, y, z = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return f"the body of {len(body)} faces around ({x:.3f}, {y:.3f}, {z:.3f})"


@nb.njit(cache=True, nogil=True)
def _level(values: Array, order: npt.NDArray[np.int64], tolerance: float) -> None:
    """Values within the tolerance of the lowest of their group become that one, in ascending order."""
    lowest = -np.inf
    for k in order:
        if values[k] - lowest > tolerance:
            lowest = values[k]
        values[k] = lowest


@nb.njit(cache=True, nogil=True)
def _winding(points: Array, corners: Array) -> Array:
    """How often the triangles `corners`, shape (m, 3, 3), go around each point (van Oosterom and Strackee)."""
    winding = np.zeros(len(points))
    for n in range(len(points)):
        for t in range(len(corners)):
            ax, ay, az = (
                corners[t, 0, 0] - points[n, 0],
                corners[t, 0, 1] - points[n, 1],
                corners[t, 0, 2] - points[n, 2],
            )
            bx, by, bz = (
                corners[t, 1, 0] - points[n, 0],
                corners[t, 1, 1] - points[n, 1],
                corners[t, 1, 2] - points[n, 2],
            )
            cx, cy, cz = (
                corners[t, 2, 0] - points[n, 0],
                corners[t, 2, 1] - points[n, 1],
                corners[t, 2, 2] - points[n, 2],
            )
            a, b, c = (
                np.sqrt(ax**2 + ay**2 + az**2),
                np.sqrt(bx**2 + by**2 + bz**2),
                np.sqrt(cx**2 + cy**2 + cz**2),
            )
            det = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
            dot = a * b * c + c * (ax * bx + ay * by + az * bz)
            dot += b * (ax * cx + ay * cy + az * cz) + a * (bx * cx + by * cy + bz * cz)
            winding[n] += np.arctan2(det, dot) / (2.0 * np.pi)
    return winding
