"""Cotangent weights: the Dirichlet energy of what is linear on each triangle (Pinkall & Polthier 1993)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import sparse

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

_FLATTEST = 1e-6
"""Area of a triangle over its longest edge squared, below which it counts as this: no weight is infinite."""


def face_edges(vertices: Array, faces: Faces) -> Array:
    """Edge opposite each corner, from the next corner to the one after it: shape (m, 3, 3), mm."""
    return np.asarray(vertices[faces[:, [2, 0, 1]]] - vertices[faces[:, [1, 2, 0]]], dtype=np.float64)


def face_areas(vertices: Array, faces: Faces) -> Array:
    """Shape (m,), mm²."""
    edges = face_edges(vertices, faces)
    return np.asarray(0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1), dtype=np.float64)


def vertex_areas(vertices: Array, faces: Faces) -> Array:
    """A third of the faces around each vertex, shape (n,), mm²."""
    thirds = np.repeat(face_areas(vertices, faces) / 3.0, 3)
    return np.asarray(np.bincount(faces.ravel(), thirds, minlength=len(vertices)), dtype=np.float64)


def vertex_normals(vertices: Array, faces: Faces) -> Array:
    """Area-weighted unit normals, shape (n, 3); 0 where the faces cancel out."""
    edges = face_edges(vertices, faces)
    normals = np.repeat(np.cross(edges[:, 0], edges[:, 1]), 3, axis=0)
    summed = np.column_stack([np.bincount(faces.ravel(), n, minlength=len(vertices)) for n in normals.T])
    return np.asarray(summed / np.maximum(np.linalg.norm(summed, axis=1), 1e-300)[:, None], dtype=np.float64)


def cotangent_weights(vertices: Array, faces: Faces) -> Array:
    """Half the cotangent at each corner, the weight of the edge opposite it within the face: shape (m, 3).

    Σ over a face's edges of w ‖u_j − u_i‖² is its area × ‖∇u‖² for u linear on it.
    """
    edges = face_edges(vertices, faces)
    doubled = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    doubled = np.maximum(doubled, 2.0 * _FLATTEST * np.einsum("fij,fij->fi", edges, edges).max(axis=1))
    inner = np.einsum("fij,fij->fi", np.roll(edges, -1, axis=1), np.roll(edges, -2, axis=1))
    return np.asarray(-0.5 * inner / np.maximum(doubled, 1e-300)[:, None], dtype=np.float64)


def edge_laplacian(start: Faces, end: Faces, weights: Array, n: int) -> sparse.csc_array:
    """The matrix L with xᵀ L x = Σ w (x_end − x_start)², shape (n, n)."""
    rows, columns = np.concatenate([start, end, start, end]), np.concatenate([end, start, start, end])
    return sparse.coo_array(
        (np.concatenate([-weights, -weights, weights, weights]), (rows, columns)), shape=(n, n)
    ).tocsc()


def cotangent_laplacian(faces: Faces, weights: Array, n: int) -> sparse.csc_array:
    """The stiffness matrix of `cotangent_weights`, shape (n, n), mm⁰."""
    return edge_laplacian(
        np.roll(faces, -1, axis=1).ravel(), np.roll(faces, -2, axis=1).ravel(), weights.ravel(), n
    )
