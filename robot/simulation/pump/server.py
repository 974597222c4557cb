"""The drive's Modbus server: connections, one request at a time, and everything that can be wrong with its answers."""

from __future__ import annotations

import asyncio
import random
import socket
import struct
import time
from collections import deque
from typing import TYPE_CHECKING

from .frames import Framing, FramingError, Request, RtuFraming, TcpFraming
from .requests import Refusal, answer, refusal

if TYPE_CHECKING:
    from .drive import Drive

CONNECTIONS = 32
"""That it serves at once; more are closed."""

AT_ONCE = 16
"""Requests of one connection that are answered without a look at the others; while more wait, it is not read."""

UNSENT = 1 << 14
"""Bytes of answers that a client may leave lying before it is no longer read."""


class ModbusServer:
    """All connections of a drive.

    Args:
        drive: whose registers they reach.
        serial: RTU frames through a gateway, instead of Modbus TCP.
        reply_delay, jitter: wall time that a request takes, and that it may take more, s; evenly distributed.
        seed: of the jitter.

    Attributes:
        muted: hear everything, answer and do nothing.
        exception: code with which every request is refused, or None.
        slow: wall time that a request takes beside that, s.
    """

    def __init__(
        self, drive: Drive, *, serial: bool, reply_delay: float = 0.0, jitter: float = 0.0, seed: int = 0
    ) -> None:
        self.drive, self.serial = drive, serial
        self.muted = False
        self.exception: int | None = None
        self.slow = 0.0
        self.connections: set[_Connection] = set()
        self.bus = asyncio.Lock()
        self._reply_delay, self._jitter = reply_delay, jitter
        self._random = random.Random(seed)  # noqa: S311 - a jitter that can be repeated

    async def listen(self, host: str, port: int) -> asyncio.Server:
        """Begin to serve.

        Raises:
            OSError: the address cannot be had.
        """
        return await asyncio.get_running_loop().create_server(lambda: _Connection(self), host, port)

    def reset(self) -> None:
        """Reset every connection; the port goes on listening."""
        for connection in list(self.connections):
            connection.reset()

    @property
    def slowness(self) -> float:
        """Longest time that a request takes, s."""
        return self._reply_delay + self.slow + self._jitter

    def delay(self) -> float:
        """What the next request takes, s."""
        return self._reply_delay + self.slow + self._jitter * self._random.random()

    def framing(self) -> Framing:
        """Of a new connection."""
        return RtuFraming(self.drive.map.device_id) if self.serial else TcpFraming()

    def carry_out(self, request: Request) -> bytes | None:
        """The answer to a request, or None where there is none."""
        if self.muted:
            return None
        here = {self.drive.map.device_id, 0} | (set() if self.serial else {0xFF})
        if request.device not in here:
            return None if self.serial else refusal(request.pdu, Refusal.NO_SUCH_DEVICE)
        if self.exception is not None:
            return refusal(request.pdu, self.exception)
        pdu = answer(request.pdu, self.drive)
        return None if self.serial and request.device == 0 else pdu  # that was for everybody


class _Connection(asyncio.Protocol):
    """One client. A few requests that take no time are answered at once; all others wait for their turn."""

    def __init__(self, server: ModbusServer) -> None:
        self._server = server
        self._framing = server.framing()
        self._waiting: deque[Request] = deque()
        self._working: asyncio.Task[None] | None = None
        self._transport: asyncio.Transport | None = None
        self._heard = asyncio.Event()  # it reads its answers
        self._heard.set()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        if len(self._server.connections) >= CONNECTIONS:
            transport.abort()
            return
        self._transport = transport
        transport.set_write_buffer_limits(high=UNSENT)
        self._server.connections.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        del exc
        self._transport = None
        self._server.connections.discard(self)
        if self._working is not None:
            self._working.cancel()

    def pause_writing(self) -> None:
        self._heard.clear()
        self._read_or_wait()

    def resume_writing(self) -> None:
        self._heard.set()
        self._read_or_wait()

    def data_received(self, data: bytes) -> None:
        if self._transport is None:
            return
        try:
            requests = self._framing.take(data, time.monotonic())
        except FramingError:
            self._transport.abort()
            return
        self._waiting.extend(requests)
        if self._working is None:
            self._answer_some()
            if self._waiting:
                self._working = asyncio.create_task(self._work())
        self._read_or_wait()

    def reset(self) -> None:
        """End the connection as a crash does, without a farewell."""
        if self._transport is not None:
            raw = self._transport.get_extra_info("socket")
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            self._transport.abort()

    def _answer_some(self) -> None:
        """Answer what takes no time, up to a few."""
        for _ in range(AT_ONCE):
            if not self._waiting or not self._heard.is_set() or self._server.slowness > 0.0:
                return
            request = self._waiting.popleft()
            self._answer(request, self._server.carry_out(request))

    async def _work(self) -> None:
        """Answer all that waits; what takes time acts when half of it is over, and has the line for itself."""
        while self._waiting:
            await self._heard.wait()
            if self._server.slowness > 0.0:
                delay = self._server.delay()
                request = self._waiting.popleft()
                async with self._server.bus:
                    await asyncio.sleep(0.5 * delay)
                    pdu = self._server.carry_out(request)
                    await asyncio.sleep(0.5 * delay)
                self._answer(request, pdu)
            else:
                self._answer_some()
                await asyncio.sleep(0.0)
            self._read_or_wait()
        self._working = None

    def _answer(self, request: Request, pdu: bytes | None) -> None:
        transport = self._transport
        if (
            pdu is not None
            and transport is not None
            and not self._server.muted
            and not transport.is_closing()
        ):
            transport.write(self._framing.frame(request, pdu))

    def _read_or_wait(self) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self._heard.is_set() and len(self._waiting) < AT_ONCE:
            self._transport.resume_reading()
        else:
            self._transport.pause_reading()
