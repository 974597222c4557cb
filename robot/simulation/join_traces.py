"""Joins the traces of a simulated cell that was ended by force: `python -m robot.simulation.join_traces DIR`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from robot.errors import RobotError

from .deposition import write_deposition


def main() -> int:
    """Write `deposition.csv` into a folder; the exit code."""
    parser = argparse.ArgumentParser(description="Join robot.csv and pump.csv of a simulated cell.")
    parser.add_argument("folder", type=Path, metavar="DIR", help="where both are, and deposition.csv will be")
    try:
        print(write_deposition(parser.parse_args().folder))
    except RobotError as error:
        print(f"join_traces: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
