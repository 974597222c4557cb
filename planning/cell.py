"""The cell: robot model and mounting, tool, bed, pump and its calibration (`configs/cells/*.toml`)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator

from twins import Plane, TwinsError

from .configuration import Table, find_configuration, parse_table, read_toml
from .errors import ConfigurationError
from .kinematics import arm

Array = npt.NDArray[np.float64]
Vector2 = tuple[float, float]
Vector3 = tuple[float, float, float]
Vector6 = tuple[float, float, float, float, float, float]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Port = Annotated[int, Field(ge=1, le=65535)]


class Robot(Table):
    """The arm.

    Attributes:
        model: a name of `planning.ARMS`.
        host: address of the controller.
        home_deg: joint angles at rest, degrees.
        joint_limit_deg: the same limit either way for each joint, degrees.
        joint_speed_deg: largest speed of each joint, degrees/s.
        acceleration: TCP acceleration, mm/s².
    """

    model: str
    host: str = "127.0.0.1"
    home_deg: Vector6
    joint_limit_deg: Vector6 = (360.0,) * 6
    joint_speed_deg: Vector6 = (120.0, 120.0, 180.0, 180.0, 180.0, 180.0)
    acceleration: Positive = 500.0

    @property
    def home(self) -> Array:
        """Joint angles at rest, shape (6,), rad."""
        return np.radians(self.home_deg)


class Tool(Table):
    """The nozzle.

    Attributes:
        tcp: nozzle tip in the flange frame: x, y, z in mm and a rotation vector in rad; z points out of the nozzle.
        heading_deg: turn of the tool about its own axis, degrees; 0 points its x axis along the bed's x axis.
        width_min, width_max: bead widths that the nozzle can lay, mm.
    """

    tcp: Vector6
    heading_deg: float = 0.0
    width_min: Positive = 1.0
    width_max: Positive = 100.0


class Bed(Table):
    """Where the part stands.

    Attributes:
        origin: the part's origin in the robot's base frame, mm.
        x_axis, y_axis: the part's x and y axes in the robot's base frame.
        size: the bed's extent along its axes, centred on its origin, mm.
        height: highest place above the bed where the nozzle may be, mm.
    """

    origin: Vector3
    x_axis: Vector3 = (1.0, 0.0, 0.0)
    y_axis: Vector3 = (0.0, 1.0, 0.0)
    size: Vector2
    height: Positive

    @field_validator("y_axis")
    @classmethod
    def _spans(cls, y_axis: Vector3) -> Vector3:
        if not any(y_axis):
            raise ValueError("must not be zero")
        return y_axis

    @property
    def plane(self) -> Plane:
        """The bed in the robot's base frame."""
        return Plane(np.array(self.origin), np.array(self.x_axis), np.array(self.y_axis))


class Pump(Table):
    """The pump and its calibration.

    Attributes:
        host, port: Modbus TCP address.
        registers: the register map, a shipped name, or a path beside the cell file.
        dead_time_s: from a command until the flow at the nozzle begins to answer, s.
        lag_s: time constant of the first-order answer, s.
        flow_max: largest flow, mm³/s.
        flow_min: smallest steady flow, mm³/s.
        period_s: time between two exchanges, s.
        transport: how Modbus gets there, where it is not as the register map says.
        flow_per_hz: calibrated flow at 1 Hz, mm³/s, of a drive that counts in Hz, where it is not as the map says.
        hose_length, hose_diameter: inside, between pump and nozzle, mm; without a length the hose holds nothing.
    """

    host: str = "127.0.0.1"
    port: Port = 5020
    registers: str = "generic"
    dead_time_s: NotNegative = 0.2
    lag_s: NotNegative = 0.2
    flow_max: Positive
    flow_min: NotNegative = 0.0
    period_s: Annotated[float, Field(gt=0, le=0.1)] = 0.02
    transport: Literal["tcp", "rtu over tcp"] | None = None
    flow_per_hz: Positive | None = None
    hose_length: NotNegative = 0.0
    hose_diameter: Positive = 35.0

    @property
    def hose_volume(self) -> float:
        """What the hose holds, mm³."""
        return 0.25 * math.pi * self.hose_diameter**2 * self.hose_length


class Cell(Table):
    """One robot cell."""

    name: str
    robot: Robot
    tool: Tool
    bed: Bed
    pump: Pump


def load_cell(name: str, beside: Path | None = None) -> Cell:
    """A cell by path or by the name of a shipped one.

    Raises:
        ConfigurationError: no such file, or a mistake in it.
    """
    path = find_configuration("cells", name, beside)
    cell = parse_table(Cell, read_toml(path), str(path))
    try:
        arm(cell.robot.model)
        _ = cell.bed.plane
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: [robot] model: {error}") from error
    except TwinsError as error:
        raise ConfigurationError(f"{path}: [bed]: {error}") from error
    beside_cell = [path.parent / cell.pump.registers, path.parent / f"{cell.pump.registers}.toml"]
    found = next((file for file in beside_cell if file.is_file()), None)
    if found is not None:
        return cell.model_copy(
            update={"pump": cell.pump.model_copy(update={"registers": str(found.resolve())})}
        )
    return cell
