"""From a program's text to what can be run, and from that of statements to what can be added to a program that runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .compiler import Compiler
from .errors import ScriptSyntaxError
from .parsing import parse, parse_statements

if TYPE_CHECKING:
    from types import CodeType

    from .functions import Library
    from .scopes import Around, Scopes

FILE = "<program>"
"""The name of the text in the code's own records."""

ADDS = "interpreter_mode"
"""The function of the controller that lets statements be added to the program that calls it."""


@dataclass(frozen=True, eq=False)
class Compiled:
    """A program that can be run.

    Attributes:
        name: of its outermost `def`.
        codes: define its functions; that called `MAIN` is the program.
        secondary: whether it began with `sec`, and so takes no time.
        calls: the controller's functions that it calls.
        around: what statements find that are added to it while it runs; None if it lets none be added.
    """

    name: str
    codes: tuple[CodeType, ...]
    secondary: bool
    calls: frozenset[str]
    around: Around | None = None


@dataclass(frozen=True, eq=False)
class Added:
    """Statements that can be added to a program that runs.

    Attributes:
        main: name of the function of `code` that they are.
        code: defines their functions.
        calls: the controller's functions that they call.
        around: what the next ones find.
        globals: variables that they declare as the program's.
    """

    main: str
    code: CodeType
    calls: frozenset[str]
    around: Around
    globals: frozenset[str]


def compiled(text: str, library: Library) -> Compiled:
    """A program's text, ready to run.

    Args:
        text: with one outermost `def` or `sec`, or bare statements.
        library: what the controller offers.

    Raises:
        ScriptSyntaxError: with line and column: it is no program, or names what there is not.
    """
    try:
        tree = parse(text)
        compiler = Compiler(tree, library)
        code = compile(compiler.module(), FILE, "exec")
    except RecursionError:
        raise ScriptSyntaxError("the program is nested too deeply", 1, 1) from None
    calls = frozenset(compiler.calls)
    return Compiled(tree.name, (code,), tree.kind == "sec", calls, interpreting(compiler.scopes, calls))


def interpreting(scopes: Scopes, calls: frozenset[str]) -> Around | None:
    """What statements find that are added to a program, if it lets any be added."""
    return scopes.around() if ADDS in calls else None


def added(text: str, library: Library, around: Around) -> Added:
    """Statements, ready to be added to a program that runs.

    Args:
        text: of the statements; a `def` or `thread` among them defines a function.
        library: what the controller offers.
        around: what they find.

    Raises:
        ScriptSyntaxError: with line and column: they are none, or name what there is not.
    """
    try:
        compiler = Compiler(parse_statements(text), library, around)
        code = compile(compiler.module(), FILE, "exec")
    except RecursionError:
        raise ScriptSyntaxError("the statement is nested too deeply", 1, 1) from None
    scopes = compiler.scopes
    return Added(
        scopes.main.code_name, code, frozenset(compiler.calls), scopes.around(), frozenset(scopes.globals)
    )
