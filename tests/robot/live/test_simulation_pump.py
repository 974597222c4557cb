"""The simulated drive over its line: its answers are the analytic ones, it trips as it is set, and fails on demand."""

import itertools
import math
import time

import numpy as np
import pytest
from pumps.alone import Line, cell_file, pump_alone
from waiting import timed, until

from robot.errors import RobotError
from robot.simulation import Fault

HOST = "127.0.34.12"
TRIP = 0.3
RESIDENCE = 1.0  # s, of what the hose holds at FLOW
FLOW = 8000.0

SETTINGS = {
    "dead_time_s": 0.15,
    "lag_s": 0.12,
    "hose_diameter": 20.0,
    "hose_length": RESIDENCE * FLOW / (0.25 * math.pi * 400.0),
}


@pytest.fixture(scope="module")
def trace(tmp_path_factory):
    return tmp_path_factory.mktemp("trace") / "pump.csv"


@pytest.fixture(scope="module")
def pump(tmp_path_factory, trace):
    path = cell_file(tmp_path_factory.mktemp("cell"), "generic", **SETTINGS)
    with pump_alone(HOST, path, "--trip", str(TRIP), "--trace", str(trace)) as alone:
        yield alone


@pytest.fixture
def line(pump):
    """A connected client, the drive ready, nothing flowing."""
    made = Line(pump)
    made.command("stop")
    time.sleep(SETTINGS["dead_time_s"])
    until(lambda: pump.report()["flow"] < 10.0 and pump.report()["pressure"] < 2.0)
    yield made
    made.close()
    pump.inject(Fault.PUMP_RESET_TRIP)


beats = itertools.count(1)


def beat(line):
    line.put("heartbeat", [next(beats) % 65536])


def watch(pump, line, seconds):
    """Reports of the pump over a time, its heart beating."""
    reports = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        beat(line)
        reports.append(pump.report())
        time.sleep(0.01)
    return reports


@timed
def test_a_step_is_answered_after_the_dead_time_with_the_lag(pump, line):
    dead, lag = pump.cell.pump.dead_time_s, pump.cell.pump.lag_s
    until(lambda: pump.report()["flow"] < 0.1)
    volume = pump.report()["volume"]
    before, after = line.run(FLOW)
    reports = watch(pump, line, dead + 6.0 * lag)
    told, off = 0.5 * (before + after) - pump.epoch, 0.5 * (after - before)
    seen = [r for r in reports if 0.05 < r["flow"] / FLOW < 0.9]
    assert len(seen) > 5
    # -log(1 - flow) is a line: its slope tells the lag, where it begins the dead time
    slope, level = np.polyfit([r["time"] for r in seen], [-math.log(1.0 - r["flow"] / FLOW) for r in seen], 1)
    assert 1.0 / slope == pytest.approx(lag, rel=0.01)
    assert -level / slope - told == pytest.approx(dead, abs=0.01 * dead + off)
    last = reports[-1]
    since = last["time"] - told - dead
    out = FLOW * (since - lag * (1.0 - math.exp(-since / lag)))
    assert last["volume"] - volume == pytest.approx(out, abs=0.01 * out + FLOW * off)
    # and the register tells the same
    measured, now = line.flow(), pump.report()
    assert measured == pytest.approx(now["flow"], rel=0.01)


@timed
def test_what_enters_the_hose_leaves_it_a_residence_later(pump, line):
    line.run(FLOW)
    reports = watch(pump, line, 3.5)
    times, volumes = [np.array([r[name] for r in reports]) for name in ("time", "volume")]
    steady = volumes[0] + FLOW * 1.5
    entered = float(np.interp(steady, volumes, times))
    left = float(np.interp(steady + pump.cell.pump.hose_volume, volumes, times))
    assert left - entered == pytest.approx(RESIDENCE, rel=0.01)
    ages = np.array([r["age"] for r in reports])
    assert float(np.interp(left, times, ages)) == pytest.approx(RESIDENCE, rel=0.01)


@timed
def test_the_drive_trips_in_silence_at_its_time(pump, line):
    line.run(4000.0)
    for _ in range(20):  # a heartbeat alone keeps it running
        beat(line)
        time.sleep(0.02)
    before = time.monotonic()
    beat(line)
    after = time.monotonic()
    assert line.state("running")
    while not line.state("tripped"):  # reading is no sign of life
        line.put("set_flow", line.map.words(4000.0))  # nor is writing what is there already
        assert time.monotonic() - after < 1.0
        time.sleep(0.005)
    seen = time.monotonic()
    told = pump.report()
    assert told["cause"] == "communication"
    assert told["silence"] == pytest.approx(TRIP, abs=0.02)  # by its own clock
    tripped = told["tripped_at"] + pump.epoch
    assert before + TRIP - 0.02 <= tripped <= after + TRIP + 0.02
    assert before + TRIP <= seen <= after + TRIP + 0.05


def test_a_tripped_drive_stands_until_a_stop(pump, line):
    line.run(4000.0)
    until(lambda: line.state("tripped"))
    until(lambda: line.flow() < 4.0)
    line.command("forward")
    assert line.state("tripped")
    assert not line.state("running")
    line.command("stop")
    assert line.state("ready")
    assert not line.state("tripped")
    line.command("forward")
    assert line.state("running")


def test_a_mute_drive_neither_answers_nor_obeys(pump, line):
    pump.inject(Fault.PUMP_MUTE)
    short = Line(pump, timeout=0.2)
    try:
        with pytest.raises(Exception, match="No response"):
            short.command("forward")
    finally:
        pump.inject(Fault.PUMP_UNMUTE)
        short.close()
    assert pump.report()["state"] == "ready"
    assert line.get("command") == 0


def test_a_reset_ends_every_connection(pump, line):
    other = Line(pump)
    assert other.get("command") == 0  # it is served, not only connected
    pump.inject(Fault.PUMP_RESET)
    for client in (line, other):
        with pytest.raises(Exception, match=r"(?i)reset|connection"):
            client.client.socket.send(b"") or client.client.socket.recv(1) or client.put("command", [0])
    other.close()
    again = Line(pump)
    assert again.get("command") == 0
    again.close()


@pytest.mark.parametrize("code", [1, 2, 4, 6, 11])
def test_every_request_is_answered_by_the_exception_that_was_asked_for(pump, line, code):
    pump.inject(Fault.PUMP_EXCEPTION, code=code)
    answers = [
        line.client.read_holding_registers(0, count=1, device_id=1),
        line.client.write_register(0, 1, device_id=1),
    ]
    pump.inject(Fault.PUMP_CLEAR_EXCEPTION)
    assert [answer.exception_code for answer in answers] == [code, code]
    assert line.get("command") == 0


def test_frozen_registers_show_what_they_did_and_take_nothing(pump, line):
    line.run(FLOW)
    watch(pump, line, 0.6)
    pump.inject(Fault.PUMP_FROZEN)
    shown = line.words("holding", 0, 6)
    line.put("set_flow", [7])
    line.command("stop")
    watched = watch(pump, line, 0.2)
    assert line.words("holding", 0, 6) == shown
    assert watched[-1]["state"] == "forward"
    until(lambda: pump.report()["state"] == "tripped")  # its heartbeat stands still, too
    assert line.words("holding", 0, 6) == shown
    pump.inject(Fault.PUMP_UNFROZEN)
    assert line.state("tripped")


def test_a_fault_of_the_drive_is_reset_at_the_drive(pump, line):
    line.run(FLOW)
    pump.inject(Fault.PUMP_TRIP)
    assert line.state("tripped")
    assert pump.report()["speed"] == 0.0
    line.command("stop")
    assert line.state("tripped")
    pump.inject(Fault.PUMP_RESET_TRIP)
    assert line.state("ready")
    assert pump.report()["speed"] == 0.0


def test_an_empty_hopper_gives_no_more_than_it_had(pump, line):
    volume = pump.report()["volume"]
    pump.inject(Fault.PUMP_HOPPER, level=2000.0)
    line.run(FLOW)
    watch(pump, line, 1.2)
    told = pump.report()
    assert told["volume"] - volume == pytest.approx(2000.0, rel=1e-2)
    assert told["hopper"] == 0.0
    assert told["state"] == "forward"
    pump.inject(Fault.PUMP_HOPPER, level=1e12)


def test_a_blocked_hose_raises_the_pressure_until_the_drive_trips(pump, line):
    line.run(FLOW)
    watch(pump, line, 1.0)
    free, current = line.get("pressure"), pump.report()["current"]
    pump.inject(Fault.PUMP_BLOCK, share=0.2)
    watch(pump, line, 1.0)
    assert line.get("pressure") == pytest.approx(free / 0.64, rel=0.03)
    assert pump.report()["current"] > current
    pump.inject(Fault.PUMP_BLOCK, share=1.0)
    watch(pump, line, 0.5)
    assert pump.report()["cause"] == "pressure"
    assert line.state("tripped")
    pump.inject(Fault.PUMP_BLOCK, share=0.0)


def test_a_wrong_width_of_registers_shows_wrong_values(pump, line):
    line.run(FLOW)  # 4000 counts
    watch(pump, line, 1.5)
    assert line.get("measured_flow") == pytest.approx(FLOW, rel=0.01)
    pump.inject(Fault.PUMP_REGISTER_WIDTH, bits=8)
    assert line.get("measured_flow") < 512.0
    pump.inject(Fault.PUMP_REGISTER_WIDTH, bits=32)
    assert line.get("measured_flow") == 0.0
    pump.inject(Fault.PUMP_REGISTER_WIDTH, bits=0)
    beat(line)
    assert line.get("measured_flow") == pytest.approx(FLOW, rel=0.01)


def test_a_slow_gateway_takes_its_time_for_every_request(pump, line):
    pump.inject(Fault.PUMP_SLOW, seconds=0.06)
    began = time.monotonic()
    for _ in range(3):
        line.get("command")
    took = time.monotonic() - began
    pump.inject(Fault.PUMP_SLOW, seconds=0.0)
    assert 0.18 <= took < 0.5
    began = time.monotonic()
    line.get("command")
    assert time.monotonic() - began < 0.06


@pytest.mark.parametrize(
    ("fault", "values"),
    [
        (Fault.PUMP_SLOW, {"seconds": -1.0}),
        (Fault.PUMP_BLOCK, {"share": 1.5}),
        (Fault.PUMP_REGISTER_WIDTH, {"bits": 12}),
        (Fault.PUMP_EXCEPTION, {}),
        (Fault.PUMP_HOPPER, {"level": math.nan}),
    ],
)
def test_a_fault_with_a_wrong_value_is_refused(pump, fault, values):
    with pytest.raises(RobotError, match="refused"):
        pump.inject(fault, **values)


def test_the_trace_closes(pump, line, trace):
    """Run after the others of this module, it has all that they pumped."""
    rows = np.genfromtxt(trace, delimiter=",", names=True)
    assert rows.dtype.names[:4] == ("time_s", "flow_mm3_s", "volume_mm3", "age_s")
    assert np.all(np.diff(rows["time_s"]) > 0.0)
    assert np.all(np.diff(rows["volume_mm3"]) >= -1e-6)
    flowed = np.concatenate(
        [[0.0], np.cumsum(np.diff(rows["time_s"]) * 0.5 * (rows["flow_mm3_s"][1:] + rows["flow_mm3_s"][:-1]))]
    )
    assert flowed[-1] == pytest.approx(rows["volume_mm3"][-1], rel=0.01, abs=100.0)
    assert np.all(rows["age_s"] <= rows["time_s"] + 1e-6)
    assert np.all(
        np.diff(rows["age_s"]) <= np.diff(rows["time_s"]) + 1e-5
    )  # nothing grows older than time passes
