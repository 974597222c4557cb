"""Goes through the parts of a program's tree."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .nodes import (
    Assign,
    Binary,
    Block,
    Call,
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
    Statement,
    Switch,
    Unary,
    While,
)

if TYPE_CHECKING:
    from collections.abc import Iterator


def statements(block: Block) -> Iterator[Statement]:
    """All statements of a block but those of functions defined in it."""
    for part in block:
        yield part
        match part:
            case If(branches=branches, otherwise=otherwise) | Switch(cases=branches, otherwise=otherwise):
                for _, body in branches:
                    yield from statements(body)
                yield from statements(otherwise)
            case While(body=body) | For(body=body):
                yield from statements(body)


def definitions(block: Block) -> Iterator[Function]:
    return (part for part in statements(block) if isinstance(part, Function))


def assignments(block: Block) -> Iterator[Assign]:
    return (part for part in statements(block) if isinstance(part, Assign))


def loops_over_lists(block: Block) -> Iterator[For]:
    return (part for part in statements(block) if isinstance(part, For))


def calls(block: Block) -> Iterator[Call]:
    for part in statements(block):
        for expression in _expressions_of(part):
            yield from _calls_in(expression)


def _expressions_of(part: Statement) -> Iterator[Expression]:
    match part:
        case Assign(target=target, value=value):
            yield target
            yield value
        case Evaluate(value=value):
            yield value
        case Return(value=result) if result is not None:
            yield result
        case If(branches=branches):
            yield from (condition for condition, _ in branches)
        case Switch(value=value, cases=cases):
            yield value
            yield from (case for case, _ in cases)
        case While(condition=condition):
            yield condition
        case For(items=items):
            yield items
        case OnThread(thread=thread):
            yield thread


def _calls_in(part: Expression) -> Iterator[Call]:
    match part:
        case Call(base=base, arguments=arguments, named=named):
            yield part
            if base is not None:
                yield from _calls_in(base)
            for argument in (*arguments, *(value for _, value in named)):
                yield from _calls_in(argument)
        case Items(items=items):
            for item in items:
                yield from _calls_in(item)
        case Unary(operand=operand):
            yield from _calls_in(operand)
        case Binary(left=left, right=right) | Index(base=left, index=right):
            yield from _calls_in(left)
            yield from _calls_in(right)
        case Member(base=base):
            yield from _calls_in(base)


def root(target: Expression) -> Name | None:
    while isinstance(target, Index | Member):
        target = target.base
    return target if isinstance(target, Name) else None
