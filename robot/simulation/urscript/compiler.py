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
from typing import TYPE_CHECKING, Any

from .errors import ScriptSyntaxError
from .expression_compiler import ExpressionCompiler
from .functions import Library
from .nodes import (
    Assign,
    Block,
    Call,
    Evaluate,
    For,
    Function,
    If,
    Index,
    Name,
    OnThread,
    Return,
    Statement,
    Switch,
    While,
    Word,
)
from .python_code import assign, call, load, placed
from .scopes import Around, Known, Scopes

if TYPE_CHECKING:
    from collections.abc import Callable

STRETCH = 50
"""Statements after one another that are not interrupted."""


class Compiler(ExpressionCompiler):
    """Translates the functions of one program.

    Args:
        tree: of the program, or of statements that are added to one.
        library: what the controller offers.
        around: the program that they are added to, or None.
    """

    def __init__(self, tree: Function, library: Library, around: Around | None = None) -> None:
        super().__init__(library, Scopes(tree, library, around))
        self._temporaries = 0
        self._loops = 0

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
        body += [assign(f"v_{name}", call("copied", load(f"v_{name}"))) for name in sorted(known.changed)]
        if known is not self.scopes.main:
            body += [self._pause()] if known.takes_time else [ast.Expr(call("enter"))]
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
        return placed(made, function)

    @staticmethod
    def _pause() -> ast.stmt:
        return ast.If(call("tick"), [ast.Expr(ast.Yield(None))], [])

    # -- statements

    def _block(self, block: Block) -> list[ast.stmt]:
        body: list[ast.stmt] = []
        for i, part in enumerate(part for part in block if not isinstance(part, Function)):
            if i % STRETCH == STRETCH - 1 and self._known.takes_time:
                body.append(placed(self._pause(), part))
            body += [placed(made, part) for made in self._statement(part)]
        return body

    def _statement(self, part: Statement) -> list[ast.stmt]:
        made = self._makers[type(part)](self, part)
        return made if isinstance(made, list) else [made]

    def _assign(self, part: Assign) -> ast.stmt:
        value = self._own(part.value)
        target = part.target
        if isinstance(target, Name):
            return assign(f"v_{target.name}", value)
        setter = self._of_array(target, 1)
        if setter and isinstance(target, Index):
            setting = Call(part.line, part.column, setter, None, (target.index, part.value), ())
            return self._evaluate(Evaluate(part.line, part.column, setting))
        base = self._expression(target.base)
        if isinstance(target, Index):
            return ast.Expr(placed(call("put", base, self._expression(target.index), value), target))
        return ast.Expr(placed(call("put_member", base, ast.Constant(target.name), value), target))

    def _evaluate(self, part: Evaluate) -> ast.stmt:
        return ast.Expr(self._expression(part.value))

    def _if(self, part: If) -> list[ast.stmt]:
        made = self._block(part.otherwise)
        for condition, block in reversed(part.branches):
            made = [
                placed(ast.If(self._condition(condition), self._body(block), made), condition),
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
        items = placed(call("items", self._expression(part.items)), part.items)
        return ast.For(ast.Name(f"v_{part.name}", ast.Store()), items, self._loop(part.body), [])

    def _switch(self, part: Switch) -> list[ast.stmt]:
        self._temporaries += 1
        value = f"t_{self._temporaries}"
        made = self._block(part.otherwise)
        for case, block in reversed(part.cases):
            test = placed(call("equal", load(value), self._expression(case)), case)
            made = [placed(ast.If(test, self._body(block), made), case)]
        return [assign(value, self._expression(part.value)), *made]

    def _return(self, part: Return) -> ast.stmt:
        return ast.Return(None if part.value is None else self._own(part.value))

    def _word(self, part: Word) -> ast.stmt:
        if part.word in ("break", "continue"):
            if not self._loops:
                raise ScriptSyntaxError(f"'{part.word}' outside a loop", part.line, part.column)
            return ast.Break() if part.word == "break" else ast.Continue()
        return ast.Expr(call(part.word))

    def _on_thread(self, part: OnThread) -> ast.stmt:
        made: ast.expr = call(part.word, self._expression(part.thread))
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
