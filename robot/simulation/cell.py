"""A simulated cell: robot and pump on one clock, started and stopped together."""

from __future__ import annotations

import contextlib
import ipaddress
import math
import os
import select
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from planning import load_cell
from planning.configuration import find_configuration
from robot.errors import CellUnreachable, PortTakenError, RobotError

from .clock import FASTEST, SLOWEST, ProcessClock
from .deposition import PUMP_FILE, ROBOT_FILE, write_deposition
from .fault_script import load_fault_script
from .faults import Fault, inject
from .lifetime import READY

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

START_TIME = 20.0  # s of wall time
STOP_TIME = 2.0
LONGEST_START_DELAY = 0.5  # s
LONGEST = 3600.0  # s, of all other delays


class SimulatedCell:
    """The two simulator processes of a cell; a context manager that ends them.

    Attributes:
        cell: what is simulated.
        host: address of the robot.
        pump_host, pump_port: address of the pump.
        time_scale: process seconds in a wall second.
        epoch: monotonic wall time of process time 0.
        trace: folder of the traces, if there are any.
    """

    def __init__(self, path: Path, *, host: str | None, time_scale: float) -> None:
        self.path = path
        self.cell = load_cell(str(path))
        self.host = host or self.cell.robot.host
        self.pump_host = host or self.cell.pump.host
        self.pump_port = self.cell.pump.port
        self.time_scale = time_scale
        self.epoch = time.monotonic()
        self.trace: Path | None = None
        self._children: list[_Child] = []

    @classmethod
    def start(
        cls,
        cell: str | Path,
        *,
        time_scale: float = 1.0,
        host: str | None = None,
        version: str = "5.12",
        start_delay: float = 0.02,
        power_delay: float = 0.0,
        protective_stop_delay: float = 0.0,
        local_control: bool = False,
        programs: str | Path | None = None,
        trip: float = 0.5,
        reply_delay: float = 0.0,
        reply_jitter: float = 0.0,
        seed: int = 0,
        ramp: float = 0.0,
        hopper: float = math.inf,
        pressure_limit: float = 40.0,
        current_limit: float = 12.0,
        trace: str | Path | None = None,
        script: str | Path | None = None,
        faults_seed: int | None = None,
    ) -> SimulatedCell:
        """Start both simulators and wait until they are ready.

        Args:
            cell: a cell file, or the name of a shipped one.
            time_scale: process seconds in a wall second, 0.1 to 50.
            host: address for robot and pump instead of the cell's own.
            version: PolyScope version that the robot says it is.
            start_delay: wall seconds until an uploaded program starts, at most 0.5.
            power_delay: process seconds of each step from no power to released brakes.
            protective_stop_delay: process seconds until a protective stop can be unlocked; a real controller's are 5.
            local_control: the robot is in local, not in remote control.
            programs: folder of the programs that the dashboard loads.
            trip: wall seconds of silence after which the pump's drive trips; 0: never.
            reply_delay, reply_jitter: wall seconds until the pump answers, and what may be added by chance.
            seed: of that chance.
            ramp: process seconds from rest to the pump's largest flow.
            hopper: what the pump's hopper holds, mm³.
            pressure_limit, current_limit: bar and A, beyond which the drive trips.
            trace: folder for `robot.csv`, `pump.csv` and, in the end, `deposition.csv`.
            script: file of faults; see `load_fault_script`.
            faults_seed: faults by chance with this seed, those of the script or `CHANCES`.

        Raises:
            ConfigurationError: there is no such cell, or it or the script is wrong.
            PortTakenError: something else listens there.
            CellUnreachable: a simulator does not start.
            RobotError: an option is out of its range, or the trace's folder cannot be made.
        """
        for name, number, least, most in (
            ("time_scale", time_scale, SLOWEST, FASTEST),
            ("start_delay", start_delay, 0.0, LONGEST_START_DELAY),
            ("power_delay", power_delay, 0.0, LONGEST),
            ("protective_stop_delay", protective_stop_delay, 0.0, LONGEST),
            ("trip", trip, 0.0, LONGEST),
            ("reply_delay", reply_delay, 0.0, LONGEST),
            ("reply_jitter", reply_jitter, 0.0, LONGEST),
            ("ramp", ramp, 0.0, LONGEST),
            ("hopper", hopper, 0.0, math.inf),
            ("pressure_limit", pressure_limit, 0.0, math.inf),
            ("current_limit", current_limit, 0.0, math.inf),
        ):
            if not least <= number <= most:
                raise RobotError(f"`{name}` must be {least:g} to {most:g}, not {number:g}")
        if script is not None:
            load_fault_script(script)
        path = Path(find_configuration("cells", str(cell))).resolve()
        simulated = cls(path, host=host, time_scale=time_scale)
        for address in (simulated.host, simulated.pump_host):
            _check_loopback(address)
        controller: dict[str, object] = {
            "version": version,
            "start-delay": start_delay,
            "power-delay": power_delay,
            "protective-stop-delay": protective_stop_delay,
            "programs": programs,
            "pump-host": simulated.pump_host,
            "script": script,
            "faults-seed": faults_seed,
        }
        pump: dict[str, object] = {
            "port": simulated.pump_port,
            "trip": trip,
            "reply-delay": reply_delay,
            "reply-jitter": reply_jitter,
            "seed": seed,
            "ramp": ramp,
            "hopper": hopper,
            "pressure-limit": pressure_limit,
            "current-limit": current_limit,
        }
        if trace is not None:
            simulated.trace = _folder(trace)
            controller["trace"], pump["trace"] = simulated.trace / ROBOT_FILE, simulated.trace / PUMP_FILE
        try:
            deadline = time.monotonic() + START_TIME
            simulated._spawn("pump", simulated.pump_host, _options(pump))
            if script is not None or faults_seed is not None:  # a fault of the pump may come at once
                simulated._children[0].wait_until_ready(deadline)
            local = ["--local-control"] * local_control
            simulated._spawn("controller", simulated.host, [*_options(controller), *local])
            for child in simulated._children:
                child.wait_until_ready(deadline)
        except BaseException:
            simulated.trace = None
            simulated.stop()
            raise
        return simulated

    def inject(self, fault: Fault | str, **values: float) -> dict[str, Any]:
        """Ask for a fault; see `faults.inject`."""
        host = self.pump_host if str(fault).startswith("pump") else self.host
        return inject(host, fault, **values)

    def complaints(self) -> str:
        """What the simulators have written to stderr so far."""
        return "".join(child.complaints() for child in self._children)

    def news(self) -> list[str]:
        """The lines that the simulators have written to stderr since they were last asked."""
        return [line for child in self._children for line in child.news()]

    def check(self) -> None:
        """Make sure that both simulators still run.

        Raises:
            CellUnreachable: one has ended by itself; with what it said.
        """
        for child in self._children:
            code = child.process.poll()
            if code is not None:
                said = child.complaints().strip().splitlines()
                raise CellUnreachable(
                    f"the simulated {child.name} ended with code {code}: {said[-1] if said else ''}"
                )

    @property
    def process_ids(self) -> dict[str, int]:
        """Process ids of `controller` and `pump`."""
        return {child.name: child.process.pid for child in self._children}

    @property
    def process_time(self) -> float:
        """Process time now, s."""
        return ProcessClock(self.epoch, self.time_scale).now()

    def stop(self) -> None:
        """End both simulators, and join their traces.

        Raises:
            RobotError: the traces cannot be joined.
        """
        ended, self._children = self._children, []
        for child in ended:
            child.ask_to_end()
        for child in ended:
            child.end()
        if ended and self.trace is not None:
            write_deposition(self.trace)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.stop()
            return
        with contextlib.suppress(RobotError):  # what went wrong first is what is told
            self.stop()

    def _spawn(self, name: str, host: str, options: list[str]) -> None:
        clock = ["--time-scale", repr(self.time_scale), "--epoch", repr(self.epoch)]
        self._children.append(_Child(name, ["--cell", str(self.path), "--host", host, *clock, *options]))


def _options(values: dict[str, object]) -> list[str]:
    """Options of a command line, without those that are None."""
    return [f"--{name}={value}" for name, value in values.items() if value is not None]


def _check_loopback(address: str) -> None:
    """Whoever reaches the ports may move the robot and run programs: nobody else is to reach them.

    Raises:
        RobotError: the address is not this machine's alone.
    """
    with contextlib.suppress(ValueError):  # a name; whether it is this machine's shows when a port is opened
        if not ipaddress.ip_address(address).is_loopback:
            raise RobotError(
                f"{address} is no loopback address, and a simulated cell is at nothing else; "
                "give `host`, such as 127.0.0.1"
            )


def _folder(path: str | Path) -> Path:
    folder = Path(path).resolve()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RobotError(f"{folder}: no folder for traces: {error.strerror}") from error
    if (folder / ROBOT_FILE).exists() or (folder / PUMP_FILE).exists():
        raise RobotError(f"{folder}: holds the traces of another cell; name another folder, or remove them")
    return folder


class _Child:
    """One simulator process. Its standard input stays open as long as this process lives, and it ends with it."""

    def __init__(self, name: str, options: list[str]) -> None:
        self.name = name
        self._stderr: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `end`
        self._told = 0  # bytes of it
        self._ready = False
        self.process = subprocess.Popen(
            [sys.executable, "-m", f"robot.simulation.{name}", "--child", *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._stderr,
            start_new_session=True,  # Ctrl-C in a terminal is the parent's to handle
            env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )

    def wait_until_ready(self, deadline: float) -> None:
        assert self.process.stdout is not None
        if self._ready:
            return
        left = max(0.0, deadline - time.monotonic())
        readable, _, _ = select.select([self.process.stdout], [], [], left)
        if readable and self.process.stdout.readline().strip() == READY.encode():
            self._ready = True
            return
        if readable:
            self.process.wait(STOP_TIME)
        told = self.complaints().strip() or f"the simulated {self.name} was not ready after {START_TIME:g} s"
        raise (PortTakenError if " is taken" in told else CellUnreachable)(told)

    def complaints(self) -> str:
        self._stderr.flush()
        return os.pread(self._stderr.fileno(), 1 << 20, 0).decode("utf-8", "replace")

    def news(self) -> list[str]:
        self._stderr.flush()
        size = os.fstat(self._stderr.fileno()).st_size
        text = os.pread(self._stderr.fileno(), size - self._told, self._told)
        whole = text[: text.rfind(b"\n") + 1]
        self._told += len(whole)
        return whole.decode("utf-8", "replace").splitlines()

    def ask_to_end(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.terminate()

    def end(self) -> None:
        assert self.process.stdout is not None
        try:
            self.process.wait(STOP_TIME)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()
        self._stderr.close()
