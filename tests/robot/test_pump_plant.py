"""The machine behind the drive against numerical integration, and the laws of what flows through it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from robot.simulation.pump.course import Course
from robot.simulation.pump.first_order import FirstOrder
from robot.simulation.pump.hose import Hose
from robot.simulation.pump.plant import FULL_PRESSURE, Plant, PlantSettings

commands = st.lists(st.tuples(st.floats(0.0, 2.0), st.floats(0.0, 1e4)), max_size=6)
lags = st.one_of(st.just(0.0), st.floats(0.01, 1.0))


@given(commands, st.floats(0.0, 0.5), lags, st.lists(st.floats(0.0, 1.0)))
def test_flow_and_volume_do_not_depend_on_when_they_are_looked_at(changes, dead, lag, looks):
    often, once = Hose(dead, lag), Hose(dead, lag)
    now = pumped = 0.0
    for pause, flow in changes:
        now += pause
        often.command(now, flow)
        once.command(now, flow)
    for look in sorted(looks):
        often.advance(look * now)
        assert often.flow >= 0.0
        assert often.volume >= pumped - 1e-6
        pumped = often.volume
    end = now + dead + 3.0
    often.advance(end)
    once.advance(end)
    assert often.volume == pytest.approx(once.volume, rel=1e-9, abs=1e-6)
    assert often.flow == pytest.approx(once.flow, rel=1e-9, abs=1e-6)


@given(st.floats(0.0, 3.0), st.floats(1.0, 1e4), st.floats(0.0, 0.5), st.floats(0.01, 0.3))
def test_all_that_is_pumped_leaves_the_nozzle(duration, flow, dead, lag):
    hose = Hose(dead, lag)
    hose.command(0.0, flow)
    hose.command(duration, 0.0)
    hose.advance(duration + dead + 60.0 * lag)
    assert hose.volume == pytest.approx(flow * duration, rel=1e-9, abs=1e-9)


def test_a_lag_follows_any_broken_line_as_a_solver_says():
    lag, dead = 0.3, 0.2
    times = [0.0, 0.5, 0.9, 2.0]
    values, slopes = [3.0, -2.0, 5.0, 1.0], [0.0, 4.0, -1.0, 0.0]
    found = FirstOrder(dead, lag)
    for time, value, slope in zip(times, values, slopes, strict=True):
        found.command(time, value, slope)

    def told(t):
        i = np.searchsorted(times, t - dead, side="right") - 1
        return 0.0 if i < 0 else values[i] + slopes[i] * (t - dead - times[i])

    looks = np.linspace(0.0, 3.0, 61)
    solution = solve_ivp(
        lambda t, y: (told(t) - y) / lag, (0.0, 3.0), [0.0], t_eval=looks, max_step=1e-3, rtol=1e-8
    )
    for look, expected in zip(looks, solution.y[0], strict=True):
        found.advance(look)
        assert found.value == pytest.approx(expected, abs=5e-3)


@pytest.mark.parametrize("lag", [0.0, 0.4])
def test_at_a_steady_flow_the_age_is_the_content_over_the_flow(lag):
    content, flow = 19.2e6, 75e3  # 20 m of 35 mm at 4.5 L/min
    hose = Hose(0.2, lag, content=content)
    hose.command(0.0, flow)
    hose.advance(200.0)
    assert hose.age == pytest.approx(200.0)  # still what filled it at first
    hose.advance(1000.0)
    assert hose.age == pytest.approx(content / flow, rel=1e-9)
    hose.command(1000.0, 0.0)  # at rest it grows older by the second
    hose.advance(1100.0)
    before = hose.age
    hose.advance(1150.0)
    assert hose.age - before == pytest.approx(50.0)


@settings(deadline=None, max_examples=50)
@given(commands.filter(lambda c: sum(q for _, q in c) > 100.0), st.floats(0.0, 0.5), lags)
def test_the_age_is_that_of_a_plug(changes, dead, lag):
    """Against the plug flow found on a fine grid: what is a content's volume behind has entered when it was pumped."""
    content = 2000.0
    hose = Hose(dead, lag, content=content)
    now = 0.0
    for pause, flow in changes:
        hose.command(now, flow)
        now += pause
    times = np.linspace(0.0, now + dead + 1.0, 120)
    volumes = []
    for time in times:
        hose.advance(time)
        volumes.append(hose.volume)
        volume = hose.volume - content
        if volume < 0.0:
            assert hose.age == pytest.approx(time)
            continue
        entered = time - hose.age
        # then the pump had moved one content less; between two looks no more than these bounds are known
        i = np.searchsorted(times, entered)
        low, high = volumes[max(i - 1, 0)], volumes[min(i, len(volumes) - 1)]
        assert low - 1e-6 * (1.0 + low) <= volume <= high + 1e-6 * (1.0 + high)


def test_what_is_sucked_back_has_to_be_pushed_forward_again():
    hose = Hose(0.0, 0.1, content=100.0)
    hose.command(0.0, 1000.0)
    hose.command(1.0, -500.0)
    hose.command(1.4, 1000.0)
    hose.advance(1.2)
    at_most = hose.volume
    hose.advance(1.4)
    assert hose.flow == 0.0
    hose.advance(3.0)
    assert hose.volume == pytest.approx(
        1000.0 - 0.4 * 500.0 + 1600.0 - 100.0, rel=1e-6
    )  # less what the lag holds
    assert at_most < 1000.0
    assert hose.flow == pytest.approx(1000.0, rel=1e-5)
    assert hose.age == pytest.approx(0.1, rel=1e-3)


@given(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(0.0, 3.0), st.floats(0.0, 40.0))
def test_a_course_gives_a_volume_at_the_time_that_it_says(speed, target, ramp, volume):
    course = Course(2.0, speed, target, ramp)
    time = course.when(volume)
    grid = 2.0 + np.linspace(0.0, ramp + 3.0, 100)
    given_by = np.array([course.volume(t) for t in grid])
    if time == math.inf:
        assert given_by.max() <= volume + 1e-6
    else:
        assert course.volume(time) == pytest.approx(volume, rel=1e-6, abs=1e-6)
        assert np.all(given_by[grid < time - 1e-9] <= volume + 1e-6)
    whole, _ = quad(course.at, 2.0, 2.0 + ramp + 1.0, points=[2.0 + ramp], limit=200)
    assert course.volume(3.0 + ramp) == pytest.approx(whole, abs=1e-6)


def test_the_hopper_loses_what_leaves_the_nozzle_and_no_more_than_it_has():
    plant = Plant(PlantSettings(flow_max=1000.0, dead_time=0.2, lag=0.1, ramp=2.0, hopper=5000.0))
    plant.run(0.0, 1000.0)
    plant.advance(2.0)
    assert plant.hopper == pytest.approx(5000.0 - 0.5 * 2.0 * 1000.0)
    plant.advance(20.0)
    assert plant.hopper == 0.0
    assert plant.speed == 1000.0  # it turns, and draws air
    assert plant.hose.flow < 1e-9
    assert plant.hose.volume == pytest.approx(5000.0)
    plant.fill(20.0, 300.0)
    plant.advance(30.0)
    assert plant.hose.volume == pytest.approx(5300.0)
    plant.fill(30.0, 1e6)
    plant.advance(31.0)
    plant.run(31.0, 0.0)
    plant.advance(40.0)
    assert plant.hose.volume == pytest.approx(5300.0 + 1e6 - plant.hopper)


def test_the_ramp_takes_its_time():
    plant = Plant(PlantSettings(flow_max=1000.0, ramp=2.0))
    plant.run(0.0, 500.0)
    for time in (0.25, 0.5, 0.75):
        plant.advance(time)
        assert plant.speed == pytest.approx(500.0 * time)
    plant.advance(1.5)
    assert plant.speed == 500.0
    plant.run(1.5, 0.0, ramp=False)
    assert plant.speed == 0.0


def test_the_pressure_answers_with_its_own_lag_and_rises_when_the_hose_is_blocked():
    plant = Plant(PlantSettings(flow_max=1000.0, dead_time=0.5, lag=0.7, pressure_lag=0.3))
    plant.run(0.0, 500.0)
    plant.advance(0.3)
    assert plant.pressure == pytest.approx(0.5 * FULL_PRESSURE * (1.0 - math.exp(-1.0)))
    plant.advance(10.0)
    assert plant.pressure == pytest.approx(0.5 * FULL_PRESSURE)
    plant.block(10.0, 0.5)
    plant.advance(20.0)
    assert plant.pressure == pytest.approx(4.0 * 0.5 * FULL_PRESSURE)
    assert plant.hose.flow == pytest.approx(500.0)  # a pump that displaces
    current = plant.current
    plant.block(20.0, 1.0)
    plant.advance(30.0)
    assert plant.hose.flow < 0.1
    assert plant.pressure > 3.0 * FULL_PRESSURE
    assert plant.current > current
