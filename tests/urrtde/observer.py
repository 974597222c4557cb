"""Sees every package that the controller sends, as no client that is asked for its newest state can."""

from __future__ import annotations

import socket
import threading
import time

from robot import rtde

NAMES = ("timestamp", "actual_q", "actual_TCP_pose", "actual_TCP_speed", "actual_qd")


class Observer:
    """A listener of its own, on a thread.

    Attributes:
        rows: of the packages since it was cleared: time, joints, tool pose, tool speed, joint speeds.
    """

    def __init__(self, host: str) -> None:
        self.rows: list[list[float]] = []
        self._connection = socket.create_connection((host, rtde.PORT), 2.0)
        self._stream = rtde.PackageStream()
        for request in (rtde.ask_protocol(), rtde.ask_outputs(NAMES, 500.0), rtde.ask_start()):
            self._connection.sendall(request)
        threading.Thread(target=self._listen, daemon=True).start()

    def seen(self, time_s: float) -> None:
        """Wait until it has seen what was sent up to a process time."""
        deadline = time.monotonic() + 2.0
        while not self.rows or self.rows[-1][0] < time_s:
            assert time.monotonic() < deadline, "the observer hears nothing"
            time.sleep(0.001)

    def _listen(self) -> None:
        recipe = None
        while received := self._connection.recv(65536):
            for kind, payload in self._stream.feed(received):
                if kind == rtde.Package.OUTPUTS:
                    recipe = rtde.Recipe(NAMES, rtde.read_types(payload)[1])
                elif kind == rtde.Package.VALUES and recipe is not None:
                    now, *vectors = recipe.unpack(payload[1:]).values()
                    self.rows.append([now, *(number for vector in vectors for number in vector)])
