"""What moves have in common that are told one after another while the arm runs.

A controller knows a program's next move only when the program tells it. A move with a blend radius asks for the next
one when the arm enters the blend, or before, when it would otherwise have to begin to brake: told in time, the arm
goes on through the blend; not told, it comes to rest at the target. So where lines are short for the arm's speed, it
knows several targets ahead. A move without a radius ends at rest.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from .course import Course

if TYPE_CHECKING:
    from collections.abc import Callable

    from .frame import Numbers
    from .motion import ArmState

MOST_ASKED = 200
"""Targets that are asked for in one cycle at most."""

RAMP = 0.25
"""Share of a move's time in which it speeds up, where the program gives the time."""


class ToldMotion(ABC):
    """Follows targets as they are told.

    Args:
        state: of the arm, at rest.
        ask: called when the arm asks for the next target, which may be added at once or later.

    Attributes:
        asking: whether the arm needs the next target, if there is one, and goes on if told where.
    """

    def __init__(self, state: ArmState, ask: Callable[[], None]) -> None:
        self.state = state
        self.finished, self.resting, self.asking = True, True, False
        self.throttle_rate = 1.0
        self._ask = ask
        self._course = Course()
        self._goes_on = False  # whether the last target asks for a next one
        self._zone = 0.0  # distance before the end at which it asks at the latest
        self._share = 1.0  # of the speed slider
        self._braking = 0.0

    def ask_with(self, ask: Callable[[], None]) -> None:
        """Ask somebody else for the next target."""
        self._ask = ask

    def advance(self, seconds: float, path_seconds: float, share: float) -> None:
        """See `Motion`.

        Raises:
            ReachError: the arm cannot take the pose that it is led to.
        """
        if self.finished or seconds <= 0.0:
            return
        if self._braking:
            end = self._coast(seconds)
            self.resting = self._course.speed <= 0.0
        else:
            self._share = share
            self._look_ahead(path_seconds)
            end = self._run(seconds, path_seconds)
        if end is not None:
            self.finished = self.resting = True
            self.asking = False
        now = self._course.speed * (1.0 if self._braking else share)
        self._see(end if end is not None else self._course.here(), now, seconds)

    def _run(self, seconds: float, path_seconds: float) -> Numbers | None:
        """Run along the course for a time that the slider has made less; what stands at the end if it was reached."""
        del seconds
        return self._course.run(path_seconds)

    def _coast(self, seconds: float) -> Numbers | None:
        """Brake along the course for a time; what stands at the end if it was reached."""
        return self._course.coast(seconds, self._braking)

    @property
    def passing(self) -> bool:
        """Whether the arm goes on if it is told where to now."""
        return self.asking and not self._braking

    @property
    @abstractmethod
    def waypoint(self) -> Numbers:
        """The tool's frame at the target of the move that goes on."""

    @abstractmethod
    def _see(self, place: Numbers, speed: float, seconds: float) -> None:
        """Take the state at a place of the course that is passed with a speed."""

    def _told(self, speed: float, acceleration: float) -> None:
        """Go on to what was added to the course."""
        self.throttle_rate = acceleration / speed
        self._course.plan()
        self.asking = False
        self.finished = self.resting = not self._course.pieces

    def _look_ahead(self, seconds: float) -> None:
        """Ask for as many targets as it takes to go on without braking for a time."""
        for _ in range(MOST_ASKED):
            if self.asking or not self._goes_on or not self._near(seconds):
                return
            known = self._course.ahead
            self.asking = True
            self._ask()
            if self._course.ahead <= known:
                return  # a target where the arm comes to anyhow; there may be any number of them

    def _near(self, seconds: float) -> bool:
        """Whether the next target is needed within a time."""
        course = self._course
        speed = max(course.speed, min(course.speed + course.gentlest * seconds, course.pieces[0].speed))
        braking = speed * speed / (2.0 * course.gentlest)
        return course.ahead - speed * seconds <= max(self._zone, braking)

    def _stoppable(self, length: float, acceleration: float) -> float:
        """Largest part of both legs that a blend may take and leave enough way to come to rest behind it.

        It matters where the leg that is told now, of a given length, is to be run at less acceleration.
        """
        course = self._course
        way = course.gentlest * course.ahead + acceleration * length - 0.5 * course.speed**2
        return max(way / (course.gentlest + acceleration), 0.0)

    def brake(self, tool: float = math.inf, joint: float = math.inf) -> None:
        """See `Motion`."""
        if self.finished:
            return
        course = self._course
        if not self._braking:
            course.speed *= self._share
        self._braking = min(max(self._along(tool, joint), 1e-6), 1e9)

    @abstractmethod
    def _along(self, tool: float, joint: float) -> float:
        """Deceleration along the course for one in mm/s² of the tool or in rad/s² of the fastest joint."""

    def resume(self) -> None:
        """See `Motion`."""
        if self._braking and self._share > 0.0:
            self._course.speed /= self._share
        self._braking = 0.0
        self.resting = self.finished


def in_time(way: float, seconds: float) -> tuple[float, float]:
    """Speed and acceleration that run a way in a time."""
    speed = way / (seconds * (1.0 - RAMP))
    return speed, speed / (seconds * RAMP)
