"""Moves of the tool that are told while it moves: how long they take, where they lead, how fast the tool is."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from planning import ReachError, arm, load_cell
from planning.pose import pose_from_vector
from robot.simulation.motions.frame import frame_of
from robot.simulation.motions.streaming import standing
from robot.simulation.motions.tool_motion import ToolMotion
from robot.simulation.motions.tool_pieces import Target

START = np.array([-300.0, -600.0, 300.0])
DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def ur10e():
    cell = load_cell("ur10e-demo")
    return arm(cell.robot.model), np.radians(cell.robot.joint_limit_deg)


def pose(place, turn=(0.0, 0.0, 0.0)):
    made = np.eye(4)
    made[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ DOWN
    made[:3, 3] = START + place
    return made


def motion(ur10e, ask=lambda: None):
    """At rest with the tool at START, pointing down."""
    model, limit = ur10e
    tool = pose_from_vector(np.array([[0.0, 0.0, 100.0, 0.0, 0.0, 0.0]]))[0]
    joints = model.inverse((pose([0, 0, 0]) @ np.linalg.inv(tool))[None])[0]
    chosen = joints[~np.isnan(joints).any(axis=1)][0]
    made = ToolMotion(model, tool, standing(model, tool, tuple(chosen.tolist())), limit.tolist(), ask)
    assert np.allclose(made.state.pose[:3], START)
    return made


def target(place, speed=100.0, acceleration=500.0, blend=0.0, **more):
    turn = more.pop("turn", (0.0, 0.0, 0.0))
    return Target(frame_of(pose(place, turn)), speed, acceleration, blend, **more)


def run(ur10e, targets, seconds=0.002, slider=1.0):
    """Tell target after target, each when it is asked for; time, places and speeds, a row a cycle."""
    waiting = list(targets)
    moving = motion(ur10e, lambda: moving.add(waiting.pop(0)) if waiting else None)
    moving.add(waiting.pop(0))
    rows, time = [], 0.0
    while not moving.finished:
        moving.advance(seconds, seconds * slider, slider)
        if moving.finished and waiting:
            moving.add(waiting.pop(0))
        time += seconds
        rows.append([time, *moving.state.pose[:3], math.hypot(*moving.state.tool_speed[:3])])
        assert time < 20.0
    return np.array(rows), moving


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


@pytest.mark.parametrize("degrees", [10.0, 45.0, 90.0, 135.0, 170.0])
@pytest.mark.parametrize("blend", [2.0, 10.0])
def test_a_blend_stays_within_its_radius_and_keeps_its_speed(ur10e, degrees, blend):
    angle = math.radians(degrees)
    corner, end = np.array([100.0, 0, 0]), np.array([100 + 100 * math.cos(angle), 100 * math.sin(angle), 0])
    rows, _ = run(ur10e, [target(corner, blend=blend), target(end)])
    places, speeds = rows[:, 1:4] - START, rows[:, 4]
    assert np.allclose(places[-1], end, atol=1e-9)
    # Off the two lines only within the radius of the corner, and never by more than an arc that touches both.
    along = np.array([math.cos(angle), math.sin(angle), 0])
    off = np.minimum(
        np.hypot(places[:, 1], np.maximum(places[:, 0] - 100.0, 0.0)),
        np.linalg.norm(places - corner - ((places - corner) @ along)[:, None] * along, axis=1),
    )
    near = np.linalg.norm(places - corner, axis=1) < blend
    assert near.any()
    assert off[~near].max() < 1e-6
    bulge = blend / math.tan(angle / 2) * (1 / math.cos(angle / 2) - 1)
    assert np.linalg.norm(places - corner, axis=1).min() >= bulge - 1e-6
    assert np.linalg.norm(places - corner, axis=1).min() <= bulge + 0.2
    time = rows[:, 0]
    cruising = (time > 0.2 + 1e-9) & (time < time[-1] - 0.2 - 0.004)
    assert np.abs(speeds[cruising] - 100.0).max() < 0.5
    # It takes as long as a straight line of the same length.
    length = 200.0 - 2.0 * blend + blend / math.tan(angle / 2) * angle
    assert time[-1] == pytest.approx(length / 100.0 + 0.2, abs=0.003)


def test_a_target_that_nobody_follows_up_is_reached_at_rest(ur10e):
    rows, moving = run(ur10e, [target([100, 0, 0], blend=5.0)])
    assert np.allclose(rows[-1, 1:4] - START, [100, 0, 0], atol=1e-9)
    assert moving.resting
    assert (rows[:, 1] - START[0]).max() <= 100.0 + 1e-9


def test_a_target_told_late_is_still_reached_without_a_jump(ur10e):
    moving = motion(ur10e)
    moving.add(target([100, 0, 0], blend=20.0))
    places, late = [], 0
    told = False
    while not moving.finished:
        moving.advance(0.002, 0.002, 1.0)
        late += moving.asking
        if late == 50 and not told:
            told = True
            moving.add(target([100, 100, 0]))
        places.append(moving.state.pose[:3])
    places = np.array(places) - START
    assert told
    assert np.allclose(places[-1], [100, 100, 0], atol=1e-9)
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() <= 100.0 * 0.002 * 1.001


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
