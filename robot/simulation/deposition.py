"""What lies where: the motion of the simulated robot and the flow of the simulated pump as one trace."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt

from robot.errors import RobotError

ROBOT_FILE, PUMP_FILE, DEPOSITION_FILE = "robot.csv", "pump.csv", "deposition.csv"
COLUMNS = ("time_s", "x_mm", "y_mm", "z_mm", "flow_mm3_s", "volume_mm3", "age_s", "path_mm")

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class RobotMotion:
    """Where the tool was.

    Attributes:
        time: process time, rising, shape (n,), s.
        position: of the tool, shape (n, 3), mm.
    """

    time: Floats
    position: Floats


@dataclass(frozen=True)
class PumpFlow:
    """What left the nozzle.

    Attributes:
        time: process time, rising, shape (m,), s.
        volume: since the beginning, shape (m,), mm³.
        age: of what leaves then, shape (m,), s; NaN where it is not known.
    """

    time: Floats
    volume: Floats
    age: Floats


@dataclass(frozen=True)
class Deposition:
    """What left the nozzle on the way of the tool, row by row.

    Attributes:
        time: process time, shape (n,), s.
        position: of the nozzle then, shape (n, 3), mm.
        flow: mean since the row before, 0 in the first, shape (n,), mm³/s.
        volume: since the first row, shape (n,), mm³: flows and times add up to it.
        age: of what leaves then, shape (n,), s; NaN where it is not known.
        path: length of the tool's way since the first row, shape (n,), mm.
    """

    time: Floats
    position: Floats
    flow: Floats
    volume: Floats
    age: Floats
    path: Floats


def deposition(robot: RobotMotion, pump: PumpFlow) -> Deposition:
    """Join both by process time, at the robot's times.

    Where the pump's trace is longer it adds its first and last time, with the tool resting where it was seen first or
    last: no volume is lost. Between its own times the pump's volume rises evenly.
    """
    ends = pump.time[[0, -1]] if len(pump.time) else pump.time
    before, after = ends[:1] < robot.time[0], ends[1:] > robot.time[-1]
    time = np.concatenate([ends[:1][before], robot.time, ends[1:][after]])
    position = np.concatenate(
        [
            robot.position[:1].repeat(before.sum(), 0),
            robot.position,
            robot.position[-1:].repeat(after.sum(), 0),
        ]
    )
    volume, age = np.zeros(len(time)), np.full(len(time), np.nan)
    if len(pump.time):
        volume = np.interp(time, pump.time, pump.volume) - pump.volume[0]
        age = np.interp(time, pump.time, pump.age)
    flow = np.concatenate([[0.0], np.diff(volume) / np.diff(time)])
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    return Deposition(time, position, flow, volume, age, np.concatenate([[0.0], np.cumsum(steps)]))


def read_deposition(folder: Path) -> Deposition:
    """Join the traces that a simulated cell left in a folder.

    Raises:
        RobotError: one is missing, or is not such a trace.
    """
    robot = _columns(folder / ROBOT_FILE, ("time_s", "x_mm", "y_mm", "z_mm"))
    pump = _columns(folder / PUMP_FILE, ("time_s", "volume_mm3", "age_s"))
    if not len(robot):
        raise RobotError(f"{folder / ROBOT_FILE}: no rows; the cell ended before it began")
    age = np.where(np.isfinite(pump[:, 2]), pump[:, 2], np.nan)
    return deposition(RobotMotion(robot[:, 0], robot[:, 1:]), PumpFlow(pump[:, 0], pump[:, 1], age))


def write_deposition(folder: Path) -> Path:
    """Write `deposition.csv` beside the traces that it joins; its path.

    Raises:
        RobotError: see `read_deposition`.
    """
    found = read_deposition(folder)
    rows = np.column_stack(
        [found.time, found.position, found.flow, found.volume, found.age, found.path],
    )
    path = folder / DEPOSITION_FILE
    formats = ["%.6f", "%.5f", "%.5f", "%.5f", "%.6f", "%.6f", "%.4f", "%.4f"]
    np.savetxt(path, rows, fmt=formats, delimiter=",", header=",".join(COLUMNS), comments="")
    return path


def _columns(path: Path, names: tuple[str, ...]) -> Floats:
    """Columns of a trace, shape (n, len(names)), in the order of time; a last line that was cut off is left out."""
    try:
        text = path.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise RobotError(f"{path}: cannot be read as a trace: {error}") from error
    header, _, rest = text.partition("\n")
    there = header.split(",")
    missing = [name for name in names if name not in there]
    if missing:
        raise RobotError(f"{path}: no column '{missing[0]}' (columns: {', '.join(there)})")
    lines = rest[: rest.rfind("\n") + 1].splitlines()
    if not lines:
        return np.zeros((0, len(names)))
    try:
        table = np.loadtxt(lines, delimiter=",", ndmin=2, usecols=[there.index(name) for name in names])
    except ValueError as error:
        raise RobotError(f"{path}: not a trace: {error}") from error
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(table[:, 0])) > 0.0])
    return cast("Floats", table[rising])
