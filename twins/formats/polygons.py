"""Polygon meshes as files hold them, and the units that files state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from twins.errors import FormatError

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

MM: Final = {
    "um": 1e-3,
    "mm": 1.0,
    "cm": 10.0,
    "dm": 100.0,
    "m": 1e3,
    "km": 1e6,
    "in": 25.4,
    "ft": 304.8,
    "yd": 914.4,
}
"""Length units that a file can state, mm."""


@dataclass(frozen=True)
class Polygons:
    """Faces of three and more corners on shared or separate vertices, in the file's unit.

    `faces` holds one array of shape (m, k) for each number of corners k; `unit` is a key of `MM`, or None where the
    file states none. `exact` tells that the mesh was drawn from smooth surfaces and is no control mesh.
    """

    vertices: Array
    faces: tuple[Faces, ...]
    unit: str | None = None
    exact: bool = False

    def triangles(self) -> Faces:
        """All faces as triangles, shape (m, 3): quads along their shorter diagonal, others as fans."""
        parts = [np.empty((0, 3), dtype=np.int64)]
        for block in self.faces:
            if block.shape[1] == 4:
                parts.append(self._halved(block))
            else:
                fan = [block[:, [0, i, i + 1]] for i in range(1, block.shape[1] - 1)]
                parts.append(np.stack(fan, axis=1).reshape(-1, 3))
        return np.concatenate(parts)

    def _halved(self, quads: Faces) -> Faces:
        corners = self.vertices[quads]
        across = ((corners[:, [0, 1]] - corners[:, [2, 3]]) ** 2).sum(axis=2)
        turned = np.where((across[:, 1] < across[:, 0])[:, None], np.roll(quads, -1, axis=1), quads)
        return np.stack([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]], axis=1).reshape(-1, 3)


def by_corners(faces: Sequence[Sequence[int]]) -> tuple[Faces, ...]:
    """Faces as lists of corners, sorted into one array for each number of corners."""
    groups: dict[int, list[Sequence[int]]] = {}
    for face in faces:
        groups.setdefault(len(face), []).append(face)
    return tuple(np.array(group, dtype=np.int64) for _, group in sorted(groups.items()))


def side_by_side(parts: Sequence[Polygons], unit: str | None, *, exact: bool) -> Polygons:
    """Several meshes as one, with vertices of their own."""
    at = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces: dict[int, list[Faces]] = {}
    for part, first in zip(parts, at, strict=False):
        for block in part.faces:
            faces.setdefault(block.shape[1], []).append(block + first)
    vertices = np.concatenate([np.empty((0, 3)), *(part.vertices for part in parts)])
    return Polygons(
        vertices, tuple(np.concatenate(blocks) for _, blocks in sorted(faces.items())), unit, exact
    )


def factor_to_mm(where: object, stated: str | None, given: str | None) -> float:
    """What a file's coordinates are multiplied by: the unit that the file states comes before the one given.

    Raises:
        FormatError: the unit given is unknown, or contradicts the file.
    """
    if given is not None and given not in MM:
        raise FormatError(f"{where}: unknown unit '{given}'; choose one of {', '.join(MM)}")
    if stated is None:
        return 1.0 if given is None else MM[given]
    if given is not None and given != stated:
        raise FormatError(
            f"{where}: is in {stated} as the file itself says, not in {given}; leave the unit out, or correct the file"
        )
    return MM[stated]
