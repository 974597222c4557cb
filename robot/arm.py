"""The supervisor's end of the arm process: starts it, gives it orders, hears its state, notices its end."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from planning import Program

from .errors import ArmError, CellUnreachable

READY_LIMIT = 10.0
"""Time for the arm process to connect, s; ur-rtde itself would wait for a mute controller for ever."""

BEAT_PERIOD = 0.05
"""Time between two heartbeats to the arm process, s."""

EXIT_LIMIT = 3.0
"""Time for it to stop the robot and exit before it is killed, s."""


@dataclass(frozen=True)
class ArmState:
    """What the arm process last said.

    Attributes:
        state: `starting`, `ready`, `loading`, `running`, `done` or `failed`.
        chunk: the chunk it speaks of; -1 for the move to the first waypoint.
        progress: index of the move in the chunk.
        window: time for which it may now be silent, s.
        message: why it failed.
    """

    state: str = "starting"
    chunk: int = -1
    progress: int = 0
    window: float = 0.0
    message: str = ""


class Arm:
    """The arm process as the supervisor sees it.

    Args:
        host: the controller.
        acceleration: of the TCP, mm/s².
        heard: called with every state that the process reports.
        lost: called once when the process has ended or closed its connection by itself.
    """

    def __init__(
        self, host: str, acceleration: float, *, heard: Callable[[ArmState], None], lost: Callable[[], None]
    ) -> None:
        self.state = ArmState()
        self.last_beat = time.monotonic()
        self._host, self._acceleration = host, acceleration
        self._heard, self._lost = heard, lost
        self._process: asyncio.subprocess.Process | None = None
        self._link: socket.socket | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._ready = asyncio.Event()
        self._ending = False
        self._last_line = ""

    @property
    def pid(self) -> int:
        """Process id, 0 before it is started."""
        return self._process.pid if self._process else 0

    async def start(self, program: Program) -> None:
        """Start the process and wait until it holds the robot.

        Raises:
            CellUnreachable: the controller does not let it in within `READY_LIMIT`.
            ArmError: the process ended.
        """
        self._folder = tempfile.TemporaryDirectory(prefix="twincell-")
        file = Path(self._folder.name) / "program.npz"
        await asyncio.to_thread(program.save, file)  # seconds for a long program, and the pump needs its beat
        self._link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._link.setblocking(False)
        with theirs:
            self._process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "robot.arm_process"),
                *(str(theirs.fileno()), self._host, str(file), str(self._acceleration)),
                pass_fds=(theirs.fileno(),),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.PIPE,
                start_new_session=True,  # a Ctrl-C in the terminal is the supervisor's to handle
            )
        asyncio.get_running_loop().add_reader(self._link, self._receive)
        self._tasks = [
            asyncio.create_task(self._beat()),
            asyncio.create_task(self._watch_exit(self._process)),
        ]
        exited = self._tasks[1]
        ready = asyncio.create_task(self._ready.wait())
        try:
            await asyncio.wait({exited, ready}, timeout=READY_LIMIT, return_when=asyncio.FIRST_COMPLETED)
        finally:
            ready.cancel()
        if exited.done():
            raise ArmError(self.epitaph())
        if not self._ready.is_set():
            self.kill()
            raise CellUnreachable(
                f"the robot at {self._host} answers but does not take a program within {READY_LIMIT:g} s (ports "
                "29999, 30003, 30004); check that it is on, in remote control, and driven by nobody else"
            )

    def approach(self) -> None:
        """Move to the program's first waypoint."""
        self._send({"do": "approach"})

    def run(self, chunk: int) -> None:
        """Execute a chunk."""
        self._send({"do": "run", "chunk": chunk})

    def stop(self) -> None:
        """Brake now; the process ends."""
        self._ending = True
        self._send({"do": "stop"})

    def quit(self) -> None:
        """End the script on the controller; the process ends."""
        self._ending = True
        self._send({"do": "quit"})

    def kill(self) -> None:
        """End the process at once; the controller's watchdog then stops the robot."""
        self._ending = True
        if self._process is not None and self._process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()

    async def close(self) -> None:
        """Wait for the process to end, and kill it if it does not; a second call does nothing."""
        self._ending = True
        if self._process is not None:
            try:
                await asyncio.wait_for(self._process.wait(), EXIT_LIMIT)
            except TimeoutError:
                self.kill()
                await self._process.wait()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._link is not None:
            asyncio.get_running_loop().remove_reader(self._link)
            self._link.close()
            self._link = None
        if self._folder is not None:
            self._folder.cleanup()

    def _send(self, message: dict[str, object]) -> None:
        if self._link is not None:
            with contextlib.suppress(OSError):  # its end is reported by its exit
                self._link.send(json.dumps(message).encode())

    def _receive(self) -> None:
        assert self._link is not None
        while True:
            try:
                message = self._link.recv(4096)
            except BlockingIOError:
                return
            except OSError:
                message = b""
            if not message:
                asyncio.get_running_loop().remove_reader(self._link)
                self._gone()
                return
            self.last_beat = time.monotonic()
            self.state = ArmState(**json.loads(message))
            self._ready.set()
            self._heard(self.state)

    async def _beat(self) -> None:
        while True:
            self._send({})
            await asyncio.sleep(BEAT_PERIOD)

    async def _watch_exit(self, process: asyncio.subprocess.Process) -> None:
        assert process.stderr is not None
        async for line in process.stderr:
            self._last_line = line.decode(errors="replace").strip() or self._last_line
        await process.wait()
        self._gone()

    def _gone(self) -> None:
        if not self._ending and self._ready.is_set():
            self._ending = True
            self._lost()

    def epitaph(self) -> str:
        """How and why the process ended, in a sentence."""
        code = self._process.returncode if self._process else None
        how = f"was ended by signal {-code}" if code is not None and code < 0 else "has ended"
        why = self.state.message or self._last_line
        return f"the arm process {how}" + (f": {why}" if why else "")
