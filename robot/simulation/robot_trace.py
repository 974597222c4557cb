"""What the simulated robot did: a table of its tool's motion over process time."""

from __future__ import annotations

import math
import sys
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType
    from typing import Self

    from .machine import Machine

PERIOD = 0.01
"""Least process time between two rows, s."""

FLUSHED = 0.5
"""Most wall time for which rows are kept in memory, s."""

COLUMNS = ("time_s", "x_mm", "y_mm", "z_mm", "rx_rad", "ry_rad", "rz_rad", "speed_mm_s")


class RobotTrace:
    """A file that grows by a row at most every `PERIOD`."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", encoding="ascii", buffering=1 << 16)
        self._file.write(",".join(COLUMNS) + "\n")
        self._due = -math.inf
        self._flushed = 0.0

    def record(self, machine: Machine) -> None:
        """Write where the tool is, if it is time."""
        now = machine.time
        if now < self._due:
            return
        self._due = max(self._due + PERIOD, now)
        state = machine.state
        speed = math.hypot(*state.tool_speed[:3])
        row = "%.6f,%.5f,%.5f,%.5f,%.7f,%.7f,%.7f,%.4f\n" % (now, *state.pose, speed)  # noqa: UP031 - faster
        wall = time.monotonic()
        try:
            self._file.write(row)
            if wall - self._flushed > FLUSHED:
                self._flushed = wall
                self._file.flush()
        except OSError as error:  # the disk is full; the robot goes on
            self._due = math.inf
            print(f"controller: the trace ends: {error}", file=sys.stderr, flush=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
