"""3DM, the files of Rhino: meshes as they are; surfaces, polysurfaces, extrusions and SubDs within a chord tolerance.

What is hidden, or on a hidden layer, is left out, and so are curves, points and notes. Blocks stand where they are
inserted.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from twins.errors import FormatError

from .lengths import factor_to_mm
from .polygons import Polygons, side_by_side
from .rhino_objects import Shown, objects_shown, open_3dm, unit_of_3dm

Array = npt.NDArray[np.float64]


def read_3dm(path: Path, unit: str | None, chord: float, *, polygons: bool = False) -> Polygons:
    """All visible meshes, surfaces, polysurfaces, extrusions and SubDs of a file, in its own unit.

    Args:
        path: of the file.
        unit: of the file if it does not say so itself; None for mm.
        chord: how far the mesh may lie off smooth surfaces, mm.
        polygons: SubDs without creases come as their control nets.

    Raises:
        FormatError: the file cannot be read, or holds no surfaces; a face cannot be meshed.
    """
    model = open_3dm(path)
    stated = unit_of_3dm(model, path)
    chord = chord / factor_to_mm(path, stated, unit)
    parts: list[Polygons] = []
    others: set[str] = set()
    for shown in objects_shown(model, path):
        scale = float(np.cbrt(abs(np.linalg.det(shown.placed[:3, :3])))) or 1.0
        part = _part(shown, chord / scale, path, polygons=polygons)
        if part is None:
            others.add(type(shown.geometry).__name__)
        else:
            parts.append(_placed(part, shown.placed))
    if not parts:
        found = f"; it holds {', '.join(sorted(others))}" if others else ""
        raise FormatError(
            f"{path}: holds no meshes, surfaces, polysurfaces, extrusions or SubDs that are visible{found}"
        )
    return side_by_side(parts, stated, exact=any(part.exact for part in parts))


def _part(shown: Shown, chord: float, path: Path, *, polygons: bool) -> Polygons | None:
    """An object as polygons; None if it has no surface."""
    import rhino3dm  # noqa: PLC0415 - only where it is needed

    from .brep import mesh_of_brep  # noqa: PLC0415 - only where it is needed
    from .rhino_subd import mesh_of_subd  # noqa: PLC0415 - only where it is needed

    geometry = shown.geometry
    if isinstance(geometry, rhino3dm.Mesh):
        return _mesh(geometry)
    if isinstance(geometry, rhino3dm.SubD):
        return mesh_of_subd(geometry, chord, path, net=polygons)
    brep: Any = geometry
    if isinstance(geometry, rhino3dm.Extrusion):
        brep = geometry.ToBrep(True)  # True: split at kinks
    elif isinstance(geometry, rhino3dm.Surface) and not isinstance(geometry, rhino3dm.BrepFace):
        brep = rhino3dm.Brep.CreateFromSurface(geometry)
    if brep is None:
        raise FormatError(f"{shown.where}: is not valid; repair it in Rhino (command SelBadObjects)")
    return mesh_of_brep(brep, chord, path) if isinstance(brep, rhino3dm.Brep) else None


def _placed(part: Polygons, placed: Array) -> Polygons:
    """A part where its block is inserted; a mirror image is turned inside out again."""
    if (placed == np.eye(4)).all():
        return part
    faces = part.faces
    if np.linalg.det(placed[:3, :3]) < 0:
        faces = tuple(block[:, ::-1] for block in faces)
    return Polygons(part.vertices @ placed[:3, :3].T + placed[:3, 3], faces, part.unit, part.exact)


def _mesh(mesh: Any) -> Polygons:
    vertices = np.array([(p.X, p.Y, p.Z) for p in mesh.Vertices.ToPoint3dArray()], dtype=np.float64).reshape(
        -1, 3
    )
    faces = np.array([mesh.Faces[i] for i in range(mesh.Faces.Count)], dtype=np.int64).reshape(-1, 4)
    triangle = faces[:, 2] == faces[:, 3]
    blocks = (faces[triangle][:, :3], faces[~triangle])
    return Polygons(vertices, tuple(block for block in blocks if len(block)))
