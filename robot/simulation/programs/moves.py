"""The motion functions of URScript: what a program's `movel` does to the arm.

Each is a generator that lets a cycle pass with each `yield` and returns when the program goes on: a move with a blend
radius when the tool has come that near to its target, any other at its end. A thread that is killed on its way leaves
the motion behind; if nothing takes it over in the same cycle, the arm brakes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from robot.simulation.machine import FAST_STOP
from robot.simulation.motions.arm_frame import flange_frame
from robot.simulation.motions.frame import (
    Numbers,
    compose,
    frame_at,
    inverse,
    metres,
    millimetres,
    pose_numbers,
)
from robot.simulation.motions.joint_motion import JointMotion, JointTarget
from robot.simulation.motions.posture import nearest_joints
from robot.simulation.motions.pursuit import Pursuit
from robot.simulation.motions.streaming import ServoMotion, SpeedMotion
from robot.simulation.motions.told_motion import ToldMotion
from robot.simulation.motions.tool_motion import ToolMotion
from robot.simulation.motions.tool_pieces import Target
from robot.simulation.urscript import Refusal
from robot.simulation.urscript.values import Pose, Value, finite, kind, numbers, written

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy.typing as npt

    from robot.simulation.machine import Machine
    from robot.simulation.motions.motion import Motion

    Array = npt.NDArray[np.float64]

Led = TypeVar("Led", bound=ToolMotion)

HALF_A_CYCLE = 0.001
"""By which a time is over too early, s: cycles do not come quite evenly, and one that is asked for is to be one."""

GAIN = 300.0
"""Gain of `servoj` at which the arm lags by its lookahead time; by less at a higher gain."""


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
        """A move of the joints."""
        machine = self._machine
        acceleration, speed, blend = positive(a, "a"), positive(v, "v"), 1000.0 * radius(r)
        seconds = duration(t)
        motion = machine.motion
        goes_on = isinstance(motion, JointMotion) and motion.passing
        if not goes_on:
            yield from self._stand(joint=acceleration)
            motion = JointMotion(
                machine.arm, machine.tool, machine.state, machine.fastest.tolist(), self._wake()
            )
        assert isinstance(motion, JointMotion)
        end = self.joints(q, near=motion.last)
        if (np.abs(end) > machine.limit + 1e-9).any():
            joint = int((np.abs(end) - machine.limit).argmax()) + 1
            raise Refusal(f"joint {joint} is asked over its limit")
        motion.add(JointTarget(tuple(end.tolist()), speed, acceleration, blend, seconds))
        yield from self._lead(motion)

    def movel(self, pose: Value, a: Value, v: Value, t: Value, r: Value) -> Iterator[None]:
        """A straight move of the tool."""
        yield from self._tool(
            Target(
                self.frame(pose),
                1000.0 * positive(v, "v"),
                1000.0 * positive(a, "a"),
                blend=1000.0 * radius(r),
                seconds=duration(t),
            )
        )

    def movep(self, pose: Value, a: Value, v: Value, r: Value) -> Iterator[None]:
        """A move of the tool at an even speed, through its blends too."""
        acceleration = 1000.0 * positive(a, "a")
        yield from self._tool(
            Target(
                self.frame(pose),
                1000.0 * positive(v, "v"),
                acceleration,
                blend=1000.0 * radius(r),
            )
        )

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
            keeps=finite(mode, "mode") == 1.0,
        )
        yield from self._tool(target)

    def _tool(self, target: Target) -> Iterator[None]:
        machine = self._machine
        flange = compose(target.frame, inverse(machine.tool_frame))
        if nearest_joints(machine.arm, flange, machine.state.joints, machine.limits) is None:
            raise Refusal(f"no inverse kinematics at {written(Pose(metres(pose_numbers(target.frame))))}")
        motion = machine.motion
        if not (type(motion) is ToolMotion and motion.passing):
            yield from self._stand(tool=target.acceleration)
            motion = self._from_rest(ToolMotion, self._wake())
        motion.add(target)
        yield from self._lead(motion)

    def _from_rest(self, kind: type[Led], ask: Callable[[], None]) -> Led:
        """A motion that leads the tool from where it rests."""
        machine = self._machine
        return kind(machine.arm, machine.tool, machine.state, machine.limits, machine.fastest.tolist(), ask)

    def _lead(self, motion: ToldMotion) -> Iterator[None]:
        """Let a motion go on until it has come to its end or asks for the next target."""
        self._left_behind = False
        self._machine.motion = motion
        motion.ask_with(self._wake())
        yield from self._until(lambda: motion.finished or motion.asking)

    def waypoint(self) -> Pose:
        """Where the move leads that goes on, or where the tool is."""
        motion = self._machine.motion
        if isinstance(motion, ToldMotion) and not motion.finished:
            return Pose(metres(pose_numbers(motion.waypoint)))
        return Pose(metres(self._machine.state.pose))

    @property
    def running_out(self) -> bool:
        """Whether the arm still runs to the last target that it was told."""
        motion = self._machine.motion
        return isinstance(motion, ToldMotion) and not (motion.finished or motion.resting)

    # -- what steers

    def servoj(self, q: Value, t: Value, lookahead_time: Value, gain: Value) -> Iterator[None]:
        """Follow a target of the joints for a time."""
        machine = self._machine
        aim = numbers(q, 6, "q")
        lookahead = within(lookahead_time, "lookahead_time", 0.03, 0.2)
        lag = lookahead * GAIN / within(gain, "gain", 100.0, 2000.0)
        motion = machine.motion
        if not isinstance(motion, ServoMotion):
            yield from self._arrive()
            motion = ServoMotion(machine.arm, machine.tool, machine.state)
        self._take(motion)
        motion.aim(aim, lag)
        yield from self._for(finite(t, "t"))

    def servoc(self, pose: Value, a: Value, v: Value, r: Value) -> Iterator[None]:
        """Lead the tool to a target that may change in every cycle."""
        machine = self._machine
        target = Target(
            self.frame(pose), 1000.0 * positive(v, "v"), 1000.0 * positive(a, "a"), blend=1000.0 * radius(r)
        )
        yield from self._arrive()
        motion = machine.motion
        if not isinstance(motion, Pursuit):
            yield from self._stand(tool=target.acceleration)
            motion = self._from_rest(Pursuit, lambda: None)
        self._take(motion)
        motion.follow(target)
        yield from self._for(0.0)

    def speedl(self, xd: Value, a: Value, t: Value, aRot: Value) -> Iterator[None]:
        """Bring the tool to a speed: for a time, or until it is reached."""
        target = millimetres(tuple(numbers(xd, 6, "xd")))
        acceleration, turning, seconds = positive(a, "a"), finite(aRot, "aRot"), duration(t)
        yield from self._arrive()
        motion = self._speeding(of_tool=True)
        motion.aim(target, 1000.0 * acceleration, turning)
        yield from self._at_speed(motion, seconds)

    def speedj(self, qd: Value, a: Value, t: Value) -> Iterator[None]:
        """Bring the joints to speeds: for a time, or until they are reached."""
        target, acceleration, seconds = numbers(qd, 6, "qd"), positive(a, "a"), duration(t)
        yield from self._arrive()
        motion = self._speeding(of_tool=False)
        motion.aim(target, acceleration)
        yield from self._at_speed(motion, seconds)

    def _speeding(self, *, of_tool: bool) -> SpeedMotion:
        machine = self._machine
        motion = machine.motion
        if not isinstance(motion, SpeedMotion) or motion.of_tool != of_tool:
            motion = SpeedMotion(machine.arm, machine.tool, machine.state, machine.limit, of_tool=of_tool)
        self._take(motion)
        return motion

    def _at_speed(self, motion: SpeedMotion, seconds: float) -> Iterator[None]:
        if seconds > 0.0:
            yield from self._for(seconds)
        else:
            yield from self._until(lambda: motion.reached)

    def _take(self, motion: Motion) -> None:
        self._left_behind = False
        self._machine.motion = motion

    # -- stops

    def stopl(self, a: Value, aRot: Value) -> Iterator[None]:
        """Bring the tool to rest."""
        yield from self._halt(tool=1000.0 * positive(a, "a"), turning=finite(aRot, "aRot"))

    def stopj(self, a: Value) -> Iterator[None]:
        """Bring the joints to rest."""
        yield from self._halt(joint=positive(a, "a"))

    def _arrive(self) -> Iterator[None]:
        """Let the arm come to a target that it was on its way through, when what follows is no move like it."""
        motion = self._machine.motion
        if isinstance(motion, ToldMotion) and motion.passing:
            self._left_behind = False
            yield from self._until(lambda: motion.finished)

    def _stand(self, tool: float = math.inf, joint: float = math.inf) -> Iterator[None]:
        """Bring whatever moves the arm to rest, at its target if it is on its way through one."""
        yield from self._arrive()
        yield from self._halt(tool=tool, joint=joint)

    def _halt(self, tool: float = math.inf, joint: float = math.inf, turning: float = 0.0) -> Iterator[None]:
        """Bring whatever moves the arm to rest now."""
        motion = self._machine.motion
        self._left_behind = False
        if motion is not None and not motion.finished:
            if isinstance(motion, SpeedMotion) and motion.of_tool and turning > 0.0:
                motion.aim((0.0,) * 6, tool, turning)
            else:
                motion.brake(tool=tool, joint=joint)
            yield from self._until(lambda: motion.resting or motion.finished)
        self._machine.motion = None

    # -- time

    def _until(self, over: Callable[[], bool]) -> Iterator[None]:
        try:
            yield from self._pass()  # a move takes a cycle at least
            while not over():
                yield from self._pass()
        except GeneratorExit:
            self._left_behind = True
            raise

    def _for(self, seconds: float) -> Iterator[None]:
        until = self._machine.time + seconds
        try:
            yield from self._pass()
            while self._machine.time < until - HALF_A_CYCLE:
                yield from self._pass()
        except GeneratorExit:
            self._left_behind = True
            raise

    def _pass(self) -> Iterator[None]:
        """Let a cycle pass.

        Raises:
            PlanningError: the arm could not go on in it.
        """
        yield
        if self._machine.failure is not None:
            raise self._machine.failure

    # -- places

    def frame(self, value: Value) -> Numbers:
        """The tool's frame, mm, that a pose in m or joint angles ask for."""
        if type(value) is Pose:
            return frame_at(millimetres(tuple(numbers(value, 6, "the pose"))))
        if type(value) is not list:
            raise Refusal(f"a pose p[...] or six joint angles are needed, not {kind(value)}")
        machine = self._machine
        joints = numbers(value, 6, "joint angles")
        return compose(flange_frame(machine.arm, joints), machine.tool_frame)

    def joints(self, value: Value, near: Numbers) -> Array:
        """Joint angles, shape (6,), rad, that a pose or joint angles ask for: the posture nearest to others."""
        if type(value) is not Pose:
            return np.array(numbers(value, 6, "joint angles"))
        found = self.nearest(value, near, self._machine.tool_frame)
        if found is None:
            raise Refusal(f"no inverse kinematics at {written(value)}")
        return np.array(found)

    def nearest(self, pose: Sequence[float], near: Numbers, tool: Numbers) -> Numbers | None:
        """Joint angles that bring a tool, given by its frame, to a pose in m: those nearest to others, or None."""
        machine = self._machine
        flange = compose(frame_at(millimetres(pose)), inverse(tool))
        return nearest_joints(machine.arm, flange, near, machine.limits)


def positive(value: Value, what: str) -> float:
    """A number above 0.

    Raises:
        Refusal: it is none.
    """
    found = finite(value, what)
    if not 0.0 < found < math.inf:
        raise Refusal(f"{what} must be above 0, not {found:g}")
    return found


def radius(value: Value) -> float:
    """A blend radius, m."""
    found = finite(value, "r")
    if not 0.0 <= found < math.inf:
        raise Refusal(f"r must be 0 or above, not {found:g}")
    return found


def duration(value: Value) -> float:
    """A time, s; 0 for none.

    Raises:
        Refusal: it is none.
    """
    found = finite(value, "t")
    if not 0.0 <= found < math.inf:
        raise Refusal(f"t must be 0 or above, not {found:g}")
    return found


def within(value: Value, what: str, least: float, most: float) -> float:
    """A number between two others.

    Raises:
        Refusal: it is beyond them.
    """
    found = finite(value, what)
    if not least <= found <= most:
        raise Refusal(f"{what} must be {least:g} to {most:g}, not {found:g}")
    return found
