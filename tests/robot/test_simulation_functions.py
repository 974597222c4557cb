"""Every kind of motion and the controller's own functions, by programs on a machine that is stepped without waiting."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest

from planning import load_cell
from robot.simulation.interfaces.rtde_values import rtde_value
from robot.simulation.machine import Machine, RuntimeState
from robot.simulation.power import RobotMode
from robot.simulation.programs.library import library
from robot.simulation.programs.moves import ScriptMoves
from robot.simulation.programs.program import ScriptProgram
from robot.simulation.urscript import ScriptError, compiled

CYCLE = 0.002
HOME = "[0, -1.5707963, -1.5707963, -1.5707963, 1.5707963, 0]"


class Bench:
    """A machine, and what its programs say."""

    def __init__(self, version=(5, 12, 0, 0)):
        self.machine = Machine(load_cell("ur10e-demo"), version)
        self.said = []
        self.errors = []
        self.places = []
        self.machine.on_fault = self.errors.append
        self.machine.rtde_value = partial(rtde_value, self.machine)
        self._now = 0.0

    def compiled(self, *lines):
        moves = ScriptMoves(self.machine, lambda: lambda: None)
        text = "def program():\n" + "".join(f"  {line}\n" for line in lines) + "end\n"
        return compiled(text, library(self.machine, moves, self.said.append))

    def run(self, *lines, seconds=20.0):
        """Run a program to its end; the process time that it took."""
        self.machine.load(ScriptProgram(self.machine, self.compiled(*lines), self.said.append), 0.0)
        began = self._now
        self.step()
        while self.machine.runtime is not RuntimeState.STOPPED or self.machine.motion is not None:
            assert self._now < began + seconds, "does not end"
            self.step()
        return self._now - began

    def step(self, cycles=1):
        for _ in range(cycles):
            self._now += CYCLE
            self.machine.cycle(self._now, self._now)
            self.places.append(self.machine.state.pose)

    def error(self, *lines):
        """What ends a program that does not come to its end."""
        try:
            self.run(*lines)
        except ScriptError as error:
            return error
        assert len(self.errors) == 1
        return self.errors.pop()


@pytest.fixture
def bench():
    made = Bench()
    made.run(f"movej({HOME}, a=20, v=2)")
    made.places.clear()
    return made


def moved(bench):
    """How far the tool is from where it was, mm."""
    return np.array(bench.places[-1][:3]) - np.array(bench.places[0][:3])


LIFTED = "pose_add(get_actual_tcp_pose(), p[0, 0, -0.1, 0, 0, 0])"
MOTIONS = {
    "movej to joints": (["q = get_actual_joint_positions()", "q[0] = q[0] + 0.2", "movej(q, t=1)"], None),
    "movej to a pose": ([f"movej({LIFTED}, t=1)"], [0, 0, -100]),
    "movel to a pose": ([f"movel({LIFTED}, a=1, v=0.2)"], [0, 0, -100]),
    "movel to joints": ([f"movel(get_inverse_kin({LIFTED}), a=1, v=0.2)"], [0, 0, -100]),
    "movep": ([f"movep({LIFTED}, a=1, v=0.2)"], [0, 0, -100]),
    "movec": (
        [
            "here = get_actual_tcp_pose()",
            "movec(pose_add(here, p[0, 0.05, -0.05, 0, 0, 0]), pose_add(here, p[0, 0, -0.1, 0, 0, 0]), a=1, v=0.1)",
        ],
        [0, 0, -100],
    ),
    "servoj": (
        [
            f"there = {LIFTED}",
            "here = get_actual_tcp_pose()",
            "i = 0",
            "while i < 500:",
            "  i = i + 1",
            "  servoj(get_inverse_kin(interpolate_pose(here, there, i / 500)), t=0.002, lookahead_time=0.05)",
            "end",
            "sleep(0.5)",
            "stopj(5)",
        ],
        [0, 0, -100],
    ),
    "speedl": (["speedl([0, 0, -0.1, 0, 0, 0], a=10, t=1)", "stopl(10)"], [0, 0, -100]),
    "speedj": (["speedj([0.2, 0, 0, 0, 0, 0], a=10, t=1)", "stopj(10)"], None),
    "a blend": (
        [
            "here = get_actual_tcp_pose()",
            "movel(pose_add(here, p[0, 0.1, 0, 0, 0, 0]), a=1, v=0.2, r=0.02)",
            "movel(pose_add(here, p[0, 0.1, -0.1, 0, 0, 0]), a=1, v=0.2)",
        ],
        [0, 100, -100],
    ),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_comes_where_it_is_sent(bench, name):
    lines, wanted = MOTIONS[name]
    before = bench.machine.state.joints
    bench.step()
    bench.run(*lines)
    assert bench.errors == []
    if wanted is None:  # the first joint has turned by 0.2, the others stand
        turned = np.array(bench.machine.state.joints) - before
        assert turned == pytest.approx([0.2, 0, 0, 0, 0, 0], abs=0.003)
    else:
        assert moved(bench) == pytest.approx(wanted, abs=1.5)


def test_optimised_moves_came_with_a_version(bench):
    error = bench.error(f"optimovej({HOME})")
    assert error.message.startswith("there is no function 'optimovej' here")
    assert (error.line, error.column) == (2, 3)
    newer = Bench((5, 22, 0, 0))
    newer.run(f"movej({HOME}, a=20, v=2)")
    newer.places.clear()
    newer.step()
    newer.run(f"optimovel({LIFTED})", "q = get_actual_joint_positions()", "q[5] = q[5] + 0.1", "optimovej(q)")
    assert moved(newer) == pytest.approx([0, 0, -100], abs=0.01)


REFUSED = {
    "a place out of reach": ("movej(p[9, 9, 9, 0, 0, 0])", "no inverse kinematics at", 2),
    "joints over their limits": ("movej([99, 0, 0, 0, 0, 0])", "joint 1 is asked over its limit", 2),
    "a speed of nothing": (f"movej({HOME}, v=0)", "v must be above 0", 2),
    "joints that are none": ("movej([1, 2, 3])", "must be 6 numbers", 2),
    "a share above 1": ("set_analog_out(0, 2)", "f must be 0 to 1", 2),
    "an output that is none": ("set_digital_out(99, True)", "there are outputs 0 to 17", 2),
    "a register that is none": ("write_output_integer_register(99, 1)", "registers 0 to 47", 2),
    "a voltage that is none": ("set_tool_voltage(5)", "voltage is 0, 12 or 24", 2),
    "an output of RTDE that is none": (
        'x = get_rtde_value("actual_mood")',
        "RTDE has no output 'actual_mood'",
        2,
    ),
    "an encoder that is none": ("x = encoder_get_tick_count(0)", "encoder 0 is not set up", 2),
    "a clock that is none": ("x = time(1)", "mode is 0 or 2", 2),
    "a joint that is none": ("x = get_joint_temp(6)", "j is 0 to 5", 2),
    "too many numbers": ("x = socket_read_byte_list(31)", "1 to 30 numbers are read at once", 2),
    "a byte that is none": ("socket_send_byte(256)", "a byte is 0 to 255", 2),
    "a port that is none": ('socket_open("localhost", 0)', "a port is 1 to 65535", 2),
    "a Modbus address elsewhere": (
        'modbus_add_signal("10.0.0.1", 255, 0, 0, "s")',
        "no address on this machine",
        2,
    ),
    "a Modbus signal that is none": ('x = modbus_get_signal_status("s")', "there is no Modbus signal 's'", 2),
    "a kind of signal that is none": (
        'modbus_add_signal("127.0.0.1", 255, 0, 9, "s")',
        "signal_type is 0 to 3",
        2,
    ),
    "a long name of a signal": (
        f'modbus_add_signal("127.0.0.1", 255, 0, 0, "{"s" * 21}")',
        "1 to 20 characters",
        2,
    ),
    "an action that is none": ('set_standard_digital_input_action(0, "freedrive")', 'only be "default"', 2),
    "a payload below nothing": ("set_payload_mass(-1)", "m must be 0 or above", 2),
    "no such function": ("set_euromap_output(1, 1)", "there is no function 'set_euromap_output'", 2),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_a_function_cannot_do_says_where(bench, name):
    line, says, at = REFUSED[name]
    error = bench.error(line)
    assert says in error.message
    assert error.line == at
    assert error.column >= 3
    bench.run("sync()")  # the next program runs


def test_the_controller_tells_about_itself(bench):
    machine = bench.machine
    machine.digital_inputs = 1 << 2 | 1 << 9 | 1 << 17
    bench.run(
        "now = time()",
        "textmsg(now.sec + now.nanosec / 1000000000)",
        "inputs = [get_standard_digital_in(2), get_configurable_digital_in(1), get_tool_digital_in(1)]",
        "textmsg(inputs)",
        "textmsg(get_digital_in(3))",
        'textmsg(get_rtde_value("actual_q") == get_actual_joint_positions())',
        'textmsg([get_rtde_value("runtime_state"), get_rtde_value("output_int_register_3")])',
        "textmsg(get_gravity())",
        "textmsg(norm(get_tool_accelerometer_reading()))",
        "textmsg(get_controller_temp() > 0 and get_joint_temp(5) > 0 and get_tool_temp() > 0)",
    )
    time = float(bench.said.pop(0))
    assert machine.time - 0.1 < time <= machine.time
    assert bench.said == ["[True, True, True]", "False", "True", "[2, 0]", "[0, 0, 9.82]", "9.82", "True"]


def test_what_is_set_stays(bench):
    machine = bench.machine
    bench.run(
        "set_flag(3, True)",
        "set_payload(2, [0, 0, 0.1])",
        "set_payload_mass(3)",
        "set_payload_cog([0.1, 0, 0])",
        "set_tool_voltage(24)",
        "set_analog_outputdomain(1, 1)",
        "encoder_enable_set_tick_count(1, 2)",
        "encoder_set_tick_count(1, 65535)",
        "set_input_actions_to_default()",
    )
    assert (machine.payload, machine.payload_cog, machine.tool_voltage) == (3.0, (0.1, 0.0, 0.0), 24)
    assert machine.analog_output_types == 0b10
    bench.run(
        "textmsg([get_flag(3), get_flag(4)])",
        "textmsg(encoder_get_tick_count(1))",
        "textmsg(encoder_unwind_delta_tick_count(1, -65530))",
    )
    assert bench.said == ["[True, False]", "65535", "6"]


def test_a_program_may_take_the_power_away(bench):
    bench.run("powerdown()", 'textmsg("still")', "sync()", 'textmsg("never")')
    assert bench.machine.mode is RobotMode.POWER_OFF
    assert bench.said == ["still"]


def test_a_popup_stands_until_another_program_takes_its_place(bench):
    bench.machine.load(
        ScriptProgram(bench.machine, bench.compiled('popup("a", "b", blocking=True)'), print), 0.0
    )
    bench.step(50)
    assert bench.machine.popup == "b: a"
    bench.run("sync()")
    assert bench.machine.popup is None
    bench.run('popup("c")')
    assert bench.machine.popup == "Popup: c"


def test_time_that_is_asked_for_in_cycles_is_that_many(bench):
    """Cycles do not come quite evenly; a speed for a cycle's time is still a speed for one cycle."""
    machine, rng = bench.machine, np.random.default_rng(1)
    lines = [
        "i = 0",
        "while i < 300:",
        "  speedj([0.1, 0, 0, 0, 0, 0], 40, 0.002)",
        "  i = i + 1",
        "end",
        "stopj(40)",
    ]
    before = machine.state.joints[0]
    machine.load(ScriptProgram(machine, bench.compiled(*lines), print), 0.0)
    now, cycles = machine.time, 0
    while machine.runtime is not RuntimeState.STOPPED or not cycles:
        cycles += 1
        at = now + CYCLE * cycles + rng.uniform(-0.0004, 0.0004)
        machine.cycle(at, at)
    assert cycles == pytest.approx(300, abs=8)
    assert machine.state.joints[0] - before == pytest.approx(0.06, abs=0.002)
    assert not math.isnan(machine.state.joints[0])
