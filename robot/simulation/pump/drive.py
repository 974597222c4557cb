"""The drive: its states, its registers, and the watchdog that stops it when its controller falls silent.

Where the register map has a heartbeat, only a write that changes a register is a sign of life, the heartbeat's own in
most cases; where it has none, every request is.
"""

from __future__ import annotations

import asyncio
import math
import time
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from robot.pump_words import Register

from .requests import Memory, Refusal, RefusedError

if TYPE_CHECKING:
    from robot.pump_map import PumpMap
    from robot.simulation.clock import ProcessClock

    from .plant import Plant

LOOK_PERIOD = 0.005  # s of wall time


class State(StrEnum):
    """What the drive is doing.

    An emergency stop switches it off, a trip is its own doing; a stop, or the map's reset, makes it ready again. A
    fault stays until somebody looks at the drive.
    """

    OFF = "off"
    READY = "ready"
    FORWARD = "forward"
    REVERSE = "reverse"
    TRIPPED = "tripped"
    FAULT = "fault"


class Drive(Memory):
    """The drive's registers and what they do.

    Args:
        registers: where everything is.
        plant: what it turns.
        clock: turns wall time into process time.
        trip: wall time of silence after which it stops by itself, s; 0: never.
        pressure_limit: bar; beyond it trips, if it measures the pressure.
        current_limit: A; beyond it trips.

    Attributes:
        state: of the drive.
        cause: of its last trip.
        silence: wall time from the last sign of life to the last trip for silence, s.
        width: bits that every measured value and set-point has, whatever the map says; 0: as it says.
    """

    def __init__(
        self,
        registers: PumpMap,
        plant: Plant,
        clock: ProcessClock,
        *,
        trip: float = 0.5,
        pressure_limit: float = 40.0,
        current_limit: float = 12.0,
    ) -> None:
        self.map, self.plant, self.clock = registers, plant, clock
        self.state = State.READY
        self.cause = ""
        self.silence = math.nan
        self.width = 0
        self.tables = frozenset(table for table, _ in registers.addresses)
        self.at_once = registers.words_at_once
        self._trip, self._pressure_limit, self._current_limit = trip, pressure_limit, current_limit
        self._written = {
            at: 0 for name in ("command", "set_flow", "heartbeat") for at in self._writable(name)
        }
        self._target = 0.0
        self._alive = time.monotonic()
        self._frozen: dict[tuple[str, int], int] | None = None
        self._tripped_at = math.nan

    @property
    def running(self) -> bool:
        """Whether it is told to run, and does."""
        return self.state in {State.FORWARD, State.REVERSE}

    @property
    def frozen(self) -> bool:
        """Whether its registers stand still: they show what they did, and take nothing."""
        return self._frozen is not None

    @frozen.setter
    def frozen(self, frozen: bool) -> None:
        self._frozen = self._show() if frozen else None

    def read(self, table: str, addresses: range) -> list[int]:
        shown = self._show() if self._frozen is None else self._frozen
        if any((table, at) not in shown for at in addresses):
            raise RefusedError(Refusal.ADDRESS)
        if self._frozen is None:
            self._hear(changed=False)
        return [shown[table, at] for at in addresses]

    def write(self, address: int, words: list[int]) -> None:
        told = dict(enumerate(words, start=address))
        if any(at not in self._written for at in told):
            raise RefusedError(Refusal.ADDRESS)
        for name in ("command", "set_flow"):
            if 0 < sum(at in told for at in self._writable(name)) < len(self._writable(name)):
                raise RefusedError(Refusal.ADDRESS)  # half of a value
        command = told.get(self.map.registers.command.address)
        if command is not None and command not in self.map.commands.model_dump().values():
            raise RefusedError(Refusal.VALUE)
        if self._frozen is not None:
            return
        self._hear(changed=any(self._written[at] != word for at, word in told.items()))
        self._written.update(told)
        if command is not None:
            self._obey(command)
        self._act()

    def trip(self, cause: str, state: State = State.TRIPPED) -> None:
        """Stop, and do nothing more."""
        self.state, self.cause = state, cause
        self._tripped_at = self.clock.now()
        self._act()

    def reset(self) -> None:
        """Somebody resets the drive at its panel; it does not start by itself."""
        if not self.running:
            self.state = State.READY

    def report(self) -> dict[str, Any]:
        """What leaves the nozzle, and how the drive is, in process time, mm³/s, mm³, s, bar and A."""
        plant = self.plant
        plant.advance(self.clock.now())
        return {
            "time": plant.time,
            "flow": plant.hose.flow,
            "volume": plant.hose.volume,
            "age": plant.hose.age,
            "speed": plant.speed,
            "pressure": plant.pressure,
            "current": plant.current,
            "hopper": plant.hopper if plant.hopper < math.inf else None,
            "state": self.state.value,
            "cause": self.cause,
            "tripped_at": self._tripped_at if self.cause else None,
            "silence": None if math.isnan(self.silence) else self.silence,
        }

    async def watch(self) -> None:
        """Trip when the controller is silent for too long, and when pressure or current is too high."""
        while True:
            wall = time.monotonic()
            silent = wall - self._alive
            if self.running:
                self._guard(wall, silent)
            left = self._trip - silent if self._trip > 0.0 and self.running else LOOK_PERIOD
            await asyncio.sleep(min(max(left, 0.0005), LOOK_PERIOD))

    def _guard(self, wall: float, silent: float) -> None:
        if 0.0 < self._trip <= silent:
            self.silence = silent
            self.trip("communication")
            return
        self.plant.advance(self.clock.at(wall))
        if self.map.registers.pressure is not None and self.plant.pressure > self._pressure_limit:
            self.trip("pressure")
        elif self.plant.current > self._current_limit:
            self.trip("current")

    def _writable(self, name: str) -> range:
        register = self.map.values.get(name)
        return register.addresses if register is not None else range(0)

    def _hear(self, *, changed: bool) -> None:
        """Take a request for a sign of life, or not."""
        if changed or self.map.registers.heartbeat is None:
            self._alive = time.monotonic()

    def _obey(self, command: int) -> None:
        commands = self.map.commands
        if self.state is State.FAULT:
            return
        if command == commands.emergency:
            self.trip("emergency", State.OFF)
        elif command in {commands.stop, commands.reset}:
            if self.running or command == commands.reset or commands.reset is None:
                self.state = State.READY
        elif self.running or self.state is State.READY:
            if not self.running:
                self._alive = time.monotonic()
            self.state = State.REVERSE if command == commands.reverse else State.FORWARD

    def _act(self) -> None:
        """Let the plant turn as the registers say, if that is another way than before."""
        at = self.map.registers.set_flow
        told = self.map.flow(self._decode(at, [self._written[address] for address in at.addresses]))
        told = max(0.0, told)  # neither negative nor no number at all
        target = {State.FORWARD: told, State.REVERSE: -told}.get(self.state, 0.0)
        if target != self._target:
            self._target = target
            ramped = self.state in {State.FORWARD, State.REVERSE, State.READY}
            self.plant.run(self.clock.now(), target, ramp=ramped)

    def _show(self) -> dict[tuple[str, int], int]:
        """All words, as they are read now."""
        plant, at = self.plant, self.map.registers
        plant.advance(self.clock.now())
        speed = abs(plant.speed)
        # A drive that counts in Hz knows its motor; the others measure at the nozzle.
        flow = plant.hose.flow if self.map.flow_per_hz is None else speed
        shown = dict.fromkeys(self.map.addresses, 0)
        shown |= {("holding", address): word for address, word in self._written.items()}
        values = (
            (at.measured_flow, flow / self.map.flow_factor),
            (at.pressure, plant.pressure),
            (at.current, plant.current),
            (at.voltage, plant.voltage),
            (at.torque, 100.0 * plant.pressure / self._pressure_limit),
            (at.volume, plant.hose.volume),
        )
        for register, value in values:
            if register is not None:
                for address, word in zip(register.addresses, self._encode(register, value), strict=True):
                    shown[register.table, address] = word
        states = {
            "ready": self.state is State.READY or self.running,
            "running": self.running,
            "reversing": self.state is State.REVERSE,
            "tripped": self.state in {State.OFF, State.TRIPPED, State.FAULT},
            "empty": plant.hopper <= 0.0,
        }
        for name, bit in self.map.bits.items():
            shown[bit.table, bit.address] |= bit.word(states[name])
        return shown

    def _encode(self, register: Register, value: float) -> list[int]:
        """A value as words, in the width that the drive has."""
        if self.width in {0, 16 * register.count}:
            return register.encode(value)
        counts = max(round(value / register.unit), 0) & (1 << self.width) - 1
        words = [counts >> 16, counts & 0xFFFF] if self.width == 32 else [counts, 0]
        return words[: register.count]

    def _decode(self, register: Register, words: list[int]) -> float:
        """Words as a value, in the width that the drive has."""
        if self.width in {0, 16 * register.count}:
            return register.decode(words)
        low = self._written.get(register.address + 1, 0)
        counts = words[0] << 16 | low if self.width == 32 else words[0] & (1 << self.width) - 1
        return counts * register.unit
