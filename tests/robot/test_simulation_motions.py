"""What programs make of the arm, cycle by cycle: times, places and speeds against what follows from their numbers.

The machine is stepped here, without its servers and its clock.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from planning import load_cell
from robot.simulation.machine import Machine, RuntimeState
from robot.simulation.power import SafetyMode
from robot.simulation.programs.library import library
from robot.simulation.programs.moves import ScriptMoves
from robot.simulation.programs.program import ScriptProgram
from robot.simulation.urscript import compiled

CYCLE = 0.002
HOME = [0.0, -math.pi / 2, -math.pi / 2, -math.pi / 2, math.pi / 2, 0.0]
LIMITS = np.radians([120.0, 120.0, 180.0, 180.0, 180.0, 180.0])


class Rig:
    """A machine whose cycles are counted out."""

    def __init__(self) -> None:
        self.machine = Machine(load_cell("ur10e-demo"), (5, 12, 0, 0))
        self.said: list[str] = []
        self.seen: list[list[float]] = []
        self.tool = np.array(self.machine.state.pose[:3])

    def load(self, *lines: str) -> None:
        text = "\n".join(["def program():", *(f"  {line}" for line in lines), "end"])
        functions = library(self.machine, ScriptMoves(self.machine, lambda: lambda: None), self.said.append)
        self.machine.load(ScriptProgram(self.machine, compiled(text, functions), self.said.append), 0.0)

    def step(self, seconds: float = CYCLE) -> None:
        machine = self.machine
        machine.cycle(machine.time + seconds, machine.time + seconds)
        state = machine.state
        speed = math.hypot(*state.tool_speed[:3])
        self.seen.append([machine.time, *state.pose[:3], speed, *state.joints, *state.joint_speeds])

    def steps(self, seconds: float) -> None:
        for _ in range(round(seconds / CYCLE)):
            self.step()

    def run(self, *lines: str, longest: float = 30.0) -> SimpleNamespace:
        """Run a program until the arm rests: time, place and speed of the tool, joints and their speeds."""
        self.load(*lines)
        self.seen.clear()
        begun = self.machine.time
        while not self.seen or self.machine.runtime is not RuntimeState.STOPPED or self.machine.motion:
            self.step()
            assert self.machine.time - begun < longest
        return self.rows(begun)

    def rows(self, begun: float = 0.0) -> SimpleNamespace:
        table = np.array(self.seen)
        return SimpleNamespace(
            time=table[:, 0] - begun,
            lasted=table[-1, 0] - begun,
            places=table[:, 1:4] - self.tool,
            speed=table[:, 4],
            joints=table[:, 5:11],
            joint_speeds=table[:, 11:17],
        )


@pytest.fixture
def rig() -> Rig:
    """An arm at home."""
    return Rig()


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> str:
    """A place near the tool's first one, offsets in mm."""
    return f"pose_add(start, p[{x / 1000}, {y / 1000}, {z / 1000}, 0, 0, 0])"


START = "start = get_actual_tcp_pose()"


def trapezoid(way: float, speed: float, acceleration: float) -> float:
    full = speed * speed / acceleration
    return way / speed + speed / acceleration if way > full else 2.0 * math.sqrt(way / acceleration)


# -- moves


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


# -- limits


def test_a_joint_that_would_turn_too_fast_stops_the_arm(rig) -> None:
    rig.run(f"movej({[0.0, -1.57, -1.57, 0.0, 0.35, 0.0]}, v=1)")
    seen = len(rig.seen)
    rig.load(f"movel({[0.0, -1.57, -1.57, 0.0, -0.35, 0.0]}, a=1, v=0.1)")  # past the wrist's singularity
    rig.steps(3.0)
    assert rig.machine.safety is SafetyMode.PROTECTIVE_STOP
    assert rig.machine.runtime is not RuntimeState.PLAYING
    assert rig.machine.motion is None or rig.machine.motion.resting
    steps = np.abs(np.diff(rig.rows().joints[seen:], axis=0)).max(axis=0)
    assert (steps < 3.0 * LIMITS * CYCLE * 1.001).all()


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


# -- what a client steers


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
