"""What drives differ in: signs of life, what a trip takes to be reset, what they measure, ramps and slow lines."""

import itertools
import time

import pytest
from pumps.alone import Line, cell_file, pump_alone
from waiting import timed

from robot.pump_map import load_pump_map
from robot.simulation.clock import ProcessClock
from robot.simulation.pump.drive import Drive
from robot.simulation.pump.plant import Plant, PlantSettings
from robot.simulation.pump.server import ModbusServer

HOST = "127.0.34.13"
TRIP = 0.25


@pytest.fixture(scope="module")
def mixing(tmp_path_factory):
    """An m-tec pump whose watchdog is set."""
    path = cell_file(
        tmp_path_factory.mktemp("cell"), "m-tec-p20", flow_per_hz=400.0, dead_time_s=0.1, lag_s=0.1
    )
    with pump_alone(HOST, path, "--trip", str(TRIP), "--ramp", "1.0", "--reply-delay", "0.01") as alone:
        yield alone


@pytest.fixture
def line(mixing):
    made = Line(mixing)
    made.command("reset")
    made.command("stop")
    while mixing.report()["speed"] > 0.0:
        time.sleep(0.01)
    yield made
    made.close()


@timed
def test_where_there_is_no_heartbeat_every_request_is_a_sign_of_life(mixing, line):
    line.run(8000.0)
    for _ in range(10):
        time.sleep(0.4 * TRIP)
        line.get("current")
    assert line.state("running")
    before = time.monotonic()
    line.get("current")
    after = time.monotonic()
    time.sleep(1.6 * TRIP)
    told = mixing.report()
    assert told["cause"] == "communication"
    assert told["silence"] == pytest.approx(TRIP, abs=0.02)
    assert before + TRIP - 0.02 <= told["tripped_at"] + mixing.epoch <= after + TRIP + 0.02


def test_a_drive_with_a_reset_is_not_made_ready_by_a_stop(mixing, line):
    line.run(8000.0)
    time.sleep(1.6 * TRIP)
    line.command("stop")
    assert line.state("tripped")
    line.command("forward")
    assert not line.state("running")
    line.command("reset")
    assert not line.state("tripped")
    assert not line.state("running")
    line.command("forward")
    assert line.state("running")


def test_an_emergency_stop_knows_no_ramp_and_takes_a_reset(mixing, line):
    line.run(16000.0)
    time.sleep(0.2)
    line.command("emergency")
    told = mixing.report()
    assert (told["state"], told["speed"]) == ("off", 0.0)
    line.command("forward")
    assert mixing.report()["speed"] == 0.0
    line.command("reset")
    assert mixing.report()["state"] == "ready"


def test_it_ramps_counts_in_hertz_and_measures_its_motor(mixing, line):
    line.run(10000.0)  # 25 Hz, half of the largest flow: half a second
    told, speeds = mixing.report(), []
    for _ in range(20):
        line.get("current")
        report = mixing.report()
        speeds.append((report["speed"] - told["speed"]) / (report["time"] - told["time"]))
        if report["speed"] > 9000.0:
            break
    assert speeds[3] == pytest.approx(mixing.cell.pump.flow_max, rel=1e-3)  # mm3/s in a second
    for _ in range(8):
        time.sleep(0.4 * TRIP)
        line.get("current")
    assert line.get("measured_flow") == pytest.approx(25.0)
    assert line.get("voltage") == pytest.approx(200.0)
    assert line.get("torque") > 0.0
    line.command("reverse")
    assert line.state("reversing")
    assert line.state("running")


def test_a_drive_without_a_watchdog_keeps_pumping(tmp_path):
    path = cell_file(tmp_path, "accelerator-doser", dead_time_s=0.0, lag_s=0.0)
    with pump_alone(HOST.replace("13", "14"), path, "--trip", "0") as alone:
        line = Line(alone)
        line.run(3000.0)
        line.close()
        time.sleep(1.2)
        told = alone.report()
        assert (told["state"], told["flow"]) == ("forward", 3000.0)
        again = Line(alone)
        strokes = again.get("volume")
        assert strokes == pytest.approx(alone.report()["volume"], abs=50.0 + 0.1 * 3000.0)
        assert strokes % 50.0 == 0.0
        again.command("stop")
        assert alone.report()["flow"] == 0.0
        again.close()


def test_the_same_seed_gives_the_same_delays():
    def delays(seed):
        plant = Plant(PlantSettings(flow_max=1.0))
        drive = Drive(load_pump_map("generic"), plant, ProcessClock(time.monotonic()))
        server = ModbusServer(drive, serial=False, reply_delay=0.02, jitter=0.01, seed=seed)
        return [server.delay() for _ in range(50)]

    assert delays(3) == delays(3)
    assert delays(3) != delays(4)
    assert all(0.02 <= delay <= 0.03 for delay in delays(3))
    assert len(set(itertools.chain(delays(3), delays(4)))) == 100
