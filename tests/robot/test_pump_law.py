"""The pump law, against a pump integrated in numpy: dead time, then a first-order lag."""

import numpy as np
import pytest

from planning import SegmentKind
from robot.chunks import split
from robot.place import Tracker
from robot.pump_law import Calibration, PumpLaw, Ratio, plan_time, planned_flow, schedule, time_to_rest

STEP = 0.002


class Pump:
    """Flow at the nozzle, exact for a command held over a step."""

    def __init__(self, dead_time, lag):
        self.pipe = [0.0] * round(dead_time / STEP)
        self.decay = np.exp(-STEP / lag) if lag else 0.0
        self.flow = 0.0

    def run(self, told):
        """Volume that leaves the nozzle in one step."""
        self.pipe.append(told)
        held = self.pipe.pop(0)
        before, self.flow = self.flow, held + (self.flow - held) * self.decay
        return 0.5 * (before + self.flow) * STEP


def drive(program, chunk, pump, calibration, rate, slowness=1.0):
    """Move along a chunk as the plan says, at a rate; volume in and outside of beads.

    `slowness` is planned over actual speed of a robot that does not keep up with its plan; it may be a function of
    plan time.
    """
    plan = schedule(program, chunk, 500.0)
    law = PumpLaw(plan, calibration)
    inside = outside = 0.0
    places = [(move, f) for move in range(len(chunk)) for f in np.linspace(0.0, 1.0, 200, endpoint=False)]
    times = np.maximum.accumulate([plan_time(plan, *place) for place in places])
    now, process = times[0], 0.0
    while now < times[-1] + 1.0:
        move, fraction = places[min(int(np.searchsorted(times, now, side="right")) - 1, len(places) - 1)]
        volume = pump.run(law.flow(move, fraction, time=process, rate=rate))
        if plan.printing[move]:
            inside += volume
        else:
            outside += volume
        now += STEP * rate / (slowness(now) if callable(slowness) else slowness)
        process += STEP
    return inside, outside


@pytest.mark.parametrize(("dead_time", "lag"), [(0.2, 0.2), (0.4, 0.2), (0.0, 0.2), (0.2, 0.1)])
def test_what_leaves_the_nozzle_is_the_bead(beads, two_layers, dead_time, lag):
    calibration = Calibration(dead_time, lag, 20_000.0)
    pairs = [drive(two_layers, chunk, Pump(dead_time, lag), calibration, 1.0) for chunk in split(two_layers)]
    inside, outside = np.sum(pairs, axis=0)
    assert inside + outside == pytest.approx(two_layers.bead_volume, rel=0.01)
    assert outside <= 0.005 * two_layers.bead_volume


@pytest.mark.parametrize("rate", [0.2, 0.5, 1.0])
def test_the_slider_changes_the_flow_and_not_the_volume(two_layers, rate):
    chunk = split(two_layers)[0]
    inside, outside = drive(two_layers, chunk, Pump(0.2, 0.2), Calibration(0.2, 0.2, 20_000.0), rate)
    assert inside + outside == pytest.approx(two_layers.bead_volume / 3.0, rel=0.01)
    assert outside <= 0.005 * two_layers.bead_volume / 3.0


@pytest.mark.parametrize("slowness", [0.9, 1.25, lambda now: 1.0 + 0.3 * np.sin(6.0 * now)])
def test_a_robot_off_its_plan_still_gets_the_beads_volume(two_layers, slowness):
    chunk = split(two_layers)[0]
    calibration = Calibration(0.2, 0.2, 20_000.0)
    inside, outside = drive(two_layers, chunk, Pump(0.2, 0.2), calibration, 1.0, slowness)
    assert inside + outside == pytest.approx(two_layers.bead_volume / 3.0, rel=0.02)


def test_nothing_flows_away_from_beads(two_layers):
    for chunk in split(two_layers):
        plan = schedule(two_layers, chunk, 500.0)
        bead = np.flatnonzero(plan.printing)
        law = PumpLaw(plan, Calibration(0.2, 0.2, 20_000.0))
        process = np.linspace(0.0, 1.0, 101)
        lead = [law.flow(bead[0] - 1, f, time=0.67 * f, rate=1.0) for f in process]
        assert lead[0] == 0.0
        assert lead[-1] > 0.0
        assert np.all(np.diff(np.array(lead) > 0) >= 0)  # once it has begun it does not stop again
        for move in range(bead[-1] + 1, len(chunk)):
            assert law.flow(move, 0.5, time=100.0, rate=1.0) == 0.0


def test_the_flow_stays_within_the_pump(two_layers):
    chunk = split(two_layers)[0]
    plan = schedule(two_layers, chunk, 500.0)
    for limit in (100.0, 5000.0):
        law = PumpLaw(plan, Calibration(0.2, 0.2, limit))
        told = [
            law.flow(move, f, time=0.01 * move, rate=1.0)  # a robot much faster than its plan
            for move in range(len(chunk))
            for f in (0.0, 0.5, 1.0)
        ]
        assert min(told) >= 0.0
        assert max(told) == limit


def test_a_slider_at_zero_stops_the_flow(two_layers):
    chunk = split(two_layers)[0]
    law = PumpLaw(schedule(two_layers, chunk, 500.0), Calibration(0.2, 0.2, 20_000.0))
    assert all(law.flow(move, 0.5, time=move, rate=0.0) == 0.0 for move in range(len(chunk)))


def test_a_robot_that_stands_in_a_bead_gets_nothing(two_layers):
    chunk = split(two_layers)[0]
    plan = schedule(two_layers, chunk, 500.0)
    law = PumpLaw(plan, Calibration(0.2, 0.2, 20_000.0))
    middle = int(np.flatnonzero(plan.printing)[12])
    told = [law.flow(middle, 0.5, time=t, rate=1.0) for t in np.arange(0.0, 0.5, STEP)]
    assert told[0] > 0.0
    assert told[-1] < 1e-6


def test_the_ratio_is_that_of_the_speeds():
    for true in (0.3, 0.8, 1.0, 1.2):
        ratio = Ratio()
        found = [ratio.update(t, true * 0.5 * t, 0.5, counts=True) for t in np.arange(0.0, 1.0, STEP)]
        assert found[-1] == pytest.approx(true)
    assert Ratio().update(0.0, 0.0, 1.0, counts=True) == 1.0
    assert Ratio().update(0.0, 0.0, 0.0, counts=True) == 1.0


def test_planned_flow_is_the_programs(two_layers):
    for chunk in split(two_layers):
        plan = schedule(two_layers, chunk, 500.0)
        for segment in two_layers.segments:
            if segment.kind is SegmentKind.PRINT and segment.start in chunk.target:
                for waypoint in range(segment.start + 1, segment.stop - 1):
                    flow, _ = planned_flow(plan, float(two_layers.time[waypoint]))
                    assert flow == pytest.approx(two_layers.flow[waypoint])


def test_plan_time_follows_even_acceleration(two_layers):
    chunk = split(two_layers)[0]
    plan = schedule(two_layers, chunk, 500.0)
    for move in np.flatnonzero(plan.printing):
        begin, end = plan_time(plan, move, 0.0), plan_time(plan, move, 1.0)
        assert (begin, end) == pytest.approx((plan.begin[move], plan.end[move]))
        v0, v1 = plan.speed_begin[move], plan.speed_end[move]
        for part in (0.25, 0.5, 0.75):  # s = v0 t + a t² / 2
            t = part * (end - begin)
            s = v0 * t + 0.5 * (v1 - v0) / (end - begin) * t * t
            assert plan_time(plan, move, s / plan.length[move]) == pytest.approx(begin + t, abs=1e-9)


def test_plan_time_never_runs_back(two_layers):
    for chunk in split(two_layers):
        plan = schedule(two_layers, chunk, 500.0)
        first = int(np.argmax(plan.printing)) - 1
        times = [plan_time(plan, m, f) for m in range(first, len(chunk)) for f in np.linspace(0.0, 1.0, 21)]
        assert np.all(np.diff(times) >= -1e-9)


def test_time_to_rest_is_that_of_even_braking():
    for v, a, extra in ((30.0, 500.0, 10.0), (150.0, 500.0, 0.0), (10.0, 100.0, 3.0)):
        braking = v / a
        assert time_to_rest(0.5 * v * braking + extra, v, a) == pytest.approx(braking + extra / v)
        t = 0.4 * braking
        assert time_to_rest(0.5 * a * t * t, v, a) == pytest.approx(t)


def test_a_tracked_tool_runs_through_plan_time_once(two_layers):
    """A tool on the path, blends included, is found where it is, and never goes back."""
    rng = np.random.default_rng(7)
    for chunk in split(two_layers):
        tracker = Tracker(two_layers, chunk)
        corners = two_layers.positions[np.append(chunk.target[0] - 1, chunk.target)]
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
        before = 0.0
        for s in np.arange(0.0, along[-1], 0.4):
            point = np.array([np.interp(s, along, corners[:, axis]) for axis in range(3)])
            place = tracker.update(point + rng.normal(0.0, 0.02, 3))
            assert place.travelled == pytest.approx(s, abs=1.0)
            assert place.travelled >= before
            before = place.travelled
        assert tracker.length == pytest.approx(along[-1])
