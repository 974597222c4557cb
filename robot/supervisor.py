"""The supervisor: it follows the arm through each chunk, tells the pump what the place of the tool calls for, and
keeps the journal.

Whatever the guard, the pump, the arm process or the operator says against going on stops pump and arm at once; the
print then ends with an error, and nothing starts again by itself.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from planning import Cell, Program

from .arm import Arm, ArmState
from .chunks import Chunk
from .errors import ArmError, JournalError, PumpError, RobotError, StoppedError
from .journal import Journal
from .place import Tracker
from .pump import Pump
from .pump_law import Calibration, PumpLaw, Schedule, plan_time, schedule
from .pump_link import PumpReading
from .robot_state import RobotListener, RobotState
from .sampling import Sampler
from .watch import Guard, unsafe

CHECKPOINT_PERIOD = 0.2
"""Shortest wall time between two checkpoints, s."""

PROGRESS_PERIOD = 0.1
"""Wall time between two reports of progress, s."""

ARRIVED = 2.0
"""How near the end of a chunk the tool has to be when the arm says that it is done, mm."""


@dataclass(frozen=True)
class Progress:
    """How far a print has come.

    Attributes:
        layer, layers: the layer being printed, from 1, and their number; 0 before the first.
        fraction: share of the program's time that is done, 0 to 1.
        time_left_s: process time to go at the present speed slider, s; infinite while it is at 0.
        flow: that the pump reports, mm³/s.
        speed: of the TCP, mm/s.
    """

    layer: int
    layers: int
    fraction: float
    time_left_s: float
    flow: float
    speed: float


class Supervisor:
    """One print, from the first connection to the last."""

    def __init__(
        self,
        program: Program,
        chunks: tuple[Chunk, ...],
        cell: Cell,
        journal: Journal,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self._program, self._chunks, self._cell = program, chunks, cell
        self._journal, self._progress = journal, progress
        self._calibration = Calibration(cell.pump.dead_time_s, cell.pump.lag_s, cell.pump.flow_max)
        self._error: RobotError | None = None
        self._unstopped: PumpError | None = None
        self._connecting: asyncio.Task[None] | None = None
        self._news = asyncio.Event()
        self._state: RobotState | None = None
        self._reading = PumpReading()
        self._chunk: Chunk | None = None
        self._plan: Schedule | None = None
        self._law: PumpLaw | None = None
        self._tracker: Tracker | None = None
        self._pumping = False  # the arm process says that the chunk is being executed
        self._layer = 0
        self._layers = int(program.layer.max()) + 1
        self._sampler = Sampler(journal.sample)
        self._checked = 0.0
        self._reported = 0.0
        self._guard = Guard(lambda reason: self._stop(StoppedError(f"{reason}{self._where()}")))
        self._listener = RobotListener(self._see, self._guard.lose)
        self._pump = Pump(
            cell.pump, read=self._read, failed=lambda why: self._stop(PumpError(f"{why}{self._where()}"))
        )
        self._arm = Arm(cell.robot.host, cell.robot.acceleration, heard=self._hear, lost=self._lose_arm)

    async def run(self) -> None:
        """Print.

        Raises:
            RobotError: the print was stopped, or the pump has not confirmed that it stops.
        """
        try:
            await self._supervise()
        except Exception as error:
            if self._unstopped is None:
                raise
            raise PumpError(f"{error}; {self._unstopped}") from error
        if self._unstopped is not None:
            raise self._unstopped

    async def _supervise(self) -> None:
        patrol: asyncio.Task[None] | None = None
        with self._interruptible():
            try:
                await self._connect()
                self._guard.arm()
                patrol = asyncio.create_task(self._guard.patrol())
                patrol.add_done_callback(self._unguarded)
                await self._print()
                self._guard.disarm()
                self._arm.quit()
            finally:
                # On every way out, with or without an error: pump and arm are told first, then waited for.
                self._guard.disarm()
                self._pump.stop()
                self._arm.stop()
                if patrol is not None:
                    patrol.cancel()
                await self._arm.close()
                await self._shut()
                self._listener.close()
                with self._journalling():
                    self._sampler.flush()

    async def _shut(self) -> None:
        """End the pump's task; a pump that may still run is what the operator has to know first."""
        try:
            await self._pump.close()
        except PumpError as error:
            self._unstopped = error
            with contextlib.suppress(JournalError):
                self._journal.event("pump", str(error), self._now)

    async def _connect(self) -> None:
        """Connect to robot and pump, and start the arm process; a stop cuts it short."""

        async def connect() -> None:
            self._check_robot(await self._listener.connect(self._cell.robot.host))
            await self._pump.start()
            await self._arm.start(self._program)

        self._connecting = asyncio.create_task(connect())
        try:
            await self._connecting
        except asyncio.CancelledError:
            if self._error is None:
                raise
        finally:
            self._connecting = None
        if self._error is not None:
            raise self._error

    async def _print(self) -> None:
        self._guard.expect()
        self._arm.approach()
        await self._done(-1)
        away = (
            float(np.linalg.norm(self._state.position - self._program.positions[0]))
            if self._state
            else math.inf
        )
        if away > ARRIVED:
            raise ArmError(
                f"the arm ended {away:.1f} mm away from the program's first waypoint; look at its pendant"
            )
        for chunk in self._chunks:
            await self._stand(chunk.wait)
            if not len(chunk):
                continue
            self._journal.event(
                "chunk", f"chunk {chunk.index} begins", self._now, chunk=chunk.index, waypoint=chunk.start
            )
            self._chunk, self._plan = chunk, schedule(self._program, chunk, self._cell.robot.acceleration)
            self._law = PumpLaw(self._plan, self._calibration)
            self._tracker = Tracker(self._program, chunk)
            self._guard.expect()
            self._arm.run(chunk.index)
            await self._done(chunk.index)
            self._pumping = False
            left = self._tracker.length - self._tracker.place.travelled
            if left > ARRIVED:
                raise ArmError(
                    f"the arm ended chunk {chunk.index} {left:.1f} mm before its end{self._where()}"
                )

    async def _done(self, chunk: int) -> None:
        """Wait until the arm process has executed a chunk; -1 for the move to the first waypoint."""
        while not (self._arm.state.state == "done" and self._arm.state.chunk == chunk):
            await self._wait()

    async def _stand(self, seconds: float) -> None:
        """Stand still for a process time."""
        until = self._now + seconds
        while self._now < until:
            await self._wait()

    async def _wait(self) -> None:
        """Wait a little for something to happen.

        Raises:
            RobotError: the print was stopped.
        """
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(PROGRESS_PERIOD):
                await self._news.wait()
        self._news.clear()
        if self._error is not None:
            if isinstance(self._error, ArmError):
                await self._arm.close()  # its last words say why, unless the robot itself does
                reason = unsafe(self._state) if self._state else None
                if reason is not None:
                    raise StoppedError(f"{reason}{self._where()}") from self._error
                raise ArmError(f"{self._arm.epitaph()}{self._where()}") from self._error
            raise self._error
        if self._progress is not None and time.monotonic() - self._reported > PROGRESS_PERIOD:
            self._reported = time.monotonic()
            self._progress(self._how_far())

    def _stop(self, error: RobotError) -> None:
        """Stop pump and arm now; the first reason is the one that counts."""
        self._pump.stop()
        self._arm.stop()
        if self._error is None:
            self._error = error
            if self._connecting is not None:
                self._connecting.cancel()
            self._guard.disarm()
            with contextlib.suppress(JournalError):
                self._journal.event("stop", str(error), self._now)
        self._news.set()

    def _see(self, state: RobotState) -> None:
        """A package from the robot: the innermost loop of a print."""
        self._state = state
        self._guard.see(state)
        flow = 0.0
        if self._tracker is not None and self._law is not None:
            place = self._tracker.update(state.position)
            wanted = self._law.flow(
                place.move,
                place.fraction,
                time=state.time,
                rate=state.rate,
                latency=self._pump.latency * self._listener.pace,
            )
            if self._pumping and state.playing and self._error is None:
                flow = wanted
        self._pump.set(flow)
        self._sampler.see(state, *self._at())
        self._check_point(state)

    def _read(self, reading: PumpReading) -> None:
        """An answer from the pump."""
        stopped = self._error is not None and reading.command == 0.0 and self._reading.command > 0.0
        self._reading = reading
        with self._journalling():
            self._sampler.read(reading)
            if stopped:
                self._journal.event("pump", "the pump has been told to stop", self._now, flow=reading.flow)

    def _hear(self, state: ArmState) -> None:
        """A word from the arm process."""
        self._guard.hear(state.window)
        self._pumping = (
            state.state == "running" and self._chunk is not None and state.chunk == self._chunk.index
        )
        if state.state == "failed":
            self._stop(ArmError(state.message))
        elif state.state == "done":
            self._news.set()

    def _unguarded(self, patrol: asyncio.Task[None]) -> None:
        """The guard's patrol has ended; without it nothing may go on."""
        if not patrol.cancelled() and (error := patrol.exception()) is not None:
            self._stop(StoppedError(f"the guard has failed: {error!r}{self._where()}"))

    def _lose_arm(self) -> None:
        self._stop(ArmError("the arm process has ended"))

    def _check_robot(self, state: RobotState) -> None:
        reason = unsafe(state)
        if reason is not None:
            raise StoppedError(reason)

    def _check_point(self, state: RobotState) -> None:
        if (
            time.monotonic() - self._checked < CHECKPOINT_PERIOD
            or self._chunk is None
            or self._tracker is None
        ):
            return
        self._checked = time.monotonic()
        target = int(self._chunk.target[self._tracker.place.move])
        passed = target if self._tracker.place.fraction == 1.0 else target - 1
        with self._journalling():
            self._journal.checkpoint(state.time, self._chunk.index, passed)

    @contextlib.contextmanager
    def _journalling(self) -> Iterator[None]:
        """A journal that fails stops the print."""
        try:
            yield
        except JournalError as error:
            self._stop(error)

    @contextlib.contextmanager
    def _interruptible(self) -> Iterator[None]:
        """Ctrl-C, a closed terminal and a request to terminate stop the print, and do not end this process."""
        loop = asyncio.get_running_loop()
        with contextlib.suppress(ValueError):  # some libraries let a closed connection end the process
            signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        added = []
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            with contextlib.suppress(ValueError, RuntimeError):  # only the main thread is sent signals
                loop.add_signal_handler(
                    number, lambda: self._stop(StoppedError(f"stopped by the operator{self._where()}"))
                )
                added.append(number)
        try:
            yield
        finally:
            for number in added:
                loop.remove_signal_handler(number)

    @property
    def _now(self) -> float:
        return self._state.time if self._state else math.nan

    def _at(self) -> tuple[int, int]:
        """Waypoint that the arm is moving to and its segment; -1 before the first chunk."""
        if self._chunk is None or self._tracker is None:
            return -1, -1
        move = self._tracker.place.move
        return int(self._chunk.target[move]), int(self._chunk.segment[move])

    def _where(self) -> str:
        waypoint, segment = self._at()
        if waypoint < 0:
            return ", before the first waypoint"
        found = self._program.segments[segment]
        bead = f"layer {found.layer}, curve {found.curve}, " if found.layer >= 0 else ""
        return f", {bead}on the way to waypoint {waypoint} ({found.kind})"

    def _how_far(self) -> Progress:
        waypoint, _ = self._at()
        state, total = self._state, self._program.duration
        at, rate = 0.0, state.rate if state else 0.0
        if self._plan is not None and self._tracker is not None:
            at = plan_time(self._plan, self._tracker.place.move, self._tracker.place.fraction)
            self._layer = max(self._layer, int(self._program.layer[waypoint]) + 1)
        return Progress(
            layer=self._layer,
            layers=self._layers,
            fraction=float(np.clip(at / total, 0.0, 1.0)) if total > 0 else 0.0,
            time_left_s=(total - at) / rate if rate > 0 else math.inf,
            flow=self._reading.flow,
            speed=state.speed if state else 0.0,
        )
