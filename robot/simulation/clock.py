"""Process time: the one clock that the simulated robot and the simulated pump share."""

from __future__ import annotations

import selectors
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from selectors import SelectorKey


LONGEST_SLEEP = 0.008
"""Wall time for which a controller without cycles, as one that boots, does not listen, s."""


@dataclass(frozen=True)
class ProcessClock:
    """Turns the wall clock, which runs alike in all processes of a machine, into process time.

    Attributes:
        epoch: wall time, as `time.monotonic` gives it, at which process time is 0.
        scale: seconds of process time in a second of wall time.
    """

    epoch: float
    scale: float = 1.0

    def now(self) -> float:
        """Process time, s."""
        return self.at(time.monotonic())

    def at(self, wall: float) -> float:
        """Process time at a wall time, s."""
        return (wall - self.epoch) * self.scale


class CycleSelector(selectors.DefaultSelector):
    """Waits until the next cycle is due, and only then looks at what clients have sent.

    A program reads its registers once a cycle, so a client gains nothing by being heard at once; but to wake up for
    each of its packages costs a core as much as the cycle itself. A client that sends more than is taken from it at
    once is heard on without a wait.
    """

    def select(self, timeout: float | None = None) -> list[tuple[SelectorKey, int]]:
        """What has come; as that of any selector."""
        if timeout is None:
            return super().select(None)
        found = super().select(0.0)
        if not found and timeout > 0.0:
            time.sleep(min(timeout, LONGEST_SLEEP))
            found = super().select(0.0)
        return found
