"""SubD of 3DM files: Catmull and Clark's surfaces with Rhino's creases, as quads whose corners lie on the surface."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from twins.errors import FormatError

from .polygons import Polygons, by_corners

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

MOST: Final = 400_000
"""Faces: beyond this the tolerance is too fine for the part."""


def mesh_of_subd(subd: Any, chord: float, path: Path, *, net: bool = False) -> Polygons:
    """A SubD as polygons; a solid faces outwards.

    Rhino's own rule divides the control net until its faces lie within the tolerance, and their corners are then
    moved to where the rule tends.

    Args:
        subd: rhino3dm's SubD.
        chord: how far the mesh may lie off the surface, in the unit of the file.
        path: of the file, for messages.
        net: the control net instead, if it has no creases.

    Raises:
        FormatError: the SubD is not valid, or needs too many faces; the package rhino3dm cannot divide it.
    """
    if not hasattr(subd, "Vertices"):
        raise FormatError(
            f"{path}: holds a SubD, which this version of the package rhino3dm does not read; update it, or in Rhino "
            "turn it into a mesh or a polysurface (command ToNURBS), and save"
        )
    if not subd.IsValid or not subd.FaceCount:
        raise FormatError(
            f"{path}: holds a SubD that is not valid; repair it in Rhino (command SelBadObjects)"
        )
    if net and not any(edge.IsCrease for edge in subd.Edges):
        return _read(subd, on_surface=False)
    fine = subd.Duplicate()
    while True:
        if 4 * fine.FaceCount > MOST or not fine.Subdivide(1):
            raise FormatError(
                f"{path}: a SubD needs more than {MOST} faces for the tolerance {chord:.3g}; give a larger one"
            )
        mesh = _read(fine, on_surface=True)
        # The faces that have just been divided miss the surface four times as far as these do.
        if _miss(mesh) <= 2.0 * chord:
            break
    return _outwards(mesh) if subd.IsSolid else mesh


def _read(subd: Any, *, on_surface: bool) -> Polygons:
    vertices = list(subd.Vertices)
    row = {vertex.Id: i for i, vertex in enumerate(vertices)}
    points = [vertex.SurfacePoint if on_surface else vertex.ControlNetPoint for vertex in vertices]
    faces = [[row[face.Vertex(i).Id] for i in range(face.VertexCount)] for face in subd.Faces]
    return Polygons(np.array([(p.X, p.Y, p.Z) for p in points]), by_corners(faces), exact=on_surface)


def _miss(mesh: Polygons) -> float:
    """How far the surface lies off the faces that the quads of a mesh have been made from, at most.

    Of the four corners of a quad the second is one of the face that was divided, the first and the third lie on its
    edges, and the last on its middle.
    """
    (quads,) = mesh.faces
    on_edges = _off_means(mesh.vertices, quads[:, [0, 2]].reshape(-1), np.repeat(quads[:, 1], 2))
    return max(on_edges, _off_means(mesh.vertices, quads[:, 3], quads[:, 1]))


def _off_means(points: Array, these: Faces, those: Faces) -> float:
    """How far points lie off the means of others, at most; `these` may name a point several times."""
    times = np.bincount(these, minlength=len(points))
    sums = np.column_stack([np.bincount(these, points[those, k], len(points)) for k in range(3)])
    named = times > 0
    return float(np.linalg.norm(sums[named] / times[named, None] - points[named], axis=1).max())


def _outwards(mesh: Polygons) -> Polygons:
    """A closed mesh with its faces turned outwards."""
    corners = (mesh.vertices - mesh.vertices.mean(axis=0))[mesh.triangles()]
    if np.linalg.det(corners).sum() >= 0:
        return mesh
    return Polygons(mesh.vertices, tuple(block[:, ::-1] for block in mesh.faces), mesh.unit, mesh.exact)
