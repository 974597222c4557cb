"""Moves of the joints, told one after another while they move.

All joints run evenly from one target to the next, the leading one, which turns most, with the speed and acceleration
that are asked for. With a blend radius they leave the straight way in the space of the joints where the tool enters
the radius, and join the next at the same turn of its leading joint behind the target, while their speeds go over
evenly from the one's to the other's. The tool stays within the radius.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .arm_frame import flange_frame
from .course import NO_LENGTH, Piece
from .frame import Numbers, compose, frame_of, pose_numbers, speed_between
from .motion import STILL, ArmState
from .told_motion import ToldMotion, in_time

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np
    import numpy.typing as npt

    from planning import Arm

STEPS = 24
"""Places along a leg at which it is asked whether the tool has left the radius."""

HALVINGS = 24
"""With which the place between two of them is found."""

TRIED = 8
"""Places on a blend at which the tool must be within the radius."""


@dataclass(frozen=True)
class JointTarget:
    """Where a move of the joints leads, and how.

    Attributes:
        joints: rad.
        speed: of the leading joint, rad/s.
        acceleration: of the leading joint, rad/s².
        blend: radius at the target, mm of the tool.
        seconds: what the move takes in place of its speed and acceleration, or 0.
    """

    joints: Numbers
    speed: float
    acceleration: float
    blend: float = 0.0
    seconds: float = 0.0


@dataclass(frozen=True)
class _Leg:
    start: Numbers
    end: Numbers
    length: float  # of the leading joint, rad
    slope: Numbers  # of each joint by that

    @classmethod
    def between(cls, start: Numbers, end: Numbers) -> _Leg:
        step = [b - a for a, b in zip(start, end, strict=True)]
        length = max(map(abs, step))
        return cls(start, end, length, tuple([s / length for s in step]) if length > NO_LENGTH else STILL)

    def at(self, on: float) -> Numbers:
        if on >= self.length:
            return self.end
        return tuple([q + on * d for q, d in zip(self.start, self.slope, strict=True)])


class JointMotion(ToldMotion):
    """Follows targets of the joints as they are told.

    Args:
        arm: the kinematics.
        tool: in the flange frame, shape (4, 4), mm.
        state: of the arm, at rest.
        fastest: largest speed of each joint, rad/s.
        ask: called when the arm asks for the next target, which it may `add` at once or later.
    """

    def __init__(
        self,
        arm: Arm,
        tool: npt.NDArray[np.float64],
        state: ArmState,
        fastest: Sequence[float],
        ask: Callable[[], None],
    ) -> None:
        super().__init__(state, ask)
        self._arm, self._fastest = arm, fastest
        self._tool = frame_of(tool)
        self._frame = self._frame_at(state.joints)
        self._leg: _Leg | None = None  # the last one told
        self._blend = 0.0  # radius at its end, mm

    def _frame_at(self, joints: Numbers) -> Numbers:
        return compose(flange_frame(self._arm, joints), self._tool)

    # -- targets

    def add(self, target: JointTarget) -> None:
        """Go on to a target: from rest, or while `asking`; no joint goes faster than it can."""
        before = self._leg if self.asking else None
        leg = _Leg.between(before.end if before is not None else self.state.joints, target.joints)
        speed, acceleration = target.speed, target.acceleration
        if leg.length <= NO_LENGTH:
            self._blend = min(self._blend, target.blend) if before is not None else 0.0
        else:
            if target.seconds > 0.0:
                speed, acceleration = in_time(leg.length, target.seconds)
            speed = min(speed, self._most(leg))
            run, entered = self._round(before, leg, speed, acceleration) if before is not None else (0.0, 0.0)
            self._course.append(
                Piece(leg.length - run, speed, acceleration, lambda on: leg.at(run + on), entered, leg.end)
            )
            self._leg, self._blend = leg, target.blend
            self._zone = self._turn_within(leg, target.blend, back=True)
        self._goes_on = self._blend > 0.0
        self._told(speed, acceleration)

    def _most(self, leg: _Leg) -> float:
        """Largest speed along a leg."""
        return min([f / abs(d) for f, d in zip(self._fastest, leg.slope, strict=True) if d], default=math.inf)

    def _turn_within(self, leg: _Leg, radius: float, *, back: bool) -> float:
        """How far the leg runs, seen from its end or its start, until the tool is a radius away, half of it at most."""
        if radius <= 0.0:
            return 0.0
        corner = self._frame_at(leg.end if back else leg.start)[9:]

        def away(turn: float) -> float:
            return math.dist(self._frame_at(leg.at(leg.length - turn if back else turn))[9:], corner)

        most = 0.5 * leg.length
        inside, outside = 0.0, most
        for i in range(1, STEPS + 1):
            if away(most * i / STEPS) > radius:
                outside = most * i / STEPS
                break
            inside = most * i / STEPS
        else:
            return most
        for _ in range(HALVINGS):
            middle = 0.5 * (inside + outside)
            if away(middle) > radius:
                outside = middle
            else:
                inside = middle
        return inside

    def _round(self, before: _Leg, after: _Leg, speed: float, acceleration: float) -> tuple[float, float]:
        """Round the corner into a leg; what of that is used up, rad, and the largest speed behind."""
        course = self._course
        left = course.pieces[-1].length - (course.on if len(course.pieces) == 1 else 0.0)
        stoppable = self._stoppable(after.length, acceleration)
        turn = min(self._zone, left, stoppable, self._turn_within(after, self._blend, back=False))
        corner, u, v = before.end, before.slope, after.slope

        def at(on: float) -> Numbers:
            share = on / (2.0 * turn)
            a, b = turn * (1.0 - share) * (1.0 - share), turn * share * share
            return tuple([q - a * d + b * e for q, d, e in zip(corner, u, v, strict=True)])

        centre = self._frame_at(corner)[9:]
        while turn > NO_LENGTH and any(
            math.dist(self._frame_at(at(2.0 * turn * i / TRIED))[9:], centre) > self._blend
            for i in range(1, TRIED)
        ):
            turn *= 0.8
        if turn <= NO_LENGTH:
            return 0.0, 0.0
        course.cut(turn)
        speed = min(speed, self._most(before), self._most(after))
        course.append(Piece(2.0 * turn, speed, acceleration, at, towards=after.end))
        return turn, math.inf

    # -- the cycle

    @property
    def last(self) -> Numbers:
        """The joints of the last target that was told, or the arm's own."""
        return self._leg.end if self._leg is not None else self.state.joints

    @property
    def waypoint(self) -> Numbers:
        """The tool's frame at the target of the move that goes on."""
        return self._frame_at(self._course.pieces[0].towards) if self._course.pieces else self._frame

    def _see(self, place: Numbers, speed: float, seconds: float) -> None:
        del speed
        old, before = self.state.joints, self._frame
        self._frame = frame = self._frame_at(place)
        if self.resting:
            self.state = ArmState(place, STILL, pose_numbers(frame), STILL)
            return
        self.state = ArmState(
            joints=place,
            joint_speeds=tuple([(b - a) / seconds for a, b in zip(old, place, strict=True)]),
            pose=pose_numbers(frame),
            tool_speed=speed_between(before, frame, seconds),
        )

    def _along(self, tool: float, joint: float) -> float:
        fast = math.hypot(*self.state.tool_speed[:3])
        by_tool = self._course.speed * tool / fast if fast > 1e-6 and math.isfinite(tool) else tool
        return min(by_tool, joint)
