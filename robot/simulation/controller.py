"""The simulated UR controller, a process of its own: `python -m robot.simulation.controller --cell CELL`."""

from __future__ import annotations

import asyncio
import contextlib
import math
import sys
import time
import traceback
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from planning import Cell, ConfigurationError, load_cell
from robot.rtde import PORT as RTDE_PORT
from robot.simulation.interfaces import dashboard, interpreter_port, script_ports
from robot.simulation.interfaces.dashboard import DashboardSettings
from robot.simulation.interfaces.line import Port, stream
from robot.simulation.interfaces.rtde_server import Connection, RtdeServer
from robot.simulation.interfaces.rtde_values import rtde_value
from robot.simulation.interfaces.state_stream import READ_ONLY
from robot.simulation.motions.streaming import standing
from robot.simulation.programs.translating import Translator

from .clock import ProcessClock
from .controller_faults import RefusingDashboard, effects
from .fault_plan import FaultPlan
from .fault_script import FaultScript, load_fault_script, with_seed
from .fault_sender import FaultSender
from .faults import CONTROLLER_PORT, FaultPort
from .lifetime import arguments, run, told_of_taken_ports, until_ended
from .machine import Machine
from .power import Power, RobotMode
from .robot_trace import RobotTrace
from .versions import SIMULATED, cycle_time

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

EARLY = 0.1
"""Share of a cycle by which it may begin too early; timers are not exact."""

CATCHES_UP = 10
"""Most cycles that are done at once after the controller was held up."""


@dataclass(frozen=True)
class ControllerSettings:
    """What users may set.

    Attributes:
        dashboard: of the dashboard.
        power_delay: process time of each step from no power to released brakes, s.
    """

    dashboard: DashboardSettings = field(default_factory=DashboardSettings)
    power_delay: float = 0.0


class Controller:
    """Machine, servers and clock.

    Attributes:
        machine, rtde, dashboard, scripts, statements: others after each boot.
        rtde_port, dashboard_port: their lines, which faults act on.
        effects: of the faults.
        observers: called after each cycle.
    """

    def __init__(
        self,
        cell: Cell,
        version: tuple[int, int, int, int],
        clock: ProcessClock,
        start_delay: float,
        host: str,
        settings: ControllerSettings | None = None,
    ) -> None:
        self.clock = clock
        self.host = host
        self._cell, self._version, self._start_delay = cell, version, start_delay
        self._settings = settings or ControllerSettings()
        self._period = cycle_time(version)
        machine = Machine(cell, version)
        self._translator = Translator(machine)
        self._boot(machine)
        self.rtde_port = Port(host, RTDE_PORT, lambda: Connection(self.rtde))
        self.dashboard_port = Port(host, dashboard.PORT, stream(self._serve_dashboard))
        self.ports = [self.rtde_port, self.dashboard_port]
        for number in script_ports.PORTS:
            self.ports.append(Port(host, number, partial(self._script_client, number)))
        for number in READ_ONLY:
            self.ports.append(Port(host, number, partial(self._listener, number)))
        if version >= interpreter_port.FIRST_VERSION:
            statements = stream(self._serve_statements, interpreter_port.LONGEST_LINE)
            self.ports.append(Port(host, interpreter_port.PORT, statements))
        self.effects = effects(self)
        self.observers: list[Callable[[Machine], None]] = []

    def _boot(self, machine: Machine) -> None:
        """Begin with a machine, and make the servers around it."""
        self.machine = machine
        self.rtde = RtdeServer(machine)
        self.machine.power.seconds = self._settings.power_delay
        remote = self._settings.dashboard.remote
        self.scripts = script_ports.ScriptPorts(machine, self._translator, self._start_delay, remote=remote)
        self.dashboard = RefusingDashboard(machine, self.scripts.start, self._settings.dashboard)
        self.statements = interpreter_port.InterpreterPort(machine)
        machine.rtde_value = partial(rtde_value, machine)

    def listen(self) -> None:
        """Open all ports.

        Raises:
            PortTakenError: one of them is in use.
        """
        for port in self.ports:
            port.open()

    async def listen_for_faults(self) -> None:
        """Open the port through which faults are asked for.

        Raises:
            PortTakenError: it is in use.
        """
        with told_of_taken_ports(self.host, CONTROLLER_PORT):
            await asyncio.get_running_loop().create_datagram_endpoint(
                lambda: FaultPort(self.effects, "controller"), local_addr=(self.host, CONTROLLER_PORT)
            )

    def close(self) -> None:
        """End what runs beside it."""
        self._translator.close()

    def reboot(self) -> None:
        """Cut everything off, and begin anew without power: the arm stands where it was. No port is open."""
        for port in self.ports:
            port.close()
            port.late(0.0)
        before = self.machine
        before.stop_program()
        machine = Machine(self._cell, self._version)
        machine.state = standing(machine.arm, machine.tool, before.state.joints)
        machine.time, machine.digital_inputs = before.time, before.digital_inputs
        machine.power = Power(RobotMode.POWER_OFF, before.power.seconds)
        self._boot(machine)

    async def _serve_dashboard(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await self.dashboard.serve(reader, writer)

    async def _serve_statements(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await self.statements.serve(reader, writer)

    def _script_client(self, port: int) -> asyncio.Protocol:
        return self.scripts.client(port)

    def _listener(self, port: int) -> asyncio.Protocol:
        return self.scripts.listener(port)

    def start(self) -> None:
        """Begin to cycle."""
        loop = asyncio.get_running_loop()
        self.machine.time = self.clock.now()
        self._cycle(loop, loop.time())

    def _cycle(self, loop: asyncio.AbstractEventLoop, due: float) -> None:
        """Do the cycles that are due: each is as long as the next, however unevenly they come."""
        wall = time.monotonic()
        step = self._period * self.clock.scale
        behind = self.clock.at(wall) - self.machine.time
        due_now = int(behind / step + EARLY)
        count = min(due_now, CATCHES_UP)
        seconds = step + (due_now - count) * step  # what is more than it can catch up with is one long cycle
        try:
            for _ in range(count):
                self.machine.cycle(self.machine.time + seconds, wall)
                seconds = step
                self.rtde.publish()
                self.scripts.streams.publish()
                for observe in self.observers:
                    observe(self.machine)
        except Exception as error:
            traceback.print_exc()
            self.machine.stop_program(f"a defect of the simulator: {error!r}")
            self.machine.motion = None
        self.machine.execution_time = (time.monotonic() - wall) * 1e3
        due += self._period * max(1, math.ceil((loop.time() - due) / self._period))
        loop.call_at(due, self._cycle, loop, due)


def _version(text: str) -> tuple[int, int, int, int]:
    try:
        numbers = [int(part) for part in text.split(".")]
    except ValueError:
        numbers = []
    if not 2 <= len(numbers) <= 4:
        raise ConfigurationError(f"--version {text}: a PolyScope version looks like 5.12 or 5.12.4.1101234")
    if not any(first <= tuple(numbers[:2]) <= last for first, last in SIMULATED):
        known = " or ".join(f"{a}.{b} to {c}.{d}" for (a, b), (c, d) in SIMULATED)
        raise ConfigurationError(f"--version {text}: there is no such PolyScope here; there are {known}")
    major, minor, bugfix, build = (*numbers, 0, 0)[:4]
    return major, minor, bugfix, build


async def _main(options: argparse.Namespace) -> None:
    cell = load_cell(options.cell)
    clock = ProcessClock(options.epoch, options.time_scale)
    host = options.host or cell.robot.host
    settings = ControllerSettings(
        DashboardSettings(options.programs, not options.local_control, options.protective_stop_delay),
        options.power_delay,
    )
    controller = Controller(cell, _version(options.version), clock, options.start_delay, host, settings)
    with contextlib.ExitStack() as stack:
        stack.callback(controller.close)
        if options.script is not None or options.faults_seed is not None:
            script = load_fault_script(options.script) if options.script is not None else None
            if options.faults_seed is not None:
                script = with_seed(script, options.faults_seed)
            sender = FaultSender(controller.effects)
            await sender.connect(options.pump_host or options.host or cell.pump.host)
            controller.observers.append(FaultPlan(script or FaultScript(), sender.send).step)
        if options.trace is not None:
            controller.observers.append(stack.enter_context(RobotTrace(options.trace)).record)
        controller.listen()
        await controller.listen_for_faults()
        controller.start()
        await until_ended(with_parent=options.child)


def main() -> int:
    """Run the simulated controller; its exit code."""
    parser = arguments("A simulated UR controller on the ports of a real one.")
    parser.add_argument("--version", default="5.12", help="PolyScope version that it says it is")
    parser.add_argument("--start-delay", type=float, default=0.02, help="wall seconds until a program starts")
    parser.add_argument("--trace", type=Path, help="file for the tool's motion over process time")
    parser.add_argument("--script", type=Path, help="file of faults")
    parser.add_argument("--faults-seed", type=int, help="seed of faults that come by chance")
    parser.add_argument(
        "--pump-host", help="address of the pump that the faults are for; default: the cell's"
    )
    parser.add_argument("--programs", type=Path, help="folder of the programs that the dashboard loads")
    parser.add_argument("--local-control", action="store_true", help="the robot is not in remote control")
    parser.add_argument(
        "--power-delay", type=float, default=0.0, help="process seconds of each step of powering on"
    )
    parser.add_argument(
        "--protective-stop-delay",
        type=float,
        default=0.0,
        help="process seconds until a protective stop can be unlocked; a real controller's are 5",
    )
    return run(_main(parser.parse_args()), "controller")


if __name__ == "__main__":
    sys.exit(main())
