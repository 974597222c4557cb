"""Boundary representations of 3DM files as meshes, within a chord tolerance.

Edges are sampled once, so that the faces on both sides share their points: a closed solid gives a closed mesh. Of a
face the boundary is carried over into the parameters of its surface, triangulated there, and every edge inside the
face is halved until the surface lies within the tolerance of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from twins.errors import FormatError
from twins.mesh_edges import edge_faults, middle_of

from .brep_boundary import SHARE, boundary_of, sampled_edges, settled
from .brep_refining import Patch, patch_of, pulled_apart
from .polygons import Polygons


def mesh_of_brep(brep: Any, chord: float, path: Path) -> Polygons:
    """Triangles of all faces, with shared points along shared edges; a solid is closed and faces outwards.

    Args:
        brep: rhino3dm's Brep.
        chord: how far the mesh may lie off the faces, in the unit of the file.
        path: of the file, for messages.

    Raises:
        FormatError: a face that cannot be meshed; the message gives its number. A solid that does not close.
    """
    if not len(brep.Faces):
        raise FormatError(f"{path}: a polysurface has no faces; delete it in Rhino")
    with _named(path, "a polysurface"):
        edges = sampled_edges(brep, SHARE * chord)
    boundaries = []
    for i in range(len(brep.Faces)):
        with _named(path, f"face {i} of a polysurface"):
            boundaries.append(boundary_of(brep.Faces[i], edges, chord))
    boundaries, edges = settled(boundaries, edges, chord)
    points, runs = edges.numbered()
    count = len(points)
    patches: list[Patch] = []
    for i, boundary in enumerate(boundaries):
        with _named(path, f"face {i} of a polysurface"):
            patches.append(patch_of(boundary, points, runs, chord, count))
        count = max(count, int(patches[-1].number.max()) + 1)
    patches = pulled_apart(patches, count)

    vertices = np.empty((max(count, *(int(patch.number.max()) + 1 for patch in patches)), 3))
    for patch in patches:
        vertices[patch.number] = patch.xyz
    vertices[: len(points)] = points
    faces = [
        patch.corners()[:, ::-1] if brep.Faces[i].OrientationIsReversed else patch.corners()
        for i, patch in enumerate(patches)
    ]
    triangles = np.concatenate(faces)
    if brep.IsSolid:
        faulty = np.concatenate(edge_faults(triangles))
        if len(faulty):
            raise FormatError(
                f"{path}: a solid does not close within the tolerance {chord:.3g} near "
                f"{middle_of(vertices, faulty[0])}; give another `chord`, or export the part to STEP"
            )
        corners = vertices[triangles] - vertices.mean(axis=0)
        # A file may hold a solid inside out.
        if np.linalg.det(corners).sum() < 0:
            triangles = triangles[:, ::-1]
    return Polygons(vertices, (triangles,), exact=True)


@contextmanager
def _named(path: Path, what: str) -> Iterator[None]:
    try:
        yield
    except (ValueError, IndexError, FloatingPointError, AttributeError) as error:
        raise FormatError(
            f"{path}: {what} cannot be meshed: {error}; rebuild it in Rhino, or export the part to STEP"
        ) from error
