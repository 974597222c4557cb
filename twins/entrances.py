"""Entrances: what is handed to a function of toolpaths or surfaces is one, or the error says what to pass instead."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import trimesh

from .toolpath import Toolpath

P = ParamSpec("P")
R = TypeVar("R")

KINDS: dict[str, tuple[type, str]] = {
    "Toolpath": (Toolpath, "toolpath"),
    "trimesh.Trimesh": (trimesh.Trimesh, "surface"),
}
"""Of an annotation: the type, and the attribute under which results hold one."""


def checks_kinds(function: Callable[P, R]) -> Callable[P, R]:
    """A function that looks at its toolpaths and surfaces first.

    Parameters annotated `Toolpath` or `trimesh.Trimesh`, also with `| None`, are looked at; all others are not.

    Raises:
        TypeError (when called): such a parameter is something else; says what was given and what to pass.
    """
    signature = inspect.signature(function)
    looked_at: list[tuple[int, str, str, bool]] = []
    starred: tuple[int, str] | None = None
    for place, parameter in enumerate(signature.parameters.values()):
        # Annotations are strings: every module here postpones them.
        kind, _, rest = str(parameter.annotation).partition(" | ")
        if kind not in KINDS or rest not in {"", "None"}:
            continue
        if parameter.kind is inspect.Parameter.VAR_POSITIONAL:
            starred = place, kind
        else:
            looked_at.append((place, parameter.name, kind, rest == "None"))

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        for place, name, kind, optional in looked_at:
            if place < len(args):
                value: Any = args[place]
            elif name in kwargs:
                value = kwargs[name]
            else:
                continue
            if not isinstance(value, KINDS[kind][0]) and not (optional and value is None):
                raise TypeError(_sentence(function.__name__, name, value, kind))
        if starred is not None:
            for value in args[starred[0] :]:
                if not isinstance(value, KINDS[starred[1]][0]):
                    raise TypeError(_sentence(function.__name__, "", value, starred[1]))
        return function(*args, **kwargs)

    return checked


def _sentence(function: str, name: str, value: Any, kind: str) -> str:
    wanted, attribute = KINDS[kind]
    given = type(value).__name__
    article = "an" if given[0].lower() in "aeiou" else "a"
    said = "None" if value is None else f"{article} {given}"
    # The parameter is named where the plain word would not tell which one is meant.
    which = f" as {name!r}" if name not in {"", "toolpath", "surface"} else ""
    return f"{function}: needs a {wanted.__name__}{which}, not {said}{_advice(value, wanted, attribute)}"


def _advice(value: Any, wanted: type, attribute: str) -> str:
    if isinstance(getattr(value, attribute, None), wanted):
        return f"; pass its .{attribute}"
    if isinstance(value, trimesh.Trimesh):
        return "; slice it first (slice_surface)"
    if isinstance(value, Toolpath):
        return "; reconstruct it first (reconstruct)"
    if isinstance(value, str | Path):
        return f"; read it first ({'load_toolpath' if wanted is Toolpath else 'read_surface'})"
    if isinstance(value, list | tuple) and any(isinstance(one, wanted) for one in value):
        return "; pass one of its items"
    return ""
