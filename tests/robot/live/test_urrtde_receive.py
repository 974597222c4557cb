"""Every getter of ur-rtde's receive interface: its values agree with each other and with what was done."""

from __future__ import annotations

import numpy as np
import pytest
from rtde_receive import RTDEReceiveInterface
from urrtde.tour import CYCLE

from planning import arm
from planning.pose import pose_from_vector

VECTORS = (
    "TargetQ TargetQd TargetQdd TargetCurrent TargetMoment ActualQ ActualQd ActualCurrent JointControlOutput "
    "ActualTCPPose ActualTCPSpeed ActualTCPForce TargetTCPPose TargetTCPSpeed JointTemperatures ActualJointVoltage "
    "FtRawWrench PayloadInertia JointMode"
)
SPEEDING = 0.2
"""Acceleration of the base at the second look, rad/s²."""


def test_every_method_is_called(tour) -> None:
    methods = {name for name in vars(RTDEReceiveInterface) if name[0] != "_"}
    assert methods - tour.called("receive") == set()


@pytest.mark.parametrize("look", ["resting", "speeding"])
def test_values_are_finite_and_of_their_length(tour, look) -> None:
    told = tour["received"][look]
    for name in VECTORS.split():
        assert len(told[f"get{name}"]) == 6
        assert np.isfinite(told[f"get{name}"]).all()
    for name in ("ActualToolAccelerometer", "PayloadCog"):
        assert len(told[f"get{name}"]) == 3
    for name in ("Timestamp", "ActualExecutionTime", "ActualRobotVoltage"):
        assert told[f"get{name}"] > 0.0
    for name in ("ActualRobotCurrent", "ActualMomentum", "Payload"):
        assert told[f"get{name}"] >= 0.0


@pytest.mark.parametrize("look", ["resting", "speeding"])
def test_targets_and_what_is_there_agree(tour, look) -> None:
    told = tour["received"][look]
    for name in ("Q", "Qd", "TCPPose", "TCPSpeed"):
        assert told[f"getActual{name}"] == pytest.approx(told[f"getTarget{name}"], abs=1e-9)


@pytest.mark.parametrize("look", ["resting", "speeding"])
def test_the_tool_is_where_the_joints_put_it_and_moves_as_they_do(tour, look) -> None:
    told = tour["received"][look]
    tool = pose_from_vector(np.array([tour.cell.tool.tcp]))[0]
    q, qd = np.array(told["getActualQ"]), np.array(told["getActualQd"])
    step = 1e-6
    before, here, after = (
        arm("ur10e").forward((q + k * step * qd)[None])[0] @ tool for k in (-1.0, 0.0, 1.0)
    )
    reported = pose_from_vector(np.array([told["getActualTCPPose"]]))[0]
    assert here[:3, 3] / 1000.0 == pytest.approx(reported[:3, 3], abs=1e-9)
    assert np.abs(here[:3, :3] - reported[:3, :3]).max() < 1e-9
    velocity = (after[:3, 3] - before[:3, 3]) / (2.0 * step) / 1000.0
    assert told["getActualTCPSpeed"][:3] == pytest.approx(velocity, abs=SPEEDING * CYCLE)
    turning = (after[:3, :3] - before[:3, :3]) / (2.0 * step) @ here[:3, :3].T
    spin = [turning[2, 1], turning[0, 2], turning[1, 0]]
    assert told["getActualTCPSpeed"][3:] == pytest.approx(spin, abs=SPEEDING * CYCLE)


def test_rest_and_motion_differ(tour) -> None:
    told = tour["received"]
    assert told["resting"]["getActualQd"] == [0.0] * 6
    assert told["speeding"]["getActualQd"][0] > 0.02
    assert told["speeding"]["getTimestamp"] > told["resting"]["getTimestamp"]
    assert told["resting"]["getTargetQdd"] == pytest.approx([0.0] * 6, abs=1e-9)


def test_accelerations_are_those_of_the_move(tour) -> None:
    """Each is what a cycle changed: on a machine that holds up every other cycle they scatter."""
    told = np.median(tour["received"]["accelerations"], axis=0)
    assert told == pytest.approx([SPEEDING, 0.0, 0.0, 0.0, 0.0, 0.0], abs=0.3 * SPEEDING)


def test_states_are_those_of_a_robot_that_runs_a_program(tour) -> None:
    told = tour["received"]["speeding"]
    assert told["getRobotMode"] == 7
    assert told["getJointMode"] == [253] * 6
    assert (told["getSafetyMode"], told["getSafetyStatusBits"]) == (1, 1)
    assert (told["getRuntimeState"], told["getRobotStatus"]) == (2, 3)
    assert not told["isProtectiveStopped"]
    assert not told["isEmergencyStopped"]
    assert told["isConnected"]
    assert told["getTargetSpeedFraction"] == 1.0
    assert told["getSpeedScalingCombined"] == told["getSpeedScaling"] == 1.0


def test_a_robot_at_rest_feels_gravity_and_has_its_voltages(tour) -> None:
    told = tour["received"]["resting"]
    assert np.linalg.norm(told["getActualToolAccelerometer"]) == pytest.approx(9.82, abs=0.05)
    for name in ("Main", "Robot"):
        assert told[f"getActual{name}Voltage"] == pytest.approx(48.0, abs=5.0)
    assert all(10.0 < one < 80.0 for one in told["getJointTemperatures"])
    assert told["getActualTCPForce"] == pytest.approx([0.0] * 6)
    assert told["getFtRawWrench"] == pytest.approx([0.0] * 6)
    assert told["getActualMomentum"] == pytest.approx(0.0)


def test_nothing_is_wired_to_the_inputs(tour) -> None:
    told = tour["received"]
    assert told["resting"]["getActualDigitalInputBits"] == 0
    assert not any(told["inputs"])
    for i in (0, 1):
        assert told["resting"][f"getStandardAnalogInput{i}"] == 0.0


def test_what_was_received_is_recorded(tour) -> None:
    told = tour["received"]
    assert told["recorded"] == [True, True]
    assert told["head"][0] == "timestamp"
    body = np.array(told["body"])
    assert len(body) > 10
    assert (np.diff(body[:, 0]) >= 0.0).all()
    assert body[-1, 0] > body[0, 0] + 0.2
    q = body[:, [told["head"].index(f"actual_q_{i}") for i in range(6)]]
    assert q[0, 0] == pytest.approx(0.5, abs=0.02)
    assert q[-1, 0] == pytest.approx(0.0, abs=1e-6)
