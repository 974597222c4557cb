"""The pump law: how much to command now, so that the right amount leaves the nozzle where it will be then.

A command shows at the nozzle one dead time later and through a first-order lag T. So the flow is planned not for
the place of the tool but for the place it will have reached by then, and the lag is inverted there:

    Q = c · (k · q(τ⁺) + T · k² · dq/dτ(τ⁺)),      τ⁺ = τ + k · (dead time + latency),      0 ≤ Q ≤ Q_max

τ is the *plan time* of the tool's place, i.e. when the plan has it there; k is the rate at which plan time should
pass, the controller's speed scaling times its target fraction; q(τ) is the planned flow, 0 outside beads. Just before
a bead τ⁺ is already inside it: that is the lead. Just before its end τ⁺ has left it: that is the cut-off.

c is measured speed over planned speed, taken as the plan time that has passed over the plan time that should have,
during the last moments. At a single moment that ratio is noise: a robot runs each move at one speed where the plan
has a ramp, and stands where the plan begins from rest. Over a short while it makes the volume come out right, because
the sum of c · k over process time is the plan time that has passed.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planning import Program

from .chunks import Chunk

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

RATIO_MAX = 1.5
"""Largest ratio of measured to planned speed that the flow follows."""

RATIO_WINDOW = 0.1
"""Process time over which that ratio is taken, s."""


@dataclass(frozen=True, eq=False)
class Schedule:
    """When the plan has the tool where, and with which flow; one entry per move of a chunk.

    Attributes:
        begin, end: plan time at the start and the end of each move, shape (m,), s; never decreasing.
        speed_begin, speed_end: planned TCP speed there, shape (m,), mm/s.
        flow_begin, flow_end: planned flow there, shape (m,), mm³/s; 0 outside beads.
        printing: whether a move lays a bead, shape (m,).
        length: of each move, shape (m,), mm.
        before_bead: on the approach to a bead, the way left to it from the end of the move, shape (m,), mm; NaN
            elsewhere.
        bead_begin: plan time at which that bead begins, shape (m,), s; NaN elsewhere.
        acceleration: of the TCP, mm/s².
    """

    begin: Array
    end: Array
    speed_begin: Array
    speed_end: Array
    flow_begin: Array
    flow_end: Array
    printing: Mask
    length: Array
    before_bead: Array
    bead_begin: Array
    acceleration: float


def schedule(program: Program, chunk: Chunk, acceleration: float) -> Schedule:
    """The schedule of a chunk.

    Args:
        program: the program.
        chunk: one of its chunks.
        acceleration: of the TCP, mm/s².
    """
    target, printing = chunk.target, chunk.printing
    length = np.linalg.norm(program.positions[target] - program.positions[target - 1], axis=1)
    before_bead, bead_begin = np.full(len(target), np.nan), np.full(len(target), np.nan)
    for bead in np.flatnonzero(printing[1:] & ~printing[:-1]) + 1:
        left = 0.0
        for move in range(bead - 1, -1, -1):
            if chunk.segment[move] != chunk.segment[bead - 1]:
                break
            before_bead[move], bead_begin[move] = left, program.time[target[bead] - 1]
            left += float(length[move])
    return Schedule(
        begin=program.time[target - 1],
        end=program.time[target],
        speed_begin=program.speed[target - 1],
        speed_end=program.speed[target],
        flow_begin=np.where(printing, program.flow[target - 1], 0.0),
        flow_end=np.where(printing, program.flow[target], 0.0),
        printing=printing,
        length=length,
        before_bead=before_bead,
        bead_begin=bead_begin,
        acceleration=acceleration,
    )


def time_to_rest(distance: float, speed: float, acceleration: float) -> float:
    """Time until standing still a distance ahead, moving with a speed and braking as late as possible, s."""
    braking = speed * speed / (2.0 * acceleration)
    near = math.sqrt(2.0 * min(distance, braking) / acceleration)
    return near + max(distance - braking, 0.0) / speed


def plan_time(plan: Schedule, move: int, fraction: float) -> float:
    """Plan time at a place, s.

    The speed changes evenly in time along a move. On the approach to a bead plan time is counted back from the
    bead, with the way the arm brakes there: the lead needs the time that really remains.
    """
    v0, v1 = float(plan.speed_begin[move]), float(plan.speed_end[move])
    if not math.isnan(plan.bead_begin[move]):
        left = float(plan.before_bead[move] + (1.0 - fraction) * plan.length[move])
        return float(plan.bead_begin[move]) - time_to_rest(left, max(v0, v1), plan.acceleration)
    mean = 0.5 * (v0 + v1)
    root = math.sqrt(max(v0 * v0 + 2.0 * (v1 - v0) * fraction * mean, 0.0))
    share = 2.0 * fraction * mean / (v0 + root) if v0 + root > 0 else fraction
    begin, end = float(plan.begin[move]), float(plan.end[move])
    return begin + share * (end - begin)


def planned_flow(plan: Schedule, time: float) -> tuple[float, float]:
    """Planned flow, mm³/s, and its change in plan time, mm³/s², at a plan time."""
    move = int(np.searchsorted(plan.end, time, side="right"))
    if move == len(plan.end) or not plan.printing[move] or time < plan.begin[move]:
        return 0.0, 0.0
    span = float(plan.end[move] - plan.begin[move])
    slope = float(plan.flow_end[move] - plan.flow_begin[move]) / span
    return float(plan.flow_begin[move]) + slope * (time - float(plan.begin[move])), slope


@dataclass(frozen=True)
class Calibration:
    """What the law knows about pump and command loop.

    Attributes:
        dead_time: from a command until the flow begins to answer, s.
        lag: time constant of the answer, s.
        flow_max: largest flow, mm³/s.
    """

    dead_time: float
    lag: float
    flow_max: float


class Ratio:
    """Measured over planned speed during the last moments: 1 where the robot keeps to its plan."""

    def __init__(self) -> None:
        self._surplus = 0.0  # plan time that has passed beyond what should have, in all
        self._before: tuple[float, float] | None = None
        self._window: deque[tuple[float, float]] = deque()

    def update(self, time: float, now: float, rate: float, *, counts: bool) -> float:
        """The ratio after a measurement, from 0 to `RATIO_MAX`.

        Args:
            time: process time, s.
            now: plan time of the tool's place, s.
            rate: at which plan time should pass.
            counts: whether the tool is in a bead or about to be; elsewhere it counts as keeping to its plan.
        """
        if self._before is not None and counts:
            then, was = self._before
            self._surplus += (now - was) - rate * (time - then)
        self._before = (time, now)
        self._window.append((time, self._surplus))
        while len(self._window) > 1 and self._window[1][0] <= time - RATIO_WINDOW:
            self._window.popleft()
        should = rate * RATIO_WINDOW
        ratio = 1.0 + (self._surplus - self._window[0][1]) / should if should > 0.0 else 1.0
        return min(max(ratio, 0.0), RATIO_MAX)


class PumpLaw:
    """The law for one chunk.

    Args:
        plan: the chunk's schedule.
        pump: the pump's calibration.
    """

    def __init__(self, plan: Schedule, pump: Calibration) -> None:
        self._plan, self._pump = plan, pump
        self._ratio = Ratio()

    def flow(self, move: int, fraction: float, *, time: float, rate: float, latency: float = 0.0) -> float:
        """The flow to command now, mm³/s.

        Args:
            move, fraction: where the tool is.
            time: process time, s.
            rate: k, at which plan time should pass.
            latency: process time from this measurement until the command acts in the drive, s.
        """
        now = plan_time(self._plan, move, fraction)
        flow, slope = planned_flow(self._plan, now + rate * (self._pump.dead_time + latency))
        ratio = self._ratio.update(time, now, rate, counts=flow > 0.0)
        wanted = ratio * (rate * flow + self._pump.lag * rate * rate * slope)
        return min(max(wanted, 0.0), self._pump.flow_max)
