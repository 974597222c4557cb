"""Which RTDE variables a controller knows: a name that came with a later version is not found."""

from __future__ import annotations

from typing import TypeAlias

from robot.rtde import INPUTS, OUTPUTS
from robot.simulation.versions import Version, has

Since: TypeAlias = tuple[Version | None, Version | None]

ALWAYS: Since = ((0,), (0,))
NEWEST: Since = (None, (5, 23))
FIRST_REGISTERS = 24
"""Registers of each kind that older versions have."""

SINCE: dict[str, Since] = {
    "elbow_position": ((3, 5), (5, 0)),
    "elbow_velocity": ((3, 5), (5, 0)),
    "safety_status": ((3, 10), (5, 4)),
    "tcp_offset": ((3, 12, 3), (5, 5, 1)),
    "payload": ((3, 11), (5, 5, 1)),
    "payload_cog": ((3, 11), (5, 5, 1)),
    "encoder0_raw": ((3, 11), (5, 5)),
    "encoder1_raw": ((3, 11), (5, 5)),
    "script_control_line": ((3, 14), (5, 9)),
    "actual_configurable_digital_input_bits": ((3, 14), (5, 9)),
    "actual_configurable_digital_output_bits": ((3, 14), (5, 9)),
    "payload_inertia": ((3, 15), (5, 11)),
    "tool_output_mode": (None, (5, 0)),
    "tool_digital_output0_mode": (None, (5, 0)),
    "tool_digital_output1_mode": (None, (5, 0)),
    "ft_raw_wrench": (None, (5, 9)),
    "joint_position_deviation_ratio": ((3, 14), (5, 9)),
    "collision_detection_ratio": (None, (5, 15)),
    "time_scale_source": (None, (5, 17)),
} | dict.fromkeys(
    (
        "actual_TCP_acceleration",
        "actual_current_as_torque",
        "actual_robot_braking_energy_dissipated",
        "actual_robot_energy_consumed",
        "control_step",
        "target_TCP_acceleration",
        "target_base_acceleration",
        "target_base_wrench",
        "target_execution_time",
        "target_gravity",
        "wrench_calc_from_currents",
    ),
    NEWEST,
)
"""Versions, of the CB3 and of the e-Series, with which a variable came; what is not here always was."""


def known_outputs(version: Version) -> dict[str, str]:
    """Type of each variable that a controller of this version can send."""
    return {name: kind for name, kind in OUTPUTS.items() if has(version, *_since(name))}


def known_inputs(version: Version) -> dict[str, str]:
    """Type of each variable that a controller of this version can be told."""
    return {name: kind for name, kind in INPUTS.items() if has(version, *_since(name))}


def _since(name: str) -> Since:
    kind, _, number = name.rpartition("_register_")
    if kind and (kind.endswith("_bit") or int(number) >= FIRST_REGISTERS):
        return (3, 9), (5, 3)
    return SINCE.get(name, ALWAYS)
