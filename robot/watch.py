"""The guard: decides when a print may not go on. It only ever stops, at once and for good.

It hears the robot through the supervisor's own listener and the arm process through its heartbeats, and stops on

- a safety status other than normal or reduced, power lost, the connection lost;
- a program that does not run, outside the short window in which the arm process uploads the next one;
- 100 ms without a word from the robot or the arm process.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable

from .robot_state import RobotState

SILENCE = 0.1
"""Longest wall time without a word, s."""

ROUND = 0.01
"""Wall time between two looks at the clocks, s."""

STALL = 0.03
"""A look this late says that this process itself was held up, s: what waits in its sockets is heard first, once."""

WINDOW_MAX = 5.0
"""Longest window that is granted for an upload, s."""

ORDER = 0.2
"""Time after an order within which the arm process says that it is uploading, s; the robot may show it first."""

SETTLE = 0.05
"""Time for which states from before the end of a window may still arrive, s."""

HELD_UP = 0.07
"""A silence of the arm process that may have cost the controller's watchdog its kicks, s: they come every 20 ms, and it
waits for 100.
"""

MEMORY = 0.05
"""Time within which the robot shows a program that stopped in such a silence, s."""

SAFETY = {
    2: "protective stop",
    3: "recovery mode",
    4: "safeguard stop",
    5: "emergency stop (system)",
    6: "emergency stop (robot)",
    7: "emergency stop",
    8: "safety violation",
    9: "safety fault",
    10: "stopped by the safety system",
}
"""Bits of `safety_status_bits` that stop a print."""


def unsafe(state: RobotState) -> str | None:
    """What keeps a robot in this state from moving, or None."""
    if not state.powered:
        return "the robot has no power; switch it on and release the brakes"
    found = [name for bit, name in SAFETY.items() if state.safety >> bit & 1]
    return f"the robot reports: {', '.join(found)}; clear it at the pendant" if found else None


class Guard:
    """Watches over one print.

    Args:
        stop: called once, with the reason, at the moment when the print has to stop.
    """

    def __init__(self, stop: Callable[[str], None]) -> None:
        self._stop = stop
        self._armed = False
        self._robot_heard = self._arm_heard = self._window_end = self._order_end = 0.0
        self._silent_from = 0.0  # the arm process, as far as this process can tell
        self._held_up, self._held_up_end = 0.0, -math.inf

    def arm(self) -> None:
        """Begin to watch: the robot's program runs and both sides are heard."""
        self._robot_heard = self._arm_heard = self._silent_from = time.monotonic()
        self._armed = True

    def disarm(self) -> None:
        """End watching: the print is over."""
        self._armed = False

    def see(self, state: RobotState) -> None:
        """Judge a state of the robot."""
        before, self._robot_heard = self._robot_heard, time.monotonic()
        if self._robot_heard - before > STALL:  # neither was heard
            self._silent_from = max(self._silent_from, self._robot_heard)
            self._held_up_end = -math.inf
        if not self._armed:
            return
        reason = unsafe(state)
        if (
            reason is None
            and not state.playing
            and self._robot_heard > max(self._window_end, self._order_end)
        ):
            reason = f"the program on the controller was stopped or paused{self._silence()}"
        if reason is not None:
            self._trip(reason)

    def hear(self, window: float) -> None:
        """Note a word from the arm process, which may now be silent for `window` seconds."""
        before, self._arm_heard = self._arm_heard, time.monotonic()
        if self._arm_heard - self._silent_from > HELD_UP:
            self._held_up, self._held_up_end = self._arm_heard - self._silent_from, self._arm_heard
        self._silent_from = self._arm_heard + min(max(window, 0.0), WINDOW_MAX)
        if window > 0:
            self._window_end = self._silent_from
        elif before < self._window_end:
            self._window_end = min(self._window_end, self._arm_heard + SETTLE)

    def expect(self) -> None:
        """Note that the arm process is about to be given an order, for which it uploads a program."""
        self._order_end = time.monotonic() + ORDER

    def lose(self, what: str) -> None:
        """Note that a connection or a process has ended."""
        if self._armed:
            self._trip(what)

    async def patrol(self) -> None:
        """Look at the clocks until cancelled."""
        before = time.monotonic()
        excused = False
        while True:
            await asyncio.sleep(ROUND)
            now = time.monotonic()
            excused = now - before >= STALL and not excused
            if self._armed and not excused:
                if now - self._robot_heard > SILENCE:
                    self._trip(f"the robot has been silent for {now - self._robot_heard:.2f} s")
                elif now - self._arm_heard > SILENCE and now > self._window_end:
                    self._trip(f"the arm process has been silent for {now - self._arm_heard:.2f} s")
            before = now

    def _silence(self) -> str:
        """What is to be added where the arm process has just been, or still is, silent for long enough."""
        now = time.monotonic()
        silent = max(now - self._silent_from, self._held_up if now - self._held_up_end < MEMORY else 0.0)
        if silent < HELD_UP:
            return ""
        return (
            f"; the arm process had been silent for {silent:.2f} s, and the controller's watchdog waits for 0.1 s: if "
            "nobody stopped it, leave this computer to the print"
        )

    def _trip(self, reason: str) -> None:
        self._armed = False
        self._stop(reason)
