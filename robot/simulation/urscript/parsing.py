"""Reads a program's text into a tree.

A statement ends with its line, except inside brackets and after an operator; another may follow on the same line, since
the statements of interpreter mode come like this. `p[...]` with one item is an index into a variable `p`, with six a
pose; `m[i, j]` is `m[i][j]`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .errors import ScriptSyntaxError
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
    OnThread,
    Return,
    Run,
    Scope,
    Statement,
    Switch,
    Unary,
    While,
    Word,
)
from .tokens import Token, tokens

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

DEEPEST = 100
"""Brackets and blocks within one another."""

_LEVELS = (("or", "xor"), ("and",), ("==", "!=", "<", ">", "<=", ">="), ("+", "-"), ("*", "/", "%"))
_CLOSENESS = {sign: level for level, signs in enumerate(_LEVELS) for sign in signs}
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


class _Parser:
    def __init__(self, words: Sequence[Token]) -> None:
        self._words = words
        self._place = 0
        self._brackets = 0  # within which a line's end means nothing
        self._depth = 0

    # -- words

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

    # -- statements

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

    # -- expressions

    def _expression(self, level: int = 0) -> Expression:
        """Operands joined by signs that bind at least as closely as a level."""
        left = self._unary()
        before = self._depth
        while (closeness := self._closeness()) >= level:
            sign = self._take()
            self._deeper()  # a long sum is a deep tree
            self._on_the_next_line()
            right = self._expression(closeness + 1)
            left = Binary(sign.line, sign.column, sign.text, left, right)
        self._depth = before
        return left

    def _closeness(self) -> int:
        """How closely the next word joins what stands around it; -1 if it is none that does."""
        word = self._next
        return _CLOSENESS.get(word.text, -1) if word.kind in ("sign", "keyword") else -1

    def _unary(self) -> Expression:
        if self._next.kind in ("sign", "keyword") and (sign := self._accept("-", "+", "not")):
            self._deeper()
            # `not a == b` asks whether they differ; a sign belongs to what follows it at once
            operand = self._expression(2) if sign.text == "not" else self._unary()
            self._depth -= 1
            return Unary(sign.line, sign.column, sign.text, operand)
        return self._after(self._atom())

    def _after(self, value: Expression) -> Expression:
        """What follows a value at once: an index, a member, a method's arguments."""
        before = self._depth
        while True:
            word = self._next
            if word.kind != "sign" or word.text not in "[.":
                self._depth = before
                return value
            self._deeper()  # as deep as it is long
            if word.text == "[":
                self._open("[", "")
                indices = [self._expression()]
                while self._accept(","):
                    self._deeper()
                    indices.append(self._expression())
                self._close("]", "after the index")
                for index in indices:
                    value = Index(word.line, word.column, value, index)
            else:
                self._take()
                name = self._take() if self._next.kind == "keyword" else self._name("a name after '.'")
                if self._is("("):
                    arguments, named = self._arguments()
                    value = Call(word.line, word.column, name.text, value, arguments, named)
                else:
                    value = Member(word.line, word.column, value, name.text)

    def _atom(self) -> Expression:
        word = self._take()
        line, column = word.line, word.column
        if word.kind == "number":
            return Constant(line, column, _number(word))
        if word.kind == "text":
            return Constant(line, column, word.text)
        if word.kind == "keyword" and word.text in ("True", "False"):
            return Constant(line, column, word.text == "True")
        if word.kind == "keyword" and word.text == "run":
            name = self._name("a thread's name after 'run'")
            self._expect("(", "after the thread's name")
            self._expect(")", "after '('; a thread has no parameters")
            return Run(line, column, name.text)
        if word.kind == "sign" and word.text == "(":
            self._place -= 1
            self._open("(", "")
            value = self._expression()
            self._close(")", "after the expression")
            return value
        if word.kind == "sign" and word.text == "[":
            self._place -= 1
            return Items(line, column, self._items(), is_pose=False)
        if word.kind == "name":
            return self._named(word)
        self._place -= word.kind != "end"
        raise self._unexpected("a value")

    def _named(self, word: Token) -> Expression:
        line, column = word.line, word.column
        if self._is("("):
            arguments, named = self._arguments()
            return Call(line, column, word.text, None, arguments, named)
        if word.text == "p" and self._is("[") and self._next.close:
            items = self._items()
            if len(items) == 1:
                return Index(line, column, Name(line, column, "p"), items[0])
            if len(items) != 6:
                raise ScriptSyntaxError(f"a pose has 6 numbers, not {len(items)}", line, column)
            return Items(line, column, items, is_pose=True)
        return Name(line, column, word.text)

    def _items(self) -> tuple[Expression, ...]:
        self._open("[", "")
        items: list[Expression] = []
        while not self._is("]"):
            items.append(self._expression())
            if not self._accept(","):
                break
        self._close("]", "after the items")
        return tuple(items)

    def _arguments(self) -> tuple[tuple[Expression, ...], tuple[tuple[str, Expression], ...]]:
        self._open("(", "")
        arguments: list[Expression] = []
        named: list[tuple[str, Expression]] = []
        while not self._is(")"):
            word = self._next
            value = self._expression()
            if self._is("=") and isinstance(value, Name):
                self._take()
                if any(value.name == other for other, _ in named):
                    raise ScriptSyntaxError(f"argument '{value.name}' twice", word.line, word.column)
                named.append((value.name, self._expression()))
            elif named:
                raise ScriptSyntaxError(
                    "an argument without a name after one with a name", word.line, word.column
                )
            else:
                arguments.append(value)
            if not self._accept(","):
                break
        self._close(")", "after the arguments")
        return tuple(arguments), tuple(named)

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


def _number(word: Token) -> int | float:
    text = word.text
    try:
        value = int(text, 0) if text[:2] in ("0x", "0X") else int(text)
    except ValueError:
        return float(text)
    return value if -(2**31) <= value < 2**31 else float(value)
