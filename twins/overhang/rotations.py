"""Best rotations of many small point sets at once (orthogonal Procrustes).

A rotation is asked for again and again while a shape moves a little, so each starts from the one before: Newton's
method on the rotations, which doubles its digits a step. Where it does not apply (a first call far off, a mirrored
or flat set) Horn's quaternion, the top eigenvector of a 4×4 matrix, decides (Horn 1987).
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def best_rotations(S: Array, start: Array | None = None) -> Array:
    """Rotations R that make tr(R S) greatest, so that Σ w ‖R d − d'‖² is least for S = Σ w d d'ᵀ.

    Args:
        S: shape (n, 3, 3).
        start: rotations near the wanted ones, shape (n, 3, 3); changes the time taken, not the result.

    Returns:
        Shape (n, 3, 3), determinant +1 throughout; the identity where S is 0.
    """
    R = np.broadcast_to(np.eye(3), S.shape).copy() if start is None else np.array(start, dtype=np.float64)
    turn_to_best(np.ascontiguousarray(S, dtype=np.float64), R)
    return R


@nb.njit(cache=True, nogil=True)
def turn_to_best(S: Array, R: Array) -> None:
    """`best_rotations` in place: R holds the start and receives the result."""
    A, T = np.empty((3, 3)), np.empty((3, 3))
    for k in range(len(S)):
        found = False
        for _ in range(8):
            for i in range(3):
                for j in range(3):
                    A[i, j] = R[k, i, 0] * S[k, 0, j] + R[k, i, 1] * S[k, 1, j] + R[k, i, 2] * S[k, 2, j]
            # tr(exp[ω] A) = tr A + g·ω − ½ ωᵀ H ω + …
            g0, g1, g2 = A[1, 2] - A[2, 1], A[2, 0] - A[0, 2], A[0, 1] - A[1, 0]
            trace = A[0, 0] + A[1, 1] + A[2, 2]
            h00, h11, h22 = trace - A[0, 0], trace - A[1, 1], trace - A[2, 2]
            h01, h02, h12 = (
                -0.5 * (A[0, 1] + A[1, 0]),
                -0.5 * (A[0, 2] + A[2, 0]),
                -0.5 * (A[1, 2] + A[2, 1]),
            )
            c00, c01, c02 = h11 * h22 - h12 * h12, h12 * h02 - h01 * h22, h01 * h12 - h11 * h02
            c11, c12, c22 = h00 * h22 - h02 * h02, h01 * h02 - h00 * h12, h00 * h11 - h01 * h01
            determinant = h00 * c00 + h01 * c01 + h02 * c02
            size = abs(h00) + abs(h11) + abs(h22)
            if not (h00 > 0.0 and c22 > 0.0 and determinant > 1e-9 * size**3):
                break  # not near a greatest value
            x = 0.5 * (c00 * g0 + c01 * g1 + c02 * g2) / determinant
            y = 0.5 * (c01 * g0 + c11 * g1 + c12 * g2) / determinant
            z = 0.5 * (c02 * g0 + c12 * g1 + c22 * g2) / determinant
            square = x * x + y * y + z * z
            if square > 0.25:
                break
            _quaternion_matrix(1.0, x, y, z, T)
            for j in range(3):
                a, b, c = R[k, 0, j], R[k, 1, j], R[k, 2, j]
                for i in range(3):
                    R[k, i, j] = T[i, 0] * a + T[i, 1] * b + T[i, 2] * c
            if square < 1e-14:  # the next step would be below 1e-14
                found = True
                break
        if not found:
            _horn(S[k], R[k])


@nb.njit(cache=True, nogil=True)
def _quaternion_matrix(w: float, x: float, y: float, z: float, R: Array) -> None:
    """The rotation of a quaternion of any length but 0."""
    s = 2.0 / (w * w + x * x + y * y + z * z)
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)


@nb.njit(cache=True, nogil=True)
def _horn(S: Array, R: Array) -> None:
    """The greatest tr(R S) over all rotations, by Jacobi's rotations of Horn's symmetric matrix."""
    K, Q = np.empty((4, 4)), np.eye(4)
    K[0, 0] = S[0, 0] + S[1, 1] + S[2, 2]
    K[1, 1] = S[0, 0] - S[1, 1] - S[2, 2]
    K[2, 2] = S[1, 1] - S[0, 0] - S[2, 2]
    K[3, 3] = S[2, 2] - S[0, 0] - S[1, 1]
    K[0, 1] = K[1, 0] = S[1, 2] - S[2, 1]
    K[0, 2] = K[2, 0] = S[2, 0] - S[0, 2]
    K[0, 3] = K[3, 0] = S[0, 1] - S[1, 0]
    K[1, 2] = K[2, 1] = S[0, 1] + S[1, 0]
    K[1, 3] = K[3, 1] = S[2, 0] + S[0, 2]
    K[2, 3] = K[3, 2] = S[1, 2] + S[2, 1]
    for _ in range(30):
        beside, total = 0.0, 0.0
        for i in range(4):
            for j in range(4):
                total += K[i, j] ** 2
                if i != j:
                    beside += K[i, j] ** 2
        if beside <= 1e-30 * total:
            break
        for p in range(3):
            for q in range(p + 1, 4):
                if K[p, q] == 0.0:
                    continue
                ratio = (K[q, q] - K[p, p]) / (2.0 * K[p, q])
                t = (1.0 if ratio >= 0.0 else -1.0) / (abs(ratio) + np.sqrt(ratio * ratio + 1.0))
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for r in range(4):
                    a, b = K[r, p], K[r, q]
                    K[r, p], K[r, q] = c * a - s * b, s * a + c * b
                for r in range(4):
                    a, b = K[p, r], K[q, r]
                    K[p, r], K[q, r] = c * a - s * b, s * a + c * b
                for r in range(4):
                    a, b = Q[r, p], Q[r, q]
                    Q[r, p], Q[r, q] = c * a - s * b, s * a + c * b
    top = 0
    for i in range(1, 4):
        if K[i, i] > K[top, top]:
            top = i
    _quaternion_matrix(Q[0, top], Q[1, top], Q[2, top], Q[3, top], R)
