"""The tool after a target that changes while it moves, as `servoc` leads it.

From where it is and the way it is heading, the tool turns on a circle towards the target and goes straight on from
where the circle's tangent meets it, to come to rest there. The circle has the radius that is asked for, or the one
that takes no more than the acceleration at the tool's speed if that is larger, but always less than would miss the
target. Where the target is too near to come to rest at, the tool first brakes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from .course import NO_LENGTH, Piece
from .frame import rotation_between, turned
from .tool_motion import REVERSAL, ToolMotion
from .tool_pieces import STRAIGHT, Target

if TYPE_CHECKING:
    from .frame import Numbers

TIGHTEST = 0.9
"""Largest radius of the circle, as a share of the one that passes through the target itself."""


class Pursuit(ToolMotion):
    """Follows a target; the arguments are those of `ToolMotion`."""

    _after: Target | None = None  # what to follow once at rest
    _followed: Target | None = None
    _held = False  # whether it was told to brake

    def follow(self, target: Target) -> None:
        """Take another target."""
        if target == self._followed:
            return
        self._followed, self._after = target, None
        self._goes_on = False
        course = self._course
        if self._braking or course.speed <= 0.0:
            if self.resting or not self._braking:
                self.asking = False
                course.clear()
                self._braking = 0.0
                self.add(target)
            else:
                self._after = target
            return
        pieces = self._turn(target)
        if sum(piece.length for piece in pieces) < course.speed**2 / (2.0 * target.acceleration):
            self._after = target
            super().brake(tool=target.acceleration)
            return
        course.clear()
        for piece in pieces:
            course.append(piece)
        self._told(target.speed, target.acceleration)

    def advance(self, seconds: float, path_seconds: float, share: float) -> None:
        """See `Motion`."""
        super().advance(seconds, path_seconds, share)
        if self._after is not None and self.resting and not self._held:
            target, self._followed = self._after, None
            self.follow(target)

    def brake(self, tool: float = math.inf, joint: float = math.inf) -> None:
        """See `Motion`."""
        self._held = True
        super().brake(tool, joint)

    def resume(self) -> None:
        """See `Motion`."""
        self._held = False
        if self._after is None:
            super().resume()

    def _turn(self, target: Target) -> list[Piece]:
        """The circle and the line to a target."""
        start, end, course = self._frame, target.frame, self._course
        ahead = course.pieces[0].at(course.on + 1e-3)
        heading = [b - a for a, b in zip(start[9:], ahead[9:], strict=True)]
        size = math.hypot(*heading)
        step = [b - a for a, b in zip(start[9:], end[9:], strict=True)]
        distance = math.hypot(*step)
        if size <= NO_LENGTH or distance <= NO_LENGTH:
            return []
        heading = [h / size for h in heading]
        x = sum(a * b for a, b in zip(step, heading, strict=True))
        across = [s - x * h for s, h in zip(step, heading, strict=True)]
        y = math.hypot(*across)
        bend = math.atan2(y, x)
        if bend > REVERSAL:
            return []
        angle = radius = 0.0
        side = [a / y for a in across] if bend > STRAIGHT else [0.0, 0.0, 0.0]
        if bend > STRAIGHT:
            wanted = max(target.blend, course.speed**2 / target.acceleration)
            radius = min(wanted, TIGHTEST * distance * distance / (2.0 * y))
            reach = math.hypot(x, y - radius)
            angle = (math.atan2(y - radius, x) + math.asin(min(radius / reach, 1.0))) % (2.0 * math.pi)
        c, s = math.cos(angle), math.sin(angle)
        onward = [c * h + s * p for h, p in zip(heading, side, strict=True)]
        left = [s * h + (1.0 - c) * p for h, p in zip(heading, side, strict=True)]
        corner = [p + radius * q for p, q in zip(start[9:], left, strict=True)]
        round_, straight = radius * angle, math.dist(corner, end[9:])
        turn = rotation_between(start, end)
        whole = round_ + straight

        def oriented(way: float) -> Numbers:
            return turned(start, [way / whole * r for r in turn])[:9]

        def on_circle(on: float) -> Numbers:
            a, b = math.sin(on / radius), 1.0 - math.cos(on / radius)
            place = [p + radius * (a * h + b * q) for p, h, q in zip(start[9:], heading, side, strict=True)]
            return (*oriented(on), *place)

        def on_line(on: float) -> Numbers:
            if on >= straight:
                return end
            return (*oriented(round_ + on), *[p + on * d for p, d in zip(corner, onward, strict=True)])

        return [
            Piece(length, target.speed, target.acceleration, at, towards=end)
            for length, at in ((round_, on_circle), (straight, on_line))
            if length > NO_LENGTH
        ]
