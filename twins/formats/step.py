"""STEP: solids of CAD programs as a triangle mesh, in mm, by Open CASCADE (the package cascadio).

Open CASCADE reads in a process of its own: it writes to the console, and a broken file may end it.
"""

from __future__ import annotations

import io
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from twins.errors import FormatError
from twins.mesh_edges import edge_faults, equal_rows

from .polygons import Polygons

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

SHARE: Final = 0.4
"""Part of the chord tolerance that Open CASCADE is asked for: its triangles lie up to 2.2 times as far off."""

ANGLE: Final = 0.5
"""Largest turn between neighbouring edges of a curve, radians."""

_READ = """
import pathlib, sys
sys.modules["trimesh"] = None  # cascadio can do without, and starts four times as fast
import cascadio
given, made, chord, angle = sys.argv[1:]
data = cascadio.load(
    pathlib.Path(given).read_bytes(), tol_linear=float(chord), tol_angular=float(angle), use_parallel=False
)
pathlib.Path(made).write_bytes(data)
"""

_SI = re.compile(
    r"LENGTH_UNIT\s*\(\s*\)\s*NAMED_UNIT\s*\(\s*\*\s*\)\s*SI_UNIT\s*\(\s*(?:\.(\w+)\.|\$)\s*,\s*\.METRE\.",
    re.IGNORECASE,
)
_OTHER = re.compile(r"CONVERSION_BASED_UNIT\s*\(\s*'([^']*)'\s*,\s*#\d+\s*\)\s*LENGTH_UNIT", re.IGNORECASE)
_PREFIX = {"MICRO": "um", "MILLI": "mm", "CENTI": "cm", "DECI": "dm", "": "m", "KILO": "km"}
_NAME = {"INCH": "in", "INCHES": "in", "FOOT": "ft", "FEET": "ft", "YARD": "yd"}


def unit_of_step(path: Path) -> str | None:
    """The length unit that the file states, if it is one and a usual one."""
    text = path.read_text(encoding="latin-1")
    others = {_NAME.get(name.strip().upper(), name) for name in _OTHER.findall(text)}
    # A conversion-based unit is defined by an SI unit, which is then in the file too.
    found = others or {_PREFIX.get(prefix.upper(), prefix) for prefix in _SI.findall(text)}
    unit = found.pop() if len(found) == 1 else None
    return unit if unit in {*_PREFIX.values(), *_NAME.values()} else None


def read_step(path: Path, chord: float) -> Polygons:
    """The solids and shells of a STEP file, in mm.

    Args:
        path: of the file.
        chord: how far the mesh may lie off the exact surface, mm.

    Raises:
        FormatError: the file cannot be read, or holds no surfaces.
    """
    if not path.read_bytes()[:4096].lstrip().startswith(b"ISO-10303-21"):
        raise FormatError(
            f"{path}: cannot be read as STEP: it does not begin with ISO-10303-21; export it anew"
        )
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "mesh.glb"
        arguments = [str(path), str(made), repr(SHARE * chord), repr(ANGLE)]
        ended = subprocess.run(
            [sys.executable, "-c", _READ, *arguments],
            capture_output=True,
            check=False,
            text=True,
            errors="replace",
        )
        content = made.read_bytes() if ended.returncode == 0 and made.is_file() else b""
    if "No module named 'cascadio'" in ended.stderr:
        raise FormatError(
            f"{path}: reading STEP needs the package cascadio; install it with 'pip install cascadio'"
        )
    if not content:
        raise FormatError(f"{path}: cannot be read as STEP: it is broken or cut off; export it anew")
    meshes = _meshes(content)
    if not meshes:
        raise FormatError(f"{path}: holds no surfaces, perhaps only curves; export the solids to STEP")
    vertices = np.concatenate([vertices for vertices, _ in meshes])
    at = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = np.concatenate([faces + first for (_, faces), first in zip(meshes, at, strict=False)])
    return Polygons(vertices, (faces,), "mm", exact=True)


def _meshes(content: bytes) -> list[tuple[Array, Faces]]:
    """The bodies in a GLB of Open CASCADE, each welded, placed as in the assembly, in mm."""
    try:
        scene: Any = trimesh.load_scene(
            io.BytesIO(content), file_type="glb", process=False, skip_materials=True
        )
    except Exception:  # trimesh does not take a scene without geometry
        return []
    found = []
    for node in sorted(scene.graph.nodes_geometry):
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            vertices, faces = weld(
                np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
            )
            found.append((1e3 * trimesh.transform_points(vertices, transform), faces))
    return found


def weld(vertices: Array, faces: Faces, share: float = 2e-6) -> tuple[Array, Faces]:
    """Vertices of open edges merged where they differ by rounding, up to a share of the size; others where equal."""
    first, index, _ = equal_rows(vertices + 0.0)
    vertices, faces = vertices[first], _proper(index[faces])
    open_edges, _, _ = edge_faults(faces)
    if not len(open_edges):
        return vertices, faces
    rim = np.unique(open_edges)
    reach = share * float(np.abs(vertices).max())
    pairs = cKDTree(vertices[rim]).query_pairs(reach, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(rim), len(rim)))
    _, group = connected_components(graph, directed=False)
    _, leader = np.unique(group, return_index=True)
    target = np.arange(len(vertices))
    target[rim] = rim[leader[group]]
    return vertices, _proper(target[faces])


def _proper(faces: Faces) -> Faces:
    """Triangles of three different corners."""
    a, b, c = faces.T
    return np.asarray(faces[(a != b) & (b != c) & (c != a)])
