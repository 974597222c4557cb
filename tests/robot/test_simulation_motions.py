"""What programs make of the arm, cycle by cycle: times, places and speeds against what follows from their numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from arm_rig import CYCLE, HOME, LIMITS, START, Rig, pose, trapezoid

from robot.simulation.machine import RuntimeState
from robot.simulation.power import SafetyMode


@pytest.fixture
def rig() -> Rig:
    """An arm at home."""
    return Rig()


@pytest.mark.parametrize(("speed", "acceleration"), [(0.2, 1.0), (1.0, 2.0), (1.05, 1.4)])
@pytest.mark.parametrize("turn", [0.1, 0.6, 1.5])
def test_a_joint_move_takes_as_long_as_its_trapezoid(rig, turn, speed, acceleration) -> None:
    end = [turn, *(q + 0.3 * turn for q in HOME[1:])]
    rows = rig.run(f"movej({end}, a={acceleration}, v={speed})")
    takes = trapezoid(turn, speed, acceleration)
    assert rows.lasted == pytest.approx(takes, rel=0.01, abs=3 * CYCLE)
    assert rows.joints[-1] == pytest.approx(end, abs=1e-12)
    assert np.abs(rows.joint_speeds).max() <= speed * (1 + 1e-9)
    # All joints keep step with the leading one, all along the trapezoid.
    share = (rows.joints[:, 0] - HOME[0]) / turn
    assert rows.joints == pytest.approx(np.array(HOME) + share[:, None] * (np.array(end) - HOME), abs=1e-12)
    peak = min(speed, math.sqrt(acceleration * turn))
    t = np.clip(rows.time - (rows.lasted - takes), 0.0, takes)
    ramp = peak / acceleration
    way = np.where(t < ramp, 0.5 * acceleration * t**2, peak * (t - 0.5 * ramp))
    way = np.where(t > takes - ramp, turn - 0.5 * acceleration * (takes - t) ** 2, way)
    assert np.abs(share * turn - way).max() < 2 * CYCLE * peak


def test_a_joint_move_with_a_time_takes_it(rig) -> None:
    assert rig.run("movej([0.4, -1.5, -1.4, -1.6, 1.5, 0.1], t=2)").lasted == pytest.approx(2.0, rel=0.01)


def test_no_joint_is_moved_faster_than_it_turns(rig) -> None:
    rows = rig.run(f"movej({[1.5, *HOME[1:5], -2.5]}, a=20, v=3.1)")
    assert (np.abs(rows.joint_speeds) <= LIMITS * (1 + 1e-9)).all()
    assert np.abs(rows.joint_speeds[:, 5]).max() == pytest.approx(3.1, rel=0.01)
    assert rig.machine.safety is SafetyMode.NORMAL


@pytest.mark.parametrize("blend", [5.0, 40.0])
def test_joint_moves_are_rounded_within_the_radius_at_their_speed(rig, blend) -> None:
    first, second = np.array([0.3, *HOME[1:]]), np.array([0.3, HOME[1] - 0.3, *HOME[2:]])
    rows = rig.run(
        f"movej({first.tolist()}, a=4, v=0.5, r={blend / 1000})",
        f"movej({second.tolist()}, a=4, v=0.5)",
    )
    model, tool = rig.machine.arm, rig.machine.tool
    corner = (model.forward(first[None]) @ tool)[0, :3, 3] - rig.tool
    away = np.linalg.norm(rows.places - corner, axis=1)
    on_first = np.abs(rows.joints - [[q, *HOME[1:]] for q in rows.joints[:, 0]]).max(axis=1) < 1e-9
    on_second = np.abs(rows.joints[:, 0] - 0.3) < 1e-9
    assert away[~on_first & ~on_second].max() <= blend * (1 + 1e-9)
    assert 0.0 < away.min() < blend
    assert rows.joints[-1] == pytest.approx(second, abs=1e-12)
    # The speed goes over from the one joint to the other: no rest, no jump, never faster.
    both = np.abs(rows.joint_speeds[:, :2]).sum(axis=1)
    cruising = (rows.time > 0.14) & (rows.time < rows.lasted - 0.14)
    assert both[cruising] == pytest.approx(0.5, rel=0.01)
    rested = rig.run(f"movej({HOME}, a=4, v=0.5)", f"movej({first.tolist()}, a=4, v=0.5)")
    assert rows.lasted < rested.lasted + trapezoid(0.3, 0.5, 4.0)


def test_a_chain_of_short_joint_moves_is_run_at_its_speed(rig) -> None:
    rows = rig.run(
        "q = get_actual_joint_positions()",
        "i = 0",
        "while i < 120:",
        "  q[0] = q[0] + 0.005",
        "  q[1] = q[1] - 0.002",
        "  movej(q, a=1.4, v=0.5, r=0.001)",
        "  i = i + 1",
        "end",
    )
    assert rows.lasted == pytest.approx(trapezoid(0.6, 0.5, 1.4), rel=0.01)
    moving = rows.joint_speeds[rows.joint_speeds[:, 0] > 0.0, 0]
    assert np.abs(np.diff(moving)).max() / CYCLE < 1.4 * (1 + 1e-6)
    assert rows.joints[-1] == pytest.approx([0.6, HOME[1] - 0.24, *HOME[2:]], abs=1e-9)


def test_a_joint_move_to_a_pose_takes_the_nearest_posture(rig) -> None:
    end = [0.2, -1.3, -1.7, -1.5, 1.6, 0.4]
    rows = rig.run(f"movej(get_forward_kin({end}), v=1)")
    assert rows.joints[-1] == pytest.approx(end, abs=1e-6)
    through = [0.2, -1.3, -1.7, -1.5, 1.6, 6.0]
    rows = rig.run(f"movej({through}, v=3, a=10, r=0.01)", f"movej(get_forward_kin({[*end[:5], 6.2]}), v=1)")
    assert rows.joints[-1, 5] == pytest.approx(6.2, abs=1e-6)


@pytest.mark.parametrize("way", [3.0, 40.0, 300.0])
def test_a_straight_move_takes_as_long_as_its_trapezoid(rig, way) -> None:
    rows = rig.run(START, f"movel({pose(y=way)}, a=1, v=0.1)")
    assert rows.lasted == pytest.approx(trapezoid(way, 100.0, 1000.0), rel=0.01, abs=3 * CYCLE)
    assert rows.places[-1] == pytest.approx([0, way, 0], abs=1e-6)
    assert np.abs(rows.places[:, [0, 2]]).max() < 1e-6


def test_a_process_move_keeps_its_speed_through_its_blends(rig) -> None:
    corners = [(60, 0, 0), (60, 60, 0), (0, 60, 0), (0, 0, 0), (60, 0, 0)]
    rows = rig.run(START, *(f"movep({pose(*corner)}, a=1.5, v=0.08, r=0.006)" for corner in corners))
    cruising = (rows.time > 0.07) & (rows.time < rows.lasted - 0.07)
    assert np.abs(rows.speed[cruising] / 80.0 - 1.0).max() < 0.005
    length = 300.0 - 4 * (2 * 6.0 - 6.0 * math.pi / 2)
    assert rows.lasted == pytest.approx(length / 80.0 + 80.0 / 1500.0, rel=0.01)
    for corner in corners[1:3]:
        bulge = 6.0 * (math.sqrt(2.0) - 1.0)
        assert np.linalg.norm(rows.places - corner, axis=1).min() == pytest.approx(bulge, abs=0.1)


def test_a_program_tells_many_targets_ahead_where_they_are_close(rig) -> None:
    n, side = 150, 2.0
    rows = rig.run(
        START,
        "i = 0",
        f"while i < {n}:",
        "  i = i + 1",
        f"  movel(pose_add(start, p[0, i * {side / 1000}, 0, 0, 0, 0]), a=1, v=0.25, r=0.0009)",
        "end",
    )
    assert rows.lasted == pytest.approx(trapezoid(n * side, 250.0, 1000.0), rel=0.01)
    assert rows.places[-1] == pytest.approx([0, n * side, 0], abs=1e-6)
    assert rows.places[:, 1].max() <= n * side + 1e-6
    assert np.abs(np.diff(rows.speed)).max() / CYCLE < 1000.0 * (1 + 1e-6)


def test_a_program_that_ends_in_a_blend_ends_with_the_arm_at_its_target(rig) -> None:
    rows = rig.run(START, f"movel({pose(y=50)}, a=0.5, v=0.2, r=0.005)")
    assert rows.places[-1] == pytest.approx([0, 50, 0], abs=1e-6)
    assert rows.lasted == pytest.approx(trapezoid(50, 200.0, 500.0), rel=0.01, abs=3 * CYCLE)


def test_what_stands_between_two_moves_waits_for_the_blend(rig) -> None:
    rig.load(
        START,
        f"movel({pose(y=60)}, a=2, v=0.1, r=0.01)",
        "set_digital_out(0, True)",
        f"movel({pose(y=60, x=60)}, a=2, v=0.1)",
        "set_digital_out(1, True)",
    )
    seen = {}
    for _ in range(1500):
        rig.step()
        for bit in (0, 1):
            if rig.machine.digital_outputs >> bit & 1:
                seen.setdefault(bit, np.array(rig.machine.state.pose[:3]) - rig.tool)
    assert np.linalg.norm(seen[0] - [0, 60, 0]) == pytest.approx(10.0, abs=0.5)
    assert seen[1] == pytest.approx([60, 60, 0], abs=1e-6)


def test_a_move_of_another_kind_begins_at_the_target_of_the_one_before(rig) -> None:
    between = [0.1, *HOME[1:]]
    rows = rig.run(
        f"movej({between}, v=0.5, r=0.02)",
        "start = get_actual_tcp_pose()",
        f"movel({pose(z=30)}, v=0.1, r=0.01)",
        f"movej({HOME}, v=0.5)",
    )
    model, tool = rig.machine.arm, rig.machine.tool
    turned = (model.forward(np.array([between])) @ tool)[0, :3, 3] - rig.tool
    assert np.linalg.norm(rows.places - turned, axis=1).min() < 1e-6
    assert rows.joints[-1] == pytest.approx(HOME, abs=1e-12)


def test_moves_that_are_broken_off_end_at_rest_before_the_next_begins(rig) -> None:
    rig.load(
        START,
        "thread mover():",
        f"  movel({pose(y=300)}, a=1, v=0.2)",
        "end",
        "runs = run mover()",
        "sleep(0.6)",
        "kill runs",
        "stopl(4)",
        'textmsg("at rest")',
        f"movej({HOME}, a=2, v=1)",
    )
    while "at rest" not in rig.said:
        rig.step()
    speeds = rig.rows().speed
    assert speeds.max() == pytest.approx(200.0, rel=1e-3)
    assert np.diff(speeds).min() / CYCLE == pytest.approx(-4000.0, rel=1e-3)
    assert speeds[-1] < 10.0
    rig.steps(2.0)
    assert rig.machine.state.joints == pytest.approx(HOME, abs=1e-12)


@pytest.mark.parametrize("kind", ["movel", "movej"])
def test_a_program_that_takes_over_in_a_blend_begins_from_rest(rig, kind) -> None:
    end = [0.3, *HOME[1:]]
    rig.load(f"{kind}({end}, a=1, v=0.2, r=0.02)", "sleep(5)")
    while rig.machine.motion is None or not getattr(rig.machine.motion, "asking", False):
        rig.step()
    rows = rig.run(f"{kind}({HOME}, a=1, v=0.2)")
    assert rows.joints[-1] == pytest.approx(HOME, abs=1e-9)
    assert rows.speed.min() < 1e-9


@pytest.mark.parametrize("kind", ["movel", "movep", "movej"])
def test_targets_where_the_arm_already_is_take_a_cycle_each(rig, kind) -> None:
    rows = rig.run("i = 0", "while i < 30:", f"  {kind}({HOME}, r=0.01)", "  i = i + 1", "end")
    assert rows.lasted == pytest.approx(30 * CYCLE, abs=4 * CYCLE)
    end = [0.1, *HOME[1:]]
    rows = rig.run(
        f"{kind}({end}, r=0.01)", "i = 0", "while i < 300:", f"  {kind}({end}, r=0.01)", "  i = i + 1", "end"
    )
    assert rows.joints[-1] == pytest.approx(end, abs=1e-9)


def test_the_target_waypoint_is_where_the_move_leads(rig) -> None:
    rig.load(
        START,
        "thread tell():",
        "  while True:",
        "    found = get_target_waypoint()",
        "    write_output_float_register(0, found[1] - start[1])",
        "    sync()",
        "  end",
        "end",
        "run tell()",
        f"movel({pose(y=60)}, a=2, v=0.1, r=0.01)",
        f"movel({pose(y=60, x=60)}, a=2, v=0.1)",
        f"movej({HOME}, v=1)",
    )
    told = []
    while rig.machine.runtime is RuntimeState.PLAYING or len(told) < 5:
        rig.step()
        told.append(round(1000.0 * rig.machine.output_doubles[0], 3))
    assert set(told[2:]) == {0.0, 60.0}
    assert told[2] == 60.0
    assert told[-2] == 0.0


# -- slider and pauses


@pytest.mark.parametrize("line", ["movej({end}, v=0.5, r=0.02)", "movel({end}, v=0.05, r=0.02)"])
def test_slider_and_pause_leave_the_arm_on_its_path(rig, line) -> None:
    ends = [[0.2, *HOME[1:]], [0.2, HOME[1] - 0.2, *HOME[2:]], HOME]
    lines = [line.format(end=end) for end in ends]
    path = rig.run(*lines).joints
    rig.load(*lines)
    rig.seen.clear()
    machine = rig.machine
    rng = np.random.default_rng(4)
    while machine.runtime is not RuntimeState.STOPPED or len(rig.seen) < 10:
        at = len(rig.seen)
        if at % 150 == 0:
            machine.slider = float(rng.uniform(0.2, 1.0))
        if at % 700 == 400:
            machine.pause_program()
        if at % 700 == 600:
            assert machine.runtime is RuntimeState.PAUSED
            still = machine.state.joints
        if at % 700 == 650:
            assert machine.state.joints == still
            assert machine.play_program()
        rig.step()
        assert at < 20000
    joints = rig.rows().joints
    assert joints[-1] == pytest.approx(HOME, abs=1e-9)
    gaps = np.array([np.abs(path - q).max(axis=1).min() for q in joints[::20]])
    assert gaps.max() < 1.5e-3  # of a path whose samples are a milliradian apart
    assert (np.abs(np.diff(joints, axis=0)) < LIMITS * CYCLE).all()


@pytest.mark.parametrize(
    "line", ["movej([1, -1.57, -1.57, -1.57, 1.57, 0], v=1)", f"movel({pose(y=300)}, a=1, v=0.5)"]
)
def test_a_pause_that_is_taken_back_while_the_arm_brakes_goes_on_from_there(rig, line) -> None:
    whole = rig.run(START, line)
    rig.run(f"movej({HOME}, v=1)")
    rig.load(START, line)
    rig.seen.clear()
    rig.steps(0.5)
    rig.machine.pause_program()
    rig.steps(0.01)
    assert rig.machine.runtime is RuntimeState.PAUSING
    assert rig.machine.play_program()
    while rig.machine.runtime is RuntimeState.PLAYING:
        rig.step()
        assert len(rig.seen) * CYCLE < 5.0
    rows = rig.rows()
    assert rows.joints[-1] == pytest.approx(whole.joints[-1], abs=1e-9)
    # It goes on where it was, at its speed.
    assert (np.abs(np.diff(rows.joint_speeds[1:], axis=0)) < 0.2).all()


# -- limits


def test_a_joint_that_would_turn_too_fast_stops_the_arm(rig) -> None:
    rig.run(f"movej({[0.0, -1.57, -1.57, 0.0, 0.35, 0.0]}, v=1)")
    seen = len(rig.seen)
    rig.load("speedj([4, 0, 0, 0, 0, 0], a=20, t=3)")
    rig.steps(1.0)
    assert rig.machine.safety is SafetyMode.PROTECTIVE_STOP
    assert rig.machine.runtime is not RuntimeState.PLAYING
    assert rig.machine.motion is None or rig.machine.motion.resting
    steps = np.abs(np.diff(rig.rows().joints[seen:], axis=0)).max(axis=0)
    assert (steps < 1.02 * LIMITS * CYCLE).all()


@pytest.mark.parametrize("number", [math.nan, math.inf])
@pytest.mark.parametrize(
    "line",
    [
        "movej([x, 0, 0, 0, 0, 0])",
        "movej(get_actual_joint_positions(), a=x)",
        "movel([x, 0, 0, 0, 0, 0])",
        "movel(p[0.5, 0.2, x, 0, 3, 0])",
        "movel(get_actual_tcp_pose(), t=x)",
        "movep(get_actual_tcp_pose(), r=x)",
        "servoj([x, 0, 0, 0, 0, 0])",
        "servoj(get_actual_joint_positions(), t=x)",
        "servoc(p[0.5, 0.2, x, 0, 3, 0])",
        "speedj([x, 0, 0, 0, 0, 0], a=1, t=1)",
        "speedl([x, 0, 0, 0, 0, 0], a=1, t=1)",
        "speedl([0, 0, 0.01, 0, 0, 0], a=1, t=1, aRot=x)",
    ],
)
def test_what_is_no_number_moves_nothing(rig, line, number) -> None:
    rig.machine.input_doubles[0] = number
    told = []
    rig.machine.on_fault = told.append
    rows = rig.run("x = read_input_float_register(0)", line)
    assert "must be finite" in str(told[0])
    assert "line 3" in str(told[0])
    assert (rows.joints == np.array(HOME)).all()


@pytest.mark.parametrize(
    "line",
    [
        "movej([6.5, -1.57, -1.57, -1.57, 1.57, 0])",
        "movel(p[2.5, 0, 0.5, 0, 0, 0], v=1, a=10)",
        "movej(p[2.5, 0, 0.5, 0, 0, 0])",
        "movel([0, -1.57, -1.57, -1.57, 1.57, 0], v=0)",
        "movel([0, -1.57, -1.57, -1.57, 1.57, 0], a=-1)",
        "movel([0, -1.57, -1.57, -1.57, 1.57, 0], r=-1)",
        "movej([0, -1.57, -1.57, -1.57, 1.57, 0], t=-1)",
        "movec(get_actual_tcp_pose(), get_actual_tcp_pose())",
        "servoj([0, -1.57, -1.57, -1.57, 1.57, 0], lookahead_time=0.02)",
        "servoj([0, -1.57, -1.57, -1.57, 1.57, 0], lookahead_time=0.3)",
        "servoj([0, -1.57, -1.57, -1.57, 1.57, 0], gain=50)",
        "servoj([0, -1.57, -1.57, -1.57, 1.57, 0], gain=2100)",
        "speedl([0, 0, 0.1, 0, 0, 0], a=0)",
        "stopj(0)",
    ],
)
def test_what_cannot_be_done_ends_the_program(rig, line, capfd) -> None:
    faults = []
    rig.machine.on_fault = faults.append
    rig.load(line, 'textmsg("went on")')
    rig.steps(4.0)
    assert rig.machine.runtime is RuntimeState.STOPPED
    assert "went on" not in rig.said
    assert faults or "program stopped" in capfd.readouterr().err
