"""A simulated cell that runs until it is ended."""

from __future__ import annotations

import signal
import threading
from typing import Any

from rich.console import Console

from robot.simulation import SimulatedCell

LOOKED_AT = 0.2  # s of wall time between two looks at what the simulators say


def simulate_cell(cell: str, console: Console, **options: Any) -> None:
    """Keep a simulated cell running until Ctrl-C, and show what its simulators say.

    Args:
        cell: a cell file, or the name of a shipped one.
        console: where.
        options: of `SimulatedCell.start`.

    Raises:
        ConfigurationError: there is no such cell, or it or the script of faults is wrong.
        RobotError: it does not start, or ends by itself.
    """

    def say(text: str) -> None:
        console.print(text, highlight=False, markup=False, soft_wrap=True)

    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    with SimulatedCell.start(cell, **options) as simulated:
        # An exception may be raised where it gets lost, in a finaliser; a flag does not.
        signal.signal(signal.SIGINT, lambda *_: ended.set())
        say(
            f"simulated cell at {simulated.host}: robot, version {options.get('version', '5.12')}, "
            f"on 30004 (RTDE), 29999, 30001 to 30003; "
            f"pump on {simulated.pump_port}; time scale {simulated.time_scale:g}; Ctrl-C ends it"
        )
        while not ended.wait(LOOKED_AT):
            for line in simulated.news():
                say(line)
            simulated.check()
        for line in simulated.news():
            say(line)
    if simulated.trace is not None:
        say(f"traces in {simulated.trace}")
