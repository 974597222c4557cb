"""Reads a program's text into a tree.

A statement ends with its line, except inside brackets and after an operator; another may follow on the same line, since
the statements of interpreter mode come like this.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .errors import ScriptSyntaxError
from .expression_reader import ExpressionReader
from .nodes import (
    Assign,
    Block,
    Evaluate,
    Expression,
    For,
    Function,
    If,
    Index,
    Member,
    Name,
    OnThread,
    Return,
    Scope,
    Statement,
    Switch,
    While,
    Word,
)
from .tokens import tokens

if TYPE_CHECKING:
    from collections.abc import Callable

_WORDS = ("break", "continue", "halt", "enter_critical", "exit_critical")


def parse(text: str) -> Function:
    """The program: what stands in its outermost `def` or `sec`; a text without one is a program of its statements.

    Raises:
        ScriptSyntaxError: with line and column.
    """
    return _Parser(tokens(text)).program()


def parse_statements(text: str) -> Function:
    """Statements, as what a program without a name does; a `def` among them defines a function.

    Raises:
        ScriptSyntaxError: with line and column.
    """
    return _Parser(tokens(text)).statements()


class _Parser(ExpressionReader):
    def program(self) -> Function:
        self._skip_lines()
        if self._is("def", "sec"):
            program = self._function()
            self._skip_lines()
            if self._next.kind != "end":
                raise self._unexpected("nothing after the program's 'end'")
            if program.parameters:
                raise ScriptSyntaxError("a program has no parameters", program.line, program.column)
            return program
        return self.statements()

    def statements(self) -> Function:
        """All there is, as statements of a program without a name."""
        self._skip_lines()
        first = self._next
        body: list[Statement] = []
        while self._next.kind != "end":
            body.append(self._statement())
            self._skip_lines()
        return Function(first.line, first.column, "unnamed", (), tuple(body), "def")

    def _block(self, *ends: str) -> Block:
        """Statements up to one of some words, which is not taken."""
        self._deeper()
        body: list[Statement] = []
        self._skip_lines()
        while not self._is(*ends):
            if self._next.kind == "end":
                raise self._unexpected(" or ".join(f"'{word}'" for word in ends))
            body.append(self._statement())
            self._skip_lines()
        self._depth -= 1
        return tuple(body)

    def _statement(self) -> Statement:
        word = self._next
        if word.kind == "keyword":
            reader = self._compound.get(word.text)
            if reader is not None:
                return reader(self)
        statement = self._simple()
        if not (self._next.kind in ("newline", "end", "keyword", "name") or self._is(";")):
            raise self._unexpected("the end of the statement")
        return statement

    def _simple(self) -> Statement:
        word = self._next
        if self._accept(*_WORDS):
            return Word(word.line, word.column, word.text)
        if self._accept("kill", "join"):
            return OnThread(word.line, word.column, word.text, self._expression())
        if self._accept("return"):
            bare = self._next.kind in ("newline", "end") or self._is("end", ";")
            return Return(word.line, word.column, None if bare else self._expression())
        scope: Scope = ""
        if self._accept("global"):
            scope = "global"
        elif self._accept("local"):
            scope = "local"
        target = self._expression()
        if not self._is("="):
            if scope:
                raise self._unexpected(f"'=' after '{scope}'")
            return Evaluate(word.line, word.column, target)
        if not isinstance(target, Name | Index | Member) or (scope and not isinstance(target, Name)):
            raise ScriptSyntaxError("only a variable can be given a value", word.line, word.column)
        self._take()
        self._on_the_next_line()
        return Assign(word.line, word.column, target, self._expression(), scope)

    def _function(self) -> Function:
        word = self._take()
        name = self._name("the function's name")
        parameters: list[tuple[str, Expression | None]] = []
        self._open("(", "after the function's name")
        while not self._is(")"):
            parameter = self._name("a parameter's name")
            if any(parameter.text == other for other, _ in parameters):
                raise ScriptSyntaxError(
                    f"parameter '{parameter.text}' twice", parameter.line, parameter.column
                )
            parameters.append((parameter.text, self._expression() if self._accept("=") else None))
            if not self._accept(","):
                break
        self._close(")", "after the parameters")
        self._expect(":", "after the parameters")
        body = self._block("end")
        self._take()
        return Function(word.line, word.column, name.text, tuple(parameters), body, word.text)

    def _if(self) -> If:
        word = self._take()
        branches = [(self._condition(), self._block("elif", "else", "end"))]
        otherwise: Block = ()
        while not self._is("end"):
            if self._accept("elif"):
                branches.append((self._condition(), self._block("elif", "else", "end")))
            else:
                self._expect("else", "or 'elif'")
                self._expect(":", "after 'else'")
                otherwise = self._block("end")
        self._take()
        return If(word.line, word.column, tuple(branches), otherwise)

    def _while(self) -> While:
        word = self._take()
        condition, body = self._condition(), self._block("end")
        self._take()
        return While(word.line, word.column, condition, body)

    def _for(self) -> For:
        word = self._take()
        name = self._name("a variable after 'for'")
        self._expect("in", "after the variable")
        items, body = self._condition(), self._block("end")
        self._take()
        return For(word.line, word.column, name.text, items, body)

    def _switch(self) -> Switch:
        word = self._take()
        value = self._condition()
        cases: list[tuple[Expression, Block]] = []
        otherwise: Block = ()
        self._skip_lines()
        while self._accept("case"):
            cases.append((self._condition(), self._block("end")))
            self._take()
            self._skip_lines()
        if self._accept("default"):
            self._expect(":", "after 'default'")
            otherwise = self._block("end")
            self._take()
            self._skip_lines()
        self._expect("end", "after the cases")
        return Switch(word.line, word.column, value, tuple(cases), otherwise)

    def _condition(self) -> Expression:
        condition = self._expression()
        self._expect(":", "after the expression")
        return condition

    _compound: dict[str, Callable[[_Parser], Statement]] = {  # noqa: RUF012 - never changed
        "def": _function,
        "sec": _function,
        "thread": _function,
        "if": _if,
        "while": _while,
        "for": _for,
        "switch": _switch,
    }
