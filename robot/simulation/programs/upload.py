"""Reads the program that ur-rtde uploads.

It is not interpreted. It is recognised by the words "RTDE Control Script Loaded"; read from it are the register
offsets and the path moves that ur-rtde injected. Any other program is none that the simulated controller can run.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

SIGNATURE = "RTDE Control Script Loaded"
MOVE = re.compile(r"\s*(movej|movel|movep)\((p?)\[([^\]]*)\],a=([^,]*),v=([^,]*),r=([^)]*)\)")
SIGNAL = re.compile(r"\s*signal_async_progress\((\d+)\)")


@dataclass(frozen=True)
class PathEntry:
    """One injected path move: numbers in metres and rad, as printed in the script."""

    kind: str
    is_pose: bool
    numbers: tuple[float, ...]
    acceleration: float
    speed: float
    blend: float
    mark: int


@dataclass(frozen=True)
class Upload:
    """What is read from an uploaded control script."""

    int_offset: int
    float_offset: int
    path: tuple[PathEntry, ...]


def recognise(text: str) -> Upload | None:
    """The upload, if it is ur-rtde's control script.

    Raises:
        ValueError: it is, but does not look as that of version 1.6 does.
    """
    if SIGNATURE not in text:
        return None
    offsets = [re.search(rf"# {kind} register offset\n\s*(\d+)", text) for kind in ("int", "float")]
    injected = re.search(r"# inject move path\n(.*?)\n\s*end", text, re.DOTALL)
    if offsets[0] is None or offsets[1] is None or injected is None:
        raise ValueError("the control script has no register offsets or no place for path moves")
    path, mark = [], 0
    for line in injected[1].splitlines():
        if signal := SIGNAL.match(line):
            mark = int(signal[1])
        elif move := MOVE.match(line):
            numbers = tuple(float(number) for number in move[3].split(","))
            path.append(
                PathEntry(
                    move[1], bool(move[2]), numbers, float(move[4]), float(move[5]), float(move[6]), mark
                )
            )
    return Upload(int(offsets[0][1]), int(offsets[1][1]), tuple(path))
