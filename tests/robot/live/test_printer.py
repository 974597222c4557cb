"""Whole prints on a simulated cell, whose robot and pump are processes of their own, and everything that stops them."""

import contextlib
import os
import signal
import socket
import subprocess
import threading
import time

import numpy as np
import pytest
from printable import at, first_curve
from waiting import timed

from planning import SegmentKind, load_cell
from robot.chunks import split
from robot.errors import ArmError, CellUnreachable, JournalError, PumpError, StoppedError
from robot.evaluation import evaluate
from robot.journal import read_checkpoint, read_events, read_samples
from robot.printer import run
from robot.simulation import Fault, SimulatedCell

HOST = "127.0.0.41"
SCALE = 6.0


@pytest.fixture(scope="module")
def simulated():
    with SimulatedCell.start("ur10e-demo", host=HOST, time_scale=SCALE) as cell:
        yield cell


@pytest.fixture(scope="module")
def cell():
    return at(load_cell("ur10e-demo"), HOST)


@pytest.fixture
def one_bead(two_layers):
    """The first curve of the program alone."""
    return first_curve(two_layers)


def when_flowing(journal, act):
    """Run `act` in a thread once the journal says that the pump runs; what it returned is appended to the result."""
    done = []

    def wait():
        until = time.monotonic() + 20.0
        while time.monotonic() < until:
            with contextlib.suppress(JournalError):  # not yet made
                if len(rows := read_samples(journal)) and rows["flow"][-1] > 5000.0:
                    done.append(act())
                    return
            time.sleep(0.02)

    thread = threading.Thread(target=wait)
    thread.start()
    return thread, done


def pump_stands(simulated):
    """Nothing leaves the nozzle any more."""
    time.sleep(0.4)  # dead time and lags, in process time
    assert volume_after(simulated, 0.2) < 1.0


def volume_after(simulated, seconds):
    """What leaves the nozzle in a wall time, mm³, after what was under way has arrived."""
    before = simulated.inject(Fault.PUMP_REPORT)["volume"]
    time.sleep(seconds)
    return simulated.inject(Fault.PUMP_REPORT)["volume"] - before


@timed
def test_a_whole_print(simulated, cell, two_layers, tmp_path):
    journal = tmp_path / "journal.sqlite"
    before = simulated.inject(Fault.PUMP_REPORT)["volume"]
    seen = []
    result = run(two_layers, cell, journal, progress=seen.append)

    assert result.chunks == 3
    assert result.deposited_volume == pytest.approx(two_layers.bead_volume, rel=0.02)
    assert result.travel_volume <= 0.005 * two_layers.bead_volume
    assert result.passed >= 0.95
    assert result.worst_deviation < 1.0
    assert result.duration > two_layers.duration

    time.sleep(0.2)
    left = simulated.inject(Fault.PUMP_REPORT)["volume"] - before  # the pump's own count, at the nozzle
    assert left == pytest.approx(two_layers.bead_volume, rel=0.02)
    assert result.deposited_volume == pytest.approx(left, rel=0.01)

    assert [round(p.fraction, 6) for p in seen] == sorted(round(p.fraction, 6) for p in seen)
    assert seen[-1].fraction > 0.9
    assert (seen[-1].layer, seen[-1].layers) == (2, 2)
    kinds = [event.kind for event in read_events(journal)]
    assert kinds == ["start", "chunk", "chunk", "chunk", "end"]
    samples = read_samples(journal)
    assert np.all(np.diff(samples["time"]) > 0)
    chunk, waypoint = read_checkpoint(journal)
    assert chunk == 2
    assert split(two_layers)[2].start <= waypoint < len(two_layers)


@timed
def test_the_slider_changes_nothing_about_the_bead(simulated, cell, one_bead, tmp_path):
    simulated.inject(Fault.SPEED_SLIDER, fraction=0.5)
    try:
        result = run(one_bead, cell, tmp_path / "journal.sqlite")
    finally:
        simulated.inject(Fault.SPEED_SLIDER, fraction=1.0)
    assert result.duration > 2.0 * one_bead.duration
    assert result.deposited_volume == pytest.approx(one_bead.bead_volume, rel=0.02)
    assert result.travel_volume <= 0.005 * one_bead.bead_volume


@pytest.mark.parametrize(
    ("fault", "clear", "says"),
    [
        (Fault.PROTECTIVE_STOP, Fault.CLEAR_PROTECTIVE_STOP, "protective stop"),
        (Fault.RTDE_DROP, None, "connection"),
    ],
)
def test_a_stop_of_the_robot_stops_the_pump_for_good(simulated, cell, one_bead, tmp_path, fault, clear, says):
    journal = tmp_path / "journal.sqlite"
    thread, answers = when_flowing(journal, lambda: simulated.inject(fault))
    try:
        with pytest.raises((StoppedError, ArmError), match=says) as caught:
            run(one_bead, cell, journal)
    finally:
        thread.join()
        if clear:
            simulated.inject(clear)
    assert answers
    if fault is not Fault.RTDE_DROP:  # it takes the arm process's connection too, which may speak first
        assert caught.type is StoppedError
    assert "layer 0, curve 0" in str(caught.value)
    stop = next(event for event in read_events(journal) if event.kind == "stop")
    pump = next(event for event in read_events(journal) if event.kind == "pump")
    assert pump.wall - stop.wall < 0.1
    if fault is not Fault.RTDE_DROP:  # without the robot's clock there are no more samples
        assert read_samples(journal)["command"][-1] == 0.0
    assert read_events(journal)[-1].kind == "error"
    pump_stands(simulated)


def signal_arm(number):
    """Send a signal to the print's arm process."""
    children = subprocess.run(
        ["ps", "-o", "pid=,args=", "--ppid", str(os.getpid())], check=True, capture_output=True, text=True
    )
    found = [line.split()[0] for line in children.stdout.splitlines() if "robot.arm_process" in line]
    os.kill(int(found[0]), number)


@timed
def test_an_arm_process_that_is_held_up_is_the_reason(simulated, cell, one_bead, tmp_path):
    journal = tmp_path / "journal.sqlite"

    def hold_up():
        signal_arm(signal.SIGSTOP)
        time.sleep(0.3)
        signal_arm(signal.SIGCONT)

    thread, _ = when_flowing(journal, hold_up)
    with pytest.raises(
        StoppedError, match=r"the arm process ha[sd] been silent for 0\.[01]\d s.*layer 0, curve 0"
    ):
        run(one_bead, cell, journal)
    thread.join()
    assert read_samples(journal)["command"][-1] == 0.0
    pump_stands(simulated)


def test_a_killed_arm_process_stops_the_pump(simulated, cell, one_bead, tmp_path):
    journal = tmp_path / "journal.sqlite"

    thread, _ = when_flowing(journal, lambda: signal_arm(signal.SIGKILL))
    with pytest.raises(ArmError, match="signal 9"):
        run(one_bead, cell, journal)
    thread.join()
    assert read_samples(journal)["command"][-1] == 0.0
    pump_stands(simulated)


def test_a_mute_pump_stops_the_robot(simulated, cell, one_bead, tmp_path):
    journal = tmp_path / "journal.sqlite"
    thread, _ = when_flowing(journal, lambda: simulated.inject(Fault.PUMP_MUTE))
    try:
        with pytest.raises(PumpError, match=rf"{HOST}:5020.*no good answer"):
            run(one_bead, cell, journal)
    finally:
        thread.join()
        simulated.inject(Fault.PUMP_UNMUTE)


def test_ctrl_c_stops_everything_and_is_recorded(simulated, cell, one_bead, tmp_path):
    journal = tmp_path / "journal.sqlite"
    thread, _ = when_flowing(journal, lambda: os.kill(os.getpid(), signal.SIGINT))
    with pytest.raises(StoppedError, match="stopped by the operator"):
        run(one_bead, cell, journal)
    thread.join()
    assert [event.kind for event in read_events(journal)] == ["start", "chunk", "stop", "pump", "error"]
    assert read_samples(journal)["command"][-1] == 0.0


def test_a_cell_that_is_not_there(cell, one_bead, tmp_path):
    with pytest.raises(CellUnreachable, match=r"127\.0\.0\.42:30004"):
        run(one_bead, at(cell, "127.0.0.42"), tmp_path / "journal.sqlite")
    assert read_events(tmp_path / "journal.sqlite")[-1].data == {"error": "CellUnreachable"}


def test_a_pump_that_is_not_there(simulated, cell, one_bead, tmp_path):
    with pytest.raises(CellUnreachable, match=r"127\.0\.0\.42:5020 refuses"):
        run(one_bead, at(cell, HOST, "127.0.0.42"), tmp_path / "journal.sqlite")


def test_a_robot_that_accepts_and_never_answers(cell, one_bead, tmp_path):
    with socket.create_server(("127.0.0.43", 30004)):
        began = time.monotonic()
        with pytest.raises(CellUnreachable, match=r"127\.0\.0\.43:30004 does not answer"):
            run(one_bead, at(cell, "127.0.0.43"), tmp_path / "journal.sqlite")
        assert time.monotonic() - began < 10.0


def test_evaluation_of_a_perfect_print(two_layers):
    """Samples made from the program itself: no deviation, every waypoint passed, the volume of the beads."""
    rows = []
    for k, segment in enumerate(two_layers.segments):
        for w in range(segment.start, segment.stop):
            flow = two_layers.flow[w] if segment.kind is SegmentKind.PRINT else 0.0
            x, y, z = two_layers.positions[w]
            rows.append((0.0, two_layers.time[w], x, y, z, two_layers.speed[w], flow, flow, w, k))
    samples = np.array(rows, dtype=read_samples.__globals__["SAMPLE"])
    found = evaluate(two_layers, samples)
    assert found.passed == 1.0
    assert found.worst_deviation == pytest.approx(0.0, abs=1e-9)
    assert found.travel_volume == 0.0
    assert found.deposited_volume == pytest.approx(two_layers.bead_volume, rel=1e-3)
    samples["x"] += 3.0
    off = evaluate(two_layers, samples)
    assert off.worst_deviation == pytest.approx(3.0, abs=1e-6)
    assert off.passed < 0.5
