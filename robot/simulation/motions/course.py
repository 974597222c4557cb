"""Running along a course: pieces one after another, with a trapezoid of speed over all of them.

A piece has a length, a largest speed and an acceleration. The speed at which each must be left is planned back from
rest at the end, so that the limits of pieces ahead, and the end, are met by braking in time. Between two instants
the speed is integrated in closed form, so that neither the way nor the time depends on how often it is looked at.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from .frame import Numbers

NO_LENGTH = 1e-9
"""Length below which there is nothing to run, mm or rad."""

SHORTEST = 1e-9
"""Least time of a stretch at one acceleration, s: rounding must not make endless ones of no length."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A part of a course.

    Attributes:
        length: mm of the tool or rad of the leading joint.
        speed: largest, per second.
        acceleration: of speeding up and of slowing down.
        at: what stands at a distance from the piece's start: the tool's frame or the joints.
        entered: largest speed at its start; 0 for a piece that begins at rest.
        towards: what stands at the target of the move that the piece belongs to.
    """

    length: float
    speed: float
    acceleration: float
    at: Callable[[float], Numbers]
    entered: float = math.inf
    towards: Numbers = ()


@dataclass(frozen=True, slots=True)
class Mark:
    """Where on a course somebody was."""

    pieces: list[Piece]
    exits: list[float]
    on: float
    speed: float
    ahead: float


class Course:
    """Pieces ahead, and how far and how fast they are run.

    Attributes:
        pieces: the one that is being run and those that follow.
        on: way run along the first.
        speed: along it.
        ahead: way to the end.
        gentlest: least acceleration of all pieces.
    """

    def __init__(self) -> None:
        self.pieces: list[Piece] = []
        self.on = self.speed = self.ahead = 0.0
        self.gentlest = math.inf
        self._exits: list[float] = []  # the speed at each piece's end
        self._entered = math.inf  # largest speed at the start of a piece that was taken away

    def append(self, piece: Piece) -> None:
        """Go on along a piece; `plan` when all are told."""
        if piece.length > NO_LENGTH:
            if self._entered < piece.entered:
                piece = replace(piece, entered=self._entered)
            self._entered = math.inf
            self.pieces.append(piece)
            self.ahead += piece.length

    def cut(self, less: float) -> None:
        """Take a length off the last piece's end, as far as it is not run yet."""
        if not self.pieces:
            return
        last = self.pieces[-1]
        run = self.on if len(self.pieces) == 1 else 0.0
        length = max(last.length - less, run)
        self.ahead -= last.length - length
        if length - run > NO_LENGTH:
            self.pieces[-1] = replace(last, length=length)
            return
        self.pieces.pop()
        if self.pieces:
            self._entered = last.entered
        else:
            self.on = self.ahead = 0.0

    def clear(self) -> None:
        """Forget what is ahead; the speed stays."""
        self.pieces.clear()
        self._exits.clear()
        self.on = self.ahead = 0.0

    def plan(self) -> None:
        """See at which speed each piece must be left, so that all that follow, and rest at the end, are met."""
        pieces = self.pieces
        leaving = [0.0] * len(pieces)
        speed = 0.0
        for i in range(len(pieces) - 1, 0, -1):
            piece = pieces[i]
            most = math.sqrt(speed * speed + 2.0 * piece.acceleration * piece.length)
            speed = leaving[i - 1] = min(most, piece.speed, piece.entered, pieces[i - 1].speed)
        self._exits = leaving
        self.gentlest = min([piece.acceleration for piece in pieces], default=math.inf)

    def braking(self, speed: float) -> float:
        """Part of the last piece that it takes to slow down to a speed; of what is before, all is used for that."""
        excess = self.speed**2 - speed**2
        for i, piece in enumerate(self.pieces[:-1]):
            excess -= 2.0 * piece.acceleration * (piece.length - (self.on if i == 0 else 0.0))
        return max(excess, 0.0) / (2.0 * self.pieces[-1].acceleration)

    def here(self) -> Numbers:
        """What stands at the place that is reached; there must be a piece."""
        return self.pieces[0].at(self.on)

    def mark(self) -> Mark:
        """Where it is now, to go `back` to."""
        return Mark(self.pieces.copy(), self._exits.copy(), self.on, self.speed, self.ahead)

    def back(self, mark: Mark) -> None:
        """Undo what was run since a mark; nothing was appended or cut since."""
        self.pieces, self._exits = mark.pieces.copy(), mark.exits.copy()
        self.on, self.speed, self.ahead = mark.on, mark.speed, mark.ahead

    def run(self, seconds: float) -> Numbers | None:
        """Run for a time; what stands at the end if it was reached."""
        while self.pieces:
            if seconds <= 0.0:
                return None
            piece = self.pieces[0]
            room = piece.length - self.on
            took, way, self.speed = _phase(
                self.speed, piece.speed, piece.acceleration, self._exits[0], room, seconds
            )
            seconds -= took
            if way < room - NO_LENGTH:
                self.on += way
                self.ahead -= way
            else:
                ended = self._leave()
                if ended is not None:
                    return ended
        return None

    def coast(self, seconds: float, rate: float) -> Numbers | None:
        """Slow down to rest at a rate, or faster if the end is nearer; what stands at the end if it was reached."""
        rate = max(rate, self.speed * self.speed / (2.0 * max(self.ahead, NO_LENGTH)))
        until = min(seconds, self.speed / rate)
        way = (self.speed - 0.5 * rate * until) * until
        self.speed = max(0.0, self.speed - rate * seconds)
        while self.pieces and self.on + way >= self.pieces[0].length - NO_LENGTH:
            way -= self.pieces[0].length - self.on
            ended = self._leave()
            if ended is not None:
                return ended
        self.on += way
        self.ahead -= way
        return None

    def _leave(self) -> Numbers | None:
        """Go over to the next piece; what stands at the end if there is none."""
        done = self.pieces.pop(0)
        if self._exits:
            self._exits.pop(0)
        self.ahead -= done.length - self.on
        self.on = 0.0
        if self.pieces:
            return None
        self.speed = self.ahead = 0.0
        return done.at(done.length)


def _phase(
    speed: float, limit: float, rate: float, leaving: float, room: float, seconds: float
) -> tuple[float, float, float]:
    """One stretch at constant acceleration: the time it takes, the way run, and the speed at its end.

    Args:
        speed: now.
        limit: to be reached and kept.
        rate: acceleration and deceleration.
        leaving: speed at which the room must be left.
        room: distance at which the stretch ends at the latest.
        seconds: time in which it ends at the latest.
    """
    braking = (speed * speed - leaving * leaving) / (2.0 * rate)
    if braking >= room * (1.0 - 1e-12):
        gain, reached = -rate if leaving > 0.0 else -max(rate, speed * speed / (2.0 * room)), leaving
        lasts = (leaving - speed) / gain
    elif speed > limit * (1.0 + 1e-12):
        gain, reached, lasts = -rate, limit, (speed - limit) / rate
    elif speed < limit * (1.0 - 1e-12):
        reached = min(limit, math.sqrt(rate * room + 0.5 * (speed * speed + leaving * leaving)))
        gain, lasts = rate, (reached - speed) / rate
    else:
        gain, reached, lasts = 0.0, speed, (room - braking) / speed
    took = min(max(lasts, SHORTEST), seconds)
    way = (speed + 0.5 * gain * took) * took
    if way > room:
        root = math.sqrt(max(speed * speed + 2.0 * gain * room, 0.0))
        took = 2.0 * room / (speed + root) if speed + root > 0.0 else took
        return took, room, root
    # Rounding must not leave the speed beside the one that was to be reached: the next stretch would mend it for ever.
    return took, way, reached if took >= lasts else speed + gain * took
