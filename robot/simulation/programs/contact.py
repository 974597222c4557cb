"""Functions that feel or give way: force mode, freedrive, contact and the force sensor.

Nothing touches the simulated tool and no hand leads it. So the tool makes no contact, stands still in freedrive, and
in force mode runs at the speed limit of each compliant axis that is asked for a force which nothing answers. The
wrench at the tool is what a client writes as `external_force_torque`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from planning.pose import pose_from_vector
from robot.simulation.motions.streaming import SpeedMotion
from robot.simulation.urscript import Refusal, builtin
from robot.simulation.urscript.values import Pose, Value, integer, number, numbers, truth

if TYPE_CHECKING:
    from collections.abc import Iterator

    from robot.simulation.machine import Machine
    from robot.simulation.urscript import Builtin

FIXED_FRAME = 2
"""The type of force mode whose frame stays where it is."""

GIVING_WAY = 1000.0
"""Acceleration along a compliant axis, mm/s²; the same number of mrad/s² about one."""


def contact_functions(machine: Machine) -> Iterator[Builtin]:
    """The functions of one machine."""
    force = _ForceMode(machine)
    yield builtin("force_mode(task_frame, selection_vector, wrench, type, limits)", force.start)
    yield builtin("end_force_mode()", force.end)
    yield builtin("force_mode_set_damping(damping)", lambda damping: _share(damping, 1.0))
    yield builtin("force_mode_set_gain_scaling(scaling)", lambda scaling: _share(scaling, 2.0))
    yield builtin("tool_contact(direction)", _no_contact, {"direction": None})
    yield builtin("zero_ftsensor()", machine.zero_force_sensor)
    yield builtin("get_tcp_force()", lambda: list(machine.wrench))
    yield builtin("get_tcp_wrench()", lambda: list(machine.wrench))
    yield builtin("force()", lambda: math.hypot(*machine.wrench[:3]))
    for name in ("ft_rtde_input_enable", "enable_external_ft_sensor"):
        yield builtin(
            f"{name}(enable, *sensor_mass, *sensor_measuring_offset, *sensor_cog)",
            lambda enable: truth(enable) and None,
            {"sensor_mass": 0.0, "sensor_measuring_offset": None, "sensor_cog": None},
        )

    def freedrive(free: bool) -> None:
        machine.freedrive = free

    defaults = {"freeAxes": None, "feature": None}
    yield builtin("freedrive_mode(*freeAxes, *feature)", lambda: freedrive(True), defaults)
    yield builtin("teach_mode()", lambda: freedrive(True))
    yield builtin("end_freedrive_mode()", lambda: freedrive(False))
    yield builtin("end_teach_mode()", lambda: freedrive(False))
    yield builtin("get_freedrive_status()", lambda: 0)  # no constraint is near
    yield builtin(
        "get_actual_joint_positions_history(steps)", lambda steps: _past(machine, steps), {"steps": 0}
    )


def _share(value: Value, most: float) -> None:
    found = number(value, "the scaling")
    if not 0.0 <= found <= most:
        raise Refusal(f"a number from 0 to {most:g} is needed, not {found:g}")


def _no_contact(direction: Value) -> int:
    if direction is not None:
        numbers(direction, 6, "direction")
    return 0


def _past(machine: Machine, steps: Value) -> list[float]:
    back = integer(steps, "steps")
    if not 0 <= back < len(machine.past_joints):
        raise Refusal(f"the joints are remembered for {len(machine.past_joints) - 1} cycles, not {back}")
    return list(machine.past_joints[-1 - back])


class _ForceMode:
    """Force mode in free space."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine

    def start(self, frame: Value, selection: Value, wrench: Value, kind: Value, limits: Value) -> None:
        if type(frame) is not Pose:
            raise Refusal("task_frame must be a pose")
        if integer(kind, "type") != FIXED_FRAME:
            raise Refusal("only force mode of type 2, whose frame stays where it is, is simulated")
        compliant = np.array(numbers(selection, 6, "selection_vector")) != 0.0
        asked, most = np.array(numbers(wrench, 6, "wrench")), np.array(numbers(limits, 6, "limits"))
        speed = np.where(compliant, np.sign(asked) * np.abs(most), 0.0)
        turn = pose_from_vector(np.array([tuple(frame)]))[0, :3, :3]
        machine = self._machine
        motion = machine.motion
        if not isinstance(motion, SpeedMotion):
            if motion is not None or not speed.any():
                return  # another motion leads the tool; forces would only bend its way
            motion = SpeedMotion(machine.arm, machine.tool, machine.state, machine.limit, of_tool=True)
            machine.motion = motion
        motion.aim([*(turn @ speed[:3] * 1000.0).tolist(), *(turn @ speed[3:]).tolist()], GIVING_WAY)

    def end(self) -> None:
        motion = self._machine.motion
        if isinstance(motion, SpeedMotion):
            motion.brake(tool=GIVING_WAY)
