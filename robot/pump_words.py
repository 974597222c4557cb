"""Modbus registers as numbers: where a value is, how wide it is, and in which unit it counts."""

from __future__ import annotations

import math
import struct
from typing import Annotated, Literal

from pydantic import Field, model_validator

from planning.configuration import Table

Address = Annotated[int, Field(ge=0, le=0xFFFF)]
RegisterTable = Literal["holding", "input"]
Type = Literal["uint16", "int16", "uint32", "int32", "float32"]

_FORMATS = {"uint16": ">H", "int16": ">h", "uint32": ">I", "int32": ">i", "float32": ">f"}
_LARGEST = {
    "uint16": 0xFFFF,
    "int16": 0x7FFF,
    "uint32": 0xFFFFFFFF,
    "int32": 0x7FFFFFFF,
    "float32": 3.4028234663852886e38,
}


class Register(Table):
    """One value.

    Attributes:
        address: of its first word, from 0.
        table: "holding" registers (functions 3, 6, 16) or "input" registers (function 4, only read).
        type: form of the value; those of 32 bits take two words.
        word_order: which of the two comes first.
        unit: how much of the value's own unit one count is.
    """

    address: Address
    table: RegisterTable = "holding"
    type: Type = "uint16"
    word_order: Literal["high first", "low first"] = "high first"
    unit: Annotated[float, Field(gt=0)] = 1.0

    @model_validator(mode="after")
    def _ends(self) -> Register:
        if self.addresses[-1] > 0xFFFF:
            raise ValueError("its second word lies beyond address 65535")
        return self

    @property
    def count(self) -> int:
        """Words that it takes."""
        return struct.calcsize(_FORMATS[self.type]) // 2

    @property
    def addresses(self) -> range:
        """Their addresses."""
        return range(self.address, self.address + self.count)

    @property
    def largest(self) -> float:
        """Largest value that it holds."""
        return _LARGEST[self.type] * self.unit

    @property
    def smallest(self) -> float:
        """Smallest value that it holds."""
        return self._least * self.unit

    def holds(self, value: float) -> bool:
        """Whether a value fits."""
        return math.isfinite(value) and self._least <= self._counts(value) <= _LARGEST[self.type]

    def encode(self, value: float) -> list[int]:
        """A value as words; what does not fit becomes the nearest value that does."""
        near = self._counts(min(max(value, self.smallest), self.largest))
        data = struct.pack(_FORMATS[self.type], min(max(near, self._least), _LARGEST[self.type]))
        words = [int.from_bytes(data[i : i + 2], "big") for i in range(0, len(data), 2)]
        return words if self.word_order == "high first" else words[::-1]

    def decode(self, words: list[int]) -> float:
        """Words as a value; not a number where a float's words say so."""
        ordered = words if self.word_order == "high first" else words[::-1]
        data = b"".join(word.to_bytes(2, "big") for word in ordered)
        return float(struct.unpack(_FORMATS[self.type], data)[0]) * self.unit

    @property
    def _least(self) -> float:
        """Smallest count."""
        if self.type.startswith("uint"):
            return 0
        return -_LARGEST[self.type] - (self.type != "float32")

    def _counts(self, value: float) -> float:
        return value / self.unit if self.type == "float32" else round(value / self.unit)


class StatusBit(Table):
    """One state.

    Attributes:
        address: of the word that has it.
        table: "holding" or "input" registers.
        bit: which of the word, 0 the lowest.
        inverted: whether 0 says yes.
    """

    address: Address
    table: RegisterTable = "holding"
    bit: Annotated[int, Field(ge=0, le=15)]
    inverted: bool = False

    def read(self, word: int) -> bool:
        """The state that a word tells."""
        return bool(word >> self.bit & 1) != self.inverted

    def word(self, state: bool) -> int:
        """The bit that tells a state, in place, all others 0."""
        return int(state != self.inverted) << self.bit
