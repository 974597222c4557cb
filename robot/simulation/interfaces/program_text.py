"""Finds programs in what a client of a script port sends.

A program is `def NAME():` to its own `end`, blocks within it counted, and `sec NAME():` the same; any other line is a
program of its own.
"""

from __future__ import annotations

import re

LONGEST = 1 << 22
"""Longest program, bytes."""

_WORD = re.compile(r'#.*|"[^"\n]*"|\b(def|sec|thread|if|while|for|switch|case|default|end)\b')


class Collected:
    """What a client has sent of a program that has not ended yet."""

    def __init__(self) -> None:
        self._line = bytearray()
        self._lines: list[str] = []
        self._open = self._length = 0

    def add(self, data: bytes) -> list[str]:
        """Take what came; the programs that it ends.

        Raises:
            ValueError: a program is too long.
        """
        self._length += len(data)
        *lines, rest = data.split(b"\n")
        programs = []
        for line in lines:
            self._line += line
            text = self._line.decode("utf-8", "replace") + "\n"
            self._line.clear()
            if self._ends_with(text):
                programs.append("".join(self._lines))
                self._lines, self._open, self._length = [], 0, len(rest)
        self._line += rest
        if self._length > LONGEST:
            raise ValueError(f"a program of more than {LONGEST} bytes")
        return programs

    def rest(self) -> str:
        """What there is of a program that its client will not end."""
        text = "".join(self._lines) + self._line.decode("utf-8", "replace")
        self._lines, self._open, self._length = [], 0, 0
        self._line.clear()
        return text if text.strip() else ""

    def _ends_with(self, line: str) -> bool:
        if not self._lines and not line.strip():
            return False
        self._lines.append(line)
        for word in _WORD.finditer(line):
            if word[1] == "end":
                self._open -= 1
            elif word[1] is not None:
                self._open += 1
        return self._open <= 0
