"""A surface that resists deformation: as rigid as possible, its walls kept, and its volume (for overhang relaxation).

One factorisation serves the whole relaxation: the energy of edges has the same Laplacian whatever the rotations are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.linalg import splu

from .contact import FlatTop
from .cotangent import (
    cotangent_laplacian,
    cotangent_weights,
    edge_laplacian,
    face_areas,
    face_edges,
    vertex_areas,
)
from .energy import collapse_energy, edge_covariances, shape_energy, volume_energy
from .rotations import turn_to_best
from .walls import across_walls

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_VOLUME = 3.0
"""Weight of the square of the enclosed volume's relative change, times the surface's area."""
_COLLAPSE = 2.0
"""A face may shrink by this ratio before that counts on its own."""
_STAY = 10.0
"""Weight of the squares of displacements over the part's diagonal, times the area around each vertex."""
_TIE = 2.0
"""Stiffness of a tie across a wall, times the area it stands for over the wall's thickness squared."""


class RigidShape:
    """The energy E_R of a surface, and the factorised matrix that preconditions it.

    Vertices that are not free stay where they are; what is minimised over is the free ones as one array (3 k,).
    """

    def __init__(
        self,
        vertices: Array,
        faces: Faces,
        free: Flags,
        thickest: float,
        keep_volume: bool,
        flat: FlatTop | None = None,
    ) -> None:
        """Prepare a surface.

        Args:
            vertices, faces: shapes (n, 3), mm, and (m, 3).
            free: vertices that may move, shape (n,).
            thickest: walls up to this thickness are tied, mm; 0 ties none.
            keep_volume: count the change of the enclosed volume; for closed surfaces.
            flat: vertices that stay in one plane, which the preconditioner then knows.
        """
        self.vertices, self.faces, self.areas = vertices, faces, face_areas(vertices, faces)
        self._free = np.flatnonzero(free)
        self._edges, self._weights = face_edges(vertices, faces), cotangent_weights(vertices, faces)
        start, end = (
            across_walls(vertices, faces, thickest) if thickest > 0.0 else (np.empty(0, np.int64),) * 2
        )
        self._foldable = np.where(free[faces].any(axis=1), self.areas, 0.0)
        n = len(vertices)
        around = vertex_areas(vertices, faces)
        across = vertices[end] - vertices[start]
        stiffness = _TIE * around[start] / np.einsum("ij,ij->i", across, across)
        self._ties = start, end, across, stiffness
        self._stay = _STAY * around / float((np.ptp(vertices, axis=0) ** 2).sum())
        matrix = 6.0 * cotangent_laplacian(faces, self._weights, n)
        matrix = (matrix + 2.0 * edge_laplacian(start, end, stiffness, n)).tocsc()
        matrix = matrix + 2.0 * sparse.diags_array(self._stay)
        matrix = matrix.tocsc()[self._free][:, self._free]
        self._factor = _factorised(matrix.tocsc())
        self._flat = flat
        if flat is not None:
            # Square to their plane, such vertices move as one or not at all: a matrix of its own.
            self._spread = flat.spread(self._free)
            self._flat_factor = _factorised((self._spread.T @ matrix @ self._spread).tocsc())
        self._rotations = np.broadcast_to(np.eye(3), (n, 3, 3)).copy()
        self._covariances = np.empty((n, 3, 3))
        self._volume_weight, self._volume = 0.0, 0.0
        if keep_volume:
            self._learn_volume()

    def full(self, point: Array) -> Array:
        """All vertices, shape (n, 3), for the free ones (3 k,)."""
        vertices = self.vertices.copy()
        vertices[self._free] = point.reshape(-1, 3)
        return vertices

    def part(self, values: Array) -> Array:
        """The free rows of an array (n, 3), as one array (3 k,)."""
        return values[self._free].ravel()

    def energy(self, vertices: Array, gradient: Array) -> float:
        """E_R and the volume's term at vertices (n, 3), mm²; the gradient (n, 3) is added to."""
        rest = (self.faces, self._edges, self._weights, *self._ties)
        edge_covariances(vertices, *rest, self._covariances)
        turn_to_best(self._covariances, self._rotations)
        energy = shape_energy(vertices, *rest, self._rotations, gradient)
        energy += collapse_energy(
            vertices, self.faces, self._edges, self._rotations, self._foldable, _COLLAPSE, gradient
        )
        displacement = vertices - self.vertices
        pull = self._stay[:, None] * displacement
        gradient += 2.0 * pull
        energy += float(np.einsum("ij,ij->", pull, displacement))
        if self._volume_weight > 0.0:
            energy += volume_energy(vertices, self.faces, self._volume, self._volume_weight, gradient)
        return float(energy)

    def precondition(self, gradient: Array) -> Array:
        """An approximate inverse Hessian applied to a gradient (3 k,)."""
        direction = self._solve(gradient)
        if self._volume_weight > 0.0:
            direction -= self._volume_column * float(np.einsum("i,i->", self._volume_row, gradient))
        return direction

    def _solve(self, values: Array) -> Array:
        rows = values.reshape(-1, 3)
        solved = np.ascontiguousarray(self._factor.solve(rows))
        if self._flat is not None:
            normal = self._flat.normal
            rise = self._spread @ self._flat_factor.solve(self._spread.T @ (rows @ normal))
            solved += (rise - solved @ normal)[:, None] * normal
        return solved.ravel()

    def _learn_volume(self) -> None:
        gradient = np.zeros_like(self.vertices)
        # With weight ½ and a volume of 1 mm³ less the gradient is the volume's own.
        self._volume = 0.0
        excess = volume_energy(self.vertices, self.faces, 0.0, 0.5, gradient)
        self._volume = float(np.sqrt(2.0 * excess))
        if self._volume == 0.0:
            return
        self._volume_weight = _VOLUME * float(self.areas.sum()) / self._volume**2
        g = self.part(gradient) / self._volume
        # Sherman-Morrison: the Hessian has 2 κ g gᵀ beside the Laplacian.
        column = self._solve(g)
        self._volume_row = column
        self._volume_column = column / (0.5 / self._volume_weight + float(np.einsum("i,i->", g, column)))


def _factorised(matrix: Any) -> Any:
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
