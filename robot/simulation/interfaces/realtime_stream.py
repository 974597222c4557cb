"""What the simulated controller tells on its real-time port: one message of doubles each cycle, nothing but numbers.

The layout grew with the versions, always at its end; a message begins with its own length.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from robot.simulation.versions import Version, has

from .outputs import readers

if TYPE_CHECKING:
    from robot.rtde import Value
    from robot.simulation.machine import Machine

    from .script_client import Outlet

MOST_WAITING = 1 << 14
"""Bytes that may wait in the system for a client that does not read; most clients of this port never do."""

REST = 10
"""Cycles for which nobody is tried once nobody reads: to try costs as much as to send."""

FIELDS: tuple[tuple[str | int, tuple[Version, Version]], ...] = tuple(
    (field, since)
    for since, fields in (
        (
            ((3, 0), (5, 0)),
            """timestamp target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_current
            joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose target_TCP_speed
            actual_digital_input_bits joint_temperatures actual_execution_time 1 robot_mode joint_mode safety_mode 6
            actual_tool_accelerometer 6 speed_scaling actual_momentum 2 actual_main_voltage actual_robot_voltage
            actual_robot_current actual_joint_voltage""",
        ),
        (((3, 2), (5, 0)), "actual_digital_output_bits runtime_state"),
        (((3, 5), (5, 0)), "elbow_position elbow_velocity"),
        (((3, 10), (5, 4)), "safety_status"),
        (((3, 14), (5, 9)), "3"),
        (((3, 15), (5, 10)), "payload payload_cog payload_inertia"),
    )
    for field in (int(word) if word.isdigit() else word for word in fields.split())
)
"""RTDE's names of the values, in their order, each with the versions (CB3, e-Series) that it came with; a number is so
many doubles of the manufacturer's own, which are 0 here."""


class RealtimeStream:
    """Sends every cycle to the clients of the real-time port that read."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._outlets: list[Outlet] = []
        known = [field for field, since in FIELDS if has(machine.version, *since)]
        self._names = tuple(field for field in known if isinstance(field, str))
        self._readers = dict(zip(self._names, readers(machine, self._names), strict=True))
        self._fields = known
        self._rest = 0

    def add(self, outlet: Outlet) -> None:
        """Tell one more client, until it leaves."""
        outlet.narrow(MOST_WAITING)
        self._outlets.append(outlet)
        self._rest = 0

    def publish(self) -> None:
        """Send the state of this cycle, unless nobody would take it."""
        if not self._outlets:
            return
        if self._rest:
            self._rest -= 1
            return
        free = [outlet for outlet in self._outlets if outlet.free]
        self._rest = 0 if free else REST
        if free:
            message = self.packed()
            for outlet in free:
                outlet.send(message)
        if any(outlet.closed for outlet in self._outlets):
            self._outlets = [outlet for outlet in self._outlets if not outlet.closed]

    def packed(self) -> bytes:
        """The message now."""
        numbers: list[float] = []
        for field in self._fields:
            if isinstance(field, int):
                numbers += [0.0] * field
                continue
            value: Value = self._readers[field]()
            if isinstance(value, tuple):
                numbers += value
            else:
                numbers.append(value)
        return struct.pack(f">i{len(numbers)}d", 4 + 8 * len(numbers), *numbers)
