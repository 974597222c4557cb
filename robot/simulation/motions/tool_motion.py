"""Moves of the tool along lines and arcs, told one after another while it moves.

The tool leaves a leg at the blend radius before its end and joins the next at the same distance behind. The radius is
at most half of the next leg, so that two blends never overlap. Orientation turns evenly along each leg; where it
turns by more than the tool travels, it sets the pace. Where a joint would have to turn faster than it can, the tool
goes along its way as slowly as that joint needs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from planning import Arm, ReachError

from .arm_frame import flange_frame
from .course import NO_LENGTH, Piece
from .frame import Numbers, compose, frame_of, inverse, pose_numbers, speed_between
from .motion import STILL, ArmState
from .posture import nearest_joints
from .told_motion import ToldMotion, in_time
from .tool_pieces import STRAIGHT, Arc, Leg, Line, Target, corner_between, rounding

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np
    import numpy.typing as npt

ALMOST_STRAIGHT = 0.01
"""Corner that a process move without a blend passes, rad."""

EASED = 0.95
"""Speed of a joint to which the tool is held up, by the largest that it can turn at."""

NEARLY = 0.9
"""Share of that speed which is near enough to it."""

TRIES = 24
"""With which the way is found that the tool can go in a cycle."""

STEEPEST = 0.03
"""Least share of a time that is tried next: where a joint all but jumps, its speed says little of the way to it."""

CRAWL = 0.01
"""Speed below which a tool that is held up for a joint stands, mm/s."""

AT_LIMIT = 1e-3
"""Angle from a joint's limit at which it is the limit that holds the tool up, rad."""

REVERSAL = math.pi - 1e-3
"""Corner beyond which there is nothing to round, rad."""


class ToolMotion(ToldMotion):
    """Follows targets of the tool as they are told.

    Args:
        arm: the kinematics.
        tool: in the flange frame, shape (4, 4), mm.
        state: of the arm, at rest.
        limit: largest angle of each joint either way, rad.
        fastest: largest speed of each joint, rad/s.
        ask: called when the tool asks for the next target, which it may `add` at once or later.
    """

    def __init__(
        self,
        arm: Arm,
        tool: npt.NDArray[np.float64],
        state: ArmState,
        limit: Sequence[float],
        fastest: Sequence[float],
        ask: Callable[[], None],
    ) -> None:
        super().__init__(state, ask)
        self._arm, self._limit, self._fastest = arm, limit, fastest
        self._tool = frame_of(tool)
        self._untool = inverse(self._tool)
        self._frame = compose(flange_frame(arm, state.joints), self._tool)
        self._leg: Leg | None = None  # the last one told
        self._blend = 0.0  # radius at its end that was asked for
        self._found: tuple[Numbers, Numbers] = (self._frame, state.joints)  # the last place, and its joints

    # -- targets

    def add(self, target: Target) -> None:
        """Go on to a target: from rest, or while `asking`.

        Raises:
            ReachError: the places of an arc lie on a line.
        """
        before = self._leg if self.asking else None
        start = before.end if before is not None else self._frame
        leg: Leg
        if target.via is None:
            leg = Line(start, target.frame)
        else:
            leg = Arc(start, target.via, target.frame, keeps=target.keeps)
        if leg.length <= NO_LENGTH:  # the tool comes as near to the place as any of the targets there asks
            self._blend = min(self._blend, target.blend) if before is not None else 0.0
        else:
            if target.seconds > 0.0:
                speed, acceleration = in_time(leg.length, target.seconds)
                target = replace(target, speed=speed / leg.pace, acceleration=acceleration / leg.pace)
            run, entered = self._round(before, leg, target) if before is not None else (0.0, 0.0)
            speed, acceleration = target.speed * leg.pace, target.acceleration * leg.pace
            at = leg.at if run == 0.0 else lambda on: leg.at(run + on)
            self._course.append(Piece(leg.length - run, speed, acceleration, at, entered, leg.end))
            self._leg, self._blend = leg, target.blend
        self._goes_on = self._blend > 0.0
        self._zone = min(self._blend, 0.5 * leg.length)
        self._told(target.speed, target.acceleration)

    def _round(self, before: Leg, after: Leg, target: Target) -> tuple[float, float]:
        """Round the corner into a leg; what of that is used up, mm, and the largest speed behind."""
        course = self._course
        bend = corner_between(before, after)
        left = course.pieces[-1].length - (course.on if len(course.pieces) == 1 else 0.0)
        stoppable = self._stoppable(after.length, target.acceleration * after.pace)
        radius = min(self._blend, left, 0.5 * after.length, stoppable)
        if bend < REVERSAL and radius > NO_LENGTH:
            if bend < STRAIGHT and not any(before.turn) and not any(after.turn):
                return 0.0, math.inf
            blend, pace = rounding(before, after, radius, bend, target)
            slowed = left - course.braking(pace * max(course.speed, target.speed))
            if radius > slowed:  # it could not turn there yet: the tool would be too fast
                radius = slowed
                blend, _ = rounding(before, after, max(radius, NO_LENGTH), bend, target)
            if radius > NO_LENGTH:
                course.cut(radius)
                course.append(blend)
                return radius, math.inf
        straight_on = self._goes_on and bend < ALMOST_STRAIGHT
        return 0.0, math.inf if straight_on else 0.0

    # -- the cycle

    @property
    def waypoint(self) -> Numbers:
        """The tool's frame at the target of the move that goes on."""
        return self._course.pieces[0].towards if self._course.pieces else self._frame

    def _run(self, seconds: float, path_seconds: float) -> Numbers | None:
        """As far as the joints can follow.

        Raises:
            ReachError: they can follow no further.
        """
        end, held_by = self._eased(seconds, path_seconds, self._course.run)
        if held_by is not None and self._course.speed < CRAWL:
            raise ReachError(self._stuck(held_by))
        return end

    def _coast(self, seconds: float) -> Numbers | None:
        """As far as the joints can follow, which may be no further."""
        course = self._course
        end, held_by = self._eased(seconds, seconds, lambda time: course.coast(time, self._braking))
        if held_by is not None and course.speed < CRAWL:
            course.speed = 0.0
        return end

    def _eased(
        self, seconds: float, whole: float, go: Callable[[float], Numbers | None]
    ) -> tuple[Numbers | None, int | None]:
        """Go on along the course as far as the joints can follow in a cycle.

        Args:
            seconds: that the cycle takes.
            whole: time along the course that it would take without the joints.
            go: goes along it for a time.

        Returns:
            What stands at the course's end if it was reached, and the index of the joint that held the tool up, if any.
        """
        course, mark = self._course, self._course.mark()
        end = go(whole)
        share, held_by = self._turning(end, seconds)
        if share <= 1.0:
            return end, None
        fits, too_long, time = 0.0, whole, whole / share
        for _ in range(TRIES):
            course.back(mark)
            end = go(time)
            share, joint = self._turning(end, seconds)
            if NEARLY <= share <= 1.0:
                break
            if share > 1.0:
                too_long, held_by = time, joint
            else:
                fits = time
            time = 0.5 * (fits + too_long) if fits > 0.0 else time * max(NEARLY / share, STEEPEST)
        else:
            course.back(mark)
            end = go(fits)
        course.speed = min(course.speed, (mark.ahead - course.ahead) / whole)
        return end, held_by

    def _stuck(self, joint: int) -> str:
        """Why the tool can go no further, when a joint holds it up."""
        for i, (angle, most) in enumerate(zip(self.state.joints, self._limit, strict=True)):
            if most - abs(angle) < AT_LIMIT:
                return f"joint {i + 1} is at its limit"
        return (
            f"joint {joint + 1} would have to turn while the tool stands: it is at a singularity or at the end of the "
            "arm's reach"
        )

    def _turning(self, end: Numbers | None, seconds: float) -> tuple[float, int]:
        """How fast a joint turns to where the course is now, by `EASED` of what it can, and which does so most."""
        place = end if end is not None else self._course.here()
        steps = zip(self.state.joints, self._joints_at(place), self._fastest, strict=True)
        share = [abs(b - a) / (EASED * most * seconds) for a, b, most in steps]
        return max(share), share.index(max(share))

    def _joints_at(self, place: Numbers) -> Numbers:
        if place != self._found[0]:
            joints = nearest_joints(self._arm, compose(place, self._untool), self.state.joints, self._limit)
            if joints is None:
                where = [round(x, 1) for x in place[9:]]
                raise ReachError(f"no inverse kinematics at tool position {where} mm")
            self._found = place, joints
        return self._found[1]

    def _see(self, place: Numbers, speed: float, seconds: float) -> None:
        before, self._frame = self._frame, place
        old, joints = self.state.joints, self._joints_at(place)
        if self.resting:
            self.state = ArmState(joints, STILL, pose_numbers(place), STILL)
            return
        mean = speed_between(before, place, seconds)
        fast = math.hypot(*mean[:3])
        scale = speed / fast if fast > NO_LENGTH and speed > 0.0 else 1.0
        self.state = ArmState(
            joints=joints,
            joint_speeds=tuple([(b - a) / seconds for a, b in zip(old, joints, strict=True)]),
            pose=pose_numbers(place),
            tool_speed=(*[scale * x for x in mean[:3]], *mean[3:]),
        )

    def _along(self, tool: float, joint: float) -> float:
        fastest = max(map(abs, self.state.joint_speeds))
        by_joints = self._course.speed * joint / fastest if fastest > 0.0 else 1000.0 * joint
        return min(tool, by_joints)
