"""A program as a tree. Every node knows the line and column that it was read from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

Scope = Literal["", "local", "global"]


@dataclass(frozen=True, slots=True)
class Node:
    """Part of a program, and where its text begins, from 1."""

    line: int
    column: int


# -- expressions


@dataclass(frozen=True, slots=True)
class Constant(Node):
    """A number, a string, `True` or `False`."""

    value: bool | int | float | str


@dataclass(frozen=True, slots=True)
class Name(Node):
    """A variable."""

    name: str


@dataclass(frozen=True, slots=True)
class Items(Node):
    """A list `[...]`, or with `is_pose` a pose `p[...]`."""

    items: tuple[Expression, ...]
    is_pose: bool


@dataclass(frozen=True, slots=True)
class Unary(Node):
    """`-x`, `+x` or `not x`."""

    sign: str
    operand: Expression


@dataclass(frozen=True, slots=True)
class Binary(Node):
    """Two operands and what is between them."""

    sign: str
    left: Expression
    right: Expression


@dataclass(frozen=True, slots=True)
class Index(Node):
    """`base[index]`."""

    base: Expression
    index: Expression


@dataclass(frozen=True, slots=True)
class Member(Node):
    """`base.name`."""

    base: Expression
    name: str


@dataclass(frozen=True, slots=True)
class Call(Node):
    """`name(...)`, or `base.name(...)`.

    Attributes:
        base: whose method it is, or None.
        named: arguments given by name, in order.
    """

    name: str
    base: Expression | None
    arguments: tuple[Expression, ...]
    named: tuple[tuple[str, Expression], ...]


@dataclass(frozen=True, slots=True)
class Run(Node):
    """`run name()`: starts a thread."""

    name: str


Expression: TypeAlias = Constant | Name | Items | Unary | Binary | Index | Member | Call | Run

# -- statements


@dataclass(frozen=True, slots=True)
class Assign(Node):
    """`target = value`, with `local` or `global` before it or neither."""

    target: Name | Index | Member
    value: Expression
    scope: Scope


@dataclass(frozen=True, slots=True)
class Evaluate(Node):
    """An expression for what it does."""

    value: Expression


@dataclass(frozen=True, slots=True)
class If(Node):
    """`if`, `elif` and `else`: conditions and what to do where they hold."""

    branches: tuple[tuple[Expression, Block], ...]
    otherwise: Block


@dataclass(frozen=True, slots=True)
class While(Node):
    """`while`."""

    condition: Expression
    body: Block


@dataclass(frozen=True, slots=True)
class For(Node):
    """`for name in list`."""

    name: str
    items: Expression
    body: Block


@dataclass(frozen=True, slots=True)
class Switch(Node):
    """`switch`: the first case whose value equals it, or else `default`."""

    value: Expression
    cases: tuple[tuple[Expression, Block], ...]
    otherwise: Block


@dataclass(frozen=True, slots=True)
class Return(Node):
    """`return`, with a value or without."""

    value: Expression | None


@dataclass(frozen=True, slots=True)
class Word(Node):
    """A statement of one word: `break`, `continue`, `halt`, `enter_critical`, `exit_critical`."""

    word: str


@dataclass(frozen=True, slots=True)
class OnThread(Node):
    """`kill` or `join` and a thread's handle."""

    word: str
    thread: Expression


@dataclass(frozen=True, slots=True)
class Function(Node):
    """`def`, `sec` or `thread`; it stands where it was defined.

    Attributes:
        parameters: names, and default values where it has them.
        kind: the word that it began with.
    """

    name: str
    parameters: tuple[tuple[str, Expression | None], ...]
    body: Block
    kind: str


Statement: TypeAlias = Assign | Evaluate | If | While | For | Switch | Return | Word | OnThread | Function
Block: TypeAlias = tuple[Statement, ...]
