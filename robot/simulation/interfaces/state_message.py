"""The controller's state as the primary and secondary ports tell it: a message of parts, one for each topic.

Every message and every part is an int32 length, itself counted, a byte for its kind and a body. Numbers are
big-endian, lengths in m. What is not simulated stands at rest; parts that are the manufacturer's own are left out.
"""

from __future__ import annotations

import math
import struct
import zlib
from typing import TYPE_CHECKING

from robot.simulation.machine import RuntimeState
from robot.simulation.motions.frame import metres
from robot.simulation.power import EMERGENCY, RobotMode, SafetyMode
from robot.simulation.versions import e_series

from .outputs import TEMPERATURE, TOOL_VOLTAGE, VOLTAGE, analog_output, joint_mode, powered, speed_scaling

if TYPE_CHECKING:
    from planning import Arm
    from robot.simulation.machine import Machine

STATE = 16
MODE, JOINTS, TOOL, BOARD, PLACE, KINEMATICS, CONFIGURATION, FORCE, ADDITIONAL = range(9)
TOOL_LINE, TOOL_MODES, SINGULARITY = 11, 12, 13

ROBOT_TYPES = {"ur5": 1, "ur10": 2, "ur3": 3, "ur16": 4, "ur20": 7, "ur30": 8}
BOX_TYPES = {False: 2, True: 5}  # of a CB3, of the e-Series
JOINT_DEFAULTS = (1.05, 1.4)  # rad/s, rad/s²
TOOL_DEFAULTS = (0.25, 1.2)  # m/s, m/s²
JOINT_ACCELERATION = 40.0  # rad/s²
TOOL_BAUD_RATE = 115200
IDLE_CHARACTERS = 1.5
TOOL_POWER_OFF = 239
TOOL_RUNNING = 253
EQUIVALENT_RADIUS = 0.25  # m


def framed(kind: int, body: bytes) -> bytes:
    """A message, or a part of one."""
    return struct.pack(">iB", 5 + len(body), kind) + body


def microseconds(machine: Machine) -> int:
    """The controller's clock."""
    return max(int(machine.time * 1e6), 0)


class StateMessage:
    """Packs the state of a machine; what never changes is packed once."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._newer = e_series(machine.version)
        self._fixed = framed(KINEMATICS, _kinematics(machine.arm)) + framed(
            CONFIGURATION, _configuration(machine)
        )
        if self._newer:
            line = struct.pack(">?iiiff", False, TOOL_BAUD_RATE, 0, 1, IDLE_CHARACTERS, IDLE_CHARACTERS)
            self._fixed += (
                framed(TOOL_LINE, line) + framed(TOOL_MODES, bytes(3)) + framed(SINGULARITY, bytes(2))
            )

    def packed(self) -> bytes:
        """The state now."""
        machine = self._machine
        reserved = b"\0" if self._newer else b""
        place = struct.pack(">12d", *metres(machine.state.pose), *metres(machine.tool_offset))
        additional = struct.pack(">B??", machine.freedrive, machine.power.on, False)
        return framed(
            STATE,
            framed(MODE, _mode(machine) + reserved)
            + framed(JOINTS, _joints(machine))
            + framed(TOOL, _tool(machine))
            + framed(BOARD, _board(machine))
            + framed(PLACE, place)
            + self._fixed
            + framed(FORCE, struct.pack(">7d", *machine.wrench, 0.0))
            + framed(ADDITIONAL, additional + reserved),
        )


def _mode(machine: Machine) -> bytes:
    return struct.pack(
        ">Q???????BBddd",
        microseconds(machine),
        True,  # a robot is there,
        True,  # and may be used
        machine.power.on,
        machine.safety in EMERGENCY,
        machine.safety is SafetyMode.PROTECTIVE_STOP,
        machine.runtime is RuntimeState.PLAYING,
        machine.runtime in (RuntimeState.PAUSING, RuntimeState.PAUSED),
        max(machine.mode, 0),
        0,  # position control
        machine.slider,
        speed_scaling(machine) * machine.slider,
        1.0,
    )


def _joints(machine: Machine) -> bytes:
    mode, voltage = joint_mode(machine), powered(machine, VOLTAGE)
    state = machine.state
    return b"".join(
        struct.pack(">dddffffB", q, q, speed, 0.0, voltage, TEMPERATURE, 0.0, mode)
        for q, speed in zip(state.joints, state.joint_speeds, strict=True)
    )


def _tool(machine: Machine) -> bytes:
    mode = TOOL_RUNNING if machine.mode is RobotMode.RUNNING else TOOL_POWER_OFF
    return struct.pack(
        ">BBddfBffB",
        *(0, 0, 0.0, 0.0),
        *(powered(machine, TOOL_VOLTAGE), machine.tool_voltage, 0.0, TEMPERATURE, mode),
    )


def _board(machine: Machine) -> bytes:
    one, two = analog_output(machine, 0), analog_output(machine, 1)
    kinds = machine.analog_output_types
    return struct.pack(
        ">iiBBddBBddffffBBBIBBB",
        *(machine.digital_inputs, machine.digital_outputs),
        *(0, 0, 0.0, 0.0),
        *(kinds & 1, kinds >> 1 & 1, one, two),
        *(TEMPERATURE, powered(machine, VOLTAGE), 0.0, 0.0),
        *(machine.safety, machine.safety is SafetyMode.REDUCED, 0),
        *(0, 0, 0, 0),
    )


def _kinematics(arm: Arm) -> bytes:
    """The nominal lengths, joint by joint, and a checksum of each."""
    theta, a, d, alpha = _denavit_hartenberg(arm)
    checksums = [zlib.crc32(struct.pack(">4d", *joint)) for joint in zip(theta, a, d, alpha, strict=True)]
    return struct.pack(">6I24dI", *checksums, *theta, *a, *d, *alpha, 0)


def _configuration(machine: Machine) -> bytes:
    arm, robot = machine.arm, machine.cell.robot
    limits = [value for most in machine.limit.tolist() for value in (-most, most)]
    motions = [value for most in robot.joint_speed_deg for value in (math.radians(most), JOINT_ACCELERATION)]
    theta, a, d, alpha = _denavit_hartenberg(arm)
    newer = e_series(machine.version)
    return struct.pack(
        ">12d12d5d24d4i",
        *limits,
        *motions,
        *(*JOINT_DEFAULTS, *TOOL_DEFAULTS, EQUIVALENT_RADIUS),
        *(*a, *d, *alpha, *theta),
        *(0, BOX_TYPES[newer], ROBOT_TYPES.get(robot.model.removesuffix("e"), 0), int(newer) + 1),
    )


def _denavit_hartenberg(arm: Arm) -> tuple[tuple[float, ...], ...]:
    """Theta (rad), a, d (m) and alpha (rad) of the six joints."""
    right = 0.5 * math.pi
    a = (0.0, arm.a2 * 0.001, arm.a3 * 0.001, 0.0, 0.0, 0.0)
    d = (arm.d1 * 0.001, 0.0, 0.0, arm.d4 * 0.001, arm.d5 * 0.001, arm.d6 * 0.001)
    return (0.0,) * 6, a, d, (right, 0.0, 0.0, right, -right, 0.0)
