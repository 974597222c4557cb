"""What a client of a script port asks of the controller itself, in words that are no program."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot.simulation.power import RobotMode, SafetyMode

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot.simulation.machine import Machine


def obeyed(machine: Machine, text: str) -> bool:
    """Do what a text asks for, if it is such a command."""
    command = _COMMANDS.get(" ".join(text.split()))
    if command is None:
        return False
    command(machine)
    return True


def _unlock(machine: Machine) -> None:
    if machine.safety is SafetyMode.PROTECTIVE_STOP:
        machine.clear_stop()


_COMMANDS: dict[str, Callable[[Machine], object]] = {
    "power on": lambda machine: machine.power_up(RobotMode.IDLE),
    "power off": lambda machine: machine.power_off(),
    "set robotmode run": lambda machine: machine.power_up(RobotMode.RUNNING),
    "set unlock protective stop": _unlock,
    "stop program": lambda machine: machine.stop_program(),
}
