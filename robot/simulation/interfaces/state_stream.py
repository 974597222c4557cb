"""What the simulated controller tells on its primary, secondary and real-time ports, ten times a second or each cycle.

The primary port tells the state and what happens: what programs say, that they begin and end and what ended them, and
how the safety system changes its mode. The secondary port tells the state alone. Both begin with the version.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from .realtime_stream import RealtimeStream
from .state_message import StateMessage, framed, microseconds

if TYPE_CHECKING:
    from robot.simulation.machine import Machine

    from .script_client import Outlet

PRIMARY, SECONDARY, REALTIME = 30001, 30002, 30003
READ_ONLY = {30011: PRIMARY, 30012: SECONDARY, 30013: REALTIME}
"""Ports that tell what others tell, and take no programs."""

PERIOD = 0.1
"""Wall time between two states, s."""

MESSAGE = 20
TEXT, VERSION, SAFETY, KEY, EXCEPTION = 0, 3, 5, 7, 10
CONTROLLER, PROGRAM_INTERPRETER = -2, -3
DATE = b"01-01-2024, 00:00:00"
WITHOUT_DATA = 0


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


def safety_message(machine: Machine) -> bytes:
    """The mode that the safety system is in from now on."""
    return _message(machine, SAFETY, struct.pack(">iiBII", 0, 0, machine.safety, WITHOUT_DATA, 0))


def key_message(machine: Machine, title: str, text: str) -> bytes:
    """That a program has begun, `PROGRAM_XXX_STARTED`, or has ended, `PROGRAM_XXX_STOPPED`; the text is its name."""
    head = title.encode("ascii")
    body = struct.pack(">iiB", 0, 0, len(head)) + head + text.encode("utf-8", "replace")
    return _message(machine, KEY, body, PROGRAM_INTERPRETER)


def _message(machine: Machine, kind: int, body: bytes, source: int = CONTROLLER) -> bytes:
    return framed(MESSAGE, struct.pack(">Qbb", microseconds(machine), source, kind) + body)


class Streams:
    """Everybody who listens to the controller's ports.

    Attributes:
        realtime: the clients of the real-time port.
    """

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._state = StateMessage(machine)
        self._listeners: dict[int, list[Outlet]] = {PRIMARY: [], SECONDARY: []}
        self.realtime = RealtimeStream(machine)
        self._due = 0.0
        self._safety = machine.safety
        machine.on_program = self._tell_program

    def listen(self, port: int, outlet: Outlet) -> None:
        """Tell a client what its port tells, until it leaves."""
        port = READ_ONLY.get(port, port)
        if port == REALTIME:
            self.realtime.add(outlet)
        else:
            outlet.send(version_message(self._machine))
            outlet.send(self._state.packed())
            self._listeners[port].append(outlet)

    def say(self, made: Callable[[Machine], bytes]) -> None:
        """Send a message to all clients of the primary port."""
        if self._listeners[PRIMARY]:
            message = made(self._machine)
            for outlet in self._listeners[PRIMARY]:
                outlet.send(message)

    def publish(self) -> None:
        """Tell what this cycle has brought."""
        machine = self._machine
        if machine.safety is not self._safety:
            self._safety = machine.safety
            self.say(safety_message)
        self.realtime.publish()
        now = time.monotonic()
        if now >= self._due:
            self._due = now + PERIOD
            self._tell_state()

    def _tell_state(self) -> None:
        for port, listeners in self._listeners.items():
            self._listeners[port] = [outlet for outlet in listeners if not outlet.closed]
        everybody = [outlet for listeners in self._listeners.values() for outlet in listeners]
        if everybody:
            message = self._state.packed()
            for outlet in everybody:
                outlet.send(message)

    def _tell_program(self, name: str, began: bool) -> None:
        title = "PROGRAM_XXX_STARTED" if began else "PROGRAM_XXX_STOPPED"
        self.say(lambda machine: key_message(machine, title, name))
