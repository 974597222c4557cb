"""The pump over Modbus: one set-point slot, one request at a time.

A single task exchanges command and measurement with the drive, by the period or as soon as the set-point has
changed noticeably. There is no queue: what it sends is the newest set-point there is. A stop cuts short the
exchange that is under way and sends a zero next, and nothing but zeros from then on, until the drive shows that it has
heard. Whether the drive lives is judged by the age of its last good answer; an open connection says nothing.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable

from planning import cell

from .errors import CellUnreachable, PumpError
from .pump_judge import FAINT, PumpJudge
from .pump_link import NoGoodAnswerError, PumpLink, PumpReading

LOSS = 0.25
"""Age of the last good answer at which the drive is lost, s of wall time."""

STOPPING = 0.5
"""Time to confirm a stop, beside the drive's answer, s."""

SLOWER = 0.9
"""Share of the flow before a stop below which it is seen to be obeyed."""

CONNECT_LIMIT = 3.0
"""Time for the drive to answer at first, s."""

RETRY_PAUSE = 0.05
"""Time between two attempts at that, s."""

LOOK_PERIOD = 0.01
"""Wall time between two looks at that age, s."""

NOTICEABLE = 0.005
"""Share of the largest flow by which the set-point has to change to be sent before its period is over."""

GRACE = 0.01
"""Time that a stop leaves the request under way, s; two requests in one packet are more than some drives take. Through
a serial gateway it is left its whole time: frames have no number there, and a late answer would be taken for the next.
"""

SMOOTHING = 0.05
"""Weight of the newest exchange in the mean latency."""


class Pump:
    """The drive as the supervisor sees it.

    Args:
        settings: address, register map, period and largest flow.
        read: called with every good answer.
        failed: called once when the drive is lost, refuses, trips or does not do what it is told, with a sentence.

    Attributes:
        latency: mean wall time from a set-point until it acts in the drive, s; half of its stay there is included.
    """

    def __init__(
        self, settings: cell.Pump, *, read: Callable[[PumpReading], None], failed: Callable[[str], None]
    ) -> None:
        self.latency = 0.0
        self._settings, self._read, self._failed = settings, read, failed
        self._where = f"the pump at {settings.host}:{settings.port}"
        self._link = PumpLink(settings)
        self._judge = PumpJudge(settings, self._link.map)
        self._noticeable = NOTICEABLE * settings.flow_max
        self._wanted, self._wanted_since = 0.0, 0.0
        self._sent = 0.0
        self._pumped = 0.0  # flow that was measured before the last stop
        self._stands = self._told_to_stand = True
        self._shown = ""
        self._patience_ends = math.inf
        self._stopped = self._closing = self._complained = False
        self._wake = asyncio.Event()
        self._answered = 0.0
        self._trouble = "no answer"
        self._task: asyncio.Task[None] | None = None
        self._watch_task: asyncio.Task[None] | None = None
        self._exchange_task: asyncio.Task[PumpReading | None] | None = None

    async def start(self) -> None:
        """Connect, tell the drive to stand, and begin to exchange.

        Raises:
            CellUnreachable: no connection, or no good answer.
            PumpError: the drive has tripped and does not reset on a stop command, its register cannot hold the
                largest flow, or it wants to be spoken to more often than it is.
        """
        self._check()
        try:
            async with asyncio.timeout(CONNECT_LIMIT):
                if not await self._link.connect():
                    raise CellUnreachable(
                        f"{self._where} refuses the connection; check address, cable and power"
                    )
                reading = await self._first_exchange()
        except TimeoutError:
            raise CellUnreachable(
                f"{self._where} gives no good answer within {CONNECT_LIMIT:g} s ({self._trouble}); check address, "
                f"device id {self._link.map.device_id} and register map '{self._link.map.name}'"
            ) from None
        if reading.tripped:
            raise PumpError(f"{self._where} has tripped; reset it at the drive")
        self._task = asyncio.create_task(self._serve())
        self._watch_task = asyncio.create_task(self._watch())
        for task in (self._task, self._watch_task):
            task.add_done_callback(self._ended)

    async def _first_exchange(self) -> PumpReading:
        """Try until the drive answers well.

        Raises:
            TimeoutError: it does not.
        """
        limit = time.monotonic() + CONNECT_LIMIT  # of its own: a cancellation that meets an answer is lost
        while (reading := await self._try_exchange(0.0)) is None:
            if time.monotonic() > limit:
                raise TimeoutError
            await asyncio.sleep(RETRY_PAUSE)
        return reading

    def set(self, flow: float) -> None:
        """Ask for a flow, mm³/s. The newest one counts; after a stop none does."""
        if self._stopped:
            return
        if self._wanted and not flow:
            self._link.hurry()
        self._wanted, self._wanted_since = flow, time.monotonic()
        if abs(flow - self._sent) > self._noticeable or (flow == 0.0) != (self._sent == 0.0):
            self._wake.set()

    def stop(self) -> None:
        """Stand now, and until the end."""
        if self._stopped:
            return
        self._halt()
        self._link.hurry()
        if self._exchange_task is not None:
            grace = self._link.timeout if self._link.serial else GRACE
            asyncio.get_running_loop().call_later(grace, self._exchange_task.cancel)
        self._wake.set()

    def _halt(self) -> None:
        """Write nothing but zeros from now on, the first of them at once."""
        self._stopped = self._link.halted = True
        self._told_to_stand = False
        self._wanted, self._wanted_since = 0.0, time.monotonic()

    async def close(self) -> None:
        """Tell the drive to stand until it shows that it has heard, and disconnect.

        Raises:
            PumpError: it does not show it; it may still be pumping.
        """
        self.stop()
        # Asked, not cancelled: a cancellation that meets an arriving answer is lost in the client.
        self._closing = True
        if self._watch_task is not None:
            self._watch_task.cancel()
        if self._task is not None:
            await asyncio.gather(self._task, return_exceptions=True)
        if self._link.connected or not self._stands:
            standing = self._exchange_task or asyncio.create_task(self._stand())
            answer = self._settings.dead_time_s + self._settings.lag_s
            self._patience_ends = time.monotonic() + (LOSS if self._stands else STOPPING + answer)
            for reading in await asyncio.gather(standing, return_exceptions=True):
                if isinstance(reading, PumpReading):
                    self._read(reading)
        self._link.close()
        if not self._stands:
            raise PumpError(
                f"{self._where} (map '{self._link.map.name}', device {self._link.map.device_id}) has not confirmed "
                f"that it stops ({self._shown or self._trouble}) and may still be pumping: stop it at the drive or by "
                "the emergency stop"
            )

    async def _stand(self) -> PumpReading | None:
        """Tell the drive to stand until it shows that it has heard, or patience ends."""
        while time.monotonic() < self._patience_ends:
            reading = await self._try_exchange(0.0)
            if reading is not None and self._stands:
                return reading
            await asyncio.sleep(LOOK_PERIOD)
        return None

    def _obeys(self, reading: PumpReading) -> bool:
        """Whether a drive that was told to stand shows that it does, or at least that it becomes slower."""
        if reading.running is False or reading.flow < SLOWER * self._pumped:
            return True
        return reading.running is None and reading.flow <= FAINT * self._settings.flow_max

    async def _serve(self) -> None:
        loop = asyncio.get_running_loop()
        while not self._closing:
            due = loop.time() + self._settings.period_s
            try:
                async with asyncio.timeout_at(due):
                    await self._wake.wait()
            except TimeoutError:
                pass
            self._wake.clear()
            reading = await self._interruptible_exchange()
            if reading is not None:
                self._read(reading)
                fault = self._judge.fault(reading, time.monotonic())
                if reading.tripped:
                    self._complain(f"{self._where} has tripped; look at the drive")
                elif fault is not None and not self._stopped:
                    self._complain(f"{self._where} {fault}")

    async def _watch(self) -> None:
        """Look at the age of the last good answer, also while a request is waiting for its own."""
        looked = self._answered = time.monotonic()
        excused = False
        while True:
            await asyncio.sleep(LOOK_PERIOD)
            now = time.monotonic()
            # A late look says that this process itself was held up: an answer may be waiting to be read, once.
            excused = now - looked >= 3.0 * LOOK_PERIOD and not excused
            if now - self._answered > LOSS and not excused and not self._stopped:
                self._complain(f"{self._where} has given no good answer for {LOSS:g} s ({self._trouble})")
            looked = now

    async def _interruptible_exchange(self) -> PumpReading | None:
        """One exchange, cut short by a stop."""
        self._exchange_task = asyncio.create_task(self._try_exchange(self._wanted))
        try:
            return await self._exchange_task
        except asyncio.CancelledError:
            this = asyncio.current_task()
            if this is not None and this.cancelling():
                self._exchange_task.cancel()
                raise
            return None
        finally:
            self._exchange_task = None

    def _check(self) -> None:
        self._link.map.words(self._settings.flow_max)
        alive = self._link.map.keep_alive_s
        if alive is not None and self._settings.period_s > 0.5 * alive:
            raise PumpError(
                f"pump '{self._link.map.name}' wants a request every {alive:g} s while it runs (keep_alive_s); the "
                f"cell's [pump] period_s of {self._settings.period_s:g} s leaves no room for a lost one, at most half "
                "of it does"
            )

    async def _try_exchange(self, flow: float) -> PumpReading | None:
        """One exchange, or None where the drive did not answer well."""
        if flow and self._stopped:
            return None  # on to the zero
        if self._link.map.told(flow) or self._told_to_stand:  # what first tells it to stand waits for nothing
            await self._link.settle()
            if flow and self._stopped:
                return None
            flow = self._wanted if flow else 0.0
        began = time.monotonic()
        since = self._wanted_since
        self._told_to_stand = not self._link.map.told(flow)
        if self._stands and self._link.map.told(flow):
            self._stands, self._pumped = False, 0.0
        self._shown = ""
        try:
            told = await self._link.command(flow)
            written = time.monotonic()
            if self._stopped and told:
                return None  # on to the zero
            await self._link.beat()
            reading = await self._link.measure(told)
        except NoGoodAnswerError as error:
            self._trouble = str(error)
            self._link.forget()
            return None
        if self._link.wrote:
            self._note_latency(since, began, written)
        if told:
            self._pumped = reading.flow
        elif not self._stands:
            self._stands = self._obeys(reading)
            runs = " and says that it runs" if reading.running else ""
            self._shown = f"it answers, measures {reading.flow:g} mm³/s{runs}"
        self._sent = flow
        self._answered = time.monotonic()
        return reading

    def _note_latency(self, since: float, began: float, written: float) -> None:
        """Take an exchange into the mean: waiting, half of the way to the drive and back, half of the time until the
        next one, which in a ramp follows at once.
        """
        latest = (began - since) + 0.5 * (written - began) + 0.5 * (time.monotonic() - began)
        if since and latest < LOSS:
            self.latency += (SMOOTHING if self.latency else 1.0) * (latest - self.latency)

    def _ended(self, task: asyncio.Task[None]) -> None:
        """A task of this class has ended: by itself it never should."""
        if not task.cancelled() and (error := task.exception()) is not None:
            self._halt()
            if task is self._task:
                self._exchange_task = asyncio.create_task(self._stand())
            self._complain(f"the exchange with {self._where} has failed: {error!r}")

    def _complain(self, why: str) -> None:
        if not self._complained:
            self._complained = True
            self._failed(why)
