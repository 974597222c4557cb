"""The bead of a scaled model: a curve as a desktop printer prints it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ModelBead:
    """A curve as the desktop printer prints it, n points.

    Attributes:
        layer, curve: indices in the toolpath.
        points: on the printer's bed, shape (n, 3), mm; a closed curve ends where it starts.
        width, height: of the bead, shape (n,), mm.
    """

    layer: int
    curve: int
    points: Array
    width: Array
    height: Array

    @property
    def lengths(self) -> Array:
        """Length of each move, shape (n - 1,), mm."""
        return np.asarray(np.linalg.norm(np.diff(self.points, axis=0), axis=1), dtype=np.float64)

    @property
    def sections(self) -> Array:
        """Mean of width · height over each move, shape (n - 1,), mm²."""
        section = self.width * self.height
        return np.asarray(0.5 * (section[1:] + section[:-1]), dtype=np.float64)


def bounds(beads: Sequence[ModelBead]) -> tuple[Array, Array]:
    """Lowest and highest coordinates of beads with half their width to all sides, shape (3,) each, mm."""
    points = np.vstack([bead.points for bead in beads])
    half = 0.5 * np.concatenate([bead.width for bead in beads])[:, None] * [1.0, 1.0, 0.0]
    return (points - half).min(axis=0), (points + half).max(axis=0)
