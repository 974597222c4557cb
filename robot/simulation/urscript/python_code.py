"""Pieces of Python's own code, as a tree."""

from __future__ import annotations

import ast
from typing import TypeVar

from .nodes import Node

Made = TypeVar("Made", bound=ast.AST)


def placed(made: Made, at: Node) -> Made:
    """A piece that says it stands where a node was read."""
    made.lineno = made.end_lineno = at.line  # type: ignore[attr-defined]
    made.col_offset = made.end_col_offset = at.column - 1  # type: ignore[attr-defined]
    return made


def load(name: str) -> ast.expr:
    """What a name stands for."""
    return ast.Name(name, ast.Load())


def call(name: str, *arguments: ast.expr) -> ast.Call:
    """A call of a function by its name."""
    return ast.Call(load(name), list(arguments), [])


def assign(name: str, value: ast.expr) -> ast.stmt:
    """A name is given a value."""
    return ast.Assign([ast.Name(name, ast.Store())], value)
