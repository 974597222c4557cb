"""Stands in for the control script that ur-rtde uploads.

This is no interpreter of URScript: what the script would do with its commands is written out here in Python, command
by command, as the numbers and registers of ur-rtde 1.6 define them. Commands that need a force sensor or a hand at
the arm end the program with a message.
"""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from planning import ReachError
from planning.pose import pose_from_vector, vector_from_pose
from robot.simulation.machine import SafetyMode
from robot.simulation.motions.frame import frame_of, metres, millimetres
from robot.simulation.motions.motion import TrackMotion
from robot.simulation.motions.path import Target
from robot.simulation.motions.posture import nearest_joints
from robot.simulation.motions.streaming import ServoMotion, SpeedMotion
from robot.simulation.motions.track import Track, joint_track, tool_track

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from concurrent.futures import Executor

    import numpy.typing as npt

    from robot.simulation.machine import Machine

    from .upload import PathEntry, Upload

    Array = npt.NDArray[np.float64]

T = TypeVar("T", ServoMotion, SpeedMotion)

READY, DONE = 1, 2
MOVE_J, MOVE_J_IK, MOVE_L, MOVE_L_FK, MOVE_PATH = 1, 2, 3, 4, 45
STOP_L, STOP_J, SPEED_STOP, SERVO_STOP, JOG_STOP, END = 33, 34, 15, 16, 42, 255
SPEED_J, SPEED_L, SERVO_J, SERVO_L, JOG = 9, 10, 11, 24, 41
REALTIME = {6, SPEED_J, SPEED_L, SERVO_J, SERVO_L, 25, 26, 27, 38, 58, 66, 67, 68, 69, 70, 71}
WITHOUT_EFFECT = {7, 17, 31, 53, 59, 65, 99}  # nothing to do in free space, or done by `_settings`


class ControlScript:
    """The running script; `run` is stepped once a cycle."""

    def __init__(self, machine: Machine, upload: Upload, workers: Executor) -> None:
        self.machine = machine
        self.upload = upload
        self._workers = workers
        self._int, self._float = upload.int_offset, upload.float_offset
        self._background: Iterator[None] | None = None
        self._changes = self._operation = 0
        self._last_steered: tuple[float, ...] = ()

    def run(self) -> Iterator[None]:
        """The script's main loop.

        Raises:
            ReachError, ValueError: what ends a script on a real controller too.
        """
        outputs = self.machine.output_ints
        self._report_end()
        outputs[self._int] = READY
        executed = False
        while True:
            command = self.machine.input_ints[self._int]
            if command in REALTIME:
                self._realtime(command)
                outputs[self._int] = READY
            elif command == 0:
                executed = False
                outputs[self._int] = READY
            elif command == END:
                return
            elif not executed:
                yield from self._execute(command)
                outputs[self._int] = DONE
                executed = True
            if self._background is not None:
                try:
                    next(self._background)
                except StopIteration:
                    self._background = None
                    self._report_end()
            yield

    # -- registers

    def _in(self, first: int, count: int = 6) -> tuple[float, ...]:
        start = self._float + first
        return tuple(self.machine.input_doubles[start : start + count])

    def _flag(self) -> int:
        return self.machine.input_ints[self._int + 1]

    def _answer(self, values: tuple[float, ...]) -> None:
        self.machine.output_doubles[self._float : self._float + len(values)] = values

    def _answer_int(self, value: int) -> None:
        self.machine.output_ints[self._int + 1] = value

    def _report(self, progress: int) -> None:
        """Progress of the asynchronous operation: bits 0-14, and that one is running: bit 15."""
        self._changes = (self._changes + 1) % 128
        if progress == 0:
            self._operation = (self._operation + 1) % 128
        word = self._changes << 16 | self._operation << 24 | 1 << 15 | min(progress, 0x7FFF)
        self.machine.output_ints[self._int + 2] = word

    def _report_end(self) -> None:
        self._changes = (self._changes + 1) % 128
        self.machine.output_ints[self._int + 2] = self._changes << 16 | self._operation << 24

    # -- commands

    def _execute(self, command: int) -> Iterator[None]:
        if command in {MOVE_J, MOVE_J_IK, MOVE_L, MOVE_L_FK, MOVE_PATH}:
            moves = self._path_moves() if command == MOVE_PATH else self._single_move(command)
            asynchronous = self._flag() == 1
            self._background = None
            if asynchronous:
                self._report(0)
                self._background = moves
            else:
                yield from moves
        elif command in {STOP_L, STOP_J, SPEED_STOP, SERVO_STOP, JOG_STOP}:
            (deceleration,) = self._in(0, 1) if command != JOG_STOP else (1.2,)
            was_running, self._background = self._background is not None, None
            if command in {STOP_L, JOG_STOP}:
                stop = self._come_to_rest(tool=deceleration * 1000.0)
            else:
                stop = self._come_to_rest(joint=deceleration, tool=self._straight_stop(command, deceleration))
            if command in {STOP_L, STOP_J} and self._flag() == 1:
                if not was_running:
                    self._report(0)
                self._background = stop
            else:
                yield from stop
                if was_running:
                    self._report_end()
        elif command == JOG:
            if int(self._in(6, 1)[0]) != 0:
                raise ValueError("jogging along anything but the base's axes is not simulated")
            self._steer_speed(of_tool=True, target=self._in(0), acceleration=self._in(7, 1)[0])
        elif command not in WITHOUT_EFFECT and not self._query(command):
            raise ValueError(f"command {command} of ur-rtde is not simulated")
        else:
            self._settings(command)

    def _straight_stop(self, command: int, deceleration: float) -> float:
        """`speedStop` gives m/s² where the tool is steered along a line; elsewhere the joints' rad/s² count."""
        steered = isinstance(self.machine.motion, SpeedMotion) and self.machine.motion.of_tool
        return deceleration * 1000.0 if command == SPEED_STOP and steered else np.inf

    def _query(self, command: int) -> bool:
        """Answer a question; whether the command is one."""
        machine = self.machine
        here = np.array(machine.state.joints)
        if command in {30, 46}:  # inverse kinematics
            near = np.array(self._in(6)) if command == 30 else here
            self._answer(tuple(self._joints_at(self._in(0), near).tolist()))
        elif command in {60, 61, 36}:  # is there one
            near = np.array(self._in(6)) if command == 61 else here
            self._answer_int(self._nearest(self._in(0), near) is not None)
        elif command == 37:
            self._answer_int(bool((np.abs(self._in(0)) <= machine.limit).all()))
        elif command in {43, 44}:  # forward kinematics
            joints = np.array([self._in(0)]) if command == 44 else here[None]
            tool = (
                pose_from_vector(np.array([millimetres(self._in(6))]))[0] if command == 44 else machine.tool
            )
            self._answer(metres(tuple(vector_from_pose(machine.arm.forward(joints) @ tool)[0].tolist())))
        elif command == 39:  # one pose after another
            a, b = pose_from_vector(np.array([self._in(0), self._in(6)]))
            self._answer(tuple(vector_from_pose((a @ b)[None])[0].tolist()))
        elif command == 28:
            self._answer(metres(machine.state.pose))
        elif command == 40:
            self._answer(metres(machine.tool_offset))
        elif command == 47:
            self._answer_int(machine.motion is None or machine.motion.resting)
        elif command == 54:
            self._answer_int(0)  # the tool touches nothing
        else:
            return command in {29, 35}
        return True

    def _settings(self, command: int) -> None:
        machine = self.machine
        if command in {17, 65}:
            (machine.payload,) = self._in(0, 1)
            cog = self._in(1, 3)
            if any(cog):
                machine.payload_cog = cog
        elif command == 29:
            machine.set_tool(millimetres(self._in(0)))
        elif command == 31:
            machine.protective_stop(SafetyMode.PROTECTIVE_STOP)
        elif command == 35:
            (frequency,) = self._in(0, 1)
            machine.watch(self._int, 1.0 / frequency if frequency > 0.0 else 0.0)

    def _realtime(self, command: int) -> None:
        if command in {SERVO_J, SERVO_L}:
            arguments = (command, *self._in(0, 11))
            if arguments != self._last_steered or not isinstance(self.machine.motion, ServoMotion):
                self._last_steered = arguments
                self._steer_servo(command)
        elif command in {SPEED_J, SPEED_L}:
            self._steer_speed(of_tool=command == SPEED_L, target=self._in(0), acceleration=self._in(6, 1)[0])
        elif command == 26:
            self._answer((0.002,))
        elif command == 27:
            self._answer(self.machine.state.joints)
        elif command == 38:
            self._answer((0.0,) * 6)
        elif command == 58:
            flange = self.machine.arm.forward(np.array([self.machine.state.joints]))
            self._answer(metres(tuple(vector_from_pose(flange)[0].tolist())))
        else:
            raise ValueError(f"command {command} of ur-rtde is not simulated")

    # -- moves

    def _single_move(self, command: int) -> Iterator[None]:
        numbers, (speed, acceleration) = self._in(0), self._in(6, 2)
        if command == MOVE_J:
            yield from self._to_joints(np.array(numbers), speed, acceleration)
        elif command == MOVE_J_IK:
            end = self._joints_at(numbers, np.array(self.machine.state.joints))
            yield from self._to_joints(end, speed, acceleration)
        else:
            pose = self._pose(numbers, is_pose=command == MOVE_L)
            yield from self._through(
                [Target(pose, _positive(speed) * 1000.0, _positive(acceleration) * 1000.0)]
            )

    def _path_moves(self) -> Iterator[None]:
        for of_joints, entries in groupby(self.upload.path, key=lambda entry: entry.kind == "movej"):
            if not of_joints:
                yield from self._through([self._target(entry) for entry in entries])
                continue
            for entry in entries:  # joint moves stop at each target, blended or not
                end = np.array(entry.numbers)
                if entry.is_pose:
                    end = self._joints_at(entry.numbers, np.array(self.machine.state.joints))
                yield from self._to_joints(end, entry.speed, entry.acceleration, entry.mark)

    def _target(self, entry: PathEntry) -> Target:
        return Target(
            pose=self._pose(entry.numbers, is_pose=entry.is_pose),
            speed=_positive(entry.speed) * 1000.0,
            acceleration=_positive(entry.acceleration) * 1000.0,
            blend=entry.blend * 1000.0,
            flowing=entry.kind == "movep",
            mark=entry.mark,
        )

    def _to_joints(self, end: Array, speed: float, acceleration: float, mark: int = -1) -> Iterator[None]:
        machine = self.machine
        if (np.abs(end) > machine.limit + 1e-9).any():
            raise ReachError(
                f"joint {int((np.abs(end) - machine.limit).argmax()) + 1} is asked over its limit"
            )
        yield from self._come_to_rest(joint=_positive(acceleration))
        start = np.array(machine.state.joints)
        yield from self._follow(
            lambda: joint_track(machine.arm, machine.tool, start, end, _positive(speed), acceleration, mark)
        )

    def _through(self, targets: list[Target]) -> Iterator[None]:
        machine = self.machine
        yield from self._come_to_rest(tool=targets[0].acceleration)
        start = np.array(machine.state.joints)
        yield from self._follow(lambda: tool_track(machine.arm, machine.tool, start, targets, machine.limit))

    def _follow(self, plan: Callable[[], Track]) -> Iterator[None]:
        planned = self._workers.submit(plan)  # a long path takes longer than a cycle may
        while not planned.done():
            yield
        motion = TrackMotion(planned.result())
        self.machine.motion = motion
        mark = 0
        while not motion.finished:
            if motion.mark > mark:
                mark = motion.mark
                self._report(mark)
            yield

    def _come_to_rest(self, tool: float = np.inf, joint: float = np.inf) -> Iterator[None]:
        motion = self.machine.motion
        if motion is not None and not motion.finished:
            motion.brake(tool=tool, joint=joint)
            while not (motion.resting or motion.finished):
                yield
        self.machine.motion = None
        self._last_steered = ()

    def _steer_servo(self, command: int) -> None:
        machine = self.machine
        numbers, (lookahead, gain) = self._in(0), self._in(9, 2)
        motion = self._steered(ServoMotion)
        if motion is None:
            motion = ServoMotion(machine.arm, machine.tool, machine.state)
            machine.motion = motion
        aim = self._joints_at(numbers, motion.target) if command == SERVO_L else np.array(numbers)
        motion.aim(aim, lookahead * 300.0 / _positive(gain))  # a model: as quick as its lookahead at gain 300

    def _steer_speed(self, *, of_tool: bool, target: tuple[float, ...], acceleration: float) -> None:
        machine = self.machine
        motion = self._steered(SpeedMotion)
        if motion is None or motion.of_tool != of_tool:
            motion = SpeedMotion(machine.arm, machine.tool, machine.state, machine.limit, of_tool=of_tool)
            machine.motion = motion
        if of_tool:
            motion.aim(np.array(millimetres(target)), acceleration * 1000.0)
        else:
            motion.aim(np.array(target), acceleration)

    def _steered(self, kind: type[T]) -> T | None:
        self._background = None
        return self.machine.motion if isinstance(self.machine.motion, kind) else None

    def _pose(self, numbers: tuple[float, ...], *, is_pose: bool) -> Array:
        if is_pose:
            pose = pose_from_vector(np.array([millimetres(numbers)]))
        else:
            pose = self.machine.arm.forward(np.array([numbers])) @ self.machine.tool
        return pose.reshape(4, 4)

    def _joints_at(self, numbers: tuple[float, ...], near: Array) -> Array:
        found = self._nearest(numbers, near)
        if found is None:
            raise ReachError(f"no inverse kinematics at {np.round(numbers, 4).tolist()}")
        return np.array(found)

    def _nearest(self, numbers: tuple[float, ...], near: Array) -> tuple[float, ...] | None:
        machine = self.machine
        flange = frame_of(self._pose(numbers, is_pose=True) @ np.linalg.inv(machine.tool))
        return nearest_joints(machine.arm, flange, near.tolist(), machine.limit.tolist())


def _positive(number: float) -> float:
    if not number > 0.0:
        raise ValueError(f"a speed, acceleration or gain must be above 0, not {number:g}")
    return number
