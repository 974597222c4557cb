"""Lines and arcs that the tool runs along from target to target, and how one is rounded into the next."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from planning import ReachError

from .course import NO_LENGTH, Piece
from .frame import Numbers, rotation_between, turned

TURN_LENGTH = 100.0
"""Travel that a turn by one radian counts as, mm."""

STRAIGHT = 1e-6
"""Angle below which a corner is none, rad."""

KNOTS = 64
"""Stretches in which a blend that is no circle is measured."""


@dataclass(frozen=True)
class Target:
    """Where a move leads, and how.

    Attributes:
        frame: of the tool, mm.
        speed: mm/s.
        acceleration: mm/s².
        blend: radius at the target, mm.
        seconds: what the move takes in place of its speed and acceleration, or 0.
        via: a place that an arc to the target passes through, mm; None for a line.
        keeps: whether the tool keeps its orientation to the arc.
    """

    frame: Numbers
    speed: float
    acceleration: float
    blend: float = 0.0
    seconds: float = 0.0
    via: Numbers | None = None
    keeps: bool = False


class Line:
    """A straight way from one frame to another, with an even turn.

    Attributes:
        end: its last frame.
        length: mm; of a turn on the spot what it counts as.
        pace: its largest speed as a share of what a move asks for: less where it turns more than it travels.
        first, last: unit vectors of its direction at its ends; None for a turn on the spot.
        turn: rotation vector from its start to its end, rad.
    """

    def __init__(self, start: Numbers, end: Numbers) -> None:
        self.start, self.end = start, end
        step = [b - a for a, b in zip(start[9:], end[9:], strict=True)]
        distance = math.hypot(*step)
        self.turn = rotation_between(start, end)
        self.length, self.pace = _measure(distance, self.turn)
        self.first = self.last = tuple([x / distance for x in step]) if distance > NO_LENGTH else None
        self._step = step

    def at(self, on: float) -> Numbers:
        """The frame at a distance from the start."""
        if on >= self.length:
            return self.end
        share = on / self.length
        x, y, z = self.turn
        dx, dy, dz = self._step
        frame = turned(self.start, (share * x, share * y, share * z))
        return (*frame[:9], frame[9] + share * dx, frame[10] + share * dy, frame[11] + share * dz)


class Arc:
    """An arc from a frame through a place to a target; as a `Line` otherwise.

    Raises:
        ReachError: the three places lie on a line.
    """

    def __init__(self, start: Numbers, via: Numbers, end: Numbers, *, keeps: bool) -> None:
        a = [v - s for v, s in zip(via, start[9:], strict=True)]
        b = [e - s for e, s in zip(end[9:], start[9:], strict=True)]
        normal = _cross(a, b)
        size = math.hypot(*normal)
        if size < 1e-9 * max(1.0, math.hypot(*a) * math.hypot(*b)):
            raise ReachError("the start, the via point and the end of a circular move lie on a line")
        aa, bb, ab = _dot(a, a), _dot(b, b), _dot(a, b)
        fa, fb = bb * (aa - ab) / (2.0 * size * size), aa * (bb - ab) / (2.0 * size * size)
        self._centre = [s + fa * p + fb * q for s, p, q in zip(start[9:], a, b, strict=True)]
        z = [n / size for n in normal]
        x = [s - c for s, c in zip(start[9:], self._centre, strict=True)]
        self._radius = math.hypot(*x)
        self._x = [p / self._radius for p in x]
        self._y = _cross(z, self._x)
        out = [e - c for e, c in zip(end[9:], self._centre, strict=True)]
        self._angle = math.atan2(_dot(out, self._y), _dot(out, self._x)) % (2.0 * math.pi)
        self.start = start
        self.turn = tuple([self._angle * n for n in z]) if keeps else rotation_between(start, end)
        self.length, self.pace = _measure(self._radius * self._angle, self.turn)
        if keeps:
            self.pace = 1.0  # it turns because it travels
        self.first = tuple(self._y)
        self.last = self._along(self._angle)
        self.end = turned(start, self.turn) if keeps else end
        self.end = (*self.end[:9], *end[9:])

    def _along(self, angle: float) -> Numbers:
        c, s = math.cos(angle), math.sin(angle)
        return tuple([c * q - s * p for p, q in zip(self._x, self._y, strict=True)])

    def at(self, on: float) -> Numbers:
        """The frame at a distance from the start."""
        if on >= self.length:
            return self.end
        share = on / self.length
        c, s = self._radius * math.cos(share * self._angle), self._radius * math.sin(share * self._angle)
        frame = turned(self.start, [share * r for r in self.turn])
        place = [m + c * p + s * q for m, p, q in zip(self._centre, self._x, self._y, strict=True)]
        return (*frame[:9], *place)


_TRIED = tuple(i / 8 for i in range(9))

Leg = Line | Arc

Place = Callable[[float], list[float]]


def corner_between(before: Leg, after: Leg) -> float:
    """The angle by which the direction changes from one leg to the next, rad; pi where one turns on the spot."""
    if before.last is None or after.first is None:
        return math.pi
    u, v = before.last, after.first
    return math.atan2(math.hypot(*_cross(u, v)), _dot(u, v))


def rounding(before: Leg, after: Leg, radius: float, bend: float, target: Target) -> tuple[Piece, float]:
    """The blend that leaves one leg at a distance before its end and joins the next at the same distance behind.

    Between lines it is the arc that touches both, else a curve whose distance from the corner is less than the radius.
    Orientation goes over evenly from the one's turn to the other's. With it comes its pace, as a leg has one.
    """
    w1, w2 = ([radius / leg.length * r for r in leg.turn] for leg in (before, after))
    if not (isinstance(before, Line) and isinstance(after, Line)):
        length, place = _curve(before, after, radius)
    elif bend < STRAIGHT:
        length, place = 2.0 * radius, _straight(before, radius)
    else:
        length, place = _circle(before, after, radius, bend)
    corner, steep = before.end, length / radius

    def at(on: float) -> Numbers:
        u = min(on / length, 1.0)
        left, gained = _fading(u, steep), _fading(1.0 - u, steep)
        frame = turned(corner, [-left * r for r in w1])
        frame = turned(frame, [gained * r for r in w2])
        return (*frame[:9], *place(on))

    a, b = math.hypot(*w1), math.hypot(*w2)
    fastest = max(_slope(u, steep) * a + _slope(1.0 - u, steep) * b for u in _TRIED) if a + b > 0.0 else 0.0
    pace = length / (TURN_LENGTH * fastest) if TURN_LENGTH * fastest > length else 1.0
    return Piece(length, target.speed * pace, target.acceleration * pace, at, towards=after.end), pace


def _fading(u: float, steep: float) -> float:
    """What is left of a turn at a share of the blend: from 1, as steeply as on the leg before, evenly to 0."""
    return 1.0 + u * (-steep + u * ((2.0 * steep - 3.0) + u * (2.0 - steep)))


def _slope(u: float, steep: float) -> float:
    return abs(-steep + u * (2.0 * (2.0 * steep - 3.0) + u * 3.0 * (2.0 - steep)))


def _straight(before: Line, radius: float) -> Place:
    """The place at each distance of a blend that only turns the tool."""
    u = before.last
    assert u is not None
    start = [c - radius * d for c, d in zip(before.end[9:], u, strict=True)]
    return lambda on: [p + on * d for p, d in zip(start, u, strict=True)]


def _circle(before: Line, after: Line, radius: float, bend: float) -> tuple[float, Place]:
    """Length, and the place at each distance, of an arc between lines."""
    curvature = radius / math.tan(0.5 * bend)
    u, v = before.last, after.first
    assert u is not None
    assert v is not None
    start = [c - radius * d for c, d in zip(before.end[9:], u, strict=True)]
    c, s = math.cos(bend), math.sin(bend)
    inward = [(b - c * a) / s for a, b in zip(u, v, strict=True)]
    length = curvature * bend

    def place(on: float) -> list[float]:
        angle = on / curvature
        sine, rise = curvature * math.sin(angle), 2.0 * curvature * math.sin(0.5 * angle) ** 2
        return [p + sine * a + rise * n for p, a, n in zip(start, u, inward, strict=True)]

    return length, place


def _curve(before: Leg, after: Leg, radius: float) -> tuple[float, Place]:
    """The same of the curve that slows down along the one leg while it speeds up along the other."""

    def by_share(u: float) -> list[float]:
        a = before.at(before.length - radius * (1.0 - u) * (1.0 - u))
        b = after.at(radius * u * u)
        return [p + q - c for p, q, c in zip(a[9:], b[9:], before.end[9:], strict=True)]

    places = [by_share(i / KNOTS) for i in range(KNOTS + 1)]
    steps = [math.dist(p, q) for p, q in pairwise(places)]
    along = [0.0]
    for step in steps:
        along.append(along[-1] + step)

    def place(on: float) -> list[float]:
        i = min(bisect_right(along, on), KNOTS) - 1
        return by_share((i + min((on - along[i]) / steps[i], 1.0)) / KNOTS)

    return along[-1], place


def _measure(distance: float, turn: Numbers) -> tuple[float, float]:
    """Length and pace of a leg."""
    counted = TURN_LENGTH * math.hypot(*turn)
    if distance <= NO_LENGTH:
        return counted, 1.0
    return distance, min(1.0, distance / counted) if counted > 0.0 else 1.0


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Sequence[float], b: Sequence[float]) -> list[float]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
