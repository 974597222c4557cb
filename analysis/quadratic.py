"""Ten-node tetrahedra: mid-side nodes on straight edges, and the weight that each node carries.

Four-node tetrahedra are too stiff in bending: they overrate the self-buckling height of a wall by a sixth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .tetrahedra import EDGES, Array, Indices, TetMesh

_CORNER_SHARE, _MIDSIDE_SHARE = -1.0 / 20.0, 1.0 / 5.0
"""∫N dV / V of the quadratic shape functions on a tetrahedron with straight edges."""


@dataclass(frozen=True, eq=False)
class QuadraticMesh:
    """A tetrahedral mesh with a node in the middle of each edge.

    Attributes:
        points: the corners in the order of the linear mesh, then the mid-side nodes, shape (n, 3), mm.
        tets: shape (m, 10): four corners, then the middles of the edges 01, 12, 20, 03, 13, 23.
        middles: corners of the edge that each mid-side node lies on, shape (n - corners, 2).
    """

    points: Array
    tets: Indices
    middles: Indices

    def with_middles(self, corners: Indices) -> Indices:
        """The given corner nodes, and the mid-side nodes between any two of them; ascending."""
        chosen = np.zeros(len(self.points), dtype=np.bool_)
        chosen[corners] = True
        first = len(self.points) - len(self.middles)
        chosen[first:] = chosen[self.middles].all(axis=1)
        return np.flatnonzero(chosen)

    def nodal_volumes(self, volumes: Array) -> Array:
        """Share of the elements' volumes that each node carries under a body force, shape (n,), mm³.

        These are the consistent loads of the quadratic element: those of corners are negative.

        Args:
            volumes: of the elements, shape (m,), mm³.
        """
        shares = np.outer(volumes, np.r_[np.full(4, _CORNER_SHARE), np.full(6, _MIDSIDE_SHARE)])
        nodal = np.bincount(self.tets.ravel(), weights=shares.ravel(), minlength=len(self.points))
        return nodal.astype(np.float64)


def quadratic(mesh: TetMesh) -> QuadraticMesh:
    """The mesh with a node in the middle of each edge."""
    corners = np.sort(mesh.tets[:, EDGES].reshape(-1, 2), axis=1)
    middles, which = np.unique(corners, axis=0, return_inverse=True)
    points = np.vstack([mesh.points, mesh.points[middles].mean(axis=1)])
    tets = np.hstack([mesh.tets, len(mesh.points) + which.reshape(len(mesh.tets), 6)])
    return QuadraticMesh(points, tets.astype(np.int64), middles.astype(np.int64))
