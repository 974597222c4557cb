"""One move of the tool: how long it takes, where it leads, how fast the tool is, and how it is held up."""

import math

import numpy as np
import pytest
from tool_desk import START, demo_arm, motion, pose, run, target

from planning import ReachError
from planning.pose import pose_from_vector


@pytest.fixture(scope="module")
def ur10e():
    return demo_arm()


@pytest.mark.parametrize("seconds", [0.002, 0.008, 0.05])
@pytest.mark.parametrize("length", [5.0, 50.0, 500.0])
def test_a_line_takes_as_long_as_its_trapezoid(ur10e, length, seconds):
    rows, _ = run(ur10e, [target([length, 0, 0])], seconds)
    speed, acceleration = 100.0, 500.0
    ramp = speed**2 / acceleration
    takes = length / speed + speed / acceleration if length > ramp else 2.0 * math.sqrt(length / acceleration)
    assert takes - 1e-9 <= rows[-1, 0] <= takes + 1.01 * seconds
    assert np.allclose(rows[-1, 1:4], START + [length, 0, 0], atol=1e-9)
    # Along it: the way run at each time, in closed form.
    t = np.minimum(rows[:, 0], takes)
    peak = min(speed, math.sqrt(acceleration * length))
    up = peak / acceleration
    way = np.where(t < up, 0.5 * acceleration * t**2, peak * t - peak**2 / (2 * acceleration))
    end = takes - t
    way = np.where(end < up, length - 0.5 * acceleration * end**2, way)
    assert np.allclose(rows[:, 1] - START[0], way, atol=1e-6)
    assert rows[:, 4].max() <= speed * (1 + 1e-9)


def test_the_slider_makes_it_longer(ur10e):
    whole = run(ur10e, [target([200, 0, 0])])[0][-1, 0]
    half = run(ur10e, [target([200, 0, 0])], slider=0.5)[0][-1, 0]
    assert half == pytest.approx(2.0 * whole, abs=0.01)


def test_orientation_turns_evenly_and_ends_where_told(ur10e):
    _, moving = run(
        ur10e, [target([100, 0, 0], blend=10.0, turn=(0, 0, 0.2)), target([100, 100, 0], turn=(0.1, 0, 0.2))]
    )
    found = pose_from_vector(np.array([moving.state.pose]))[0]
    wanted = pose([100, 100, 0], (0.1, 0, 0.2))
    assert np.allclose(found, wanted, atol=1e-9)


def test_a_turn_on_the_spot_takes_its_time(ur10e):
    rows, _ = run(ur10e, [target([0, 0, 0], turn=(0, 0, 0.5))])
    assert np.allclose(rows[:, 1:4], START, atol=1e-9)
    assert rows[-1, 0] == pytest.approx(50.0 / 100.0 + 0.2, abs=0.003)


def test_an_arc_is_run_on_its_circle_at_its_speed(ur10e):
    via = tuple(START + [50.0, 50.0, 0])
    rows, _ = run(ur10e, [target([100, 0, 0], via=via)])
    centre = START + [50.0, 0, 0]
    assert np.abs(np.linalg.norm(rows[:, 1:4] - centre, axis=1) - 50.0).max() < 1e-9
    assert np.allclose(rows[-1, 1:4], START + [100, 0, 0], atol=1e-9)
    assert rows[:, 2].max() - START[1] == pytest.approx(50.0, abs=0.01)
    assert rows[-1, 0] == pytest.approx(50 * math.pi / 100 + 0.2, abs=0.003)


def test_an_arc_through_places_on_a_line_is_refused(ur10e):
    with pytest.raises(ReachError, match="lie on a line"):
        motion(ur10e).add(target([100, 0, 0], via=tuple(START + [50.0, 0, 0])))


def test_braking_stays_on_the_path_and_goes_on(ur10e):
    moving = motion(ur10e)
    moving.add(target([200, 0, 0]))
    for _ in range(500):
        moving.advance(0.002, 0.002, 1.0)
    speed, place = 100.0, moving.state.pose[0]
    moving.brake(tool=1000.0)
    while not moving.resting:
        moving.advance(0.002, 0.002, 1.0)
    assert moving.state.pose[0] - place == pytest.approx(speed**2 / 2000.0, abs=1e-6)
    moving.resume()
    while not moving.finished:
        moving.advance(0.002, 0.002, 1.0)
    assert moving.state.pose[0] - START[0] == pytest.approx(200.0, abs=1e-9)


def test_a_place_out_of_reach_ends_the_move_there(ur10e):
    with pytest.raises(ReachError, match="no inverse kinematics"):
        run(ur10e, [target([-5000, 0, 0], speed=1000.0)])


@pytest.mark.parametrize("seconds", [1.0, 3.0])
def test_a_move_with_a_time_takes_it(ur10e, seconds):
    rows, _ = run(ur10e, [target([120, 0, 0], seconds=seconds)])
    assert rows[-1, 0] == pytest.approx(seconds, abs=0.003)
    turned, _ = run(ur10e, [target([1, 0, 0], seconds=seconds, turn=(0, 0, 0.4))])
    assert turned[-1, 0] == pytest.approx(seconds, abs=0.003)


def test_braking_at_half_speed_goes_on_from_half_speed(ur10e):
    moving = motion(ur10e)
    moving.add(target([200, 0, 0]))
    for _ in range(500):
        moving.advance(0.002, 0.001, 0.5)
    place = moving.state.pose[0]
    moving.brake(tool=1000.0)
    moving.advance(0.002, 0.001, 0.5)
    assert moving.state.tool_speed[0] == pytest.approx(48.0)
    while not moving.resting:
        moving.advance(0.002, 0.001, 0.5)
    assert moving.state.pose[0] - place == pytest.approx(50.0**2 / 2000.0, abs=1e-6)


@pytest.mark.parametrize("after", [5, 60, 100, 500, 1015])
def test_pauses_leave_the_tool_on_its_path(ur10e, after):
    corners = [target([100, 0, 0], blend=10.0), target([100, 100, 0], blend=10.0), target([0, 100, 0])]
    straight = run(ur10e, corners)[0][:, 1:4]
    waiting = list(corners)
    moving = motion(ur10e, lambda: moving.add(waiting.pop(0)) if waiting else None)
    moving.add(waiting.pop(0))
    places = []
    for cycle in range(4000):
        if cycle == after:
            moving.brake(tool=3000.0)
        if cycle == after + 200:
            moving.resume()
        moving.advance(0.002, 0.002, 1.0)
        places.append(moving.state.pose[:3])
    assert moving.finished
    gaps = np.linalg.norm(np.array(places)[:, None] - straight[None], axis=2).min(axis=1)
    assert gaps.max() < 0.15  # places on the way are 0.2 mm apart
