"""The simulated UR controller, a process of its own: `python -m robot.simulation.controller --cell CELL`."""

from __future__ import annotations

import asyncio
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Any

from planning import ConfigurationError, load_cell
from robot.rtde import PORT as RTDE_PORT
from robot.simulation.interfaces import dashboard, script_ports
from robot.simulation.interfaces.rtde_server import Connection, RtdeServer

from .clock import ProcessClock
from .faults import CONTROLLER_PORT, Fault, FaultPort
from .lifetime import arguments, run, told_of_taken_ports, until_ended
from .machine import Machine, SafetyMode

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

CYCLE = 0.002  # s of wall time


class Controller:
    """Machine, servers and clock."""

    def __init__(self, machine: Machine, clock: ProcessClock, start_delay: float) -> None:
        self.machine = machine
        self.clock = clock
        self.rtde = RtdeServer(machine)
        self.dashboard = dashboard.Dashboard(machine)
        self.scripts = script_ports.ScriptPorts(machine, ThreadPoolExecutor(1, "planning"), start_delay)

    async def listen(self, host: str) -> None:
        """Open all ports.

        Raises:
            PortTakenError: one of them is in use.
        """
        loop = asyncio.get_running_loop()
        with told_of_taken_ports(host, RTDE_PORT):
            await loop.create_server(lambda: Connection(self.rtde), host, RTDE_PORT)
        with told_of_taken_ports(host, dashboard.PORT):
            await asyncio.start_server(self.dashboard.serve, host, dashboard.PORT)
        for port in script_ports.PORTS:
            with told_of_taken_ports(host, port):
                serve = partial(self.scripts.serve, port)
                await asyncio.start_server(serve, host, port, limit=script_ports.LONGEST_LINE)
        with told_of_taken_ports(host, CONTROLLER_PORT):
            await loop.create_datagram_endpoint(
                lambda: FaultPort(self._faults()), local_addr=(host, CONTROLLER_PORT)
            )

    def start(self) -> None:
        """Begin to cycle."""
        loop = asyncio.get_running_loop()
        self.machine.time = self.clock.now()
        self._cycle(loop, loop.time())

    def _cycle(self, loop: asyncio.AbstractEventLoop, due: float) -> None:
        wall = time.monotonic()
        self.machine.cycle(self.clock.at(wall), wall)
        self.rtde.publish()
        due += CYCLE
        if due < loop.time():
            due = loop.time() + CYCLE  # late cycles are dropped, not made up for
        loop.call_at(due, self._cycle, loop, due)

    def _faults(self) -> dict[Fault, Callable[[dict[str, Any]], dict[str, Any] | None]]:
        machine, rtde = self.machine, self.rtde

        def of(effect: Callable[[], None]) -> Callable[[dict[str, Any]], None]:
            return lambda _: effect()

        def slide(values: dict[str, Any]) -> None:
            machine.slider = min(max(float(values["fraction"]), 0.0), 1.0)

        def mute(muted: bool) -> None:
            rtde.muted = muted

        return {
            Fault.PROTECTIVE_STOP: of(machine.protective_stop),
            Fault.CLEAR_PROTECTIVE_STOP: of(machine.clear_stop),
            Fault.SAFEGUARD_STOP: of(partial(machine.protective_stop, SafetyMode.SAFEGUARD_STOP)),
            Fault.CLEAR_SAFEGUARD_STOP: of(machine.clear_stop),
            Fault.EMERGENCY_STOP: of(machine.emergency_stop),
            Fault.RELEASE_EMERGENCY_STOP: of(machine.clear_stop),
            Fault.PROGRAM_STOP: of(machine.stop_program),
            Fault.SPEED_SLIDER: slide,
            Fault.RTDE_MUTE: of(partial(mute, True)),
            Fault.RTDE_UNMUTE: of(partial(mute, False)),
            Fault.RTDE_DROP: of(rtde.drop),
        }


def _version(text: str) -> tuple[int, int, int, int]:
    try:
        numbers = [int(part) for part in text.split(".")]
    except ValueError:
        numbers = []
    if not 2 <= len(numbers) <= 4:
        raise ConfigurationError(f"--version {text}: a PolyScope version looks like 5.12 or 5.12.4.1101234")
    major, minor, bugfix, build = (*numbers, 0, 0)[:4]
    return major, minor, bugfix, build


async def _main(options: argparse.Namespace) -> None:
    cell = load_cell(options.cell)
    machine = Machine(cell, _version(options.version))
    controller = Controller(machine, ProcessClock(options.epoch, options.time_scale), options.start_delay)
    await controller.listen(options.host or cell.robot.host)
    controller.start()
    await until_ended(with_parent=options.child)


def main() -> int:
    """Run the simulated controller; its exit code."""
    parser = arguments("A simulated UR controller on the ports of a real one.")
    parser.add_argument("--version", default="5.12", help="PolyScope version that it says it is")
    parser.add_argument("--start-delay", type=float, default=0.02, help="wall seconds until a program starts")
    return run(_main(parser.parse_args()), "controller")


if __name__ == "__main__":
    sys.exit(main())
