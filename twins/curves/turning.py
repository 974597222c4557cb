"""Turning and curvature of curves: how sharply a nozzle has to turn within the width of a bead.

A polyline has all its turning in its vertices, so its curvature depends on how finely it is sampled. What a bead of
width d feels is the turning within a length d of the curve, whatever the sampling: `largest_turning`.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from twins.errors import ToolpathError
from twins.toolpath import Curve

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


def turning_angles(points: Array, closed: bool = True) -> Array:
    """Signed angle by which a polyline turns at each point, rad, positive to the left; 0 at open ends.

    Args:
        points: shape (n, 2), mm; a closed polyline does not repeat its first point.

    Returns:
        shape (n,), in (-π, π].
    """
    into, out = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    angles = np.arctan2(
        into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0], into[:, 0] * out[:, 0] + into[:, 1] * out[:, 1]
    )
    if not closed:
        angles[[0, -1]] = 0.0
    return np.asarray(angles, dtype=np.float64)


def curvature(
    points: Array, closed: bool = True, estimate: Literal["mean", "inscribed"] = "inscribed"
) -> Array:
    """Curvature of a polyline at each point (seed paper, equations 2 and 3), 1/mm; 0 at open ends.

    Args:
        points: shape (n, 2), mm.
        estimate: what |t_{i+1} - t_i| is divided by: "mean" the mean length of the two segments (equation 2),
            "inscribed" the shorter of them (equation 3), which does not fall as segments become uneven.

    Returns:
        shape (n,).
    """
    segments = np.roll(points, -1, axis=0) - points
    lengths = np.linalg.norm(segments, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        tangents = segments / lengths[:, None]
        into = np.roll(lengths, 1)
        over = np.minimum(into, lengths) if estimate == "inscribed" else 0.5 * (into + lengths)
        result = np.linalg.norm(tangents - np.roll(tangents, 1, axis=0), axis=1) / over
    if not closed:
        result[[0, -1]] = 0.0
    return np.asarray(result, dtype=np.float64)


def largest_turning(curve: Curve, window: float, counted: Flags | None = None) -> float:
    """The greatest sum of absolute turning angles within any piece of length `window` of a curve, rad.

    A curve that bends with radius R turns by window / R; a corner counts whole. Both ends of a piece belong to it. A
    closed curve shorter than the window counts once around.

    Args:
        curve: open or closed.
        window: length along the curve, mm; for a bead its width, or the least distance d_min of beads.
        counted: points whose turning counts, shape (n,); default all.

    Raises:
        ToolpathError: the window is not above 0.
    """
    if not window > 0 or not np.isfinite(window):
        raise ToolpathError(f"the window that turning is summed over must be above 0 mm, not {window}")
    angles = np.abs(turning_angles(curve.points, curve.closed))
    if counted is not None:
        angles = np.where(counted, angles, 0.0)
    lengths = np.linalg.norm(np.roll(curve.points, -1, axis=0) - curve.points, axis=1)
    count = len(angles)
    if curve.closed:
        if lengths.sum() <= window:
            return float(angles.sum())
        angles, lengths = np.tile(angles, 2), np.tile(lengths, 2)
    place = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    summed = np.concatenate([[0.0], np.cumsum(angles)])
    last = np.searchsorted(place, place[:count] + window * (1.0 + 1e-9), side="right")
    return float((summed[last] - summed[:count]).max())
