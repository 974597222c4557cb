"""The pump over Modbus TCP: one set-point slot, one request at a time. Every call of pymodbus is in this file.

A single task exchanges command and measurement with the drive, by the period or as soon as the set-point has
changed noticeably. There is no queue: what it sends is the newest set-point there is. A stop cuts short the
exchange that is under way and sends a zero next, and nothing but zeros from then on. Whether the drive lives is
judged by the age of its last good answer; an open connection says nothing.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

from pymodbus import ModbusException
from pymodbus.client import AsyncModbusTcpClient

from planning import cell

from .errors import CellUnreachable, PumpError
from .pump_map import RUN, STOP, TRIPPED_BIT, PumpMap, load_pump_map

TIMEOUT = 0.1
"""For one request, s; pymodbus would take 12 s by default to notice a mute drive."""

LOSS = 0.25
"""Age of the last good answer at which the drive is lost, s of wall time."""

CONNECT_LIMIT = 3.0
"""Time for the drive to answer at first, s."""

LOOK_PERIOD = 0.01
"""Wall time between two looks at that age, s."""

NOTICEABLE = 0.005
"""Share of the largest flow by which the set-point has to change to be sent before its period is over."""

HEARTBEAT_PERIOD = 0.1
"""Wall time between two counts of the heartbeat, s; a drive watches for half a second or more."""

GRACE = 0.01
"""Time that a stop leaves the request under way, s; two requests in one packet are more than some drives take."""

SMOOTHING = 0.05
"""Weight of the newest exchange in the mean latency."""

_COUNTS = 1 << 16

# It reports every late answer to a cancelled request as an error; what matters is told by the age of the last good one.
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)


@dataclass(frozen=True)
class PumpReading:
    """One exchange with the drive.

    Attributes:
        command: flow that it was told, mm³/s.
        flow: flow that it reports, mm³/s.
        pressure: bar.
        tripped: whether it has stopped by itself.
    """

    command: float = 0.0
    flow: float = 0.0
    pressure: float = 0.0
    tripped: bool = False


class Pump:
    """The drive as the supervisor sees it.

    Args:
        settings: address, register map, period and largest flow.
        read: called with every good answer.
        failed: called once when the drive is lost, refuses or trips, with a sentence.

    Attributes:
        latency: mean wall time from a set-point until it acts in the drive, s; half of its stay there is included.
    """

    def __init__(
        self, settings: cell.Pump, *, read: Callable[[PumpReading], None], failed: Callable[[str], None]
    ) -> None:
        self.latency = 0.0
        self._settings, self._read, self._failed = settings, read, failed
        self._where = f"the pump at {settings.host}:{settings.port}"
        self._map: PumpMap = load_pump_map(settings.registers)
        self._noticeable = NOTICEABLE * settings.flow_max
        self._wanted, self._wanted_since = 0.0, 0.0
        self._sent = 0.0
        self._stopped = self._closing = self._complained = False
        self._wake = asyncio.Event()
        self._answered = 0.0
        self._heartbeat, self._beat_at = 0, 0.0
        self._trouble = "no answer"
        self._client: AsyncModbusTcpClient | None = None
        self._task: asyncio.Task[None] | None = None
        self._judge_task: asyncio.Task[None] | None = None
        self._exchange_task: asyncio.Task[PumpReading | None] | None = None

    async def start(self) -> None:
        """Connect, tell the drive to stand, and begin to exchange.

        Raises:
            CellUnreachable: no connection, or no good answer.
            PumpError: the drive has tripped and does not reset on a stop command, or its register cannot hold the
                largest flow.
        """
        self._map.counts(self._settings.flow_max)
        self._client = AsyncModbusTcpClient(
            self._settings.host,
            port=self._settings.port,
            timeout=TIMEOUT,
            retries=0,
            reconnect_delay=0.05,
            reconnect_delay_max=0.5,
        )
        try:
            async with asyncio.timeout(CONNECT_LIMIT):
                if not await self._client.connect():
                    raise CellUnreachable(
                        f"{self._where} refuses the connection; check address, cable and power"
                    )
                reading = None
                while reading is None:
                    reading = await self._try_exchange(0.0)
        except TimeoutError:
            raise CellUnreachable(
                f"{self._where} gives no good answer within {CONNECT_LIMIT:g} s ({self._trouble}); check address, "
                f"device id {self._map.device_id} and register map '{self._map.name}'"
            ) from None
        if reading.tripped:
            raise PumpError(f"{self._where} has tripped; reset it at the drive")
        self._task = asyncio.create_task(self._serve())
        self._judge_task = asyncio.create_task(self._judge())
        for task in (self._task, self._judge_task):
            task.add_done_callback(self._ended)

    def set(self, flow: float) -> None:
        """Ask for a flow, mm³/s. The newest one counts; after a stop none does."""
        if self._stopped:
            return
        self._wanted, self._wanted_since = flow, time.monotonic()
        if abs(flow - self._sent) > self._noticeable or (flow == 0.0) != (self._sent == 0.0):
            self._wake.set()

    def stop(self) -> None:
        """Stand now, and until the end."""
        if self._stopped:
            return
        self._stopped = True
        self._wanted, self._wanted_since = 0.0, time.monotonic()
        if self._exchange_task is not None:
            asyncio.get_running_loop().call_later(GRACE, self._exchange_task.cancel)
        self._wake.set()

    async def close(self) -> None:
        """Tell the drive to stand, and disconnect."""
        self.stop()
        # Asked, not cancelled: a cancellation that meets an arriving answer is lost in the client.
        self._closing = True
        if self._judge_task is not None:
            self._judge_task.cancel()
        if self._task is not None:
            await asyncio.gather(self._task, return_exceptions=True)
        if self._client is not None:
            if self._client.connected:
                await self._try_exchange(0.0)
            self._client.close()

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
                if reading.tripped:
                    self._complain(f"{self._where} has tripped; look at the drive")

    async def _judge(self) -> None:
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

    async def _try_exchange(self, flow: float) -> PumpReading | None:
        """One exchange, or None where the drive did not answer well."""
        began = time.monotonic()
        since = self._wanted_since
        try:
            at = self._map.registers
            counts = self._map.counts(flow)
            await self._write({at.command: RUN if counts else STOP, at.set_flow: counts})
            written = time.monotonic()
            if self._stopped and counts:
                return None  # on to the zero
            if written - self._beat_at > HEARTBEAT_PERIOD:
                self._heartbeat, self._beat_at = (self._heartbeat + 1) % _COUNTS, written
                await self._write({at.heartbeat: self._heartbeat})
            values = await self._read_registers(at.measured_flow, at.status, at.pressure)
        except (ModbusException, OSError) as error:
            self._trouble = str(error)
            return None
        self._note_latency(since, began, written)
        self._sent = flow
        self._answered = time.monotonic()
        return PumpReading(
            command=self._map.flow(counts),
            flow=self._map.flow(values[0]),
            pressure=self._map.pressure(values[2]),
            tripped=bool(values[1] & TRIPPED_BIT),
        )

    async def _write(self, values: dict[int, int]) -> None:
        """Write registers by address, neighbours together."""
        assert self._client is not None
        addresses = sorted(values)
        while addresses:
            run = [addresses[0] + i for i in range(len(addresses)) if addresses[i] == addresses[0] + i]
            answer = await self._client.write_registers(
                run[0], [values[a] for a in run], device_id=self._map.device_id
            )
            if answer.isError():
                raise ModbusException(f"it refuses to write register {run[0]}: {answer}")
            addresses = addresses[len(run) :]

    async def _read_registers(self, *addresses: int) -> list[int]:
        """Registers by address, from one request."""
        assert self._client is not None
        first, last = min(addresses), max(addresses)
        answer = await self._client.read_holding_registers(
            first, count=last - first + 1, device_id=self._map.device_id
        )
        if answer.isError() or len(answer.registers) != last - first + 1:
            raise ModbusException(f"it refuses to read registers {first} to {last}: {answer}")
        return [answer.registers[address - first] for address in addresses]

    def _note_latency(self, since: float, began: float, written: float) -> None:
        """Take an exchange into the mean: waiting, half of the way to the drive and back, half of the time until the
        next one, which in a ramp follows at once.
        """
        latest = (began - since) + 0.5 * (written - began) + 0.5 * (time.monotonic() - began)
        if since and latest < LOSS:
            self.latency += SMOOTHING * (latest - self.latency)

    def _ended(self, task: asyncio.Task[None]) -> None:
        """A task of this class has ended: by itself it never should."""
        if not task.cancelled() and (error := task.exception()) is not None:
            self._stopped = True
            self._exchange_task = asyncio.create_task(self._try_exchange(0.0))
            self._complain(f"the exchange with {self._where} has failed: {error!r}")

    def _complain(self, why: str) -> None:
        if not self._complained:
            self._complained = True
            self._failed(why)
