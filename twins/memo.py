"""Memory of what has been built, so that an edit rebuilds only what it touches.

Every stage of the reconstruction is a function of frozen objects, which are equal only to themselves. Called through
a memo it is computed once for the same objects, and what a round of calls did not ask for is forgotten. What comes out
is what a rebuild from nothing would give, because it is the same functions.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Executor
from itertools import repeat
from typing import Any, TypeVar

Result = TypeVar("Result")

_UNKNOWN: Any = object()


class Memo:
    """Results of functions of frozen objects."""

    def __init__(self) -> None:
        self._old: dict[str, dict[Hashable, Any]] = {}
        self._new: dict[str, dict[Hashable, Any]] = {}
        self._parts: dict[str, dict[Hashable, Memo]] = {}
        self._worked_on: list[Memo] = []

    def map(
        self,
        function: Callable[..., Result],
        calls: Sequence[tuple[Any, ...]],
        executor: Executor | None = None,
    ) -> list[Result]:
        """The results of calls, in their order; those not known yet are computed, by the executor if there is one."""
        name = function.__qualname__
        new, old = self._new.setdefault(name, {}), self._old.get(name, {})
        results: list[Any] = list(map(old.get, calls, repeat(_UNKNOWN)))
        unknown = [i for i, result in enumerate(results) if result is _UNKNOWN]
        missing = list(dict.fromkeys(calls[i] for i in unknown if calls[i] not in new))
        if executor is None or len(missing) < 2:
            made = [function(*call) for call in missing]
        else:
            columns = zip(*missing, strict=True)
            made = list(executor.map(function, *columns, chunksize=max(1, len(missing) // 16)))
        new.update(zip(missing, made, strict=True))
        for i in unknown:
            results[i] = new[calls[i]]
        new.update(zip(calls, results, strict=True))
        return results

    def map_parts(
        self, function: Callable[..., Result], calls: Mapping[Hashable, tuple[Any, ...]]
    ) -> list[Result]:
        """The results of calls for the parts of a whole, by a function that is given a memo before a call's objects.

        The memo is the part's own, and knows what it knew when the part was last worked on. So a part in which
        nothing has changed costs one look-up, and one that has changed is not begun from nothing.

        Args:
            function: of a memo and the objects of a call.
            calls: for each part; the memos of other parts are forgotten.
        """
        name = function.__qualname__
        before = self._parts.get(name, {})
        self._parts[name] = parts = {part: before.get(part) or Memo() for part in calls}
        for part, call in calls.items():
            if not self.knows(name, call):
                self._worked_on.append(parts[part])
                self.store(name, call, function(parts[part], *call))
        return [self.recall(name, call) for call in calls.values()]

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
        for memo in self._worked_on:
            memo.end_round()
        self._worked_on = []

    def abandon_round(self) -> None:
        """Forget what was made since the last time, after a failure."""
        self._new = {}
        for memo in self._worked_on:
            memo.abandon_round()
        self._worked_on = []
