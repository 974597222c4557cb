"""Subdivision surfaces: control meshes refined by Catmull and Clark's rule, or by Loop's.

Catmull & Clark 1978: a face point is the mean of its corners, an edge point the mean of its ends and the face points
beside it, and a vertex with n faces moves to (F + 2 R + (n - 3) P) / n, with F the mean of its face points and R of
the middles of its edges. Open boundaries become cubic B-splines (Hoppe et al. 1994): edge points are middles, and a
vertex moves to 3/4 of itself and 1/8 of either neighbour.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt
import trimesh

from twins.errors import SurfaceError
from twins.mesh_edges import equal_rows, middle_of

from .polygons import Polygons

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

SCHEMES: Final = ("catmull-clark", "loop")

MOST: Final = 8
"""Levels of subdivision at most: each makes four faces of one."""


def subdivide(mesh: Polygons, scheme: str, levels: int = 2) -> Polygons:
    """The control mesh after some levels of subdivision, its vertices at equal points merged.

    Args:
        mesh: faces of any number of corners; Loop's rule takes them as triangles.
        scheme: "catmull-clark" or "loop".
        levels: how often every face is divided, 0 to 8.

    Raises:
        SurfaceError: an unknown scheme or number of levels; an edge of more than two faces.
    """
    if scheme not in SCHEMES:
        raise SurfaceError(f"unknown subdivision '{scheme}'; choose one of {', '.join(SCHEMES)}")
    if not (isinstance(levels, int) and 0 <= levels <= MOST):
        raise SurfaceError(f"levels of subdivision must be a whole number from 0 to {MOST}, not {levels}")
    mesh = _merged(mesh)
    if scheme == "loop":
        return _loop(mesh, levels)
    for _ in range(levels):
        mesh = catmull_clark(mesh)
    return mesh


def catmull_clark(mesh: Polygons) -> Polygons:
    """One level of Catmull and Clark's rule: quads, four corners around each corner of a face."""
    points = mesh.vertices
    face_points = np.concatenate([points[block].mean(axis=1) for block in mesh.faces])
    corner, following, face = _corners(mesh)
    ends, edge, count = _edges(points, np.column_stack([corner, following]))
    inner = count == 2
    middles = points[ends].mean(axis=1)
    beside = _sums(edge, face_points[face], len(ends))
    edge_points = np.where(inner[:, None], 0.5 * middles + 0.25 * beside, middles)

    faces_at = np.bincount(corner, minlength=len(points)).astype(np.float64)[:, None]
    edges_at = np.bincount(ends.reshape(-1), minlength=len(points)).astype(np.float64)[:, None]
    with np.errstate(all="ignore"):  # vertices without a face stay
        F = _sums(corner, face_points[face], len(points)) / faces_at
        R = _sums(ends.reshape(-1), np.repeat(middles, 2, axis=0), len(points)) / edges_at
        moved = (F + 2.0 * R + (faces_at - 3.0) * points) / faces_at
    rim = ends[~inner]
    at_rim = np.bincount(rim.reshape(-1), minlength=len(points))
    around = _sums(rim.reshape(-1), points[rim[:, ::-1].reshape(-1)], len(points))
    on_curve = 0.75 * points + 0.125 * around
    # Where sheets touch in one vertex more than two open edges meet: it stays, as a corner of each.
    moved = np.where((at_rim == 2)[:, None], on_curve, np.where((at_rim > 0)[:, None], points, moved))
    moved = np.where(faces_at > 0, moved, points)

    before = edge[_row_of_previous(mesh)]
    n, m = len(points), len(face_points)
    quads = np.column_stack([corner, n + m + edge, n + face, n + m + before])
    return Polygons(np.concatenate([moved, face_points, edge_points]), (quads,), mesh.unit)


def _loop(mesh: Polygons, levels: int) -> Polygons:
    faces = mesh.triangles()
    _edges(mesh.vertices, np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]))
    if levels == 0:
        return Polygons(mesh.vertices, (faces,), mesh.unit)
    loop: Any = trimesh.remesh.subdivide_loop
    vertices, faces = loop(mesh.vertices, faces, iterations=levels)
    return Polygons(np.asarray(vertices, dtype=np.float64), (np.asarray(faces, dtype=np.int64),), mesh.unit)


def _merged(mesh: Polygons) -> Polygons:
    """Vertices at equal points merged, unused ones and faces that fold by it left out."""
    first, index, _ = equal_rows(mesh.vertices + 0.0)
    blocks = []
    for block in mesh.faces:
        corners = index[block]
        ordered = np.sort(corners, axis=1)
        kept = corners[(ordered[:, 1:] != ordered[:, :-1]).all(axis=1)]
        if len(kept):
            blocks.append(kept)
    if not blocks:
        raise SurfaceError("the control mesh has no faces")
    used = np.unique(np.concatenate([block.reshape(-1) for block in blocks]))
    place = np.empty(len(first), dtype=np.int64)
    place[used] = np.arange(len(used))
    return Polygons(mesh.vertices[first][used], tuple(place[block] for block in blocks), mesh.unit)


def _corners(mesh: Polygons) -> tuple[Faces, Faces, Faces]:
    """For each corner of each face: its vertex, the next one, and the face's number."""
    corner = np.concatenate([block.reshape(-1) for block in mesh.faces])
    following = np.concatenate([np.roll(block, -1, axis=1).reshape(-1) for block in mesh.faces])
    sizes = np.concatenate([np.full(len(block), block.shape[1]) for block in mesh.faces])
    return corner, following, np.repeat(np.arange(len(sizes)), sizes)


def _row_of_previous(mesh: Polygons) -> Faces:
    """For each corner of each face, the row of the corner before it."""
    rows, at = [], 0
    for block in mesh.faces:
        own = at + np.arange(block.size).reshape(block.shape)
        rows.append(np.roll(own, 1, axis=1).reshape(-1))
        at += block.size
    return np.concatenate(rows)


def _edges(points: Array, directed: Faces) -> tuple[Faces, Faces, Faces]:
    """Distinct edges, shape (e, 2); which one each directed edge is; of how many faces."""
    ordered = np.sort(directed, axis=1)
    first, index, count = equal_rows(ordered)
    if (count > 2).any():
        edge = ordered[first[count > 2][0]]
        raise SurfaceError(
            f"the control mesh has an edge of {count.max()} faces at {middle_of(points, edge)}; "
            "subdivision takes at most two faces at an edge"
        )
    return ordered[first], index, count


def _sums(where: Faces, values: Array, length: int) -> Array:
    return np.column_stack([np.bincount(where, values[:, axis], length) for axis in range(3)])
