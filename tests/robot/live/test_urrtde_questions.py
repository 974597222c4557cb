"""What ur-rtde's control interface asks and sets: kinematics, tool, payload, sensors; against other libraries."""

from __future__ import annotations

import numpy as np
import pytest
from eaik.IK_DH import DhRobot
from scipy.spatial.transform import Rotation
from urrtde.tour import CYCLE, Rows


def matrix(pose) -> np.ndarray:
    """A pose of ur-rtde, m, as a transform, shape (4, 4), by scipy."""
    whole = np.eye(4)
    whole[:3, :3] = Rotation.from_rotvec(pose[3:]).as_matrix()
    whole[:3, 3] = pose[:3]
    return whole


def forward(joints) -> np.ndarray:
    """Flange of a UR10e, m, by eaik and the lengths that the maker publishes."""
    quarter = np.pi / 2.0
    robot = DhRobot(
        np.array([quarter, 0.0, 0.0, quarter, -quarter, 0.0]),
        np.array([0.0, -0.6127, -0.57155, 0.0, 0.0, 0.0]),
        np.array([0.1807, 0.0, 0.0, 0.17415, 0.11985, 0.11655]),
    )
    return robot.fwdKin(np.array(joints))


def off(a, b) -> float:
    return float(np.abs(np.asarray(a) - np.asarray(b)).max())


def test_forward_kinematics_agree_with_another_library(tour) -> None:
    told = tour["forward_and_inverse"]
    tool = matrix([0.0, 0.0, 0.2, 0.0, 0.0, 0.0])
    home = tour["move_l"]["start"]
    assert off(matrix(told["here"]), matrix(told["reported"])) < 1e-9
    assert off(matrix(home), matrix(told["reported"])) < 1e-9
    assert off(matrix(told["elsewhere"]), forward(told["near"]) @ tool) < 1e-9
    other = matrix(tour["the_tool"]["tool"])
    assert off(matrix(told["with_tool"]), forward(told["near"]) @ other) < 1e-9


def test_the_flange_is_where_the_joints_put_it(tour) -> None:
    told = tour["realtime_questions"]
    assert off(matrix(told["flange"]), forward(told["home"]["q"])) < 1e-9


def test_inverse_kinematics_choose_the_posture_that_is_near(tour) -> None:
    told = tour["forward_and_inverse"]
    home = tour["realtime_questions"]["home"]["q"]
    assert told["joints"] == pytest.approx(home, abs=1e-6)
    assert told["joints_near"] == pytest.approx(told["near"], abs=1e-6)
    tool = matrix([0.0, 0.0, 0.2, 0.0, 0.0, 0.0])
    flipped = np.array(told["joints_flipped"])
    assert off(forward(flipped) @ tool, matrix(told["reported"])) < 1e-8
    wanted = np.array(told["flipped"])
    assert np.linalg.norm(flipped - wanted) < np.linalg.norm(np.array(home) - wanted)


def test_what_is_out_of_reach_has_no_solution(tour) -> None:
    told = tour["forward_and_inverse"]
    assert told["solvable"] == [True, True, False, False]
    assert told["poses_within"] == [True, False]
    assert told["joints_within"] == [True, False]


def test_poses_are_composed(tour) -> None:
    told = tour["poses_in_poses"]
    for (a, b), answer in zip(told["pairs"], told["answers"], strict=True):
        assert off(matrix(answer), matrix(a) @ matrix(b)) < 1e-9


def test_another_tool_moves_the_tcp_and_not_the_arm(tour) -> None:
    told = tour["the_tool"]
    tool, before, after = matrix(told["tool"]), told["before"], told["after"]
    assert told["answers"] == [True] * 3
    assert told["offset"] == pytest.approx([0.0, 0.0, 0.2, 0.0, 0.0, 0.0])
    assert told["told"] == pytest.approx(told["tool"])
    assert told["restored"] == pytest.approx(told["offset"])
    assert after["q"] == before["q"]
    assert off(matrix(after["pose"]), forward(after["q"]) @ tool) < 1e-9
    assert off(matrix(told["forward"]), matrix(after["pose"])) < 1e-9
    moved = told["moved"]
    assert moved["pose"] == pytest.approx([after["pose"][0] + 0.05, *after["pose"][1:]], abs=1e-6)
    assert off(matrix(moved["pose"]), forward(moved["q"]) @ tool) < 1e-6


def test_the_payload_is_told_back(tour) -> None:
    told = tour["the_payload"]["found"]
    assert [answer for answer, _ in told] == [True] * 4
    assert [mass for _, (mass, _, _) in told] == [2.5, 3.5, 4.5, 1.5]
    first, later = [0.01, 0.02, 0.03], [0.03, 0.01, 0.05]
    # Without a centre of gravity the last one is kept.
    assert [cog for _, (_, cog, _) in told] == [pytest.approx(cog) for cog in (first, first, later, later)]


def test_the_payload_s_inertia_is_told_back(tour) -> None:
    told = tour["the_payload"]
    for _, (_, _, inertia) in told["found"][2:]:
        assert inertia == pytest.approx(told["inertia"])


def test_gravity_is_felt_at_the_flange(tour) -> None:
    told = tour["gravity"]
    assert told["answers"] == [True] * 4
    for asked, felt, joints in told["felt"]:
        assert felt == pytest.approx(forward(joints)[:3, :3].T @ asked, abs=1e-6)


def test_what_is_asked_in_real_time(tour) -> None:
    told = tour["realtime_questions"]
    assert told["step"] == 0.002
    assert len(told["torques"]) == 6
    assert np.isfinite(told["torques"]).all()
    assert told["contact"] == 0
    assert told["steady"]
    assert told["resting"] == pytest.approx(told["home"]["q"], abs=1e-9)
    assert off(matrix(told["waypoint"]), matrix(told["home"]["pose"])) < 1e-6  # nothing moves


def test_the_history_tells_where_the_joints_were(tour) -> None:
    told = tour["realtime_questions"]
    times = [row[0] for row in told["rows"]]
    distance = np.abs(Rows(told["rows"]).q - np.array(told["history"])).max(axis=1)
    assert distance.min() < 0.5 * CYCLE  # on the way, which was gone at half of that speed
    asked, answered = (np.searchsorted(times, told[name]) for name in ("asked_at", "answered_at"))
    assert asked - 33 <= distance.argmin() <= answered - 27  # 30 cycles before


def test_periods_are_those_of_the_controller(tour) -> None:
    told = tour["periods"]
    for interface in ("control", "receive"):
        assert told[interface] > told["count"] * 0.001  # the client waits whole milliseconds


def test_there_is_no_contact_in_free_space(tour) -> None:
    told = tour["no_contact"]
    answers = dict(told["answers"])
    assert answers.pop("read") is False
    assert answers.pop("stop") is False
    assert all(answers.values())
    assert told["force"] == pytest.approx([0.0] * 6)
    assert told["runs"]


def test_an_external_sensor_is_switched(tour) -> None:
    """The client writes its forces into a recipe of other variables, so that they do not arrive."""
    told = tour["an_external_sensor"]
    assert told["answers"] == [True] * 6
    assert told["runs"]


def test_force_mode_runs_at_its_limit_where_nothing_answers(tour) -> None:
    told = tour["force_in_free_space"]
    assert told["answers"] == [True, True]
    along = matrix(told["frame"])[:3, 0]
    assert told["speed"][:3] == pytest.approx(told["limit"] * along, abs=1e-3)
    assert told["later"] == told["end"]["pose"]
    gone = np.array(told["end"]["pose"][:3]) - np.array(told["start"]["pose"][:3])
    assert gone @ along > 0.005
    assert np.linalg.norm(gone - (gone @ along) * along) < 1e-4


def test_an_arm_that_nobody_leads_stays(tour) -> None:
    told = tour["hand_guiding"]
    assert told["answers"] == [True] * 5
    assert told["status"] == [0, 0, 0]
    assert told["steady"] == [True, False, False, True]  # never steady while it may be led
    assert told["after"]["q"] == pytest.approx(told["before"]["q"], abs=1e-9)
