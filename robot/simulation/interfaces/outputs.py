"""What the simulated controller tells through RTDE, variable by variable, in the wire's metres."""

from __future__ import annotations

from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING

from robot.rtde import OUTPUTS, Value
from robot.simulation.machine import RobotMode, RuntimeState, SafetyMode
from robot.simulation.motions.frame import metres

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot.simulation.machine import Machine

JOINT_RUNNING, JOINT_POWER_OFF = 253, 239
NOTHING: dict[str, Value] = {
    "DOUBLE": 0.0,
    "BOOL": False,
    "VECTOR3D": (0.0,) * 3,
    "VECTOR6D": (0.0,) * 6,
    "VECTOR6INT32": (0,) * 6,
}
CONSTANTS: dict[str, Value] = {
    "actual_execution_time": 0.1,
    "actual_main_voltage": 48.0,
    "actual_robot_voltage": 48.0,
    "actual_joint_voltage": (48.0,) * 6,
    "joint_temperatures": (30.0,) * 6,
    "tool_temperature": 30.0,
    "actual_tool_accelerometer": (0.0, 0.0, 9.82),
    "target_gravity": (0.0, 0.0, -9.82),
}
SAFETY_BITS = {
    SafetyMode.NORMAL: 1 << 0,
    SafetyMode.PROTECTIVE_STOP: 1 << 2 | 1 << 10,
    SafetyMode.SAFEGUARD_STOP: 1 << 4 | 1 << 10,
    SafetyMode.ROBOT_EMERGENCY_STOP: 1 << 6 | 1 << 7 | 1 << 10,
}


def readers(machine: Machine, names: tuple[str, ...]) -> list[Callable[[], Value]]:
    """One function for each variable that reads its value now."""
    return [_reader(machine, name) for name in names]


def _reader(machine: Machine, name: str) -> Callable[[], Value]:
    special = SPECIAL.get(name)
    if special is not None:
        return partial(special, machine)
    for prefix, bank in (
        ("input_int_register_", machine.input_ints),
        ("input_double_register_", machine.input_doubles),
        ("input_bit_register_", machine.input_bits),
        ("output_int_register_", machine.output_ints),
        ("output_double_register_", machine.output_doubles),
        ("output_bit_register_", machine.output_bits),
    ):
        if name.startswith(prefix):
            return partial(itemgetter(int(name.removeprefix(prefix))), bank)
    constant: Value = CONSTANTS.get(name, NOTHING.get(OUTPUTS[name], 0))
    return lambda: constant


def _speed_scaling(machine: Machine) -> float:
    """What of the slider's speed the motion has: below 1 while it still speeds up to it."""
    if machine.runtime is not RuntimeState.PLAYING:
        return 0.0
    return min(1.0, machine.throttle / machine.slider) if machine.slider > 0.0 else 1.0


def _robot_bits(machine: Machine) -> int:
    return (machine.mode is not RobotMode.POWER_OFF) << 0 | (machine.runtime is RuntimeState.PLAYING) << 1


def _bits(low: int, bank: list[bool]) -> int:
    return sum(bank[low + i] << i for i in range(32))


SPECIAL: dict[str, Callable[[Machine], Value]] = {
    "timestamp": lambda m: m.time,
    "control_step": lambda m: m.cycles,
    "target_q": lambda m: m.state.joints,
    "actual_q": lambda m: m.state.joints,
    "target_qd": lambda m: m.state.joint_speeds,
    "actual_qd": lambda m: m.state.joint_speeds,
    "target_TCP_pose": lambda m: metres(m.state.pose),
    "actual_TCP_pose": lambda m: metres(m.state.pose),
    "target_TCP_speed": lambda m: metres(m.state.tool_speed),
    "actual_TCP_speed": lambda m: metres(m.state.tool_speed),
    "actual_TCP_force": lambda m: m.external_wrench,
    "ft_raw_wrench": lambda m: m.external_wrench,
    "tcp_offset": lambda m: metres(m.tool_offset),
    "robot_mode": lambda m: m.mode,
    "joint_mode": lambda m: (JOINT_POWER_OFF if m.mode is RobotMode.POWER_OFF else JOINT_RUNNING,) * 6,
    "safety_mode": lambda m: m.safety,
    "safety_status": lambda m: m.safety,
    "safety_status_bits": lambda m: SAFETY_BITS[m.safety],
    "robot_status_bits": _robot_bits,
    "runtime_state": lambda m: m.runtime,
    "speed_scaling": _speed_scaling,
    "target_speed_fraction": lambda m: m.slider,
    "speed_slider_fraction": lambda m: m.slider,
    "actual_digital_output_bits": lambda m: m.digital_outputs,
    "actual_configurable_digital_output_bits": lambda m: m.digital_outputs >> 8 & 0xFF,
    "standard_digital_output": lambda m: m.digital_outputs & 0xFF,
    "configurable_digital_output": lambda m: m.digital_outputs >> 8 & 0xFF,
    "tool_digital_output": lambda m: m.digital_outputs >> 16 & 0x3,
    "standard_analog_output0": lambda m: m.analog_outputs[0],
    "standard_analog_output1": lambda m: m.analog_outputs[1],
    "analog_io_types": lambda m: m.analog_output_types << 2,
    "payload": lambda m: m.payload,
    "payload_cog": lambda m: m.payload_cog,
    "input_bit_registers0_to_31": lambda m: _bits(0, m.input_bits),
    "input_bit_registers32_to_63": lambda m: _bits(32, m.input_bits),
    "output_bit_registers0_to_31": lambda m: _bits(0, m.output_bits),
    "output_bit_registers32_to_63": lambda m: _bits(32, m.output_bits),
}
