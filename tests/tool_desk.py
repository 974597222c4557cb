"""Tells a tool where to go while it moves, and writes down where it was."""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from planning import arm, load_cell
from planning.pose import pose_from_vector
from robot.simulation.motions.frame import frame_of
from robot.simulation.motions.streaming import standing
from robot.simulation.motions.tool_motion import ToolMotion
from robot.simulation.motions.tool_pieces import Target

START = np.array([-300.0, -600.0, 300.0])
DOWN = np.diag([1.0, -1.0, -1.0])


def pose(place, turn=(0.0, 0.0, 0.0)):
    made = np.eye(4)
    made[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ DOWN
    made[:3, 3] = START + place
    return made


def demo_arm():
    """The demo cell's arm, how far its joints turn, and how fast."""
    cell = load_cell("ur10e-demo")
    robot = cell.robot
    return arm(robot.model), np.radians(robot.joint_limit_deg), np.radians(robot.joint_speed_deg)


def motion(ur10e, ask=lambda: None):
    """At rest with the tool at START, pointing down."""
    model, limit, fastest = ur10e
    tool = pose_from_vector(np.array([[0.0, 0.0, 100.0, 0.0, 0.0, 0.0]]))[0]
    joints = model.inverse((pose([0, 0, 0]) @ np.linalg.inv(tool))[None])[0]
    chosen = joints[~np.isnan(joints).any(axis=1)][0]
    state = standing(model, tool, tuple(chosen.tolist()))
    made = ToolMotion(model, tool, state, limit.tolist(), fastest.tolist(), ask)
    assert np.allclose(made.state.pose[:3], START)
    return made


def target(place, speed=100.0, acceleration=500.0, blend=0.0, **more):
    turn = more.pop("turn", (0.0, 0.0, 0.0))
    return Target(frame_of(pose(place, turn)), speed, acceleration, blend, **more)


def run(ur10e, targets, seconds=0.002, slider=1.0):
    """Tell target after target, each when it is asked for; time, place and speed, a row a cycle.

    No joint may turn faster than it can.
    """
    waiting = list(targets)
    moving = motion(ur10e, lambda: moving.add(waiting.pop(0)) if waiting else None)
    moving.add(waiting.pop(0))
    rows, time = [], 0.0
    while waiting or not moving.finished:
        if moving.finished:
            moving.add(waiting.pop(0))
        moving.advance(seconds, seconds * slider, slider)
        time += seconds
        rows.append([time, *moving.state.pose[:3], math.hypot(*moving.state.tool_speed[:3])])
        assert (np.abs(moving.state.joint_speeds) <= 0.951 * ur10e[2]).all()
        assert time < 20.0
    return np.array(rows), moving
