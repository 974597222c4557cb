"""Samples are states of the robot, with the pump's flow between its readings."""

import numpy as np
import pytest

from robot.pump import PumpReading
from robot.robot_state import RobotState
from robot.sampling import PERIOD, Sampler


def state(time):
    return RobotState(time, np.array([time, 2.0, 3.0]), 50.0, np.zeros(6), True, True, 1, 1.0)


def test_flow_is_interpolated_between_readings():
    samples = []
    sampler = Sampler(samples.append)
    for i, time in enumerate(np.arange(0.0, 1.0, 0.02)):
        sampler.see(state(float(time)), 7, 2)
        if i % 5 == 0:
            sampler.read(PumpReading(command=900.0, flow=1000.0 * float(time)))
    sampler.flush()
    assert [s.time for s in samples] == pytest.approx(np.arange(0.0, 1.0, 0.02))
    assert [s.flow for s in samples[:46]] == pytest.approx([1000.0 * s.time for s in samples[:46]])
    assert {s.flow for s in samples[46:]} == {samples[45].flow}  # nothing later is known
    assert {(s.command, s.waypoint, s.segment, s.y) for s in samples} == {(900.0, 7, 2, 2.0)}


def test_samples_are_not_denser_than_their_period():
    samples = []
    sampler = Sampler(samples.append)
    for time in np.arange(0.0, 1.0, 0.002):
        sampler.see(state(float(time)), 0, 0)
        sampler.read(PumpReading())
    assert np.diff([s.time for s in samples]).min() >= PERIOD - 1e-9
    assert len(samples) == pytest.approx(1.0 / PERIOD, abs=5)


def test_a_reading_before_any_state_is_no_sample():
    samples = []
    sampler = Sampler(samples.append)
    sampler.read(PumpReading(flow=5.0))
    sampler.flush()
    assert samples == []
