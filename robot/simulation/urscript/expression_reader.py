"""Reads expressions.

`p[...]` with one item is an index into a variable `p`, with six a pose; `m[i, j]` is `m[i][j]`.
"""

from __future__ import annotations

from .errors import ScriptSyntaxError
from .nodes import Binary, Call, Constant, Expression, Index, Items, Member, Name, Run, Unary
from .token_reader import TokenReader
from .tokens import Token

_LEVELS = (("or", "xor"), ("and",), ("==", "!=", "<", ">", "<=", ">="), ("+", "-"), ("*", "/", "%"))
_CLOSENESS = {sign: level for level, signs in enumerate(_LEVELS) for sign in signs}


class ExpressionReader(TokenReader):
    """Reads the expressions of a text."""

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


def _number(word: Token) -> int | float:
    text = word.text
    try:
        value = int(text, 0) if text[:2] in ("0x", "0X") else int(text)
    except ValueError:
        return float(text)
    return value if -(2**31) <= value < 2**31 else float(value)
