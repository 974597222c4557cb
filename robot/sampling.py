"""Sampling: robot states and pump readings, which come at their own times, become one row of samples.

A sample is taken with a state of the robot. Its flow is interpolated between the readings before and after it, so
samples wait for the next reading.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from planning import PrintedSample

from .pump_link import PumpReading
from .robot_state import RobotState

PERIOD = 0.01
"""Shortest process time between two samples, s."""


class Sampler:
    """Joins states and readings of one print.

    Args:
        record: called with every sample, in the order of time.
    """

    def __init__(self, record: Callable[[PrintedSample], None]) -> None:
        self._record = record
        self._waiting: list[tuple[RobotState, int, int]] = []
        self._latest: RobotState | None = None
        self._sampled = -math.inf
        self._reading, self._read_at = PumpReading(), -math.inf

    def see(self, state: RobotState, waypoint: int, segment: int) -> None:
        """Take a state of the robot, on its way to a waypoint of a segment."""
        self._latest = state
        if state.time - self._sampled >= PERIOD:
            self._sampled = state.time
            self._waiting.append((state, waypoint, segment))

    def read(self, reading: PumpReading) -> None:
        """Take a reading of the pump; it belongs to the newest state."""
        if self._latest is None:
            return
        now = self._latest.time
        before, span = self._reading, now - self._read_at
        for state, waypoint, segment in self._waiting:
            share = (state.time - self._read_at) / span if 0.0 < span < math.inf else 1.0
            flow = before.flow + share * (reading.flow - before.flow)
            x, y, z = map(float, state.position)
            self._record(
                PrintedSample(state.time, x, y, z, state.speed, reading.command, flow, waypoint, segment)
            )
        self._waiting.clear()
        self._reading, self._read_at = reading, now

    def flush(self) -> None:
        """Record what still waits, with the last flow that is known."""
        self.read(self._reading)
