"""Units of length that drawings come in."""

from __future__ import annotations

from pathlib import Path

from twins.errors import FormatError

MM = {
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


def mm_in_unit(path: Path, said: object, given: str | None) -> float:
    """Millimetres in the unit of a file: the one the file says, or else the one that is given.

    Args:
        path: of the file, for the errors.
        said: unit that the file names; None where it names none.
        given: unit that the caller names, or None.

    Raises:
        FormatError: neither is known, they contradict one another, or a unit is none of `MM`.
    """
    if given is not None and given not in MM:
        raise FormatError(f"{path}: units must be one of {', '.join(MM)}, not {given!r}")
    if said is None and given is None:
        raise FormatError(f'{path}: does not say its unit; give it, for example units="mm"')
    if said is not None and (not isinstance(said, str) or said not in MM):
        raise FormatError(f"{path}: its unit {said!r} is not known; save it in one of {', '.join(MM)}")
    if said is not None and given is not None and said != given:
        raise FormatError(
            f"{path}: says that its unit is {said}, not {given}; leave units out, or correct the file"
        )
    return MM[str(said if said is not None else given)]
