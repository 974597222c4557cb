"""What a controller's version changes: CB3 controllers have PolyScope 3, e-Series and later ones PolyScope 5."""

from __future__ import annotations

from typing import TypeAlias

Version: TypeAlias = tuple[int, ...]
"""Major, minor, bugfix and build; what is left out counts as 0."""

SIMULATED: tuple[tuple[Version, Version], ...] = (((3, 0), (3, 15)), ((5, 0), (5, 25)))
"""First and last version of each family, CB3 and e-Series."""

E_SERIES = 5
"""Major version with which the e-Series began."""


def e_series(version: Version) -> bool:
    """Whether it is a controller of the e-Series or a later one, not a CB3."""
    return version[0] >= E_SERIES


def cycle_time(version: Version) -> float:
    """One cycle of the controller, s: 2 ms, and 8 ms of a CB3."""
    return 0.002 if e_series(version) else 0.008


def has(version: Version, cb3: Version | None, e: Version | None) -> bool:
    """Whether a version has what came with these versions of the two families; None: it never did."""
    since = e if e_series(version) else cb3
    return since is not None and version >= since
