"""The sockets of a program: it connects to servers, and talks with them while the controller's cycles go on.

A function that waits asks again in each cycle; its time runs as the controller's process time. Only servers on this
machine are reached, by a loopback address or as `localhost`: nothing leaves it and no name is looked up.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any, TypeVar

from robot.simulation.client_socket import LONGEST, ClientSocket, loopback
from robot.simulation.urscript import Refusal, builtin
from robot.simulation.urscript.strings import raw, text
from robot.simulation.urscript.values import LONGEST_STRING, Value, integer, number, truth, written

from .moves import HALF_A_CYCLE

if TYPE_CHECKING:
    from robot.simulation.machine import Machine
    from robot.simulation.urscript import Builtin

Found = TypeVar("Found")
Waiting = Generator[None, None, Found]
"""What lets a cycle pass with each `yield`, and then has a value."""

PATIENCE = 2.0
"""Process time for a connection, an answer or what is sent to leave, s, if a program gives no other."""

MOST = 32
"""Sockets that a program may have open."""

MOST_NUMBERS = 30
"""Numbers that are read at once."""

MOST_READS = 10
"""Messages that a program reads in a cycle; a server that sends more has to wait."""


class Sockets:
    """The sockets of one program, by name.

    Args:
        machine: whose time is waited for.
        say: is told why an address is not reached.
    """

    def __init__(self, machine: Machine, say: Callable[[str], None]) -> None:
        self._machine = machine
        self._say = say
        self._open: dict[str, ClientSocket] = {}
        self._reads, self._cycle = 0, 0

    def close_all(self) -> None:
        """Close every socket: the program has ended."""
        for one in self._open.values():
            one.close()
        self._open.clear()

    def open(self, address: Value, port: Value, name: Value) -> Waiting[bool]:
        """Connect a socket; one of the same name is closed first. False if that fails."""
        host, number_of_port, key = (
            raw(address, "address").decode("utf-8", "replace"),
            integer(port, "port"),
            _name(name),
        )
        if not 0 < number_of_port < 1 << 16:
            raise Refusal(f"a port is 1 to 65535, not {number_of_port}")
        self.close(key)
        target = loopback(host)
        if target is None or len(self._open) >= MOST:
            reason = f"there are {MOST} already" if target else f"{host} is not on this machine"
            self._say(f"no socket {key}: {reason}")
            yield
            return False
        made = self._open[key] = ClientSocket(target, number_of_port)
        until = self._machine.time + PATIENCE
        while (connected := made.connect()) is None and self._machine.time < until:
            yield
        if not connected:
            yield  # so that a program which tries again and again takes time
            if self._open.get(key) is made:
                self.close(key)
        return bool(connected)

    def close(self, name: Value) -> None:
        """Close a socket, if it is open."""
        one = self._open.pop(_name(name), None)
        if one is not None:
            one.close()

    def send(self, data: bytes, name: Value) -> Waiting[bool]:
        """Send all of something; False if that fails."""
        one = self._open.get(_name(name))
        if one is None:
            yield
            return False
        until = self._machine.time + PATIENCE
        try:
            while data := data[one.send(data) :]:
                if self._machine.time >= until:
                    return False
                yield
        except OSError:
            yield
            return False
        return True

    def read(
        self, found: Callable[[bytearray], Found | None], name: Value, timeout: Value
    ) -> Waiting[Found | None]:
        """Wait until something is found in what has come, which takes it out; None if it does not come in time."""
        one, seconds = self._open.get(_name(name)), number(timeout, "timeout")
        if one is None:
            yield
            return None
        until = self._machine.time + seconds if seconds > 0.0 else math.inf
        waited = False
        if self._cycle != self._machine.cycles:
            self._reads, self._cycle = 0, self._machine.cycles
        self._reads += 1
        if self._reads > MOST_READS:
            yield
        while True:
            one.receive()
            value = found(one.received)
            if value is not None:
                return value
            if waited and (one.ended or self._machine.time >= until - HALF_A_CYCLE):
                return None
            yield
            waited = True


def socket_functions(sockets: Sockets) -> Iterator[Builtin]:
    """The functions of one program's sockets."""
    named = {"socket_name": "socket_0"}
    timed = {**named, "timeout": PATIENCE}
    yield builtin("socket_open(address, port, socket_name)", sockets.open, named)
    yield builtin("socket_close(socket_name)", sockets.close, named)
    yield from _sending(sockets, named)

    def numbers_from(
        count: Value,
        name: Value,
        timeout: Value,
        width: int,
        unpacked: Callable[[bytes, int], tuple[int, ...]],
    ) -> Waiting[list[int]]:
        many = _count(count)

        def found(received: bytearray) -> list[int] | None:
            if len(received) < width * many:
                return None
            return [many, *unpacked(_taken(received, width * many), many)]

        value = yield from sockets.read(found, name, timeout)
        return value if value is not None else [0] + [-1] * many

    def integers(count: Value, name: Value, timeout: Value) -> Waiting[list[int]]:
        return (
            yield from numbers_from(count, name, timeout, 4, lambda data, n: struct.unpack(f">{n}i", data))
        )

    def octets(count: Value, name: Value, timeout: Value) -> Waiting[list[int]]:
        return (yield from numbers_from(count, name, timeout, 1, lambda data, _: tuple(data)))

    def floats(count: Value, name: Value, timeout: Value) -> Waiting[list[Any]]:
        many = _count(count)
        value = yield from sockets.read(_in_brackets, name, timeout)
        if not value:
            return [0] + [math.nan] * many
        kept = value[:many]
        return [len(kept), *kept, *[math.nan] * (many - len(kept))]

    def line(name: Value, timeout: Value) -> Waiting[str]:
        value = yield from sockets.read(_line, name, timeout)
        return text(value[:LONGEST_STRING]) if value is not None else ""

    def string(name: Value, prefix: Value, suffix: Value, escape: Value, timeout: Value) -> Waiting[str]:
        before, after = (
            raw(part, what).lstrip(b" ") for part, what in ((prefix, "prefix"), (suffix, "suffix"))
        )
        if truth(escape):
            before, after = _escaped(before), _escaped(after)
        value = yield from sockets.read(lambda received: _between(received, before, after), name, timeout)
        return text(value[:LONGEST_STRING]) if value is not None else ""

    yield builtin("socket_read_binary_integer(number, socket_name, timeout)", integers, timed)
    yield builtin("socket_read_byte_list(number, socket_name, timeout)", octets, timed)
    yield builtin("socket_read_ascii_float(number, socket_name, timeout)", floats, timed)
    yield builtin("socket_read_line(socket_name, timeout)", line, timed)
    yield builtin(
        "socket_read_string(socket_name, prefix, suffix, interpret_escape, timeout)",
        string,
        {**timed, "prefix": "", "suffix": "", "interpret_escape": False},
    )


def _sending(sockets: Sockets, named: dict[str, Any]) -> Iterator[Builtin]:
    def string(value: Value, name: Value) -> Waiting[bool]:
        return (yield from sockets.send(_bytes(value), name))

    def line(value: Value, name: Value) -> Waiting[bool]:
        return (yield from sockets.send(_bytes(value) + b"\n", name))

    def byte(value: Value, name: Value) -> Waiting[bool]:
        found = integer(value, "value")
        if not 0 <= found < 1 << 8:
            raise Refusal(f"a byte is 0 to 255, not {found}")
        return (yield from sockets.send(bytes((found,)), name))

    def whole(value: Value, name: Value) -> Waiting[bool]:
        return (yield from sockets.send(struct.pack(">i", integer(value, "value")), name))

    def set_variable(variable: Value, value: Value, name: Value) -> Waiting[None]:
        asked = b"SET %s %d\n" % (raw(variable, "name"), integer(value, "value"))
        yield from sockets.send(asked, name)

    def get_variable(variable: Value, name: Value) -> Waiting[int]:
        key = raw(variable, "name")
        if not (yield from sockets.send(b"GET %s\n" % key, name)):
            return 0
        answer = yield from sockets.read(_line, name, PATIENCE)
        first, _, last = (answer or b"").strip().rpartition(b" ")
        with suppress(ValueError, Refusal):
            return integer(float(int(last))) if first == key else 0
        return 0

    yield builtin("socket_send_string(str, socket_name)", string, named)
    yield builtin("socket_send_line(str, socket_name)", line, named)
    yield builtin("socket_send_byte(value, socket_name)", byte, named)
    yield builtin("socket_send_int(value, socket_name)", whole, named)
    yield builtin("socket_set_var(name, value, socket_name)", set_variable, named)
    yield builtin("socket_get_var(name, socket_name)", get_variable, named)


def _name(value: Value) -> str:
    return text(raw(value, "socket_name"))


def _bytes(value: Value) -> bytes:
    return raw(value, "str") if isinstance(value, str) else raw(written(value), "str")


def _count(value: Value) -> int:
    found = integer(value, "number")
    if not 1 <= found <= MOST_NUMBERS:
        raise Refusal(f"1 to {MOST_NUMBERS} numbers are read at once, not {found}")
    return found


# -- what is found in what has come


def _taken(received: bytearray, count: int) -> bytes:
    """The first bytes, taken out."""
    found = bytes(received[:count])
    del received[:count]
    return found


def _line(received: bytearray) -> bytes | None:
    end = received.find(b"\n")
    if end < 0:
        return _taken(received, LONGEST) if len(received) >= LONGEST else None
    return _taken(received, end + 1)[:-1].removesuffix(b"\r")


def _in_brackets(received: bytearray) -> list[float] | None:
    """Numbers between brackets; an empty list if what stands there is none."""
    end = received.find(b")")
    if end < 0:
        if len(received) >= LONGEST:
            received.clear()
        return None
    try:
        return [float(part) for part in _taken(received, end + 1)[:-1].rpartition(b"(")[2].split(b",")]
    except ValueError:
        return []


def _between(received: bytearray, prefix: bytes, suffix: bytes) -> bytes | None:
    begin = received.find(prefix)
    if begin < 0:  # only the end of it may be the beginning of a prefix
        del received[: max(0, len(received) - len(prefix) + 1)]
        return None
    del received[:begin]
    if not suffix:
        if len(received) == len(prefix):
            return None
        return _taken(received, len(prefix) + LONGEST_STRING)[len(prefix) :]
    end = received.find(suffix, len(prefix))
    if end < 0:
        if len(received) >= LONGEST:
            received.clear()
        return None
    found = _taken(received, end)[len(prefix) :]
    del received[: len(suffix)]
    return found


def _escaped(pattern: bytes) -> bytes:
    return pattern.replace(b"\\n", b"\n").replace(b"\\t", b"\t").replace(b"\\r", b"\r")
