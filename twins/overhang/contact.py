"""Contact: what free vertices may not do while a surface relaxes: sink below the bed, or leave a flat top's plane.

Points are projected onto what is permitted, and directions of a minimisation onto what the bounds at hand leave. What
comes to lie on the bed stays on it, and may slide: let go again, the vertices around a narrow foot end up on toes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from twins.toolpath import Plane

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_TOUCHES = 1e-9
"""A vertex this near to its bound is at it, as a share of the extent of all."""


@dataclass(frozen=True, eq=False)
class FlatTop:
    """Vertices that stay in one plane.

    Attributes:
        vertices: which ones of all, shape (n,).
        normal: of the plane, unit vector, shape (3,).
        level: its distance from the origin, mm; None: they may rise and sink together.
    """

    vertices: Flags
    normal: Array
    level: float | None

    def spread(self, free: Indices) -> Any:
        """The matrix (k, j) from the displacements along the normal that are left to those of k free vertices."""
        top = self.vertices[free]
        column = np.cumsum(~top) - 1
        count = int((~top).sum())
        if self.level is None:
            column[top] = count
            count += 1
        rows = np.flatnonzero(~top) if self.level is not None else np.arange(len(free))
        return sparse.csr_array((np.ones(len(rows)), (rows, column[rows])), shape=(len(free), count))


class Contact:
    """Bounds on free vertices, which come and go as one array (3 k,), as those of `QuasiNewton` do."""

    def __init__(self, vertices: Array, free: Flags, bed: Plane, flat: FlatTop | None) -> None:
        """Bounds for vertices from where they are.

        Args:
            vertices: all, shape (n, 3), mm.
            free: those that come and go, shape (n,).
            bed: none of them goes below it, and one that is below goes no lower.
            flat: those that stay in one plane.
        """
        self._origin, self._up, self._flat = bed.origin, bed.normal, flat
        self._low = np.minimum(bed.height_of(vertices[free]), 0.0)
        self._touch = _TOUCHES * float(np.ptp(vertices, axis=0).max())
        self._top = np.empty(0, np.int64)
        if flat is not None:
            self._top = np.flatnonzero(flat.vertices[free])
            self._low[self._top] = -np.inf

    def onto(self, point: Array) -> Array:
        """The nearest point that keeps all bounds."""
        vertices = point.reshape(-1, 3).copy()
        below = self._low - self._height(vertices)
        sunk = np.flatnonzero(below > 0.0)
        vertices[sunk] += below[sunk, None] * self._up
        if self._flat is not None and len(self._top):
            level = vertices[self._top] @ self._flat.normal
            wanted = float(level.mean()) if self._flat.level is None else self._flat.level
            vertices[self._top] += (wanted - level)[:, None] * self._flat.normal
        return vertices.ravel()

    def touching(self, point: Array) -> Flags:
        """Vertices on the bed, shape (k,)."""
        return np.asarray(self._height(point.reshape(-1, 3)) <= self._low + self._touch)

    def along(self, vector: Array, held: Flags) -> Array:
        """What is left of a vector where vertices (k,) are held on the bed, and flat tops stay flat."""
        left = vector.reshape(-1, 3).copy()
        chosen = np.flatnonzero(held)
        left[chosen] -= (left[chosen] @ self._up)[:, None] * self._up
        if self._flat is not None and len(self._top):
            rise = left[self._top] @ self._flat.normal
            common = float(rise.mean()) if self._flat.level is None else 0.0
            left[self._top] += (common - rise)[:, None] * self._flat.normal
        return left.ravel()

    def _height(self, vertices: Array) -> Array:
        return np.asarray((vertices - self._origin) @ self._up)
