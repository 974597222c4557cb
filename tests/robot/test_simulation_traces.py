"""A scripted cell that is traced: faults come where the script says, and the traces close over robot and pump."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from pymodbus.client import ModbusTcpClient
from rtde_control import Path as RobotPath
from rtde_control import PathEntry, RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

from planning import ConfigurationError
from robot.errors import RobotError
from robot.pump_map import pump_map
from robot.simulation import Fault, SimulatedCell
from robot.simulation.deposition import read_deposition

HOST = "127.0.35.4"
SCALE = 4.0
LENGTH = 100.0  # mm
FLOW = 12000.0  # mm³/s
SCRIPT = """
[[fault]]
fault = "digital input"
number = 1
waypoint = 2

[[fault]]
fault = "digital input"
number = 2
when_near = { position = [0.0, 0.0, -1000.0], radius = 1.0 }

[[fault]]
fault = "digital input"
number = 3
when_register = { name = "output_int_register_20", value = 7 }
lasts = 0.5

[[fault]]
fault = "pump hopper"
level = 1e9
at = 0.0
"""


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    path = tmp_path_factory.mktemp("script") / "faults.toml"
    path.write_text(SCRIPT, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def traced(script, tmp_path_factory):
    """A cell in which a path was driven, a program told a register, and the pump ran; and what was seen of it."""
    folder = tmp_path_factory.mktemp("trace") / "new"
    seen = {}
    with SimulatedCell.start(
        "ur10e-demo", host=HOST, time_scale=SCALE, trip=0.0, trace=folder, script=script
    ) as cell:
        receive = RTDEReceiveInterface(HOST)
        seen["waypoints"] = drive_path(receive)
        with socket.create_connection((HOST, 30001), 2.0) as port:
            port.sendall(b"write_output_integer_register(20, 7)\n")
            seen["register"] = watch(receive, lambda: receive.getActualDigitalInputBits() & 1 << 3)
            seen["lasted"] = watch(receive, lambda: not receive.getActualDigitalInputBits() & 1 << 3)
        receive.disconnect()
        pump(cell, FLOW)
        time.sleep(0.3)
        pump(cell, 0.0)
        time.sleep((cell.cell.pump.dead_time_s + 8.0 * cell.cell.pump.lag_s) / SCALE + 0.1)
        seen["report"] = cell.inject(Fault.PUMP_REPORT)
        seen["news"] = cell.news()
        assert cell.news() == []
    return folder, seen


def watch(receive, says, seconds=3.0):
    """Time and position at which something is so."""
    deadline = time.monotonic() + seconds
    while not says():
        assert time.monotonic() < deadline
        time.sleep(0.001)
    return receive.getTimestamp(), receive.getActualTCPPose()


def drive_path(receive):
    """Four waypoints in a row, `LENGTH` in all; start, and where the tool was when two of them were passed."""
    control = RTDEControlInterface(HOST)
    start = receive.getActualTCPPose()
    path = RobotPath()
    for k in range(1, 5):
        pose = [start[0], start[1] + 0.25e-3 * LENGTH * k, *start[2:]]
        path.addEntry(PathEntry(PathEntry.MoveL, PathEntry.PositionTcpPose, [*pose, 0.1, 1.0, 0.0]))
    assert control.movePath(path, True)
    passed = watch(receive, lambda: receive.getActualDigitalInputBits() & 1 << 1)
    watch(receive, lambda: not control.getAsyncOperationProgressEx().isAsyncOperationRunning())
    control.disconnect()
    return start, passed


def pump(cell, flow):
    """Tell the drive of the pump a flow, as its register map says."""
    known = pump_map(cell.cell.pump)
    client = ModbusTcpClient(cell.pump_host, port=cell.pump_port)
    assert client.connect()
    registers = known.registers
    count = round(flow / registers.set_flow.unit)
    for address, value in ((registers.set_flow.address, count), (registers.command.address, int(flow > 0.0))):
        assert not client.write_registers(address, [value], device_id=known.device_id).isError()
    client.close()


def test_a_fault_comes_at_its_waypoint(traced):
    start, (_, pose) = traced[1]["waypoints"]
    assert 1e3 * (pose[1] - start[1]) == pytest.approx(0.5 * LENGTH, abs=8.0)  # at 100 mm/s, 4 times as fast


def test_a_fault_comes_at_a_registers_value_and_lasts(traced):
    (began, _), (ended, _) = traced[1]["register"], traced[1]["lasted"]
    assert ended - began == pytest.approx(0.5, abs=0.1)


def test_each_fault_is_told_once_with_its_time(traced):
    lines = [line for line in traced[1]["news"] if "fault at" in line]
    assert not [line for line in traced[1]["news"] if "asked for: pump hopper" in line]
    assert [line.split(": ", 2)[2] for line in lines] == [
        "pump hopper, level 1e+09",
        "digital input, number 1",
        "digital input, number 3",
        "clear digital input, number 3",
    ]


def test_no_volume_is_lost(traced):
    folder, seen = traced
    found = np.genfromtxt(folder / "deposition.csv", delimiter=",", names=True)
    assert found["volume_mm3"][-1] == pytest.approx(
        seen["report"]["volume"], rel=1e-5
    )  # the end of the flow trickles
    flowed = np.sum(found["flow_mm3_s"][1:] * np.diff(found["time_s"]))
    assert flowed == pytest.approx(seen["report"]["volume"], rel=1e-5)
    assert found["flow_mm3_s"].max() == pytest.approx(FLOW, rel=0.01)
    assert np.all(np.diff(found["time_s"]) > 0.0)


def test_the_way_is_the_robots(traced):
    folder, seen = traced
    found = np.genfromtxt(folder / "deposition.csv", delimiter=",", names=True)
    assert found["path_mm"][-1] == pytest.approx(LENGTH, abs=0.01)
    start, (time_passed, pose) = seen["waypoints"]
    at = np.interp(time_passed, found["time_s"], found["y_mm"])
    assert at == pytest.approx(1e3 * pose[1], abs=0.2)
    motion = np.genfromtxt(folder / "robot.csv", delimiter=",", names=True)
    assert motion["speed_mm_s"].max() == pytest.approx(100.0, rel=1e-3)
    assert motion["y_mm"][0] == pytest.approx(1e3 * start[1], abs=1e-3)
    steps = np.diff(motion["time_s"])
    assert np.median(steps) <= 0.0125
    assert steps.min() > 0.0


def test_traces_outlive_kill_9_up_to_the_last_second(tmp_path):
    cell = SimulatedCell.start("ur10e-demo", host=HOST, trace=tmp_path)
    try:
        time.sleep(1.2)
        killed = cell.process_time
        for process in cell.process_ids.values():
            os.kill(process, signal.SIGKILL)
        found = read_deposition(tmp_path)
        assert killed - 1.0 < found.time[-1] <= cell.process_time
        (tmp_path / "deposition.csv").unlink(missing_ok=True)
        said = subprocess.run(
            [sys.executable, "-m", "robot.simulation.join_traces", tmp_path],
            capture_output=True,
            text=True,
            check=True,
        )
        assert said.stdout.strip() == str(tmp_path / "deposition.csv")
        assert said.stderr == ""
    finally:
        cell.stop()


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("", encoding="ascii")
    with pytest.raises(RobotError, match="no folder for traces"):
        SimulatedCell.start("ur10e-demo", host=HOST, trace=tmp_path / "file" / "below")


def test_a_wrong_script_is_told_before_anything_starts(tmp_path):
    path = tmp_path / "faults.toml"
    path.write_text('[[fault]]\nfault = "pump mut"\nat = 1', encoding="ascii")
    with pytest.raises(
        ConfigurationError, match="fault 1: key 'fault': there is no such fault; did you mean"
    ):
        SimulatedCell.start("ur10e-demo", host=HOST, script=path)
