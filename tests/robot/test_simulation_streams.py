"""What the simulated controller tells on its primary and secondary ports, read as their documentation describes."""

from __future__ import annotations

import math
import socket
import struct
import time

import numpy as np
import pytest

from planning import arm, load_cell
from planning.pose import pose_from_vector, vector_from_pose
from robot.simulation import Fault, SimulatedCell

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
        body, parts = self.next_of(16), {}
        while body:
            length, kind = struct.unpack(">iB", body[:5])
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


def test_what_a_program_says_and_what_ends_it_is_told_to_all(cell):
    with Client(30001) as one, Client(30002) as other:
        one.state()
        other.state()
        one.send('def program():\n  textmsg("layer ", 7)\n  sync()\n  x = 1 / 0\nend\n')
        for client in (one, other):
            assert client.next_of(20, said(0))[10:] == b"layer 7"
            body = client.next_of(20, said(10))
            assert struct.unpack(">ii", body[10:18]) == (4, 9)
            assert body[18:] == b"division by zero"
        one.send("def program():\n  mvoe(1)\nend\n")
        body = other.next_of(20, said(10))
        assert struct.unpack(">ii", body[10:18]) == (2, 3)


def test_a_client_that_does_not_read_holds_nobody_up(cell):
    with socket.create_connection((HOST, 30002), 2.0), Client(30002) as client:
        first = client.state()[0]
        time.sleep(1.0)
        for _ in range(12):
            last = client.state()[0]
        times = [struct.unpack(">Q", body[:8])[0] * 1e-6 for body in (first, last)]
        assert times[1] - times[0] > 1.0
        assert math.isfinite(times[1])
