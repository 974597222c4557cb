"""What is said to the pump's drive and what it answers, by the register map. Every call of pymodbus is in this file.

Drives with a heartbeat are written to in every exchange. The others take any request for a sign of life and are written
what has changed, as a serial line has no time to spare.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pymodbus import ModbusException
from pymodbus.client import AsyncModbusTcpClient
from pymodbus.framer import FramerType

from .pump_map import pump_map
from .pump_words import Register, StatusBit

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from pymodbus.pdu import ModbusPDU

    from planning import cell

    from .pump_words import RegisterTable

TIMEOUT = 0.1
"""For one request, s; pymodbus would take 12 s by default to notice a mute drive."""

SERIAL_TIMEOUT = 0.07
"""The same where a serial line is behind the connection, s: one lost answer, settling and another exchange are to take
less time than the drive is given to say anything good.
"""

HEARTBEAT_PERIOD = 0.1
"""Wall time between two counts of the heartbeat, s; a drive watches for half a second or more."""

SETTLING = 0.05
"""Time that a late answer is waited for beside that on a serial line, s, before something else is asked."""

_COUNTS = 1 << 16

# It reports every late answer to a cancelled request as an error; what matters is told by the age of the last good one.
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)


class NoGoodAnswerError(Exception):
    """The drive did not answer, or refused, or answered with what makes no sense."""


@dataclass(frozen=True)
class PumpReading:
    """One exchange with the drive.

    Attributes:
        command: flow that it was told, mm³/s.
        flow: flow that it reports, mm³/s.
        pressure: bar.
        tripped: whether it has stopped by itself.
        running: whether it says that it runs; None where it is not asked.
        beat: count of the heartbeat that it was last written.
        echo: count that it shows there; None where it is not asked.
    """

    command: float = 0.0
    flow: float = 0.0
    pressure: float = 0.0
    tripped: bool = False
    running: bool | None = None
    beat: int = 0
    echo: int | None = None


class PumpLink:
    """A connection to the drive.

    Args:
        settings: address and register map.

    Attributes:
        map: the register map.
        serial: whether there is a serial line behind the connection.
        timeout: for one request, s.
        wrote: whether the last command had anything to write.
        halted: set for good when nothing but a stop may be written any more.
    """

    def __init__(self, settings: cell.Pump) -> None:
        self.map = pump_map(settings)
        self.serial = self.map.transport == "rtu over tcp"
        self.timeout = SERIAL_TIMEOUT if self.serial else TIMEOUT
        self.wrote = self.halted = False
        self._settings = settings
        self._client: AsyncModbusTcpClient | None = None
        self._heartbeat, self._beat_at = 0, 0.0
        self._written: dict[str, list[int]] = {}  # what the drive has taken, where that is remembered
        self._owed = 0  # answers that are still to come
        self._expected_until = 0.0
        self._go_on = asyncio.Event()
        self._asked = self._worth_asking()

    @property
    def connected(self) -> bool:
        """Whether there is a connection; that says nothing of the drive."""
        return self._client is not None and self._client.connected

    async def connect(self) -> bool:
        """Connect, and from then on reconnect by itself; whether it did the first time."""
        self._client = AsyncModbusTcpClient(
            self._settings.host,
            port=self._settings.port,
            framer=FramerType.RTU if self.serial else FramerType.SOCKET,
            timeout=self.timeout,
            retries=0,
            reconnect_delay=0.05,
            reconnect_delay_max=0.5,
            trace_pdu=self._count_answers,
            trace_connect=self._owe_nothing,
        )
        return await self._client.connect()

    def close(self) -> None:
        """Disconnect."""
        if self._client is not None:
            self._client.close()

    def forget(self) -> None:
        """Write everything anew: it is not known what the drive has taken."""
        self._written.clear()

    async def settle(self) -> None:
        """Wait until no answer is to be expected that belongs to an earlier request, or until `hurry`."""
        self._go_on.clear()
        left = self._expected_until - time.monotonic()
        if self.serial and self._owed and left > 0.0:
            try:
                await asyncio.wait_for(self._go_on.wait(), left)
            except TimeoutError:
                self._owed = 0  # it is lost

    def hurry(self) -> None:
        """End the waiting that is under way."""
        self._go_on.set()

    async def command(self, flow: float) -> float:
        """Tell the drive to give a flow; the flow that it was told, mm³/s.

        Raises:
            NoGoodAnswerError: it may not have taken it.
            PumpError: the flow does not fit into its register.
        """
        at, commands = self.map.registers, self.map.commands
        told = self.map.told(flow)
        # A stop comes before the flow, a start after it: nothing runs at a flow that was left there.
        values = {"command": [commands.forward if told else commands.stop], "set_flow": self.map.words(flow)}
        if not told or at.heartbeat is not None:
            self._written.clear()
        values = {name: words for name, words in values.items() if self._written.get(name) != words}
        self.wrote = bool(values)
        for name in values:  # not known any more until the drive says so
            self._written.pop(name, None)
        places = {"command": at.command, "set_flow": at.set_flow}
        names = sorted(values, key=lambda name: places[name].address)
        together = len(names) == 2 and places[names[0]].addresses.stop == places[names[1]].address
        words = [word for name in names for word in values[name]]
        if together and len(words) <= self.map.words_at_once:
            await self._write(places[names[0]].address, words)
        else:
            for name in sorted(values, reverse=bool(told)):
                if told and self.halted:
                    raise NoGoodAnswerError("a stop came between")
                await self._write(places[name].address, values[name])
        self._written.update(values)
        return told

    async def beat(self) -> None:
        """Count the heartbeat, if it is due and the drive has one.

        Raises:
            NoGoodAnswerError: it may not have taken it.
        """
        at, now = self.map.registers.heartbeat, time.monotonic()
        if at is not None and now - self._beat_at > HEARTBEAT_PERIOD:
            self._heartbeat, self._beat_at = (self._heartbeat + 1) % _COUNTS, now
            await self._write(at.address, [self._heartbeat])

    async def measure(self, told: float) -> PumpReading:
        """Read what the drive measures and how it is.

        Raises:
            NoGoodAnswerError: it did not say.
        """
        asked = self._asked
        found = await self._read_words(list(asked.values()))

        def number(name: str, otherwise: float) -> float:
            place = asked.get(name)
            return _value(place, found) if isinstance(place, Register) else otherwise

        def state(name: str) -> bool | None:
            place = asked.get(name)
            return place.read(found[place.table, place.address]) if isinstance(place, StatusBit) else None

        return PumpReading(
            command=told,
            flow=self.map.flow(number("measured_flow", told / self.map.flow_factor)),
            pressure=number("pressure", 0.0),
            tripped=bool(state("tripped")),
            running=state("running"),
            beat=self._heartbeat,
            echo=round(number("heartbeat", 0.0)) if "heartbeat" in asked else None,
        )

    def _worth_asking(self) -> dict[str, Register | StatusBit]:
        """What is read in every exchange, by name; some of it only where that takes no request of its own."""
        at, states = self.map.registers, self.map.states
        always = {"measured_flow": at.measured_flow, "pressure": at.pressure, "tripped": states.tripped}
        asked = {name: place for name, place in always.items() if place is not None}
        for name, place in {"running": states.running, "heartbeat": at.heartbeat}.items():
            if place is not None:
                requests = self._requests([*asked.values(), place])
                if len(requests) == max(len(self._requests(list(asked.values()))), 1):
                    asked[name] = place
        return asked or {"command": at.command}

    async def _write(self, address: int, words: list[int]) -> None:
        """Write neighbouring registers."""
        assert self._client is not None
        if self.map.words_at_once == 1:
            answer = await self._good(self._client.write_register, address, words[0])
        else:
            answer = await self._good(self._client.write_registers, address, words)
        echoed = answer.function_code != 6 or answer.registers == words[:1] or not self.serial
        if answer.function_code not in {6, 16} or answer.address != address or not echoed:
            raise self._another()

    async def _read_words(self, wanted: list[Register | StatusBit]) -> dict[tuple[str, int], int]:
        """The words of some values, by table and address."""
        found: dict[tuple[str, int], int] = {}
        for table, first, count in self._requests(wanted):
            words = await self._read_registers(table, first, count)
            found |= {(table, first + i): word for i, word in enumerate(words)}
        return found

    def _requests(self, wanted: list[Register | StatusBit]) -> list[tuple[RegisterTable, int, int]]:
        """As few reads as the map allows: table, first address and count of each.

        What lies between two values is read along if the map knows it; a value is never cut in two.
        """
        requests: list[tuple[RegisterTable, int, int]] = []
        for place in sorted(wanted, key=lambda place: (place.table, place.address)):
            end = place.address + _count(place)
            if requests:
                table, first, count = requests[-1]
                known = all((table, at) in self.map.addresses for at in range(first, end))
                if place.table == table and known and end - first <= self.map.words_at_once:
                    requests[-1] = (table, first, max(count, end - first))
                    continue
            requests.append((place.table, place.address, _count(place)))
        return requests

    async def _read_registers(self, table: RegisterTable, first: int, count: int) -> list[int]:
        """Neighbouring registers from one request."""
        assert self._client is not None
        client = self._client
        read = client.read_input_registers if table == "input" else client.read_holding_registers
        await self.settle()
        answer = await self._good(read, first, count=count)
        if answer.function_code not in {3, 4} or len(answer.registers) != count:
            raise self._another()
        return list(answer.registers)

    async def _good(self, ask: Callable[..., Awaitable[ModbusPDU]], *values: Any, **named: Any) -> ModbusPDU:
        """The answer to a request, if it is a good one."""
        try:  # without a connection the call itself fails, not what it returns
            answer = await ask(*values, device_id=self.map.device_id, **named)
        except (ModbusException, OSError) as error:
            self._expect()
            raise NoGoodAnswerError(str(error)) from error
        except asyncio.CancelledError:
            self._expect()
            raise
        if answer.isError():
            self._expect()
            raise NoGoodAnswerError(f"it refuses with {answer}")
        return answer

    def _another(self) -> NoGoodAnswerError:
        """An answer to something else has come; the right one is still on its way."""
        self._owed = max(self._owed, 1)
        self._expect()
        return NoGoodAnswerError("it answers another request")

    def _expect(self) -> None:
        """Expect a late answer, which on a serial line looks like any other."""
        self._expected_until = time.monotonic() + SETTLING

    def _count_answers(self, sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        """Count what is sent and what comes back, whoever still waits for it."""
        self._owed = self._owed + 1 if sending else max(self._owed - 1, 0)
        if not self._owed:
            self._go_on.set()
        return pdu

    def _owe_nothing(self, _connected: bool) -> None:
        self._owed = 0
        self._go_on.set()


def _count(place: Register | StatusBit) -> int:
    return place.count if isinstance(place, Register) else 1


def _value(register: Register, found: dict[tuple[str, int], int]) -> float:
    """A value from the words that were read.

    Raises:
        NoGoodAnswerError: they are no number.
    """
    value = register.decode([found[register.table, address] for address in register.addresses])
    if not math.isfinite(value):
        raise NoGoodAnswerError(f"register {register.address} holds no number")
    return value
