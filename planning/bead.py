"""A bead: the waypoints of one curve, with speeds that a pump can follow.

A pump answers late and gradually, as dead time and first-order lag T. Its flow follows the nozzle without blobs
if the speed changes no faster than the flow can. A bead therefore starts with constant acceleration over a
time of 2 T, and ends on an exponential of time constant 1.1 T, along which the inverted lag Q + T dQ/dt stays just
above 0. At the cut-off the flow is down to `end_speed` of its value, and so is what still drips afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from twins import Curve

Array = npt.NDArray[np.float64]

START_LAGS = 2.0
"""Shortest time of the start ramp, in lags; longer where the pump has little head room for 1 + 1 / START_LAGS."""

MOST_START_LAGS = 10.0

END_LAGS = 1.1
"""Time constant of the end ramp, in lags."""

_START_STEPS = 10
_END_RATIO = 0.75
_NEAR = 0.02
"""A ramp's waypoint nearer than this to a point of the curve is left out, mm."""


@dataclass(frozen=True, eq=False)
class Bead:
    """One curve as it is driven, n waypoints.

    Attributes:
        points: in the layer's plane, shape (n, 2), mm; a closed curve ends where it starts.
        width: shape (n,), mm.
        speed: TCP speed on arrival, shape (n,), mm/s; 0 at the first.
    """

    points: Array
    width: Array
    speed: Array


@dataclass(frozen=True)
class Ramp:
    """Speed along a bead of a given length.

    Attributes:
        length: mm.
        acceleration: at the start, mm/s².
        decay: time constant at the end, s.
        cruise: speed between the ramps, mm/s.
        end: speed at the end, mm/s.
    """

    length: float
    acceleration: float
    decay: float
    cruise: float
    end: float

    @classmethod
    def along(
        cls,
        length: float,
        speed: float,
        end_speed: float,
        lag: float,
        acceleration: float = np.inf,
        head_room: float = np.inf,
    ) -> Ramp:
        """The ramp of a bead; where it is too short for its speed, the cruising speed is lowered.

        Args:
            length: of the bead, mm.
            speed: wanted, mm/s.
            end_speed: share of `speed` at the end.
            lag: the pump's time constant T, s.
            acceleration: the robot's, mm/s²; no ramp is steeper.
            head_room: the pump's largest flow over the bead's.
        """
        lags = float(np.clip(1.0 / max(head_room - 1.0, 1e-9), START_LAGS, MOST_START_LAGS))
        acceleration = min(acceleration, speed / max(lags * lag, 1e-9))
        decay, end = max(END_LAGS * lag, speed / acceleration), end_speed * speed
        # Start ramp v²/2a plus end ramp (v - e) d must fit into the length.
        b = decay * acceleration
        fitting = -b + np.sqrt(b * b + 2.0 * acceleration * (length + end * decay))
        cruise = float(min(speed, fitting))
        return cls(length, acceleration, decay, cruise, min(end, cruise))

    def speed_at(self, place: Array) -> Array:
        """Speed at arc lengths `place`, shape (n,), mm/s."""
        rising = np.sqrt(2.0 * self.acceleration * np.maximum(place, 0.0))
        falling = self.end + np.maximum(self.length - place, 0.0) / self.decay
        speed = np.minimum(np.minimum(rising, falling), self.cruise)
        return np.asarray(speed, dtype=np.float64)

    def places(self) -> Array:
        """Arc lengths where waypoints follow the ramps, ascending."""
        rising = self.cruise * np.arange(1, _START_STEPS + 1) / _START_STEPS
        steps = (
            max(1, int(np.ceil(np.log(self.end / self.cruise) / np.log(_END_RATIO))))
            if self.end < self.cruise
            else 0
        )
        falling = self.cruise * (self.end / self.cruise) ** (np.arange(steps) / max(steps, 1))
        places: Array = np.r_[
            rising**2 / (2.0 * self.acceleration), self.length - (falling - self.end) * self.decay
        ]
        return places


def drive(
    curve: Curve,
    start: int,
    width: float,
    speed: float,
    end_speed: float,
    lag: float,
    acceleration: float = np.inf,
    head_room: float = np.inf,
) -> Bead:
    """The waypoints of a curve.

    Args:
        curve: closed ones are driven once around, open ones from end to end.
        start: index of the point where a closed curve starts; for an open curve 0, or its last point to reverse it.
        width: bead width where the curve has none of its own, mm.
        speed: TCP speed between the ramps, mm/s.
        end_speed: share of `speed` at the end.
        lag: the pump's time constant, s.
        acceleration: the robot's, mm/s².
        head_room: the pump's largest flow over the bead's.
    """
    widths = np.full(len(curve.points), float(width)) if curve.width is None else np.asarray(curve.width)
    if curve.closed:
        order = np.r_[np.arange(start, len(widths)), np.arange(start + 1)]
    else:
        order = np.arange(len(widths)) if start == 0 else np.arange(len(widths))[::-1]
    points, widths = curve.points[order], widths[order]
    place = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    ramp = Ramp.along(float(place[-1]), speed, end_speed, lag, acceleration, head_room)
    extra = ramp.places()
    extra = extra[(extra > _NEAR) & (extra < place[-1] - _NEAR)]
    gap = np.abs(extra[:, None] - place).min(axis=1) if len(extra) else extra
    places = np.sort(np.r_[place, extra[gap > _NEAR]])
    places = places[np.r_[True, np.diff(places) > 0.5 * _NEAR]]
    return Bead(
        points=np.column_stack([np.interp(places, place, points[:, k]) for k in range(2)]),
        width=np.interp(places, place, widths),
        speed=ramp.speed_at(places),
    )
