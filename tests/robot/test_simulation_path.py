"""Laws of planned motions: where they pass, how fast, and that joints and tool agree."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from planning import ReachError, arm
from planning.pose import rotation_from_vector
from robot.simulation.motions.motion import TrackMotion
from robot.simulation.motions.path import Target, path_through
from robot.simulation.motions.track import joint_track, tool_track

ARM = arm("ur10e")
HOME = np.radians([0.0, -90.0, -90.0, -90.0, 90.0, 0.0])
LIMIT = np.full(6, 2.0 * np.pi)
TOOL = np.eye(4)
TOOL[2, 3] = 200.0
START = ARM.forward(HOME[None])[0] @ TOOL

corner = st.tuples(*[st.floats(-120.0, 120.0) for _ in range(3)])
entry = st.tuples(corner, st.floats(5.0, 300.0), st.floats(0.0, 30.0), st.booleans(), st.floats(0.0, 0.3))


def target(offset, speed=100.0, blend=0.0, flowing=False, turn=0.0, mark=-1) -> Target:
    pose = START.copy()
    pose[:3, 3] += offset
    pose[:3, :3] = rotation_from_vector(np.array([[0.0, turn, 0.0]]))[0] @ pose[:3, :3]
    return Target(pose, speed, 500.0, blend, flowing, mark)


def run(track, step: float = 0.004, share: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions and speeds of a motion, to its end."""
    motion = TrackMotion(track)
    times, positions, speeds = [0.0], [motion.state.pose[:3]], [motion.state.tool_speed[:3]]
    while not motion.finished:
        motion.advance(step, step * share, share)
        times.append(times[-1] + step)
        positions.append(motion.state.pose[:3])
        speeds.append(motion.state.tool_speed[:3])
        assert times[-1] < 1000.0
    return np.array(times), np.array(positions), np.linalg.norm(speeds, axis=1)


def distance_to_polyline(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    a, b = corners[:-1], corners[1:]
    leg = b - a
    along = np.einsum("nkj,kj->nk", points[:, None] - a, leg) / np.maximum((leg * leg).sum(axis=1), 1e-12)
    nearest = a + np.clip(along, 0.0, 1.0)[..., None] * leg
    return np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1)


@settings(max_examples=60, deadline=None)
@given(st.lists(entry, min_size=1, max_size=8))
@example(
    [
        ((1.0, 0.0, 0.0), 5.0, 1.0, False, 0.0),
        ((1.0, 0.0, 0.0), 5.0, 0.0, False, 0.0),
        ((0.0, 0.0, 1.0), 5.0, 0.0, False, 0.0),
    ]
)
def test_a_path_keeps_to_its_corners_and_its_limits(entries) -> None:
    targets = [target(*given) for given in entries]
    track = tool_track(ARM, TOOL, HOME, targets, LIMIT)
    positions, step = np.array(track.positions), np.diff(track.distance)
    corners = np.array([START[:3, 3], *(t.pose[:3, 3] for t in targets)])
    assert distance_to_polyline(positions, corners).max() <= max(t.blend for t in targets) + 1e-6
    for t in targets:  # every target is passed within its blend
        assert np.linalg.norm(positions - t.pose[:3, 3], axis=1).min() <= t.blend + 1e-4
    assert np.allclose(positions[-1], corners[-1], atol=1e-4)

    speed = np.array(track.speed)
    assert speed[0] == speed[-1] == 0.0
    assert (np.maximum(speed[1:], speed[:-1]) <= np.array(track.limit) + 1e-9).all()
    assert (np.abs(speed[1:] ** 2 - speed[:-1] ** 2) <= 2.0 * 500.0 * step + 1e-6).all()
    # the parameter is the way of the tool, or more where the tool turns
    assert (np.linalg.norm(np.diff(positions, axis=0), axis=1) <= step + 1e-8).all()

    poses = ARM.forward(np.array(track.joints)) @ TOOL
    assert np.abs(poses[:, :3, 3] - positions).max() < 1e-6


def test_speed_is_constant_through_blends_and_lower_limits_are_met_in_time() -> None:
    square = [(100, 0, 0), (100, 100, 0), (0, 100, 0), (0, 0, 0)]
    slow = [target(at, 40.0 if i == 2 else 100.0, 5.0, True) for i, at in enumerate(square)]
    track = tool_track(ARM, TOOL, HOME, slow, LIMIT)
    times, positions, speeds = run(track, 0.001)
    ramp = 100.0 / 500.0
    even = (
        (times > ramp + 0.03)
        & (positions[:, 1] < START[1, 3] + 60.0)
        & (positions[:, 0] > START[0, 3] + 11.0)
    )
    assert even.sum() > 500
    assert speeds[even] == pytest.approx(100.0, rel=2e-3)
    on_slow = (positions[:, 1] > START[1, 3] + 99.9) & (np.abs(positions[:, 0] - START[0, 3] - 50.0) < 40.0)
    assert speeds[on_slow] == pytest.approx(40.0, rel=1e-9)
    # the reported speed is the derivative of the reported place
    between = np.linalg.norm(np.diff(positions, axis=0), axis=1) / 0.001
    assert between == pytest.approx(0.5 * (speeds[1:] + speeds[:-1]), abs=0.6)


def test_a_straight_move_from_rest_to_rest_takes_the_trapezoid_s_time() -> None:
    track = tool_track(ARM, TOOL, HOME, [target((0.0, 150.0, 0.0), 100.0)], LIMIT)
    assert track.time[-1] == pytest.approx(150.0 / 100.0 + 100.0 / 500.0, rel=1e-3)
    short = tool_track(ARM, TOOL, HOME, [target((0.0, 4.0, 0.0), 100.0)], LIMIT)
    assert short.time[-1] == pytest.approx(2.0 * math.sqrt(4.0 / 500.0), rel=1e-6)


def test_a_joint_move_takes_the_leading_joint_s_time() -> None:
    end = HOME + np.array([0.5, 0.1, -0.2, 0.0, 1.5, 0.0])
    track = joint_track(ARM, TOOL, HOME, end, 1.0, 2.0)
    assert track.time[-1] == pytest.approx(1.5 / 1.0 + 1.0 / 2.0, rel=1e-3)
    assert np.allclose(track.joints[-1], end, atol=1e-12)


def test_a_line_stops_where_it_has_no_blend_and_a_process_move_goes_straight_on() -> None:
    there = [(50, 0, 0), (100, 0, 0)]
    for flowing, expected in ((False, 2), (True, 1)):
        track = tool_track(ARM, TOOL, HOME, [target(at, 100.0, 0.0, flowing) for at in there], LIMIT)
        assert (np.array(track.speed)[1:] == 0.0).sum() == expected


def test_half_the_share_takes_twice_the_time() -> None:
    track = tool_track(ARM, TOOL, HOME, [target((100, 0, 0), 80.0, 3.0), target((100, 60, 0), 80.0)], LIMIT)
    times, _, speeds = run(track)
    slow_times, _, slow_speeds = run(track, share=0.5)
    assert slow_times[-1] == pytest.approx(2.0 * times[-1], abs=0.01)
    assert slow_speeds.max() == pytest.approx(0.5 * speeds.max(), rel=1e-6)


def test_a_braked_motion_stops_on_its_path_and_goes_on_from_there() -> None:
    targets = [target((100, 0, 0), 100.0, 10.0, True), target((100, 100, 0), 100.0)]
    motion = TrackMotion(tool_track(ARM, TOOL, HOME, targets, LIMIT))
    while motion.state.pose[0] < START[0, 3] + 90.0:
        motion.advance(0.002, 0.002, 1.0)
    motion.brake(tool=1000.0)
    before = np.array(motion.state.pose[:3])
    taken = 0.0
    while not motion.resting:
        motion.advance(0.002, 0.002, 1.0)
        taken += 0.002
    assert taken == pytest.approx(100.0 / 1000.0, abs=0.004)
    run_out = np.linalg.norm(np.array(motion.state.pose[:3]) - before)
    assert (
        0.9 * 5.0 < run_out <= 100.0**2 / (2.0 * 1000.0) + 1e-6
    )  # v²/2a along the path, less along the chord
    held = motion.state.pose
    motion.resume()
    motion.advance(0.0, 0.0, 1.0)
    assert motion.state.pose == pytest.approx(held, abs=1e-6)
    while not motion.finished:
        motion.advance(0.002, 0.002, 1.0)
    assert motion.state.pose[:3] == pytest.approx(targets[-1].pose[:3, 3], abs=1e-6)


def test_a_motion_that_begins_too_fast_brakes_down_to_its_limit() -> None:
    track = tool_track(ARM, TOOL, HOME, [target((100, 0, 0), 50.0)], LIMIT, start_speed=100.0)
    speed, way = np.array(track.speed), np.array(track.distance)
    braking = way < (100.0**2 - 50.0**2) / (2.0 * 500.0)
    assert speed[braking] ** 2 == pytest.approx(100.0**2 - 2.0 * 500.0 * way[braking])
    assert speed[~braking].max() <= 50.0 + 1e-9


def test_marks_are_passed_in_order_where_their_moves_begin() -> None:
    there = [(50, 0, 0), (50, 50, 0), (0, 50, 0)]
    targets = [target(at, 100.0, 4.0, True, mark=i) for i, at in enumerate(there)]
    motion = TrackMotion(tool_track(ARM, TOOL, HOME, targets, LIMIT))
    seen = {}
    while not motion.finished:
        motion.advance(0.001, 0.001, 1.0)
        seen.setdefault(motion.mark, np.array(motion.state.pose[:3]))
    assert list(seen) == [0, 1, 2]
    for mark in (1, 2):
        assert np.linalg.norm(seen[mark] - targets[mark - 1].pose[:3, 3]) <= 4.0


def test_a_target_where_the_tool_already_is_needs_no_motion() -> None:
    assert TrackMotion(tool_track(ARM, TOOL, HOME, [target((0.0, 0.0, 0.0))], LIMIT)).finished
    path = path_through(
        START, [target((0, 0, 0)), target((10, 0, 0)), target((10, 0, 0)), target((20, 0, 0))]
    )
    assert path.step.sum() == pytest.approx(20.0)


def test_a_path_out_of_reach_is_refused() -> None:
    with pytest.raises(ReachError, match="no inverse kinematics at flange position"):
        tool_track(ARM, TOOL, HOME, [target((2000.0, 0.0, 0.0))], LIMIT)


def test_a_path_through_a_singularity_is_refused() -> None:
    wrist_in_line = np.radians([0.0, -90.0, -90.0, 0.0, 20.0, 0.0])
    through = ARM.forward(np.radians([[0.0, -90.0, -90.0, 0.0, -20.0, 0.0]]))[0] @ TOOL
    with pytest.raises(ReachError, match=r"singularity|limit|no inverse"):
        tool_track(ARM, TOOL, wrist_in_line, [Target(through, 100.0, 500.0)], LIMIT)
