"""Takes a text's words one after another."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .errors import ScriptSyntaxError
from .tokens import Token

if TYPE_CHECKING:
    from collections.abc import Sequence

DEEPEST = 100
"""Brackets and blocks within one another."""


class TokenReader:
    """Where one is in a text, and what comes next."""

    def __init__(self, words: Sequence[Token]) -> None:
        self._words = words
        self._place = 0
        self._brackets = 0  # within which a line's end means nothing
        self._depth = 0

    @property
    def _next(self) -> Token:
        if self._brackets:
            while self._words[self._place].kind == "newline":
                self._place += 1
        return self._words[self._place]

    def _take(self) -> Token:
        word = self._next
        if word.kind != "end":
            self._place += 1
        return word

    def _is(self, *texts: str) -> bool:
        word = self._next
        return word.kind in ("sign", "keyword") and word.text in texts

    def _accept(self, *texts: str) -> Token | None:
        return self._take() if self._is(*texts) else None

    def _expect(self, text: str, where: str) -> Token:
        if not self._is(text):
            raise self._unexpected(f"'{text}' {where}")
        return self._take()

    def _name(self, what: str) -> Token:
        if self._next.kind != "name":
            raise self._unexpected(what)
        return self._take()

    def _unexpected(self, wanted: str) -> ScriptSyntaxError:
        word = self._next
        shown = {"newline": "the end of the line", "end": word.text, "text": f'"{word.text}"'}
        found = shown.get(word.kind, f"'{word.text}'")
        return ScriptSyntaxError(f"expected {wanted}, not {found}", word.line, word.column)

    def _on_the_next_line(self) -> None:
        """Go on there: what comes after an operator may stand behind the line's end."""
        while self._next.kind == "newline":
            self._take()

    def _skip_lines(self) -> None:
        while self._next.kind == "newline" or self._is(";"):
            self._take()

    def _deeper(self) -> None:
        self._depth += 1
        if self._depth > DEEPEST:
            word = self._next
            raise ScriptSyntaxError(f"more than {DEEPEST} levels deep", word.line, word.column)

    def _open(self, sign: str, where: str) -> None:
        self._expect(sign, where)
        self._brackets += 1
        self._deeper()

    def _close(self, sign: str, where: str) -> None:
        if not self._is(sign):
            raise self._unexpected(f"'{sign}' {where}")
        self._brackets -= 1  # before the word is taken, so that the line's end after it counts
        self._place += 1
        self._depth -= 1
