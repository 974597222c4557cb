"""The simulated controller's RTDE server: recipes, ownership of inputs, and a package to every listener each cycle."""

from __future__ import annotations

import asyncio
import socket
import struct
import sys
import time
from typing import TYPE_CHECKING, cast

from robot.errors import RobotError
from robot.rtde import IN_USE, INPUTS, NOT_FOUND, OUTPUTS, Package, PackageStream, Recipe, Value, package

from .outputs import readers

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot.simulation.machine import Machine

FREQUENCY = 500.0  # Hz of wall time
BACKLOG = 65536  # bytes; a listener that does not read misses packages, it does not fill memory


class RtdeServer:
    """All RTDE connections of the controller.

    Attributes:
        muted: send no values, as a controller that hangs.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.muted = False
        self.connections: set[Connection] = set()

    def publish(self) -> None:
        """Send the values of this cycle."""
        if not self.muted:
            for connection in list(self.connections):
                connection.publish(self.machine.cycles)

    def drop(self) -> None:
        """Cut every connection, as a pulled cable that the controller notices."""
        for connection in list(self.connections):
            connection.transport.abort()

    def owned_by_others(self, name: str, asking: Connection) -> bool:
        """Whether an input belongs to another connection."""
        return any(name in other.owned for other in self.connections if other is not asking)


class Connection(asyncio.Protocol):
    """One client."""

    def __init__(self, server: RtdeServer) -> None:
        self.server = server
        self.machine = server.machine
        self.owned: set[str] = set()
        self._stream = PackageStream()
        self._inputs: dict[int, Recipe] = {}
        self._outputs: list[Callable[[], Value]] = []
        self._recipe: Recipe | None = None
        self._every = 1
        self._started = False
        self._answers: dict[int, Callable[[bytes], None]] = {
            Package.PROTOCOL: self._protocol,
            Package.CONTROLLER_VERSION: self._version,
            Package.OUTPUTS: self._choose_outputs,
            Package.INPUTS: self._choose_inputs,
            Package.START: self._start,
            Package.PAUSE: self._pause,
            Package.VALUES: self._write,
        }

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.Transport", transport)
        connected = self.transport.get_extra_info("socket")
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
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

    def publish(self, cycle: int) -> None:
        """Send one package of values, if it is this client's turn."""
        if not self._started or self._recipe is None or cycle % self._every:
            return
        if self.transport.get_write_buffer_size() < BACKLOG:
            values = [read() for read in self._outputs]
            self.transport.write(package(Package.VALUES, b"\x01" + self._recipe.pack(values)))

    def _reply(self, kind: Package, payload: bytes) -> None:
        self.transport.write(package(kind, payload))

    def _protocol(self, payload: bytes) -> None:
        (asked,) = struct.unpack(">H", payload)
        self._reply(Package.PROTOCOL, bytes((asked == 2,)))

    def _version(self, payload: bytes) -> None:
        del payload
        self._reply(Package.CONTROLLER_VERSION, struct.pack(">4I", *self.machine.version))

    def _choose_outputs(self, payload: bytes) -> None:
        (frequency,) = struct.unpack_from(">d", payload)
        names = _names(payload[8:])
        types = [OUTPUTS.get(name, NOT_FOUND) for name in names]
        self._recipe = None
        if names and NOT_FOUND not in types:
            self._recipe = Recipe(names, types)
            self._outputs = readers(self.machine, self._recipe.names)
            self._every = max(1, round(FREQUENCY / frequency)) if frequency > 0.0 else 1
        self._reply(Package.OUTPUTS, bytes((self._recipe is not None,)) + ",".join(types).encode())

    def _choose_inputs(self, payload: bytes) -> None:
        names = _names(payload)
        types = [
            IN_USE if self.server.owned_by_others(name, self) else INPUTS.get(name, NOT_FOUND)
            for name in names
        ]
        number = 0
        if not {IN_USE, NOT_FOUND} & set(types):
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
            return
        # ur-rtde sends one of its recipes 4 bytes short; the controller takes what is there.
        written = payload[1 : 1 + recipe.size].ljust(recipe.size, b"\0")
        _take_inputs(self.machine, recipe.unpack(written))


def _names(payload: bytes) -> list[str]:
    return [name for name in payload.decode("ascii").split(",") if name]


def _take_inputs(machine: Machine, values: dict[str, Value]) -> None:
    """Write a client's values into the controller."""
    wall = time.monotonic()
    for name, value in values.items():
        kind, _, number = name.rpartition("_register_")
        if kind == "input_int":
            machine.write_input_int(int(number), cast("int", value), wall)
        elif kind == "input_double":
            machine.input_doubles[int(number)] = cast("float", value)
        elif kind == "input_bit":
            machine.input_bits[int(number)] = cast("bool", value)
        elif name.startswith("input_bit_registers"):
            low = 32 * name.endswith("_63")
            for i in range(32):
                machine.input_bits[low + i] = bool(cast("int", value) >> i & 1)
        elif name == "external_force_torque":
            machine.external_wrench = cast("tuple[float, ...]", value)
    for group, shift, width in (("standard", 0, 8), ("configurable", 8, 8), ("tool", 16, 2)):
        mask = cast("int", values.get(f"{group}_digital_output_mask", 0)) & ((1 << width) - 1)
        if mask:
            wanted = cast("int", values[f"{group}_digital_output"]) & mask
            machine.digital_outputs = machine.digital_outputs & ~(mask << shift) | wanted << shift
    mask = cast("int", values.get("standard_analog_output_mask", 0))
    for i in (0, 1):
        if mask >> i & 1:
            voltage = cast("int", values["standard_analog_output_type"]) >> i & 1
            share = cast("float", values[f"standard_analog_output_{i}"])
            machine.analog_output_types = machine.analog_output_types & ~(1 << i) | voltage << i
            machine.analog_outputs[i] = 10.0 * share if voltage else 0.004 + 0.016 * share
    if values.get("speed_slider_mask"):
        machine.slider = min(max(cast("float", values["speed_slider_fraction"]), 0.0), 1.0)
