"""Turns a program's tree into Python's own code, so that it runs at Python's speed.

A function that takes time becomes a generator, each `yield` of which is a cycle of the controller; a function that
takes none becomes a plain function. Every piece keeps the line and column of the text it comes from, which is how an
error finds its place. Names of variables become `v_NAME`, of the program's functions `f_NAME`, of the controller's
`b_NAME`; what else the code calls is in `running`.

A variable belongs to the program if the program's own block or a `global` gives it a value, and to its function
otherwise or if it is declared `local`.
"""

from __future__ import annotations

import ast
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from .errors import ScriptSyntaxError
from .functions import REQUIRED, Library
from .nodes import (
    Assign,
    Binary,
    Block,
    Call,
    Constant,
    Evaluate,
    Expression,
    For,
    Function,
    If,
    Index,
    Items,
    Member,
    Name,
    Node,
    OnThread,
    Return,
    Run,
    Statement,
    Switch,
    Unary,
    While,
    Word,
)
from .parsing import parse, parse_statements
from .scopes import Around, Known, Scopes, defined
from .values import LONGEST

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import CodeType

Made = TypeVar("Made", bound=ast.AST)

FILE = "<program>"
"""The name of the text in the code's own records."""

STRETCH = 50
"""Statements after one another that are not interrupted."""

_OPERATIONS = {
    "+": "add",
    "-": "subtract",
    "*": "multiply",
    "/": "divide",
    "%": "remainder",
    "<": "less",
    "<=": "at_most",
    ">": "more",
    ">=": "at_least",
    "==": "equal",
    "!=": "differ",
    "xor": "either",
}
_ARRAYS = {
    "digital_out": ("get_digital_out", "set_digital_out"),
    "analog_out": ("get_analog_out", "set_analog_out"),
    "digital_in": ("get_digital_in", ""),
    "analog_in": ("get_analog_in", ""),
}
"""Inputs and outputs as older programs write them, `digital_out[2] = True`: what reads and what sets one."""

_TRUE_OR_FALSE = frozenset({"<", "<=", ">", ">=", "==", "!=", "xor", "and", "or"})


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


ADDS = "interpreter_mode"
"""The function of the controller that lets statements be added to the program that calls it."""


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


class Compiler:
    """Translates the functions of one program."""

    def __init__(self, tree: Function, library: Library, around: Around | None = None) -> None:
        self._library = library
        self.calls: set[str] = set()
        self._temporaries = 0
        self._loops = 0
        self.scopes = Scopes(tree, library, around)
        self._known = self.scopes.main

    def module(self) -> ast.Module:
        module = ast.Module(body=[self.function(known) for known in self.scopes.functions], type_ignores=[])
        return ast.fix_missing_locations(module)

    # -- functions

    def function(self, known: Known) -> ast.stmt:
        """The definition of one function."""
        self._known, self._loops = known, 0
        function = known.function
        body: list[ast.stmt] = []
        if known.of_program:
            body.append(ast.Global([f"v_{name}" for name in sorted(known.of_program)]))
        body += [_assign(f"v_{name}", _call("copied", _load(f"v_{name}"))) for name in sorted(known.changed)]
        if known is not self.scopes.main:
            body += [self._pause()] if known.takes_time else [ast.Expr(_call("enter"))]
        body += self._block(function.body)
        if known.takes_time:  # what makes it a generator, if nothing else does
            body.append(ast.If(ast.Constant(value=False), [ast.Expr(ast.Yield(None))], []))
        arguments = ast.arguments(
            posonlyargs=[],
            args=[ast.arg(f"v_{name}") for name, _ in function.parameters],
            kwonlyargs=[],
            kw_defaults=[],
            defaults=[],
        )
        made = ast.FunctionDef(
            name=known.code_name, args=arguments, body=body or [ast.Pass()], decorator_list=[]
        )
        return _placed(made, function)

    @staticmethod
    def _pause() -> ast.stmt:
        return ast.If(_call("tick"), [ast.Expr(ast.Yield(None))], [])

    # -- statements

    def _block(self, block: Block) -> list[ast.stmt]:
        body: list[ast.stmt] = []
        for i, part in enumerate(part for part in block if not isinstance(part, Function)):
            if i % STRETCH == STRETCH - 1 and self._known.takes_time:
                body.append(_placed(self._pause(), part))
            body += [_placed(made, part) for made in self._statement(part)]
        return body

    def _statement(self, part: Statement) -> list[ast.stmt]:
        made = self._makers[type(part)](self, part)
        return made if isinstance(made, list) else [made]

    def _assign(self, part: Assign) -> ast.stmt:
        value = self._own(part.value)
        target = part.target
        if isinstance(target, Name):
            return _assign(f"v_{target.name}", value)
        setter = self._of_array(target, 1)
        if setter and isinstance(target, Index):
            call = Call(part.line, part.column, setter, None, (target.index, part.value), ())
            return self._evaluate(Evaluate(part.line, part.column, call))
        base = self._expression(target.base)
        if isinstance(target, Index):
            return ast.Expr(_placed(_call("put", base, self._expression(target.index), value), target))
        return ast.Expr(_placed(_call("put_member", base, ast.Constant(target.name), value), target))

    def _evaluate(self, part: Evaluate) -> ast.stmt:
        return ast.Expr(self._expression(part.value))

    def _if(self, part: If) -> list[ast.stmt]:
        made = self._block(part.otherwise)
        for condition, block in reversed(part.branches):
            made = [
                _placed(ast.If(self._condition(condition), self._body(block), made), condition),
            ]
        return made

    def _body(self, block: Block) -> list[ast.stmt]:
        return self._block(block) or [ast.Pass()]

    def _loop(self, block: Block) -> list[ast.stmt]:
        self._loops += 1
        body = [self._pause(), *self._block(block)]
        self._loops -= 1
        return body

    def _while(self, part: While) -> ast.stmt:
        return ast.While(self._condition(part.condition), self._loop(part.body), [])

    def _for(self, part: For) -> ast.stmt:
        items = _placed(_call("items", self._expression(part.items)), part.items)
        return ast.For(ast.Name(f"v_{part.name}", ast.Store()), items, self._loop(part.body), [])

    def _switch(self, part: Switch) -> list[ast.stmt]:
        self._temporaries += 1
        value = f"t_{self._temporaries}"
        made = self._block(part.otherwise)
        for case, block in reversed(part.cases):
            test = _placed(_call("equal", _load(value), self._expression(case)), case)
            made = [_placed(ast.If(test, self._body(block), made), case)]
        return [_assign(value, self._expression(part.value)), *made]

    def _return(self, part: Return) -> ast.stmt:
        return ast.Return(None if part.value is None else self._own(part.value))

    def _word(self, part: Word) -> ast.stmt:
        if part.word in ("break", "continue"):
            if not self._loops:
                raise ScriptSyntaxError(f"'{part.word}' outside a loop", part.line, part.column)
            return ast.Break() if part.word == "break" else ast.Continue()
        return ast.Expr(_call(part.word))

    def _on_thread(self, part: OnThread) -> ast.stmt:
        made: ast.expr = _call(part.word, self._expression(part.thread))
        return ast.Expr(ast.YieldFrom(made) if part.word == "join" else made)

    _makers: dict[type, Callable[[Compiler, Any], ast.stmt | list[ast.stmt]]] = {  # noqa: RUF012 - never changed
        Assign: _assign,
        Evaluate: _evaluate,
        If: _if,
        While: _while,
        For: _for,
        Switch: _switch,
        Return: _return,
        Word: _word,
        OnThread: _on_thread,
    }

    # -- expressions

    def _expression(self, part: Expression) -> ast.expr:
        return _placed(self._made(part), part)

    def _made(self, part: Expression) -> ast.expr:
        match part:
            case Constant(value=value):
                return ast.Constant(value)
            case Name(name=name):
                return self._variable(part)
            case Items(items=items, is_pose=True):
                return _call("pose", *map(self._expression, items))
            case Items(items=items):
                if len(items) > LONGEST:
                    raise ScriptSyntaxError(f"a list has at most {LONGEST} items", part.line, part.column)
                if all(isinstance(item, Constant) for item in items):
                    return ast.List([self._expression(item) for item in items], ast.Load())
                return _call("listed", *map(self._expression, items))
            case Unary(sign="not", operand=operand):
                return ast.UnaryOp(ast.Not(), self._condition(operand))
            case Unary(sign=sign, operand=operand):
                return _call("negative" if sign == "-" else "positive", self._expression(operand))
            case Binary(sign=("and" | "or") as sign, left=left, right=right):
                joint = ast.And() if sign == "and" else ast.Or()
                return ast.BoolOp(joint, [self._condition(left), self._condition(right)])
            case Binary(sign=sign, left=left, right=right):
                return _call(_OPERATIONS[sign], self._expression(left), self._expression(right))
            case Index(base=base, index=index):
                if getter := self._of_array(part, 0):
                    return self._called(Call(part.line, part.column, getter, None, (index,), ()))
                return _call("item", self._expression(base), self._expression(index))
            case Member(base=base, name=name):
                return _call("member", self._expression(base), ast.Constant(name))
            case Run(name=name):
                return self._run(part)
            case Call():
                return self._called(part)

    def _of_array(self, part: Expression, which: int) -> str:
        """The function that reads or sets an input or output written as an item of an array, or nothing."""
        if not isinstance(part, Index) or not isinstance(part.base, Name):
            return ""
        name = part.base.name
        if name in self._known.local or name in self.scopes.names:
            return ""
        function = _ARRAYS.get(name, ("", ""))[which]
        return function if function in self._library else ""

    def _own(self, part: Expression) -> ast.expr:
        """A value that nothing else changes."""
        made = self._expression(part)
        return (
            _placed(_call("copied", made), part) if isinstance(part, Name | Index | Member | Call) else made
        )

    def _condition(self, part: Expression) -> ast.expr:
        made = self._expression(part)
        certain = (
            (isinstance(part, Binary) and part.sign in _TRUE_OR_FALSE)
            or (isinstance(part, Unary) and part.sign == "not")
            or (isinstance(part, Constant) and isinstance(part.value, bool))
        )
        return made if certain else _placed(_call("truth", made), part)

    def _variable(self, part: Name) -> ast.expr:
        if part.name not in self._known.local and part.name not in self.scopes.names:
            hint = (
                "; call it with ()" if part.name in self._library or defined(self._known, part.name) else ""
            )
            raise ScriptSyntaxError(f"there is no variable '{part.name}'{hint}", part.line, part.column)
        return _load(f"v_{part.name}")

    def _run(self, part: Run) -> ast.expr:
        known = defined(self._known, part.name)
        if known is None or known.function.kind != "thread":
            raise ScriptSyntaxError(f"there is no thread '{part.name}'", part.line, part.column)
        return _call("run", _load(known.code_name))

    def _called(self, part: Call) -> ast.expr:
        if part.base is not None:
            if part.named:
                message = f"'{part.name}' takes no arguments by name"
                raise ScriptSyntaxError(message, part.line, part.column)
            arguments = [self._own(argument) for argument in part.arguments]
            return _call("method", self._expression(part.base), ast.Constant(part.name), *arguments)
        if part.name == "struct":
            if part.arguments:
                raise ScriptSyntaxError("a struct's values have names", part.line, part.column)
            keys: list[ast.expr | None] = [ast.Constant(name) for name, _ in part.named]
            return _call("struct", ast.Dict(keys, [self._own(value) for _, value in part.named]))
        known = defined(self._known, part.name)
        if known is not None:
            return self._call_of_program(part, known)
        found = self._library.get(part.name)
        if found is None:
            raise ScriptSyntaxError(f"there is no function '{part.name}'", part.line, part.column)
        self.calls.add(part.name)
        given = self._arguments(part, [name for name, _ in found.parameters])
        arguments = []
        for (name, default), value in zip(found.parameters, given, strict=True):
            if value is None and default is REQUIRED:
                raise ScriptSyntaxError(f"'{part.name}' needs '{name}'", part.line, part.column)
            arguments.append(ast.Constant(default) if value is None else self._expression(value))
        made: ast.expr = _placed(_call(f"b_{part.name}", *arguments), part)
        return ast.YieldFrom(made) if found.takes_time else made

    def _call_of_program(self, part: Call, known: Known) -> ast.expr:
        function = known.function
        if function.kind == "thread":
            raise ScriptSyntaxError(f"'{part.name}' is a thread; start it with 'run'", part.line, part.column)
        given = self._arguments(part, [name for name, _ in function.parameters])
        arguments = []
        for (name, default), value in zip(function.parameters, given, strict=True):
            if value is None and default is None:
                raise ScriptSyntaxError(f"'{part.name}' needs '{name}'", part.line, part.column)
            arguments.append(self._expression(value) if value is not None else self._default(default, part))
        made: ast.expr = _placed(_call(known.code_name, *arguments), part)
        return ast.YieldFrom(made) if known.takes_time else made

    def _default(self, value: Any, call: Call) -> ast.expr:
        """What a parameter is if it is not given; it is worked out by the call, and stands in its place."""
        made = self._expression(value)
        for inner in ast.walk(made):
            if isinstance(inner, ast.expr):
                _placed(inner, call)
        return made

    def _arguments(self, part: Call, names: Sequence[str]) -> list[Expression | None]:
        """What is given for each parameter, None for nothing."""
        if len(part.arguments) > len(names):
            takes = f"at most {len(names)} arguments" if names else "no arguments"
            raise ScriptSyntaxError(
                f"'{part.name}' takes {takes}, not {len(part.arguments)}", part.line, part.column
            )
        given: dict[str, Expression] = dict(zip(names, part.arguments, strict=False))
        for name, value in part.named:
            if name not in names:
                raise ScriptSyntaxError(f"'{part.name}' has no parameter '{name}'", value.line, value.column)
            if name in given:
                raise ScriptSyntaxError(f"'{name}' is given twice", value.line, value.column)
            given[name] = value
        return [given.get(name) for name in names]


# -- pieces of Python


def _placed(made: Made, at: Node) -> Made:
    made.lineno = made.end_lineno = at.line  # type: ignore[attr-defined]
    made.col_offset = made.end_col_offset = at.column - 1  # type: ignore[attr-defined]
    return made


def _load(name: str) -> ast.expr:
    return ast.Name(name, ast.Load())


def _call(name: str, *arguments: ast.expr) -> ast.Call:
    return ast.Call(_load(name), list(arguments), [])


def _assign(name: str, value: ast.expr) -> ast.stmt:
    return ast.Assign([ast.Name(name, ast.Store())], value)
