"""One client of a script port: what it says is programs, and what it is told never holds anybody up.

Many a client sends its program and leaves without a look at what the port tells. Telling it then fails, and that must
not cost the program: so what goes out goes its own way, beside the connection's transport.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from collections import deque
from typing import TYPE_CHECKING, cast

from .program_text import Collected

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

MOST_WAITING = 1 << 16
"""Bytes that may wait for a client that does not read; a message beyond them is left out."""

MOST_PROGRAMS = 64
"""Programs that may wait to be started; the client is not read until they are fewer."""


class Outlet:
    """Sends without waiting."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = socket.socket(fileno=os.dup(connected.fileno()))
        self._socket.setblocking(False)
        self._rest = b""
        self.closed = False

    def narrow(self, size: int) -> None:
        """Let the system keep no more than so many bytes for a client that does not read, as near as it can."""
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, size)

    @property
    def free(self) -> bool:
        """Whether all that was sent has gone, as far as the client takes it now."""
        if self._rest:
            self.send(b"")
        return not self.closed and not self._rest

    def send(self, message: bytes) -> None:
        """Send a message as far as the client takes it; the rest goes before the next one."""
        if self.closed or len(self._rest) > MOST_WAITING:
            return
        waiting = self._rest + message if self._rest else message
        try:
            sent = self._socket.send(waiting)
        except BlockingIOError:
            sent = 0
        except OSError:
            self.close()
            return
        self._rest = waiting[sent:]

    def close(self) -> None:
        """Send no more."""
        self.closed = True
        self._socket.close()


class Listener(asyncio.Protocol):
    """A client that is only told; what it says is thrown away.

    Args:
        connected: is told of what sends to the client, once it is there.
    """

    def __init__(self, connected: Callable[[Outlet], None]) -> None:
        self._connected = connected

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._outlet = Outlet(transport.get_extra_info("socket"))
        self._connected(self._outlet)

    def connection_lost(self, exc: Exception | None) -> None:
        del exc
        self._outlet.close()


class ScriptClient(asyncio.Protocol):
    """The connection.

    Args:
        start: starts a program; asked for one at a time.
        connected: is told of what sends to the client, once it is there.
        complain: is told why a client is dropped.
    """

    def __init__(
        self,
        start: Callable[[str], Awaitable[object]],
        connected: Callable[[Outlet], None],
        complain: Callable[[str], None],
    ) -> None:
        self._start, self._connected, self._complain = start, connected, complain
        self._collected = Collected()
        self._waiting: deque[str] = deque()
        self._working: asyncio.Task[None] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.Transport", transport)
        self._outlet = Outlet(transport.get_extra_info("socket"))
        self._connected(self._outlet)

    def data_received(self, data: bytes) -> None:
        try:
            programs = self._collected.add(data)
        except ValueError as error:
            self._complain(f"script client dropped: {error}")
            self._transport.abort()
            return
        self._take(programs)

    def connection_lost(self, exc: Exception | None) -> None:
        del exc
        self._outlet.close()
        if rest := self._collected.rest():
            self._take([rest])

    def _take(self, programs: list[str]) -> None:
        self._waiting += programs
        if self._waiting and self._working is None:
            self._working = asyncio.get_running_loop().create_task(self._work())
        if len(self._waiting) > MOST_PROGRAMS:
            self._transport.pause_reading()

    async def _work(self) -> None:
        while self._waiting:
            await self._start(self._waiting.popleft())
            if len(self._waiting) == MOST_PROGRAMS:
                with contextlib.suppress(RuntimeError):  # it is gone
                    self._transport.resume_reading()
        self._working = None
