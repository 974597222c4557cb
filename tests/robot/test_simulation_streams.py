"""What the simulated controller tells on its primary, secondary and real-time ports, read as they are documented."""

from __future__ import annotations

import math
import socket
import struct
import time

import numpy as np
import pytest

from planning import ARMS, arm, load_cell
from planning.pose import pose_from_vector, vector_from_pose
from robot import rtde
from robot.simulation import Fault, SimulatedCell
from robot.simulation.interfaces.realtime_stream import RealtimeStream
from robot.simulation.interfaces.state_message import StateMessage
from robot.simulation.machine import Machine

HOST = "127.0.0.24"


@pytest.fixture(scope="module")
def cell():
    with SimulatedCell.start("ur10e-demo", host=HOST, time_scale=4.0) as simulated:
        yield simulated


class Client:
    """Reads messages from a port."""

    def __init__(self, port):
        self._socket = socket.create_connection((HOST, port), 2.0)
        self._socket.settimeout(3.0)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._socket.close()

    def send(self, text):
        self._socket.sendall(text.encode())

    def _exactly(self, count):
        data = b""
        while len(data) < count:
            received = self._socket.recv(count - len(data))
            assert received, "the controller has closed the connection"
            data += received
        return data

    def message(self):
        """Kind and body."""
        length, kind = struct.unpack(">iB", self._exactly(5))
        return kind, self._exactly(length - 5)

    def next_of(self, kind, wanted=lambda body: True, seconds=5.0):
        """The body of the next message of a kind."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            found, body = self.message()
            if found == kind and wanted(body):
                return body
        raise AssertionError("it was not told in time")

    def state(self):
        """The parts of the next state, by kind."""
        return parts_of(self.next_of(16))

    def silent(self, seconds=0.3):
        """Whether nothing but states comes for a time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if self.message()[0] != 16:
                return False
        return True


def parts_of(body):
    """Bodies of a state's parts, by kind."""
    parts = {}
    while body:
        length, kind = struct.unpack(">iB", body[:5])
        assert 5 <= length <= len(body)
        parts[kind], body = body[5:length], body[length:]
    return parts


def said(kind):
    """Whether a message of kind 20 is of a kind of its own."""
    return lambda body: body[9] == kind


@pytest.mark.parametrize("port", [30001, 30002])
def test_every_client_is_told_the_version_and_then_the_state(cell, port):
    with Client(port) as client:
        kind, body = client.message()
        assert kind == 20
        _, source, what, length = struct.unpack(">Qbbb", body[:11])
        assert (source, what) == (-2, 3)
        assert body[11 : 11 + length] == b"URControl"
        assert struct.unpack(">BBii", body[11 + length : 21 + length])[:2] == (5, 12)
        parts = client.state()
    assert {0: 42, 1: 246, 4: 96, 7: 56}.items() <= {k: len(v) for k, v in parts.items()}.items()


def test_the_state_is_that_of_the_arm(cell):
    known = load_cell("ur10e-demo")
    with Client(30002) as client:
        parts = client.state()
    joints = np.array([struct.unpack(">dddffffB", parts[1][i : i + 41])[:2] for i in range(0, 246, 41)])
    assert np.allclose(joints, known.robot.home[:, None])
    pose, tool = np.array(struct.unpack(">12d", parts[4])).reshape(2, 6)
    metres = np.array([1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0])
    assert np.allclose(tool, known.tool.tcp * metres)
    offset = pose_from_vector(np.array([known.tool.tcp]))[0]
    frame = arm(known.robot.model).forward(known.robot.home[None])[0] @ offset
    assert np.allclose(pose[:3], (vector_from_pose(frame[None])[0] * metres)[:3], atol=1e-9)


def test_power_stops_programs_and_outputs_are_told(cell):
    def mode(parts):
        return struct.unpack(">Q???????BBddd?", parts[0])

    with Client(30002) as client:
        assert mode(client.state())[1:8] == (True, True, True, False, False, False, False)
        client.send("def program():\n  set_standard_digital_out(2, True)\n  sleep(20)\nend\n")
        end = time.monotonic() + 5.0
        while not mode(client.state())[6]:
            assert time.monotonic() < end
        assert struct.unpack(">ii", client.state()[3][:8])[1] == 1 << 2
        cell.inject(Fault.PROTECTIVE_STOP)
        while not mode(client.state())[5]:
            assert time.monotonic() < end
        held = mode(client.state())
        assert (held[6], held[7]) == (False, True)
        cell.inject(Fault.CLEAR_PROTECTIVE_STOP)


def test_what_a_program_says_and_what_ends_it_is_told_on_the_primary_port(cell):
    with Client(30001) as one, Client(30001) as other, Client(30002) as secondary:
        for client in (one, other, secondary):
            client.state()
        secondary.send('def program():\n  textmsg("layer ", 7)\n  sync()\n  x = 1 / 0\nend\n')
        for client in (one, other):
            assert client.next_of(20, said(0))[10:] == b"layer 7"
            body = client.next_of(20, said(10))
            assert struct.unpack(">ii", body[10:18]) == (4, 9)
            assert body[18:] == b"division by zero"
        one.send("def program():\n  mvoe(1)\nend\n")
        body = other.next_of(20, said(10))
        assert struct.unpack(">ii", body[10:18]) == (2, 3)
        assert secondary.silent()


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        (["movel(p[2.5, 0, 0.2, 0, 3.14, 0])"], b"no inverse kinematics at p[2.5, 0, 0.2"),
        (
            ["q = get_actual_joint_positions()", "q[0] = q[0] + 2", "sync()", "servoj(q, t=1, gain=2000)"],
            b"joint 1 is led at ",
        ),
    ],
)
def test_a_move_that_cannot_go_on_is_told_with_its_place(cell, lines, says):
    with Client(30001) as client:
        client.state()
        client.send("def program():\n" + "".join(f"  {line}\n" for line in lines) + "end\n")
        body = client.next_of(20, said(10))
        assert struct.unpack(">ii", body[10:18]) == (1 + len(lines), 3)
        assert body[18:].startswith(says)


def key(body):
    """Title and text of a key message."""
    length = body[18]
    return body[19 : 19 + length].decode(), body[19 + length :].decode()


def test_the_primary_port_tells_that_programs_begin_and_end(cell):
    with Client(30001) as client:
        client.state()
        client.send("def first():\n  sleep(30)\nend\n")
        assert key(client.next_of(20, said(7))) == ("PROGRAM_XXX_STARTED", "first")
        client.send("def second():\n  x = 1\nend\n")  # takes the other's place, and no time
        told = [key(client.next_of(20, said(7))) for _ in range(3)]
        assert told == [
            ("PROGRAM_XXX_STOPPED", "first"),
            ("PROGRAM_XXX_STARTED", "second"),
            ("PROGRAM_XXX_STOPPED", "second"),
        ]


def test_the_primary_port_tells_what_the_safety_system_does(cell):
    with Client(30001) as client:
        client.state()
        for fault, mode in ((Fault.PROTECTIVE_STOP, 3), (Fault.CLEAR_PROTECTIVE_STOP, 1)):
            cell.inject(fault)
            body = client.next_of(20, said(5))
            assert struct.unpack(">iiB", body[10:19]) == (0, 0, mode)


@pytest.mark.parametrize("port", [30011, 30012])
def test_ports_that_only_tell_take_no_programs(cell, port):
    with Client(port) as client, Client(30001) as primary:
        assert client.message()[1][9] == 3  # the version
        assert client.message()[0] == 16
        primary.state()
        client.send("def program():\n  sleep(1)\nend\n")
        assert primary.silent()
        primary.send('def program():\n  textmsg("hello")\nend\n')
        if port == 30011:
            assert client.next_of(20, said(0))[10:] == b"hello"
        else:
            assert client.silent()


@pytest.mark.parametrize("end", ["end\n", "end"])
@pytest.mark.parametrize("port", [30001, 30002, 30003])
def test_a_program_arrives_though_its_client_leaves_without_a_look_at_what_it_is_told(cell, port, end):
    with socket.create_connection((HOST, rtde.PORT), 2.0) as exchange:
        exchange.settimeout(3.0)
        exchange.sendall(
            rtde.ask_protocol() + rtde.ask_outputs(["output_int_register_7"], 125.0) + rtde.ask_start()
        )
        stream, value = rtde.PackageStream(), None
        for i in range(4):
            sent = 1 + i + port + 100_000 * len(end)
            with socket.create_connection((HOST, port), 2.0) as leaving:
                time.sleep(0.03 * i)  # as long as something is told
                text = "".join(f"  # line {j} of {'many' * 10}\n" for j in range(300))
                text += f"  write_output_integer_register(7, {sent})\n"
                leaving.sendall(f"def program():\n{text}{end}".encode())
            until = time.monotonic() + 4.0
            while value != sent:
                assert time.monotonic() < until, "the program has not run"
                for kind, payload in stream.feed(exchange.recv(65536)):
                    if kind == rtde.Package.VALUES:
                        (value,) = struct.unpack(">i", payload[1:])


# -- the parts of the state that never change


def forward(theta, a, d, alpha, joints):
    """The flange's pose, m, as the Denavit-Hartenberg convention defines it."""
    pose = np.eye(4)
    for t, x, z, twist in zip(np.array(theta) + joints, a, d, alpha, strict=True):
        c, s, u, v = math.cos(t), math.sin(t), math.cos(twist), math.sin(twist)
        pose = pose @ [[c, -s * u, s * v, x * c], [s, c * u, -c * v, x * s], [0, v, u, z], [0, 0, 0, 1]]
    return pose


def model(name, version=(5, 12, 0, 0)):
    """A controller of an arm."""
    cell = load_cell("ur10e-demo")
    return Machine(cell.model_copy(update={"robot": cell.robot.model_copy(update={"model": name})}), version)


@pytest.mark.parametrize("name", list(ARMS))
def test_kinematics_and_configuration_are_those_of_the_arm(name):
    parts = parts_of(StateMessage(model(name)).packed()[5:])
    numbers = struct.unpack(">6I24dI", parts[5])
    theta, a, d, alpha = np.array(numbers[6:30]).reshape(4, 6)
    joints = np.random.default_rng(3).uniform(-3.0, 3.0, (5, 6))
    for posture, expected in zip(joints, ARMS[name].forward(joints), strict=True):
        found = forward(theta, a, d, alpha, posture)
        assert np.allclose(found[:3, 3] * 1e3, expected[:3, 3], atol=1e-9)
        assert np.allclose(found[:3, :3], expected[:3, :3], atol=1e-12)
    numbers = struct.unpack(">12d12d5d24d4i", parts[6])
    assert np.allclose(np.array(numbers[29:53]).reshape(4, 6), [a, d, alpha, theta])
    known = {"ur5": 1, "ur10": 2, "ur3": 3, "ur16": 4, "ur20": 7, "ur30": 8}
    assert numbers[55] == known[name.removesuffix("e")]


@pytest.mark.parametrize(
    ("version", "mode", "board", "additional", "newer"),
    [((3, 15, 0, 0), 46, 75, 8, set()), ((5, 12, 0, 0), 47, 75, 9, {11, 12, 13})],
)
def test_parts_have_the_sizes_of_their_version(version, mode, board, additional, newer):
    message = StateMessage(model("ur5", version)).packed()
    assert struct.unpack(">iB", message[:5]) == (len(message), 16)
    assert len(message) <= 2000  # what urx takes for a message
    sizes = {kind: len(body) + 5 for kind, body in parts_of(message[5:]).items()}
    expected = {0: mode, 1: 251, 2: 37, 3: board, 4: 101, 5: 225, 6: 445, 7: 61, 8: additional}
    assert {kind: size for kind, size in sizes.items() if kind < 9} == expected
    assert set(sizes) - set(expected) == newer


# -- the real-time port

COLUMNS = {
    "timestamp": (1, 1),
    "target_q": (2, 6),
    "target_qd": (8, 6),
    "target_qdd": (14, 6),
    "actual_q": (32, 6),
    "actual_qd": (38, 6),
    "actual_TCP_pose": (56, 6),
    "actual_TCP_speed": (62, 6),
    "actual_TCP_force": (68, 6),
    "target_TCP_pose": (74, 6),
    "actual_digital_input_bits": (86, 1),
    "joint_temperatures": (87, 6),
    "robot_mode": (95, 1),
    "joint_mode": (96, 6),
    "safety_mode": (102, 1),
    "actual_tool_accelerometer": (109, 3),
    "speed_scaling": (118, 1),
    "actual_main_voltage": (122, 1),
    "actual_joint_voltage": (125, 6),
    "actual_digital_output_bits": (131, 1),
    "runtime_state": (132, 1),
    "elbow_position": (133, 3),
    "elbow_velocity": (136, 3),
    "safety_status": (139, 1),
    "payload": (143, 1),
    "payload_cog": (144, 3),
    "payload_inertia": (147, 6),
}
"""Of the values that RTDE tells too: their first column in the published table, counted from 1, and their number."""


@pytest.mark.parametrize(
    ("version", "size"),
    [
        ((3, 2), 1060),
        ((3, 5), 1108),
        ((3, 10), 1116),
        ((3, 15), 1220),
        ((5, 1), 1108),
        ((5, 4), 1116),
        ((5, 9), 1140),
        ((5, 12), 1220),
        ((5, 22), 1220),
    ],
)
def test_the_real_time_message_has_the_size_of_its_version(version, size):
    message = RealtimeStream(model("ur10e", (*version, 0, 0))).packed()
    assert len(message) == size
    assert struct.unpack(">i", message[:4]) == (size,)


@pytest.mark.parametrize("port", [30003, 30013])
def test_the_real_time_port_tells_what_rtde_tells_at_the_same_time(cell, port):
    names = list(COLUMNS)
    with (
        socket.create_connection((HOST, rtde.PORT), 2.0) as exchange,
        socket.create_connection((HOST, port), 2.0) as realtime,
        Client(30002) as scripts,
    ):
        exchange.settimeout(3.0)
        realtime.settimeout(3.0)
        base = 0.3 if port == 30003 else -0.3
        scripts.send("def turn():\n  set_target_payload(1.5,[0.01,0.02,0.03],[1,2,3,0,0,0])\n")
        scripts.send(
            f"  set_standard_digital_out(1, True)\n  movej([{base},-1.4,-1.6,-1.6,1.4,0.1],a=1,v=0.5)\nend\n"
        )
        exchange.sendall(rtde.ask_protocol() + rtde.ask_outputs(names, 500.0) + rtde.ask_start())
        stream, received = rtde.PackageStream(), []
        while len(received) < 403:
            received += stream.feed(exchange.recv(65536))
        recipe = rtde.Recipe(names, rtde.read_types(received[1][1])[1])
        told = [recipe.unpack(payload[1:]) for kind, payload in received if kind == rtde.Package.VALUES]
        told = {values["timestamp"]: values for values in told}
        data = b""
        while len(data) < 300 * 1220:
            data += realtime.recv(65536)
    messages = [struct.unpack(">i152d", data[i : i + 1220]) for i in range(0, 299 * 1220, 1220)]
    assert {message[0] for message in messages} == {1220}
    both = [message for message in messages if message[1] in told]
    assert len(both) > 50
    assert len({message[2:8] for message in both}) > 20  # the arm moves meanwhile
    for message in both:
        for name, (column, count) in COLUMNS.items():
            value = told[message[1]][name]
            assert message[column : column + count] == (value if isinstance(value, tuple) else (value,)), name


def test_a_client_of_the_real_time_port_that_does_not_read_holds_nobody_up(cell):
    with socket.create_connection((HOST, 30003), 2.0), socket.create_connection((HOST, 30003), 2.0) as other:
        other.settimeout(3.0)
        received, end = 0, time.monotonic() + 1.5
        while time.monotonic() < end:
            received += len(other.recv(1 << 16))
        assert received > 100 * 1220


def test_a_client_that_does_not_read_holds_nobody_up(cell):
    with socket.create_connection((HOST, 30002), 2.0), Client(30002) as client:
        first = client.state()[0]
        time.sleep(1.0)
        for _ in range(12):
            last = client.state()[0]
        times = [struct.unpack(">Q", body[:8])[0] * 1e-6 for body in (first, last)]
        assert times[1] - times[0] > 1.0
        assert math.isfinite(times[1])
