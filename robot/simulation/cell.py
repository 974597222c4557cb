"""A simulated cell: robot and pump on one clock, started and stopped together."""

from __future__ import annotations

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
from robot.errors import CellUnreachable, PortTakenError

from .faults import Fault, inject
from .lifetime import READY

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

START_TIME = 20.0  # s of wall time
STOP_TIME = 2.0


class SimulatedCell:
    """The two simulator processes of a cell; a context manager that ends them.

    Attributes:
        cell: what is simulated.
        host: address of the robot.
        pump_host, pump_port: address of the pump.
        time_scale: process seconds in a wall second.
        epoch: monotonic wall time of process time 0.
    """

    def __init__(self, path: Path, *, host: str | None, time_scale: float) -> None:
        self.path = path
        self.cell = load_cell(str(path))
        self.host = host or self.cell.robot.host
        self.pump_host = host or self.cell.pump.host
        self.pump_port = self.cell.pump.port
        self.time_scale = time_scale
        self.epoch = time.monotonic()
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
        trip: float = 0.5,
        pump_trace: Path | None = None,
    ) -> SimulatedCell:
        """Start both simulators and wait until they are ready.

        Args:
            cell: a cell file, or the name of a shipped one.
            time_scale: process seconds in a wall second.
            host: address for robot and pump instead of the cell's own.
            version: PolyScope version that the robot says it is.
            start_delay: wall seconds until an uploaded program starts.
            trip: wall seconds of silence after which the pump's drive trips; 0: never.
            pump_trace: file for flow and volume over process time.

        Raises:
            ConfigurationError: there is no such cell, or it is wrong.
            PortTakenError: something else listens there.
            CellUnreachable: a simulator does not start.
        """
        path = Path(find_configuration("cells", str(cell))).resolve()
        simulated = cls(path, host=host, time_scale=time_scale)
        controller = ["--version", version, "--start-delay", str(start_delay)]
        pump = ["--port", str(simulated.pump_port), "--trip", str(trip)]
        if pump_trace is not None:
            pump += ["--trace", str(pump_trace)]
        try:
            simulated._spawn("controller", simulated.host, controller)
            simulated._spawn("pump", simulated.pump_host, pump)
            deadline = time.monotonic() + START_TIME
            for child in simulated._children:
                child.wait_until_ready(deadline)
        except BaseException:
            simulated.stop()
            raise
        return simulated

    def inject(self, fault: Fault, **values: float) -> dict[str, Any]:
        """Ask for a fault; see `faults.inject`."""
        host = self.pump_host if fault.value.startswith("pump") else self.host
        return inject(host, fault, **values)

    def complaints(self) -> str:
        """What the simulators have written to stderr so far."""
        return "".join(child.complaints() for child in self._children)

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

    def stop(self) -> None:
        """End both simulators."""
        for child in self._children:
            child.ask_to_end()
        for child in self._children:
            child.end()
        self._children = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def _spawn(self, name: str, host: str, options: list[str]) -> None:
        clock = ["--time-scale", repr(self.time_scale), "--epoch", repr(self.epoch)]
        self._children.append(_Child(name, ["--cell", str(self.path), "--host", host, *clock, *options]))


class _Child:
    """One simulator process. Its standard input stays open as long as this process lives, and it ends with it."""

    def __init__(self, name: str, options: list[str]) -> None:
        self.name = name
        self._stderr: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `end`
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
        left = max(0.0, deadline - time.monotonic())
        readable, _, _ = select.select([self.process.stdout], [], [], left)
        if readable and self.process.stdout.readline().strip() == READY.encode():
            return
        if readable:
            self.process.wait(STOP_TIME)
        told = self.complaints().strip() or f"the simulated {self.name} was not ready after {START_TIME:g} s"
        raise (PortTakenError if " is taken" in told else CellUnreachable)(told)

    def complaints(self) -> str:
        self._stderr.flush()
        return os.pread(self._stderr.fileno(), 1 << 20, 0).decode("utf-8", "replace")

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
