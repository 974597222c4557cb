"""The simulated controller, a process of its own, when things go wrong: faults, stops, silence, rubbish."""

from __future__ import annotations

import math
import socket
import struct
import time

import numpy as np
import pytest
from dashboard_client import DashboardClient
from rtde_control import RTDEControlInterface
from rtde_io import RTDEIOInterface
from rtde_receive import RTDEReceiveInterface
from waiting import until

from planning import arm
from planning.pose import pose_from_vector
from robot import rtde
from robot.simulation import Fault, SimulatedCell
from robot.simulation.interfaces.variables import known_outputs

HOST = "127.0.0.21"
SCALE = 4.0
HOME = np.radians([0.0, -90.0, -90.0, -90.0, 90.0, 0.0]).tolist()


@pytest.fixture(scope="module")
def cell():
    with SimulatedCell.start("ur10e-demo", host=HOST, time_scale=SCALE) as simulated:
        yield simulated


@pytest.fixture(scope="module")
def receive(cell):
    interface = RTDEReceiveInterface(HOST)
    yield interface
    interface.disconnect()


@pytest.fixture(scope="module")
def connected(cell):
    interface = RTDEControlInterface(HOST)
    yield interface
    interface.disconnect()


@pytest.fixture
def control(cell, connected):
    """The control interface with its script running, the arm at rest at home, and everything set right again."""
    cell.inject(Fault.RELEASE_EMERGENCY_STOP)
    cell.inject(Fault.CLEAR_PROTECTIVE_STOP)
    cell.inject(Fault.SPEED_SLIDER, fraction=1.0)
    for line in ("power on", "brake release", "stop"):
        ask_dashboard(line)
    until(lambda: not connected.isProgramRunning())
    connected.reuploadScript()
    until(connected.isProgramRunning)
    assert connected.moveJ(HOME, 3.0, 30.0)
    return connected


def ask_dashboard(line: str) -> str:
    with socket.create_connection((HOST, 29999), 2.0) as connection, connection.makefile("rw") as lines:
        lines.readline()
        lines.write(line + "\n")
        lines.flush()
        return lines.readline().strip()


def speed(receive) -> float:
    return math.hypot(*receive.getActualTCPSpeed()[:3])


def moved(pose, x=0.0, y=0.0, z=0.0):
    return [pose[0] + x, pose[1] + y, pose[2] + z, *pose[3:]]


def agree(receive, cell) -> float:
    """Distance, m, between the tool that the joints give and the tool that is reported, both at rest."""
    tool = pose_from_vector(np.array([cell.cell.tool.tcp]))[0]
    pose = arm("ur10e").forward(np.array([receive.getActualQ()]))[0] @ tool
    told = pose_from_vector(np.array([receive.getActualTCPPose()]))[0]
    return max(
        float(np.abs(pose[:3, 3] / 1000.0 - told[:3, 3]).max()),
        float(np.abs(pose[:3, :3] - told[:3, :3]).max()),
    )


def settled(receive) -> None:
    """Wait until the receiving client has seen the arm at rest."""
    time.sleep(0.02)
    until(lambda: speed(receive) == 0.0)


def test_the_arm_starts_at_the_cell_s_home_with_its_tool(receive, cell) -> None:
    assert receive.getActualQ() == pytest.approx(HOME, abs=1e-12)
    assert receive.getRobotMode() == 7
    assert receive.getSafetyMode() == 1
    assert agree(receive, cell) < 1e-9


def test_a_move_takes_its_process_time_whatever_the_scale(control, receive) -> None:
    start = receive.getActualTCPPose()
    begun = receive.getTimestamp()
    wall = time.monotonic()
    assert control.moveL(moved(start, 0.2), 0.2, 1.0)
    taken = receive.getTimestamp() - begun
    assert taken == pytest.approx(0.2 / 0.2 + 0.2 / 1.0, abs=0.05 * SCALE)
    assert taken == pytest.approx((time.monotonic() - wall) * SCALE, abs=0.01 * SCALE)


def test_the_slider_scales_everything_down_to_a_standstill(control, receive, cell) -> None:
    io = RTDEIOInterface(HOST)
    start = receive.getActualTCPPose()
    try:
        assert io.setSpeedSlider(0.5)
        until(lambda: receive.getTargetSpeedFraction() == 0.5)
        assert control.moveL(moved(start, 0.25), 0.2, 2.0, True)
        until(lambda: speed(receive) == pytest.approx(0.1, rel=1e-6))
        cell.inject(Fault.SPEED_SLIDER, fraction=0.0)
        until(lambda: speed(receive) == 0.0)
        held = receive.getActualTCPPose()
        assert receive.getRuntimeState() == 2
        time.sleep(0.05)
        assert receive.getActualTCPPose() == held
        cell.inject(Fault.SPEED_SLIDER, fraction=1.0)
        until(lambda: speed(receive) == pytest.approx(0.2, rel=1e-6))
        until(lambda: not control.getAsyncOperationProgressEx().isAsyncOperationRunning())
        settled(receive)
        assert receive.getActualTCPPose() == pytest.approx(moved(start, 0.25), abs=1e-6)
    finally:
        io.disconnect()


def test_a_protective_stop_holds_the_program_until_it_is_played_on(control, receive, cell) -> None:
    start = receive.getActualTCPPose()
    assert control.moveL(moved(start, 0.2), 0.1, 1.0, True)
    until(lambda: speed(receive) == pytest.approx(0.1))
    cell.inject(Fault.PROTECTIVE_STOP)
    until(receive.isProtectiveStopped, 0.2)
    until(lambda: speed(receive) == 0.0, 0.2)
    assert receive.getSafetyStatusBits() >> 2 & 1
    assert receive.getSafetyMode() == 3
    until(lambda: receive.getRuntimeState() == 4)
    held = receive.getActualTCPPose()
    dashboard = DashboardClient(HOST)
    dashboard.connect()
    assert dashboard.safetystatus() == "Safetystatus: PROTECTIVE_STOP"
    dashboard.unlockProtectiveStop()
    until(lambda: not receive.isProtectiveStopped())
    time.sleep(0.05)
    assert receive.getActualTCPPose() == held
    dashboard.play()
    until(lambda: not control.getAsyncOperationProgressEx().isAsyncOperationRunning())
    settled(receive)
    assert receive.getActualTCPPose() == pytest.approx(moved(start, 0.2), abs=1e-6)
    dashboard.disconnect()


def test_an_emergency_stop_ends_the_program_and_takes_the_power(control, receive, cell) -> None:
    start = receive.getActualTCPPose()
    assert control.moveL(moved(start, 0.2), 0.1, 1.0, True)
    until(lambda: speed(receive) > 0.05)
    cell.inject(Fault.EMERGENCY_STOP)
    until(receive.isEmergencyStopped, 0.2)
    until(lambda: speed(receive) == 0.0, 0.2)
    assert receive.getRuntimeState() == 1
    assert receive.getRobotMode() == 3
    assert "Failed" in ask_dashboard("brake release")
    cell.inject(Fault.RELEASE_EMERGENCY_STOP)
    assert ask_dashboard("robotmode") == "Robotmode: POWER_OFF"
    assert not control.moveL(start, 0.1, 1.0)
    ask_dashboard("power on")
    assert ask_dashboard("robotmode") == "Robotmode: IDLE"
    ask_dashboard("brake release")
    until(lambda: receive.getRobotMode() == 7)


def test_a_stop_on_the_pendant_ends_the_program_and_a_new_upload_runs(control, receive, cell) -> None:
    start = receive.getActualTCPPose()
    assert control.moveL(moved(start, 0.3), 0.1, 1.0, True)
    until(lambda: speed(receive) > 0.05)
    cell.inject(Fault.PROGRAM_STOP)
    until(lambda: receive.getRuntimeState() == 1, 0.2)
    until(lambda: speed(receive) == 0.0, 0.2)
    assert not control.isProgramRunning()
    assert not control.moveL(start, 0.1, 1.0)
    control.reuploadScript()
    until(control.isProgramRunning)
    assert control.moveL(start, 0.3, 2.0)


def test_the_watchdog_stops_what_falls_silent(control, receive) -> None:
    start = receive.getActualTCPPose()
    assert control.setWatchdog(20.0)
    assert control.moveL(moved(start, 0.4), 0.1, 1.0, True)
    deadline = time.monotonic() + 0.4
    while time.monotonic() < deadline:
        assert control.kickWatchdog()
        time.sleep(0.01)
    assert receive.getRuntimeState() == 2
    silent = time.monotonic()
    until(lambda: receive.getRuntimeState() == 1, 0.5)
    assert 0.03 < time.monotonic() - silent < 0.12  # 50 ms of wall time, at any time scale
    until(lambda: speed(receive) == 0.0, 0.2)


def test_a_target_out_of_reach_ends_the_program(control, receive, cell) -> None:
    start = receive.getActualTCPPose()
    assert not control.moveJ_IK(moved(start, 2.0), 0.2, 1.0)
    assert not control.isProgramRunning()
    assert "no inverse kinematics" in cell.complaints()
    settled(receive)
    assert receive.getActualTCPPose() == pytest.approx(start, abs=1e-9)


def test_a_mute_robot_says_nothing_and_a_dropped_one_hangs_up(cell) -> None:
    with RawRtde() as client:
        client.choose(["timestamp"])
        assert client.next_values()["timestamp"] > 0.0
        cell.inject(Fault.RTDE_MUTE)
        client.drain()
        client.connection.settimeout(0.1)
        with pytest.raises(TimeoutError):
            client.next_values()
        cell.inject(Fault.RTDE_UNMUTE)
        client.connection.settimeout(1.0)
        assert client.next_values()["timestamp"] > 0.0


def test_every_variable_of_the_table_can_be_sent(cell) -> None:
    with RawRtde() as client:
        names = known_outputs((5, 12))
        client.choose(list(names))
        values = client.next_values()
        assert values.keys() == names.keys()
        assert values["actual_q"] == pytest.approx(values["target_q"])


def test_unknown_and_owned_variables_are_refused(cell) -> None:
    with RawRtde() as client, RawRtde() as other:
        number, types = client.ask(rtde.ask_outputs(["timestamp", "no_such_thing"], 125.0))
        assert (number, types) == (0, ("DOUBLE", rtde.NOT_FOUND))
        number, types = client.ask(rtde.ask_inputs(["input_int_register_40"]))
        assert (number, types) == (1, ("INT32",))
        assert other.ask(rtde.ask_inputs(["input_int_register_40"])) == (0, (rtde.IN_USE,))
        other.choose(["input_int_register_40"])
        client.connection.sendall(rtde.values_package(1, struct.pack(">i", -77)))
        until(lambda: other.next_values()["input_int_register_40"] == -77)
    with RawRtde() as client:  # the owner has left
        until(lambda: client.ask(rtde.ask_inputs(["input_int_register_40"]))[0] == 1)


def test_rubbish_is_dropped_and_others_are_served_on(cell, receive) -> None:
    before = receive.getTimestamp()
    for port, rubbish in (
        (30004, b"\0\0\0" * 9),
        (29999, b"\xff\xfe\n"),
        (30003, b"def x():\n movej(\nend\n"),
    ):
        with socket.create_connection((HOST, port), 2.0) as connection:
            connection.sendall(rubbish)
    until(lambda: receive.getTimestamp() > before + 0.1)


class RawRtde:
    """A client that speaks RTDE through `robot.rtde` alone."""

    def __enter__(self):
        self.connection = socket.create_connection((HOST, rtde.PORT), 2.0)
        self.stream, self.pending = rtde.PackageStream(), []
        self.connection.sendall(rtde.ask_protocol())
        assert self.next(rtde.Package.PROTOCOL) == b"\x01"
        self.connection.sendall(rtde.ask_controller_version())
        assert rtde.read_controller_version(self.next(rtde.Package.CONTROLLER_VERSION))[:2] == (5, 12)
        return self

    def __exit__(self, *_):
        self.connection.close()

    def next(self, kind: int) -> bytes:
        while True:
            for i, (found, payload) in enumerate(self.pending):
                if found == kind:
                    del self.pending[: i + 1]
                    return payload
            self.pending += self.stream.feed(self.connection.recv(65536))

    def ask(self, request: bytes):
        self.connection.sendall(request)
        return rtde.read_types(self.next(request[2]))

    def choose(self, names: list[str]) -> None:
        number, types = self.ask(rtde.ask_outputs(names, 500.0))
        assert number == 1
        self.recipe = rtde.Recipe(names, types)
        self.connection.sendall(rtde.ask_start())
        assert self.next(rtde.Package.START) == b"\x01"

    def next_values(self):
        return self.recipe.unpack(self.next(rtde.Package.VALUES)[1:])

    def drain(self) -> None:
        time.sleep(0.02)
        self.connection.settimeout(0.01)
        try:
            while self.connection.recv(65536):
                pass
        except TimeoutError:
            self.pending.clear()
            self.stream = rtde.PackageStream()
