"""What the simulated controller's faults do to it."""

from __future__ import annotations

import asyncio
import sys
from functools import partial
from typing import TYPE_CHECKING, Any

from robot.errors import RobotError
from robot.simulation.interfaces.dashboard import Dashboard

from .faults import Effect, Fault
from .power import SafetyMode

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot.simulation.machine import Machine

    from .controller import Controller

ASKING = (
    "get ",
    "getuserrole",
    "is ",
    "isprogramsaved",
    "polyscopeversion",
    "programstate",
    "quit",
    "robotmode",
    "running",
    "safetymode",
    "safetystatus",
    "version",
)
"""How the dashboard's questions begin; all else would change something."""


class RefusingDashboard(Dashboard):
    """A dashboard that may refuse what would change something.

    Attributes:
        refusing: whether it does.
    """

    def __init__(self, *parts: Any) -> None:
        super().__init__(*parts)
        self.refusing = False

    def answer(self, asked: str) -> str:
        if not self.refusing or asked.lower().startswith(ASKING):
            return super().answer(asked)
        if asked.lower().startswith("load "):
            return f"Error while loading program: {asked[5:]}"
        return f"Failed to execute: {asked}"


def effects(controller: Controller) -> dict[Fault, Effect]:
    """One function for each fault that a controller can have."""

    def on_machine(effect: Callable[[Machine], object]) -> Effect:
        def act(_: dict[str, Any]) -> None:
            effect(controller.machine)

        return act

    def clear(mode: SafetyMode) -> Effect:
        def lift(_: dict[str, Any]) -> None:
            if controller.machine.safety is mode:
                controller.machine.clear_stop()

        return lift

    def slide(values: dict[str, Any]) -> None:
        controller.machine.slider = values["fraction"]

    def wire(values: dict[str, Any]) -> None:
        controller.machine.digital_inputs |= 1 << values["number"]

    def unwire(values: dict[str, Any]) -> None:
        controller.machine.digital_inputs &= ~(1 << values["number"])

    def mute(muted: bool, _: dict[str, Any]) -> None:
        controller.rtde.muted = muted

    def refuse(_: dict[str, Any]) -> None:
        controller.dashboard.refusing = True

    opening: set[asyncio.Task[None]] = set()

    async def listen_after(seconds: float) -> None:
        await asyncio.sleep(seconds)
        try:
            controller.listen()
        except RobotError as error:
            print(f"controller: after a fault: {error}", file=sys.stderr, flush=True)

    def listen(seconds: float) -> None:
        for earlier in opening:
            earlier.cancel()
        task = asyncio.get_running_loop().create_task(listen_after(seconds))
        opening.add(task)
        task.add_done_callback(opening.discard)

    def open_dashboard(_: dict[str, Any]) -> None:
        controller.dashboard.refusing = False
        if not opening:  # a controller that boots opens it by itself
            listen(0.0)

    def reboot(values: dict[str, Any]) -> None:
        controller.reboot()
        listen(values["seconds"])

    rtde, dashboard = controller.rtde_port, controller.dashboard_port
    safeguard, system = SafetyMode.SAFEGUARD_STOP, SafetyMode.SYSTEM_EMERGENCY_STOP
    return {
        Fault.PROTECTIVE_STOP: on_machine(lambda machine: machine.protective_stop()),
        Fault.CLEAR_PROTECTIVE_STOP: clear(SafetyMode.PROTECTIVE_STOP),
        Fault.SAFEGUARD_STOP: on_machine(lambda machine: machine.protective_stop(safeguard)),
        Fault.CLEAR_SAFEGUARD_STOP: clear(safeguard),
        Fault.EMERGENCY_STOP: on_machine(lambda machine: machine.emergency_stop()),
        Fault.RELEASE_EMERGENCY_STOP: clear(SafetyMode.ROBOT_EMERGENCY_STOP),
        Fault.SYSTEM_EMERGENCY_STOP: on_machine(lambda machine: machine.emergency_stop(system)),
        Fault.RELEASE_SYSTEM_EMERGENCY_STOP: clear(system),
        Fault.PROGRAM_STOP: on_machine(lambda machine: machine.stop_program()),
        Fault.PROGRAM_PAUSE: on_machine(lambda machine: machine.pause_program()),
        Fault.PROGRAM_PLAY: on_machine(lambda machine: machine.play_program()),
        Fault.SPEED_SLIDER: slide,
        Fault.DIGITAL_INPUT: wire,
        Fault.CLEAR_DIGITAL_INPUT: unwire,
        Fault.RTDE_MUTE: partial(mute, True),
        Fault.RTDE_UNMUTE: partial(mute, False),
        Fault.RTDE_DROP: lambda _: rtde.cut(),
        Fault.RTDE_LATE: lambda values: rtde.late(values["seconds"]),
        Fault.RTDE_ON_TIME: lambda _: rtde.late(0.0),
        Fault.RTDE_GARBAGE: lambda _: rtde.damage(rtde.garbage),
        Fault.RTDE_HALF: lambda _: rtde.damage(rtde.half),
        Fault.RTDE_HALF_DROP: lambda _: rtde.damage(rtde.half_and_end),
        Fault.DASHBOARD_REFUSE: refuse,
        Fault.DASHBOARD_CLOSE: lambda _: dashboard.close(),
        Fault.DASHBOARD_OPEN: open_dashboard,
        Fault.REBOOT: reboot,
    }
