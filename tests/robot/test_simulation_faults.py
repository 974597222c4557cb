"""Faults on demand of the simulated controller, seen by clients: raw RTDE, the dashboard and ur-rtde."""

from __future__ import annotations

import contextlib
import itertools
import json
import random
import socket
import struct
import time

import pytest
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

from robot import rtde
from robot.errors import RobotError
from robot.simulation import Fault, SimulatedCell
from robot.simulation.faults import CONTROLLER_PORT, VALUES

HOST = "127.0.35.2"
NAMES = (
    "timestamp",
    "safety_status_bits",
    "runtime_state",
    "robot_mode",
    "actual_digital_input_bits",
    "actual_q",
)


@pytest.fixture(scope="module")
def cell():
    with SimulatedCell.start("ur10e-demo", host=HOST) as simulated:
        yield simulated


class Listener:
    """A client that receives values, as bytes or unpacked."""

    def __init__(self, names=NAMES, frequency=500.0):
        self.socket = socket.create_connection((HOST, rtde.PORT), 2.0)
        self._stream = rtde.PackageStream()
        self._waiting = []
        self._ask(rtde.ask_protocol())
        _, types = rtde.read_types(self._ask(rtde.ask_outputs(names, frequency)))
        self.recipe = rtde.Recipe(names, types)
        self._ask(rtde.ask_start())

    def _ask(self, question):
        self.socket.sendall(question)
        return self.package()[1]

    def package(self):
        """The next package: kind, payload."""
        while not self._waiting:
            received = self.socket.recv(65536)
            if not received:
                raise ConnectionError("closed")
            self._waiting = list(self._stream.feed(received))
        return self._waiting.pop(0)

    def values(self):
        """The next values."""
        while True:
            kind, payload = self.package()
            if kind == rtde.Package.VALUES:
                return self.recipe.unpack(payload[1:])

    def until(self, says, seconds=2.0):
        """The first values of which `says` is true."""
        deadline = time.monotonic() + seconds
        while not says(values := self.values()):
            assert time.monotonic() < deadline, values
        return values

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.socket.close()


def never(values):
    return False


@pytest.fixture
def listener(cell):
    with Listener() as client:
        yield client


def dashboard(*lines):
    """What the dashboard answers, line by line; the welcome is left out."""
    with socket.create_connection((HOST, 29999), 2.0) as connection, connection.makefile("rw") as stream:
        stream.readline()
        answers = []
        for line in lines:
            stream.write(line + "\n")
            stream.flush()
            answers.append(stream.readline().strip())
        return answers


@pytest.fixture
def ready(cell):
    """The robot has power and nothing stops it, before and after."""

    def make():
        dashboard("power on", "brake release")
        deadline = time.monotonic() + 3.0
        while dashboard("robotmode") != ["Robotmode: RUNNING"]:
            assert time.monotonic() < deadline
            time.sleep(0.01)

    make()
    yield
    make()


@pytest.mark.parametrize(
    ("fault", "clear", "bits"),
    [
        (Fault.PROTECTIVE_STOP, Fault.CLEAR_PROTECTIVE_STOP, 1 << 2),
        (Fault.SAFEGUARD_STOP, Fault.CLEAR_SAFEGUARD_STOP, 1 << 4),
        (Fault.SYSTEM_EMERGENCY_STOP, Fault.RELEASE_SYSTEM_EMERGENCY_STOP, 1 << 5 | 1 << 7),
        (Fault.EMERGENCY_STOP, Fault.RELEASE_EMERGENCY_STOP, 1 << 6 | 1 << 7),
    ],
)
def test_a_safety_stop_is_told_and_ends(cell, ready, listener, fault, clear, bits):
    told = cell.inject(fault)
    seen = listener.until(lambda values: values["safety_status_bits"] & bits == bits)
    assert seen["timestamp"] - (told["wall"] - cell.epoch) < 0.5
    cell.inject(clear)
    listener.until(lambda values: values["safety_status_bits"] & 1)


def test_one_stop_is_not_cleared_by_anothers_end(cell, ready, listener):
    cell.inject(Fault.SAFEGUARD_STOP)
    cell.inject(Fault.CLEAR_PROTECTIVE_STOP)
    listener.until(lambda values: values["safety_status_bits"] & 1 << 4)
    for _ in range(20):
        assert listener.values()["safety_status_bits"] & 1 << 4
    cell.inject(Fault.CLEAR_SAFEGUARD_STOP)
    listener.until(lambda values: values["safety_status_bits"] & 1)


@pytest.mark.parametrize("number", [0, 7, 8, 17])
def test_an_input_is_wired_and_unwired(cell, listener, number):
    cell.inject(Fault.DIGITAL_INPUT, number=number)
    listener.until(lambda values: values["actual_digital_input_bits"] == 1 << number)
    cell.inject(Fault.CLEAR_DIGITAL_INPUT, number=number)
    listener.until(lambda values: values["actual_digital_input_bits"] == 0)


def test_a_program_is_held_goes_on_and_ends(cell, ready, listener):
    with socket.create_connection((HOST, 30001), 2.0) as port:
        port.sendall(b"def waits():\n  while True:\n    sync()\n  end\nend\n")
        listener.until(lambda values: values["runtime_state"] == 2)
        cell.inject(Fault.PROGRAM_PAUSE)
        listener.until(lambda values: values["runtime_state"] == 4)
        cell.inject(Fault.PROGRAM_PLAY)
        listener.until(lambda values: values["runtime_state"] == 2)
        cell.inject(Fault.PROGRAM_STOP)
        listener.until(lambda values: values["runtime_state"] == 1)


def test_values_are_late_by_what_was_asked_for_and_none_is_lost(cell, listener):
    clock = listener.until(lambda _: True)["timestamp"]
    cell.inject(Fault.RTDE_LATE, seconds=0.3)
    try:
        began = time.monotonic()
        delays, times = [], [clock]
        while time.monotonic() < began + 0.9:
            times.append(listener.values()["timestamp"])
            delays.append(time.monotonic() - cell.epoch - times[-1])
        assert sorted(times) == times
        late = sorted(delays[len(delays) // 2 :])
        assert late[0] >= 0.299
        assert late[len(late) // 2] < 0.35
        assert max(b - a for a, b in itertools.pairwise(times)) < 0.1  # no gap of what was held
    finally:
        cell.inject(Fault.RTDE_ON_TIME)
    listener.until(lambda values: time.monotonic() - cell.epoch - values["timestamp"] < 0.1)


def test_a_mute_controller_keeps_its_connections(cell, listener):
    cell.inject(Fault.RTDE_MUTE)
    try:
        listener.socket.settimeout(0.2)
        with pytest.raises(TimeoutError):
            listener.until(never, 3.0)
    finally:
        cell.inject(Fault.RTDE_UNMUTE)
    listener.socket.settimeout(2.0)
    assert listener.values()


def raw(listener, size):
    """So many bytes as they come."""
    received = b""
    while len(received) < size:
        more = listener.socket.recv(size - len(received))
        if not more:
            raise ConnectionError("closed")
        received += more
    return received


@pytest.fixture
def slow():
    """A listener at 5 Hz that is past its first values: a fault between two packages is seen on its own."""
    with Listener(frequency=5.0) as client:
        client.values()
        assert not client._waiting
        yield client


def test_garbage_is_as_long_as_a_package_and_is_none(cell, slow):
    size = slow.recipe.size + 4
    cell.inject(Fault.RTDE_GARBAGE)
    assert raw(slow, 3) != struct.pack(">HB", size, rtde.Package.VALUES)
    raw(slow, size - 3)
    assert raw(slow, 3) == struct.pack(">HB", size, rtde.Package.VALUES)


def test_half_a_package_is_followed_by_a_whole_one(cell, slow):
    size = slow.recipe.size + 4
    cell.inject(Fault.RTDE_HALF)
    assert raw(slow, 3) == struct.pack(">HB", size, rtde.Package.VALUES)
    raw(slow, size // 2 - 3)
    assert raw(slow, 3) == struct.pack(">HB", size, rtde.Package.VALUES)


def test_half_a_package_and_the_end(cell, slow):
    size = slow.recipe.size + 4
    cell.inject(Fault.RTDE_HALF_DROP)
    assert raw(slow, 3) == struct.pack(">HB", size, rtde.Package.VALUES)
    raw(slow, size // 2 - 3)
    with pytest.raises(ConnectionError):
        raw(slow, 1)


def test_dropped_connections_can_be_made_again(cell, listener):
    cell.inject(Fault.RTDE_DROP)
    with pytest.raises(ConnectionError):
        listener.until(never, 3.0)
    with Listener() as again:
        assert again.values()


def test_the_dashboard_refuses_what_would_change_something(cell, ready):
    cell.inject(Fault.DASHBOARD_REFUSE)
    try:
        answers = dashboard("robotmode", "power off", "stop", "load wall.urp")
        assert answers == [
            "Robotmode: RUNNING",
            "Failed to execute: power off",
            "Failed to execute: stop",
            "Error while loading program: wall.urp",
        ]
        assert dashboard("robotmode") == ["Robotmode: RUNNING"]
    finally:
        cell.inject(Fault.DASHBOARD_OPEN)
    assert dashboard("stop") == ["Stopped"]


def test_a_closed_dashboard_takes_nobody(cell):
    with socket.create_connection((HOST, 29999), 2.0) as connection:
        connection.recv(100)
        cell.inject(Fault.DASHBOARD_CLOSE)
        assert connection.recv(100) == b""
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((HOST, 29999), 2.0)
    cell.inject(Fault.DASHBOARD_OPEN)
    deadline = time.monotonic() + 2.0
    while True:
        with contextlib.suppress(ConnectionRefusedError):
            assert dashboard("robotmode")
            break
        assert time.monotonic() < deadline


def test_a_reboot_cuts_everything_and_leaves_the_arm_where_it_was(cell, ready, listener):
    control = RTDEControlInterface(HOST)
    target = list(listener.values()["actual_q"])
    target[0] += 0.2
    assert control.moveJ(target, 3.0, 20.0)
    control.disconnect()
    before = listener.values()
    with socket.create_connection((HOST, 30001), 2.0) as script:
        answer = cell.inject(Fault.REBOOT, seconds=0.4)
        script.settimeout(1.0)
        with contextlib.suppress(ConnectionResetError):
            while script.recv(65536):
                assert time.monotonic() < answer["wall"] + 3.0
    with pytest.raises(ConnectionError):
        listener.until(never, 3.0)
    while time.monotonic() < answer["wall"] + 0.35:
        for port in (29999, 30001, 30002, 30003, 30004):
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection((HOST, port), 1.0)
        time.sleep(0.05)
    time.sleep(max(0.0, answer["wall"] + 0.7 - time.monotonic()))
    with Listener() as again:
        after = again.values()
        assert after["timestamp"] > before["timestamp"]
        assert after["actual_q"] == pytest.approx(target, abs=1e-9)
        assert (after["robot_mode"], after["runtime_state"]) == (3, 1)
        assert dashboard("power on", "brake release")[0] == "Powering on"
        again.until(lambda values: values["robot_mode"] == 7)
    receive = RTDEReceiveInterface(HOST)
    assert receive.getRobotMode() == 7
    receive.disconnect()


@pytest.mark.parametrize(
    ("sent", "says"),
    [
        (b"", "send one JSON object"),
        (b"\xff\x00", "send one JSON object"),
        (b"[1]", "send one JSON object"),
        (b"{}", "send one JSON object"),
        (b"[" * 9000, "send one JSON object"),
        (b'{"fault": "rtde moot"}', "there is no such fault; did you mean 'rtde mute'?"),
        (b'{"fault": ["speed slider"]}', "there is no such fault"),
        (b'{"fault": "pump mute"}', "'pump mute' is the pump's: send it to port 30098 at the pump's address"),
        (b'{"fault": "speed slider", "fraction": 1, "bar": 2}', "'speed slider' takes `fraction`, not `bar`"),
        (b'{"fault": "rtde drop", "bar": 2}', "'rtde drop' takes no values, not `bar`"),
        (b'{"fault": "speed slider"}', "'speed slider' takes `fraction`, 0 to 1"),
        (b'{"fault": "speed slider", "fraction": NaN}', "'speed slider' takes `fraction`, 0 to 1, not nan"),
        (b'{"fault": "speed slider", "fraction": 1e999}', "'speed slider' takes `fraction`, 0 to 1, not inf"),
        (
            b'{"fault": "speed slider", "fraction": 1' + b"0" * 400 + b"}",
            "'speed slider' takes `fraction`, 0 to 1, not 1000",
        ),
        (b'{"fault": "speed slider", "fraction": "1"}', "'speed slider' takes `fraction`, 0 to 1, not '1'"),
        (
            b'{"fault": "digital input", "number": 18}',
            "'digital input' takes `number`, a whole number, 0 to 17, not 18",
        ),
    ],
)
def test_what_is_not_understood_changes_nothing_and_says_why(cell, sent, says):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        asking.settimeout(2.0)
        asking.connect((HOST, CONTROLLER_PORT))
        asking.send(sent)
        answer = json.loads(asking.recv(65536))
    assert answer.keys() == {"error"}
    assert answer["error"].startswith(says)


def test_nonsense_is_answered_and_harms_nobody(cell, listener):
    chance = random.Random(7)
    whole = b'{"fault": "speed slider", "fraction": 1.0}'
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        asking.settimeout(2.0)
        asking.connect((HOST, CONTROLLER_PORT))
        for k in range(2000):
            sent = bytearray(chance.randbytes(chance.randrange(200)) if k % 2 else whole)
            for _ in range(chance.randrange(1, 4)):
                sent[chance.randrange(len(sent) or 1) : chance.randrange(len(sent) + 1)] = chance.randbytes(2)
            asking.send(sent)
            answer = json.loads(asking.recv(65536))
            assert answer.keys() in ({"error"}, {"wall"})
    assert listener.until(lambda values: values["timestamp"] > time.monotonic() - cell.epoch - 0.5)


def test_every_fault_is_somebodys(cell):
    """Controller or pump takes each one that needs no value, or says which value it needs."""
    for fault in Fault:
        if fault in VALUES:
            with pytest.raises(RobotError, match=f"takes `{VALUES[fault].name}`"):
                cell.inject(fault)
