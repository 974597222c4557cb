"""The functions about strings. A string is a row of bytes: what does not read as UTF-8 keeps its bytes all the same."""

from __future__ import annotations

import math
import re

from .errors import Refusal
from .functions import Builtin, builtin
from .values import LONGEST_STRING, Struct, Value, integer, kind, written

_NUMBER = re.compile(
    r"""\s*(?:(?P<hex>[+-]?0[xX][0-9a-fA-F]+)
    | (?P<whole>[+-]?\d+)
    | (?P<float>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)
    | (?P<other>[+-]?(?:inf(?:inity)?|nan)))$""",
    re.VERBOSE | re.ASCII | re.IGNORECASE,
)


def raw(value: Value, what: str) -> bytes:
    """The bytes of a string.

    Raises:
        Refusal: it is none.
    """
    if type(value) is not str:
        raise Refusal(f"{what} must be a string, not {kind(value)}")
    try:
        return value.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError:
        return value.encode("utf-8", "replace")


def text(data: bytes) -> str:
    """The string of such bytes."""
    return data.decode("utf-8", "surrogateescape")


def limited(value: str) -> str:
    """The string, if it is not too long.

    Raises:
        Refusal: it is.
    """
    if len(value) > LONGEST_STRING or len(raw(value, "a string")) > LONGEST_STRING:
        raise Refusal(f"a string has at most {LONGEST_STRING} characters")
    return value


def shown(value: Value) -> str:
    """A value as part of a message.

    Raises:
        Refusal: it is a struct or nothing.
    """
    if value is None or type(value) is Struct:
        raise Refusal(f"{kind(value)} cannot be written")
    return value if isinstance(value, str) else written(value)


def _at(source: Value, index: Value) -> str:
    data, at = raw(source, "src"), integer(index, "index")
    if not 0 <= at < len(data):
        raise Refusal(f"index {at} is outside a string of {len(data)}")
    return text(data[at : at + 1])


def _find(source: Value, target: Value, start: Value) -> int:
    at = integer(start, "start_from")
    if at < 0:
        raise Refusal(f"start_from must be 0 or above, not {at}")
    return raw(source, "src").find(raw(target, "target"), at)


def _sub(source: Value, index: Value, length: Value) -> str:
    data, at = raw(source, "src"), integer(index, "index")
    count = len(data) - at if length is None else integer(length, "len")
    if not (0 <= at <= len(data) and count >= 0):
        raise Refusal(f"characters {at} to {at + count} are outside a string of {len(data)}")
    return text(data[at : at + count])


def _number(value: Value) -> int | float:
    found = _NUMBER.match(text(raw(value, "str")))
    if found is None:
        raise Refusal(f"'{value}' is no number")
    if found["hex"] is not None or found["whole"] is not None:
        written_out = found[0].strip()
        whole = int(written_out, 16) if found["hex"] is not None else float(written_out)
        return integer(float(whole), "the number")
    made = float(found[0])
    if math.isinf(made) and found["other"] is None:
        raise Refusal(f"'{value}' is beyond what a float holds")
    return made


STRINGS: tuple[Builtin, ...] = (
    builtin("str_cat(op1, op2)", lambda op1, op2: limited(shown(op1) + shown(op2))),
    builtin("str_at(src, index)", _at),
    builtin("str_empty(str)", lambda value: not raw(value, "str")),
    builtin("str_find(src, target, start_from)", _find, {"start_from": 0}),
    builtin("str_len(str)", lambda value: len(raw(value, "str"))),
    builtin("str_sub(src, index, len)", _sub, {"len": None}),
    builtin("to_num(str)", _number),
    builtin("to_str(val)", lambda val: limited(shown(val))),
    builtin("is_num(str)", lambda value: _NUMBER.match(text(raw(value, "str"))) is not None),
)
