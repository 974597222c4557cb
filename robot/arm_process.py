"""The arm process: the only place that drives the robot through ur-rtde, and the only one that knows metres.

ur-rtde can freeze or crash the process it lives in, so it lives in one of its own: `python -m robot.arm_process`,
started by `robot.arm`. One socket leads to the supervisor. Messages are JSON; an empty object is a heartbeat.

    from the supervisor   {"do": "approach"}            to the program's first waypoint
                          {"do": "run", "chunk": k}     execute a chunk
                          {"do": "stop"}                brake, end the script, exit
                          {"do": "quit"}                end the script, exit
    to the supervisor     {"state": ready | loading | running | done | failed, "chunk": k, "progress": i,
                           "window": s, "message": ...}

Every call is an asynchronous one: a blocking move can be neither stopped nor watched. While the supervisor's beat
is fresh the controller's watchdog is kicked; when it is not, the arm brakes, and should this process die or freeze,
the controller stops for want of a kick.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import select
import socket
import sys
import time
from pathlib import Path
from typing import Any

import rtde_control

from planning import Program
from planning.pose import vector_from_pose

from .chunks import Chunk, split

POLL = 0.004
"""Time between two looks at the socket and the robot, s."""

STATE_PERIOD = 0.008
"""Longest time between two messages to the supervisor, s."""

KICK_PERIOD = 0.02
WATCHDOG_HZ = 10.0
"""The controller stops when it is not kicked this often."""

BEAT_LIMIT = 0.2
"""Age of the supervisor's last message at which the arm brakes, s."""

WINDOW = 5.0
"""Longest time in which a script is uploaded and started, s; the supervisor expects no beat meanwhile."""

GUARDING = 0.5
"""Longest time in which the watchdog of a script that already moves the arm is set, s; likewise."""

START_LIMIT = 0.5
"""Time after which a move that was never seen running counts as finished, s."""

JOINT_SPEED, JOINT_ACCELERATION = 0.5, 0.8
"""Of the move to the program's first waypoint, rad/s and rad/s²."""

BRAKING = 2.0
"""Deceleration of a stop, m/s²."""

PRIORITY = -10
"""Of this process among those of the machine, as `nice` counts."""

MM = 1e-3
"""Metres in a millimetre."""


class ArmProcess:
    """Executes chunks for a supervisor.

    Args:
        link: socket to the supervisor.
        host: the controller.
        program: what to execute.
        acceleration: of the TCP, mm/s².
    """

    def __init__(self, link: socket.socket, host: str, program: Program, acceleration: float) -> None:
        self._link = link
        self._program = program
        self._chunks = split(program)
        self._acceleration = acceleration * MM
        self._state: dict[str, Any] = {"state": "ready", "chunk": -1, "progress": 0}
        self._sent = 0.0
        self._kicked = 0.0
        self._heard = time.monotonic()
        self._started = 0.0
        self._seen_running = False
        self._control = rtde_control.RTDEControlInterface(host)
        tool = vector_from_pose(program.tool[None])[0]
        self._require(self._control.setTcp([*(tool[:3] * MM), *tool[3:]]), "the controller refused the tool")
        self._require(self._control.setWatchdog(WATCHDOG_HZ), "the controller refused the watchdog")

    def serve(self) -> None:
        """Obey until told to end. Without a supervisor, silent or gone, the arm brakes.

        Raises:
            ConnectionError: there is no supervisor any more.
            RuntimeError: the controller refused something, or its program has ended.
        """
        self._heard = time.monotonic()
        try:
            while self._turn():
                pass
        except OSError as error:
            self._brake()
            raise ConnectionError(f"the supervisor is gone ({error}); the arm was stopped") from error
        except BaseException:
            with contextlib.suppress(Exception):  # the first fault is the one to tell
                self._brake()
            raise

    def _turn(self) -> bool:
        """Look once at the clocks, the robot and the socket; whether to go on."""
        now = time.monotonic()
        if now - self._heard > BEAT_LIMIT:
            raise TimeoutError(f"silent for {BEAT_LIMIT} s")
        if now - self._kicked > KICK_PERIOD:
            self._control.kickWatchdog()
            self._kicked = now
        if self._state["state"] == "running":
            self._look()
        if now - self._sent > STATE_PERIOD:
            self._tell()
        return not select.select([self._link], [], [], POLL)[0] or self._obey()

    def _obey(self) -> bool:
        """Handle one message; whether to go on."""
        message = self._link.recv(4096)
        if not message:
            raise ConnectionError("it closed the connection")
        self._heard = time.monotonic()
        order = json.loads(message)
        what = order.get("do")
        if what == "stop":
            self._brake()
        if what in ("stop", "quit"):
            self._control.stopScript()
            return False
        if what == "approach":
            self._approach()
        elif what == "run":
            self._run(self._chunks[order["chunk"]])
        return True

    def _approach(self) -> None:
        self._tell(state="loading", chunk=-1, progress=0, window=WINDOW)
        joints = [float(q) for q in self._program.joints[0]]
        self._begin(
            self._control.moveJ(joints, JOINT_SPEED, JOINT_ACCELERATION, True), "to its first waypoint"
        )

    def _run(self, chunk: Chunk) -> None:
        self._tell(state="loading", chunk=chunk.index, progress=0, window=WINDOW)
        self._begin(self._control.movePath(self._path(chunk), True), f"along chunk {chunk.index}")
        # The upload replaced the script, and with it the watchdog; setting it is an exchange with the controller.
        self._tell(window=GUARDING)
        self._require(self._control.setWatchdog(WATCHDOG_HZ), "the controller refused the watchdog")
        self._tell(window=0.0)

    def _begin(self, accepted: bool, where: str) -> None:
        self._require(accepted, f"the controller refused to move {where}; look at its log")
        self._started = self._heard = time.monotonic()
        self._seen_running = False
        self._tell(state="running", window=0.0)

    def _path(self, chunk: Chunk) -> rtde_control.Path:
        kind, position = rtde_control.PathEntry.eMoveType, rtde_control.PathEntry.PositionTcpPose
        poses = vector_from_pose(self._program.poses[chunk.target])
        poses[:, :3] *= MM
        # The program's speed changes evenly along a move, a controller's move has one speed: the mean takes as long.
        speeds = 0.5 * (self._program.speed[chunk.target - 1] + self._program.speed[chunk.target]) * MM
        blends = chunk.blend * MM
        path = rtde_control.Path()
        for pose, speed, blend, printing in zip(poses, speeds, blends, chunk.printing, strict=True):
            parameters = [*map(float, pose), float(speed), self._acceleration, float(blend)]
            path.addEntry(
                rtde_control.PathEntry(kind.MoveP if printing else kind.MoveL, position, parameters)
            )
        return path

    def _look(self) -> None:
        """See how far the robot has come."""
        if not self._control.isProgramRunning():
            self._require(False, "the program on the controller has stopped")
        status = self._control.getAsyncOperationProgressEx()
        if status.isAsyncOperationRunning():
            self._seen_running = True
            if status.progress() != self._state["progress"]:
                self._tell(progress=status.progress())
        elif self._seen_running or time.monotonic() - self._started > START_LIMIT:
            self._tell(state="done")

    def _brake(self) -> None:
        self._control.stopL(BRAKING, True)
        until = time.monotonic() + 1.0
        while (
            time.monotonic() < until and self._control.getAsyncOperationProgressEx().isAsyncOperationRunning()
        ):
            self._control.kickWatchdog()
            time.sleep(POLL)
        self._control.stopScript()

    def _require(self, accepted: bool, otherwise: str) -> None:
        if not accepted:
            self._tell(state="failed", message=otherwise)
            raise RuntimeError(otherwise)

    def _tell(self, **changes: Any) -> None:
        self._state.update(changes)
        self._link.send(json.dumps(self._state).encode())
        self._sent = time.monotonic()


def main(arguments: list[str]) -> int:
    """Run as a process: socket's file descriptor, host, program file, acceleration in mm/s²."""
    descriptor, host, file, acceleration = arguments
    try:
        gc.collect()
        gc.freeze()  # a full collection over all imports would hold up the watchdog's kicks
        with contextlib.suppress(OSError):  # and so would a busy machine; not everybody may ask for this
            os.setpriority(os.PRIO_PROCESS, 0, PRIORITY)
        link = socket.socket(fileno=int(descriptor))
        ArmProcess(link, host, Program.load(Path(file)), float(acceleration)).serve()
    except Exception as error:
        sys.stderr.write(f"{error}\n")
        sys.stderr.flush()
        return 1
    return 0


if __name__ == "__main__":
    # The interface's destructor sleeps and can wait for a controller that is gone; the script has ended by now.
    os._exit(main(sys.argv[1:]))
