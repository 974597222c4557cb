"""Mesh formats: STL, PLY, OBJ, 3MF and glTF by trimesh; polygons of OBJ and PLY as they are, for subdivision."""

from __future__ import annotations

import warnings
import zipfile
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh

from twins.errors import FormatError

from .polygons import Polygons, by_corners

SUFFIXES: Final = (".stl", ".ply", ".obj", ".3mf", ".glb", ".gltf")

_UNITS_3MF = {
    "micron": "um",
    "millimeter": "mm",
    "centimeter": "cm",
    "inch": "in",
    "foot": "ft",
    "meter": "m",
}

Y_UP_TO_Z_UP: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""glTF has +y up; here +z is."""


def read_mesh(path: Path, *, polygons: bool = False) -> Polygons:
    """The mesh in a file, in the unit of the file.

    Args:
        path: of an STL, PLY, OBJ, 3MF or glTF file.
        polygons: keep quads and larger faces of OBJ and PLY; otherwise all faces come as triangles.

    Raises:
        FormatError: the file cannot be read; the message names it.
    """
    suffix = path.suffix.lower()
    try:
        # What is wrong with the numbers of a broken file is said by the caller, not by NumPy's warnings.
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            if polygons and suffix == ".obj":
                return _read_obj(path)
            if polygons and suffix == ".ply":
                return _read_ply(path)
            unit = unit_of_mesh(path)
            loaded: Any = trimesh.load(path, process=False, force="mesh", skip_materials=True)
            vertices = np.asarray(loaded.vertices, dtype=np.float64)
            faces = np.asarray(loaded.faces, dtype=np.int64)
            if suffix in {".glb", ".gltf"} and vertices.shape[1:] == (3,):
                vertices = vertices @ Y_UP_TO_Z_UP.T
    except FormatError:
        raise
    except Exception as error:
        raise FormatError(
            f"{path}: cannot be read as {path.suffix[1:].upper()}: {_first_line(error)}"
        ) from error
    return Polygons(vertices, (faces,), unit)


def unit_of_mesh(path: Path) -> str | None:
    """The unit that a mesh file states: that of 3MF, metres for glTF, none for the others.

    Raises:
        FormatError: the file states a unit that its format does not have.
    """
    if path.suffix.lower() in {".glb", ".gltf"}:
        return "m"
    if path.suffix.lower() != ".3mf":
        return None
    from lxml import etree  # type: ignore[import-untyped] # noqa: PLC0415 - only where it is needed

    with zipfile.ZipFile(path) as archive:
        name = next(name for name in archive.namelist() if "3d/3dmodel.model" in name.lower())
        with archive.open(name) as model:
            _, root = next(iter(etree.iterparse(model, events=("start",), resolve_entities=False)))
            said = root.get("unit", "millimeter")
    if said not in _UNITS_3MF:
        raise FormatError(f"{path}: unknown unit '{said}'; 3MF has {', '.join(_UNITS_3MF)}")
    return _UNITS_3MF[said]


def _read_obj(path: Path) -> Polygons:
    points: list[list[float]] = []
    faces: list[list[int]] = []
    for line in path.read_text(encoding="utf-8", errors="replace").replace("\\\n", " ").splitlines():
        words = line.split("#")[0].split()
        if words[:1] == ["v"]:
            points.append([float(word) for word in words[1:4]])
        elif words[:1] == ["f"]:
            numbers = [int(word.split("/")[0]) for word in words[1:]]
            # Vertices count from 1, or back from the last one so far.
            faces.append([number - 1 if number > 0 else len(points) + number for number in numbers])
    return Polygons(np.array(points, dtype=np.float64).reshape(-1, 3), by_corners(faces))


def _read_ply(path: Path) -> Polygons:
    import meshio  # noqa: PLC0415 - only where it is needed

    mesh: Any = meshio.ply.read(path)
    faces = [face.tolist() for cells in mesh.cells for face in cells.data if len(face) >= 3]
    return Polygons(np.asarray(mesh.points, dtype=np.float64), by_corners(faces))


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]
