"""Memory of what has been built, so that an edit rebuilds only what it touches.

Every stage of the reconstruction is a function of frozen objects, which are equal only to themselves. Called through
a memo it is computed once for the same objects, and what a round of calls did not ask for is forgotten. What comes out
is what a rebuild from nothing would give, because it is the same functions.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Executor
from typing import Any, TypeVar

Result = TypeVar("Result")


class Memo:
    """Results of functions of frozen objects."""

    def __init__(self) -> None:
        self._old: dict[str, dict[Hashable, Any]] = {}
        self._new: dict[str, dict[Hashable, Any]] = {}

    def map(
        self,
        function: Callable[..., Result],
        calls: Sequence[tuple[Any, ...]],
        executor: Executor | None = None,
    ) -> list[Result]:
        """The results of calls, in their order; those not known yet are computed, by the executor if there is one."""
        name = function.__qualname__
        new, old = self._new.setdefault(name, {}), self._old.get(name, {})
        missing: dict[tuple[Any, ...], None] = {}
        for call in calls:
            if call in old:
                new[call] = old[call]
            elif call not in new:
                missing[call] = None
        if executor is None or len(missing) < 2:
            for call in missing:
                new[call] = function(*call)
        else:
            columns = zip(*missing, strict=True)
            results = executor.map(function, *columns, chunksize=max(1, len(missing) // 16))
            new.update(zip(missing, results, strict=True))
        return [new[call] for call in calls]

    def knows(self, name: str, key: Hashable) -> bool:
        """Whether there is a result under a key; it is then kept for this round."""
        new, old = self._new.setdefault(name, {}), self._old.get(name, {})
        if key in old:
            new[key] = old[key]
        return key in new

    def store(self, name: str, key: Hashable, result: Any) -> None:
        """Keep a result under a key."""
        self._new.setdefault(name, {})[key] = result

    def recall(self, name: str, key: Hashable) -> Any:
        """The result under a key."""
        return self._new[name][key]

    def end_round(self) -> None:
        """Forget what was not asked for since the last time."""
        self._old, self._new = self._new, {}

    def abandon_round(self) -> None:
        """Forget what was made since the last time, after a failure."""
        self._new = {}
