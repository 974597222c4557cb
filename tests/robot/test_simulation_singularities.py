"""Moves of the tool beside singularities and joints' limits: as slow as the joints need, and no slower."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from arm_rig import CYCLE, LIMITS, Rig

from robot.simulation.machine import RuntimeState
from robot.simulation.motions.arm_frame import flange_frame
from robot.simulation.power import SafetyMode


@pytest.fixture
def rig() -> Rig:
    """An arm at home."""
    return Rig()


CYCLES = pytest.mark.parametrize("cycle", [CYCLE, 4 * CYCLE, 20 * CYCLE])


def held_up(rig, wrist: float, way: str, options: str, cycle: float = CYCLE) -> SimpleNamespace:
    """Run a move of the tool that begins beside the wrist's singularity: no joint turns too fast, and none is lost."""
    rig.run(f"movej({[0.0, -1.0, -1.6, -1.0, wrist, 0.0]}, v=1)")
    rig.seen.clear()
    rig.load(f"movel(pose_trans(get_actual_tcp_pose(), p[{way}, 0, 0, 0]), {options})")
    begun = rig.machine.time
    rig.step(cycle)
    while rig.machine.runtime is RuntimeState.PLAYING or rig.machine.motion is not None:
        rig.step(cycle)
        assert rig.machine.time - begun < 5.0
    rows = rig.rows(begun)
    assert rig.machine.safety is SafetyMode.NORMAL
    assert (np.abs(rows.joint_speeds) <= 0.951 * LIMITS).all()
    return rows


@CYCLES
@pytest.mark.parametrize(
    ("wrist", "way", "speed", "takes"),
    [
        (0.15, "0.3, 0, 0", 0.8, 0.75),
        (0.15, "0, 0, 0.3", 0.8, 0.65),
        (0.15, "0, 0, -0.3", 0.8, 1.74),
        (1e-3, "0, 0, -0.1", 0.2, 1.6),
        (1e-4, "0, 0, -0.1", 0.2, 1.6),
    ],
)
def test_a_move_of_the_tool_is_as_slow_as_its_joints_need(rig, wrist, way, speed, takes, cycle) -> None:
    rows = held_up(rig, wrist, way, f"a=3, v={speed}", cycle)
    assert np.abs(rows.joint_speeds / LIMITS).max() > 0.85
    length = 1000.0 * np.linalg.norm([float(part) for part in way.split(",")])
    places = rows.places - rows.places[0]
    end = places[-1] / np.linalg.norm(places[-1])
    along = places @ end
    assert (np.diff(along) >= 0.0).all()
    assert np.abs(places - np.outer(along, end)).max() < 1e-6
    assert along[-1] == pytest.approx(length, abs=2.0 * cycle * cycle * 3000.0)  # the first cycle is not seen
    assert rows.lasted == pytest.approx(takes, abs=0.1 + 3 * cycle)


@CYCLES
@pytest.mark.parametrize("acceleration", [0.2, 1.0, 3.0])
def test_a_move_of_the_tool_passes_a_singularity_where_its_joints_can(rig, acceleration, cycle) -> None:
    aim = [0.0, -1.57, -1.57, 0.0, -0.35, 0.0]
    rig.run(f"movej({[0.0, -1.57, -1.57, 0.0, 0.35, 0.0]}, v=1)")
    rig.load(f"movel({aim}, a={acceleration}, v=0.1)")
    rig.seen.clear()
    for _ in range(round(6.0 / cycle)):
        rig.step(cycle)
    rows = rig.rows()
    assert rig.machine.safety is SafetyMode.NORMAL
    assert (np.abs(rows.joint_speeds) <= 0.951 * LIMITS).all()
    wanted = flange_frame(rig.machine.arm, aim)
    assert np.allclose(flange_frame(rig.machine.arm, rows.joints[-1]), wanted, atol=1e-6)


@CYCLES
def test_a_move_of_the_tool_ends_where_a_joint_would_have_to_turn_first(rig, cycle) -> None:
    told = []
    rig.machine.on_fault = told.append
    rows = held_up(rig, 0.0, "0, 0, 0.1", "a=1, v=0.1", cycle)
    assert "joint 4 would have to turn while the tool stands" in str(told[0])
    assert np.linalg.norm(rows.places[-1] - rows.places[0]) < 0.01


@CYCLES
def test_a_move_of_the_tool_ends_at_a_joints_limit(rig, cycle) -> None:
    rig.run("movej([0, -1.57, -1.57, -1.57, 1.57, 6.0])")
    told = []
    rig.machine.on_fault = told.append
    rig.load("movel(pose_trans(get_actual_tcp_pose(), p[0, 0, 0, 0, 0, 1]))")
    for _ in range(round(4.0 / cycle)):
        rig.step(cycle)
    assert "joint 6 is at its limit" in str(told[0])
    assert rig.machine.state.joints[5] == pytest.approx(2.0 * math.pi, abs=1e-3)


@pytest.mark.parametrize("wrist", [0.15, 0.05, 0.02])
def test_a_pause_beside_a_singularity_is_no_stop(rig, wrist) -> None:
    whole = held_up(rig, wrist, "0, 0, -0.3", "a=3, v=0.8")
    for after in np.linspace(0.05, 0.95, 8) * whole.lasted:
        rig.run(f"movej({[0.0, -1.0, -1.6, -1.0, wrist, 0.0]}, v=1)")
        rig.seen.clear()
        rig.load("movel(pose_trans(get_actual_tcp_pose(), p[0, 0, -0.3, 0, 0, 0]), a=3, v=0.8)")
        rig.steps(after)
        rig.machine.pause_program()
        rig.steps(1.0)
        assert rig.machine.motion is None or rig.machine.motion.resting
        assert rig.machine.play_program()
        while rig.machine.motion is not None:
            rig.step()
            assert len(rig.seen) * CYCLE < 10.0
        rows = rig.rows()
        assert rig.machine.safety is SafetyMode.NORMAL
        assert (np.abs(rows.joint_speeds) <= 0.951 * LIMITS).all()
        assert np.allclose(rows.joints[-1], whole.joints[-1], atol=1e-9)
