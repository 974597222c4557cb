"""The simulated controller as a Modbus TCP client: it keeps signals up to date, which programs read and set.

An input is read with function 2 (discrete inputs) or 4 (input registers). An output is read with function 1 (coils) or
3 (holding registers) until it is set, and from then on written with 5 or 6, with 15 or 16 if it is several. A signal
of registers to read and to write is read with 3 until it is set, and from then on exchanged with 23. Nothing is waited
for: `poll` is called in each cycle.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from enum import IntEnum

from .client_socket import ClientSocket, loopback

PORT = 502
ANSWER_TIME = 1.0
"""Process time in which an answer is expected, s."""

RECONNECT_TIME = 0.5
"""Process time after which a lost device is tried again, s."""

CONNECTION_ERROR = 255
"""Error of a signal whose device does not answer."""

_HEADER = struct.Struct(">HHHB")
_LONGEST_FRAME = 260


class Kind(IntEnum):
    """What a signal is."""

    DIGITAL_INPUT = 0
    DIGITAL_OUTPUT = 1
    REGISTER_INPUT = 2
    REGISTER_OUTPUT = 3


_READS = {
    Kind.DIGITAL_INPUT: 2,
    Kind.DIGITAL_OUTPUT: 1,
    Kind.REGISTER_INPUT: 4,
    Kind.REGISTER_OUTPUT: 3,
}
_DIGITAL = (Kind.DIGITAL_INPUT, Kind.DIGITAL_OUTPUT)


@dataclass(eq=False)
class Signal:
    """One signal.

    Attributes:
        device: whose it is.
        unit: of the device, 0 to 255.
        kind, address, count: what is read.
        written: address and number of the registers that an exchange writes, if it is one.
        values: last known, or last set.
        orders: what a program has set, none if it has not.
        period: between requests, s; infinite if there is one request only.
        patience: how long it may be without an answer, s.
        answered: process time of the last good answer, or of when the signal was added.
        error: 0, the exception that the device answered, or `CONNECTION_ERROR`.
        due: process time of the next request.
    """

    device: Device
    unit: int
    kind: Kind
    address: int
    count: int
    answered: float
    written: tuple[int, int] | None = None
    values: list[int] = field(default_factory=list)
    orders: list[int] = field(default_factory=list)
    period: float = 0.1
    patience: float = 2.0
    error: int = CONNECTION_ERROR
    due: float = 0.0

    def __post_init__(self) -> None:
        self.values = [0] * self.count

    @property
    def is_digital(self) -> bool:
        return self.kind in _DIGITAL

    def request(self) -> bytes:
        """What is asked next: function and data."""
        address, count = self.address, self.count
        if not self.orders:
            return struct.pack(">BHH", _READS[self.kind], address, count)
        values = self.orders
        if self.written is not None:
            there, many = self.written
            numbers = struct.pack(f">{many}H", *values)
            return struct.pack(">BHHHHB", 23, address, count, there, many, 2 * many) + numbers
        if self.is_digital:
            if count == 1:
                return struct.pack(">BHH", 5, address, 0xFF00 if values[0] else 0)
            bits = sum(1 << i for i, value in enumerate(values) if value)
            size = (count + 7) // 8
            return struct.pack(">BHHB", 15, address, count, size) + bits.to_bytes(size, "little")
        if count == 1:
            return struct.pack(">BHH", 6, address, values[0])
        return struct.pack(f">BHHB{count}H", 16, address, count, 2 * count, *values)

    def take(self, answer: bytes, now: float) -> None:
        """Take the answer to a request: function and data."""
        function = answer[0]
        if function & 0x80:
            self.error = answer[1] if len(answer) > 1 else CONNECTION_ERROR
            return
        if function in (1, 2):
            bits = int.from_bytes(answer[2:], "little")
            self.values = [bits >> i & 1 for i in range(self.count)]
        elif function in (3, 4, 23) and len(answer) >= 2 + 2 * self.count:
            self.values = list(struct.unpack_from(f">{self.count}H", answer, 2))
        elif function not in (5, 6, 15, 16):
            self.error = CONNECTION_ERROR
            return
        self.error, self.answered = 0, now


@dataclass(eq=False)
class Device:
    """A connection to one device, and the requests that it has not answered.

    Attributes:
        one_by_one: whether a request waits for the answer to the one before.
    """

    host: str
    port: int
    one_by_one: bool = False
    _link: ClientSocket | None = None
    _connected: bool = False
    _retry: float = 0.0
    _number: int = 0
    _asked: dict[int, tuple[Signal | None, float]] = field(default_factory=dict)
    _orders: list[tuple[int, bytes]] = field(default_factory=list)

    def order(self, unit: int, request: bytes) -> None:
        """Send a request whose answer nobody reads."""
        self._orders.append((unit, request))
        del self._orders[:-16]

    def poll(self, signals: list[Signal], now: float) -> None:
        """Ask what is due and take what has come."""
        try:
            if not self._ready(now):
                if self._link is None:
                    for signal in signals:
                        signal.error = CONNECTION_ERROR
                return
            self._take(now)
            waiting = {id(signal) for signal, _ in self._asked.values()}
            for unit, request in self._orders:
                self._send(None, unit, request, now)
            self._orders.clear()
            for signal in signals:
                if signal.due <= now and id(signal) not in waiting and not (self.one_by_one and self._asked):
                    self._send(signal, signal.unit, signal.request(), now)
                    signal.due = now + signal.period
        except OSError:
            self.lose(now)

    def lose(self, now: float = -math.inf) -> None:
        """Close the connection; it is opened again."""
        if self._link is not None:
            self._link.close()
        for signal, _ in self._asked.values():
            if signal is not None:
                signal.error, signal.due = CONNECTION_ERROR, -math.inf
        self._asked.clear()
        self._orders.clear()
        self._link, self._connected, self._retry = None, False, now + RECONNECT_TIME

    def _ready(self, now: float) -> bool:
        if self._connected:
            return True
        if self._link is None:
            if now < self._retry:
                return False
            self._link = ClientSocket(self.host, self.port)
            self._retry = now + ANSWER_TIME
        found = self._link.connect()
        if found is False or (found is None and now > self._retry):
            self.lose(now)
        self._connected = bool(found)
        return self._connected

    def _send(self, signal: Signal | None, unit: int, request: bytes, now: float) -> None:
        assert self._link is not None
        self._number = (self._number + 1) & 0xFFFF
        frame = _HEADER.pack(self._number, 0, len(request) + 1, unit) + request
        if self._link.send(frame) < len(frame):
            raise OSError("the device takes nothing")
        self._asked[self._number] = (signal, now)

    def _take(self, now: float) -> None:
        """Take the answers that have come.

        Raises:
            OSError: the device is gone, is late, or sends what is no Modbus.
        """
        link = self._link
        assert link is not None
        link.receive()
        while len(link.received) > _HEADER.size:
            number, protocol, length, _ = _HEADER.unpack_from(link.received)
            if protocol != 0 or not 2 <= length <= _LONGEST_FRAME:
                raise OSError("no Modbus")
            if len(link.received) < 6 + length:
                break
            answer = bytes(link.received[_HEADER.size : 6 + length])
            del link.received[: 6 + length]
            signal, _ = self._asked.pop(number, (None, 0.0))
            if signal is not None:
                signal.take(answer, now)
        if link.ended or any(now - asked > ANSWER_TIME for _, asked in self._asked.values()):
            raise OSError("no answer")


class ModbusClient:
    """All signals, by name."""

    def __init__(self) -> None:
        self.signals: dict[str, Signal] = {}
        self.devices: dict[tuple[str, int], Device] = {}

    def device(self, address: str) -> Device | None:
        """The device at `IP` or `IP:PORT`; None where that is not on this machine."""
        host, _, port = address.partition(":") if address.count(":") == 1 else (address, "", "")
        target = loopback(host)
        if target is None or (port and not (port.isdecimal() and 0 < int(port) < 1 << 16)):
            return None
        key = (target, int(port or PORT))
        if key not in self.devices:
            self.devices[key] = Device(*key)
        return self.devices[key]

    def poll(self, now: float) -> None:
        """Do what a cycle at a process time asks for."""
        for key, device in list(self.devices.items()):
            signals = [signal for signal in self.signals.values() if signal.device is device]
            device.poll(signals, now)
            if not signals and not device._orders and not device._asked:  # noqa: SLF001 - of this file
                device.lose(now)
                del self.devices[key]
