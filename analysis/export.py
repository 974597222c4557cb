"""Mesh files for finite element programs: VTK, Gmsh and Abaqus/CalculiX.

Layers count from 0 in the toolpath and in the `layer` array of `mesh.vtu`; as groups and sets they are named from
`LAYER_1`. `mesh.vtu` and `mesh.msh` hold the four-node tetrahedra that they were made as, `mesh.inp` holds ten-node
ones, which is what the input files of this project are solved with.
"""

from __future__ import annotations

from pathlib import Path
from typing import TextIO

import meshio
import numpy as np

from .quadratic import QuadraticMesh, quadratic
from .tetrahedra import Indices, TetMesh

UNITS = "units: mm, N, MPa (N/mm2), tonne, s"
_PER_LINE = 16
"""Entries per line of a set, the most that CalculiX reads."""


def write_mesh(mesh: TetMesh, base: Indices, folder: Path) -> tuple[Path, Path, Path]:
    """Write `mesh.vtu`, `mesh.msh` and `mesh.inp`.

    - `mesh.vtu`: VTK, cell data `layer` (integer, from 0) and `quality` (mean ratio).
    - `mesh.msh`: Gmsh 2.2 (later versions lose the groups), a physical volume per layer and the physical surface
      `BASE`.
    - `mesh.inp`: nodes (set `NALL`), C3D10 elements (set `ALL`), a set `LAYER_k` per layer that has elements, and
      the node set `BASE`, mid-side nodes included.

    Args:
        base: corner nodes that stand on the base.
        folder: must exist.

    Returns:
        The three paths, in this order.
    """
    vtu, msh, inp = (folder / f"mesh.{ending}" for ending in ("vtu", "msh", "inp"))
    meshio.write(
        vtu,
        meshio.Mesh(
            mesh.points,
            [("tetra", mesh.tets)],
            cell_data={"layer": [mesh.layer.astype(np.int32)], "quality": [mesh.quality]},
        ),
        file_format="vtu",
    )
    meshio.write(msh, _with_groups(mesh, base), file_format="gmsh22", binary=False, float_fmt=".12e")
    with inp.open("w", encoding="ascii") as file:
        _write_abaqus(file, mesh, quadratic(mesh), base)
    return vtu, msh, inp


def layer_set(layer: int) -> str:
    """Name of the element set of a layer that counts from 0."""
    return f"LAYER_{layer + 1}"


def _with_groups(mesh: TetMesh, base: Indices) -> meshio.Mesh:
    standing = np.zeros(len(mesh.points), dtype=np.bool_)
    standing[base] = True
    faces = mesh.boundary()
    faces = faces[standing[faces].all(axis=1)]
    groups = mesh.layer.astype(np.int32) + 1
    base_group = np.full(len(faces), int(groups.max()) + 1, dtype=np.int32)
    names = {layer_set(int(k)): np.array([k + 1, 3]) for k in mesh.layers}
    return meshio.Mesh(
        mesh.points,
        [("triangle", faces), ("tetra", mesh.tets)],
        cell_data={"gmsh:physical": [base_group, groups], "gmsh:geometrical": [base_group, groups]},
        field_data={"BASE": np.array([int(groups.max()) + 1, 2]), **names},
    )


def _write_abaqus(file: TextIO, mesh: TetMesh, fine: QuadraticMesh, base: Indices) -> None:
    # meshio's Abaqus writer names ten-node tetrahedra by a type that CalculiX does not have, so this one is our own.
    file.write(f"** ten-node tetrahedra, one element set per printed layer\n** {UNITS}\n*NODE, NSET=NALL\n")
    numbers = np.arange(1, len(fine.points) + 1)
    # CalculiX reads coordinates from fields of 20 characters
    np.savetxt(file, np.column_stack([numbers, fine.points]), fmt="%d, %.12e, %.12e, %.12e")
    file.write("*ELEMENT, TYPE=C3D10, ELSET=ALL\n")
    numbers = np.arange(1, len(fine.tets) + 1)
    np.savetxt(file, np.column_stack([numbers, fine.tets + 1]), fmt="%d", delimiter=", ")
    for k in mesh.layers:
        file.write(f"*ELSET, ELSET={layer_set(int(k))}\n")
        _write_numbers(file, np.flatnonzero(mesh.layer == k) + 1)
    file.write("*NSET, NSET=BASE\n")
    _write_numbers(file, fine.with_middles(base) + 1)


def _write_numbers(file: TextIO, numbers: Indices) -> None:
    entries = [str(number) for number in numbers.tolist()]
    rows = (entries[start : start + _PER_LINE] for start in range(0, len(entries), _PER_LINE))
    file.writelines(", ".join(row) + "\n" for row in rows)
