"""Surfaces: reading a mesh, and making sure that it bounds a solid.

Inside the package a surface is a `trimesh.Trimesh` made with `process=False`, in mm, whose vertices are distinct
points. This file is the doorway: whatever comes in leaves as such a surface, or is refused with the place.
"""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh

from .entrances import checks_kinds
from .errors import FormatError, SurfaceError
from .formats.lengths import factor_to_mm
from .formats.polygons import Polygons
from .formats.reading import check_file, read_polygons
from .formats.subdivision import subdivide as divided
from .holes import boundary_loops, hole_at
from .mesh_edges import edge_faults, equal_rows, middle_of
from .toolpath import FAR

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

# trimesh logs whole tracebacks of what it cannot read; without a handler Python prints them.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


def make_surface(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> trimesh.Trimesh:
    """A mesh of the given vertices, shape (n, 3), and triangles, shape (m, 3), left as they are."""
    return trimesh.Trimesh(
        np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64), process=False
    )


def read_surface(
    path: Path | str,
    *,
    unit: str | None = None,
    chord: float = 0.1,
    subdivide: str | None = None,
    levels: int = 2,
) -> trimesh.Trimesh:
    """The surface in an STL, PLY, OBJ, 3MF, glTF, STEP or 3DM file, with equal vertices merged.

    It comes in mm where the file states its unit (3MF, glTF, STEP, 3DM) or `unit` is given, else as it stands.

    Args:
        path: of the file; its ending tells the format.
        unit: "mm", "cm", "m", "in", …, of a file that does not say so itself.
        chord: how far the mesh may lie off the smooth surfaces of STEP and 3DM, mm.
        subdivide: "catmull-clark" or "loop" where the file holds the control mesh of a subdivision surface.
        levels: how often every face of the control mesh is divided.

    Raises:
        FormatError: no such file, an unknown ending, a file that holds no triangles or a point beyond 1 km; `unit`
            contradicts the file.
        SurfaceError: `chord`, `subdivide` or `levels` cannot be; the control mesh has an edge of three faces.
    """
    path = Path(path)
    check_file(path)
    if not (np.isfinite(chord) and chord > 0):
        raise SurfaceError(f"{path}: the chord tolerance must be above 0 mm, not {chord}")
    factor_to_mm(path, None, unit)
    mesh = read_polygons(path, unit, chord, polygons=subdivide == "catmull-clark")
    factor = factor_to_mm(path, mesh.unit, unit)
    _check_polygons(mesh, path, factor)
    if subdivide is not None:
        if mesh.exact:
            raise FormatError(
                f"{path}: holds smooth surfaces; leave subdivision out, or give their control mesh"
            )
        try:
            mesh = divided(mesh, subdivide, levels)
        except SurfaceError as error:
            raise SurfaceError(f"{path}: {error}") from None
    surface = welded(factor * mesh.vertices, mesh.triangles())
    if len(surface.faces) == 0:
        raise FormatError(f"{path}: all its triangles are degenerate")
    return surface


def _check_polygons(mesh: Polygons, path: Path, factor: float) -> None:
    """Refuse what cannot be a surface, in the words of its file."""
    vertices = mesh.vertices
    if len(vertices) == 0 or not any(len(block) for block in mesh.faces):
        raise FormatError(f"{path}: holds no triangles")
    if vertices.shape[1:] != (3,) or any(block.ndim != 2 or block.shape[1] < 3 for block in mesh.faces):
        raise FormatError(
            f"{path}: its vertices do not have three coordinates each, or its faces three corners"
        )
    named = np.concatenate([block.reshape(-1) for block in mesh.faces])
    if named.min() < 0 or named.max() >= len(vertices):
        wrong = named.max() if named.min() >= 0 else named.min()
        raise FormatError(f"{path}: a face names vertex {wrong}, but there are {len(vertices)}")
    if len(bad := np.flatnonzero(~(np.abs(factor * vertices) <= FAR).all(axis=1))):
        point = ", ".join(f"{value:.6g}" for value in vertices[bad[0]])
        kind = "is not within 1 km" if np.isfinite(vertices[bad[0]]).all() else "is not a finite point"
        raise FormatError(f"{path}: vertex {bad[0]} ({point}) {kind}; check the file, and its unit")


def welded(vertices: Array, faces: Faces) -> trimesh.Trimesh:
    """Vertices at exactly the same point merged; triangles that lose a corner by it dropped."""
    first, index, _ = equal_rows(vertices + 0.0)
    points = vertices[first]
    corners = index[faces]
    proper = (
        (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]) & (corners[:, 2] != corners[:, 0])
    )
    return make_surface(points, corners[proper])


@checks_kinds
def check_surface(surface: trimesh.Trimesh) -> None:
    """Make sure that a mesh bounds a solid: closed, two faces an edge, outward normals.

    Raises:
        SurfaceError: it does not; the message counts the faults and names the place of the first.
    """
    faces = np.asarray(surface.faces)
    vertices = np.asarray(surface.vertices)
    if len(faces) == 0:
        raise SurfaceError("the surface is empty")
    if not np.isfinite(vertices).all():
        raise SurfaceError("the surface has a vertex that is not a finite point")
    check_edges(vertices, faces)
    size = float(np.ptp(vertices, axis=0).max())
    if abs(signed_volume(surface)) < 1e-12 * size**3:
        raise SurfaceError("the surface encloses no volume; make it a closed solid")
    if signed_volume(surface) < 0:
        raise SurfaceError("the surface is inside out: its normals point inwards; flip all faces")


def check_edges(vertices: Array, faces: Faces) -> None:
    open_edges, crowded, twisted = edge_faults(faces)
    if len(crowded):
        raise SurfaceError(
            f"the surface is not manifold: {len(crowded)} edges have more than two faces, the first at "
            f"{middle_of(vertices, crowded[0])}; make one solid of the bodies that touch there"
        )
    if len(open_edges):
        holes = boundary_loops(faces)
        places = "; ".join(str(hole_at(vertices, rim)) for rim in holes[:5])
        more = f"; and {len(holes) - 5} more" if len(holes) > 5 else ""
        raise SurfaceError(
            f"the surface is open: {len(holes)} {'hole' if len(holes) == 1 else 'holes'}: {places}{more}; "
            "close it, or let `repair_surface` do it"
        )
    if len(twisted):
        raise SurfaceError(
            f"the surface is not consistently oriented: {len(twisted)} edges have two faces that turn the same way, "
            f"the first at {middle_of(vertices, twisted[0])}; flip the faces on one side"
        )


@checks_kinds
def signed_volume(surface: trimesh.Trimesh) -> float:
    """Enclosed volume, mm³; negative where the normals point inwards."""
    corners = np.asarray(surface.vertices)[np.asarray(surface.faces)]
    corners = corners - corners.reshape(-1, 3).mean(axis=0)
    return float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0)
