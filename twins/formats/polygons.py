"""Polygon meshes as files hold them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Polygons:
    """Faces of three and more corners on shared or separate vertices, in the file's unit.

    `faces` holds one array of shape (m, k) for each number of corners k; `unit` is a key of `lengths.MM`, or None where
    the file states none. `exact` tells that the mesh was drawn from smooth surfaces and is no control mesh.
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
