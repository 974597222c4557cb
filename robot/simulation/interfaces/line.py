"""The lines between the simulated controller and its clients: its ports, and what goes wrong on the way."""

from __future__ import annotations

import asyncio
import random
import socket
import sys
from collections import deque
from collections.abc import Callable
from typing import Any, cast

from robot.rtde import Package
from robot.simulation.lifetime import told_of_taken_ports

Damage = Callable[["_Outgoing", bytes], None]
"""What happens to a package instead of its being sent."""

MOST_AT_ONCE = 2048
"""Bytes that are taken from a client before everybody else has had a turn."""

MOST_WAITING = 100
"""Clients whose call is not yet answered."""

PAUSE = 1.0
"""For which nobody is let in when there is no room, s."""

_GARBAGE_SEED = 20


class Port:
    """A TCP port, with its connections.

    Attributes:
        delay: how late everything leaves, s of wall time.
        lines: the connections.
    """

    def __init__(self, host: str, number: int, protocol: Callable[[], asyncio.Protocol]) -> None:
        self.host, self.number = host, number
        self.delay = 0.0
        self._protocol = protocol
        self._listening: socket.socket | None = None
        self._accepted: set[asyncio.Task[object]] = set()
        self.lines: set[_Line] = set()
        self._random = random.Random(_GARBAGE_SEED)  # noqa: S311 - garbage, the same in each run

    @property
    def is_open(self) -> bool:
        """Whether it listens."""
        return self._listening is not None

    def open(self) -> None:
        """Begin to listen.

        Raises:
            PortTakenError: somebody else does.
        """
        if self._listening is None:
            with told_of_taken_ports(self.host, self.number):
                self._listening = socket.create_server((self.host, self.number), backlog=MOST_WAITING)
            self._listening.setblocking(False)
            self._listen()

    def close(self) -> None:
        """No longer listen, and cut every connection."""
        if self._listening is not None:
            asyncio.get_running_loop().remove_reader(self._listening)
            self._listening.close()
            self._listening = None
        self.cut()

    def _listen(self) -> None:
        if self._listening is not None:
            asyncio.get_running_loop().add_reader(self._listening, self._accept)

    def _accept(self) -> None:
        # Not by an asyncio server: a connection that it has accepted but not made when it is closed is never ended.
        if self._listening is None:
            return
        loop = asyncio.get_running_loop()
        try:
            connection, _ = self._listening.accept()
        except (BlockingIOError, InterruptedError, ConnectionAbortedError):
            return
        except OSError as error:  # no more files: clients that leave make room
            print(
                f"controller: a client of port {self.number} must wait: {error}", file=sys.stderr, flush=True
            )
            loop.remove_reader(self._listening)
            loop.call_later(PAUSE, self._listen)
            return
        connection.setblocking(False)
        making = loop.connect_accepted_socket(lambda: _Line(self, self._protocol()), connection)
        task: asyncio.Task[object] = loop.create_task(making)
        self._accepted.add(task)
        task.add_done_callback(self._accepted.discard)

    def cut(self) -> None:
        """Cut every connection, as a pulled cable that both ends notice."""
        for line in list(self.lines):
            line.outgoing.abort()

    def late(self, seconds: float) -> None:
        """Let everything leave so much later from now on; what is held leaves at once if it is no longer late."""
        self.delay = seconds
        if seconds == 0.0:
            for line in self.lines:
                line.outgoing.flush()

    def damage(self, damage: Damage) -> None:
        """Let something happen to the next package of values on each connection."""
        for line in self.lines:
            line.outgoing.damage = damage

    def garbage(self, outgoing: _Outgoing, package: bytes) -> None:
        """Damage: as many bytes as the package had, none of which means anything."""
        outgoing.send(self._random.randbytes(len(package)))

    @staticmethod
    def half(outgoing: _Outgoing, package: bytes) -> None:
        """Damage: the first half of the package, and then whatever is sent next."""
        outgoing.send(package[: len(package) // 2])

    @staticmethod
    def half_and_end(outgoing: _Outgoing, package: bytes) -> None:
        """Damage: the first half of the package, and the end of the connection."""
        outgoing.send(package[: len(package) // 2])
        outgoing.flush()
        outgoing.close()


def stream(
    serve: Callable[[asyncio.StreamReader, asyncio.StreamWriter], Any], limit: int = 1 << 16
) -> Callable[[], asyncio.Protocol]:
    """The protocol of a server that is a coroutine.

    Args:
        serve: talks with one client.
        limit: bytes of the longest line.
    """

    def protocol() -> asyncio.Protocol:
        return asyncio.StreamReaderProtocol(asyncio.StreamReader(limit=limit), serve)

    return protocol


class _Line(asyncio.BufferedProtocol):
    """One connection: passes everything on to the server's own protocol, and gives it a transport that may fail.

    It takes a little at a time, so that a client that floods the controller does not hold up its cycle.
    """

    def __init__(self, port: Port, protocol: asyncio.Protocol) -> None:
        self._port, self._inner = port, protocol
        self._received = bytearray(MOST_AT_ONCE)
        self.eof_received = protocol.eof_received  # type: ignore[method-assign]
        self.pause_writing = protocol.pause_writing  # type: ignore[method-assign]
        self.resume_writing = protocol.resume_writing  # type: ignore[method-assign]

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.outgoing = _Outgoing(cast("asyncio.Transport", transport), self._port)
        if not self._port.is_open:  # it was closed between the client's call and this
            self.outgoing.abort()
            return
        self._port.lines.add(self)
        self._inner.connection_made(cast("asyncio.Transport", self.outgoing))

    def get_buffer(self, sizehint: int) -> bytearray:
        del sizehint
        return self._received

    def buffer_updated(self, nbytes: int) -> None:
        self._inner.data_received(bytes(self._received[:nbytes]))

    def connection_lost(self, exc: Exception | None) -> None:
        if self in self._port.lines:
            self._port.lines.discard(self)
            self._inner.connection_lost(exc)


class _Outgoing:
    """A transport that may delay or damage what it is given, and is otherwise the one that it wraps."""

    def __init__(self, transport: asyncio.Transport, port: Port) -> None:
        self._transport, self._port = transport, port
        self._held: deque[tuple[float, bytes]] = deque()
        self._releasing: asyncio.TimerHandle | None = None
        self.damage: Damage | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def write(self, data: bytes) -> None:
        damage = self.damage
        if damage is not None and data[2:3] == bytes((Package.VALUES,)):
            self.damage = None
            damage(self, data)
        else:
            self.send(data)

    def writelines(self, lines: list[bytes]) -> None:
        self.write(b"".join(lines))

    def send(self, data: bytes) -> None:
        """Send, or hold for as long as the port is late; nothing to a client that has gone."""
        delay = self._port.delay
        if self._transport.is_closing():
            return
        if delay == 0.0 and not self._held:
            self._transport.write(data)
            return
        loop = asyncio.get_running_loop()
        self._held.append((loop.time() + delay, bytes(data)))
        if self._releasing is None:
            self._releasing = loop.call_at(self._held[0][0], self._release)

    def flush(self) -> None:
        """Send everything that is held."""
        while self._held:
            data = self._held.popleft()[1]
            if not self._transport.is_closing():
                self._transport.write(data)

    def _release(self) -> None:
        loop = asyncio.get_running_loop()
        now = loop.time()
        while self._held and self._held[0][0] <= now:
            data = self._held.popleft()[1]
            if not self._transport.is_closing():
                self._transport.write(data)
        self._releasing = loop.call_at(self._held[0][0], self._release) if self._held else None
