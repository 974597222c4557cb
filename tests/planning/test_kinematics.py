"""Laws of the arms' kinematics, and the same arms in an independent library."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from eaik.IK_DH import DhRobot
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from planning import ARMS, ConfigurationError, arm
from planning.pose import pose_from_vector, rotation_from_vector, vector_from_pose, vector_from_rotation

if TYPE_CHECKING:
    from planning.kinematics import Arm

every_arm = pytest.mark.parametrize("model", ARMS.values(), ids=lambda model: model.name)
angle = st.floats(-2.0 * np.pi, 2.0 * np.pi)


def random_joints(n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (n, 6))


def assert_reaches(model: Arm, poses: np.ndarray, solutions: np.ndarray) -> None:
    """Every solution that is given reaches its pose, and is given whole."""
    given = ~np.isnan(solutions)
    assert (given.all(axis=2) == given.any(axis=2)).all()
    which = given.all(axis=2)
    error = model.forward(solutions[which]) - np.repeat(poses, 8, axis=0).reshape(-1, 8, 4, 4)[which]
    assert np.abs(error).max() < 1e-9
    assert (solutions[which] > -np.pi).all()
    assert (solutions[which] <= np.pi).all()


def turn_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.abs(np.pi - np.mod(np.pi - (a - b), 2.0 * np.pi)).max(axis=-1)


@every_arm
def test_forward_agrees_with_an_independent_library(model: Arm) -> None:
    quarter = np.pi / 2.0
    other = DhRobot(
        np.array([quarter, 0.0, 0.0, quarter, -quarter, 0.0]),
        np.array([0.0, model.a2, model.a3, 0.0, 0.0, 0.0]),
        np.array([model.d1, 0.0, 0.0, model.d4, model.d5, model.d6]),
    )
    joints = random_joints(200)
    assert np.abs(model.forward(joints) - np.array([other.fwdKin(q) for q in joints])).max() < 1e-9


@every_arm
def test_inverse_undoes_forward(model: Arm) -> None:
    joints = random_joints(2000)
    poses = model.forward(joints)
    solutions = model.inverse(poses)
    assert_reaches(model, poses, solutions)
    found = np.nanmin(turn_between(solutions, joints[:, None]), axis=1)
    assert found.max() < 1e-6


@settings(max_examples=200, deadline=None)
@given(st.lists(angle, min_size=6, max_size=6))
def test_inverse_reaches_whatever_forward_gives(joints: list[float]) -> None:
    model = arm("ur10e")
    poses = model.forward(np.array([joints]))
    solutions = model.inverse(poses)
    assert_reaches(model, poses, solutions)
    if (
        not 1e-13 < abs(np.sin(joints[4])) < 1e-5
    ):  # there rounding turns joint 6, which an arm at full stretch misses
        assert (~np.isnan(solutions)).any()


@every_arm
@pytest.mark.parametrize(
    "joints",
    [
        (0.3, -1.2, 1.1, -0.7, 0.0, 0.9),
        (0.3, -1.2, 1.1, -0.7, np.pi, 0.9),
        (0.3, -1.2, 0.0, -0.7, 1.3, 0.9),
        (0.3, -1.2, 0.0, -0.7, 0.0, 0.9),
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        (0.0, -np.pi / 2, 0.0, -np.pi / 2, 0.0, 0.0),
    ],
    ids=["wrist in line", "wrist turned back", "stretched", "stretched, wrist in line", "zero", "upright"],
)
def test_singular_poses_are_reached(model: Arm, joints: tuple[float, ...]) -> None:
    poses = model.forward(np.array([joints]))
    solutions = model.inverse(poses)
    assert (~np.isnan(solutions)).any()
    assert_reaches(model, poses, solutions)
    assert np.array_equal(solutions, model.inverse(poses), equal_nan=True)


def test_joint_6_is_zero_where_the_wrist_is_in_line() -> None:
    model = arm("ur10e")
    solutions = model.inverse(model.forward(np.array([[0.3, -1.2, 1.1, -0.7, 0.0, 0.9]])))[0]
    in_line = np.abs(np.sin(solutions[:, 4])) < 1e-12
    assert in_line.any()
    assert (solutions[in_line, 5] == 0.0).all()


def test_a_wrist_on_the_shoulder_cylinder_is_reached() -> None:
    """The wrist as close to joint 1's axis as d4 lets it be: both shoulders are one."""
    model = arm("ur10e")
    q2, q3 = -2.0, 1.0
    # joint 4 turns the d5 bone so that the whole arm ends above the base's axis
    out = model.a2 * np.cos(q2) + model.a3 * np.cos(q2 + q3)
    pitch = np.arcsin(-out / model.d5)
    poses = model.forward(np.array([[0.4, q2, q3, pitch - q2 - q3, 1.0, 0.2]]))
    wrist = poses[0, :3, 3] - model.d6 * poses[0, :3, 2]
    assert np.hypot(wrist[0], wrist[1]) == pytest.approx(model.d4, abs=1e-9)
    solutions = model.inverse(poses)
    assert (~np.isnan(solutions)).any()
    assert_reaches(model, poses, solutions)


@every_arm
def test_out_of_reach_is_nan(model: Arm) -> None:
    poses = np.repeat(np.eye(4)[None], 3, axis=0)
    poses[0, :3, 3] = [10.0 * model.a2, 0.0, 0.0]
    poses[1, :3, 3] = [0.0, 0.0, model.d6 + 300.0]  # wrist on joint 1's axis, nearer than d4
    poses[2, :3, 3] = np.nan
    assert np.isnan(model.inverse(poses)).all()


def test_every_branch_is_continuous_along_a_path() -> None:
    model = arm("ur10e")
    start = model.forward(np.array([[0.2, -1.6, -1.7, -1.4, 1.4, 0.3]]))[0]
    t = np.linspace(0.0, 1.0, 2000)
    poses = np.repeat(start[None], len(t), axis=0)
    poses[:, :3, 3] += np.column_stack([80.0 * np.sin(6.0 * t), 90.0 * (np.cos(6.0 * t) - 1.0), 30.0 * t])
    poses[:, :3, :3] = rotation_from_vector(np.outer(0.2 * t, [1.0, -0.5, 0.3])) @ poses[:, :3, :3]
    solutions = model.inverse(poses)
    assert not np.isnan(solutions[0]).all()
    for branch in range(8):
        joints = solutions[:, branch]
        if not np.isnan(joints).any():
            assert turn_between(joints[1:], joints[:-1]).max() < 0.02


def test_poses_run_through_both_ways() -> None:
    rng = np.random.default_rng(1)
    axis = rng.normal(size=(400, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    turn = np.concatenate([[0.0, 1e-12, 1e-7, np.pi - 1e-9, np.pi], rng.uniform(0.0, np.pi, 395)])
    vectors = axis * turn[:, None]
    rotations = rotation_from_vector(vectors)
    assert np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max() < 1e-14
    assert np.abs(rotation_from_vector(vector_from_rotation(rotations)) - rotations).max() < 1e-14
    poses = np.hstack([rng.normal(size=(400, 3)) * 1000.0, vectors])
    back = vector_from_pose(pose_from_vector(poses))
    assert np.abs(back[:, :3] - poses[:, :3]).max() == 0.0
    below = turn < np.pi - 1e-6
    assert np.abs(back[below, 3:] - vectors[below]).max() < 1e-12


def test_rotations_are_those_of_another_library() -> None:
    rng = np.random.default_rng(2)
    axis = rng.normal(size=(400, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    turn = np.concatenate([[0.0, 1e-12, 1e-7, np.pi - 1e-9, np.pi], rng.uniform(0.0, 7.0, 395)])
    theirs = Rotation.from_rotvec(axis * turn[:, None])
    assert np.abs(rotation_from_vector(axis * turn[:, None]) - theirs.as_matrix()).max() < 1e-14
    assert np.abs(vector_from_rotation(theirs.as_matrix()) - theirs.as_rotvec())[5:].max() < 1e-12


def test_no_poses_give_no_poses() -> None:
    assert pose_from_vector(np.empty((0, 6))).shape == (0, 4, 4)
    assert vector_from_pose(np.empty((0, 4, 4))).shape == (0, 6)
    assert arm("ur5e").inverse(np.empty((0, 4, 4))).shape == (0, 8, 6)
    assert arm("ur5e").forward(np.empty((0, 6))).shape == (0, 4, 4)


def test_an_unknown_arm_is_answered_with_those_that_exist() -> None:
    with pytest.raises(ConfigurationError, match=r"'ur7'.*ur3, ur5, ur10.*ur10e"):
        arm("ur7")
