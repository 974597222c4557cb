"""Translates programs that are mostly like one before: each function is read and translated once.

A client that sends its program again for a new path changes one function of forty; the others are the same text, on
other lines. So a function is kept by its text, its lines counted from its own first one, and moved to where it stands.
A function's translation also depends on what the program around it defines; with another of that it is made anew.
What is wrong with a program is told by translating it whole.
"""

from __future__ import annotations

import ast
import re
from collections import OrderedDict
from dataclasses import dataclass, replace
from functools import partial
from types import CodeType
from typing import TYPE_CHECKING, Generic, TypeVar

from .compiler import Compiler
from .compiling import FILE, Compiled, compiled, interpreting
from .errors import ScriptSyntaxError
from .nodes import Function
from .parsing import parse, parse_statements

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    from .functions import Library
    from .scopes import Known

KEPT = 1 << 18
"""Characters of functions whose trees, and whose translations, are kept."""

_WORD = re.compile(r'#[^\n]*|"[^"\n]*"|\b(def|sec|thread|if|while|for|switch|case|default|end)\b|\n')

Made = TypeVar("Made")


@dataclass(frozen=True)
class _Piece:
    """A function's text, begun in its own column; `line` is that before its first one, `head` for the program."""

    text: str
    line: int


class Pieces:
    """Translates one program after another.

    Args:
        library: what the controller offers.
    """

    def __init__(self, library: Library) -> None:
        self._library = library
        self._trees: _Kept[Function] = _Kept()
        self._codes: _Kept[tuple[CodeType, frozenset[str]]] = _Kept()

    def compiled(self, text: str) -> Compiled:
        """As `compiling.compiled`, with the same errors."""
        try:
            return self._put_together(text)
        except (ScriptSyntaxError, RecursionError):
            return compiled(text, self._library)

    def _put_together(self, text: str) -> Compiled:
        rest, pieces = _split(text)
        head = parse(rest)
        trees = [self._trees.get(piece.text, piece.text, partial(_read, piece)) for piece in pieces]
        places = {id(tree): piece for tree, piece in zip(trees, pieces, strict=True)}
        if len(places) < len(trees):
            raise ScriptSyntaxError("a function is there twice", 1, 1)  # said by whoever translates it whole
        compiler = Compiler(replace(head, body=(*head.body, *trees)), self._library)
        scopes = compiler.scopes
        around = (
            scopes.names,
            tuple(
                (known.code_name, known.function.kind, known.function.parameters, known.takes_time)
                for known in scopes.functions
            ),
        )
        codes: list[CodeType] = []
        calls: set[str] = set()
        for known in scopes.functions:
            piece = places.get(id(_outermost(known).function))
            if piece is None:
                code, called = _translated(compiler, known)
            else:
                key = (piece.text, known.code_name, around)
                code, called = self._codes.get(key, piece.text, partial(_translated, compiler, known))
                code = _moved(code, piece.line)
            codes.append(code)
            calls |= called
        calls_made = frozenset(calls)
        return Compiled(
            head.name, tuple(codes), head.kind == "sec", calls_made, interpreting(scopes, calls_made)
        )


class _Kept(Generic[Made]):
    """What was made last."""

    def __init__(self) -> None:
        self._made: OrderedDict[Hashable, tuple[Made, int]] = OrderedDict()
        self._size = 0

    def get(self, key: Hashable, text: str, make: Callable[[], Made]) -> Made:
        if key not in self._made:
            self._made[key] = make(), len(text)
            self._size += len(text)
        self._made.move_to_end(key)
        made, _ = self._made[key]
        while self._size > KEPT:
            _, (_, size) = self._made.popitem(last=False)
            self._size -= size
        return made


def _split(text: str) -> tuple[str, list[_Piece]]:
    """A program without the functions that stand right within it, all else in its place, and these functions."""
    rest, pieces = [], []
    depth = line = start = first = kept = 0
    for word in _WORD.finditer(text):
        if word[0] == "\n":
            line += 1
        elif word[1] == "end":
            depth -= 1
            if depth == 1 and start:
                column = start - text.rfind("\n", 0, start) - 1
                pieces.append(_Piece(" " * column + text[start : word.end()], first))
                rest += [text[kept:start], "\n" * (line - first)]
                rest.append(" " * (word.end() - text.rfind("\n", 0, word.end()) - 1) if line > first else "")
                kept, start = word.end(), 0
        elif word[1]:
            if depth == 1 and not start and word[1] in ("def", "thread"):
                start, first = word.start(), line
            depth += 1
    return "".join([*rest, text[kept:]]), pieces


def _read(piece: _Piece) -> Function:
    (function,) = parse_statements(piece.text).body
    assert isinstance(function, Function)
    return function


def _outermost(known: Known) -> Known:
    """The function right within the program in which another is defined, or the program itself."""
    while known.outer is not None and known.outer.outer is not None:
        known = known.outer
    return known


def _translated(compiler: Compiler, known: Known) -> tuple[CodeType, frozenset[str]]:
    """The code that defines one function, and the controller's functions that it calls."""
    compiler.calls.clear()
    module = ast.fix_missing_locations(ast.Module([compiler.function(known)], []))
    return compile(module, FILE, "exec"), frozenset(compiler.calls)


def _moved(code: CodeType, lines: int) -> CodeType:
    """Code that says it is some lines further down."""
    constants = tuple(_moved(part, lines) if isinstance(part, CodeType) else part for part in code.co_consts)
    return code.replace(co_firstlineno=code.co_firstlineno + lines, co_consts=constants)
