"""A client of ur-rtde that streams `servoL` at 500 Hz: the arm follows as its lookahead implies.

The targets are read back from the controller's own registers, beside the arm's place and at the same process time, so
that a busy machine that holds the client up shows in both.
"""

from __future__ import annotations

import math
import socket
import threading
import time

import numpy as np
import pytest
from rtde_control import RTDEControlInterface

from robot import rtde
from robot.simulation import SimulatedCell

HOST = "127.0.36.5"
RADIUS, SPEED = 50.0, 100.0
LOOKAHEAD = 0.1
NAMES = [
    "timestamp",
    *(f"input_double_register_{i}" for i in range(3)),
    "actual_TCP_pose",
    "actual_TCP_speed",
]


@pytest.fixture(scope="module")
def streamed():
    """Times, targets, places and speeds of the tool, a row a cycle, in mm and s."""
    with SimulatedCell.start("ur10e-demo", host=HOST):
        control = RTDEControlInterface(HOST)
        rows: list[tuple[float, ...]] = []
        over = threading.Event()
        listener = threading.Thread(target=listen, args=(rows, over), daemon=True)
        try:
            start = np.array(control.getTargetWaypoint())
            listener.start()
            stream(control, start)
            over.set()
            listener.join(2.0)
            assert control.servoStop()
            control.stopScript()
        finally:
            over.set()
            control.disconnect()
    return np.array(rows), start[:3] * 1000.0


def stream(control, start) -> None:
    """A circle at an even speed, by the client's clock."""
    begun = time.monotonic()
    rate = SPEED / RADIUS
    while (now := time.monotonic() - begun) < 3.0:
        period = control.initPeriod()
        angle = rate * now
        offset = RADIUS / 1000.0 * np.array([math.sin(angle), 1.0 - math.cos(angle), 0.0, 0.0, 0.0, 0.0])
        assert control.servoL((start + offset).tolist(), 0.5, 0.5, 0.002, LOOKAHEAD, 300.0)
        control.waitPeriod(period)


def listen(rows: list[tuple[float, ...]], over: threading.Event) -> None:
    """Collect what the controller tells, in mm, until it is over."""
    with socket.create_connection((HOST, rtde.PORT), 2.0) as connection:
        packages = rtde.PackageStream()

        def received():
            while True:
                yield from packages.feed(connection.recv(65536))

        answers = received()
        connection.sendall(rtde.ask_protocol())
        next(answers)
        connection.sendall(rtde.ask_outputs(NAMES, 500.0))
        _, types = rtde.read_types(next(answers)[1])
        recipe = rtde.Recipe(NAMES, types)
        connection.sendall(rtde.ask_start())
        for kind, payload in answers:
            if over.is_set():
                return
            if kind == rtde.Package.VALUES:
                found = recipe.unpack(payload[1:])
                target = [1000.0 * found[name] for name in NAMES[1:4]]
                place, speed = ([1000.0 * x for x in found[name][:3]] for name in NAMES[4:])
                rows.append((found["timestamp"], *target, *place, math.hypot(*speed)))


def test_the_tool_lags_behind_its_target_by_the_lookahead(streamed) -> None:
    rows, start = streamed
    middle = start + [0.0, RADIUS, 0.0]
    settled = rows[:, 0] > rows[0, 0] + 1.0
    assert settled.sum() > 500
    rate = SPEED / RADIUS
    target, place = rows[settled, 1:4] - middle, rows[settled, 4:7] - middle
    behind = np.unwrap(np.arctan2(target[:, 0], -target[:, 1]) - np.arctan2(place[:, 0], -place[:, 1]))
    assert np.median(behind) / rate == pytest.approx(LOOKAHEAD, rel=0.05)
    size = np.linalg.norm(place, axis=1) / RADIUS
    assert np.median(size) == pytest.approx(1.0 / (1.0 + (0.5 * LOOKAHEAD * rate) ** 2), rel=0.005)
    assert np.median(rows[settled, 7]) == pytest.approx(SPEED * np.median(size), rel=0.02)
