"""Carries out a fault script, cycle by cycle of the controller."""

from __future__ import annotations

import heapq
import itertools
import math
import random
from typing import TYPE_CHECKING, Any

from .faults import Fault, lifting

if TYPE_CHECKING:
    from collections.abc import Callable

    from .fault_script import FaultScript, RandomFaults, ScriptedFault
    from .machine import Machine

PROGRESS_WORDS = (2, 26)
"""Integer output registers in which ur-rtde's script tells of asynchronous moves, without and with the upper range."""


class FaultPlan:
    """What is to come.

    Args:
        script: what was asked for.
        act: makes a fault happen, given its values; told of each one in turn, with the process time.
    """

    def __init__(self, script: FaultScript, act: Callable[[float, Fault, dict[str, Any]], None]) -> None:
        self._act = act
        self._order = itertools.count()
        self._due: list[tuple[float, int, Callable[[float], None]]] = []
        self._watched = [_Watched(entry) for entry in script.faults if entry.at is None]
        self._waypoints = [WaypointCount(word) for word in PROGRESS_WORDS]
        for entry in script.faults:
            if entry.at is not None:
                self._at(entry.at, _Repeated(self, entry))
        if script.random is not None:
            chance = _Chance(self, script.random)
            self._at(chance.interval(), chance)

    def step(self, machine: Machine) -> None:
        """Let happen what is due in this cycle."""
        while self._due and self._due[0][0] <= machine.time:
            time, _, act = heapq.heappop(self._due)
            act(time)
        if self._watched:
            passed = sum(count.step(machine) for count in self._waypoints)
            for watched in self._watched:
                if watched.begins(machine, passed):
                    self.happen(machine.time, watched.entry.fault, watched.entry.values, watched.entry.lasts)
            self._watched = [watched for watched in self._watched if watched.left > 0]

    def happen(self, time: float, fault: Fault, values: dict[str, Any], lasts: float | None) -> None:
        """Make a fault happen that was due at a process time, and plan its end."""
        self._act(time, fault, values)
        end = lifting(fault, values)
        if lasts is not None and end is not None:
            self._at(time + lasts, lambda then: self._act(then, *end))

    def _at(self, time: float, act: Callable[[float], None]) -> None:
        heapq.heappush(self._due, (time, next(self._order), act))


class _Repeated:
    """A fault at a time, and again every so often."""

    def __init__(self, plan: FaultPlan, entry: ScriptedFault) -> None:
        self._plan, self._entry = plan, entry
        self._left = entry.times or (1 if entry.every is None else math.inf)

    def __call__(self, time: float) -> None:
        entry = self._entry
        self._plan.happen(time, entry.fault, entry.values, entry.lasts)
        self._left -= 1
        if entry.every is not None and self._left > 0:
            self._plan._at(time + entry.every, self)  # noqa: SLF001 - the plan's own


class _Chance:
    """Faults by chance."""

    def __init__(self, plan: FaultPlan, chances: RandomFaults) -> None:
        self._plan, self._chances = plan, chances
        self._random = random.Random(chances.seed)  # noqa: S311 - the same for the same seed

    def interval(self) -> float:
        """Process time to the next, s."""
        return self._random.expovariate(1.0 / self._chances.mean_interval_s)

    def __call__(self, time: float) -> None:
        fault = self._random.choice(self._chances.faults)
        self._plan.happen(time, fault, self._chances.of(fault), self._chances.lasts)
        self._plan._at(time + self.interval(), self)  # noqa: SLF001


class _Watched:
    """A fault that waits for something."""

    def __init__(self, entry: ScriptedFault) -> None:
        self.entry = entry
        self.left = entry.times or 1
        self._was = False

    def begins(self, machine: Machine, passed: int) -> bool:
        """Whether what it waits for has come about in this cycle; `passed` waypoints were passed so far."""
        is_so = self._holds(machine, passed)
        begins = is_so and not self._was
        self._was = is_so
        self.left -= begins
        return begins

    def _holds(self, machine: Machine, passed: int) -> bool:
        entry = self.entry
        if entry.waypoint is not None:
            return passed >= entry.waypoint
        if entry.when_near is not None:
            near = entry.when_near
            return math.dist(machine.state.pose[:3], near.position) <= near.radius
        assert entry.when_register is not None
        kind, _, number = entry.when_register.name.partition("_register_")
        bank: list[Any] = getattr(machine, f"{kind}s")
        return bool(bank[int(number)] == entry.when_register.value)


class WaypointCount:
    """Counts the waypoints that asynchronous moves pass, by the word that ur-rtde's control script keeps of them.

    A waypoint is passed when the progress of a move goes on from it, or the move ends.
    """

    def __init__(self, register: int) -> None:
        self._register = register
        self._passed = 0
        self._progress = 0
        self._operation = 0
        self._running = False

    def step(self, machine: Machine) -> int:
        """How many were passed until now."""
        word = machine.output_ints[self._register]
        progress, running, operation = word & 0x7FFF, bool(word >> 15 & 1), word >> 24 & 0x7F
        if self._running and (operation != self._operation or not running):
            self._passed += 1
        if operation != self._operation:
            self._progress = 0
        if running:
            self._passed += max(0, progress - self._progress)
            self._progress = progress
        self._operation, self._running = operation, running
        return self._passed
