"""What a client steers step by step, cycle by cycle: a servo's lag, speeds and how they are reached."""

from __future__ import annotations

import math

import numpy as np
import pytest
from arm_rig import CYCLE, HOME, START, Rig, pose

from robot.simulation.machine import RuntimeState


@pytest.fixture
def rig() -> Rig:
    """An arm at home."""
    return Rig()


@pytest.mark.parametrize(("lookahead", "gain"), [(0.03, 300), (0.1, 300), (0.2, 300), (0.2, 600)])
def test_a_servo_lags_as_its_lookahead_says(rig, lookahead, gain) -> None:
    speed, lag = 0.1, lookahead * 300 / gain
    rig.load(
        "q = get_actual_joint_positions()",
        "while True:",
        f"  q[0] = q[0] + {speed * CYCLE}",
        "  write_output_float_register(0, q[0])",
        f"  servoj(q, t={CYCLE}, lookahead_time={lookahead}, gain={gain})",
        "end",
    )
    rig.steps(1.5)
    behind = rig.machine.output_doubles[0] - rig.machine.state.joints[0]
    assert behind == pytest.approx(speed * lag, rel=0.01, abs=speed * CYCLE)
    assert rig.machine.state.joint_speeds[0] == pytest.approx(speed, rel=5e-3)


@pytest.mark.parametrize("lookahead", [0.05, 0.1])
def test_a_servo_on_a_circle_lags_as_its_lookahead_says(rig, lookahead) -> None:
    radius, rate = 50.0, 2.0
    rig.load(
        START,
        "i = 0",
        "while True:",
        f"  angle = i * {rate * CYCLE}",
        f"  x = p[sin(angle) * {radius / 1000}, {radius / 1000} - cos(angle) * {radius / 1000}, 0, 0, 0, 0]",
        f"  servoj(get_inverse_kin(pose_add(start, x)), t={CYCLE}, lookahead_time={lookahead}, gain=300)",
        "  i = i + 1",
        "end",
    )
    begun = rig.machine.time
    rig.steps(2.0 * math.pi / rate)
    rows = rig.rows(begun)
    settled = rows.time > 10.0 * lookahead
    out = rows.places[:, :2] - [0.0, radius]
    angle = np.unwrap(np.arctan2(out[:, 0], -out[:, 1]))
    lag = rows.time[settled] - angle[settled] / rate
    assert lag == pytest.approx(lookahead, rel=0.05, abs=2 * CYCLE)
    # A critically damped follower runs on a circle that is smaller by (half the lag times the rate)², and as much.
    size = np.linalg.norm(out[settled], axis=1)
    assert size / radius == pytest.approx(1.0 / (1.0 + (0.5 * lookahead * rate) ** 2), rel=2e-3)
    assert rows.speed[settled] == pytest.approx(rate * size, rel=2e-3)


def test_a_servo_to_a_target_that_stands_does_not_overshoot(rig) -> None:
    end = [0.05, *HOME[1:]]
    rig.load("while True:", f"  servoj({end}, t=0.002, lookahead_time=0.1, gain=300)", "end")
    rig.steps(1.0)
    joints = rig.rows().joints[:, 0]
    assert (np.diff(joints) >= 0.0).all()
    assert joints[-1] == pytest.approx(0.05, abs=1e-6)
    rate = 20.0
    t = np.arange(1, len(joints) + 1) * CYCLE
    closed = 0.05 * (1.0 - (1.0 + rate * t) * np.exp(-rate * t))
    late = len(joints) - np.count_nonzero(joints)
    assert joints[late:] == pytest.approx(closed[: len(joints) - late], abs=1e-9)


def test_a_servo_holds_its_program_for_its_time(rig) -> None:
    begun = rig.machine.time
    rig.load(f"servoj({HOME}, t=0.5)", 'textmsg("over")')
    while not rig.said:
        rig.step()
    assert rig.machine.time - begun == pytest.approx(0.5, abs=2 * CYCLE)


@pytest.mark.parametrize(
    ("line", "index", "target", "rate"),
    [
        ("speedl([0, 0.05, 0, 0, 0, 0], a=0.5, t=1)", 1, 50.0, 500.0),
        ("speedl([0, 0, 0, 0, 0, 0.2], a=10, t=1, aRot=0.4)", 5, 0.2, 0.4),
        ("speedl([0, 0, 0, 0, 0, 0.2], a=0.8, t=1)", 5, 0.2, 0.8),
    ],
)
def test_speeds_of_the_tool_are_reached_at_their_accelerations(rig, line, index, target, rate) -> None:
    rig.load(line, "stopl(2, aRot=1)")
    found = []
    for _ in range(450):
        rig.step()
        found.append(rig.machine.state.tool_speed[index])
    found = np.array(found[1:])
    assert found[-1] == pytest.approx(target, rel=1e-6)
    assert np.diff(found).max() / CYCLE == pytest.approx(rate, rel=1e-3)
    assert (found >= -1e-9).all()


def test_speeds_of_the_joints_are_reached_at_the_leading_joint_s_acceleration(rig) -> None:
    rows = rig.run("speedj([0.2, 0.1, 0, 0, 0, -0.4], a=0.8, t=1)", "stopj(2)")
    at = np.searchsorted(rows.time, 0.25)
    assert rows.joint_speeds[at, [0, 1, 5]] == pytest.approx([0.1, 0.05, -0.2], abs=0.004)
    assert rows.joint_speeds[np.searchsorted(rows.time, 0.9), [0, 1, 5]] == pytest.approx([0.2, 0.1, -0.4])
    assert rows.lasted == pytest.approx(1.0 + 0.4 / 2.0, abs=3 * CYCLE)


def test_without_a_time_a_speed_is_waited_for(rig) -> None:
    begun = rig.machine.time
    rig.load("speedl([0, 0.05, 0, 0, 0, 0], a=0.25)", 'textmsg("reached")', "stopl(1)")
    while not rig.said:
        rig.step()
    assert rig.machine.time - begun == pytest.approx(0.2, abs=3 * CYCLE)


def test_a_circular_servo_turns_towards_each_new_target(rig) -> None:
    rig.load(
        START,
        f"target = {pose(x=200)}",
        "thread lead():",
        "  while True:",
        "    servoc(target, a=1, v=0.1, r=0.03)",
        "  end",
        "end",
        "run lead()",
        "sleep(1)",
        f"target = {pose(x=90, y=100)}",
        "sleep(5)",
    )
    rig.steps(6.0)
    rows = rig.rows()
    assert rows.places[-1] == pytest.approx([90, 100, 0], abs=1e-6)
    places, speeds = rows.places, rows.speed
    moving = (rows.time > 0.15) & (speeds > 0.0)
    assert speeds.max() == pytest.approx(100.0, rel=1e-3)
    assert np.abs(np.diff(speeds)).max() / CYCLE < 1000.0 * 1.01
    turn = (rows.time > 1.05) & (places[:, 1] > 1.0) & (places[:, 1] < 25.0)
    a, b, c = places[turn][0], places[turn][len(places[turn]) // 2], places[turn][-1]
    area = np.linalg.norm(np.cross(b - a, c - a))
    around = np.linalg.norm(b - a) * np.linalg.norm(c - b) * np.linalg.norm(c - a) / (2.0 * area)
    assert around == pytest.approx(30.0, rel=0.01)
    assert moving.any()


def test_a_circular_servo_whose_target_is_too_near_comes_back_to_it(rig) -> None:
    rig.load(
        START,
        "thread lead():",
        "  while True:",
        "    servoc(target, a=0.2, v=0.1, r=0)",
        "  end",
        "end",
        f"target = {pose(x=200)}",
        "run lead()",
        "sleep(1.5)",
        "target = pose_add(get_actual_tcp_pose(), p[0.002, 0, 0, 0, 0, 0])",
        "write_output_float_register(0, target[0] - start[0])",
        "sleep(5)",
    )
    rig.steps(6.0)
    rows = rig.rows()
    assert rows.places[-1] == pytest.approx([1000.0 * rig.machine.output_doubles[0], 0, 0], abs=1e-6)
    assert np.abs(np.diff(rows.speed)).max() / CYCLE < 200.0 * 1.01


# -- the watchdog


def watched(rig, action: str) -> None:
    """A program that moves the tool for 5 s, stopped or paused when register 7 is not written for 0.1 s."""
    rig.load(
        START, f'rtde_set_watchdog("input_int_register_7", 10, {action})', f"movel({pose(y=500)}, v=0.1)"
    )


def write(rig) -> None:
    rig.machine.write_input_int(7, 1, rig.machine.time)


@pytest.mark.parametrize(
    ("action", "ends"),
    [('"stop"', RuntimeState.STOPPED), ('"pause"', RuntimeState.PAUSED), ('"ignore"', None)],
)
def test_a_program_that_nobody_kicks_is_stopped_or_paused(rig, action, ends) -> None:
    watched(rig, action)
    for _ in range(10):
        rig.steps(0.09)
        assert rig.machine.runtime is RuntimeState.PLAYING
        write(rig)
    rig.steps(0.3)
    assert rig.machine.runtime is (ends or RuntimeState.PLAYING)
    assert (rig.seen[-1][4] == 0.0) == (ends is not None)


def test_a_program_that_was_paused_for_want_of_a_kick_is_played_on(rig) -> None:
    watched(rig, '"pause"')
    rig.steps(0.5)
    assert rig.machine.runtime is RuntimeState.PAUSED
    assert rig.machine.play_program()
    while rig.machine.runtime is not RuntimeState.STOPPED:
        rig.step()
        write(rig)
        assert len(rig.seen) * CYCLE < 8.0
    assert rig.rows().places[-1] - rig.rows().places[0] == pytest.approx([0.0, 500.0, 0.0], abs=1.0)


@pytest.mark.parametrize("held_up", [0.06, 0.5])
def test_a_controller_that_was_held_up_itself_blames_no_client(rig, held_up) -> None:
    watched(rig, '"stop"')
    rig.steps(0.05)
    rig.step(held_up)
    rig.steps(0.09)
    assert rig.machine.runtime is RuntimeState.PLAYING
    rig.steps(0.02)
    assert rig.machine.runtime is RuntimeState.STOPPED


def test_a_watchdog_of_another_action_is_refused(rig) -> None:
    told = []
    rig.machine.on_fault = told.append
    watched(rig, '"halt"')
    rig.steps(0.01)
    assert "action must be 'ignore', 'pause' or 'stop', not" in str(told[0])
