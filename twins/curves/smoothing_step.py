"""One step of curve smoothing with a side and a curvature constraint (seed paper, Section 4.1, Algorithm 1).

Each point is drawn to the middle of its neighbours (equation 1). Where that would take it to the locked side, the
displacement is turned round and shared by its neighbours, so that a fillet grows on the permitted side.

Curves are linked lists in arrays: `before[i]` and `after[i]` are a point's neighbours, -1 beyond an open end. A
point that has been collapsed has `after[i]` = -2.
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


@nb.njit(cache=True, nogil=True)
def displacements(
    points: Array,
    before: Indices,
    after: Indices,
    side: int,
    strengths: tuple[float, float],
    limit: Array,
    stops: bool,
) -> tuple[Array, Array]:
    """Where a step of Algorithm 1 takes each point (its lines 2 to 16), and the curvature at each point.

    Args:
        points: shape (n, 2), mm.
        side: 1 where the left of the curves is permitted, -1 the right, 0 both: then equation (1) alone, for points
            above the curvature.
        strengths: s_0 and s_1.
        limit: shape (n,): κ_max at each point, 1/mm.
        stops: points at or below κ_max push no neighbours either. Algorithm 1 as printed lets them, so that arcs
            grow on and on; the text has only points above κ_max cause displacements.

    Returns:
        displacements, shape (n, 2); curvatures by equation (3), shape (n,).
    """
    n = len(points)
    own = np.zeros((n, 2))
    adjusted = np.zeros((n, 2))
    kappa = np.zeros(n)
    permitted = np.zeros(n, np.bool_)
    for i in range(n):
        h, j = before[i], after[i]
        if h < 0 or j < 0:
            continue
        ux, uy = points[i, 0] - points[h, 0], points[i, 1] - points[h, 1]
        vx, vy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
        u, v = np.hypot(ux, uy), np.hypot(vx, vy)
        if u == 0.0 or v == 0.0:
            continue
        kappa[i] = np.hypot(vx / v - ux / u, vy / v - uy / u) / min(u, v)
        fx, fy = 0.25 * strengths[0] * (vx - ux), 0.25 * strengths[0] * (vy - uy)
        # The permitted normal is across the line from neighbour to neighbour; only its sign along f matters.
        along = side * ((uy + vy) * -fx + (ux + vx) * fy)
        if along < 0.0:
            if not stops or kappa[i] > limit[i]:
                for k in (h, j):
                    adjusted[k, 0] -= 0.5 * fx
                    adjusted[k, 1] -= 0.5 * fy
        else:
            share = strengths[1] if side != 0 else 1.0
            own[i, 0], own[i, 1] = share * fx, share * fy
            permitted[i] = True
    for i in range(n):
        if permitted[i] and (adjusted[i, 0] != 0.0 or adjusted[i, 1] != 0.0 or kappa[i] > limit[i]):
            adjusted[i, 0] += own[i, 0]
            adjusted[i, 1] += own[i, 1]
    return adjusted, kappa


@nb.njit(cache=True, nogil=True)
def shortest_of(points: Array, before: Indices, after: Indices, fixed: Flags, i: int) -> int:
    """Of the segment that begins at point i, the end that can go: free, not an end, the less bent; -1 for neither."""
    gone, least = -1, np.inf
    for k in (i, after[i]):
        if k >= 0 and not fixed[k] and before[k] >= 0 and after[k] >= 0:
            h, j = before[k], after[k]
            ux, uy = points[k, 0] - points[h, 0], points[k, 1] - points[h, 1]
            vx, vy = points[j, 0] - points[k, 0], points[j, 1] - points[k, 1]
            bend = abs(np.arctan2(ux * vy - uy * vx, ux * vx + uy * vy))
            if bend < least:
                gone, least = k, bend
    return gone
