"""An output of the RTDE, for a program that asks for it by name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from robot.rtde import OUTPUTS

from .outputs import readers
from .variables import known_outputs

if TYPE_CHECKING:
    from robot.simulation.machine import Machine


def rtde_value(machine: Machine, name: str) -> Any:
    """Its value now, None if the controller's version has no such output."""
    if name not in OUTPUTS or name not in known_outputs(machine.version):
        return None
    return readers(machine, (name,))[0]()
