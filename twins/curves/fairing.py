"""Fairing of overfill optimisation: how points that nothing pushes follow those beside them.

How far points have gone diffuses along their curve, from stretches that are pushed and those that stay into what lies
between. It does so by lengths, not by points, so that curves sampled more finely end in the same shape; the step is
implicit, which stays stable however short segments are.
"""

from __future__ import annotations

from typing import Final

import numba as nb
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_SHORTEST: Final = 1e-6  # share of the length by which segments count as that long: those of repeated points


@nb.njit(cache=True, nogil=True)
def fair(
    step: Array,
    points: Array,
    origin: Array,
    previous: Indices,
    following: Indices,
    starts: Indices,
    free: Flags,
    share: float,
    length: float,
) -> None:
    """Put into `step` what points that nothing pushes go, and 0 for those that are not free.

    Args:
        step: what points are pushed, shape (n, 2), mm; 0 where nothing pushes.
        points, origin: where they are, and were, shape (n, 2), mm.
        previous, following, starts: as in `Runs`.
        free: shape (n,), which points may move.
        share: at segments of `length` about this share of the difference between how far a point has gone and how
            far its neighbours have.
        length: mm.
    """
    n = len(points)
    still = np.zeros(n, np.bool_)
    gone = np.empty((n, 2))
    for i in range(n):
        if not free[i]:
            step[i, 0] = step[i, 1] = 0.0
        still[i] = not free[i] or step[i, 0] != 0.0 or step[i, 1] != 0.0
        for axis in range(2):
            gone[i, axis] = points[i, axis] + step[i, axis] - origin[i, axis]
    if share <= 0.0:
        return
    # Row i of the system: diagonal 1 + back + ahead; -back to the point before, -ahead to the next.
    back, ahead = np.zeros(n), np.zeros(n)
    for i in range(n):
        if still[i]:
            continue
        p, f = previous[i], following[i]
        to_last = np.sqrt((origin[p, 0] - origin[i, 0]) ** 2 + (origin[p, 1] - origin[i, 1]) ** 2)
        to_next = np.sqrt((origin[f, 0] - origin[i, 0]) ** 2 + (origin[f, 1] - origin[i, 1]) ** 2)
        to_last, to_next = max(to_last, _SHORTEST * length), max(to_next, _SHORTEST * length)
        if p == i:
            ahead[i] = share * (length / to_next) ** 2
        elif f == i:
            back[i] = share * (length / to_last) ** 2
        else:
            rate = share * length * length / (to_last + to_next)
            back[i], ahead[i] = rate / to_last, rate / to_next
    for c in range(len(starts) - 1):
        _solve(gone, back, ahead, starts[c], starts[c + 1])
    for i in range(n):
        if not still[i]:
            for axis in range(2):
                step[i, axis] = gone[i, axis] + origin[i, axis] - points[i, axis]


@nb.njit(cache=True, nogil=True)
def _solve(gone: Array, back: Array, ahead: Array, begin: int, end: int) -> None:
    """Solve the rows of a curve for `gone`, in place.

    They are tridiagonal but for the two corners of a closed curve, which are taken out as a matrix of rank one,
    column (g, 0, ..., -ahead[last]) times row (1, 0, ..., -back[first] / g), as Sherman and Morrison do.
    """
    m = end - begin
    if m < 2:
        return
    first, last = begin, end - 1
    g = -(1.0 + back[first] + ahead[first])
    upper, right = np.empty(m), np.empty((m, 3))
    for i in range(m):
        right[i, 0], right[i, 1], right[i, 2] = gone[begin + i, 0], gone[begin + i, 1], 0.0
    right[0, 2], right[m - 1, 2] = g, -ahead[last]
    for i in range(m):
        k = begin + i
        pivot = 1.0 + back[k] + ahead[k]
        if i == 0:
            pivot -= g
        if i == m - 1:
            pivot -= ahead[last] * back[first] / g
        if i > 0:
            pivot += back[k] * upper[i - 1]
        upper[i] = -ahead[k] / pivot
        for column in range(3):
            if i > 0:
                right[i, column] += back[k] * right[i - 1, column]
            right[i, column] /= pivot
    for i in range(m - 2, -1, -1):
        for column in range(3):
            right[i, column] -= upper[i] * right[i + 1, column]
    below = 1.0 + right[0, 2] - back[first] / g * right[m - 1, 2]
    for axis in range(2):
        along = (right[0, axis] - back[first] / g * right[m - 1, axis]) / below
        for i in range(m):
            gone[begin + i, axis] = right[i, axis] - along * right[i, 2]
