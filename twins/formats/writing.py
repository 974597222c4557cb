"""Surfaces out: the mesh formats that designers open, in mm, with the unit stated where the format has one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh

from twins.entrances import checks_kinds
from twins.errors import FormatError, SurfaceError
from twins.exchange import save_surface
from twins.mesh_edges import arrays_of

from .labelled import write_whole
from .meshes import Y_UP_TO_Z_UP

RHINO: Final = 7
"""Version of 3DM: Rhino 7 and later open it."""


@checks_kinds
def write_surface(surface: trimesh.Trimesh, path: Path | str) -> None:
    """Write a surface as STL, PLY, OBJ, 3MF, 3DM, GLB or glTF; the file appears whole or not at all.

    PLY, OBJ, 3MF and 3DM hold double precision, STL and glTF single precision. 3MF and 3DM state mm; glTF is in
    metres with y up, as its standard asks.

    Args:
        surface: in mm, z up.
        path: of the file; its ending tells the format.

    Raises:
        FormatError: an unknown ending, a folder that does not exist, or a file that cannot be written.
        SurfaceError: the surface is empty, or has a vertex that is not a finite point.
    """
    path = Path(path)
    write = _WRITERS.get(path.suffix.lower())
    if write is None:
        raise FormatError(
            f"{path}: unknown ending '{path.suffix}'; a surface is written as {', '.join(_WRITERS)}"
        )
    if not path.parent.is_dir():
        raise FormatError(f"{path}: there is no folder {path.parent}; make it first")
    vertices, faces = arrays_of(surface)
    if len(faces) == 0:
        raise SurfaceError(f"{path}: the surface is empty; there is nothing to write")
    if not np.isfinite(vertices).all():
        raise SurfaceError(f"{path}: the surface has a vertex that is not a finite point")
    whole = trimesh.Trimesh(vertices, faces, process=False)
    write_whole(path, lambda partial, _: write(whole, partial), ())


_exchange: Any = trimesh.exchange


def _stl(surface: trimesh.Trimesh, path: Path) -> None:
    path.write_bytes(_exchange.stl.export_stl(surface))


def _obj(surface: trimesh.Trimesh, path: Path) -> None:
    vertices, faces = arrays_of(surface)
    points = [f"v {x!r} {y!r} {z!r}\n" for x, y, z in vertices.tolist()]
    corners = [f"f {a} {b} {c}\n" for a, b, c in (faces + 1).tolist()]
    path.write_text("# unit mm\n" + "".join(points + corners), encoding="ascii")


def _3mf(surface: trimesh.Trimesh, path: Path) -> None:
    path.write_bytes(_exchange.threemf.export_3MF(surface))


def _gltf(surface: trimesh.Trimesh, path: Path) -> None:
    vertices, faces = arrays_of(surface)
    scene = trimesh.Scene(trimesh.Trimesh(1e-3 * vertices @ Y_UP_TO_Z_UP, faces, process=False))
    if path.suffix.lower() == ".glb":
        path.write_bytes(_exchange.gltf.export_glb(scene, include_normals=False))
    else:
        made = _exchange.gltf.export_gltf(scene, include_normals=False, embed_buffers=True)
        path.write_bytes(made["model.gltf"])


def _3dm(surface: trimesh.Trimesh, path: Path) -> None:
    try:
        import rhino3dm  # noqa: PLC0415 - only where it is needed
    except ImportError as error:
        raise FormatError(
            "writing 3DM needs the package rhino3dm; install it with 'pip install rhino3dm'"
        ) from error
    vertices, faces = arrays_of(surface)
    mesh: Any = rhino3dm.Mesh()
    mesh.Vertices.UseDoublePrecisionVertices = True
    for x, y, z in vertices.tolist():
        mesh.Vertices.AddPoint3d(x, y, z)
    for a, b, c in faces.tolist():
        mesh.Faces.AddFace(a, b, c)
    model: Any = rhino3dm.File3dm()
    model.Settings.ModelUnitSystem = rhino3dm.UnitSystem.Millimeters
    model.Objects.AddMesh(mesh)
    if not model.Write(str(path), RHINO):
        raise FormatError("cannot be written; check the folder and the space on the disk")


_WRITERS: Final[dict[str, Callable[[trimesh.Trimesh, Path], None]]] = {
    ".stl": _stl,
    ".ply": save_surface,
    ".obj": _obj,
    ".3mf": _3mf,
    ".3dm": _3dm,
    ".glb": _gltf,
    ".gltf": _gltf,
}
