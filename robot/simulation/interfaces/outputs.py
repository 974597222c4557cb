"""What the simulated controller tells through RTDE, variable by variable, in the wire's metres.

The arm follows its targets exactly: actual and target values are the same. It has no mass and no motors: currents,
moments, momentum and consumed energy are 0. Temperatures and voltages are those of a warm robot at rest.
"""

from __future__ import annotations

import math
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING

from robot.rtde import OUTPUTS, Value
from robot.simulation.machine import RuntimeState
from robot.simulation.motions.arm_frame import flange_frame
from robot.simulation.motions.frame import Numbers, metres
from robot.simulation.power import RobotMode, SafetyMode

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot.simulation.machine import Machine

TEMPERATURE = 30.0  # °C
VOLTAGE = 48.0
TOOL_VOLTAGE = 24.0

JOINT_RUNNING, JOINT_IDLE, JOINT_BOOTING, JOINT_POWER_OFF = 253, 255, 247, 239
JOINT_VIOLATION, JOINT_FAULT = 251, 252
JOINT_MODES = {
    RobotMode.BOOTING: JOINT_BOOTING,
    RobotMode.POWER_ON: JOINT_IDLE,
    RobotMode.IDLE: JOINT_IDLE,
    RobotMode.RUNNING: JOINT_RUNNING,
}

NOTHING: dict[str, Value] = {
    "DOUBLE": 0.0,
    "BOOL": False,
    "VECTOR3D": (0.0,) * 3,
    "VECTOR6D": (0.0,) * 6,
    "VECTOR6INT32": (0,) * 6,
}
CONSTANTS: dict[str, Value] = {
    "actual_main_voltage": VOLTAGE,
    "joint_temperatures": (TEMPERATURE,) * 6,
    "tool_temperature": TEMPERATURE,
    "target_base_acceleration": (0.0,) * 6,
}

STOPPED_BIT = 1 << 10
EMERGENCY_BIT = 1 << 7
SAFETY_BITS = {
    SafetyMode.NORMAL: 1 << 0,
    SafetyMode.REDUCED: 1 << 1,
    SafetyMode.PROTECTIVE_STOP: 1 << 2 | STOPPED_BIT,
    SafetyMode.RECOVERY: 1 << 3,
    SafetyMode.SAFEGUARD_STOP: 1 << 4 | STOPPED_BIT,
    SafetyMode.SYSTEM_EMERGENCY_STOP: 1 << 5 | EMERGENCY_BIT | STOPPED_BIT,
    SafetyMode.ROBOT_EMERGENCY_STOP: 1 << 6 | EMERGENCY_BIT | STOPPED_BIT,
    SafetyMode.VIOLATION: 1 << 8 | STOPPED_BIT,
    SafetyMode.FAULT: 1 << 9 | STOPPED_BIT,
    SafetyMode.AUTOMATIC_MODE_SAFEGUARD_STOP: 1 << 4 | STOPPED_BIT,
    SafetyMode.SYSTEM_THREE_POSITION_ENABLING_STOP: 1 << 4 | STOPPED_BIT,
}


def readers(machine: Machine, names: tuple[str, ...]) -> list[Callable[[], Value]]:
    """One function for each variable that reads its value now."""
    return [_reader(machine, name) for name in names]


def reader_of_all(machine: Machine, names: tuple[str, ...]) -> Callable[[], tuple[float, ...]]:
    """One function that reads all variables now: their numbers in a row, those of a vector one by one.

    Every cycle calls it for every client, so it is one expression, `(read0(), *read1(), read2())`.
    """
    items = [f"*read{i}()" if "VECTOR" in OUTPUTS[name] else f"read{i}()" for i, name in enumerate(names)]
    reading = {f"read{i}": read for i, read in enumerate(readers(machine, names))}
    made: Callable[[], tuple[float, ...]] = eval(f"lambda: ({', '.join(items)},)", reading)  # noqa: S307 - our own text
    return made


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


def speed_scaling(machine: Machine) -> float:
    """What of the slider's speed the motion has: below 1 while it still speeds up to it."""
    if machine.runtime is not RuntimeState.PLAYING:
        return 0.0
    return min(1.0, machine.throttle / machine.slider) if machine.slider > 0.0 else 1.0


def joint_mode(machine: Machine) -> int:
    """The same for all joints."""
    if machine.safety is SafetyMode.VIOLATION:
        return JOINT_VIOLATION
    if machine.safety is SafetyMode.FAULT:
        return JOINT_FAULT
    return JOINT_MODES.get(machine.mode, JOINT_POWER_OFF)


def safety_mode(machine: Machine) -> int:
    """The older of the two variables: it knows every stop of a safeguard as one."""
    return machine.safety if machine.safety <= SafetyMode.UNDEFINED_SAFETY_MODE else SafetyMode.SAFEGUARD_STOP


def joint_accelerations(machine: Machine) -> Numbers:
    """Of the last cycle, rad/s²."""
    return _change(machine.before.joint_speeds, machine.state.joint_speeds, machine.elapsed)


def tool_acceleration(machine: Machine) -> Numbers:
    """Of the last cycle, m/s² and rad/s²."""
    return metres(_change(machine.before.tool_speed, machine.state.tool_speed, machine.elapsed))


def accelerometer(machine: Machine) -> Numbers:
    """What holds the flange up against gravity, in its own axes, m/s²; motions are not felt."""
    frame = flange_frame(machine.arm, machine.state.joints)
    up = machine.gravity
    return tuple([sum(frame[j + i] * up[i] for i in (0, 1, 2)) for j in (0, 3, 6)])


def elbow_position(machine: Machine) -> Numbers:
    """Where joint 3 is, m."""
    arm, (q1, q2, *_) = machine.arm, machine.state.joints
    out = 0.001 * arm.a2 * math.cos(q2)
    return (out * math.cos(q1), out * math.sin(q1), 0.001 * (arm.d1 + arm.a2 * math.sin(q2)))


def elbow_velocity(machine: Machine) -> Numbers:
    """How fast joint 3 moves, m/s."""
    arm, (q1, q2, *_), (w1, w2, *_) = machine.arm, machine.state.joints, machine.state.joint_speeds
    out, outwards = 0.001 * arm.a2 * math.cos(q2), -0.001 * arm.a2 * math.sin(q2) * w2
    c, s = math.cos(q1), math.sin(q1)
    return (outwards * c - out * s * w1, outwards * s + out * c * w1, out * w2)


def analog_output(machine: Machine, place: int) -> float:
    """V or A, as the output's type is."""
    share = machine.analog_outputs[place]
    return 10.0 * share if machine.analog_output_types >> place & 1 else 0.004 + 0.016 * share


def encoder_count(machine: Machine, place: int) -> int:
    """What a program says an encoder has counted, as 32 bits with a sign."""
    encoder = machine.encoders[place]
    return 0 if encoder is None else (encoder[1] + (1 << 31)) % (1 << 32) - (1 << 31)


def powered(machine: Machine, value: float) -> float:
    """A value that is 0 while the arm has no power."""
    return value if machine.power.on else 0.0


def _change(before: Numbers, now: Numbers, seconds: float) -> Numbers:
    if seconds <= 0.0:
        return (0.0,) * len(now)
    return tuple([(b - a) / seconds for a, b in zip(before, now, strict=True)])


def _robot_bits(machine: Machine) -> int:
    return machine.power.on << 0 | (machine.runtime is RuntimeState.PLAYING) << 1 | machine.freedrive << 2


def _bits(low: int, bank: list[bool]) -> int:
    return sum(bank[low + i] << i for i in range(32))


SPECIAL: dict[str, Callable[[Machine], Value]] = {
    "timestamp": lambda m: m.time,
    "control_step": lambda m: m.cycles,
    "actual_execution_time": lambda m: m.execution_time,
    "target_execution_time": lambda m: m.execution_time,
    "target_q": lambda m: m.state.joints,
    "actual_q": lambda m: m.state.joints,
    "target_qd": lambda m: m.state.joint_speeds,
    "actual_qd": lambda m: m.state.joint_speeds,
    "target_qdd": joint_accelerations,
    "target_TCP_pose": lambda m: metres(m.state.pose),
    "actual_TCP_pose": lambda m: metres(m.state.pose),
    "target_TCP_speed": lambda m: metres(m.state.tool_speed),
    "actual_TCP_speed": lambda m: metres(m.state.tool_speed),
    "target_TCP_acceleration": tool_acceleration,
    "actual_TCP_acceleration": tool_acceleration,
    "actual_TCP_force": lambda m: m.wrench,
    "tcp_force_scalar": lambda m: math.hypot(*m.wrench[:3]),
    "ft_raw_wrench": lambda m: m.external_wrench,
    "tcp_offset": lambda m: metres(m.tool_offset),
    "actual_tool_accelerometer": accelerometer,
    "elbow_position": elbow_position,
    "elbow_velocity": elbow_velocity,
    "target_gravity": lambda m: m.gravity,
    "actual_robot_voltage": lambda m: powered(m, VOLTAGE),
    "actual_joint_voltage": lambda m: (powered(m, VOLTAGE),) * 6,
    "robot_mode": lambda m: m.mode,
    "joint_mode": lambda m: (joint_mode(m),) * 6,
    "safety_mode": safety_mode,
    "safety_status": lambda m: m.safety,
    "safety_status_bits": lambda m: SAFETY_BITS.get(m.safety, STOPPED_BIT),
    "robot_status_bits": _robot_bits,
    "runtime_state": lambda m: m.runtime,
    "speed_scaling": speed_scaling,
    "target_speed_fraction": lambda m: m.slider,
    "actual_digital_input_bits": lambda m: m.digital_inputs,
    "actual_configurable_digital_input_bits": lambda m: m.digital_inputs >> 8 & 0xFF,
    "actual_digital_output_bits": lambda m: m.digital_outputs,
    "actual_configurable_digital_output_bits": lambda m: m.digital_outputs >> 8 & 0xFF,
    "standard_analog_output0": lambda m: analog_output(m, 0),
    "standard_analog_output1": lambda m: analog_output(m, 1),
    "analog_io_types": lambda m: m.analog_output_types << 2,
    "tool_output_voltage": lambda m: m.tool_voltage,
    "encoder0_raw": lambda m: encoder_count(m, 0),
    "encoder1_raw": lambda m: encoder_count(m, 1),
    "payload": lambda m: m.payload,
    "payload_cog": lambda m: m.payload_cog,
    "payload_inertia": lambda m: m.payload_inertia,
    "input_bit_registers0_to_31": lambda m: _bits(0, m.input_bits),
    "input_bit_registers32_to_63": lambda m: _bits(32, m.input_bits),
    "output_bit_registers0_to_31": lambda m: _bits(0, m.output_bits),
    "output_bit_registers32_to_63": lambda m: _bits(32, m.output_bits),
}
