"""Modbus frames, as they come out of a stream of bytes and go into one: Modbus TCP, and RTU over TCP.

Whatever bytes come, at most one frame's worth of them is kept.
"""

from __future__ import annotations

import abc
from typing import NamedTuple

LONGEST_PDU = 253
HEADER = 7  # of Modbus TCP: transaction, protocol, length, unit
SILENCE = 0.05
"""An RTU frame that is not complete after this time without a byte never will be, s; a line needs 0.002 s."""

READS_AND_SINGLE_WRITES = range(1, 7)
WRITES = {15: 6, 16: 6, 23: 10}
"""Functions that tell the number of bytes that follow, and where."""


class Request(NamedTuple):
    """A request.

    Attributes:
        transaction: number that the answer repeats; 0 in RTU.
        device: whom it is for.
        pdu: function and what follows it.
    """

    transaction: int
    device: int
    pdu: bytes


class FramingError(Exception):
    """The stream makes no sense any more."""


class Framing(abc.ABC):
    """One connection's frames."""

    @abc.abstractmethod
    def take(self, data: bytes, now: float) -> list[Request]:
        """The requests that are complete with these bytes, which came at a time in s.

        Raises:
            FramingError: there is no telling where the next one begins.
        """

    @abc.abstractmethod
    def frame(self, request: Request, pdu: bytes) -> bytes:
        """The answer to a request."""


class TcpFraming(Framing):
    """Modbus TCP: a header tells the length."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def take(self, data: bytes, now: float) -> list[Request]:
        del now
        self._buffer += data
        requests = []
        while len(self._buffer) >= HEADER:
            transaction, protocol, length = (
                int.from_bytes(self._buffer[i : i + 2], "big") for i in (0, 2, 4)
            )
            if protocol != 0 or not 2 <= length <= LONGEST_PDU + 1:
                raise FramingError
            if len(self._buffer) < HEADER - 1 + length:
                break
            pdu = bytes(self._buffer[HEADER : HEADER - 1 + length])
            requests.append(Request(transaction, self._buffer[HEADER - 1], pdu))
            del self._buffer[: HEADER - 1 + length]
        return requests

    def frame(self, request: Request, pdu: bytes) -> bytes:
        header = (request.transaction, 0, len(pdu) + 1)
        return b"".join(number.to_bytes(2, "big") for number in header) + bytes([request.device]) + pdu


class RtuFraming(Framing):
    """RTU: a frame ends where its check sum fits, or with silence."""

    LONGEST = LONGEST_PDU + 3

    def __init__(self, device: int) -> None:
        self._device = device
        self._buffer = b""
        self._heard = 0.0

    def take(self, data: bytes, now: float) -> list[Request]:
        if now - self._heard > SILENCE:
            self._buffer = b""
        self._heard = now
        self._buffer = (self._buffer + data)[-2 * self.LONGEST :]
        requests = []
        place = 0
        while place < len(self._buffer) - 3:
            size = self._size(place)
            if size and _sound(self._buffer[place : place + size]):
                frame = self._buffer[place : place + size]
                requests.append(Request(0, frame[0], frame[1:-2]))
                self._buffer, place = self._buffer[place + size :], 0
            else:
                place += 1
        if len(self._buffer) > self.LONGEST:
            self._buffer = self._buffer[-self.LONGEST :]
        return requests

    def frame(self, request: Request, pdu: bytes) -> bytes:
        frame = bytes([request.device]) + pdu
        return frame + check_sum(frame)

    def _size(self, place: int) -> int:
        """Length of the frame that may begin at a place; 0 where none does, or not all of it is there."""
        left = len(self._buffer) - place
        if self._buffer[place] not in {self._device, 0}:
            return 0
        function = self._buffer[place + 1]
        if function in READS_AND_SINGLE_WRITES:
            size = 8
        elif function in WRITES:
            at = WRITES[function]
            size = at + 3 + self._buffer[place + at] if left > at else left + 1
        else:  # a function that is not there: all that has come, if it is a frame
            size = left if left <= self.LONGEST else 0
        return size if size <= left else 0


def _table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        rest = byte
        for _ in range(8):
            rest = rest >> 1 ^ (0xA001 if rest & 1 else 0)
        table.append(rest)
    return tuple(table)


_TABLE = _table()


def check_sum(frame: bytes) -> bytes:
    """The two bytes that end an RTU frame: CRC-16 with polynomial 0x8005, reflected, low byte first."""
    rest = 0xFFFF
    for byte in frame:
        rest = rest >> 8 ^ _TABLE[(rest ^ byte) & 0xFF]
    return rest.to_bytes(2, "little")


def _sound(frame: bytes) -> bool:
    return check_sum(frame[:-2]) == frame[-2:]
