"""Faults on demand: what can go wrong in a simulated cell, and the port through which it is asked for.

A fault is one UDP datagram of JSON, `{"fault": NAME, ...}`, to the simulator that has it. It is answered with what
came of it, and the wall time at which it took effect: reaction times are measured from there. What is not understood
is answered with `{"error": SENTENCE}`, and changes nothing.
"""

from __future__ import annotations

import asyncio
import difflib
import json
import socket
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from robot.errors import CellUnreachable, RobotError

CONTROLLER_PORT = 30099
PUMP_PORT = 30098


class Fault(StrEnum):
    """What can be asked of a simulated cell."""

    # of the robot: safety

    PROTECTIVE_STOP = "protective stop"
    CLEAR_PROTECTIVE_STOP = "clear protective stop"
    SAFEGUARD_STOP = "safeguard stop"
    CLEAR_SAFEGUARD_STOP = "clear safeguard stop"
    EMERGENCY_STOP = "emergency stop"
    """The robot's own button."""
    RELEASE_EMERGENCY_STOP = "release emergency stop"
    SYSTEM_EMERGENCY_STOP = "system emergency stop"
    """Somebody else's button, wired to the controller's safety inputs."""
    RELEASE_SYSTEM_EMERGENCY_STOP = "release system emergency stop"

    # of the robot: what somebody does at the pendant, and what is wired to its inputs

    PROGRAM_STOP = "program stop"
    """Somebody presses stop on the pendant."""
    PROGRAM_PAUSE = "program pause"
    PROGRAM_PLAY = "program play"
    """Goes on with a program that was paused."""
    SPEED_SLIDER = "speed slider"
    """Takes `fraction`, 0 to 1."""
    DIGITAL_INPUT = "digital input"
    """Sets input `number`, numbered as RTDE's bits are: 0 to 7 standard, 8 to 15 configurable, 16 and 17 tool."""
    CLEAR_DIGITAL_INPUT = "clear digital input"

    # of the robot: its connections

    RTDE_MUTE = "rtde mute"
    """Values are no longer sent, though the connections stay."""
    RTDE_UNMUTE = "rtde unmute"
    RTDE_DROP = "rtde drop"
    """Every RTDE connection is closed; the port goes on listening."""
    RTDE_LATE = "rtde late"
    """Values leave `seconds` (wall time) after they were taken."""
    RTDE_ON_TIME = "rtde on time"
    RTDE_GARBAGE = "rtde garbage"
    """One package of wrong bytes to everybody who receives values."""
    RTDE_HALF = "rtde half package"
    """One package of values is cut in its middle; the next ones follow."""
    RTDE_HALF_DROP = "rtde half package, drop"
    """One package of values is cut in its middle, and the connection is closed."""
    DASHBOARD_REFUSE = "dashboard refuse"
    """Commands that would change something are answered as failed."""
    DASHBOARD_CLOSE = "dashboard close"
    """The dashboard's connections are closed, and new ones are refused."""
    DASHBOARD_OPEN = "dashboard open"
    """Ends both."""
    REBOOT = "reboot"
    """Every connection is cut, the ports are closed for `seconds` (wall time), and all state is as after a boot."""

    # of the pump

    PUMP_MUTE = "pump mute"
    """It hears what it is told, and neither answers nor obeys."""
    PUMP_UNMUTE = "pump unmute"
    PUMP_REPORT = "pump report"
    """No fault: answers with `flow` (mm³/s) and `volume` (mm³) at the nozzle and `time` (process time, s)."""
    PUMP_RESET = "pump reset"
    """Every connection is reset."""
    PUMP_EXCEPTION = "pump exception"
    """Every request is answered by the Modbus exception `code`."""
    PUMP_CLEAR_EXCEPTION = "pump clear exception"
    PUMP_FROZEN = "pump frozen"
    """Registers stand still: requests are answered, and nothing comes of them."""
    PUMP_UNFROZEN = "pump unfrozen"
    PUMP_TRIP = "pump trip"
    PUMP_RESET_TRIP = "pump reset trip"
    PUMP_HOPPER = "pump hopper"
    """The hopper holds `level`, mm³; 0 is empty."""
    PUMP_BLOCK = "pump block"
    """A `share` of the hose is blocked, 0 (free) to 1."""
    PUMP_REGISTER_WIDTH = "pump register width"
    """The registers have `bits`, 8, 16 or 32, whatever the register map says; 0: as it says."""
    PUMP_SLOW = "pump slow"
    """Answers come `seconds` (wall time) late, as through a slow serial gateway; 0: at once."""


@dataclass(frozen=True)
class Value:
    """A number that a fault takes.

    Attributes:
        name: as it is passed.
        least, most: bounds, both allowed.
        steps: the only numbers allowed; none: all within the bounds.
        lifted: the number that takes the fault back; None: none does.
    """

    name: str
    least: float
    most: float
    steps: tuple[int, ...] = ()
    lifted: float | None = None

    def checked(self, given: object) -> float:
        """The number, if it is allowed.

        Raises:
            ValueError: it is not; the sentence says what is.
        """
        if (
            isinstance(given, int | float)
            and not isinstance(given, bool)
            and self.least <= given <= self.most
            and (not self.steps or given in self.steps)
        ):
            return int(given) if self.steps else float(given)
        raise ValueError(f"takes `{self.name}`, {self.range}, not {repr(given)[:40]}")

    @property
    def range(self) -> str:
        """What is allowed, in words."""
        if self.steps and self.steps != tuple(range(self.steps[0], self.steps[-1] + 1)):
            return "one of " + ", ".join(map(str, self.steps))
        whole = "a whole number, " if self.steps else ""
        return f"{whole}{self.least:g} to {self.most:g}"


def _whole(name: str, *steps: int, lifted: float | None = None) -> Value:
    return Value(name, steps[0], steps[-1], steps, lifted)


LONGEST = 60.0  # s of wall time; a line holds what is late

VALUES = {
    Fault.SPEED_SLIDER: Value("fraction", 0.0, 1.0, lifted=1.0),
    Fault.DIGITAL_INPUT: _whole("number", *range(18)),
    Fault.CLEAR_DIGITAL_INPUT: _whole("number", *range(18)),
    Fault.RTDE_LATE: Value("seconds", 0.0, LONGEST),
    Fault.REBOOT: Value("seconds", 0.0, 3600.0),
    Fault.PUMP_EXCEPTION: _whole("code", *range(1, 256)),
    Fault.PUMP_HOPPER: Value("level", 0.0, 1e12),
    Fault.PUMP_BLOCK: Value("share", 0.0, 1.0, lifted=0.0),
    Fault.PUMP_REGISTER_WIDTH: _whole("bits", 0, 8, 16, 32, lifted=0),
    Fault.PUMP_SLOW: Value("seconds", 0.0, LONGEST, lifted=0.0),
}
"""What faults take; all others take nothing."""

LIFTED_BY = {
    Fault.PROTECTIVE_STOP: Fault.CLEAR_PROTECTIVE_STOP,
    Fault.SAFEGUARD_STOP: Fault.CLEAR_SAFEGUARD_STOP,
    Fault.EMERGENCY_STOP: Fault.RELEASE_EMERGENCY_STOP,
    Fault.SYSTEM_EMERGENCY_STOP: Fault.RELEASE_SYSTEM_EMERGENCY_STOP,
    Fault.PROGRAM_PAUSE: Fault.PROGRAM_PLAY,
    Fault.SPEED_SLIDER: Fault.SPEED_SLIDER,
    Fault.DIGITAL_INPUT: Fault.CLEAR_DIGITAL_INPUT,
    Fault.RTDE_MUTE: Fault.RTDE_UNMUTE,
    Fault.RTDE_LATE: Fault.RTDE_ON_TIME,
    Fault.DASHBOARD_REFUSE: Fault.DASHBOARD_OPEN,
    Fault.DASHBOARD_CLOSE: Fault.DASHBOARD_OPEN,
    Fault.PUMP_MUTE: Fault.PUMP_UNMUTE,
    Fault.PUMP_EXCEPTION: Fault.PUMP_CLEAR_EXCEPTION,
    Fault.PUMP_FROZEN: Fault.PUMP_UNFROZEN,
    Fault.PUMP_TRIP: Fault.PUMP_RESET_TRIP,
    Fault.PUMP_BLOCK: Fault.PUMP_BLOCK,
    Fault.PUMP_REGISTER_WIDTH: Fault.PUMP_REGISTER_WIDTH,
    Fault.PUMP_SLOW: Fault.PUMP_SLOW,
}
"""What takes a fault back; some are taken back by themselves with another value."""


def lifting(fault: Fault, values: dict[str, float]) -> tuple[Fault, dict[str, float]] | None:
    """What takes a fault back, and with which values; None if nothing does."""
    counterpart = LIFTED_BY.get(fault)
    if counterpart is None:
        return None
    taken = VALUES.get(counterpart)
    if taken is None:
        return counterpart, {}
    return counterpart, {taken.name: values[taken.name] if taken.lifted is None else taken.lifted}


def checked(fault: Fault, values: dict[str, Any]) -> dict[str, Any]:
    """The values of a fault, if they are what it takes.

    Raises:
        ValueError: one is missing or wrong.
    """
    taken = VALUES.get(fault)
    for name in values:
        if taken is None or name != taken.name:
            raise ValueError(f"takes {f'`{taken.name}`' if taken else 'no values'}, not `{name[:40]}`")
    if taken is None:
        return values
    if taken.name not in values:
        raise ValueError(f"takes `{taken.name}`, {taken.range}")
    return {taken.name: taken.checked(values[taken.name])}


def described(fault: Fault, values: Mapping[str, Any]) -> str:
    """A fault and what it takes, in a line."""
    taken = VALUES.get(fault)
    return fault.value if taken is None else f"{fault}, {taken.name} {values[taken.name]:g}"


def named(name: object) -> Fault:
    """The fault of a name.

    Raises:
        ValueError: there is none; the sentence has the nearest.
    """
    if isinstance(name, str) and name in {fault.value for fault in Fault}:
        return Fault(name)
    near = difflib.get_close_matches(str(name), list(Fault), n=1)
    raise ValueError("there is no such fault" + (f"; did you mean '{near[0]}'?" if near else ""))


def inject(host: str, fault: Fault | str, timeout: float = 1.0, **values: float) -> dict[str, Any]:
    """Ask a simulator for a fault.

    Args:
        host: address of the robot, or of the pump for its faults.
        fault: which, or its name.
        timeout: how long to wait for the answer, s of wall time.
        values: what the fault takes.

    Returns:
        The simulator's answer; `wall` is the monotonic wall time at which the fault took effect.

    Raises:
        CellUnreachable: there is no answer.
        RobotError: there is no such fault, or the simulator refuses.
    """
    try:
        fault = named(fault)
    except ValueError as error:
        raise RobotError(f"'{fault}': {error}") from None
    _, port = _taker(fault)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        asking.settimeout(timeout)
        try:
            asking.connect((host, port))
            asking.send(json.dumps({"fault": fault.value, **values}).encode())
            answer: dict[str, Any] = json.loads(asking.recv(65536))
        except OSError as error:
            raise CellUnreachable(
                f"{host}: port {port} does not answer '{fault}'; is a simulated cell running there?"
            ) from error
    if "error" in answer:
        raise RobotError(f"{host}: refused: {answer['error']}")
    return answer


def _taker(fault: Fault) -> tuple[str, int]:
    """Whose fault it is, and the port that takes it."""
    return ("pump", PUMP_PORT) if fault.value.startswith("pump") else ("robot", CONTROLLER_PORT)


Effect = Callable[[dict[str, Any]], dict[str, Any] | None]
"""What makes a fault happen: takes its values, and returns what the answer tells."""


class FaultPort(asyncio.DatagramProtocol):
    """The simulator's side.

    Args:
        faults: one function for each fault that the simulator has; may change.
        owner: the simulator, as it says on stderr what was asked of it.
    """

    def __init__(self, faults: Mapping[Fault, Effect], owner: str) -> None:
        self._faults = faults
        self._owner = owner

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:  # type: ignore[override]
        self._transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        try:
            answer = self._take(data)
        except (ValueError, RobotError) as error:
            answer = {"error": str(error)}
        self._transport.sendto(json.dumps(answer).encode(), addr)

    def _take(self, data: bytes) -> dict[str, Any]:
        try:
            asked = json.loads(data)
        except (ValueError, RecursionError):
            asked = None
        if not isinstance(asked, dict) or "fault" not in asked:
            raise ValueError('send one JSON object, {"fault": NAME} with the values that it takes')
        fault = named(asked.pop("fault"))
        scripted = asked.pop("scripted", False)  # then it was said already
        if fault not in self._faults:
            whose, port = _taker(fault)
            raise ValueError(f"'{fault}' is the {whose}'s: send it to port {port} at the {whose}'s address")
        try:
            values = checked(fault, asked)
        except ValueError as error:
            raise ValueError(f"'{fault}' {error}") from None
        answer = self._faults[fault](values) or {}
        if fault is not Fault.PUMP_REPORT and not scripted:
            print(f"{self._owner}: asked for: {described(fault, values)}", file=sys.stderr, flush=True)
        return {**answer, "wall": time.monotonic()}
