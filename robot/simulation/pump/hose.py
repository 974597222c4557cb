"""Pump and hose: what leaves the nozzle after what the pump is told.

A command reaches the nozzle after a dead time; from then on the flow goes towards it exponentially. Commands are
constant between their changes, so flow and volume are known exactly at any time; nothing is stepped.
"""

from __future__ import annotations

import math
from collections import deque


class Hose:
    """Flow at the nozzle.

    Attributes:
        time: process time until which flow and volume are known, s.
        flow: at the nozzle, mm³/s.
        volume: that left the nozzle since the beginning, mm³.
    """

    def __init__(self, dead_time: float, lag: float, time: float = 0.0) -> None:
        self.time = time
        self.flow = self.volume = 0.0
        self._dead_time, self._lag = dead_time, lag
        self._target = 0.0
        self._coming: deque[tuple[float, float]] = deque()  # time of arrival at the nozzle, flow

    def command(self, time: float, flow: float) -> None:
        """From a process time on, which must not go back, the pump gives a flow."""
        self._coming.append((time + self._dead_time, flow))

    def advance(self, time: float) -> None:
        """Go on to a process time."""
        while self._coming and self._coming[0][0] <= time:
            arrival, target = self._coming.popleft()
            self._run(arrival)
            self._target = target
        self._run(time)

    def _run(self, time: float) -> None:
        seconds = time - self.time
        if seconds <= 0.0:
            return
        if self._lag > 0.0:
            kept = math.exp(-seconds / self._lag)
            gap = self.flow - self._target
            self.volume += self._target * seconds + gap * self._lag * -math.expm1(-seconds / self._lag)
            self.flow = self._target + gap * kept
        else:
            self.flow = self._target
            self.volume += self._target * seconds
        self.time = time
