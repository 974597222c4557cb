"""Modbus requests: what the functions that a drive knows do with its registers, and how all others are refused."""

from __future__ import annotations

import abc
from enum import IntEnum

READ_HOLDING, READ_INPUT, WRITE_ONE, WRITE_MANY = 3, 4, 6, 16
REFUSED = 0x80
MOST_READ, MOST_WRITTEN = 125, 123


class Refusal(IntEnum):
    """Exception codes."""

    FUNCTION = 1
    ADDRESS = 2
    VALUE = 3
    NO_SUCH_DEVICE = 11


class RefusedError(Exception):
    """A request is answered with an exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class Memory(abc.ABC):
    """Registers that can be read and written.

    Attributes:
        tables: that there are: "holding", "input".
        at_once: most registers in one request.
    """

    tables: frozenset[str]
    at_once: int

    @abc.abstractmethod
    def read(self, table: str, addresses: range) -> list[int]:
        """Words of a table.

        Raises:
            RefusedError: there is no such register.
        """

    @abc.abstractmethod
    def write(self, address: int, words: list[int]) -> None:
        """Take words for holding registers, all at once.

        Raises:
            RefusedError: there is no such register, or it cannot be written, or not with this.
        """


def answer(pdu: bytes, memory: Memory) -> bytes:
    """Carry out a request, function and what follows it; the answer, or the refusal."""
    try:
        return bytes([pdu[0]]) + _carry_out(pdu, memory)
    except RefusedError as error:
        return refusal(pdu, error.code)


def refusal(pdu: bytes, code: int) -> bytes:
    """The answer that refuses a request."""
    return bytes([pdu[0] | REFUSED, code])


def _carry_out(pdu: bytes, memory: Memory) -> bytes:
    function, body = pdu[0], pdu[1:]
    tables = {READ_HOLDING: "holding", READ_INPUT: "input", WRITE_ONE: "holding", WRITE_MANY: "holding"}
    if tables.get(function) not in memory.tables or (function == WRITE_MANY and memory.at_once == 1):
        raise RefusedError(Refusal.FUNCTION)
    if len(body) < 4 or (function != WRITE_MANY and len(body) != 4):
        raise RefusedError(Refusal.VALUE)
    address, number = int.from_bytes(body[:2], "big"), int.from_bytes(body[2:4], "big")
    if function == WRITE_ONE:
        memory.write(address, [number])
        return body
    if not 1 <= number <= min(MOST_WRITTEN if function == WRITE_MANY else MOST_READ, memory.at_once):
        raise RefusedError(Refusal.VALUE)
    if function == WRITE_MANY and (len(body) != 5 + 2 * number or body[4] != 2 * number):
        raise RefusedError(Refusal.VALUE)
    if address + number > 0x10000:
        raise RefusedError(Refusal.ADDRESS)
    if function == WRITE_MANY:
        memory.write(address, [int.from_bytes(body[i : i + 2], "big") for i in range(5, len(body), 2)])
        return body[:4]
    words = memory.read(tables[function], range(address, address + number))
    return bytes([2 * number]) + b"".join(word.to_bytes(2, "big") for word in words)
