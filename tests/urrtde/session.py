"""The clients of one robot, what was called of them, and what every step of the tour needs."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Callable
from contextlib import contextmanager
from typing import Any

from dashboard_client import DashboardClient
from observer import Observer
from rtde_control import RTDEControlInterface
from rtde_io import RTDEIOInterface
from rtde_receive import RTDEReceiveInterface
from script_client import ScriptClient

HOME = [0.0, -math.pi / 2, -math.pi / 2, -math.pi / 2, math.pi / 2, 0.0]

STEPS: list[tuple[str, Callable[[Session], dict[str, Any]]]] = []


def step(function):
    """Register a step of the tour; the steps run in the order in which they are written."""
    STEPS.append((function.__name__, function))
    return function


class Recorded:
    """An interface that notes which of its methods are asked for."""

    def __init__(self, interface, called: set[str]) -> None:
        self._interface, self._called = interface, called

    def __getattr__(self, name: str):
        self._called.add(name)
        return getattr(self._interface, name)


class Session:
    """All clients of one robot.

    Attributes:
        offset: of the registers: 0, or 24 in the upper range.
        called: names of the methods that were called, by interface.
        made_in: wall time of the constructors, s.
    """

    def __init__(self, host: str, version: tuple[int, int], *, upper: bool) -> None:
        self.host, self.version, self.upper = host, version, upper
        self.offset = 24 if upper else 0
        self.called: dict[str, set[str]] = {
            name: set() for name in ("control", "receive", "io", "dashboard", "script")
        }
        self.made_in: dict[str, float] = {}
        flags = RTDEControlInterface.FLAG_UPLOAD_SCRIPT
        if upper:
            flags |= RTDEControlInterface.FLAG_UPPER_RANGE_REGISTERS
        self.receive = self._made(
            "receive", lambda: RTDEReceiveInterface(host, -1.0, [], False, use_upper_range_registers=upper)
        )
        self.control = self._made("control", lambda: RTDEControlInterface(host, -1.0, flags))
        self.io = self._made("io", lambda: RTDEIOInterface(host, False, use_upper_range_registers=upper))
        self.dashboard = self._made("dashboard", lambda: DashboardClient(host))
        self.dashboard.connect()
        self._observer = Observer(host)
        self.script = self._made("script", lambda: ScriptClient(host, *version))

    def _made(self, name: str, make: Callable[[], Any]) -> Any:
        begun = time.monotonic()
        interface = make()
        self.made_in[name] = time.monotonic() - begun
        return Recorded(interface, self.called[name])

    # -- states

    def ready(self) -> None:
        """The robot is on, the script runs, and the arm rests at home."""
        if self.receive.isProtectiveStopped():
            self.dashboard.unlockProtectiveStop()
            until(lambda: not self.receive.isProtectiveStopped())
        if not self.control.isProgramRunning():
            self.upload()
        if not self.control.moveJ(HOME, 3.0, 30.0):
            self.upload()
            assert self.control.moveJ(HOME, 3.0, 30.0)
        self.settled()

    def upload(self) -> None:
        """Send the script again and wait until it runs."""
        self.ask("stop")
        until(lambda: not self.control.isProgramRunning())
        assert self.control.reuploadScript()
        until(self.control.isProgramRunning)

    def ask(self, line: str) -> str:
        """The dashboard's answer to one line, asked beside ur-rtde."""
        with (
            socket.create_connection((self.host, 29999), 2.0) as connection,
            connection.makefile("rw") as lines,
        ):
            lines.readline()
            lines.write(line + "\n")
            lines.flush()
            return lines.readline().strip()

    def speed(self) -> float:
        """Of the tool, m/s."""
        return math.hypot(*self.receive.getActualTCPSpeed()[:3])

    def moves(self) -> bool:
        """Whether any joint moves."""
        return any(self.receive.getActualQd())

    def settled(self) -> None:
        """Wait until the receiving client has seen the arm at rest."""
        self.news(5)
        until(lambda: not self.moves())

    def news(self, packages: int = 2) -> None:
        """Wait until the receiving client has been sent that many more packages."""
        for _ in range(packages):
            before = self.receive.getTimestamp()
            until(lambda before=before: self.receive.getTimestamp() != before)

    def ended(self) -> list[int]:
        """Wait until the asynchronous operation has ended; the progress that it told on its way."""
        progress: list[int] = []
        deadline = time.monotonic() + 8.0
        while (status := self.control.getAsyncOperationProgressEx()).isAsyncOperationRunning():
            if not progress or progress[-1] != status.progress():
                progress.append(status.progress())
            assert time.monotonic() < deadline, "the asynchronous operation did not end"
            time.sleep(0.001)
        return progress

    def at_rest(self) -> dict[str, Any]:
        """Where the arm stands."""
        self.settled()
        return {"q": self.receive.getActualQ(), "pose": self.receive.getActualTCPPose()}

    @contextmanager
    def watched(self):
        """Collects a row for each package that is sent meanwhile."""
        rows: list[list[float]] = []
        self._observer.rows = rows
        begun = self.receive.getTimestamp()
        self._observer.seen(begun)
        try:
            yield rows
        finally:
            self._observer.seen(self.receive.getTimestamp())
            self._observer.rows = []
            rows[:] = [
                row for row in rows if row[0] >= begun
            ]  # a late observer still heard of what was before


def until(condition: Callable[[], bool], seconds: float = 4.0) -> float:
    """Wait for something; the wall time that it took."""
    begun = time.monotonic()
    while not condition():
        if time.monotonic() > begun + seconds:
            raise TimeoutError("did not happen in time")
        time.sleep(0.001)
    return time.monotonic() - begun


def moved(pose, x=0.0, y=0.0, z=0.0):
    """A pose further along the base's axes."""
    return [pose[0] + x, pose[1] + y, pose[2] + z, *pose[3:]]
