"""Interior points: a grid inside a layer's region, for meshes whose elements are to be no larger than their bead.

A region has points on its curves alone, so that tetrahedra span it from side to side. Grid points that keep away
from the curves leave the curves' segments Gabriel edges and the region what it was.
"""

from __future__ import annotations

from collections.abc import Sequence

import numba as nb
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

CLEARANCE = 0.6
"""Least distance of an interior point from the curves, as a share of the grid's spacing."""


def interior_points(curves: Sequence[Array], spacing: float, *, shifted: bool) -> Array:
    """Points of a triangular grid inside the region to the left of closed curves, shape (n, 2), mm.

    Args:
        curves: each of shape (m, 2), mm.
        spacing: of the grid, mm.
        shifted: take the grid's other half, above the middles of its triangles; for every other layer.
    """
    if not curves:
        return np.zeros((0, 2))
    start = np.concatenate(curves)
    end = np.concatenate([np.roll(curve, -1, axis=0) for curve in curves])
    step = np.array([spacing, spacing * np.sqrt(0.75)])
    first = np.floor(start.min(axis=0) / step).astype(np.int64) - 1
    count = np.ceil(start.max(axis=0) / step).astype(np.int64) + 2 - first
    i, j = np.meshgrid(first[0] + np.arange(count[0]), first[1] + np.arange(count[1]), indexing="ij")
    grid = np.column_stack([(i + 0.5 * (j % 2)).ravel(), j.ravel().astype(np.float64)]) * step
    if shifted:
        grid = grid + np.array([0.0, spacing / np.sqrt(3.0)])
    inside = _inside(grid, np.ascontiguousarray(start), np.ascontiguousarray(end), CLEARANCE * spacing)
    return np.asarray(grid[inside], dtype=np.float64)


@nb.njit(cache=True, nogil=True)
def _inside(points: Array, start: Array, end: Array, clearance: float) -> npt.NDArray[np.bool_]:
    """Whether points have a winding number above 0 and keep a distance from all segments."""
    inside = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        winding, clear = 0, True
        for s in range(len(start)):
            ax, ay, bx, by = start[s, 0] - x, start[s, 1] - y, end[s, 0] - x, end[s, 1] - y
            if (ay <= 0.0) != (by <= 0.0) and (ax * by - ay * bx > 0.0) == (by > ay):
                winding += 1 if by > ay else -1
            dx, dy = bx - ax, by - ay
            length = dx * dx + dy * dy
            share = min(max(-(ax * dx + ay * dy) / length, 0.0), 1.0) if length > 0.0 else 0.0
            px, py = ax + share * dx, ay + share * dy
            if px * px + py * py < clearance * clearance:
                clear = False
                break
        inside[i] = clear and winding > 0
    return inside
