"""Every method of ur-rtde's control interface, against the simulated controller: moves, paths, stops, steering."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from rtde_control import RTDEControlInterface
from urrtde.tour import CYCLE, Rows, bend, off_the_profile, slope

from planning import arm
from planning.pose import pose_from_vector

PRINTED = 1e-5
"""Positions of a path are written into its script with six digits."""

LATER = "needs PolyScope 5.23: in the script for earlier versions the command is empty"
NOT_CALLED = {
    "moveUntilContact": "needs contact: in free space it never ends",
    "directTorque": LATER,
    "getCoriolisAndCentrifugalTorques": LATER,
    "getJacobian": LATER,
    "getJacobianTimeDerivative": LATER,
    "getMassMatrix": LATER,
    "getTargetJointAccelerations": LATER,
}


def transform(vector) -> np.ndarray:
    """A pose of ur-rtde, m, as a transform, shape (4, 4)."""
    return pose_from_vector(np.array([vector]))[0]


def same_pose(a, b, tolerance: float = 1e-6) -> bool:
    return bool(np.abs(transform(a) - transform(b)).max() < tolerance)


def nearest(places: np.ndarray, corner) -> float:
    return float(np.linalg.norm(places - np.array(corner[:3]), axis=1).min())


def off_the_line(places: np.ndarray, start, end) -> float:
    """Largest distance from a straight line."""
    start, end = np.array(start[:3]), np.array(end[:3])
    along = (end - start) / np.linalg.norm(end - start)
    across = (places - start) - np.outer((places - start) @ along, along)
    return float(np.linalg.norm(across, axis=1).max())


def test_every_method_is_called_or_cannot_be(tour) -> None:
    methods = {
        name
        for name in vars(RTDEControlInterface)
        if name[0] not in "_F" and callable(getattr(RTDEControlInterface, name))
    }
    assert methods - tour.called("control") == set(NOT_CALLED)


def test_a_joint_move_follows_its_trapezoid(tour) -> None:
    told = tour["move_j"]
    (target, speed, acceleration), rows = told["asked"], Rows(told["rows"])
    assert told["answer"]
    assert told["end"]["q"] == pytest.approx(target, abs=1e-9)
    way = np.abs(rows.q - rows.q[0])
    leading = int(way[-1].argmax())
    assert off_the_profile(rows.time, way[:, leading], speed, acceleration) < 0.01 * way[-1, leading]
    share = way[:, leading] / way[-1, leading]
    assert np.abs(way - np.outer(share, way[-1])).max() < 1e-6  # all joints together
    assert np.abs(rows.qd).max() <= speed * (1.0 + 1e-6)


def test_a_tool_move_follows_its_trapezoid_on_a_line(tour) -> None:
    told = tour["move_l"]
    (target, speed, acceleration), rows = told["asked"], Rows(told["rows"])
    assert told["answer"]
    assert same_pose(told["end"]["pose"], target)
    assert off_the_line(rows.place, told["start"], target) < 1e-6
    way = np.linalg.norm(rows.place - rows.place[0], axis=1)
    assert off_the_profile(rows.time, way, speed, acceleration) < 0.01 * way[-1]
    assert np.abs(transform(told["start"])[:3, :3] - transform(rows.pose[len(way) // 2])[:3, :3]).max() < 1e-6


def test_moves_between_joints_and_poses(tour) -> None:
    told = tour["move_between_spaces"]
    by_joints, by_line = told["ends"]
    assert told["answers"] == [True, True]
    assert same_pose(by_joints["pose"], told["pose"])
    assert by_line["q"] == pytest.approx(told["joints"], abs=1e-6)
    rows = Rows(told["rows"])
    way = np.abs(rows.q - rows.q[0])
    assert np.abs(way - np.outer(way[:, way[-1].argmax()] / way[-1].max(), way[-1])).max() < 1e-6
    assert off_the_line(Rows(told["line"]).place, by_joints["pose"], by_line["pose"]) < 1e-6


def test_numbers_out_of_range_move_nothing(tour) -> None:
    told = tour["refused_numbers"]
    assert told["refused"] == ["ValueError"] * 4
    assert told["after"] == told["before"]


@pytest.mark.parametrize("k", range(4), ids=["moveJ", "moveL", "moveJ_IK", "moveL_FK"])
def test_an_asynchronous_move_tells_its_progress(tour, k) -> None:
    told = tour["asynchronous_moves"]["told"][k]
    assert told["answer"]
    before, during, after = told["ids"]
    assert during == after == (before + 1) % 128
    assert [(b - a) % 128 for a, b in pairwise(told["changes"])] == [1, 1]
    assert told["running"] == [False, True, False]
    assert told["progress"] == 0
    assert told["same"] == [True, False]
    for word, identity, change, running in zip(
        told["words"], told["ids"], told["changes"], told["running"], strict=True
    ):
        assert word == identity << 24 | change << 16 | running << 15
    old_before, old_during, old_after = told["old"]
    assert old_during == 0
    assert {old_before, old_after} == {-1, -2}
    assert told["steady"] == [False, True]


@pytest.mark.parametrize("k", range(4), ids=["moveJ", "moveL", "moveJ_IK", "moveL_FK"])
def test_an_asynchronous_move_reaches_its_target(tour, k) -> None:
    told = tour["asynchronous_moves"]["told"][k]
    if k in (0, 3):
        assert told["end"]["q"] == pytest.approx(told["target"], abs=1e-6)
    else:
        assert same_pose(told["end"]["pose"], told["target"])


@pytest.mark.parametrize("k", range(4), ids=["moveJ", "moveL", "moveJ_IK", "moveL_FK"])
def test_the_target_waypoint_is_where_a_move_goes(tour, k) -> None:
    told = tour["asynchronous_moves"]["told"][k]
    assert same_pose(told["waypoint"], told["end"]["pose"])


def test_a_path_of_joints_passes_its_waypoints(tour) -> None:
    told = tour["joint_path"]
    via, end = told["waypoints"]
    there, back = told["ends"]
    assert told["answers"] == [True, True]
    assert there["q"] == pytest.approx(end, abs=PRINTED)
    assert told["progress"] == [0, 1]
    assert back["q"] == pytest.approx([0.0, *[-np.pi / 2] * 3, np.pi / 2, 0.0], abs=PRINTED)
    tool = pose_from_vector(np.array([tour.cell.tool.tcp]))[0]
    corner = (arm("ur10e").forward(np.array([via]))[0] @ tool)[:3, 3] / 1000.0
    assert nearest(Rows(told["rows"]).place, corner) < 0.05  # its blend radius


def test_a_path_of_poses_is_rounded_within_its_blends(tour) -> None:
    told = tour["tool_path"]
    corners, rows = told["corners"], Rows(told["rows"])
    there, back = told["ends"]
    assert told["answers"] == [True, True]
    assert same_pose(there["pose"], corners[-1], PRINTED)
    assert same_pose(back["pose"], told["start"], PRINTED)
    assert told["progress"] == [0, 1, 2]
    for corner in corners[:-1]:
        assert 0.001 < nearest(rows.place, corner) < 0.02
        around = np.linalg.norm(rows.place - np.array(corner[:3]), axis=1) < 0.02
        assert rows.speed[around].min() > 0.05  # it does not stop there
    away = np.ones(len(rows.time), dtype=bool)
    for corner in corners[:-1]:
        away &= np.linalg.norm(rows.place - np.array(corner[:3]), axis=1) > 0.02 + PRINTED
    ways = [*pairwise([told["start"], *corners])]
    off = np.array([[off_the_line(place[None], *way) for way in ways] for place in rows.place[away]])
    assert off.min(axis=1).max() < PRINTED


def test_a_path_of_all_kinds_of_moves(tour) -> None:
    told = tour["mixed_path"]
    rows, corners, (end, short_end) = Rows(told["rows"]), told["corners"], told["ends"]
    assert told["answers"] == [True, True]
    assert told["sizes"] == [0, 6, 2, 2]
    assert told["progress"] == [0, 1, 2, 3, 4, 5]
    assert end["q"] == pytest.approx(told["joints"], abs=PRINTED)
    assert same_pose(short_end["pose"], corners[0], PRINTED)
    for corner in (corners[0], corners[3]):  # without a blend; a package beside it may be the nearest
        assert nearest(rows.place, corner) < 2.0 * (2.0 * CYCLE) ** 2
    even = np.zeros(len(rows.time), dtype=bool)
    first, last = (
        int(np.linalg.norm(rows.place - np.array(c[:3]), axis=1).argmin()) for c in (corners[0], corners[3])
    )
    even[first:last] = True
    for corner in (corners[0], corners[3]):  # v²/2a where it starts and stops
        even &= np.linalg.norm(rows.place - np.array(corner[:3]), axis=1) > 0.006
    assert even.sum() > 100
    assert rows.speed[even] == pytest.approx(0.1, rel=0.005)
    for corner in corners[1:3]:
        assert 0.0005 < nearest(rows.place, corner) < 0.01


def test_a_path_is_written_as_a_script(tour) -> None:
    told = tour["mixed_path"]
    lines = told["code"].splitlines()
    assert [line.strip() for line in lines[::2]] == [f"signal_async_progress({i})" for i in range(6)]
    assert [line.split("(")[0].strip() for line in lines[1::2]] == ["movej", *["movep"] * 3, "movel", "movej"]
    assert told["entry"].strip() == lines[3].strip()


def test_a_path_is_stopped_on_its_way(tour) -> None:
    told = tour["a_path_is_stopped"]
    assert told["answer"]
    assert not told["running"]
    start, end = np.array(told["start"][:3]), np.array(told["end"]["pose"][:3])
    assert end[0] - start[0] == pytest.approx(0.1, abs=0.005)
    assert 0.001 < end[1] - start[1] < 0.6


def test_stops_brake_as_they_are_asked_to(tour) -> None:
    told = tour["stops"]
    joints, later, tool = told["joints"], told["tool later"], told["tool"]
    rows = Rows(joints["rows"])
    assert bend(rows.time, rows.q[:, 0], rows.qd[:, 0]) == pytest.approx(-joints["asked"], rel=0.02)
    for stop in (later, tool):
        rows = Rows(stop["rows"])
        assert slope(rows.time, rows.speed) == pytest.approx(-stop["asked"], rel=0.02)
        first = int(np.argmax(rows.speed < 0.19))
        gone = np.linalg.norm(rows.place[-1] - rows.place[first])
        assert gone == pytest.approx(rows.speed[first] ** 2 / (2.0 * stop["asked"]), rel=0.02, abs=1e-4)


def test_asynchronous_stops_do_not_wait(tour) -> None:
    told = tour["stops"]
    for name, waits in (("joints", True), ("tool", True), ("tool later", False), ("later", False)):
        assert told[name]["moving"] is not waits
    assert told["later"]["end"]["q"][0] < 2.9


def test_tool_speeds_are_reached_and_stopped(tour) -> None:
    told = tour["tool_speeds"]
    rows, stop = Rows(told["rows"]), Rows(told["stop"])
    assert told["answers"] == [True] * 3
    assert told["speed"] == pytest.approx([0.05, 0.0, 0.0, 0.0, 0.0, 0.04], abs=1e-6)
    assert told["target"] == told["speed"]
    alone = rows.time < rows.time[int((rows.twist[:, 1] > 0.0999).argmax())]
    assert slope(rows.time[alone], rows.speed[alone]) == pytest.approx(0.5, rel=0.02)
    assert slope(stop.time, stop.speed) == pytest.approx(-0.2, rel=0.02)


def test_joint_speeds_are_reached_and_stopped(tour) -> None:
    told = tour["joint_speeds"]
    rows, stop = Rows(told["rows"]), Rows(told["stop"])
    assert told["answers"] == [True] * 2
    assert told["speeds"] == pytest.approx([0.3, 0.0, 0.0, 0.0, 0.0, -0.2], abs=1e-6)
    assert told["target"] == told["speeds"]
    assert bend(rows.time, rows.q[:, 0], rows.qd[:, 0]) == pytest.approx(1.0, rel=0.02)
    assert bend(stop.time, stop.q[:, 0], stop.qd[:, 0]) == pytest.approx(-0.5, rel=0.02)


def test_the_joints_follow_a_servo_target(tour) -> None:
    told = tour["servo_joints"]
    rows = Rows(told["rows"])
    assert all(told["answers"])
    assert told["end"]["q"] == pytest.approx(told["target"], abs=1e-4)
    left = np.abs(rows.q - np.array(told["target"])).max(axis=1)
    assert (np.diff(left) < 1e-9).all()  # it comes ever nearer, and does not overshoot
    assert np.abs(rows.qd).max() < 1.1 * left[0] / told["lookahead"]  # and is not there at once


def test_the_tool_follows_a_servo_target_with_a_lag(tour) -> None:
    told = tour["servo_tool"]
    assert all(told["answers"])
    assert same_pose(told["end"]["pose"], told["target"], 1e-5)
    lag = np.median(told["lags"]) / told["speed"]
    assert 0.5 * told["lookahead"] < lag < 1.5 * told["lookahead"] + 4.0 * CYCLE


def test_the_tool_servos_to_a_pose_at_its_speed(tour) -> None:
    told = tour["servo_circular"]
    rows = Rows(told["rows"])
    assert told["answers"] == [True, False]
    assert same_pose(told["end"]["pose"], told["target"], 1e-5)
    assert rows.speed.max() == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize("k", range(3), ids=["base", "tool", "custom"])
def test_jogging_goes_along_its_feature(tour, k) -> None:
    told = tour["jogging"]["found"][k]
    frame = {"base": np.eye(4), "tool": transform(told["pose"]), "custom": transform(told["frame"])}[
        told["name"]
    ]
    asked = np.array(told["asked"])
    expected = np.concatenate([frame[:3, :3] @ asked[:3], frame[:3, :3] @ asked[3:]])
    assert told["answers"] == [True] * 3
    assert told["speed"] == pytest.approx(expected, abs=1e-4)
    assert told["half"] == pytest.approx(0.5 * expected, abs=1e-4)
    assert np.linalg.norm(np.array(told["end"]["pose"][:3]) - np.array(told["pose"][:3])) > 0.005
