"""Units of length that files come in, and the one rule for all of them.

The unit that a file states counts, and one that is given must agree with it; a file that states none is in the one
given; without either, surfaces and CSV are in mm and SVG in pixels of 1/96 inch, and other curve files are refused.
"""

from __future__ import annotations

from typing import Final

from twins.errors import FormatError

MM: Final = {
    "um": 1e-3,
    "mm": 1.0,
    "cm": 10.0,
    "dm": 100.0,
    "m": 1000.0,
    "km": 1e6,
    "mil": 0.0254,
    "in": 25.4,
    "ft": 304.8,
    "yd": 914.4,
}
"""Millimetres in a unit."""


def factor_to_mm(where: object, stated: object, given: str | None, otherwise: str | None = "mm") -> float:
    """What a file's coordinates are multiplied by.

    Args:
        where: the file, for the errors.
        stated: unit that the file states; None where it states none.
        given: unit that the caller gives, or None.
        otherwise: unit if there is neither; None to refuse the file.

    Raises:
        FormatError: there is none, they contradict one another, or a unit is none of `MM`.
    """
    if given is not None and given not in MM:
        raise FormatError(f"{where}: unknown unit {given!r}; choose one of {', '.join(MM)}")
    if stated is not None and (not isinstance(stated, str) or stated not in MM):
        raise FormatError(f"{where}: its unit {stated!r} is not known; save it in one of {', '.join(MM)}")
    if stated is not None and given is not None and stated != given:
        raise FormatError(
            f"{where}: is in {stated} as the file itself says, not in {given}; leave the unit out, or correct the file"
        )
    unit = stated or given or otherwise
    if unit is None:
        raise FormatError(f'{where}: does not say its unit; give it, for example `units="mm"`')
    return MM[unit]
