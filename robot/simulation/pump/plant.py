"""The machine that the drive turns: hopper, pump and hose, with pressure and current.

Everything is an exact function of time between two commands. The pressure answers the drive's speed with a lag of its
own; it has nothing to do with how long the material stays in the hose.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from .course import Course
from .first_order import FirstOrder
from .hose import Hose

FULL_PRESSURE = 20.0  # bar, at the largest flow through a free hose
STALL_PRESSURE = 100.0  # bar; the pump slips beyond
IDLE_CURRENT, CURRENT_PER_BAR = 2.0, 0.25  # A
FULL_VOLTAGE = 400.0  # V, at the largest flow
OVERSPEED = 1.5  # largest speed of the drive, by that of the largest flow
NARROWEST = 0.01  # share of the hose that stays open when it counts as blocked


@dataclass(frozen=True)
class PlantSettings:
    """What the machine is like.

    Attributes:
        flow_max: largest flow, mm³/s.
        dead_time, lag: of the flow at the nozzle, s.
        hose_volume: what the hose holds, mm³.
        ramp: time from rest to the largest flow, s; 0: the drive jumps.
        pressure_lag: time constant of the pressure, s.
        hopper: what it holds at first, mm³; may be infinite.
    """

    flow_max: float
    dead_time: float = 0.0
    lag: float = 0.0
    hose_volume: float = 0.0
    ramp: float = 0.0
    pressure_lag: float = 0.3
    hopper: float = math.inf


class Plant:
    """The machine, from a process time on.

    Attributes:
        time: process time until which everything is known, s.
        hose: what leaves the nozzle.
    """

    def __init__(self, settings: PlantSettings, time: float = 0.0) -> None:
        self.settings = settings
        self.time = time
        self.hose = Hose(settings.dead_time, settings.lag, time, content=settings.hose_volume)
        self._course = Course(time)
        self._pressure = FirstOrder(0.0, settings.pressure_lag, time)
        self._level = settings.hopper  # when the course began
        self._open = 1.0  # share of the hose that is not blocked

    @property
    def speed(self) -> float:
        """Of the drive, as the flow that it would give, mm³/s; negative backwards."""
        return self._course.at(self.time)

    @property
    def hopper(self) -> float:
        """What it holds, mm³."""
        return max(self._level - (self._course.volume(self.time) if self._open else 0.0), 0.0)

    @property
    def pressure(self) -> float:
        """At the pump, bar."""
        return max(self._pressure.value, 0.0)

    @property
    def current(self) -> float:
        """Of the motor, A."""
        return (IDLE_CURRENT + CURRENT_PER_BAR * self.pressure) if self.speed else 0.0

    @property
    def voltage(self) -> float:
        """Of the motor, V."""
        return FULL_VOLTAGE * abs(self.speed) / self.settings.flow_max

    def run(self, time: float, flow: float, *, ramp: bool = True) -> None:
        """From a process time on, turn so as to give a flow, mm³/s: by the ramp, or at once."""
        self.advance(time)
        most = OVERSPEED * self.settings.flow_max
        target = min(max(flow, -most), most)
        took = abs(target - self.speed) / self.settings.flow_max * self.settings.ramp if ramp else 0.0
        self._set_off(Course(self.time, self.speed, target, took))

    def fill(self, time: float, level: float) -> None:
        """From a process time on, the hopper holds a volume, mm³."""
        self.advance(time)
        self._go_on()
        self._level = level
        self._set_off(self._course)

    def block(self, time: float, share: float) -> None:
        """From a process time on, a share of the hose is blocked, 0 to 1."""
        self.advance(time)
        self._go_on()
        self._open = 1.0 - share
        self._set_off(self._course)

    def advance(self, time: float) -> None:
        """Go on to a process time; an earlier one changes nothing."""
        self.time = max(self.time, time)
        self.hose.advance(self.time)
        self._pressure.advance(self.time)

    def _go_on(self) -> None:
        """Let what is left of the course be a course of its own."""
        left = max(self._course.start + self._course.ramp - self.time, 0.0)
        self._level = self.hopper
        self._course = Course(self.time, self.speed, self._course.target, left)

    def _set_off(self, course: Course) -> None:
        self._level, self._course = self.hopper, course
        empty = course.when(self._level)
        flows = [part for part in course.parts() if part[0] < empty]
        if empty < math.inf:
            flows.append((max(empty, self.time), 0.0, 0.0))
        for time, flow, slope in flows if self._open else [(self.time, 0.0, 0.0)]:
            self.hose.command(time, flow, slope)
        fastest = max(abs(course.speed), abs(course.target), 1e-9)
        bar = FULL_PRESSURE / self.settings.flow_max / max(self._open, NARROWEST) ** 2
        bar = min(bar, STALL_PRESSURE / fastest)
        for time, speed, slope in course.parts():
            self._pressure.command(time, bar * speed, bar * slope)
