"""The pump's runtime against the simulated drive, with every map: it is led, stopped at once, and watched."""

import asyncio
import contextlib
import os
import re
import signal
import time

import pytest
from pumps.alone import cell_file, pump_alone
from waiting import timed

from planning import load_cell
from robot.errors import CellUnreachable, PumpError
from robot.pump import LOSS, STOPPING, Pump
from robot.pump_judge import DOUBT
from robot.simulation import Fault

HOST = "127.0.34.30"
FLOW = 9000.0
SERVED = [
    ("generic", "tcp"),
    ("generic", "rtu over tcp"),
    ("m-tec-p20", "rtu over tcp"),
    ("accelerator-doser", "tcp"),
]


@pytest.fixture(scope="module", params=SERVED, ids=" ".join)
def drive(request, tmp_path_factory):
    name, transport = request.param
    path = cell_file(
        tmp_path_factory.mktemp("cell"),
        name,
        host=HOST,
        transport=transport,
        period_s=0.02,
        dead_time_s=0.05,
        lag_s=0.05,
    )
    with pump_alone(HOST, path) as alone:
        yield alone


@pytest.fixture
def serial_line(drive):
    """Each request takes as long as one of 8 bytes and its answer at 19200 baud."""
    drive.inject(Fault.PUMP_SLOW, seconds=0.013)
    yield
    drive.inject(Fault.PUMP_SLOW, seconds=0.0)


class Led:
    """A pump that is being led, and what it has told."""

    def __init__(self, settings):
        self.readings, self.failures, self.closed = [], [], False
        self.pump = Pump(settings, read=self.readings.append, failed=self._fail)

    def _fail(self, why):
        self.failures.append((time.monotonic(), why))

    async def __aenter__(self):
        await self.pump.start()
        return self

    async def __aexit__(self, *error):
        if not self.closed:
            await self.close()

    async def close(self):
        self.closed = True
        await self.pump.close()

    async def flow(self, flow, seconds):
        for _ in range(round(seconds / 0.01)):
            self.pump.set(flow)
            await asyncio.sleep(0.01)

    async def until_failed(self, limit=2.0, flow=FLOW):
        async with asyncio.timeout(limit):
            while not self.failures:
                self.pump.set(flow)
                await asyncio.sleep(0.005)
        return self.failures[0]


@timed
def test_it_is_led_and_stopped_at_once(drive):
    async def lead():
        async with Led(drive.cell.pump) as led:
            await led.flow(FLOW, 0.6)
            told = drive.report()
            assert told["state"] == "forward"
            assert told["speed"] == pytest.approx(FLOW, rel=0.01)
            assert led.readings[-1].command == pytest.approx(told["speed"], rel=1e-6)
            assert led.readings[-1].flow == pytest.approx(FLOW, rel=0.02)
            await led.flow(0.5 * FLOW, 0.2)
            assert drive.report()["speed"] == pytest.approx(0.5 * FLOW, rel=0.01)
            await led.flow(0.0, 0.1)
            assert drive.report()["state"] == "ready"
            await led.flow(FLOW, 0.2)
            began = time.monotonic()
            led.pump.stop()
            led.pump.set(FLOW)
            while drive.report()["state"] == "forward":
                assert time.monotonic() - began < 0.1
                await asyncio.sleep(0.001)
            await led.flow(FLOW, 0.2)
            assert drive.report()["speed"] == 0.0
            assert not led.failures

    asyncio.run(lead())
    assert drive.report()["state"] == "ready"


@timed
@pytest.mark.parametrize("fault", [Fault.PUMP_MUTE, Fault.PUMP_EXCEPTION, Fault.PUMP_RESET, Fault.PUMP_TRIP])
def test_a_drive_that_fails_is_noticed(drive, fault):
    lifted = {
        Fault.PUMP_MUTE: Fault.PUMP_UNMUTE,
        Fault.PUMP_EXCEPTION: Fault.PUMP_CLEAR_EXCEPTION,
        Fault.PUMP_TRIP: Fault.PUMP_RESET_TRIP,
    }

    async def lead():
        async with Led(drive.cell.pump) as led:
            await led.flow(FLOW, 0.3)
            at = drive.inject(fault, **({"code": 4} if fault is Fault.PUMP_EXCEPTION else {}))["wall"]
            if fault is Fault.PUMP_RESET:  # it connects again by itself, and nobody is the wiser
                await led.flow(FLOW, 0.4)
                assert not led.failures
                assert drive.report()["state"] == "forward"
                return
            noticed, why = await led.until_failed()
            assert noticed - at < LOSS + 0.1
            assert ("tripped" if fault is Fault.PUMP_TRIP else "no good answer") in why
            drive.inject(lifted[fault])

    try:
        asyncio.run(lead())
    finally:
        if fault in lifted:
            drive.inject(lifted[fault])
    assert drive.report()["speed"] == 0.0


@contextlib.contextmanager
def faulty(drive, fault, lifting, **values):
    """A drive with a fault, which is lifted at the end; nothing of it is left then."""
    try:
        yield lambda: drive.inject(fault, **values)["wall"]
    finally:
        drive.inject(lifting, **({"bits": 0} if lifting is Fault.PUMP_REGISTER_WIDTH else {}))
        drive.inject(Fault.PUMP_RESET_TRIP)


@timed
def test_registers_that_stand_still_are_noticed_and_the_stop_is_not_believed(drive):
    patience = DOUBT + 0.1  # and the answer of the cell's pump

    async def lead(freeze):
        async with Led(drive.cell.pump) as led:
            await led.flow(FLOW, 0.4)
            at = freeze()
            await led.flow(FLOW, 0.1)
            noticed, why = await led.until_failed(3.0, 0.5 * FLOW)
            assert noticed - at < patience + 0.5
            assert re.search(rf"{HOST}:\d+ answers.*stands? still", why)
            if drive.map.registers.heartbeat is not None:
                assert "its heartbeat, register 3" in why
            began = time.monotonic()
            with pytest.raises(
                PumpError,
                match=rf"{HOST}:\d+ \(map '{drive.map.name}', device \d\).*says that it runs.*may still be",
            ):
                await led.close()
            assert time.monotonic() - began < STOPPING + 0.1 + 0.5

    with faulty(drive, Fault.PUMP_FROZEN, Fault.PUMP_UNFROZEN) as freeze:
        asyncio.run(lead(freeze))


@timed
@pytest.mark.parametrize("bits", [8, 16, 32])
def test_registers_of_another_width_are_noticed(drive, bits):
    at = drive.map.registers
    if bits == 16 * at.measured_flow.count or (
        bits == 8 and at.set_flow.encode(FLOW / drive.map.flow_factor)[0] < 256
    ):
        pytest.skip("nothing of it can be seen, or comes of it")

    async def lead(widen):
        async with Led(drive.cell.pump) as led:
            await led.flow(FLOW, 0.3)
            since = widen()
            noticed, why = await led.until_failed(3.0)
            assert noticed - since < DOUBT + 0.1 + 0.5
            assert re.search(r"is told [89]\d{3}(\.\d+)? mm³/s and measures", why) or "it measures" in why

    with faulty(drive, Fault.PUMP_REGISTER_WIDTH, Fault.PUMP_REGISTER_WIDTH, bits=bits) as widen:
        asyncio.run(lead(widen))
    assert drive.report()["speed"] == 0.0


@timed
def test_a_stop_that_is_never_confirmed_is_reported(drive):
    async def lead(silence):
        async with Led(drive.cell.pump) as led:
            await led.flow(FLOW, 0.2)
            silence()
            with pytest.raises(
                PumpError,
                match=rf"{HOST}:\d+ .*has not confirmed that it stops.*at the drive or by the emergency stop",
            ):
                await led.close()
            assert not led.failures

    with faulty(drive, Fault.PUMP_MUTE, Fault.PUMP_UNMUTE) as silence:
        asyncio.run(lead(silence))


def test_a_drive_that_stood_and_falls_silent_is_no_danger(drive):
    async def lead(silence):
        async with Led(drive.cell.pump) as led:
            await led.flow(FLOW, 0.1)
            await led.flow(0.0, 0.4)
            silence()

    with faulty(drive, Fault.PUMP_MUTE, Fault.PUMP_UNMUTE) as silence:
        asyncio.run(lead(silence))


@timed
def test_a_slow_line_is_led_too(drive, serial_line):
    async def lead():
        async with Led(drive.cell.pump) as led:
            for share in (0.2, 0.4, 0.6, 0.8, 1.0):
                await led.flow(share * FLOW, 0.2)
            assert not led.failures
            assert drive.report()["speed"] == pytest.approx(FLOW, rel=0.01)
            assert 0.015 < led.pump.latency < 0.2
            began = time.monotonic()
            led.pump.stop()
            while drive.report()["state"] == "forward":
                assert time.monotonic() - began < 0.2
                await asyncio.sleep(0.001)

    asyncio.run(lead())


def test_another_device_gives_no_good_answer(drive, monkeypatch):
    monkeypatch.setattr("robot.pump.CONNECT_LIMIT", 1.0)
    if drive.map.name != "generic":
        pytest.skip("it takes its time, and is alike with every map of a transport")
    led = Led(drive.cell.pump)
    led.pump._link.map = led.pump._link.map.model_copy(update={"device_id": 77})
    with pytest.raises(CellUnreachable, match=r"no good answer within 1 s.*device id 77 and register map"):
        asyncio.run(led.pump.start())


def test_a_period_too_long_for_the_drive_is_refused(tmp_path):
    path = tmp_path / "nervous.toml"
    path.write_text(
        'name = "nervous"\nkeep_alive_s = 0.1\n[registers]\ncommand = { address = 0 }\nset_flow = { address = 1 }\n'
    )
    settings = load_cell("ur10e-demo").pump.model_copy(update={"registers": str(path), "period_s": 0.06})
    led = Led(settings)
    with pytest.raises(PumpError, match=r"pump 'nervous'.*every 0.1 s.*period_s of 0.06 s"):
        asyncio.run(led.pump.start())


async def change(led, seconds):
    """Something is written in every exchange."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        await led.flow(0.9 * FLOW, 0.01)
        await led.flow(FLOW, 0.01)


@timed
def test_late_answers_are_not_taken_for_those_of_what_was_asked_next(drive, serial_line):
    async def lead():
        async with Led(drive.cell.pump) as led:
            await led.flow(FLOW, 0.4)
            for _ in range(3):
                seen = len(led.readings)
                os.kill(drive.pid, signal.SIGSTOP)
                await change(led, 0.12)
                os.kill(drive.pid, signal.SIGCONT)
                await change(led, 0.5)
                assert not led.failures
                flows = [reading.flow for reading in led.readings[seen:]]
                assert len(flows) > 3
                assert all(0.88 * FLOW < flow < 1.02 * FLOW for flow in flows)

    try:
        asyncio.run(lead())
    finally:
        os.kill(drive.pid, signal.SIGCONT)


async def lose(drive):
    """Lose what is asked in a time that is shorter than an exchange."""
    drive.inject(Fault.PUMP_MUTE)
    await asyncio.sleep(0.01)
    drive.inject(Fault.PUMP_UNMUTE)


@timed
def test_a_lost_answer_is_no_loss_of_the_drive(drive, serial_line):
    async def lead():
        async with Led(drive.cell.pump) as led:
            await led.flow(FLOW, 0.4)
            for _ in range(4):
                await lose(drive)
                await change(led, 0.4)
                assert not led.failures

    drive.inject(Fault.PUMP_SLOW, seconds=0.018)
    asyncio.run(lead())


async def stand(led, drive, within):
    """Stop; the drive stands within a time, in which it obeys what was on its way to it, and from then on."""
    began = time.monotonic()
    led.pump.stop()
    while (elapsed := time.monotonic() - began) < 0.3:
        forward = drive.report()["state"] == "forward"
        assert not forward or elapsed < within
        await asyncio.sleep(0.001)


@timed
@pytest.mark.parametrize(("before", "lost"), [(FLOW, 0.9 * FLOW), (0.0, 0.9 * FLOW), (FLOW, 0.0)])
@pytest.mark.parametrize("waited", [0.01, 0.03])
def test_a_stop_does_not_wait_for_a_late_answer(drive, serial_line, monkeypatch, before, lost, waited):
    monkeypatch.setattr("robot.pump_link.SETTLING", 0.4)

    async def lead():
        async with Led(drive.cell.pump) as led:
            await led.flow(before, 0.4)
            led.pump.set(lost)
            await lose(drive)
            await led.flow(lost, led.pump._link.timeout - 0.01 + waited)
            await stand(led, drive, 0.05)

    asyncio.run(lead())


# Its starts are two writes; the others write command and flow at once, and may be too late to be overtaken.
of_two_writes = pytest.mark.parametrize(
    "drive", [("m-tec-p20", "rtu over tcp")], indirect=True, ids=["m-tec-p20"]
)


@timed
@of_two_writes
@pytest.mark.parametrize("turns", range(5))
def test_a_stop_overtakes_a_start_that_is_about_to_be_written(drive, serial_line, monkeypatch, turns):
    """Whichever turn of the event loop it falls into."""
    monkeypatch.setattr("robot.pump_link.SETTLING", 0.4)

    async def lead():
        async with Led(drive.cell.pump) as led:
            await led.flow(0.0, 0.1)
            await lose(drive)
            await led.flow(0.0, led.pump._link.timeout)
            led.pump.set(FLOW)
            for _ in range(turns):
                await asyncio.sleep(0.0)
            await stand(led, drive, 0.0)

    asyncio.run(lead())


@timed
@of_two_writes
@pytest.mark.parametrize("after", [0.002, 0.006, 0.01])
def test_a_stop_comes_between_the_two_writes_of_a_start(drive, serial_line, after):
    async def lead():
        async with Led(drive.cell.pump) as led:
            await led.flow(0.0, 0.1)
            seen = len(led.readings)
            while len(led.readings) == seen:  # an exchange has just ended
                await led.flow(0.0, 0.01)
            led.pump.set(FLOW)
            await asyncio.sleep(after)
            await stand(led, drive, 0.0)

    asyncio.run(lead())
