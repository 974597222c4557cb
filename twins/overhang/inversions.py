"""Faces that a deformation turned inside out, and how to turn them back.

A face is inverted if its normal ends up more than 90° from where the rotations of the surface around it take its
old normal: a fold at the scale of a face, whatever the part as a whole does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba as nb
import numpy as np
import numpy.typing as npt
from scipy import sparse

from .cotangent import cotangent_weights, face_edges
from .energy import edge_covariances
from .rotations import turn_to_best

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_SWEEPS = 5
"""Averages in the first round, and that many more in each one after it."""
_ROUNDS = 12


class _Folds:
    """Finds what a deformation of one surface inverted."""

    def __init__(self, before: Array, faces: Faces) -> None:
        self._faces = faces
        self._edges, self._weights = face_edges(before, faces), cotangent_weights(before, faces)
        self._covariances = np.empty((len(before), 3, 3))
        self._rotations = np.broadcast_to(np.eye(3), (len(before), 3, 3)).copy()
        self._no_ties = np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 3)), np.empty(0)

    def inverted(self, after: Array) -> Flags:
        """Which faces are inverted, shape (m,), for vertices (n, 3)."""
        edge_covariances(after, self._faces, self._edges, self._weights, *self._no_ties, self._covariances)
        turn_to_best(self._covariances, self._rotations)
        return np.asarray(_against(after, self._faces, self._edges, self._rotations))


def inverted_faces(before: Array, after: Array, faces: Faces) -> Flags:
    """Which faces are inverted, shape (m,), for vertices (n, 3) before and after."""
    return _Folds(before, faces).inverted(after)


@nb.njit(cache=True, nogil=True)
def _against(V: Array, F: Faces, D: Array, R: Array) -> Flags:
    """Faces whose normal is against what the rotations R (n, 3, 3) make of that of their old edges D (m, 3, 3)."""
    flags = np.zeros(len(F), dtype=np.bool_)
    for f in range(len(F)):
        a, b, c = F[f, 0], F[f, 1], F[f, 2]
        old, new = np.cross(D[f, 0], D[f, 1]), np.cross(V[b] - V[a], V[c] - V[a])
        along = 0.0
        for i in range(3):
            for j in range(3):
                along += new[i] * (R[a, i, j] + R[b, i, j] + R[c, i, j]) * old[j]
        flags[f] = along < 0.0
    return flags


def turned_back(
    before: Array,
    after: Array,
    faces: Faces,
    free: Flags,
    permitted: Callable[[Array], Array] = lambda vertices: vertices,
) -> tuple[Array, int]:
    """Vertices after, with the displacements around inverted faces averaged until none is inverted.

    A smooth displacement inverts nothing, so each round averages over one more ring of vertices. Vertices that are
    not free stay, and all go to the nearest place `permitted`. Also how many faces are inverted still.
    """
    folds = _Folds(before, faces)
    inverted = folds.inverted(after)
    if not inverted.any():
        return after, 0
    n = len(before)
    rows, columns = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    half = sparse.coo_array((np.ones(len(rows)), (rows, columns)), shape=(n, n)).tocsr()
    links: Any = half + half.T
    degree = links @ np.ones(n)
    moved = after.copy()
    chosen = np.zeros(n, dtype=bool)
    for k in range(_ROUNDS):
        chosen[faces[inverted]] = True
        chosen |= (links @ chosen.astype(np.float64)) > 0.0
        soft = np.flatnonzero(chosen & free)
        around = links[soft]
        displacement = moved - before
        for _ in range(_SWEEPS * (k + 1)):
            displacement[soft] = (around @ displacement) / degree[soft, None]
        moved = permitted(before + displacement)
        inverted = folds.inverted(moved)
        if not inverted.any():
            break
    return moved, int(inverted.sum())
