"""Process time: the one clock that the simulated robot and the simulated pump share."""

from __future__ import annotations

import time
from dataclasses import dataclass

SLOWEST, FASTEST = 0.1, 50.0
"""Bounds of the scale of a cell that users start."""


@dataclass(frozen=True)
class ProcessClock:
    """Turns the wall clock, which runs alike in all processes of a machine, into process time.

    Attributes:
        epoch: wall time, as `time.monotonic` gives it, at which process time is 0.
        scale: seconds of process time in a second of wall time.
    """

    epoch: float
    scale: float = 1.0

    def now(self) -> float:
        """Process time, s."""
        return self.at(time.monotonic())

    def at(self, wall: float) -> float:
        """Process time at a wall time, s."""
        return (wall - self.epoch) * self.scale
