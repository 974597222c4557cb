"""Moves of the tool that are told while it moves: one goes over into the next within its blend, at its speed."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tool_desk import START, demo_arm, motion, pose, run, target

from planning.pose import pose_from_vector


@pytest.fixture(scope="module")
def ur10e():
    return demo_arm()


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


def polyline(n, length, blend, **more):
    """A circle of n short lines, and its radius, mm."""
    radius = n * length / (2.0 * math.pi)
    angles = 2.0 * math.pi * np.arange(1, n + 1) / n
    places = radius * np.column_stack([np.sin(angles), 1.0 - np.cos(angles), np.zeros(n)])
    return [target(place, blend=blend, **more) for place in places], radius


@pytest.mark.parametrize(("blend", "speed"), [(1.0, 250.0), (0.5, 250.0), (0.5, 100.0)])
def test_a_chain_of_short_lines_is_run_at_its_speed(ur10e, blend, speed):
    # It takes 31 mm to stop from 250 mm/s: many of these lines must be known ahead.
    targets, radius = polyline(500, 2.0, blend, speed=speed, acceleration=1000.0)
    rows, moving = run(ur10e, targets)
    places, speeds = rows[:, 1:4] - START, rows[:, 4]
    way = np.linalg.norm(np.diff(places, axis=0, prepend=np.zeros((1, 3))), axis=1).sum()
    assert rows[-1, 0] == pytest.approx(way / speed + speed / 1000.0, abs=0.004)
    assert way == pytest.approx(1000.0, rel=1e-3)
    off = np.abs(np.hypot(places[:, 0], places[:, 1] - radius) - radius)
    assert off.max() < 2.0**2 / (8.0 * radius) * 1.001  # between the corners of a polyline and its circle
    ramp = speed / 1000.0 + 0.002
    cruising = (rows[:, 0] > ramp) & (rows[:, 0] < rows[-1, 0] - ramp - 0.002)
    assert np.abs(speeds[cruising] / speed - 1.0).max() < 0.005
    assert np.abs(np.diff(speeds)).max() / 0.002 < 1000.0 * (1 + 1e-6)
    assert np.allclose(places[-1], 0.0, atol=1e-9)
    assert moving.resting


def test_a_chain_that_ends_unforeseen_comes_to_rest_at_its_last_target_without_hurry(ur10e):
    targets, _ = polyline(200, 2.0, 0.5, speed=250.0, acceleration=1000.0)
    rows, _ = run(ur10e, targets[:70])
    assert rows[:, 4].max() == pytest.approx(250.0)
    assert np.diff(rows[:, 4]).min() / 0.002 > -1000.0 * (1 + 1e-6)
    assert np.allclose(rows[-1, 1:4], targets[69].frame[9:], atol=1e-9)


@pytest.mark.parametrize("degrees", [45.0, 90.0, 120.0])
def test_a_process_move_keeps_its_speed_through_a_tight_blend(ur10e, degrees):
    angle = math.radians(degrees)
    end = np.array([100.0, 0, 0]) + 100.0 * np.array([math.cos(angle), math.sin(angle), 0])
    more = {"blend": 2.0, "acceleration": 500.0}
    rows, _ = run(ur10e, [target([100, 0, 0], **more), target(end, **more | {"blend": 0.0})])
    middle = rows[(rows[:, 0] > 0.3) & (rows[:, 0] < rows[-1, 0] - 0.3), 4]
    assert np.abs(middle / 100.0 - 1.0).max() < 0.005


def test_a_blend_lets_the_tool_go_straight_on(ur10e):
    places = [[20.0 * i, 0, 0] for i in range(1, 11)]
    rows, _ = run(ur10e, [target(place, blend=2.0) for place in places])
    assert rows[-1, 0] == pytest.approx(200.0 / 100.0 + 0.2, abs=0.003)
    rested, _ = run(ur10e, [target(place) for place in places[:3]])
    assert rested[-1, 0] == pytest.approx(3 * 2.0 * math.sqrt(20.0 / 500.0), abs=0.01)


def test_a_corner_without_a_blend_is_reached_at_rest(ur10e):
    rows, _ = run(ur10e, [target([50, 0, 0]), target([50, 50, 0])])
    assert np.linalg.norm(rows[:, 1:4] - START - [50.0, 0, 0], axis=1).min() < 1e-3
    assert rows[-1, 0] == pytest.approx(2 * (50.0 / 100.0 + 0.2), abs=0.006)


def test_a_slower_move_is_entered_at_its_speed(ur10e):
    rows, _ = run(ur10e, [target([100, 0, 0], blend=5.0), target([200, 0, 0], speed=40.0, blend=5.0)])
    beyond = rows[:, 1] - START[0] > 101.0
    assert rows[beyond, 4].max() <= 40.0 * (1 + 1e-9)
    assert np.abs(np.diff(rows[:, 4])).max() / 0.002 < 500.0 * (1 + 1e-6)


def test_orientation_goes_over_evenly_in_a_blend(ur10e):
    first, last = (0.0, 0.3, 0.0), (0.3, 0.3, 0.0)
    moving = motion(ur10e)
    moving.add(target([100, 0, 0], blend=20.0, turn=first))
    moving.ask_with(lambda: moving.add(target([100, 100, 0], turn=last)))
    frames = []
    while not moving.finished:
        moving.advance(0.002, 0.002, 1.0)
        frames.append(pose_from_vector(np.array([moving.state.pose]))[0])
        moving.ask_with(lambda: None) if len(frames) > 900 else None
    frames = Rotation.from_matrix(np.array(frames)[:, :3, :3])
    spin = (frames[1:] * frames[:-1].inv()).as_rotvec() / 0.002
    assert np.linalg.norm(np.diff(spin, axis=0), axis=1).max() < 0.02  # no jump: a leg turns at 0.3 rad/s
    assert (frames[-1] * Rotation.from_matrix(pose([0, 0, 0], last)[:3, :3]).inv()).magnitude() < 1e-9


def test_a_move_that_turns_more_than_it_travels_is_blended_too(ur10e):
    rows, _ = run(
        ur10e, [target([50, 0, 0], blend=5.0, turn=(0, 0, 1.0)), target([100, 0, 0], turn=(0, 0, 1.0))]
    )
    middle = (rows[:, 1] - START[0] > 20.0) & (rows[:, 1] - START[0] < 80.0)
    assert rows[middle, 4].min() > 45.0  # a radian counts as 100 mm: half the speed on the first move
    assert rows[:, 4].max() == pytest.approx(100.0)


@pytest.mark.parametrize("bent", [0.0, 0.5])
def test_lines_and_arcs_are_blended(ur10e, bent):
    # Along x, then a quarter of a circle that is entered along its tangent, or with a corner, then on along y.
    way = np.array(
        [[100, 0, 0], [100 + 50 * math.sqrt(0.5), 50 - 50 * math.sqrt(0.5), 0], [150, 50, 0], [150, 150, 0]]
    )
    first = np.array([100.0, -100.0 * math.tan(bent), 0.0])
    via = tuple(START + way[1] + first - way[0])
    rest = way[2:] + first - way[0]
    blend = 5.0
    rows, _ = run(
        ur10e,
        [target(first, blend=blend), target(rest[0], blend=blend, via=via), target(rest[1])],
    )
    assert np.allclose(rows[-1, 1:4] - START, rest[1], atol=1e-9)
    length = np.linalg.norm(np.diff(rows[:, 1:4], axis=0), axis=1).sum()
    assert rows[-1, 0] == pytest.approx(length / 100.0 + 0.2, rel=0.01)
    cruising = (rows[:, 0] > 0.21) & (rows[:, 0] < rows[-1, 0] - 0.21)
    assert np.abs(rows[cruising, 4] / 100.0 - 1.0).max() < 0.005
    # Away from the path by less than the radius, and that only within the radius of a corner.
    along = np.linspace(0.0, 1.0, 2001)[:, None]
    turn = 0.5 * math.pi * along
    centre = first + [0.0, 50.0, 0.0]
    path = np.vstack(
        [
            along * first,
            centre + 50.0 * np.column_stack([np.sin(turn), -np.cos(turn), 0.0 * turn]),
            rest[0] + along * (rest[1] - rest[0]),
        ]
    )
    places = rows[:, 1:4] - START
    off = np.linalg.norm(places[:, None] - path[None], axis=2).min(axis=1)
    near = (
        np.minimum(np.linalg.norm(places - first, axis=1), np.linalg.norm(places - rest[0], axis=1)) < blend
    )
    assert off[~near].max() < 0.06  # the path's samples are this far apart
    assert off.max() < 0.5 * blend


place = st.tuples(*[st.floats(-25.0, 25.0) for _ in range(3)])
move = st.tuples(
    place,
    st.floats(60.0, 250.0),  # speed
    st.one_of(st.just(0.0), st.floats(0.01, 40.0)),  # blend
    st.floats(-0.3, 0.3),  # turn
)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(move, min_size=1, max_size=6))
@example(  # turns on the spot, and a blend that takes all of the leg behind one
    [
        ((20.0, -21.0, 25.0), 151.0, 8.0, 0.0),
        ((0.0, 0.0, 0.0), 64.0, 4.0, -0.3),
        ((0.0, 0.0, 0.0), 102.0, 14.0, 0.25),
        ((20.0, 0.0, 3.0), 117.0, 39.0, -0.2),
        ((-25.0, 1.0, -14.0), 245.0, 0.0, 0.1),
    ]
)
@example(  # a last leg that is slow because it turns
    [
        ((-6.0, 25.0, -2.0), 143.0, 35.0, -0.15),
        ((1.0, 0.0, -1.6), 117.0, 3.4, 0.3),
        ((0.0, 0.0, 0.0), 236.0, 14.0, 0.0),
    ]
)
@example(  # rounding once left the speed beside its limit for ever
    [
        ((20.227187229910044, 12.474588402182107, 1.0), 248.21288105857764, 13.536409252754138, -0.3),
        ((0.0, 0.0, 0.0), 141.51384199220178, 24.19770181246079, 0.0),
        ((1.0, 16.33460245586351, -22.332331337515765), 81.28309339444112, 37.0, -0.15863091949992383),
        ((-16.13163868613531, 1.0, -19.19738831609132), 115.57501961556036, 3.9, -0.07929486101066599),
        ((-7.72598914716313, 24.77425173404356, -25.0), 80.43516004146598, 0.0, 0.3),
        ((0.0, 0.0, 0.0), 163.05380774371093, 16.85773601732481, 0.0),
    ]
)
def test_any_moves_are_run_within_their_blends_speeds_and_acceleration(ur10e, moves):
    acceleration = 800.0
    targets = [
        target(
            at,
            speed,
            acceleration,
            blend,
            turn=(0.0, 0.0, turn),
        )
        for at, speed, blend, turn in moves
    ]
    rows, moving = run(ur10e, [target([0.0, 0.0, -1.0], speed=50.0), *targets])
    places, speeds = rows[:, 1:4] - START, rows[:, 4]
    corners = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], *(at for at, *_ in moves)])
    assert np.allclose(places[-1], corners[-1], atol=1e-7)
    assert np.allclose(
        pose_from_vector(np.array([moving.state.pose]))[0], pose(corners[-1], (0, 0, moves[-1][3])), atol=1e-9
    )
    assert speeds.max() <= max(speed for _, speed, *_ in moves) * (1 + 1e-9)
    assert np.abs(np.diff(speeds)).max(initial=0.0) / 0.002 <= acceleration * 1.001
    # On the lines, or within the radius of the corner that is rounded.
    a, b = corners[:-1], corners[1:]
    leg = b - a
    size = np.maximum((leg * leg).sum(axis=1), 1e-12)
    along = np.clip(np.einsum("nkj,kj->nk", places[:, None] - a, leg) / size, 0.0, 1.0)
    off = np.linalg.norm(places[:, None] - (a + along[..., None] * leg), axis=2).min(axis=1)
    radii = np.array([0.0, *(blend for _, _, blend, *_ in moves)])
    rounded = (np.linalg.norm(places[:, None] - b, axis=2) <= radii + 1e-6).any(axis=1)
    assert off[~rounded].max(initial=0.0) < 1e-6
