"""Walls of a surface: which vertices face each other through the material.

From each vertex the largest ball grows inwards that touches the surface there and holds no other vertex (the
shrinking-ball algorithm of Ma, Bae & Choi 2012). Where it ends on the far side of a wall, its diameter is the wall's
thickness and the vertex it ends on is the one across.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from .cotangent import vertex_normals

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

_OPPOSED = -0.5
"""Cosine between the normals of two vertices below which they face each other."""


def across_walls(vertices: Array, faces: Faces, thickest: float) -> tuple[Faces, Faces]:
    """Pairs of vertices that face each other through a wall.

    Args:
        vertices, faces: shapes (n, 3), mm, and (m, 3), normals outwards.
        thickest: walls above this are left alone, mm.

    Returns:
        Indices (k,) of vertices, and of the vertex across the wall from each.
    """
    normals = vertex_normals(vertices, faces)
    tree = cKDTree(vertices)
    radius = np.full(len(vertices), 0.5 * thickest)
    across = np.full(len(vertices), -1, dtype=np.int64)
    growing = np.arange(len(vertices))
    for _ in range(30):
        center = vertices[growing] - radius[growing, None] * normals[growing]
        distance, found = tree.query(center)
        nearest = np.asarray(found, dtype=np.int64)
        held = (nearest != growing) & (distance < radius[growing] * (1.0 - 1e-3))
        growing, nearest = growing[held], nearest[held]
        if len(growing) == 0:
            break
        chord = vertices[growing] - vertices[nearest]
        depth = np.maximum(np.einsum("ij,ij->i", normals[growing], chord), 1e-12)
        radius[growing] = 0.5 * np.einsum("ij,ij->i", chord, chord) / depth
        across[growing] = nearest
    here = np.flatnonzero(across >= 0)
    facing = np.einsum("ij,ij->i", normals[here], normals[across[here]]) < _OPPOSED
    apart = np.linalg.norm(vertices[here] - vertices[across[here]], axis=1) > 1e-9 * thickest
    here = here[facing & apart]
    return here, across[here]
