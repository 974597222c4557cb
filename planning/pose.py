"""Poses: rotation vectors, matrices and the six numbers that robot controllers write.

A pose vector is (x, y, z, rx, ry, rz): a position in whatever length unit the caller uses, and a rotation
vector in rad. Its direction is the axis and its length the angle, so (0, 0, 0) is no rotation.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]


def rotation_from_vector(vectors: Array) -> Array:
    """Rotation vectors, shape (n, 3), rad, as matrices, shape (n, 3, 3)."""
    vectors = np.asarray(vectors, dtype=np.float64).reshape(-1, 3)
    return np.asarray(Rotation.from_rotvec(vectors).as_matrix(), dtype=np.float64).reshape(-1, 3, 3)


def vector_from_rotation(rotations: Array) -> Array:
    """Rotation matrices, shape (n, 3, 3), as vectors of length 0 to pi, shape (n, 3), rad."""
    rotations = np.asarray(rotations, dtype=np.float64).reshape(-1, 3, 3)
    # Through a quaternion, whose largest component is found first: exact near no turn and near half a turn.
    return np.asarray(Rotation.from_matrix(rotations).as_rotvec(), dtype=np.float64).reshape(-1, 3)


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
