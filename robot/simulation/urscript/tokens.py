"""Splits a program's text into tokens."""

from __future__ import annotations

import re
from typing import Literal, NamedTuple

from .errors import ScriptSyntaxError

Kind = Literal["name", "keyword", "number", "text", "sign", "newline", "end"]

KEYWORDS = frozenset(
    {"if", "elif", "else", "end", "while", "for", "in", "switch", "case", "default", "break", "continue"}
    | {"def", "sec", "thread", "return", "halt", "global", "local"}
    | {"run", "kill", "join", "enter_critical", "exit_critical"}
    | {"and", "or", "xor", "not", "True", "False"}
)

LONGEST_TEXT = 1 << 20
"""Longest program that is read, characters."""

_TOKEN = re.compile(
    r"""(?P<newline>\r?\n)
    | (?P<blank>[ \t\r\f\v]+ | \#[^\n]*)
    | (?P<number>0[xX][0-9a-fA-F]+ | (?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)
    | (?P<name>[A-Za-z_]\w*)
    | (?P<text>"[^"\n]*")
    | (?P<sign>==|!=|<=|>=|[-+*/%<>=()\[\],.:;])""",
    re.VERBOSE | re.ASCII,
)
_MARK = re.compile(r"^[ \t]*\$[^\n]*", re.MULTILINE)


class Token(NamedTuple):
    """A word of a program.

    Attributes:
        kind: of the word; `end` is the end of the text.
        text: as written; of a string what stands between its quotes.
        line, column: of its first character, from 1.
        close: whether it follows what is before it without a space.
    """

    kind: Kind
    text: str
    line: int
    column: int
    close: bool = False


def tokens(program: str) -> list[Token]:
    """The words of a program, comments left out; lines that PolyScope marks with a `$` count as comments.

    Raises:
        ScriptSyntaxError: a character that no program has, a string without its end, or a text beyond `LONGEST_TEXT`.
    """
    if len(program) > LONGEST_TEXT:
        raise ScriptSyntaxError(f"the program is longer than {LONGEST_TEXT} characters", 1, 1)
    program = _MARK.sub(lambda mark: " " * len(mark[0]), program)
    found: list[Token] = []
    line, start, place, close = 1, 0, 0, False
    while place < len(program):
        match = _TOKEN.match(program, place)
        column = place - start + 1
        if match is None:
            what = "a string without its end" if program[place] == '"' else f"unexpected {program[place]!r}"
            raise ScriptSyntaxError(what, line, column)
        place = match.end()
        kind, text = match.lastgroup, match[0]
        if kind == "newline":
            found.append(Token("newline", "\n", line, column))
            line, start = line + 1, place
        elif kind == "name":
            found.append(Token("keyword" if text in KEYWORDS else "name", text, line, column, close))
        elif kind == "text":
            found.append(Token("text", text[1:-1], line, column, close))
        elif kind == "number":
            found.append(Token("number", text, line, column, close))
        elif kind == "sign":
            found.append(Token("sign", text, line, column, close))
        close = kind not in ("blank", "newline")
    found.append(Token("end", "the end of the program", line, place - start + 1))
    return found
