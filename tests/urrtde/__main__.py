"""A tour of every ur-rtde client of one robot: `python urrtde HOST VERSION RANGE`; a line of JSON for each step.

ur-rtde ends its process when a connection is cut, so its clients live here, in a process of their own.
"""

from __future__ import annotations

import faulthandler
import importlib
import json
import sys
import time
import traceback

from session import STEPS, Session

LONGEST_STEP = 15.0
"""Wall time, s."""

ORDER = ("moves", "questions", "streams", "programs", "others")


def tell(**values) -> None:
    print("\n@" + json.dumps(values), flush=True)


def main() -> None:
    host, version, registers = sys.argv[1:4]
    only = sys.argv[4:]
    for name in ORDER:
        importlib.import_module(name)
    faulthandler.dump_traceback_later(LONGEST_STEP, exit=True)
    major, minor = version.split(".")
    robot = Session(host, (int(major), int(minor)), upper=registers == "upper")
    tell(step="constructed", values={"made_in": robot.made_in}, called={})
    for name, function in STEPS:
        if only and name not in only:
            continue
        begun = time.monotonic()
        faulthandler.dump_traceback_later(LONGEST_STEP, exit=True)  # ur-rtde may wait for ever
        try:
            robot.ready()
            values, error = function(robot), None
        except Exception:
            values, error = None, traceback.format_exc()
        called = {interface: sorted(names) for interface, names in robot.called.items()}
        tell(step=name, values=values, error=error, called=called, took=time.monotonic() - begun)


if __name__ == "__main__":
    main()
