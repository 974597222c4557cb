"""Lists as programs use them: their methods, and the functions about them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .errors import Refusal
from .functions import Builtin, builtin
from .values import LONGEST, Pose, Struct, Value, copied, equal, integer, kind, size


def items(value: Value) -> list[Any]:
    """What a `for` goes through: a copy, so that the loop may change the list."""
    return list(_list(value, "for"))


def struct(members: dict[str, Any]) -> Struct:
    """A struct of values by name.

    Raises:
        Refusal: it would be deeper or larger than a value may be.
    """
    found = Struct(members)
    size(found)
    return found


def method(base: Value, name: str, *arguments: Any) -> Any:
    """Call a method of a list.

    Raises:
        Refusal: there is no such method, or it cannot do that.
    """
    found = _METHODS.get(name)
    if found is None:
        raise Refusal(f"there is no method '{name}'")
    call, count = found
    if len(arguments) != count:
        raise Refusal(f"'{name}' takes {count} argument{'s' * (count != 1)}, not {len(arguments)}")
    value = _list(base, name)
    made = call(value, *arguments)
    if arguments and isinstance(arguments[-1], list | Struct):
        size(value)
    return made


def _list(value: Value, where: str) -> list[Any]:
    if type(value) not in (list, Pose):
        raise Refusal(f"'{where}' needs a list, not {kind(value)}")
    found: list[Any] = value
    return found


def _growing(value: list[Any], more: int) -> list[Any]:
    if type(value) is Pose:
        raise Refusal("a pose keeps its 6 numbers")
    if len(value) + more > LONGEST:
        raise Refusal(f"a list has at most {LONGEST} items")
    return value


def _within(value: list[Any], index: Value, last: int) -> int:
    at = integer(index, "an index")
    if not 0 <= at <= last:
        raise Refusal(f"index {at} is outside a list of {len(value)}")
    return at


def _append(value: list[Any], item: Any) -> None:
    _growing(value, 1).append(item)


def _extend(value: list[Any], other: Any) -> None:
    more = _list(other, "extend")
    _growing(value, len(more)).extend(copied(more))


def _insert(value: list[Any], index: Any, item: Any) -> None:
    _growing(value, 1).insert(_within(value, index, len(value)), item)


def _remove(value: list[Any], index: Any) -> None:
    del _growing(value, 0)[_within(value, index, len(value) - 1)]


def _pop(value: list[Any]) -> Any:
    if not _growing(value, 0):
        raise Refusal("'pop' of an empty list")
    return value.pop()


def _clear(value: list[Any]) -> None:
    _growing(value, 0).clear()


def _index(value: list[Any], item: Any) -> int:
    return next((i for i, other in enumerate(value) if equal(other, item)), -1)


def _slice(value: list[Any], begin: Any, end: Any) -> list[Any]:
    last = _within(value, end, len(value))
    return list(value[_within(value, begin, last) : last])


_METHODS: dict[str, tuple[Callable[..., Any], int]] = {
    "append": (_append, 1),
    "clear": (_clear, 0),
    "extend": (_extend, 1),
    "index": (_index, 1),
    "insert": (_insert, 2),
    "length": (len, 0),
    "pop": (_pop, 0),
    "remove": (_remove, 1),
    "slice": (_slice, 2),
}


def _make_list(length: Value, initial_value: Value, capacity: Value) -> list[Any]:
    count = integer(length, "length")
    room = count if capacity is None else integer(capacity, "capacity")
    if not 0 <= count <= room <= LONGEST:
        raise Refusal(f"a list has 0 to {LONGEST} items, and no more than its capacity, not {count}")
    if count * size(initial_value) > LONGEST:
        raise Refusal(f"a list has at most {LONGEST} items")
    return [copied(initial_value) for _ in range(count)]


LISTS: tuple[Builtin, ...] = (
    builtin("get_list_length(v)", lambda v: len(_list(v, "get_list_length"))),
    builtin("make_list(length, initial_value, capacity)", _make_list, {"capacity": None}),
)
