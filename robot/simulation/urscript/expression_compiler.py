"""Turns a program's expressions into Python's own, each with the line and column of the text it comes from."""

from __future__ import annotations

import ast
import difflib
from typing import TYPE_CHECKING, Any

from .errors import ScriptSyntaxError
from .functions import REQUIRED, Library
from .nodes import Binary, Call, Constant, Expression, Index, Items, Member, Name, Run, Unary
from .python_code import call, load, placed
from .scopes import Known, Scopes, defined
from .values import LONGEST

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

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

ALIKE = 0.75
"""How alike two names are, 0 to 1, if the one may be a slip of the other."""

_TRUE_OR_FALSE = frozenset({"<", "<=", ">", ">=", "==", "!=", "xor", "and", "or"})


class ExpressionCompiler:
    """Translates expressions of one program's functions.

    Args:
        library: what the controller offers.
        scopes: the program's functions.

    Attributes:
        calls: the controller's functions that were called.
    """

    def __init__(self, library: Library, scopes: Scopes) -> None:
        self._library = library
        self.scopes = scopes
        self.calls: set[str] = set()
        self._known = scopes.main

    def _expression(self, part: Expression) -> ast.expr:
        return placed(self._made(part), part)

    def _made(self, part: Expression) -> ast.expr:
        match part:
            case Constant(value=value):
                return ast.Constant(value)
            case Name(name=name):
                return self._variable(part)
            case Items(items=items, is_pose=True):
                return call("pose", *map(self._expression, items))
            case Items(items=items):
                if len(items) > LONGEST:
                    raise ScriptSyntaxError(f"a list has at most {LONGEST} items", part.line, part.column)
                if all(isinstance(item, Constant) for item in items):
                    return ast.List([self._expression(item) for item in items], ast.Load())
                return call("listed", *map(self._expression, items))
            case Unary(sign="not", operand=operand):
                return ast.UnaryOp(ast.Not(), self._condition(operand))
            case Unary(sign=sign, operand=operand):
                return call("negative" if sign == "-" else "positive", self._expression(operand))
            case Binary(sign=("and" | "or") as sign, left=left, right=right):
                joint = ast.And() if sign == "and" else ast.Or()
                return ast.BoolOp(joint, [self._condition(left), self._condition(right)])
            case Binary(sign=sign, left=left, right=right):
                return call(_OPERATIONS[sign], self._expression(left), self._expression(right))
            case Index(base=base, index=index):
                if getter := self._of_array(part, 0):
                    return self._called(Call(part.line, part.column, getter, None, (index,), ()))
                return call("item", self._expression(base), self._expression(index))
            case Member(base=base, name=name):
                return call("member", self._expression(base), ast.Constant(name))
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
        return placed(call("copied", made), part) if isinstance(part, Name | Index | Member | Call) else made

    def _condition(self, part: Expression) -> ast.expr:
        made = self._expression(part)
        certain = (
            (isinstance(part, Binary) and part.sign in _TRUE_OR_FALSE)
            or (isinstance(part, Unary) and part.sign == "not")
            or (isinstance(part, Constant) and isinstance(part.value, bool))
        )
        return made if certain else placed(call("truth", made), part)

    def _variable(self, part: Name) -> ast.expr:
        if part.name not in self._known.local and part.name not in self.scopes.names:
            if part.name in self._library or defined(self._known, part.name):
                hint = "; call it with ()"
            else:
                hint = _near(part.name, self._known.local | self.scopes.names)
            raise ScriptSyntaxError(f"there is no variable '{part.name}'{hint}", part.line, part.column)
        return load(f"v_{part.name}")

    def _run(self, part: Run) -> ast.expr:
        known = defined(self._known, part.name)
        if known is None or known.function.kind != "thread":
            raise ScriptSyntaxError(f"there is no thread '{part.name}'", part.line, part.column)
        return call("run", load(known.code_name))

    def _called(self, part: Call) -> ast.expr:
        if part.base is not None:
            if part.named:
                message = f"'{part.name}' takes no arguments by name"
                raise ScriptSyntaxError(message, part.line, part.column)
            arguments = [self._own(argument) for argument in part.arguments]
            return call("method", self._expression(part.base), ast.Constant(part.name), *arguments)
        if part.name == "struct":
            if part.arguments:
                raise ScriptSyntaxError("a struct's values have names", part.line, part.column)
            keys: list[ast.expr | None] = [ast.Constant(name) for name, _ in part.named]
            return call("struct", ast.Dict(keys, [self._own(value) for _, value in part.named]))
        known = defined(self._known, part.name)
        if known is not None:
            return self._call_of_program(part, known)
        found = self._library.get(part.name)
        if found is None:
            raise self._no_function(part)
        self.calls.add(part.name)
        given = self._arguments(part, [name for name, _ in found.parameters])
        arguments = []
        for (name, default), value in zip(found.parameters, given, strict=True):
            if value is None and default is REQUIRED:
                raise ScriptSyntaxError(f"'{part.name}' needs '{name}'", part.line, part.column)
            arguments.append(ast.Constant(default) if value is None else self._expression(value))
        made: ast.expr = placed(call(f"b_{part.name}", *arguments), part)
        return ast.YieldFrom(made) if found.takes_time else made

    def _no_function(self, part: Call) -> ScriptSyntaxError:
        """Nothing has this name: it is a slip, or one of a controller's functions that are not simulated."""
        names = {name for known in self.scopes.functions for name in known.inner} | set(self._library)
        hint = _near(part.name, names) or " here (docs/simulator.md says which there are)"
        return ScriptSyntaxError(f"there is no function '{part.name}'{hint}", part.line, part.column)

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
        made: ast.expr = placed(call(known.code_name, *arguments), part)
        return ast.YieldFrom(made) if known.takes_time else made

    def _default(self, value: Any, at: Call) -> ast.expr:
        """What a parameter is if it is not given; it is worked out by the call, and stands in its place."""
        made = self._expression(value)
        for inner in ast.walk(made):
            if isinstance(inner, ast.expr):
                placed(inner, at)
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


def _near(name: str, names: Collection[str]) -> str:
    """What a name may have been meant to be."""
    lowered = {other.lower(): other for other in sorted(names)}
    near = difflib.get_close_matches(name.lower(), lowered, n=1, cutoff=ALIKE)
    return f"; did you mean '{lowered[near[0]]}'?" if near else ""
