"""Tetrahedra with the layer that each was printed in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .errors import MeshingError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
"""Corners of a tetrahedron's four faces, counter-clockwise seen from outside."""

EDGES = np.array([[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]])
"""Corners of a tetrahedron's six edges, in the order of the mid-side nodes of C3D10 and of VTK's quadratic tetra."""


@dataclass(frozen=True, eq=False)
class TetMesh:
    """Tetrahedra of positive volume; all arrays are read-only.

    Attributes:
        points: shape (n, 3), mm.
        tets: corner indices, shape (m, 4); seen from the fourth corner the first three run counter-clockwise.
        layer: layer of the toolpath that each element belongs to, counted from 0, shape (m,).

    Raises:
        MeshingError: wrong shapes, indices out of range, values that are not finite, no elements, or an element
            whose volume is not above 0.
    """

    points: Array
    tets: Indices
    layer: Indices

    def __post_init__(self) -> None:
        points = np.array(self.points, dtype=np.float64)
        tets = np.array(self.tets, dtype=np.int64)
        layer = np.array(self.layer, dtype=np.int64)
        if points.ndim != 2 or points.shape[1] != 3 or tets.ndim != 2 or tets.shape[1] != 4:
            raise MeshingError(
                f"tetrahedra need points (n, 3) and corners (m, 4), not {points.shape} and {tets.shape}"
            )
        if len(tets) == 0:
            raise MeshingError("there are no tetrahedra")
        if layer.shape != (len(tets),):
            raise MeshingError(f"there are {len(tets)} tetrahedra, but layers of shape {layer.shape}")
        if not np.isfinite(points).all():
            raise MeshingError(f"point {int(np.argmin(np.isfinite(points).all(axis=1)))} is not finite")
        if tets.min() < 0 or tets.max() >= len(points) or layer.min() < 0:
            raise MeshingError(f"a corner lies outside the {len(points)} points, or a layer is below 0")
        volumes = signed_volumes(points, tets)
        if volumes.min() <= 0:
            raise MeshingError(
                f"{int((volumes <= 0).sum())} of {len(tets)} tetrahedra are flat or inside out, the first is element "
                f"{int(np.argmax(volumes <= 0))}; mesh again, with a smaller tolerance if it stays"
            )
        for name, array in (("points", points), ("tets", tets), ("layer", layer)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def volumes(self) -> Array:
        """Volume of each element, shape (m,), mm³; all above 0."""
        return signed_volumes(self.points, self.tets)

    @property
    def volume(self) -> float:
        """Volume of all elements, mm³."""
        return float(self.volumes.sum())

    @property
    def centroids(self) -> Array:
        """Centroid of each element, shape (m, 3), mm."""
        return np.asarray(self.points[self.tets].mean(axis=1), dtype=np.float64)

    @property
    def quality(self) -> Array:
        """Mean ratio of each element, 12 (3V)^⅔ / Σ l², shape (m,): 1 for a regular tetrahedron, 0 for a flat one."""
        corners = self.points[self.tets]
        lengths = corners[:, EDGES[:, 0]] - corners[:, EDGES[:, 1]]
        return np.asarray(
            12.0 * np.cbrt(3.0 * self.volumes) ** 2 / (lengths**2).sum(axis=(1, 2)), dtype=np.float64
        )

    @property
    def layers(self) -> Indices:
        """The layers that have elements, ascending."""
        return np.unique(self.layer)

    def boundary(self) -> Indices:
        """Corners of the outer faces, shape (b, 3), counter-clockwise seen from outside."""
        faces = self.tets[:, FACES].reshape(-1, 3)
        _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        return np.asarray(faces[first[count == 1]], dtype=np.int64)


def signed_volumes(points: Array, tets: Indices) -> Array:
    """Volume of each tetrahedron, shape (m,), mm³; below 0 where it is inside out."""
    a, b, c, d = (points[tets[:, k]] for k in range(4))
    return np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0, dtype=np.float64)


def oriented(points: Array, tets: Indices) -> Indices:
    """`tets` with two corners swapped wherever the volume is below 0, shape (m, 4)."""
    turned = np.array(tets, dtype=np.int64)
    inside_out = signed_volumes(points, turned) < 0
    turned[inside_out, 2:] = turned[inside_out, :1:-1]
    return turned
