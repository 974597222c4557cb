"""The course of the drive's speed: a ramp to a target, which it then keeps. Speeds are told as the flow they give."""

from __future__ import annotations

import math
from dataclasses import dataclass

SHORTEST = 1e-9
"""Ramps that take less time are none, s: their slope means nothing any more."""


@dataclass(frozen=True)
class Course:
    """From one command to the next.

    Attributes:
        start: process time at which it begins, s.
        speed: at the start, mm³/s.
        target: at the end of the ramp, and from then on, mm³/s.
        ramp: how long that takes, s.
    """

    start: float
    speed: float = 0.0
    target: float = 0.0
    ramp: float = 0.0

    def __post_init__(self) -> None:
        if self.ramp < SHORTEST:
            object.__setattr__(self, "ramp", 0.0)

    @property
    def slope(self) -> float:
        """Of the ramp, mm³/s²."""
        return (self.target - self.speed) / self.ramp if self.ramp > 0.0 else 0.0

    def at(self, time: float) -> float:
        """Speed at a time from the start on, mm³/s."""
        passed = time - self.start
        return self.target if passed >= self.ramp else self.speed + self.slope * passed

    def volume(self, time: float) -> float:
        """What it gives from the start to a time, mm³."""
        passed = time - self.start
        ramping = min(max(passed, 0.0), self.ramp)
        return (self.speed + 0.5 * self.slope * ramping) * ramping + self.target * max(
            passed - self.ramp, 0.0
        )

    def parts(self) -> list[tuple[float, float, float]]:
        """Time, speed and slope where the slope changes."""
        parts = [(self.start + self.ramp, self.target, 0.0)]
        return [(self.start, self.speed, self.slope), *parts] if self.ramp > 0.0 else parts

    def when(self, volume: float) -> float:
        """The first time at which it has given a volume, which is not negative; infinite if it never does."""
        if volume == math.inf:
            return math.inf
        half = 0.5 * self.slope
        inside = self.speed**2 + 4.0 * half * volume
        if inside >= 0.0:
            root = math.sqrt(inside)
            passed = math.inf
            if self.speed > 0.0:
                passed = 2.0 * volume / (self.speed + root)
            elif half > 0.0:
                passed = (root - self.speed) / (2.0 * half)
            if passed <= self.ramp:
                return self.start + passed
        if self.target <= 0.0:
            return math.inf
        at_top = self.start + self.ramp
        return at_top + max(volume - self.volume(at_top), 0.0) / self.target
