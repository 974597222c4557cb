"""One frame in plain numbers is what arrays of frames are."""

from __future__ import annotations

import numpy as np
import pytest
from eaik.IK_DH import DhRobot
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from planning import ARMS, arm
from planning.pose import pose_from_vector, rotation_from_vector, vector_from_pose
from robot.simulation.motions.arm_frame import flange_frame, joint_solutions
from robot.simulation.motions.frame import (
    compose,
    frame_at,
    frame_of,
    inverse,
    pose_numbers,
    rotation_between,
    speed_between,
    turn,
    turned,
)
from robot.simulation.motions.posture import nearest_joints

joint_angles = st.lists(st.floats(-6.2, 6.2), min_size=6, max_size=6)
poses = st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6)
LIMIT = [2.0 * np.pi] * 6


def matrix(frame) -> np.ndarray:
    return np.vstack([np.array(frame).reshape(4, 3).T, [0.0, 0.0, 0.0, 1.0]])


@given(st.sampled_from(sorted(ARMS)), joint_angles)
def test_the_flange_is_where_the_arm_s_kinematics_say(name, joints) -> None:
    expected = arm(name).forward(np.array([joints]))[0]
    assert matrix(flange_frame(arm(name), joints)) == pytest.approx(expected, abs=1e-9)


def independent(model) -> DhRobot:
    """The same arm in another library, by the manufacturer's table."""
    quarter = np.pi / 2.0
    return DhRobot(
        np.array([quarter, 0.0, 0.0, quarter, -quarter, 0.0]),
        np.array([0.0, model.a2, model.a3, 0.0, 0.0, 0.0]),
        np.array([model.d1, 0.0, 0.0, model.d4, model.d5, model.d6]),
    )


@pytest.mark.parametrize("name", ARMS)
def test_the_flange_is_where_an_independent_library_says(name) -> None:
    model = arm(name)
    other = independent(model)
    for joints in np.random.default_rng(5).uniform(-2.0 * np.pi, 2.0 * np.pi, (300, 6)):
        found = matrix(flange_frame(model, joints.tolist()))
        assert np.abs(found - other.fwdKin(joints)).max() < 1e-9 * max(1.0, np.abs(found).max())


@pytest.mark.parametrize("name", ARMS)
def test_the_controller_s_choice_is_the_nearest_of_all_solutions(name) -> None:
    model = arm(name)
    rng = np.random.default_rng(6)
    other = independent(model)
    for k in range(150):
        joints = rng.uniform(-np.pi, np.pi, 6)
        joints[[2, 4]] *= 10.0 ** rng.uniform(-5.0, 0.0, 2)  # often near a singularity
        near = joints + rng.normal(0.0, (0.01, 0.3, 2.0)[k % 3], 6)
        frame = flange_frame(model, joints.tolist())
        found = nearest_joints(model, frame, near.tolist(), [4.0 * np.pi] * 6)
        assert found is not None
        assert np.abs(matrix(flange_frame(model, found)) - matrix(frame)).max() < 1e-4
        apart = np.abs(np.array(found) - near).max()
        solutions = [np.ravel(q) for q in other.IK(matrix(frame)).Q]
        for solution in solutions:
            if np.abs(other.fwdKin(solution) - matrix(frame)).max() < 1e-6:
                turned = solution + 2.0 * np.pi * np.round((near - solution) / (2.0 * np.pi))
                assert apart <= np.abs(turned - near).max() + 1e-4


@pytest.mark.parametrize("name", ARMS)
def test_the_solutions_are_those_of_the_arm_s_kinematics(name) -> None:
    joints = np.random.default_rng(2).uniform(-np.pi, np.pi, (60, 6))
    joints[:10, 4] = 0.0  # the wrist in line
    for q, expected in zip(joints, arm(name).inverse(arm(name).forward(joints)), strict=True):
        found = np.array(joint_solutions(arm(name), flange_frame(arm(name), q.tolist())))
        known = expected[~np.isnan(expected).any(axis=1)]
        assert len(found) == len(known) > 0
        apart = np.abs(np.sin(0.5 * (found[:, None] - known))).max(axis=2)
        assert apart.min(axis=1).max() < 1e-7
        assert apart.min(axis=0).max() < 1e-7


@given(joint_angles)
@example([0.03125, 0.25, 0.0, 4.0, 1e-07, 0.0])  # the arm straight and the wrist nearly in line
def test_the_nearest_solution_to_where_the_arm_is_is_where_it_is(joints) -> None:
    model = arm("ur10e")
    found = nearest_joints(model, flange_frame(model, joints), joints, LIMIT)
    assert found is not None
    assert flange_frame(model, found) == pytest.approx(flange_frame(model, joints), abs=1e-3)
    ordinary = abs(np.sin(joints[4])) > 0.01 and abs(np.sin(joints[2])) > 0.01
    wrist = model.forward(np.array([joints]))[0] @ [0.0, 0.0, -model.d6, 1.0]
    if ordinary and np.hypot(wrist[0], wrist[1]) > model.d4 + 1.0:
        assert found == pytest.approx(joints, abs=1e-6)


def test_a_joint_keeps_within_its_limit() -> None:
    model = arm("ur10e")
    joints = np.radians([170.0, -90.0, -90.0, -90.0, 90.0, 0.0]).tolist()
    near = [-3.3, *joints[1:]]
    frame = flange_frame(model, joints)
    wide, narrow = nearest_joints(model, frame, near, LIMIT), nearest_joints(model, frame, near, [3.1] * 6)
    assert wide is not None
    assert narrow is not None
    assert wide[0] == pytest.approx(joints[0] - 2.0 * np.pi)
    assert max(map(abs, narrow)) <= 3.1
    assert flange_frame(model, narrow) == pytest.approx(frame, abs=1e-8)
    assert nearest_joints(model, frame, near, [0.1] * 6) is None


@given(poses, poses, st.floats(0.01, 2.0))
def test_frames_compose_turn_and_differ_as_matrices_do(a, b, seconds) -> None:
    A, B = pose_from_vector(np.array([a, b]))
    fa, fb = frame_of(A), frame_of(B)
    assert matrix(compose(fa, fb)) == pytest.approx(A @ B, abs=1e-12)
    spun = rotation_from_vector(np.array([b[3:]]))[0] @ A[:3, :3]
    assert matrix(turned(fa, b[3:]))[:3, :3] == pytest.approx(spun, abs=1e-12)
    speed = np.array(speed_between(fa, fb, seconds)) * seconds
    assert speed[:3] == pytest.approx(B[:3, 3] - A[:3, 3], abs=1e-12)
    assert rotation_from_vector(speed[None, 3:])[0] @ A[:3, :3] == pytest.approx(B[:3, :3], abs=1e-9)
    back = pose_from_vector(np.array([pose_numbers(fa)]))[0]
    assert back == pytest.approx(A, abs=1e-9)
    assert np.linalg.norm(pose_numbers(fa)[3:]) <= np.pi + 1e-12
    assert matrix(frame_at(a)) == pytest.approx(A, abs=1e-12)
    assert matrix(compose(fa, inverse(fa))) == pytest.approx(np.eye(4), abs=1e-12)


@given(poses, st.floats(0.0, 3.14), st.sampled_from([1e-12, 1e-9, 1e-6, 1e-3, 1.0]))
def test_a_rotation_between_frames_is_the_one_that_turns_them(a, angle, scale) -> None:
    frame, vector = frame_at(a), scale * angle * np.array([0.6, 0.0, -0.8])
    found = rotation_between(frame, turned(frame, vector.tolist()))
    assert found == pytest.approx(vector, rel=1e-6, abs=2e-15 if scale < 1.0 else 1e-9)


def test_half_a_turn_has_one_sense_whatever_the_rounding() -> None:
    down = Rotation.from_rotvec([-np.pi / np.sqrt(2.0), np.pi / np.sqrt(2.0), 0.0]).as_quat()
    told = {tuple(np.round(turn((*down[:3], w)), 6)) for w in (1e-16, -1e-16, 0.0)}
    assert len(told) == 1
    assert vector_from_pose(np.eye(4)[None])[0] == pytest.approx(np.zeros(6))
