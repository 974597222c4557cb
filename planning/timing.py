"""Timing: process time at each waypoint."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def leg_times(length: Array, speed: float, acceleration: float) -> Array:
    """Durations of straight moves from rest to rest, shape (n,), s.

    Args:
        length: shape (n,), mm.
        speed: largest, mm/s.
        acceleration: mm/s².
    """
    full = speed * speed / acceleration
    return np.where(
        length >= full, length / speed + speed / acceleration, 2.0 * np.sqrt(length / acceleration)
    )


def bead_times(length: Array, speed: Array) -> Array:
    """Durations of the moves of a bead whose speed is linear in time between waypoints, shape (n - 1,), s.

    Args:
        length: of each move, shape (n - 1,), mm.
        speed: at each waypoint, shape (n,), mm/s; two neighbours are not both 0.
    """
    return np.asarray(length / (0.5 * (speed[1:] + speed[:-1])), dtype=np.float64)
