"""Faults on demand: what can go wrong in a simulated cell, and the port through which it is asked for.

A fault is one UDP datagram of JSON, `{"fault": NAME, ...}`, to the simulator that has it. It is answered with what
came of it, and the wall time at which it took effect: reaction times are measured from there.
"""

from __future__ import annotations

import asyncio
import json
import socket
import time
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from robot.errors import CellUnreachable, RobotError

if TYPE_CHECKING:
    from collections.abc import Callable

CONTROLLER_PORT = 30099
PUMP_PORT = 30098


class Fault(StrEnum):
    """What can be asked of a simulated cell."""

    PROTECTIVE_STOP = "protective stop"
    CLEAR_PROTECTIVE_STOP = "clear protective stop"
    SAFEGUARD_STOP = "safeguard stop"
    CLEAR_SAFEGUARD_STOP = "clear safeguard stop"
    EMERGENCY_STOP = "emergency stop"
    RELEASE_EMERGENCY_STOP = "release emergency stop"
    PROGRAM_STOP = "program stop"
    """Somebody presses stop on the pendant."""
    SPEED_SLIDER = "speed slider"
    """Takes `fraction`, 0 to 1."""
    RTDE_MUTE = "rtde mute"
    RTDE_UNMUTE = "rtde unmute"
    RTDE_DROP = "rtde drop"
    PUMP_MUTE = "pump mute"
    PUMP_UNMUTE = "pump unmute"
    PUMP_REPORT = "pump report"
    """No fault: answers with `flow` (mm³/s) and `volume` (mm³) at the nozzle and `time` (process time, s)."""


def inject(host: str, fault: Fault, timeout: float = 1.0, **values: float) -> dict[str, Any]:
    """Ask a simulator for a fault.

    Args:
        host: address of the robot, or of the pump for its faults.
        fault: which.
        timeout: how long to wait for the answer, s of wall time.
        values: what the fault takes.

    Returns:
        The simulator's answer; `wall` is the monotonic wall time at which the fault took effect.

    Raises:
        CellUnreachable: there is no answer.
        RobotError: the simulator refuses.
    """
    fault = Fault(fault)
    port = PUMP_PORT if fault.value.startswith("pump") else CONTROLLER_PORT
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
        raise RobotError(f"{host}: '{fault}' refused: {answer['error']}")
    return answer


class FaultPort(asyncio.DatagramProtocol):
    """The simulator's side: calls one function for each fault."""

    def __init__(self, faults: dict[Fault, Callable[[dict[str, Any]], dict[str, Any] | None]]) -> None:
        self._faults = faults

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:  # type: ignore[override]
        self._transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        try:
            asked = json.loads(data)
            answer = self._faults[Fault(asked.pop("fault"))](asked) or {}
            answer["wall"] = time.monotonic()
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        self._transport.sendto(json.dumps(answer).encode(), addr)
