"""Makes the faults of a script happen, in the controller or by its pump, and says so, a line each, on stderr."""

from __future__ import annotations

import asyncio
import json
import sys
from typing import TYPE_CHECKING, Any

from robot.errors import RobotError

from .faults import PUMP_PORT, Effect, Fault, described

if TYPE_CHECKING:
    from collections.abc import Mapping


class FaultSender(asyncio.DatagramProtocol):
    """To be connected to the pump's fault port.

    Args:
        effects: what the controller's own faults do.
    """

    def __init__(self, effects: Mapping[Fault, Effect]) -> None:
        self._effects = effects
        self._transport: asyncio.DatagramTransport | None = None

    async def connect(self, pump_host: str) -> None:
        """Find the pump; it need not be there yet."""
        loop = asyncio.get_running_loop()
        await loop.create_datagram_endpoint(lambda: self, remote_addr=(pump_host, PUMP_PORT))

    def send(self, time: float, fault: Fault, values: dict[str, Any]) -> None:
        """Make a fault happen that was due at a process time."""
        _say(f"fault at {time:.3f} s: {described(fault, values)}")
        if fault.value.startswith("pump"):
            if self._transport is not None:
                self._transport.sendto(
                    json.dumps({"fault": fault.value, "scripted": True, **values}).encode()
                )
            return
        try:
            self._effects[fault](values)
        except (ValueError, RobotError) as error:
            _say(f"'{fault}' refused: {error}")

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:  # type: ignore[override]
        self._transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        del addr
        answer = json.loads(data)
        if "error" in answer:
            _say(f"the pump refuses: {answer['error']}")

    def error_received(self, exc: Exception) -> None:
        _say(f"the pump does not answer: {exc}")


def _say(text: str) -> None:
    print(f"controller: {text}", file=sys.stderr, flush=True)
