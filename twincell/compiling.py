"""A word where the first run waits: kernels are compiled once, and later runs read them from a cache."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from numba.core.event import Event, Listener, install_listener

COMPILING = "compiling the geometry kernels, which later runs need not do: a minute or two"


class _First(Listener):
    """Says once that something is compiled. Numba sends no such event for what it finds in its cache."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._said = False

    def on_start(self, event: Event) -> None:  # noqa: ARG002 - numba's signature
        if not self._said:
            self._said = True
            self._say(COMPILING)

    def on_end(self, event: Event) -> None:
        """Nothing to say."""


@contextlib.contextmanager
def compiling_said(say: Callable[[str], None]) -> Iterator[None]:
    """While this is open, `say` is told when the first kernel is compiled."""
    with install_listener("numba:compile", _First(say)):
        yield
