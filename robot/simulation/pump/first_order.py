"""A first-order lag with dead time, exactly: its input is linear between its changes, so nothing is stepped.

With the input u + m s, s being the time since its last change, and the lag T, the output is a + m s + c exp(-s / T)
with a = u - m T, and c such that it goes on from where it was.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise


@dataclass(frozen=True, eq=False)
class Piece:
    """The output from one change of the input to the next: a + b s + c exp(-s / lag).

    Attributes:
        start: time at which s is 0, s.
        a, b, c: coefficients.
        lag: time constant, s.
    """

    start: float
    a: float
    b: float = 0.0
    c: float = 0.0
    lag: float = 0.0

    def value(self, s: float) -> float:
        """The output, a time s after the start."""
        return self.a + self.b * s + (self.c * math.exp(-s / self.lag) if self.c else 0.0)

    def integral(self, s: float) -> float:
        """The output's integral from the start to a time s after it."""
        fading = self.c * self.lag * -math.expm1(-s / self.lag) if self.c else 0.0
        return self.a * s + 0.5 * self.b * s * s + fading

    def sign_changes(self, begin: float, end: float) -> list[float]:
        """Where the output passes through 0 between two times after the start, in order: at most twice."""
        marks = [begin, end]
        ratio = self.b * self.lag / self.c if self.c else 0.0
        if ratio > 0.0:  # the one place where the output turns round
            marks.insert(1, min(max(-self.lag * math.log(ratio), begin), end))
        return [
            bisect(self.value, low, high)
            for low, high in pairwise(marks)
            if self.value(low) * self.value(high) < 0.0
        ]

    def when(self, volume: float, begin: float, end: float) -> float:
        """The time between two times after the start at which the integral reaches a value, while it rises."""
        return bisect(lambda s: self.integral(s) - volume, begin, end)


def bisect(function: Callable[[float], float], low: float, high: float) -> float:
    """The place between two others where a function changes its sign, as exactly as floats tell."""
    rising = function(high) >= function(low)
    while True:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return high
        if (function(middle) >= 0.0) == rising:
            high = middle
        else:
            low = middle


class FirstOrder:
    """An input and what becomes of it.

    Attributes:
        time: until which the output is known, s.
        piece: the one that `time` lies in.
    """

    def __init__(self, dead_time: float, lag: float, time: float = 0.0) -> None:
        self.time = time
        self.piece = Piece(time, 0.0)
        self._dead_time, self._lag = dead_time, lag
        self._coming: deque[tuple[float, float, float]] = deque()  # time of arrival, value, slope

    @property
    def value(self) -> float:
        """The output."""
        return self.piece.value(self.time - self.piece.start)

    def command(self, time: float, value: float, slope: float = 0.0) -> None:
        """From a time on, the input has a value, and changes by a slope; what was said for later is forgotten."""
        arrival = time + self._dead_time
        while self._coming and self._coming[-1][0] >= arrival:
            self._coming.pop()
        self._coming.append((arrival, value, slope))

    def advance(self, time: float) -> list[tuple[Piece, float]]:
        """Go on to a time.

        Returns:
            The pieces that this passes through, each with the time to which it was followed; the last one may go on.
        """
        passed = []
        while self._coming and self._coming[0][0] <= time:
            arrival, value, slope = self._coming.popleft()
            self.time = max(self.time, arrival)
            passed.append((self.piece, self.time))
            now = value + slope * (self.time - arrival)  # the input may have been told late
            a = now - slope * self._lag
            c = self.value - a if self._lag > 0.0 else 0.0
            self.piece = Piece(self.time, a, slope, c, self._lag)
        self.time = max(self.time, time)
        passed.append((self.piece, self.time))
        return passed
