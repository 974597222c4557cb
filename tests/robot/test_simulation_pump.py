"""A pymodbus client against the simulated pump: its answer is the analytic one, and it trips in silence."""

from __future__ import annotations

import math
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.client import ModbusTcpClient

from planning import ConfigurationError, load_cell
from robot.errors import PumpError
from robot.pump_map import READY_BIT, RUNNING_BIT, TRIPPED_BIT, load_pump_map
from robot.simulation import Fault, SimulatedCell
from robot.simulation.pump.hose import Hose

HOST = "127.0.0.22"
MAP = load_pump_map("generic")
AT = MAP.registers


@pytest.fixture(scope="module")
def cell():
    with SimulatedCell.start("ur10e-demo", host=HOST, trip=0.3) as simulated:
        yield simulated


@pytest.fixture
def pump(cell):
    """A connected client, the drive ready and stopped."""
    client = ModbusTcpClient(HOST, port=cell.pump_port, timeout=0.2, retries=0)
    assert client.connect()
    write(client, AT.command, 0)
    yield client
    write(client, AT.command, 0)
    client.close()


def write(client, address: int, *values: int) -> None:
    if len(values) == 1:
        answer = client.write_register(address, values[0], device_id=MAP.device_id)
    else:
        answer = client.write_registers(address, list(values), device_id=MAP.device_id)
    assert not answer.isError()


def read(client, address: int) -> int:
    answer = client.read_holding_registers(address, count=1, device_id=MAP.device_id)
    assert not answer.isError()
    return answer.registers[0]


def test_a_step_is_answered_after_the_dead_time_with_the_lag(cell, pump) -> None:
    dead, lag, flow = cell.cell.pump.dead_time_s, cell.cell.pump.lag_s, 8000.0
    while cell.inject(Fault.PUMP_REPORT)["flow"] > 1e-3:
        time.sleep(0.05)
    volume = cell.inject(Fault.PUMP_REPORT)["volume"]
    before = time.monotonic()
    write(pump, AT.command, 1, MAP.counts(flow))
    after = time.monotonic()
    start = 0.5 * (before + after) - cell.epoch
    for beat in range(40):
        write(pump, AT.heartbeat, beat + 1)
        asked = time.monotonic()
        measured = MAP.flow(read(pump, AT.measured_flow))
        told = cell.inject(Fault.PUMP_REPORT)
        time.sleep(0.02)
        for at, value in ((asked - cell.epoch, measured), (told["time"], told["flow"])):
            since = at - start - dead
            expected = flow * (1.0 - math.exp(-since / lag)) if since > 0.0 else 0.0
            # the write and the reading each took some milliseconds
            assert value == pytest.approx(expected, abs=flow * 0.006 / lag + MAP.flow_unit)
        since = max(told["time"] - start - dead, 0.0)
        out = flow * (since - lag * (1.0 - math.exp(-since / lag)))
        assert told["volume"] - volume == pytest.approx(out, abs=flow * 0.006)
    assert read(pump, AT.status) == READY_BIT | RUNNING_BIT
    write(pump, AT.command, 0)
    assert read(pump, AT.status) == READY_BIT


def test_the_drive_trips_in_silence_and_is_armed_by_a_stop(cell, pump) -> None:
    write(pump, AT.command, 1, MAP.counts(4000.0))
    for beat in range(20):  # a heartbeat alone keeps it running
        write(pump, AT.heartbeat, 100 + beat)
        time.sleep(0.02)
    assert read(pump, AT.status) == READY_BIT | RUNNING_BIT
    silent = time.monotonic()
    while not read(pump, AT.status) & TRIPPED_BIT:  # reading is no sign of life
        write(pump, AT.set_flow, MAP.counts(4000.0))  # nor is writing what is there already
        assert time.monotonic() - silent < 1.0
        time.sleep(0.005)
    assert time.monotonic() - silent == pytest.approx(0.3, abs=0.06)
    time.sleep(cell.cell.pump.dead_time_s + 8.0 * cell.cell.pump.lag_s)
    assert MAP.flow(read(pump, AT.measured_flow)) < 4.0
    write(pump, AT.command, 1)
    assert read(pump, AT.status) == TRIPPED_BIT
    write(pump, AT.command, 0)
    assert read(pump, AT.status) == READY_BIT
    write(pump, AT.command, 1)
    assert read(pump, AT.status) == READY_BIT | RUNNING_BIT


def test_a_mute_drive_neither_answers_nor_acts(cell, pump) -> None:
    cell.inject(Fault.PUMP_MUTE)
    try:
        with pytest.raises(Exception, match="No response"):
            pump.write_register(AT.command, 1, device_id=MAP.device_id)
    finally:
        cell.inject(Fault.PUMP_UNMUTE)
    pump.close()
    assert pump.connect()
    assert read(pump, AT.command) == 0


def test_other_addresses_and_functions_are_answered_with_an_exception(pump) -> None:
    assert pump.read_holding_registers(5000, count=1, device_id=MAP.device_id).isError()
    assert pump.read_input_registers(AT.status, count=1, device_id=MAP.device_id).isError()
    assert pump.write_register(5000, 1, device_id=MAP.device_id).isError()


commands = st.lists(st.tuples(st.floats(0.0, 2.0), st.floats(0.0, 1e4)), max_size=6)


@given(
    commands,
    st.floats(0.0, 0.5),
    st.one_of(st.just(0.0), st.floats(0.01, 1.0)),
    st.lists(st.floats(0.0, 1.0)),
)
def test_flow_and_volume_do_not_depend_on_when_they_are_looked_at(changes, dead, lag, looks) -> None:
    often, once = Hose(dead, lag), Hose(dead, lag)
    now = pumped = 0.0
    for pause, flow in changes:
        now += pause
        often.command(now, flow)
        once.command(now, flow)
    for look in sorted(looks):
        often.advance(look * now)
        assert often.flow >= -1e-9
        assert often.volume >= pumped - 1e-6
        pumped = often.volume
    end = now + dead + 3.0
    often.advance(end)
    once.advance(end)
    assert often.volume == pytest.approx(once.volume, rel=1e-9, abs=1e-6)
    assert often.flow == pytest.approx(once.flow, rel=1e-9, abs=1e-6)


@given(st.floats(0.0, 3.0), st.floats(1.0, 1e4), st.floats(0.0, 0.5), st.floats(0.01, 0.3))
def test_all_that_is_pumped_leaves_the_nozzle(duration, flow, dead, lag) -> None:
    hose = Hose(dead, lag)
    hose.command(0.0, flow)
    hose.command(duration, 0.0)
    hose.advance(duration + dead + 60.0 * lag)
    assert hose.volume == pytest.approx(flow * duration, rel=1e-9, abs=1e-9)


@given(st.floats(0.0, 131070.0))
def test_counts_and_flows_run_through_both_ways(flow) -> None:
    counts = MAP.counts(flow)
    assert 0 <= counts <= 65535
    assert abs(MAP.flow(counts) - flow) <= 0.5 * MAP.flow_unit + 1e-9


@pytest.mark.parametrize("flow", [-3.0, 131100.0, math.nan, math.inf])
def test_a_flow_that_does_not_fit_is_refused(flow: float) -> None:
    with pytest.raises(PumpError, match=r"register 1, which holds 0 to 131070 mm³/s"):
        MAP.counts(flow)


def test_a_map_with_one_address_twice_is_refused(tmp_path) -> None:
    text = (
        'name = "x"\nflow_unit = 1.0\npressure_unit = 1.0\n[registers]\ncommand = 0\nset_flow = 0\n'
        "measured_flow = 2\nheartbeat = 3\nstatus = 4\npressure = 5\n"
    )
    (tmp_path / "twice.toml").write_text(text)
    with pytest.raises(ConfigurationError, match=r"twice\.toml.*same address"):
        load_pump_map("twice", tmp_path)


def test_the_shipped_cells_flow_fits_its_registers() -> None:
    pump = load_cell("ur10e-demo").pump
    assert MAP.flow(MAP.counts(pump.flow_max)) == pytest.approx(pump.flow_max, abs=MAP.flow_unit)
