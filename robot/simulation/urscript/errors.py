"""What ends a program: a place in its text and a sentence."""

from __future__ import annotations


class ScriptError(Exception):
    """A program that does not make sense, or did something that ends it.

    Attributes:
        message: what is wrong.
        line, column: where in the program's text, from 1.
    """

    def __init__(self, message: str, line: int, column: int) -> None:
        super().__init__(f"{message}, line {line}, column {column}")
        self.message, self.line, self.column = message, line, column


class ScriptSyntaxError(ScriptError):
    """The text is no program; nothing of it was executed."""


class ScriptRuntimeError(ScriptError):
    """A running program did what ends it."""


class Refusal(Exception):  # noqa: N818 - never leaves this package: the place is still to be added
    """What a function of the controller says when it cannot do what it was called for."""
