"""Improvement of a layered tetrahedral mesh: coarser where it is too fine, and without slivers.

Cutting at the nozzle planes leaves two kinds of bad tetrahedra: flat ones, where layers lie nearly alike above each
other, and needles, where outlines or cut edges come close. Short edges collapse first, as that helps both and leaves
less to do; then the worst tetrahedra are flipped, collapsed and smoothed, in rounds of a rising threshold. Slivers of
almost no volume that are left on the boundary, mostly where the part nearly touches itself, are taken away.

Nozzle planes stay as they are. The boundary strays by at most `STRAY` of a thickness.
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

from .tet_collapse import coarsen, collapse_at
from .tet_flips import drop, flip_at
from .tet_smoothing import smooth
from .tet_star import Mesh, make_mesh

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

STRAY = 0.01
"""How far the boundary may come to lie from where it was, as a share of the thickness."""

LONGEST = 2.0
"""Collapses make no edges longer than this, in thicknesses."""

SHORT = (0.4, 0.8, 1.2)
"""Lengths below which edges are collapsed, in turn, in thicknesses."""

GOOD = 0.45
"""Mean ratio with which a collapse is accepted even if it worsens the mesh."""

ROUNDS = (0.3, 0.5, 0.65, 0.35)
"""Mean ratios below which tetrahedra are improved, in turn."""

POOR = 0.35
"""Mean ratio below which points are moved and edges collapsed for a tetrahedron's sake: flips alone are quicker."""

HOPELESS, NOTHING = 0.08, 1e-3
"""Mean ratio and volume, in cubes of the thickness, below which a tetrahedron on the boundary is taken away."""


def mean_ratios(points: Array, tets: Indices) -> Array:
    """Mean ratio 12 (3 V)^(2/3) / Σ l² of each tetrahedron, shape (m,): 1 where regular, 0 where flat."""
    a, b, c, d = points[tets].transpose(1, 0, 2)
    volume = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0
    edges = sum(((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (a, c), (a, d), (b, c), (b, d), (c, d)))
    return np.asarray(
        np.sign(volume) * 12.0 * (3.0 * np.abs(volume)) ** (2.0 / 3.0) / edges, dtype=np.float64
    )


def improve(
    points: Array, plane: Indices, axes: Array, tets: Indices, layer: Indices, thickness: float
) -> tuple[Array, Indices, Indices]:
    """A better mesh of the same layers.

    Args:
        points: in the world, shape (n, 3), mm.
        plane: number of the nozzle plane that a point lies in, or -1, shape (n,).
        axes: two unit vectors along each nozzle plane, at right angles, shape (planes, 2, 3).
        tets: positively oriented save where flat, each within a layer, shape (m, 4).
        layer: of each, shape (m,).
        thickness: nominal, mm.

    Returns:
        points, tetrahedra and their layers.
    """
    mesh = make_mesh(points, plane, tets, layer)
    axes = np.ascontiguousarray(axes)
    longest, stray = LONGEST * thickness, STRAY * thickness
    for round_, below in enumerate(ROUNDS):
        if round_ + 1 < len(ROUNDS):
            for short in SHORT if round_ == 0 else SHORT[-1:]:
                coarsen(mesh, short * thickness, GOOD**1.5, longest, stray)
        else:
            mesh.settled[:] = False  # neighbours have changed since
        worst = np.flatnonzero(mesh.q < below**1.5)
        worst = worst[np.argsort(mesh.q[worst], kind="stable")]
        _improve_each(mesh, worst, axes, float(below**1.5), float(POOR**1.5), longest, stray)
    _drop_below(mesh, HOPELESS**1.5, NOTHING * thickness**3)
    rows = np.flatnonzero(mesh.T[:, 0] >= 0)
    used, local = np.unique(mesh.T[rows], return_inverse=True)
    return mesh.X[used], local.reshape(-1, 4), mesh.layer[rows]


@nb.njit(cache=True, nogil=True)
def _improve_each(
    M: Mesh, tets: Indices, axes: Array, below: float, poor: float, longest: float, stray: float
) -> None:
    """Better some tetrahedra in turn, while they have a shape below some value."""
    for t in tets:
        if M.T[t, 0] < 0 or M.q[t] >= below or M.settled[t] or flip_at(M, t, 0.5 * stray):
            continue
        if M.q[t] < poor and collapse_at(M, t, longest, stray):
            continue
        M.settled[t] = True
        if M.q[t] < poor:
            for k in range(4):
                smooth(M, M.T[t, k], axes, 4, stray)


@nb.njit(cache=True, nogil=True)
def _drop_below(M: Mesh, below: float, volume: float) -> None:
    """Take away slivers from the boundary inwards."""
    gone = 1
    while gone:
        gone = 0
        for t in range(len(M.q)):
            if M.q[t] < below:
                gone += drop(M, t, volume)
