"""The simulated cell's processes: they start together, tell why they cannot, and never outlive their parent."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from rtde_receive import RTDEReceiveInterface
from waiting import until

from planning import ConfigurationError
from robot.errors import CellUnreachable, PortTakenError, RobotError
from robot.simulation import Fault, SimulatedCell, inject
from robot.simulation.addresses import free_address

HOST = "127.0.0.23"


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").split()[2] != "Z"
    except FileNotFoundError:
        return False


def test_both_processes_share_a_clock_and_end_with_the_cell() -> None:
    with SimulatedCell.start("ur10e-demo", host=HOST, time_scale=10.0) as cell:
        ids = cell.process_ids
        assert set(ids) == {"controller", "pump"}
        assert cell.inject(Fault.PUMP_REPORT)["volume"] == 0.0
        for _ in range(2):
            told = cell.inject(Fault.PUMP_REPORT)
            assert told["time"] == pytest.approx((told["wall"] - cell.epoch) * 10.0, abs=0.05)
            time.sleep(0.1)
        with pytest.raises(RobotError, match="refused: 'speed slider' takes `fraction`, 0 to 1"):
            cell.inject(Fault.SPEED_SLIDER)
    assert not any(alive(pid) for pid in ids.values())
    with pytest.raises(CellUnreachable, match=r"port 30099 does not answer 'protective stop'"):
        inject(HOST, Fault.PROTECTIVE_STOP, timeout=0.1)


def test_a_taken_port_is_told_in_one_sentence() -> None:
    with socket.create_server((HOST, 30004)), pytest.raises(PortTakenError) as caught:
        SimulatedCell.start("ur10e-demo", host=HOST)
    assert f"port 30004 on {HOST} is taken; " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_simulator_alone_tells_of_a_taken_port_and_fails() -> None:
    with socket.create_server((HOST, 5020)):
        done = subprocess.run(
            [sys.executable, "-m", "robot.simulation.pump", "--cell", "ur10e-demo", "--host", HOST],
            capture_output=True,
            text=True,
            timeout=20,
            check=False,
        )
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith(f"pump: port 5020 on {HOST} is taken; ")
    assert done.stderr.count("\n") == 1


def test_an_unknown_cell_is_answered_with_those_that_exist() -> None:
    with pytest.raises(ConfigurationError, match=r"no-such-cell.*ur10e-demo"):
        SimulatedCell.start("no-such-cell", host=HOST)


def test_the_simulators_die_with_a_killed_parent() -> None:
    program = (
        "import sys, time\nfrom robot.simulation import SimulatedCell\n"
        f"cell = SimulatedCell.start('ur10e-demo', host='{HOST}')\n"
        "print(*cell.process_ids.values(), flush=True)\ntime.sleep(60)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    try:
        assert parent.stdout is not None
        ids = [int(pid) for pid in parent.stdout.readline().split()]
        assert len(ids) == 2
        assert all(alive(pid) for pid in ids)
    finally:
        os.kill(parent.pid, signal.SIGKILL)
        parent.wait()
        parent.stdout.close()
    deadline = time.monotonic() + 3.0
    while any(alive(pid) for pid in ids):
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.parametrize(
    ("option", "value", "says"),
    [
        ("time_scale", 0.0, "`time_scale` must be 0.1 to 50, not 0"),
        ("start_delay", 0.6, "`start_delay` must be 0 to 0.5, not 0.6"),
        ("trip", float("nan"), "`trip` must be 0 to 3600, not nan"),
        ("hopper", -1.0, "`hopper` must be 0 to inf, not -1"),
    ],
)
def test_a_wrong_option_is_refused_before_anything_starts(option: str, value: float, says: str) -> None:
    with pytest.raises(RobotError) as caught:
        SimulatedCell.start("ur10e-demo", host=HOST, **{option: value})
    assert str(caught.value) == says


@pytest.mark.parametrize(
    ("version", "says"),
    [
        ("five", "a PolyScope version looks like"),
        ("2.1", r"there is no such PolyScope here; there are 3\.0 to 3\.15 or 5\.0 to 5\.25"),
    ],
)
def test_a_wrong_version_is_told(version: str, says: str) -> None:
    with pytest.raises(CellUnreachable, match=f"--version {version}: {says}"):
        SimulatedCell.start("ur10e-demo", host=HOST, version=version)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.0.10"])
def test_a_cell_that_others_would_reach_is_refused(host: str) -> None:
    with pytest.raises(RobotError, match=f"{host} is no loopback address.*give `host`, such as 127"):
        SimulatedCell.start("ur10e-demo", host=host)


def test_a_robot_in_local_control_takes_no_programs() -> None:
    with SimulatedCell.start("ur10e-demo", host=HOST, local_control=True) as cell:
        with socket.create_connection((HOST, 30002), 2.0) as connection:
            connection.sendall(b"set_digital_out(0, True)\n")
        until(
            lambda: "'set_digital_out(0, True)' refused: the robot is in local control" in cell.complaints()
        )


def test_four_cells_at_once_each_at_its_own_address() -> None:
    with contextlib.ExitStack() as stack, ThreadPoolExecutor(4) as starting:
        hosts = [stack.enter_context(free_address(5020)) for _ in range(4)]
        cells = list(starting.map(lambda host: SimulatedCell.start("ur10e-demo", host=host), hosts))
        for cell in cells:
            stack.callback(cell.stop)
        receivers = [RTDEReceiveInterface(host, 125.0) for host in hosts]
        cells[2].inject(Fault.DIGITAL_INPUT, number=2)
        time.sleep(0.2)
        assert [receiver.getActualDigitalInputBits() for receiver in receivers] == [0, 0, 4, 0]
        for receiver in receivers:
            receiver.disconnect()
