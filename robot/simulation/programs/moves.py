"""The motion functions of URScript: what a program's `movel` does to the arm.

Each is a generator that lets a cycle pass with each `yield` and returns when the program goes on: a move with a blend
radius when the tool has come that near to its target, any other at its end. A thread that is killed on its way leaves
the motion behind; if nothing takes it over in the same cycle, the arm brakes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from planning.pose import pose_from_vector
from robot.simulation.machine import FAST_STOP
from robot.simulation.motions.frame import Numbers, frame_of, millimetres
from robot.simulation.motions.motion import TrackMotion
from robot.simulation.motions.posture import nearest_joints
from robot.simulation.motions.streaming import ServoMotion, SpeedMotion
from robot.simulation.motions.tool_motion import ToolMotion
from robot.simulation.motions.tool_pieces import Target
from robot.simulation.motions.track import joint_track
from robot.simulation.urscript import Refusal
from robot.simulation.urscript.values import Pose, Value, kind, number, numbers

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import numpy.typing as npt

    from robot.simulation.machine import Machine

    Array = npt.NDArray[np.float64]

Steered = TypeVar("Steered", ServoMotion, SpeedMotion)

RAMP = 0.25
"""Share of a move's time in which it speeds up, where the program gives the time."""

GAIN = 300.0
"""Gain of `servoj` at which the arm follows as quickly as its lookahead time says."""


class ScriptMoves:
    """Motions for one program.

    Args:
        machine: whose arm moves.
        wake: gives what lets the thread that now runs go on within a cycle, when the tool asks for the next target.
    """

    def __init__(self, machine: Machine, wake: Callable[[], Callable[[], None]]) -> None:
        self._machine = machine
        self._wake = wake
        self._left_behind = False

    def settle(self) -> None:
        """End a cycle: what was left behind and not taken over comes to rest."""
        if self._left_behind and self._machine.motion is not None:
            self._machine.motion.brake(tool=FAST_STOP)
        self._left_behind = False

    # -- moves

    def movej(self, q: Value, a: Value, v: Value, t: Value, r: Value) -> Iterator[None]:
        """A move of the joints; a blend radius is not rounded: the arm rests at the target."""
        machine = self._machine
        number(r, "r")
        acceleration, speed = positive(a, "a"), positive(v, "v")
        end = self.joints(q)
        if (np.abs(end) > machine.limit + 1e-9).any():
            joint = int((np.abs(end) - machine.limit).argmax()) + 1
            raise Refusal(f"joint {joint} is asked over its limit")
        yield from self._stand(joint=acceleration)
        start = np.array(machine.state.joints)
        seconds, span = number(t, "t"), float(np.abs(end - start).max())
        if seconds > 0.0 and span > 0.0:
            speed, acceleration = in_time(span, seconds)
        motion = TrackMotion(joint_track(machine.arm, machine.tool, start, end, speed, acceleration))
        machine.motion = motion
        yield from self._until(lambda: motion.finished)

    def movel(self, pose: Value, a: Value, v: Value, t: Value, r: Value) -> Iterator[None]:
        """A straight move of the tool."""
        frame = self.frame(pose)
        seconds = number(t, "t")
        acceleration, speed = 1000.0 * positive(a, "a"), 1000.0 * positive(v, "v")
        if seconds > 0.0:
            way = math.dist(frame[9:], self._machine.state.pose[:3])
            if way > 0.0:
                speed, acceleration = in_time(way, seconds)
        yield from self._tool(Target(frame, speed, acceleration, blend=1000.0 * radius(r)))

    def movep(self, pose: Value, a: Value, v: Value, r: Value) -> Iterator[None]:
        """A move of the tool at an even speed through its blends."""
        target = Target(
            self.frame(pose), 1000.0 * positive(v, "v"), 1000.0 * positive(a, "a"), blend=1000.0 * radius(r)
        )
        yield from self._tool(target)

    def movec(
        self, pose_via: Value, pose_to: Value, a: Value, v: Value, r: Value, mode: Value
    ) -> Iterator[None]:
        """A move of the tool along an arc through a place; mode 1 keeps the tool's orientation to the arc."""
        via = self.frame(pose_via)
        target = Target(
            self.frame(pose_to),
            1000.0 * positive(v, "v"),
            1000.0 * positive(a, "a"),
            blend=1000.0 * radius(r),
            via=via[9:],
            keeps=number(mode, "mode") == 1.0,
        )
        yield from self._tool(target)

    def _tool(self, target: Target) -> Iterator[None]:
        machine = self._machine
        motion = machine.motion
        if isinstance(motion, ToolMotion) and motion.asking:
            self._left_behind = False
            motion.add(target)
        else:
            yield from self._stand(tool=target.acceleration)
            motion = ToolMotion(
                machine.arm, machine.tool, machine.state, machine.limit.tolist(), self._wake()
            )
            motion.add(target)
            machine.motion = motion
        told = motion
        told.ask_with(self._wake())
        yield from self._until(lambda: told.finished or told.asking)

    # -- what steers

    def servoj(self, q: Value, t: Value, lookahead_time: Value, gain: Value) -> Iterator[None]:
        """Follow a target of the joints for a time."""
        machine = self._machine
        aim = np.array(numbers(q, 6, "q"))
        motion = self._steered(ServoMotion)
        if motion is None:
            motion = ServoMotion(machine.arm, machine.tool, machine.state)
            machine.motion = motion
        motion.aim(aim, positive(lookahead_time, "lookahead_time") * GAIN / positive(gain, "gain"))
        yield from self._for(number(t, "t"))

    def speedl(self, xd: Value, a: Value, t: Value) -> Iterator[None]:
        """Bring the tool to a speed: for a time, or until it is reached."""
        motion = self._speeding(of_tool=True)
        target = np.array(millimetres(tuple(numbers(xd, 6, "xd"))))
        motion.aim(target, 1000.0 * positive(a, "a"))
        yield from self._at_speed(motion, number(t, "t"))

    def speedj(self, qd: Value, a: Value, t: Value) -> Iterator[None]:
        """Bring the joints to speeds: for a time, or until they are reached."""
        motion = self._speeding(of_tool=False)
        motion.aim(np.array(numbers(qd, 6, "qd")), positive(a, "a"))
        yield from self._at_speed(motion, number(t, "t"))

    def _speeding(self, *, of_tool: bool) -> SpeedMotion:
        machine = self._machine
        motion = self._steered(SpeedMotion)
        if motion is None or motion.of_tool != of_tool:
            motion = SpeedMotion(machine.arm, machine.tool, machine.state, machine.limit, of_tool=of_tool)
            machine.motion = motion
        return motion

    def _at_speed(self, motion: SpeedMotion, seconds: float) -> Iterator[None]:
        if seconds > 0.0:
            yield from self._for(seconds)
        else:
            yield from self._until(lambda: motion.reached)

    def _steered(self, what: type[Steered]) -> Steered | None:
        self._left_behind = False
        return self._machine.motion if isinstance(self._machine.motion, what) else None

    # -- stops

    def stopl(self, a: Value) -> Iterator[None]:
        """Bring the tool to rest."""
        yield from self._stand(tool=1000.0 * positive(a, "a"))

    def stopj(self, a: Value) -> Iterator[None]:
        """Bring the joints to rest."""
        yield from self._stand(joint=positive(a, "a"))

    def _stand(self, tool: float = math.inf, joint: float = math.inf) -> Iterator[None]:
        """Bring whatever moves the arm to rest."""
        motion = self._machine.motion
        self._left_behind = False
        if motion is not None and not motion.finished:
            motion.brake(tool=tool, joint=joint)
            yield from self._until(lambda: motion.resting or motion.finished)
        self._machine.motion = None

    # -- time

    def _until(self, over: Callable[[], bool]) -> Iterator[None]:
        try:
            yield  # a move takes a cycle at least
            while not over():
                yield
        except GeneratorExit:
            self._left_behind = True
            raise

    def _for(self, seconds: float) -> Iterator[None]:
        until = self._machine.time + seconds
        try:
            yield
            while self._machine.time < until - 1e-9:
                yield
        except GeneratorExit:
            self._left_behind = True
            raise

    # -- places

    def frame(self, value: Value) -> Numbers:
        """The tool's frame, mm, that a pose in m or joint angles ask for."""
        if type(value) is Pose:
            return frame_of(pose_from_vector(np.array([millimetres(tuple(value))]))[0])
        if type(value) is not list:
            raise Refusal(f"a pose p[...] or six joint angles are needed, not {kind(value)}")
        joints = np.array([numbers(value, 6, "joint angles")])
        return frame_of((self._machine.arm.forward(joints) @ self._machine.tool)[0])

    def joints(self, value: Value) -> Array:
        """Joint angles, shape (6,), rad, that a pose or joint angles ask for: the posture nearest to the arm's own."""
        if type(value) is not Pose:
            return np.array(numbers(value, 6, "joint angles"))
        found = self.nearest(value, self._machine.state.joints, self._machine.tool)
        if found is None:
            raise Refusal(f"no inverse kinematics at {value}")
        return np.array(found)

    def nearest(self, pose: Pose, near: Numbers, tool: Array) -> Numbers | None:
        """Joint angles at a pose in m, nearest to others; None where there are none."""
        machine = self._machine
        wanted = pose_from_vector(np.array([millimetres(tuple(pose))]))[0] @ np.linalg.inv(tool)
        return nearest_joints(machine.arm, frame_of(wanted), near, machine.limit.tolist())


def positive(value: Value, what: str) -> float:
    """A number above 0.

    Raises:
        Refusal: it is none.
    """
    found = number(value, what)
    if not 0.0 < found < math.inf:
        raise Refusal(f"{what} must be above 0, not {found:g}")
    return found


def radius(value: Value) -> float:
    """A blend radius, m."""
    found = number(value, "r")
    if not 0.0 <= found < math.inf:
        raise Refusal(f"r must be 0 or above, not {found:g}")
    return found


def in_time(way: float, seconds: float) -> tuple[float, float]:
    """Speed and acceleration that run a way in a time."""
    speed = way / (seconds * (1.0 - RAMP))
    return speed, speed / (seconds * RAMP)
