"""Lines and arcs that the tool runs along: its frame by the distance run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from planning import ReachError

from .frame import Numbers, rotation_between, turned

if TYPE_CHECKING:
    from collections.abc import Callable

TURN_LENGTH = 100.0  # mm of travel that a turn by one radian counts as
NO_LENGTH = 1e-9  # mm


@dataclass(frozen=True)
class Target:
    """Where a move leads, and how.

    Attributes:
        frame: of the tool, mm.
        speed: mm/s.
        acceleration: mm/s².
        blend: radius at the target, mm.
        via: a place that an arc to the target passes through, mm; None for a line.
        keeps: whether the tool keeps its orientation to the arc.
    """

    frame: Numbers
    speed: float
    acceleration: float
    blend: float = 0.0
    via: Numbers | None = None
    keeps: bool = False


@dataclass(frozen=True)
class Piece:
    """A line or an arc: the tool's frame by the distance run along it, to its end."""

    length: float
    speed: float
    acceleration: float
    frame_at: Callable[[float], Numbers]


@dataclass(frozen=True)
class Leg:
    """A line from target to target; what is run of it is counted in travel, mm."""

    start: Numbers
    end: Numbers
    direction: Numbers  # of unit length, or (0, 0, 0) for a turn on the spot
    distance: float
    travel: float
    turn: Numbers  # from start to end, rad

    @classmethod
    def between(cls, start: Numbers, end: Numbers) -> Leg:
        step = [b - a for a, b in zip(start[9:], end[9:], strict=True)]
        distance = math.hypot(*step)
        turn = rotation_between(start, end)
        direction = tuple(x / distance for x in step) if distance > NO_LENGTH else (0.0, 0.0, 0.0)
        travel = max(distance, TURN_LENGTH * math.hypot(*turn))
        return cls(start, end, direction, distance, travel, turn)

    def oriented(self, share: float) -> Numbers:
        """The frame with the orientation at a share of the line, at the line's start."""
        return turned(self.start, [share * r for r in self.turn])

    def frame(self, share: float) -> Numbers:
        """The frame at a share of the line."""
        if share >= 1.0:
            return self.end
        way = share * self.distance
        place = (a + way * d for a, d in zip(self.start[9:], self.direction, strict=True))
        return (*self.oriented(share)[:9], *place)


def rounding(before: Leg, after: Leg, radius: float, bend: float, target: Target) -> Piece:
    """The arc that touches two lines at a distance from their corner."""
    curvature = radius / math.tan(0.5 * bend)
    length = curvature * bend
    u, v = before.direction, after.direction
    start = [c - radius * d for c, d in zip(before.end[9:], u, strict=True)]
    inward = [(b - math.cos(bend) * a) / math.sin(bend) for a, b in zip(u, v, strict=True)]

    def frame_at(on: float) -> Numbers:
        angle = bend * min(on / length, 1.0)
        sine, rise = curvature * math.sin(angle), curvature * (1.0 - math.cos(angle))
        place = (p + sine * a + rise * n for p, a, n in zip(start, u, inward, strict=True))
        half = angle / (0.5 * bend)
        if half < 1.0:
            oriented = before.oriented(1.0 - (1.0 - half) * radius / before.distance)
        else:
            oriented = after.oriented((half - 1.0) * radius / after.distance)
        return (*oriented[:9], *place)

    return Piece(length, target.speed, target.acceleration, frame_at)


def arc_through(start: Numbers, target: Target) -> Piece:
    """The arc from a frame through a place to a target.

    Raises:
        ReachError: the three places lie on a line.
    """
    assert target.via is not None
    a = [v - s for v, s in zip(target.via, start[9:], strict=True)]
    b = [e - s for e, s in zip(target.frame[9:], start[9:], strict=True)]
    normal = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    size = math.hypot(*normal)
    if size < 1e-9 * max(1.0, math.hypot(*a) * math.hypot(*b)):
        raise ReachError("the start, the via point and the end of a circular move lie on a line")
    aa, bb, ab = (sum(p * q for p, q in zip(x, y, strict=True)) for x, y in ((a, a), (b, b), (a, b)))
    fa, fb = bb * (aa - ab) / (2.0 * size * size), aa * (bb - ab) / (2.0 * size * size)
    centre = [s + fa * p + fb * q for s, p, q in zip(start[9:], a, b, strict=True)]
    z = [n / size for n in normal]
    x = [s - c for s, c in zip(start[9:], centre, strict=True)]
    radius = math.hypot(*x)
    x = [p / radius for p in x]
    y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]]
    end = [e - c for e, c in zip(target.frame[9:], centre, strict=True)]
    angle = math.atan2(*(sum(p * q for p, q in zip(end, axis, strict=True)) for axis in (y, x))) % (
        2.0 * math.pi
    )
    length = radius * angle
    turn = [angle * n for n in z] if target.keeps else rotation_between(start, target.frame)
    travel = max(length, TURN_LENGTH * math.hypot(*turn))

    def frame_at(on: float) -> Numbers:
        share = min(on / travel, 1.0)
        cosine, sine = radius * math.cos(share * angle), radius * math.sin(share * angle)
        place = (c + cosine * p + sine * q for c, p, q in zip(centre, x, y, strict=True))
        return (*turned(start, [share * r for r in turn])[:9], *place)

    return Piece(travel, target.speed, target.acceleration, frame_at)
