"""The simulated controller's RTDE server: recipes, ownership of inputs, and a package to every listener each cycle."""

from __future__ import annotations

import asyncio
import math
import socket
import struct
import sys
import time
from functools import cache
from typing import TYPE_CHECKING, cast

from robot.errors import RobotError
from robot.rtde import IN_USE, NOT_FOUND, PROTOCOL, Package, PackageStream, Recipe, Value, package
from robot.simulation.versions import cycle_time

from .outputs import reader_of_all
from .variables import known_inputs, known_outputs

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot.simulation.machine import Machine

OLD_PROTOCOL = 1
"""Spoken to a client that asks for none; it has neither frequencies nor a number in its packages of values."""

OLD_FREQUENCY = 125.0
BACKLOG = 1 << 15  # bytes; a listener that does not read misses packages, it does not fill memory
MOST_RECIPES = 255
SLOWEST = 1 << 31  # cycles between two packages
LONGEST_TEXT = 255
LARGEST_VALUES = 0xFFFF - 4  # bytes, with a header and a recipe's number in one package
SOURCE = b"RTDE interface"
WARNING = 2


class RtdeServer:
    """All RTDE connections of the controller.

    Attributes:
        muted: send no values, as a controller that hangs.
        frequency: packages in a second of wall time that a listener gets at most, Hz.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.muted = False
        self.frequency = 1.0 / cycle_time(machine.version)
        self._cycle = 0
        self._began = time.monotonic()
        self.connections: set[Connection] = set()
        self.inputs = known_inputs(machine.version)
        self.outputs = known_outputs(machine.version)

    def publish(self) -> None:
        """Send the values of this cycle. Cycles that were dropped count: listeners keep their pace."""
        passed = round((time.monotonic() - self._began) * self.frequency)
        self._cycle = max(self._cycle + 1, passed)
        if not self.muted:
            for connection in list(self.connections):
                connection.publish(self._cycle)

    def owned_by_others(self, name: str, asking: Connection) -> bool:
        """Whether an input belongs to another connection."""
        return any(name in other.owned for other in self.connections if other is not asking)


class _Sent(Recipe):
    """What a client is sent, as numbers in a row: packages are the most that a controller has to do."""

    def package(self, number: bytes, values: tuple[float, ...]) -> bytes:
        """The package, of the recipe's number as it is sent and of the values."""
        return package(Package.VALUES, number + self._struct.pack(*values))


class Connection(asyncio.Protocol):
    """One client."""

    def __init__(self, server: RtdeServer) -> None:
        self.server = server
        self.machine = server.machine
        self.owned: set[str] = set()
        self._protocol = OLD_PROTOCOL
        self._stream = PackageStream()
        self._inputs: dict[int, Recipe] = {}
        self._values: Callable[[], tuple[float, ...]] = tuple
        self._recipe: _Sent | None = None
        self._every = 1
        self._turn = 0
        self._started = False
        self._answers: dict[int, Callable[[bytes], None]] = {
            Package.PROTOCOL: self._choose_protocol,
            Package.CONTROLLER_VERSION: self._version,
            Package.OUTPUTS: self._choose_outputs,
            Package.INPUTS: self._choose_inputs,
            Package.START: self._start,
            Package.PAUSE: self._pause,
            Package.VALUES: self._write,
            Package.MESSAGE: self._hear,
        }

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.Transport", transport)
        connected = self.transport.get_extra_info("socket")
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._waiting = self.transport.get_write_buffer_size
        self.server.connections.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        del exc
        self.server.connections.discard(self)

    def data_received(self, data: bytes) -> None:
        try:
            for kind, payload in self._stream.feed(data):
                answer = self._answers.get(kind)
                if answer is not None:
                    answer(payload)
        except (RobotError, struct.error, UnicodeDecodeError) as error:
            print(f"controller: RTDE client dropped: {error}", file=sys.stderr, flush=True)
            self.transport.abort()

    def pause_writing(self) -> None:
        """A client that asks and does not read the answers is not heard until it does."""
        self.transport.pause_reading()

    def resume_writing(self) -> None:
        """It has read."""
        self.transport.resume_reading()

    def publish(self, cycle: int) -> None:
        """Send one package of values, if it is this client's turn."""
        turn = cycle // self._every
        if not self._started or self._recipe is None or turn == self._turn:
            return
        self._turn = turn
        if self._waiting() < BACKLOG:
            number = b"" if self._protocol == OLD_PROTOCOL else b"\x01"
            self.transport.write(self._recipe.package(number, self._values()))

    def _warn(self, text: str) -> None:
        """A text message. Before the values start a client expects nothing but the answer that it waits for."""
        if not self._started or self._waiting() >= BACKLOG:
            return
        message = text.encode("ascii", "replace")[:LONGEST_TEXT]
        if self._protocol == OLD_PROTOCOL:
            payload = bytes((WARNING,)) + message
        else:
            payload = bytes((len(message),)) + message + bytes((len(SOURCE),)) + SOURCE + bytes((WARNING,))
        self._reply(Package.MESSAGE, payload)

    def _reply(self, kind: Package, payload: bytes) -> None:
        self.transport.write(package(kind, payload))

    def _choose_protocol(self, payload: bytes) -> None:
        (asked,) = struct.unpack(">H", payload)
        accepted = asked in (OLD_PROTOCOL, PROTOCOL)
        if accepted:
            self._protocol = asked
        self._reply(Package.PROTOCOL, bytes((accepted,)))

    def _version(self, payload: bytes) -> None:
        del payload
        self._reply(Package.CONTROLLER_VERSION, struct.pack(">4I", *self.machine.version))

    def _choose_outputs(self, payload: bytes) -> None:
        if self._protocol == OLD_PROTOCOL:
            frequency, listed = OLD_FREQUENCY, payload
        else:
            (frequency,), listed = struct.unpack_from(">d", payload), payload[8:]
        names = _names(listed)
        types = [self.server.outputs.get(name, NOT_FOUND) for name in names]
        self._recipe = None
        if names and NOT_FOUND not in types:
            self._recipe = _Sent(names, types)
            if self._recipe.size > LARGEST_VALUES:
                raise RobotError(f"RTDE: values of {self._recipe.size} bytes do not fit into a package")
            self._values = reader_of_all(self.machine, self._recipe.names)
            self._every = self._division(frequency)
        number = b"" if self._protocol == OLD_PROTOCOL else bytes((self._recipe is not None,))
        self._reply(Package.OUTPUTS, number + ",".join(types).encode())

    def _division(self, frequency: float) -> int:
        """Every how many cycles a package is due, for a frequency in Hz; 0 and nonsense ask for all."""
        if not frequency > 0.0:
            return 1
        return max(1, round(min(self.server.frequency / frequency, SLOWEST)))

    def _choose_inputs(self, payload: bytes) -> None:
        names = _names(payload)
        types = [
            IN_USE if self.server.owned_by_others(name, self) else self.server.inputs.get(name, NOT_FOUND)
            for name in names
        ]
        number = 0
        if names and not {IN_USE, NOT_FOUND} & set(types) and len(self._inputs) < MOST_RECIPES:
            number = len(self._inputs) + 1
            self._inputs[number] = Recipe(names, types)
            self.owned.update(names)
        self._reply(Package.INPUTS, bytes((number,)) + ",".join(types).encode())

    def _start(self, payload: bytes) -> None:
        del payload
        self._started = self._recipe is not None
        self._reply(Package.START, bytes((self._started,)))

    def _pause(self, payload: bytes) -> None:
        del payload
        self._started = False
        self._reply(Package.PAUSE, b"\x01")

    def _write(self, payload: bytes) -> None:
        recipe = self._inputs.get(payload[0]) if payload else None
        if recipe is None:
            self._warn(f"no input recipe {payload[0] if payload else ''}")
            return
        # ur-rtde sends one of its recipes 4 bytes short; the controller takes what is there.
        written = payload[1 : 1 + recipe.size].ljust(recipe.size, b"\0")
        _take_inputs(self.machine, recipe.unpack(written))

    def _hear(self, payload: bytes) -> None:
        """A client's text message, for the log."""
        text = (
            payload[1:] if self._protocol == OLD_PROTOCOL else payload[1 : 1 + payload[0]] if payload else b""
        )
        print(
            f"controller: RTDE client says: {text.decode('ascii', 'replace')!r}", file=sys.stderr, flush=True
        )


def _names(payload: bytes) -> list[str]:
    return [name for name in payload.decode("ascii").split(",") if name]


def _take_inputs(machine: Machine, values: dict[str, Value]) -> None:
    """Write a client's values into the controller. What is no number moves neither slider nor output."""
    wall = time.monotonic()
    other = False
    for name, value in values.items():
        kind, number = _register(name)
        if kind == "input_double":
            machine.input_doubles[number] = cast("float", value)
        elif kind == "input_int":
            machine.write_input_int(number, cast("int", value), wall)
        elif kind == "input_bit":
            machine.input_bits[number] = cast("bool", value)
        else:
            other = True
    if other:
        _take_others(machine, values)


@cache
def _register(name: str) -> tuple[str, int]:
    """The kind and number of a register; nothing for what is none."""
    kind, _, number = name.rpartition("_register_")
    return (kind, int(number)) if kind else ("", 0)


def _take_others(machine: Machine, values: dict[str, Value]) -> None:
    for name, value in values.items():
        if name.startswith("input_bit_registers"):
            low = 32 * name.endswith("_63")
            for i in range(32):
                machine.input_bits[low + i] = bool(cast("int", value) >> i & 1)
        elif name == "external_force_torque":
            wrench = cast("tuple[float, ...]", value)
            if all(map(math.isfinite, wrench)):
                machine.external_wrench = wrench
    for group, shift, width in (("standard", 0, 8), ("configurable", 8, 8), ("tool", 16, 2)):
        mask = cast("int", values.get(f"{group}_digital_output_mask", 0)) & ((1 << width) - 1)
        if mask:
            wanted = cast("int", values.get(f"{group}_digital_output", 0)) & mask
            machine.digital_outputs = machine.digital_outputs & ~(mask << shift) | wanted << shift
    mask = cast("int", values.get("standard_analog_output_mask", 0))
    for i in (0, 1):
        share = _share(values.get(f"standard_analog_output_{i}"))
        if mask >> i & 1 and share is not None:
            kinds = cast("int", values.get("standard_analog_output_type", machine.analog_output_types))
            voltage = kinds >> i & 1
            machine.analog_output_types = machine.analog_output_types & ~(1 << i) | voltage << i
            machine.analog_outputs[i] = share
    fraction = _share(values.get("speed_slider_fraction"))
    if values.get("speed_slider_mask") and fraction is not None:
        machine.slider = fraction


def _share(value: Value | None) -> float | None:
    """A number within 0 to 1; None if it is none."""
    if not isinstance(value, float) or math.isnan(value):
        return None
    return min(max(value, 0.0), 1.0)
