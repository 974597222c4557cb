"""Edges of a mesh, and what can be wrong with them."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


def edge_faults(faces: Faces) -> tuple[Faces, Faces, Faces]:
    """Open edges (directed, as their face has them), edges of more than two faces, edges of two like-turned faces."""
    directed = directed_edges(faces)
    first, index, count = equal_rows(np.sort(directed, axis=1))
    forward = np.bincount(index, np.where(directed[:, 0] < directed[:, 1], 1.0, -1.0), len(count))
    return (
        directed[first[count == 1]],
        directed[first[count > 2]],
        directed[first[(count == 2) & (forward != 0)]],
    )


def equal_rows(
    rows: npt.NDArray[Any],
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Of the distinct rows in ascending order: where each is first; which one each row is; how often each occurs."""
    order = np.lexsort(rows.T[::-1])
    new = np.r_[True, (rows[order[1:]] != rows[order[:-1]]).any(axis=1)][: len(rows)]
    index = np.empty(len(rows), dtype=np.int64)
    index[order] = np.cumsum(new) - 1
    return order[new], index, np.diff(np.r_[np.flatnonzero(new), len(rows)])


def directed_edges(faces: Faces) -> Faces:
    """Half-edges: row r is of face r % m, from its corner r // m to the next."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def middle_of(vertices: Array, edge: npt.NDArray[np.int64]) -> str:
    x, y, z = vertices[edge].mean(axis=0)
    return f"({x:.3f}, {y:.3f}, {z:.3f})"


def arrays_of(surface: trimesh.Trimesh) -> tuple[Array, Faces]:
    return np.asarray(surface.vertices, dtype=np.float64), np.asarray(surface.faces, dtype=np.int64)
