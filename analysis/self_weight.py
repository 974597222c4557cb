"""The input file of the self-weight case: one material, fixed base, gravity (CalculiX, Abaqus syntax)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from planning import Mix

from .errors import DeckError
from .export import UNITS
from .quadratic import quadratic
from .tetrahedra import Array, Indices, TetMesh

GRAVITY = 9810.0
"""Acceleration of gravity, mm/s²."""

_DOWN = (0.0, 0.0, -1.0)

_DIRECT_MAX = 60_000
"""Elements up to which the system is factored: quick and exact, but 57,000 elements already take 3 GB. Beyond,
conjugate gradients take an eighth of the memory."""


@dataclass(frozen=True, eq=False)
class Deck:
    """A self-weight case on disk, and what its solution must add up to.

    Attributes:
        path: the input file; it includes `mesh.inp` beside it.
        weight: of all elements, shape (3,), N.
        base_weight: the part of it that acts on fixed nodes, shape (3,), N. A solver leaves it out of the reactions
            that it prints, so that reactions + weight = base_weight.
    """

    path: Path
    weight: Array
    base_weight: Array


def write_self_weight(
    folder: Path, mesh: TetMesh, base: Indices, mix: Mix, down: tuple[float, float, float] = _DOWN
) -> Deck:
    """Write `self_weight.inp`, which includes the `mesh.inp` that `analysis.export.write_mesh` puts beside it.

    Args:
        folder: where `mesh.inp` is.
        base: corner nodes that stand on the base; they and the mid-side nodes between them are fixed.
        mix: gives Young's modulus, Poisson's ratio and density of the fresh material.
        down: direction of gravity; the world's -z unless told otherwise. Its length does not matter.

    Raises:
        DeckError: gravity has no direction, or a part of the mesh does not stand on the base.
    """
    direction = np.asarray(down, dtype=np.float64)
    length = float(np.linalg.norm(direction))
    if direction.shape != (3,) or not np.isfinite(length) or length == 0.0:
        raise DeckError(f"gravity needs a direction in space, not {down}")
    direction = direction / length
    _check_support(mesh, base)
    if not (folder / "mesh.inp").is_file():
        raise DeckError(
            f"{folder}: there is no mesh.inp that the input file could include; write the mesh first"
        )
    path = folder / "self_weight.inp"
    gx, gy, gz = direction
    path.write_text(
        f"""** Self-weight of the fresh part: linear elastic, static, fixed on its base
** {UNITS}
** mix: {_ascii(mix.name)}
*INCLUDE, INPUT=mesh.inp
*MATERIAL, NAME=FRESH
*ELASTIC
{mix.youngs_modulus:.9g}, {mix.poisson:.9g}
*DENSITY
{mix.density:.9g}
*SOLID SECTION, ELSET=ALL, MATERIAL=FRESH
*BOUNDARY
BASE, 1, 3
*STEP
*STATIC{", SOLVER=ITERATIVE CHOLESKY" if len(mesh.tets) > _DIRECT_MAX else ""}
*DLOAD
ALL, GRAV, {GRAVITY:.9g}, {gx:.12g}, {gy:.12g}, {gz:.12g}
*NODE PRINT, NSET=BASE, TOTALS=ONLY
RF
*NODE PRINT, NSET=NALL
U
*EL PRINT, ELSET=ALL
S
*NODE FILE
U, RF
*EL FILE
S
*END STEP
""",
        encoding="ascii",
    )
    return Deck(
        path, mesh.volume * mix.density * GRAVITY * direction, base_weight(mesh, base, mix) * direction
    )


def base_weight(mesh: TetMesh, base: Indices, mix: Mix) -> float:
    """The part of the weight that acts on fixed nodes, N.

    It is lumped as ten-node tetrahedra do it, -V/20 at each corner and V/5 at each mid-side node of an element.
    """
    fine = quadratic(mesh)
    return float(fine.nodal_volumes(mesh.volumes)[fine.with_middles(base)].sum()) * mix.density * GRAVITY


def _check_support(mesh: TetMesh, base: Indices) -> None:
    n = len(mesh.points)
    a, b = mesh.tets[:, [0, 0, 0]].ravel(), mesh.tets[:, 1:].ravel()
    graph = coo_matrix((np.ones(len(a), dtype=np.int8), (a, b)), shape=(n, n))
    count, part = connected_components(graph, directed=False)
    floating = np.setdiff1d(part[mesh.tets[:, 0]], part[base])
    if len(floating):
        first = int(mesh.layer[part[mesh.tets[:, 0]] == floating[0]].min())
        raise DeckError(
            f"{len(floating)} of {count} separate parts of the mesh do not stand on the base, one begins in layer "
            f"{first}; they would fall: join them to the part in the toolpath, or take them out"
        )


def _ascii(text: str) -> str:
    return " ".join(text.encode("ascii", "replace").decode("ascii").split())
