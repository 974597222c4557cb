"""Moves of the tool along lines and arcs, told one after another while it moves.

A controller knows a program's next move only when the program tells it. A move with a blend radius asks for the next
one when the tool comes within that radius of its target: told in time, the tool leaves the line on the arc that
touches both lines and keeps its speed; not told, it comes to rest at the target. A move without a radius ends at rest.

The radius is at most half of the next line, so that two blends never overlap; the arc stays within it. Orientation
turns evenly along each line; where it turns by more than the tool travels, it sets the pace.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from planning import Arm, ReachError

from .arm_frame import flange_frame
from .frame import Numbers, compose, frame_of, inverse, pose_numbers, speed_between
from .motion import STILL, ArmState
from .posture import nearest_joints
from .tool_pieces import NO_LENGTH, Leg, Piece, Target, arc_through, rounding

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np
    import numpy.typing as npt

STRAIGHT = 1e-6  # rad, below which a corner is none
REVERSAL = math.pi - 1e-3  # rad, beyond which a corner cannot be rounded


class ToolMotion:
    """Follows targets as they are told.

    Args:
        arm: the kinematics.
        tool: in the flange frame, shape (4, 4), mm.
        state: of the arm, at rest.
        limit: largest angle of each joint either way, rad.
        ask: called when the tool asks for the next target, which it may `add` at once or later.

    Attributes:
        asking: whether the tool has come within the blend radius of the last target, and goes on if told where.
    """

    mark = -1

    def __init__(
        self,
        arm: Arm,
        tool: npt.NDArray[np.float64],
        state: ArmState,
        limit: Sequence[float],
        ask: Callable[[], None],
    ) -> None:
        self.arm, self.state = arm, state
        self._ask = ask
        self.finished, self.resting, self.asking = True, True, False
        self.throttle_rate = 1.0
        self._limit = limit
        self._tool = frame_of(tool)
        self._untool = inverse(self._tool)
        self._frame = compose(flange_frame(arm, state.joints), self._tool)
        self._pieces: list[Piece] = []
        self._on, self._speed = 0.0, 0.0  # along the first piece
        self._leg: Leg | None = None  # the last one told
        self._blend = 0.0  # what of the last leg's end is left for a blend, as far as the leg allows
        self._target: Target | None = None
        self._braking = 0.0

    def ask_with(self, ask: Callable[[], None]) -> None:
        """Ask somebody else for the next target."""
        self._ask = ask

    # -- targets

    def add(self, target: Target) -> None:
        """Go on to a target: from rest, or while `asking`."""
        self.throttle_rate = target.acceleration / target.speed
        if target.via is not None:
            self._addrounding(target)
        else:
            self._add_line(target)
        self._target = target
        self.asking = False
        self.finished = not self._pieces
        self.resting = self.finished

    def _add_line(self, target: Target) -> None:
        corner = self._leg.end if self._leg is not None and self.asking else self._frame
        leg = Leg.between(corner, target.frame)
        if leg.travel < NO_LENGTH:
            return
        rounded = self._round(leg, target) if self._leg is not None and self.asking else 0.0
        start = rounded / leg.travel if leg.distance > NO_LENGTH else 0.0
        room = leg.travel * (1.0 - start)
        radius = min(target.blend, 0.5 * leg.travel) if leg.distance > 0.99 * leg.travel else 0.0
        self._leg, self._blend = leg, min(radius, room)
        self._append_line(leg, start, 1.0 - self._blend / leg.travel, target)

    def _append_line(self, leg: Leg, start: float, end: float, target: Target) -> None:
        length = (end - start) * leg.travel
        if length > NO_LENGTH:
            self._pieces.append(
                Piece(
                    length,
                    target.speed,
                    target.acceleration,
                    lambda s: leg.frame(end if s >= length else start + s / leg.travel),
                )
            )

    def _round(self, leg: Leg, target: Target) -> float:
        """Round the corner from the last leg into the next; what of the next is used up, mm."""
        before = self._leg
        assert before is not None
        assert self._target is not None
        cosine = sum(a * b for a, b in zip(before.direction, leg.direction, strict=True))
        bend = math.acos(min(1.0, max(-1.0, cosine)))
        radius = min(self._blend, 0.5 * leg.distance)
        if leg.distance < 0.99 * leg.travel or bend > REVERSAL:
            radius = 0.0  # a turn on the spot or back: nothing to round
        share = self._reopen(before)
        radius = min(radius, self._blend)
        self._append_line(before, share, 1.0 - radius / before.travel, self._target)
        if radius <= NO_LENGTH or bend < STRAIGHT:
            if bend < STRAIGHT or radius > NO_LENGTH:
                self._append_line(before, 1.0 - radius / before.travel, 1.0, self._target)
            return 0.0
        self._pieces.append(rounding(before, leg, radius, bend, target))
        return radius

    def _reopen(self, leg: Leg) -> float:
        """Give up the stretch that comes to rest; the share of its line that is run."""
        self._blend = max(self._blend - self._on, 0.0)
        self._pieces.clear()
        self._on = 0.0
        return 1.0 - self._blend / leg.travel

    def _addrounding(self, target: Target) -> None:
        start = self._leg.end if self._leg is not None and self.asking else self._frame
        if self._leg is not None and self.asking:
            self._append_line(self._leg, self._reopen(self._leg), 1.0, self._target or target)
        piece = arc_through(start, target)
        self._pieces.append(piece)
        self._leg, self._blend = None, 0.0

    # -- the cycle

    def advance(self, seconds: float, path_seconds: float, share: float) -> None:
        """See `Motion`.

        Raises:
            ReachError: the arm cannot take the pose that it is led to.
        """
        if self.finished or seconds <= 0.0:
            return
        before = self._frame
        if self._braking:
            self._coast(seconds)
        else:
            self._run(path_seconds)
        if self._pieces:
            self._frame = self._pieces[0].frame_at(self._on)
        self._see(before, seconds, share)

    def _run(self, seconds: float) -> None:
        while seconds > 0.0 and self._pieces:
            piece = self._pieces[0]
            room = piece.length - self._on
            stop = self._distance_to_rest()
            took, way, speed = _phase(self._speed, piece.speed, self._rate(piece), stop, room, seconds)
            seconds -= took
            self._on, self._speed = self._on + way, speed
            if self._on >= piece.length - NO_LENGTH:
                self._next()

    def _rate(self, piece: Piece) -> float:
        """Acceleration: what the move asks for, or what it takes to come to rest at the end."""
        stop = self._distance_to_rest()
        return (
            piece.acceleration
            if math.isinf(stop)
            else max(piece.acceleration, self._speed**2 / (2.0 * max(stop, 1e-9)))
        )

    def _distance_to_rest(self) -> float:
        if self._blend > 0.0 and not self.asking:
            return math.inf  # it asks before
        return sum(piece.length for piece in self._pieces) - self._on

    def _next(self) -> None:
        """Go over to the next piece, to the blend, or to rest."""
        done = self._pieces.pop(0)
        self._frame, self._on = done.frame_at(done.length), 0.0
        if self._pieces:
            return
        if self._blend > 0.0 and not self.asking and self._leg is not None and self._target is not None:
            self.asking = True
            self._append_line(self._leg, 1.0 - self._blend / self._leg.travel, 1.0, self._target)
            self._ask()
            return
        self.finished = self.resting = True
        self.asking = False
        self._speed = 0.0

    def _coast(self, seconds: float) -> None:
        until = min(seconds, self._speed / self._braking)
        way = (self._speed - 0.5 * self._braking * until) * until
        self._speed = max(0.0, self._speed - self._braking * seconds)
        while self._on + way >= self._pieces[0].length and len(self._pieces) > 1:
            way -= self._pieces[0].length - self._on
            self._pieces.pop(0)
            self._on = 0.0
        self._on = min(self._on + way, self._pieces[0].length)
        self.resting = self._speed <= 0.0

    def _see(self, before: Numbers, seconds: float, share: float) -> None:
        old = self.state.joints
        joints = nearest_joints(self.arm, compose(self._frame, self._untool), old, self._limit)
        if joints is None:
            raise ReachError(
                f"no inverse kinematics at tool position {[round(x, 1) for x in self._frame[9:]]} mm"
            )
        if self.resting:
            self.state = ArmState(joints, STILL, pose_numbers(self._frame), STILL)
            return
        mean = speed_between(before, self._frame, seconds)
        fast = math.hypot(*mean[:3])
        now = self._speed * share
        scale = now / fast if fast > NO_LENGTH and now > 0.0 else 1.0
        self.state = ArmState(
            joints=joints,
            joint_speeds=tuple([(b - a) / seconds for a, b in zip(old, joints, strict=True)]),
            pose=pose_numbers(self._frame),
            tool_speed=tuple([scale * x for x in mean[:3]]) + mean[3:],
        )

    # -- stops

    def brake(self, tool: float = math.inf, joint: float = math.inf) -> None:
        """See `Motion`; one rad/s² of the joints counts as 1000 mm/s² of the tool."""
        if not self.finished:
            self._braking = max(min(tool, 1000.0 * joint, 1e9), 1e-6)

    def resume(self) -> None:
        """See `Motion`."""
        self._braking = 0.0


def _phase(
    speed: float, limit: float, rate: float, stop: float, room: float, seconds: float
) -> tuple[float, float, float]:
    """One stretch at constant acceleration: the time it takes, the way run, and the speed at its end.

    Args:
        speed: now.
        limit: to be reached and kept.
        rate: acceleration and deceleration.
        stop: distance at which the tool must rest.
        room: distance at which the stretch ends at the latest.
        seconds: time in which it ends at the latest.
    """
    braking = speed * speed / (2.0 * rate)
    if stop <= braking + 1e-12 * max(1.0, braking):
        gain, lasts = -rate, speed / rate
    elif speed > limit * (1.0 + 1e-12):
        gain, lasts = -rate, (speed - limit) / rate
    elif speed < limit * (1.0 - 1e-12):
        peak = limit if math.isinf(stop) else min(limit, math.sqrt(rate * stop + 0.5 * speed * speed))
        gain, lasts = rate, max(peak - speed, 0.0) / rate
    else:
        gain, lasts = 0.0, (stop - braking) / speed
    lasts = max(lasts, 1e-9)
    took = min(lasts, seconds)
    way = (speed + 0.5 * gain * took) * took
    if way > room:
        root = math.sqrt(max(speed * speed + 2.0 * gain * room, 0.0))
        took = 2.0 * room / (speed + root) if speed + root > 0.0 else took
        way = room
    return took, way, max(speed + gain * took, 0.0)
