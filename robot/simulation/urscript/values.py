"""The values that a program computes with, and its arithmetic.

Booleans, 32-bit integers, floats, strings, lists, poses and structs; a list or a pose is copied when it is given to a
variable. Whole numbers wrap around at 32 bits; a division always gives a float. Lists of numbers of the same length
are added and subtracted item by item, and multiplied and divided by a number. A list of lists of the same length is a
matrix, and is multiplied as one.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from .errors import Refusal

LONGEST = 10_000
"""Most items of a list, those of lists in it counted too."""

LONGEST_STRING = 1023
"""Most bytes of a string."""

DEEPEST = 20
"""Lists within one another."""


class Pose(list[float]):
    """A pose `p[x, y, z, rx, ry, rz]`: m and a rotation vector in rad."""

    __slots__ = ()


class Struct(dict[str, Any]):
    """A struct: values by name."""

    __slots__ = ()


class Thread(int):
    """The handle of a thread; 0 is none."""

    __slots__ = ()


Value: TypeAlias = Any
"""One of these, or None: what a function without `return` gives."""

_KINDS: dict[type, str] = {
    bool: "a boolean",
    int: "an integer",
    Thread: "a thread",
    float: "a float",
    str: "a string",
    list: "a list",
    Pose: "a pose",
    Struct: "a struct",
    type(None): "nothing",
}
_NUMBERS = frozenset({int, float, Thread})
_SHARED = frozenset({list, Pose, Struct})


def kind(value: Value) -> str:
    """What a value is, for messages."""
    return _KINDS.get(type(value), type(value).__name__)


def copied(value: Value) -> Any:
    """The value for a variable of its own."""
    of = type(value)
    if of not in _SHARED:
        return value
    if of is Struct:
        return Struct({name: copied(item) for name, item in value.items()})
    if _SHARED.isdisjoint(map(type, value)):
        return of(value)
    return [copied(item) for item in value]


def size(value: Value, deep: int = 0) -> int:
    """Items of a value, those of lists in it counted too; 1 of what is no list.

    Raises:
        Refusal: it is deeper or larger than a value may be.
    """
    if type(value) not in _SHARED:
        return 1
    if deep > DEEPEST:
        raise Refusal(f"lists are more than {DEEPEST} levels deep")
    parts = value.values() if type(value) is Struct else value
    found = 1 + len(parts)
    if not _SHARED.isdisjoint(map(type, parts)):
        for part in parts:
            if type(part) in _SHARED:
                found += size(part, deep + 1)
                if found > LONGEST:
                    break
    if found > LONGEST + 1:
        raise Refusal(f"a list has at most {LONGEST} items")
    return found


def listed(*parts: Value) -> list[Any]:
    """[...], of copies.

    Raises:
        Refusal: it would be deeper or larger than a list may be.
    """
    found = list(parts)
    if len(found) > LONGEST or not _SHARED.isdisjoint(map(type, found)):
        size(found)
        return copied(found)  # type: ignore[no-any-return]
    return found


def truth(value: Value) -> bool:
    """A condition: a boolean, a number other than 0, a string that is not empty.

    Raises:
        Refusal: it is none of them.
    """
    if value is True or value is False:
        return value
    if type(value) in _NUMBERS or type(value) is str:
        return bool(value)
    raise Refusal(f"a condition must be True or False, not {kind(value)}")


def number(value: Value, what: str = "a value") -> float:
    """A number as a float.

    Raises:
        Refusal: it is none.
    """
    if type(value) in _NUMBERS:
        return float(value)
    raise Refusal(f"{what} must be a number, not {kind(value)}")


def integer(value: Value, what: str = "a value") -> int:
    """A whole number; what stands behind the point of a float is left out.

    Raises:
        Refusal: it is none, or beyond 32 bits.
    """
    if type(value) is int:
        return value
    found = number(value, what)
    if not -(2.0**31) <= found < 2.0**31:
        raise Refusal(f"{what} is beyond 32 bits: {found:g}")
    return int(found)


def numbers(value: Value, count: int, what: str) -> list[float]:
    """A list or pose of so many numbers.

    Raises:
        Refusal: it is none.
    """
    if type(value) not in (list, Pose) or len(value) != count:
        has = f" of {len(value)}" if isinstance(value, list) else ""
        raise Refusal(f"{what} must be {count} numbers, not {kind(value)}{has}")
    return [finite(item, what) for item in value]


def finite(value: Value, what: str) -> float:
    """A number that is one: registers may hold others.

    Raises:
        Refusal: it is none.
    """
    found = number(value, what)
    if not math.isfinite(found):
        raise Refusal(f"{what} must be finite, not {found}")
    return found


def wrapped(value: int) -> int:
    """A whole number in 32 bits."""
    return value if -0x80000000 <= value < 0x80000000 else (value + 0x80000000 & 0xFFFFFFFF) - 0x80000000


# -- arithmetic


def _two(sign: str, of: Callable[[Any, Any], Any], a: Value, b: Value) -> Any:
    if type(a) is int and type(b) is int:
        return wrapped(of(a, b))
    if type(a) in _NUMBERS and type(b) in _NUMBERS:
        return float(of(a, b))
    raise Refusal(f"{kind(a)} {sign} {kind(b)} has no meaning")


def _by_item(sign: str, of: Callable[[Any, Any], Any], a: list[Any], b: list[Any]) -> list[Any]:
    if len(a) != len(b):
        raise Refusal(f"lists of {len(a)} and {len(b)} items have no {sign}")
    return [of(x, y) for x, y in zip(a, b, strict=True)]


def is_matrix(value: Value) -> bool:
    """Whether it is a list of lists."""
    return type(value) is list and bool(value) and type(value[0]) is list


def array(value: Value, what: str) -> npt.NDArray[np.float64]:
    """A list or a matrix of numbers, shape (n,) or (n, m).

    Raises:
        Refusal: it is none.
    """
    if type(value) not in (list, Pose) or not value:
        raise Refusal(f"{what} must be a list of numbers, not {kind(value)}")
    rows = value if is_matrix(value) else [value]
    if any(type(row) not in (list, Pose) or len(row) != len(rows[0]) for row in rows):
        raise Refusal(f"{what} must have rows of the same length")
    found = np.array([[number(item, "an item") for item in row] for row in rows])
    return found if rows is value else found[0]


def _product(a: Value, b: Value) -> list[Any]:
    """Of a matrix and a matrix or a list, or of a list and a matrix."""
    left, right = array(a, "a matrix"), array(b, "a matrix")
    if left.shape[-1] != right.shape[0]:
        raise Refusal(f"{shape(a)} * {shape(b)} have no product")
    found: list[Any] = (left @ right).tolist()
    size(found)
    return found


def shape(value: Value) -> str:
    """The size of a list or matrix, for messages."""
    return f"a {len(value)} by {len(value[0])} matrix" if is_matrix(value) else f"a list of {len(value)}"


def add(a: Value, b: Value) -> Any:
    """a + b."""
    if type(a) is float and type(b) is float:
        return a + b
    if type(a) is int and type(b) is int:
        return wrapped(a + b)
    if type(a) is list and type(b) is list:
        return _by_item("+", add, a, b)
    return _two("+", operator.add, a, b)


def subtract(a: Value, b: Value) -> Any:
    """a - b."""
    if type(a) is float and type(b) is float:
        return a - b
    if type(a) is list and type(b) is list:
        return _by_item("-", subtract, a, b)
    return _two("-", operator.sub, a, b)


def multiply(a: Value, b: Value) -> Any:
    """a * b."""
    if type(a) is float and type(b) is float:
        return a * b
    if type(a) is list and type(b) in _NUMBERS:
        return [multiply(item, b) for item in a]
    if type(b) is list and type(a) in _NUMBERS:
        return [multiply(a, item) for item in b]
    if (is_matrix(a) and type(b) is list) or (type(a) is list and is_matrix(b)):
        return _product(a, b)
    return _two("*", operator.mul, a, b)


def divide(a: Value, b: Value) -> Any:
    """a / b, always a float."""
    if type(a) is list and type(b) in _NUMBERS:
        return [divide(item, b) for item in a]
    divisor = number(b, "a divisor")
    if divisor == 0.0:
        raise Refusal("division by zero")
    return number(a, "a dividend") / divisor


def remainder(a: Value, b: Value) -> Any:
    """a % b, with the sign of a."""
    if number(b, "a divisor") == 0.0:
        raise Refusal("remainder of a division by zero")
    found = _two("%", math.fmod, a, b) if float in (type(a), type(b)) else None
    return found if found is not None else _two("%", lambda x, y: int(math.fmod(x, y)), a, b)


def negative(a: Value) -> Any:
    """-a."""
    if type(a) is list:
        return [negative(item) for item in a]
    return _two("-", operator.sub, 0, a) if type(a) is not float else -a


def _comparison(sign: str, of: Callable[[Any, Any], bool]) -> Callable[[Value, Value], bool]:
    def compare(a: Value, b: Value) -> bool:
        if type(a) in _NUMBERS and type(b) in _NUMBERS:
            return of(a, b)
        raise Refusal(f"{kind(a)} {sign} {kind(b)} has no meaning")

    return compare


less, at_most = _comparison("<", operator.lt), _comparison("<=", operator.le)
more, at_least = _comparison(">", operator.gt), _comparison(">=", operator.ge)


def equal(a: Value, b: Value) -> bool:
    """a == b; values of different kinds differ, whole and other numbers are compared."""
    return a == b and (type(a) is bool) == (type(b) is bool)


def differ(a: Value, b: Value) -> bool:
    """a != b."""
    return not equal(a, b)


def either(a: Value, b: Value) -> bool:
    """a xor b."""
    return truth(a) is not truth(b)


# -- parts of values


def pose(*items: Value) -> Pose:
    """p[...]."""
    return Pose([number(item, "a pose's item") for item in items])


def _place(base: Value, index: Value) -> int:
    if type(base) not in (list, Pose):
        raise Refusal(f"{kind(base)} has no items")
    if type(index) is not int:
        raise Refusal(f"an index must be an integer, not {kind(index)}")
    if not 0 <= index < len(base):
        raise Refusal(f"index {index} is outside a list of {len(base)}")
    return index


def item(base: Value, index: Value) -> Any:
    """base[index]."""
    if type(index) is int and type(base) in (list, Pose) and 0 <= index < len(base):
        return base[index]
    return base[_place(base, index)]


def put(base: Value, index: Value, value: Value) -> None:
    """base[index] = value."""
    at = _place(base, index)
    if type(base) is Pose:
        base[at] = number(value, "a pose's item")
        return
    before = base[at]
    alike = type(before) is type(value) or (type(before) in _NUMBERS and type(value) in _NUMBERS)
    if not alike:
        raise Refusal(f"an item that is {kind(before)} cannot become {kind(value)}")
    base[at] = copied(value)
    if type(value) in _SHARED:
        size(base)


def member(base: Value, name: str) -> Any:
    """base.name."""
    if type(base) is not Struct:
        raise Refusal(f"{kind(base)} has no member '{name}'")
    if name not in base:
        raise Refusal(f"the struct has no member '{name}'")
    return base[name]


def put_member(base: Value, name: str, value: Value) -> None:
    """base.name = value."""
    before = member(base, name)
    if type(before) is not type(value) and not (type(before) in _NUMBERS and type(value) in _NUMBERS):
        raise Refusal(f"member '{name}' is {kind(before)} and cannot become {kind(value)}")
    base[name] = copied(value)
    if type(value) in _SHARED:
        size(base)


def written(value: Value) -> str:
    """A value as `textmsg` and `to_str` write it: floats to 6 decimals, without the zeros at their end."""
    of = type(value)
    if of is float:
        return f"{value:.6f}".rstrip("0").rstrip(".") if math.isfinite(value) else str(value)
    if of is Pose:
        return "p[" + ", ".join(map(written, value)) + "]"
    if of is list:
        return "[" + ", ".join(map(written, value)) + "]"
    if of is Struct:
        return "{" + ", ".join(f"{name}: {written(part)}" for name, part in value.items()) + "}"
    return "nothing" if value is None else str(value)
