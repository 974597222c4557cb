"""3DM, the files of Rhino: meshes as they are; surfaces, polysurfaces and extrusions within a chord tolerance.

What is hidden, or on a hidden layer, is left out, and so are curves, points and notes. Blocks stand where they are
inserted.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from twins.errors import FormatError

from .polygons import Polygons, factor_to_mm, side_by_side

Array = npt.NDArray[np.float64]

_UNITS: Final = {
    "Microns": "um",
    "Millimeters": "mm",
    "Centimeters": "cm",
    "Decimeters": "dm",
    "Meters": "m",
    "Kilometers": "km",
    "Inches": "in",
    "Feet": "ft",
    "Yards": "yd",
}

_DEEPEST = 32  # blocks in blocks


def open_3dm(path: Path) -> Any:
    """The file as rhino3dm has it.

    Raises:
        FormatError: it cannot be read, or rhino3dm is not installed.
    """
    try:
        from .guarded_3dm import open_guarded  # noqa: PLC0415 - only where it is needed
    except ImportError as error:
        raise FormatError(
            f"{path}: reading 3DM needs the package rhino3dm; install it with 'pip install rhino3dm'"
        ) from error
    return open_guarded(path)


def unit_of_3dm(model: Any, path: Path) -> str | None:
    """The unit of the model; None if it has none.

    Raises:
        FormatError: the unit is none that a part is drawn in.
    """
    name = str(model.Settings.ModelUnitSystem.name)
    if name in {"None", "Unset"}:
        return None
    if name not in _UNITS:
        raise FormatError(
            f"{path}: its unit is '{name}'; change it to millimetres with the command Units in Rhino, and save"
        )
    return _UNITS[name]


def read_3dm(path: Path, unit: str | None, chord: float) -> Polygons:
    """All visible meshes, surfaces, polysurfaces and extrusions of a file, in its own unit.

    Args:
        path: of the file.
        unit: of the file if it does not say so itself; None for mm.
        chord: how far the mesh may lie off smooth surfaces, mm.

    Raises:
        FormatError: the file cannot be read, or holds no surfaces; a face cannot be meshed.
    """
    model = open_3dm(path)
    stated = unit_of_3dm(model, path)
    chord = chord / factor_to_mm(path, stated, unit)
    hidden = {layer.Index for layer in model.Layers if not layer.Visible}
    shown = [
        item.Geometry
        for item in model.Objects
        if item.Attributes.Visible
        and not item.Attributes.IsInstanceDefinitionObject
        and item.Attributes.LayerIndex not in hidden
    ]
    parts: list[Polygons] = []
    others: set[str] = set()
    for geometry in shown:
        parts += _parts(geometry, model, chord, path, others, 0)
    if not parts:
        found = f"; it holds {', '.join(sorted(others))}" if others else ""
        raise FormatError(
            f"{path}: holds no meshes, surfaces, polysurfaces or extrusions that are visible{found}"
        )
    return side_by_side(parts, stated, exact=any(part.exact for part in parts))


def _parts(
    geometry: Any, model: Any, chord: float, path: Path, others: set[str], depth: int
) -> list[Polygons]:
    import rhino3dm  # noqa: PLC0415 - only where it is needed

    from .brep import mesh_of_brep  # noqa: PLC0415 - only where it is needed

    if isinstance(geometry, rhino3dm.Mesh):
        return [_mesh(geometry)]
    if isinstance(geometry, rhino3dm.SubD):
        raise FormatError(
            f"{path}: holds a SubD; in Rhino turn it into a mesh or a polysurface (command ToNURBS), and save"
        )
    if isinstance(geometry, rhino3dm.InstanceReference):
        return _block(geometry, model, chord, path, others, depth)
    brep = geometry
    if isinstance(geometry, rhino3dm.Extrusion):
        brep = geometry.ToBrep(True)  # True: split at kinks
    elif isinstance(geometry, rhino3dm.Surface) and not isinstance(geometry, rhino3dm.BrepFace):
        brep = rhino3dm.Brep.CreateFromSurface(geometry)
    if brep is None:
        raise FormatError(
            f"{path}: holds a surface that is not valid; repair it in Rhino (command SelBadObjects)"
        )
    if isinstance(brep, rhino3dm.Brep):
        return [mesh_of_brep(brep, chord, path)]
    others.add(type(geometry).__name__)
    return []


def _block(
    reference: Any, model: Any, chord: float, path: Path, others: set[str], depth: int
) -> list[Polygons]:
    """The geometry of a block where it is inserted."""
    if depth > _DEEPEST:
        raise FormatError(
            f"{path}: its blocks contain one another; explode them in Rhino (command ExplodeBlock)"
        )
    form = reference.Xform
    matrix = np.array([[getattr(form, f"M{i}{j}") for j in range(4)] for i in range(4)])
    scale = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3])))) or 1.0
    definition = model.InstanceDefinitions.FindId(reference.ParentIdefId)
    wanted = {str(key) for key in definition.GetObjectIds()} if definition is not None else set()
    placed = []
    for item in model.Objects:
        if str(item.Attributes.Id) in wanted:
            for part in _parts(item.Geometry, model, chord / scale, path, others, depth + 1):
                faces = part.faces
                if np.linalg.det(matrix[:3, :3]) < 0:
                    faces = tuple(block[:, ::-1] for block in faces)
                points = part.vertices @ matrix[:3, :3].T + matrix[:3, 3]
                placed.append(Polygons(points, faces, part.unit, part.exact))
    return placed


def _mesh(mesh: Any) -> Polygons:
    vertices = np.array([(p.X, p.Y, p.Z) for p in mesh.Vertices.ToPoint3dArray()], dtype=np.float64).reshape(
        -1, 3
    )
    faces = np.array([mesh.Faces[i] for i in range(mesh.Faces.Count)], dtype=np.int64).reshape(-1, 4)
    triangle = faces[:, 2] == faces[:, 3]
    blocks = (faces[triangle][:, :3], faces[~triangle])
    return Polygons(vertices, tuple(block for block in blocks if len(block)))
