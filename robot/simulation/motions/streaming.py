"""Motions that a client steers while they run: servoing towards targets, and following given speeds."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from planning import Arm, ReachError

from .arm_frame import flange_frame
from .frame import Numbers, compose, frame_of, inverse, pose_numbers, speed_between, turned
from .motion import STILL, ArmState
from .posture import nearest_joints

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

SHORTEST_LAG = 0.002
"""Of a servo, s: what a controller takes to act at all."""


class _Steered:
    """What steered motions share: they go on until braked, and keep the tool's frame."""

    finished = False
    throttle_rate = 5.0

    def __init__(self, arm: Arm, tool: Array, state: ArmState) -> None:
        self.arm = arm
        self.state = state
        self.resting = True
        self._tool = frame_of(tool)
        self._frame = self._tool_at(state.joints)

    def _tool_at(self, joints: Numbers) -> Numbers:
        return compose(flange_frame(self.arm, joints), self._tool)

    def _move_joints(self, joints: Numbers, joint_speeds: Numbers, seconds: float) -> None:
        before, self._frame = self._frame, self._tool_at(joints)
        self.state = ArmState(
            joints=joints,
            joint_speeds=joint_speeds,
            pose=pose_numbers(self._frame),
            tool_speed=speed_between(before, self._frame, seconds),
        )


class ServoMotion(_Steered):
    """Runs after a target of the joints, as `servoj` does.

    Each joint is drawn towards its target like a critically damped mass on a spring: its speed never jumps, it does
    not overshoot a target that stands, and it stays behind one that moves evenly by the lag, s. Between two targets
    this is solved in closed form.
    """

    def __init__(self, arm: Arm, tool: Array, state: ArmState) -> None:
        super().__init__(arm, tool, state)
        self.target: Numbers = state.joints
        self.lag = 0.1
        self._speeds: Numbers = state.joint_speeds  # by path time
        self._braking = 0.0

    def aim(self, joints: Sequence[float], lag: float) -> None:
        """Take a new target, rad, to be followed with a lag in s."""
        self.target, self.lag = tuple(joints), max(lag, SHORTEST_LAG)
        self._braking = 0.0

    def advance(self, seconds: float, path_seconds: float, share: float) -> None:
        """See `Motion`."""
        del share
        if seconds <= 0.0:
            return
        if self._braking:
            self._slow_down(seconds)
            return
        rate = 2.0 / self.lag
        kept = math.exp(-rate * path_seconds)
        joints, speeds = [], []
        for at, speed, target in zip(self.state.joints, self._speeds, self.target, strict=True):
            gap = at - target
            pull = speed + rate * gap
            joints.append(target + (gap + pull * path_seconds) * kept)
            speeds.append((speed - rate * pull * path_seconds) * kept)
        self._speeds = tuple(speeds)
        scale = path_seconds / seconds
        self._move_joints(tuple(joints), tuple([speed * scale for speed in speeds]), seconds)
        self.resting = max(speeds) < 1e-7 and min(speeds) > -1e-7

    def _slow_down(self, seconds: float) -> None:
        speeds = self.state.joint_speeds
        fastest = max(map(abs, speeds))
        kept = max(0.0, 1.0 - self._braking * seconds / fastest) if fastest > 1e-9 else 0.0
        until = 0.5 * (1.0 + kept) * min(seconds, fastest / self._braking)
        joints = tuple([q + v * until for q, v in zip(self.state.joints, speeds, strict=True)])
        self._speeds = tuple([v * kept for v in speeds])
        self._move_joints(joints, self._speeds, seconds)
        self.resting = fastest * kept < 1e-7

    def brake(self, tool: float = math.inf, joint: float = math.inf) -> None:
        """See `Motion`; without a joint deceleration of its own, it takes as long as the tool does."""
        speed = math.hypot(*self.state.tool_speed[:3])
        fastest = max(map(abs, self.state.joint_speeds))
        self._braking = max(min(joint, fastest * tool / max(speed, 1e-6)), 1e-3)

    def resume(self) -> None:
        """See `Motion`; it stays where it came to rest until it is given a new target."""
        self.target = self.state.joints
        self._braking = 0.0


class SpeedMotion(_Steered):
    """Follows a speed of the tool or of the joints, as `speedl` and `speedj` do."""

    def __init__(self, arm: Arm, tool: Array, state: ArmState, limit: Array, *, of_tool: bool) -> None:
        super().__init__(arm, tool, state)
        self.of_tool = of_tool
        self.target: Numbers = STILL
        self.acceleration = 1.0
        self.turning = 0.001
        self._limit = limit.tolist()
        self._untool = inverse(self._tool)
        self._speed: Numbers = state.tool_speed if of_tool else state.joint_speeds

    def aim(self, speed: Sequence[float], acceleration: float, turning: float = 0.0) -> None:
        """Take a new speed.

        Args:
            speed: mm/s and rad/s of the tool, or rad/s of the joints.
            acceleration: mm/s² of the tool, or rad/s² of the joint whose speed changes most.
            turning: of the tool, rad/s²; 0 for the same number of rad/s² as `acceleration` has of m/s².
        """
        self.target, self.acceleration = tuple(speed), max(acceleration, 1e-3)
        self.turning = turning if turning > 0.0 else self.acceleration / 1000.0

    def advance(self, seconds: float, path_seconds: float, share: float) -> None:
        """See `Motion`.

        Raises:
            ReachError: the arm cannot take the pose that it is led to.
        """
        if seconds <= 0.0:
            return
        old = self._speed
        gap = [b - a for a, b in zip(old, self.target, strict=True)]
        if any(gap):
            needed = self._time_to_close(gap)
            ramp = min(path_seconds, needed)
            part = ramp / needed if needed > path_seconds else 1.0
            reached = tuple([a + part * g for a, g in zip(old, gap, strict=True)])
            even = path_seconds - ramp
            moved = [0.5 * (a + b) * ramp + b * even for a, b in zip(old, reached, strict=True)]
        else:
            reached = old
            moved = [path_seconds * a for a in old]
        self._speed = reached
        self.resting = not any(moved)
        if not self.of_tool:
            joints = tuple([q + m for q, m in zip(self.state.joints, moved, strict=True)])
            self._move_joints(joints, tuple([m / seconds for m in moved]), seconds)
        elif self.resting:
            self.state = ArmState(self.state.joints, STILL, self.state.pose, STILL)
        else:
            self._move_tool(moved, tuple([share * v for v in reached]), seconds)

    def _move_tool(self, moved: Sequence[float], speed: Numbers, seconds: float) -> None:
        x, y, z, *rotation = moved
        frame = turned(self._frame, rotation)
        self._frame = frame = (*frame[:9], frame[9] + x, frame[10] + y, frame[11] + z)
        joints = self.state.joints
        found = nearest_joints(self.arm, compose(frame, self._untool), joints, self._limit)
        if found is None:
            raise ReachError(f"no inverse kinematics at tool position {[round(x, 1) for x in frame[9:]]} mm")
        self.state = ArmState(
            joints=found,
            joint_speeds=tuple([(b - a) / seconds for a, b in zip(joints, found, strict=True)]),
            pose=pose_numbers(frame),
            tool_speed=speed,
        )

    @property
    def reached(self) -> bool:
        """Whether the speed is the one that was asked for."""
        return max([abs(b - a) for a, b in zip(self._speed, self.target, strict=True)]) < 1e-9

    def brake(self, tool: float = math.inf, joint: float = math.inf) -> None:
        """See `Motion`; one rad/s² of the joints counts as 1000 mm/s² of the tool."""
        self.aim(STILL, min(tool, joint * 1000.0) if self.of_tool else min(joint, tool / 1000.0))

    def resume(self) -> None:
        """See `Motion`; it stays at rest until it is given a new speed."""

    def _time_to_close(self, gap: Sequence[float]) -> float:
        if not self.of_tool:
            return max(map(abs, gap)) / self.acceleration
        return max(math.hypot(*gap[:3]) / self.acceleration, math.hypot(*gap[3:]) / self.turning)


def standing(arm: Arm, tool: Array, joints: Numbers) -> ArmState:
    """The state of an arm at rest with the given joint angles."""
    return ArmState(joints, STILL, pose_numbers(compose(flange_frame(arm, joints), frame_of(tool))), STILL)
