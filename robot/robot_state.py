"""What the robot reports: a small read-only RTDE client of the supervisor's own, independent of ur-rtde.

It shares no connection and no process with what drives the arm, so it still sees the robot when that one hangs.
"""

from __future__ import annotations

import asyncio
import math
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from . import rtde
from .errors import CellUnreachable, RobotError

Array = npt.NDArray[np.float64]

FREQUENCY = 500.0
"""Packages asked for per second; the controller sends at most its own rate."""

CONNECT_LIMIT = 3.0
"""Time for the controller to answer, s."""

PACE_WINDOW = 0.5
"""Wall time over which the pace of the controller's clock is measured, s."""

PLAYING = 2
"""`runtime_state` of a running program."""

_NAMES = (
    "timestamp",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "actual_q",
    "runtime_state",
    "robot_status_bits",
    "safety_status_bits",
    "speed_scaling",
    "target_speed_fraction",
)
_MM = 1e3


@dataclass(frozen=True, eq=False)
class RobotState:
    """One RTDE package.

    Attributes:
        time: process time: the controller's clock, s.
        position: TCP in the robot's base frame, shape (3,), mm.
        speed: of the TCP, mm/s.
        joints: shape (6,), rad.
        playing: whether a program runs.
        powered: whether the robot has power.
        safety: the controller's safety status bits.
        rate: speed scaling times its target fraction: the rate at which a program is executed.
    """

    time: float
    position: Array
    speed: float
    joints: Array
    playing: bool
    powered: bool
    safety: int
    rate: float


class RobotListener(asyncio.Protocol):
    """Receives robot states.

    Args:
        seen: called with every state; none is skipped, since a status bit may only blink.
        lost: called once when the connection has ended or talks nonsense, with a sentence.

    Attributes:
        heard: monotonic wall time of the last package, s.
        pace: seconds of the controller's clock per second of wall time; 1 on a real controller.
    """

    def __init__(self, seen: Callable[[RobotState], None], lost: Callable[[str], None]) -> None:
        self.heard = -math.inf
        self.pace = 1.0
        self._seen, self._lost = seen, lost
        self._stream = rtde.PackageStream()
        self._transport: asyncio.Transport | None = None
        self._recipe: rtde.Recipe | None = None
        self._first: asyncio.Future[RobotState] = asyncio.get_running_loop().create_future()
        self._mark = (0.0, 0.0)

    async def connect(self, host: str) -> RobotState:
        """Connect and wait for the first state.

        Raises:
            CellUnreachable: no connection, no answer, or an answer that is not RTDE's.
        """
        where = f"the robot at {host}:{rtde.PORT}"
        try:
            async with asyncio.timeout(CONNECT_LIMIT):
                await asyncio.get_running_loop().create_connection(lambda: self, host, rtde.PORT)
                return await self._first
        except TimeoutError:
            raise CellUnreachable(
                f"{where} does not answer within {CONNECT_LIMIT:g} s; check address, cable and power"
            ) from None
        except OSError as error:
            raise CellUnreachable(
                f"{where} cannot be reached ({error.strerror or error}); check address, cable and power"
            ) from None
        except RobotError as error:
            raise CellUnreachable(f"{where} does not speak RTDE 2 ({error}); check the address") from None

    def close(self) -> None:
        """End the connection quietly."""
        self._lost = lambda _: None
        if self._transport is not None:
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        transport.write(rtde.ask_protocol())

    def connection_lost(self, error: Exception | None) -> None:
        self._end(
            f"the controller closed its connection ({error})"
            if error
            else "the controller closed its connection"
        )

    def data_received(self, data: bytes) -> None:
        try:
            for kind, payload in self._stream.feed(data):
                self._take(kind, payload)
        except (RobotError, IndexError, UnicodeDecodeError) as error:
            self._end(f"the controller sent something that is not RTDE ({error})")
            if self._transport is not None:
                self._transport.abort()

    def _take(self, kind: int, payload: bytes) -> None:
        assert self._transport is not None
        if kind == rtde.Package.VALUES and self._recipe is not None:
            self._receive(self._recipe.unpack(payload[1:]))
        elif kind == rtde.Package.PROTOCOL:
            if payload != b"\1":
                raise RobotError("it refuses version 2")
            self._transport.write(rtde.ask_outputs(_NAMES, FREQUENCY))
        elif kind == rtde.Package.OUTPUTS:
            self._recipe = rtde.Recipe(_NAMES, rtde.read_types(payload)[1])
            self._transport.write(rtde.ask_start())
        elif kind == rtde.Package.START and payload != b"\1":
            raise RobotError("it refuses to start")

    def _receive(self, values: dict[str, rtde.Value]) -> None:
        state = RobotState(
            time=_number(values["timestamp"]),
            position=_vector(values["actual_TCP_pose"])[:3] * _MM,
            speed=float(np.linalg.norm(_vector(values["actual_TCP_speed"])[:3])) * _MM,
            joints=_vector(values["actual_q"]),
            playing=values["runtime_state"] == PLAYING,
            powered=bool(int(_number(values["robot_status_bits"])) & 1),
            safety=int(_number(values["safety_status_bits"])),
            rate=_number(values["speed_scaling"]) * _number(values["target_speed_fraction"]),
        )
        self.heard = time.monotonic()
        self._measure_pace(state.time)
        if not self._first.done():
            self._first.set_result(state)
        self._seen(state)

    def _measure_pace(self, now: float) -> None:
        wall, process = self._mark
        if not wall:
            self._mark = (self.heard, now)
        elif self.heard - wall > PACE_WINDOW:
            self.pace = max((now - process) / (self.heard - wall), 0.0)
            self._mark = (self.heard, now)

    def _end(self, why: str) -> None:
        lost, self._lost = self._lost, lambda _: None
        if not self._first.done():
            self._first.set_exception(RobotError(why))
        else:
            lost(why)


def _number(value: rtde.Value) -> float:
    if isinstance(value, tuple):
        raise RobotError("a vector where a number was agreed")
    return float(value)


def _vector(value: rtde.Value) -> Array:
    if not isinstance(value, tuple):
        raise RobotError("a number where a vector was agreed")
    return np.array(value, dtype=np.float64)
