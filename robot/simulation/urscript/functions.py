"""The functions that a program calls without defining them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any, Final, TypeAlias


class _Required:
    """Stands where a parameter has no default."""


REQUIRED: Final = _Required()


@dataclass(frozen=True, eq=False)
class Builtin:
    """A function of the controller.

    Attributes:
        name: as programs call it.
        call: what it does, with one argument for each parameter; it raises `Refusal` for what it cannot do. That of
            a function that takes time is a generator: each `yield` lets one cycle pass.
        parameters: names and default values, in order.
        takes_time: whether it is one.
    """

    name: str
    call: Callable[..., Any]
    parameters: tuple[tuple[str, Any], ...] = ()
    takes_time: bool = False


Library: TypeAlias = Mapping[str, Builtin]


def builtin(
    signature: str, call: Callable[..., Any], defaults: Mapping[str, Any] = MappingProxyType({})
) -> Builtin:
    """A function from its signature, `name(a, b, c)`, whose parameters named in `defaults` may be left out.

    A parameter written `*a` is one that programs may give and that has no effect here: `call` does not get it. A
    function that takes time is written as a generator.
    """
    name, names, kept = _read(signature)
    effect = call
    if len(kept) < len(names):

        def effect(*arguments: Any) -> Any:
            return call(*[arguments[i] for i in kept])

    parameters = tuple([(part, defaults.get(part, REQUIRED)) for part in names])
    return Builtin(name, effect, parameters, inspect.isgeneratorfunction(call))


@cache
def _read(signature: str) -> tuple[str, tuple[str, ...], tuple[int, ...]]:
    """The function's name, its parameters' names, and the places of those that have an effect."""
    name, _, rest = signature.partition("(")
    parts = [part.strip() for part in rest.rstrip(")").split(",") if part.strip()]
    kept = [i for i, part in enumerate(parts) if not part.startswith("*")]
    return name, tuple(part.removeprefix("*") for part in parts), tuple(kept)
