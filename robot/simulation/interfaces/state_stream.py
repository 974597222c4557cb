"""What the simulated controller tells on its primary and secondary ports: its version, its state, what programs say.

Every message is an int32 length, itself counted, a byte for its kind and a body; the state is made of parts of the
same form. Numbers are big-endian, lengths in m. What is not simulated stands at rest: temperatures of a warm robot,
voltages of a powered one.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from typing import TYPE_CHECKING

from robot.simulation.machine import RobotMode, RuntimeState, SafetyMode
from robot.simulation.motions.frame import metres

from .outputs import JOINT_POWER_OFF, JOINT_RUNNING

if TYPE_CHECKING:
    from robot.simulation.machine import Machine

PERIOD = 0.1
"""Wall time between two states, s."""

MOST_WAITING = 1 << 16
"""Bytes that may wait for a client that does not read; a state that would be more is left out."""

STATE, MESSAGE = 16, 20
VERSION, TEXT, EXCEPTION = 3, 0, 10
SOURCE = -2
DATE = b"01-01-2024, 00:00:00"
TEMPERATURE, VOLTAGE = 30.0, 48.0


def version_message(machine: Machine) -> bytes:
    """The first message to every client."""
    major, minor, bugfix, build = machine.version
    name = b"URControl"
    body = struct.pack(">b", len(name)) + name + struct.pack(">BBii", major, minor, bugfix, build) + DATE
    return _message(machine, VERSION, body)


def text_message(machine: Machine, text: str) -> bytes:
    """What a program says with `textmsg`."""
    return _message(machine, TEXT, text.encode("utf-8", "replace"))


def exception_message(machine: Machine, text: str, line: int, column: int) -> bytes:
    """What ended a program, and where in its text."""
    return _message(machine, EXCEPTION, struct.pack(">ii", line, column) + text.encode("utf-8", "replace"))


def state_message(machine: Machine) -> bytes:
    """The controller's state."""
    parts = _mode(machine) + _joints(machine) + _tool(machine) + _board(machine) + _place(machine)
    return _framed(STATE, parts + _force(machine) + _framed(8, struct.pack(">B??B", 0, False, False, 0)))


def _framed(kind: int, body: bytes) -> bytes:
    return struct.pack(">iB", 5 + len(body), kind) + body


def _message(machine: Machine, kind: int, body: bytes) -> bytes:
    return _framed(MESSAGE, struct.pack(">Qbb", _microseconds(machine), SOURCE, kind) + body)


def _microseconds(machine: Machine) -> int:
    return max(int(machine.time * 1e6), 0)


def _mode(machine: Machine) -> bytes:
    body = struct.pack(
        ">Q???????BBddd",
        _microseconds(machine),
        True,  # a robot is there,
        True,  # and may be used
        machine.mode is not RobotMode.POWER_OFF,
        machine.safety is SafetyMode.ROBOT_EMERGENCY_STOP,
        machine.safety is SafetyMode.PROTECTIVE_STOP,
        machine.runtime is RuntimeState.PLAYING,
        machine.runtime in (RuntimeState.PAUSING, RuntimeState.PAUSED),
        machine.mode,
        0,  # position control
        machine.slider,
        machine.throttle if machine.runtime is RuntimeState.PLAYING else 0.0,
        1.0,
    )
    return _framed(0, body + (b"\0" if machine.version[0] >= 5 else b""))


def _joints(machine: Machine) -> bytes:
    mode = JOINT_POWER_OFF if machine.mode is RobotMode.POWER_OFF else JOINT_RUNNING
    state = machine.state
    return _framed(
        1,
        b"".join(
            struct.pack(">dddffffB", q, q, speed, 0.0, VOLTAGE, TEMPERATURE, 0.0, mode)
            for q, speed in zip(state.joints, state.joint_speeds, strict=True)
        ),
    )


def _tool(machine: Machine) -> bytes:
    mode = JOINT_POWER_OFF if machine.mode is RobotMode.POWER_OFF else JOINT_RUNNING
    return _framed(2, struct.pack(">BBddfBffB", 0, 0, 0.0, 0.0, 24.0, 0, 0.0, TEMPERATURE, mode))


def _board(machine: Machine) -> bytes:
    one, two = machine.analog_outputs
    kinds = machine.analog_output_types
    return _framed(
        3,
        struct.pack(
            ">iiBBddBBddffffBBBIBB",
            *(0, machine.digital_outputs),
            *(0, 0, 0.0, 0.0),
            *(kinds & 1, kinds >> 1 & 1, one, two),
            *(TEMPERATURE, VOLTAGE, 0.5, 0.1),
            *(machine.safety, 0, 0),
            *(0, 0, 0),
        )
        + (b"\0" if machine.version[0] >= 5 else b""),
    )


def _place(machine: Machine) -> bytes:
    return _framed(4, struct.pack(">12d", *metres(machine.state.pose), *metres(machine.tool_offset)))


def _force(machine: Machine) -> bytes:
    return _framed(7, struct.pack(">7d", *machine.external_wrench, 0.0))


class StateStream:
    """Sends the state to the clients of a port, and what else is said meanwhile."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._writers: set[asyncio.StreamWriter] = set()

    async def feed(self, writer: asyncio.StreamWriter) -> None:
        """Tell one client until it leaves."""
        self._writers.add(writer)
        try:
            self._send(writer, version_message(self._machine))
            while not writer.is_closing():
                self._send(writer, state_message(self._machine))
                await asyncio.sleep(PERIOD)
        finally:
            self._writers.discard(writer)

    def say(self, made: Callable[[Machine], bytes]) -> None:
        """Send a message to all clients."""
        if self._writers:
            message = made(self._machine)
            for writer in list(self._writers):
                self._send(writer, message)

    @staticmethod
    def _send(writer: asyncio.StreamWriter, message: bytes) -> None:
        transport = writer.transport
        if not transport.is_closing() and transport.get_write_buffer_size() < MOST_WAITING:
            writer.write(message)
