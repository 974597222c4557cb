"""Whether a drive does what it is told, by what it measures: a connection that answers well says nothing of that.

Every judgement takes its time: a pump answers after its dead time and with a lag, ramps, and measures coarsely. Any
sign that it follows begins that time anew.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from planning import cell

    from .pump_link import PumpReading
    from .pump_map import PumpMap

STANDSTILL = 0.5
"""Time that a drive which should pump may not run or measure nothing, beside its answer, s."""

DOUBT = 1.0
"""Time that it may measure much too little, or the same whatever it is told, beside its answer, s."""

GLITCH = 0.25
"""Time that it may measure what no pump gives, s: on a serial line a late answer is taken for another."""

BEATS = 5
"""Counts of the heartbeat for which its register may stand still; they are a tenth of a second apart."""

BEYOND = 2.0
"""Share of the largest flow above which a measured one makes no sense, either way."""

TOO_LITTLE = 0.25
"""Share of the flow that was told below which a measured one is not a matter of calibration."""

PROGRESS = 0.01
"""Share of the flow that was told by which the measured one has to rise to count as coming."""

CHANGE = 0.2
"""Share of the highest flow by which what should be given has to change until the measured one has to."""

FAINT = 0.02
"""Share of the largest flow that a drive need not measure well."""

DROPS = 0.005
"""Share of the largest flow that it need not measure at all."""


class PumpJudge:
    """Looks at one reading after the other.

    Args:
        settings: calibration and largest flow.
        registers: the register map.
    """

    def __init__(self, settings: cell.Pump, registers: PumpMap) -> None:
        self._map, self._settings = registers, settings
        self._answer = settings.dead_time_s + settings.lag_s
        measured = registers.registers.measured_flow
        floating = measured is None or measured.type == "float32"
        self._count = 0.0 if measured is None or floating else measured.unit * registers.flow_factor
        self._faint = max(FAINT * settings.flow_max, 4.0 * self._count)
        self._sense_at = self._running_at = self._flowing_at = self._enough_at = math.nan
        self._most = 0.0
        self._echo: int | None = None
        self._echoes, self._echo_beat = 0, 0
        self._still = _Still(settings.dead_time_s, settings.lag_s)

    def fault(self, reading: PumpReading, now: float) -> str | None:
        """What is wrong with a drive that gives this reading, or None.

        Args:
            reading: the newest.
            now: wall time, s.
        """
        faults = (self._nonsense, self._deaf, self._idle, self._dry, self._short, self._stiff)
        found = [fault(reading, now) for fault in faults]  # each keeps its own time
        return next((fault for fault in found if fault is not None), None)

    def _nonsense(self, reading: PumpReading, now: float) -> str | None:
        """A flow beyond all pumps."""
        if math.isnan(self._sense_at) or abs(reading.flow) <= BEYOND * self._settings.flow_max:
            self._sense_at = now
        if now - self._sense_at <= GLITCH:
            return None
        return (
            f"says that it pumps {reading.flow:g} mm³/s, and {self._settings.flow_max:g} are all it can; check type, "
            f"word order and unit of {self._register}"
        )

    def _deaf(self, reading: PumpReading, now: float) -> str | None:
        """A heartbeat that could be read back, and stands still."""
        del now
        if reading.echo is None:
            return None
        if reading.echo != self._echo:
            self._echo, self._echo_beat = reading.echo, reading.beat
            self._echoes += 1
        # Some drives show nothing there at all: only one that has followed can stop to.
        if self._echoes <= 2 or (reading.beat - self._echo_beat) % (1 << 16) <= BEATS:
            return None
        at = self._map.registers.heartbeat
        assert at is not None
        return (
            f"answers, and takes nothing of what it is told: its heartbeat, register {at.address}, stands still at "
            f"{reading.echo}; look at the drive"
        )

    def _idle(self, reading: PumpReading, now: float) -> str | None:
        """A drive that says itself that it does not run."""
        if math.isnan(self._running_at) or reading.command <= 0.0 or reading.running is not False:
            self._running_at = now
        if now - self._running_at <= STANDSTILL + self._answer:
            return None
        return f"is told {reading.command:g} mm³/s and says that it does not run; look at the drive"

    def _dry(self, reading: PumpReading, now: float) -> str | None:
        """No flow at all."""
        due = reading.command > max(DROPS * self._settings.flow_max, 4.0 * self._count)
        flowing = not due or reading.flow > 1e-3 * reading.command
        if math.isnan(self._flowing_at) or flowing:
            self._flowing_at = now
        if now - self._flowing_at <= STANDSTILL + self._answer:
            return None
        return (
            f"is told {reading.command:g} mm³/s and measures none; look at drive, hopper and hose, and at "
            f"{self._register}"
        )

    def _short(self, reading: PumpReading, now: float) -> str | None:
        """A flow that is far too small, and does not rise."""
        low = reading.command > self._faint and reading.flow < TOO_LITTLE * reading.command
        rises = reading.flow > self._most + max(PROGRESS * reading.command, self._count)
        if math.isnan(self._enough_at) or not low or rises:
            self._enough_at, self._most = now, reading.flow
        if now - self._enough_at <= DOUBT + self._answer:
            return None
        return (
            f"is told {reading.command:g} mm³/s and measures {reading.flow:g}; look at pump and hose, and check type, "
            f"word order and unit of its flows' registers"
        )

    def _stiff(self, reading: PumpReading, now: float) -> str | None:
        """The same flow to the last digit, whatever it is told."""
        if self._map.registers.measured_flow is None:
            return None
        low, high, most = self._still.see(reading, now, DOUBT + self._answer)
        if high - low <= max(CHANGE * most, self._faint):
            return None
        return (
            f"answers with registers that stand still: it measures {reading.flow:g} mm³/s and nothing else, though "
            f"it was told {low:.0f} to {high:.0f}; look at the drive"
        )

    @property
    def _register(self) -> str:
        at = self._map.registers.measured_flow
        return "its flow" if at is None else f"register {at.address} (measured_flow)"


class _Course:
    """What a pump gives that follows with a lag: lowest and highest so far.

    Args:
        given: at first, mm³/s.
        time: when that is, s.
    """

    def __init__(self, given: float, time: float) -> None:
        self.given = self.low = self.high = given
        self._time = time

    def follow(self, told: float, time: float, lag: float) -> None:
        """Be told a flow up to a time."""
        left = math.exp(-max(time - self._time, 0.0) / lag) if lag > 0.0 else 0.0
        self.given = told + (self.given - told) * left
        self._time = max(self._time, time)
        self.low, self.high = min(self.low, self.given), max(self.high, self.given)

    @property
    def change(self) -> float:
        """How far it has changed, mm³/s."""
        return self.high - self.low


class _Told:
    """What was told, until it acts."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, float]] = deque()

    def add(self, time: float, told: float) -> None:
        """Be told a flow from a time on."""
        self._waiting.append((time, told))

    def until(self, time: float) -> Iterator[tuple[float, float]]:
        """The flows that act up to a time, and until when each does."""
        while len(self._waiting) > 1 and self._waiting[1][0] <= time:
            yield self._waiting.popleft()[1], self._waiting[0][0]
        if self._waiting[0][0] <= time:
            yield self._waiting[0][1], time


class _Still:
    """What a pump should have given while it measured the same flow.

    Args:
        dead_time, lag: of its answer, s.
    """

    def __init__(self, dead_time: float, lag: float) -> None:
        self._dead_time, self._lag = dead_time, lag
        self._flow = math.nan
        self._expected = _Course(0.0, 0.0)
        self._ahead = _Told()
        self._courses: list[_Course] = []
        self._since = _Told()
        self._most = 0.0

    def see(self, reading: PumpReading, now: float, patience: float) -> tuple[float, float, float]:
        """Take a reading.

        Returns:
            The lowest and highest flow that should have been measured since it is the same, and the highest that was
            told, mm³/s.
        """
        told = reading.command
        self._ahead.add(now, told)
        for flow, time in self._ahead.until(now - self._dead_time):
            self._expected.follow(flow, time, self._lag)
        if reading.flow != self._flow:
            # It may have followed at once, or as it should: it stands still only if neither explains it.
            self._flow, self._since, self._most = reading.flow, _Told(), 0.0
            self._courses = [_Course(told, now), _Course(self._expected.given, now)]
        self._since.add(now, told)
        self._most = max(self._most, told)
        for flow, time in self._since.until(now - patience):
            for course in self._courses:
                course.follow(flow, time, self._lag)
        least = min(self._courses, key=lambda course: course.change)
        return least.low, least.high, self._most
