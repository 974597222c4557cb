"""Programs sent to the simulated controller, a process of its own: what they say is what the arm does."""

from __future__ import annotations

import math
import socket
import time

import numpy as np
import pytest
from rtde_receive import RTDEReceiveInterface
from waiting import until

from robot.simulation import Fault, SimulatedCell

HOST = "127.0.0.23"
SCALE = 4.0
JITTER = 0.2
"""What a busy machine may be late with the first package that is read, s of process time."""

HOME = [0.0, -math.pi / 2, -math.pi / 2, -math.pi / 2, math.pi / 2, 0.0]


@pytest.fixture(scope="module")
def cell():
    with SimulatedCell.start("ur10e-demo", host=HOST, time_scale=SCALE) as simulated:
        yield simulated


@pytest.fixture(scope="module")
def receive(cell):
    interface = RTDEReceiveInterface(HOST)
    yield interface
    interface.disconnect()


def send(text, port=30002):
    with socket.create_connection((HOST, port), 2.0) as connection:
        connection.sendall(text.encode())


def run(receive, *lines, seconds=10.0):
    """Run a program to its end; time, place and speed of the tool while it ran, a row a package."""
    mark = receive.getOutputIntRegister(12) + 1
    body = "\n".join(f"  {line}" for line in lines)
    send(f"def program():\n  write_output_integer_register(12, {mark})\n{body}\nend\n")
    rows = []
    deadline = time.monotonic() + seconds
    while receive.getOutputIntRegister(12) != mark or receive.getRuntimeState() == 2:
        assert time.monotonic() < deadline, "did not end in time"
        now = receive.getTimestamp()
        if not rows or now > rows[-1][0]:
            speed = math.hypot(*receive.getActualTCPSpeed()[:3])
            rows.append([now, *receive.getActualTCPPose()[:3], speed])
        time.sleep(0.0005)
    return np.array(rows)


@pytest.fixture
def home(cell, receive):
    """The arm at rest at home; where its tool is, m."""
    run(receive, f"movej({HOME}, a=30, v=3)")
    assert np.allclose(receive.getActualQ(), HOME, atol=1e-6)
    return np.array(receive.getActualTCPPose())


def written(pose):
    return "p[" + ", ".join(f"{x:.9g}" for x in pose) + "]"


def moved(pose, x=0.0, y=0.0, z=0.0):
    return np.concatenate([pose[:3] + [x, y, z], pose[3:]])


def test_a_straight_move_takes_as_long_as_its_trapezoid(receive, home):
    rows = run(receive, f"movel({written(moved(home, z=-0.2))}, a=0.5, v=0.1)")
    assert np.allclose(receive.getActualTCPPose()[:3], home[:3] - [0, 0, 0.2], atol=1e-6)
    moving = rows[rows[:, 4] > 1e-6]
    assert moving[-1, 0] - moving[0, 0] == pytest.approx(0.2 / 0.1 + 0.1 / 0.5, abs=JITTER)
    assert rows[:, 4].max() == pytest.approx(0.1, rel=1e-6)
    assert np.abs(rows[:, 1:3] - home[:2]).max() < 1e-6


def test_the_same_straight_move_in_a_given_time(receive, home):
    rows = run(receive, f"movel({written(moved(home, z=-0.1))}, t=2)")
    moving = rows[rows[:, 4] > 1e-6]
    assert moving[-1, 0] - moving[0, 0] == pytest.approx(2.0, abs=JITTER)


def test_a_path_of_movep_keeps_its_speed_through_its_blends(receive, home):
    """Each move is told when the one before comes within its radius: the speed never falls."""
    corners = [moved(home, z=-0.1), moved(home, y=0.1, z=-0.1), moved(home, y=0.1), home]
    moves = [f"movep({written(corner)}, a=1.0, v=0.1, r=0.01)" for corner in corners[:-1]]
    for _ in range(5):  # a busy machine lets packages pass unread
        rows = run(receive, *moves, f"movep({written(corners[-1])}, a=1.0, v=0.1, r=0)")
        if np.diff(rows[:, 0]).max() < 0.02:
            break
    assert np.allclose(receive.getActualTCPPose()[:3], home[:3], atol=1e-6)
    moving = rows[rows[:, 4] > 1e-6]
    start, end = moving[0, 0], moving[-1, 0]
    cruising = moving[(moving[:, 0] > start + 0.15) & (moving[:, 0] < end - 0.15)]
    assert np.abs(cruising[:, 4] - 0.1).max() < 0.0005
    places = moving[:, 1:4]
    for corner in corners[:-1]:  # past every corner, within the blend's radius but not at it
        nearest = np.linalg.norm(places - corner[:3], axis=1).min()
        assert 0.01 * (math.sqrt(2.0) - 1.0) - 1e-5 <= nearest < 0.01
    length = 0.4 - 3 * (2 * 0.01 - 0.01 * math.pi / 2)
    assert end - start == pytest.approx(length / 0.1 + 0.1, abs=JITTER)


def test_loops_functions_and_threads_move_the_arm(receive, home):
    run(
        receive,
        "global count = 0",
        "thread watch():",
        "  while True:",
        "    count = count + 1",
        "    sync()",
        "  end",
        "end",
        "def step(z):",
        "  here = get_actual_tcp_pose()",
        "  here[2] = here[2] + z",
        "  movel(here, a=2, v=0.2)",
        "end",
        "h = run watch()",
        "i = 0",
        "while i < 3:",
        "  step(-0.02)",
        "  i = i + 1",
        "end",
        "kill h",
        "write_output_integer_register(13, i)",
        "write_output_float_register(12, count * 1.0)",
    )
    assert receive.getActualTCPPose()[2] == pytest.approx(home[2] - 0.06, abs=1e-6)
    assert receive.getOutputIntRegister(13) == 3
    assert receive.getOutputDoubleRegister(12) > 10.0


def test_a_killed_thread_leaves_the_arm_to_brake(receive, home):
    run(
        receive,
        "thread far():",
        f"  movel({written(moved(home, z=-0.3))}, a=1, v=0.2)",
        "end",
        "h = run far()",
        "sleep(0.5)",
        "kill h",
        "sleep(0.5)",
    )
    fallen = home[2] - receive.getActualTCPPose()[2]
    assert 0.05 < fallen < 0.15
    assert math.hypot(*receive.getActualTCPSpeed()[:3]) == 0.0


def test_a_secondary_program_runs_beside_the_other(receive, home):
    send("def program():\n  sleep(2)\nend\n")
    until(lambda: receive.getRuntimeState() == 2)
    send("sec lamp():\n  set_digital_out(3, True)\nend\n")
    until(lambda: receive.getActualDigitalOutputBits() >> 3 & 1)
    assert receive.getRuntimeState() == 2
    send("digital_out[3]=False\n")  # a line is a program, and takes the place of the one that runs
    until(lambda: not receive.getActualDigitalOutputBits() >> 3 & 1)
    until(lambda: receive.getRuntimeState() == 1)


@pytest.mark.parametrize(
    "lines",
    [
        "def program():\n  mvoe(1)\nend\n",
        "def program():\n  x = (1\nend\n",
        "def program():\n  x = [1][5]\nend\n",
        "def program():\n  movel(p[9, 9, 9, 0, 0, 0])\nend\n",
        "def program():\n  while True:\n  end\nend\n",
    ],
)
def test_a_wrong_program_ends_and_the_next_one_runs(receive, home, lines):
    send(lines)
    until(lambda: receive.getRuntimeState() == 1)
    run(receive, f"movel({written(moved(home, z=-0.01))})")
    assert receive.getActualTCPPose()[2] == pytest.approx(home[2] - 0.01, abs=1e-6)


def test_a_protective_stop_holds_a_program_until_it_is_played_on(cell, receive, home):
    send(f"def program():\n  movel({written(moved(home, z=-0.2))}, v=0.1)\nend\n")
    until(lambda: math.hypot(*receive.getActualTCPSpeed()[:3]) > 0.09)
    cell.inject(Fault.PROTECTIVE_STOP)
    until(lambda: math.hypot(*receive.getActualTCPSpeed()[:3]) == 0.0)
    cell.inject(Fault.CLEAR_PROTECTIVE_STOP)
    with socket.create_connection((HOST, 29999), 2.0) as connection, connection.makefile("rw") as lines:
        lines.readline()
        lines.write("play\n")
        lines.flush()
        assert lines.readline().strip() == "Starting program"
    until(lambda: receive.getRuntimeState() == 1)
    assert receive.getActualTCPPose()[2] == pytest.approx(home[2] - 0.2, abs=1e-6)


def test_two_threads_cannot_move_the_arm_at_once(cell, receive, home):
    said = len(cell.complaints())
    place = written(moved(home, z=-0.05))
    thread = f"thread t():\n while True:\n  movel({place}, v=0.01)\n end\nend\n"
    send(f"def program():\n{thread} run t()\n sync()\n movej({place})\nend\n")
    until(lambda: "another thread is already controlling the robot" in cell.complaints()[said:])
    until(lambda: receive.getRuntimeState() == 1)
    assert "line 9, column 2" in cell.complaints()[said:]
