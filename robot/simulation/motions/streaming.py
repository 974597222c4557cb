"""Motions that a client steers while they run: servoing towards targets, and following given speeds."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from planning import Arm, ReachError

from .arm_frame import flange_frame
from .frame import Numbers, compose, frame_of, pose_numbers, speed_between, turned
from .motion import STILL, ArmState
from .posture import nearest_joints

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]


class _Steered:
    """What steered motions share: they go on until braked, and keep the tool's frame."""

    finished = False
    mark = -1
    throttle_rate = 5.0

    def __init__(self, arm: Arm, tool: Array, state: ArmState) -> None:
        self.arm = arm
        self.state = state
        self.resting = True
        self._tool = frame_of(tool)
        self._frame = self._tool_at(state.joints)

    def _tool_at(self, joints: Numbers) -> Numbers:
        return compose(flange_frame(self.arm, joints), self._tool)

    def _move_joints(self, joints: Array, joint_speeds: Array, seconds: float) -> None:
        numbers = tuple(joints.tolist())
        before, self._frame = self._frame, self._tool_at(numbers)
        self.state = ArmState(
            joints=numbers,
            joint_speeds=tuple(joint_speeds.tolist()),
            pose=pose_numbers(self._frame),
            tool_speed=speed_between(before, self._frame, seconds),
        )


class ServoMotion(_Steered):
    """Runs after a target of the joints, as `servoj` does: the gap closes exponentially."""

    def __init__(self, arm: Arm, tool: Array, state: ArmState) -> None:
        super().__init__(arm, tool, state)
        self.target = np.array(state.joints)
        self.time_constant = 0.1
        self._braking = 0.0

    def aim(self, joints: Array, time_constant: float) -> None:
        """Take a new target, shape (6,), rad, to be approached with a time constant in s."""
        self.target, self.time_constant = joints, max(time_constant, 1e-3)
        self._braking = 0.0

    def advance(self, seconds: float, path_seconds: float, share: float) -> None:
        """See `Motion`."""
        del share
        if seconds <= 0.0:
            return
        joints, speeds = np.array(self.state.joints), np.array(self.state.joint_speeds)
        if self._braking:
            fastest = float(np.abs(speeds).max())
            kept = max(0.0, 1.0 - self._braking * seconds / fastest) if fastest > 1e-9 else 0.0
            until = min(seconds, fastest / self._braking)
            moved = speeds * (0.5 * (1.0 + kept) * until)
            speeds = speeds * kept
        else:
            moved = (self.target - joints) * -math.expm1(-path_seconds / self.time_constant)
            speeds = moved / seconds
        self._move_joints(joints + moved, speeds, seconds)
        self.resting = float(np.abs(speeds).max()) < 1e-7

    def brake(self, tool: float = math.inf, joint: float = math.inf) -> None:
        """See `Motion`; without a joint deceleration of its own, it takes as long as the tool does."""
        speed = math.hypot(*self.state.tool_speed[:3])
        fastest = max(map(abs, self.state.joint_speeds))
        self._braking = max(min(joint, fastest * tool / max(speed, 1e-6)), 1e-3)

    def resume(self) -> None:
        """See `Motion`; it stays where it came to rest until it is given a new target."""
        self.target = np.array(self.state.joints)
        self._braking = 0.0


class SpeedMotion(_Steered):
    """Follows a speed of the tool or of the joints, as `speedl` and `speedj` do."""

    def __init__(self, arm: Arm, tool: Array, state: ArmState, limit: Array, *, of_tool: bool) -> None:
        super().__init__(arm, tool, state)
        self.of_tool = of_tool
        self.target = np.zeros(6)
        self.acceleration = 1.0
        self._limit = limit.tolist()
        self._untool = frame_of(np.asarray(np.linalg.inv(tool), dtype=np.float64))
        self._speed = np.array(state.tool_speed if of_tool else state.joint_speeds)

    def aim(self, speed: Array, acceleration: float) -> None:
        """Take a new speed, shape (6,): mm/s and rad/s of the tool or rad/s of the joints; mm/s² or rad/s²."""
        self.target, self.acceleration = speed, max(acceleration, 1e-3)

    def advance(self, seconds: float, path_seconds: float, share: float) -> None:
        """See `Motion`.

        Raises:
            ReachError: the arm cannot take the pose that it is led to.
        """
        if seconds <= 0.0:
            return
        gap = self.target - self._speed
        needed = self._time_to_close(gap)
        ramp = min(path_seconds, needed)
        reached = self._speed + gap * (ramp / needed if needed > 0.0 else 1.0)
        moved = 0.5 * (self._speed + reached) * ramp + reached * (path_seconds - ramp)
        self._speed = reached
        self.resting = not moved.any()
        if not self.of_tool:
            self._move_joints(np.array(self.state.joints) + moved, moved / seconds, seconds)
        elif self.resting:
            self.state = ArmState(self.state.joints, STILL, self.state.pose, STILL)
        else:
            self._move_tool(moved, reached * share, seconds)

    def _move_tool(self, moved: Array, speed: Array, seconds: float) -> None:
        x, y, z, *rotation = moved.tolist()
        frame = turned(self._frame, rotation)
        self._frame = frame = (*frame[:9], frame[9] + x, frame[10] + y, frame[11] + z)
        joints = self.state.joints
        found = nearest_joints(self.arm, compose(frame, self._untool), joints, self._limit)
        if found is None:
            raise ReachError(f"no inverse kinematics at tool position {np.round(frame[9:], 1)} mm")
        self.state = ArmState(
            joints=found,
            joint_speeds=tuple([(b - a) / seconds for a, b in zip(joints, found, strict=True)]),
            pose=pose_numbers(frame),
            tool_speed=tuple(speed.tolist()),
        )

    @property
    def reached(self) -> bool:
        """Whether the speed is the one that was asked for."""
        return bool(np.abs(self.target - self._speed).max() < 1e-9)

    def brake(self, tool: float = math.inf, joint: float = math.inf) -> None:
        """See `Motion`; one rad/s² of the joints counts as 1000 mm/s² of the tool."""
        self.aim(np.zeros(6), min(tool, joint * 1000.0) if self.of_tool else min(joint, tool / 1000.0))

    def resume(self) -> None:
        """See `Motion`; it stays at rest until it is given a new speed."""

    def _time_to_close(self, gap: Array) -> float:
        if not self.of_tool:
            return float(np.abs(gap).max()) / self.acceleration
        # URScript gives one number for m/s² and rad/s².
        along, around = float(np.linalg.norm(gap[:3])), float(np.linalg.norm(gap[3:])) * 1000.0
        return max(along, around) / self.acceleration


def standing(arm: Arm, tool: Array, joints: Numbers) -> ArmState:
    """The state of an arm at rest with the given joint angles."""
    return ArmState(joints, STILL, pose_numbers(compose(flange_frame(arm, joints), frame_of(tool))), STILL)
