"""Poses: rotation vectors, matrices and the six numbers that robot controllers write.

A pose vector is (x, y, z, rx, ry, rz): a position in whatever length unit the caller uses, and a rotation
vector in rad. Its direction is the axis and its length the angle, so (0, 0, 0) is no rotation.

Both ways go through a unit quaternion (u, w): axis times sine, and cosine, of half the turn.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

DIAGONAL = np.arange(3)
# u @ CROSS is the matrix of the cross product with u, shape (3, 3), as one row.
CROSS = np.zeros((3, 9))
CROSS[[0, 1, 2], [7, 2, 3]] = 1.0
CROSS[[0, 1, 2], [5, 6, 1]] = -1.0


def rotation_from_vector(vectors: Array) -> Array:
    """Rotation vectors, shape (n, 3), rad, as matrices, shape (n, 3, 3)."""
    vectors = np.asarray(vectors, dtype=np.float64).reshape(-1, 3)
    half = 0.5 * np.sqrt((vectors * vectors).sum(axis=1))
    u, w = 0.5 * np.sinc(half / np.pi)[:, None] * vectors, np.cos(half)
    rotations = 2.0 * (u[:, :, None] * u[:, None, :] + ((w[:, None] * u) @ CROSS).reshape(-1, 3, 3))
    rotations[:, DIAGONAL, DIAGONAL] += (2.0 * w * w - 1.0)[:, None]
    return np.asarray(rotations, dtype=np.float64)


def vector_from_rotation(rotations: Array) -> Array:
    """Rotation matrices, shape (n, 3, 3), as vectors of length 0 to pi, shape (n, 3), rad."""
    rotations = np.asarray(rotations, dtype=np.float64).reshape(-1, 3, 3)
    trace = rotations[:, 0, 0] + rotations[:, 1, 1] + rotations[:, 2, 2]
    products = np.empty((len(rotations), 4, 4))  # 4 q qT of the quaternion q
    products[:, :3, :3] = rotations + rotations.transpose(0, 2, 1)
    products[:, DIAGONAL, DIAGONAL] += (1.0 - trace)[:, None]
    products[:, 3, :3] = products[:, :3, 3] = rotations.reshape(-1, 9) @ CROSS.T
    products[:, 3, 3] = 1.0 + trace
    # The row of the largest component is exact near no turn and near half a turn.
    largest = np.diagonal(products, axis1=1, axis2=2).argmax(axis=1)
    q = products[np.arange(len(products)), largest]
    q *= np.where(q[:, 3:] < 0.0, -1.0, 1.0)
    sine, cosine = np.sqrt((q[:, :3] * q[:, :3]).sum(axis=1)), q[:, 3]
    turns = sine > 0.0
    stretch = np.where(turns, 2.0 * np.arctan2(sine, cosine) / np.where(turns, sine, 1.0), 0.0)
    return np.asarray(stretch[:, None] * q[:, :3], dtype=np.float64)


def pose_from_vector(vectors: Array) -> Array:
    """Pose vectors, shape (n, 6), as matrices, shape (n, 4, 4), in the same length unit."""
    vectors = np.asarray(vectors, dtype=np.float64).reshape(-1, 6)
    poses = np.zeros((len(vectors), 4, 4))
    poses[:, :3, :3] = rotation_from_vector(vectors[:, 3:])
    poses[:, :3, 3] = vectors[:, :3]
    poses[:, 3, 3] = 1.0
    return poses


def vector_from_pose(poses: Array) -> Array:
    """Pose matrices, shape (n, 4, 4), as vectors, shape (n, 6), in the same length unit."""
    poses = np.asarray(poses, dtype=np.float64).reshape(-1, 4, 4)
    return np.hstack([poses[:, :3, 3], vector_from_rotation(poses[:, :3, :3])])
