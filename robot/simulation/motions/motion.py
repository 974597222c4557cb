"""Motions: what moves the arm from one cycle of the controller to the next.

Every motion keeps the arm's state (`ArmState`), advances it by a time and can be braked. Path time differs from
process time by the speed slider: `advance` is given both, and the slider's share.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from .frame import Numbers, turn
from .track import Track, rest_of

STILL: Numbers = (0.0,) * 6


@dataclass(frozen=True)
class ArmState:
    """The arm at one moment.

    Attributes:
        joints: rad.
        joint_speeds: rad/s.
        pose: of the tool in the base frame: mm and a rotation vector in rad.
        tool_speed: mm/s and rad/s.
    """

    joints: Numbers
    joint_speeds: Numbers
    pose: Numbers
    tool_speed: Numbers


class Motion(Protocol):
    """A motion of the arm.

    Attributes:
        state: of the arm now.
        finished: whether it has reached its end.
        resting: whether it stands, at its end or because it was braked.
        mark: what it last passed, or -1.
        throttle_rate: how fast the speed slider may act on it, 1/s.
    """

    state: ArmState
    finished: bool
    resting: bool
    mark: int
    throttle_rate: float

    def advance(self, seconds: float, path_seconds: float, share: float) -> None:
        """Move on by a time of the process and of the path; the slider ends at `share`."""

    def brake(self, tool: float = math.inf, joint: float = math.inf) -> None:
        """From now on slow down until at rest, by mm/s² of the tool or rad/s² of the fastest joint."""

    def resume(self) -> None:
        """Go on after a brake, from rest."""


class TrackMotion:
    """Follows a planned track."""

    def __init__(self, track: Track) -> None:
        self.track = track
        self.throttle_rate = track.throttle_rate
        self.finished = len(track.time) == 1
        self.resting = True
        self.mark = -1
        self._index = 0
        self._time = 0.0
        self._distance = track.distance[0]
        self._speed = 0.0
        self._braking = 0.0  # deceleration along the track, 0 while it follows its plan
        self._marks = iter(track.marks)
        self._next_mark = next(self._marks, None)
        self._see()

    def advance(self, seconds: float, path_seconds: float, share: float) -> None:
        """See `Motion`."""
        if self.finished:
            return
        if self._braking:
            self._coast(seconds)
        else:
            self._follow(path_seconds, share)
        self._see()

    def brake(self, tool: float = math.inf, joint: float = math.inf) -> None:
        """See `Motion`."""
        if self.finished:
            return
        i = self._index
        tool_slope = math.hypot(*self.track.slope[i])
        joint_slope = max(map(abs, self.track.joint_slope[i]))
        along = min(tool / max(tool_slope, 1e-9), joint / max(joint_slope, 1e-9))
        self._braking = max(along, 1e-6)

    def resume(self) -> None:
        """See `Motion`."""
        if not self._braking or self.finished:
            return
        self.track = rest_of(self.track, self._index, self._distance)
        self._index, self._time, self._speed, self._braking = 0, 0.0, 0.0, 0.0

    def _follow(self, path_seconds: float, share: float) -> None:
        track = self.track
        self._time += path_seconds
        i, last = self._index, len(track.time) - 1
        while i < last and track.time[i + 1] <= self._time:
            i += 1
        if i == last:
            self._end()
            return
        self._index = i
        u = self._time - track.time[i]
        gain = (track.speed[i + 1] - track.speed[i]) / (track.time[i + 1] - track.time[i])
        self._distance = track.distance[i] + (track.speed[i] + 0.5 * gain * u) * u
        self._speed = (track.speed[i] + gain * u) * share
        self.resting = False

    def _coast(self, seconds: float) -> None:
        track = self.track
        stop_after = self._speed / self._braking
        t = min(seconds, stop_after)
        self._distance += (self._speed - 0.5 * self._braking * t) * t
        self._speed = max(0.0, self._speed - self._braking * seconds)
        last = len(track.distance) - 1
        while self._index < last and track.distance[self._index + 1] <= self._distance:
            self._index += 1
        self.resting = self._speed == 0.0
        if self._index == last:
            self._end()

    def _end(self) -> None:
        self._index = len(self.track.time) - 1
        self._distance = self.track.distance[-1]
        self._speed = 0.0
        self.finished = self.resting = True

    def _see(self) -> None:
        """The arm's state at the distance run."""
        track, i = self.track, self._index
        while self._next_mark is not None and self._next_mark[0] <= self._distance + 1e-9:
            self.mark = max(self.mark, self._next_mark[1])
            self._next_mark = next(self._marks, None)
        if i == len(track.time) - 1:
            self.state = ArmState(
                track.joints[i], STILL, (*track.positions[i], *turn(track.rotations[i])), STILL
            )
            return
        on, v = self._distance - track.distance[i], self._speed
        part = on / (track.distance[i + 1] - track.distance[i])
        a, b = track.rotations[i], track.rotations[i + 1]
        rotation = a if a == b else [p + part * (q - p) for p, q in zip(a, b, strict=True)]
        joint_slope, slope, spin = track.joint_slope[i], track.slope[i], track.spin[i]
        self.state = ArmState(
            joints=tuple([q + d * on for q, d in zip(track.joints[i], joint_slope, strict=True)]),
            joint_speeds=tuple([d * v for d in joint_slope]),
            pose=(*[p + d * on for p, d in zip(track.positions[i], slope, strict=True)], *turn(rotation)),
            tool_speed=(*[d * v for d in slope], *[d * v for d in spin]),
        )
