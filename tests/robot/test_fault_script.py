"""Fault scripts: what is wrong with one is told with its place; what is right happens when it says."""

from __future__ import annotations

import itertools
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planning import ConfigurationError, load_cell
from robot.simulation.fault_plan import FaultPlan, WaypointCount
from robot.simulation.fault_script import CHANCES, FaultScript, RandomFaults, load_fault_script, with_seed
from robot.simulation.faults import LIFTED_BY, VALUES, Fault, checked, lifting
from robot.simulation.machine import Machine

CYCLE = 0.002


@pytest.fixture
def machine():
    return Machine(load_cell("ur10e-demo"), (5, 12, 0, 0))


@pytest.fixture
def script(tmp_path):
    """A script of the text."""

    def load(text):
        path = tmp_path / "faults.toml"
        path.write_text(text, encoding="utf-8")
        return load_fault_script(path)

    return load


def happened(script, machine, until, move=lambda machine: None):
    """Everything that happens until a process time: when, what, and with which values."""
    seen = []
    plan = FaultPlan(script, lambda time, fault, values: seen.append((machine.time, time, fault, values)))
    for k in range(round(until / CYCLE) + 1):
        machine.time = k * CYCLE
        move(machine)
        plan.step(machine)
    return seen


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no faults; give a list [[fault]], a table [random] or both"),
        ("fault = 3", "'fault'"),
        ("[[faults]]\nat = 1", "no key 'faults'; did you mean 'fault'"),
        ('[[fault]]\nfault = "speed slide"\nat = 1\nfraction = 0.5', "fault 1: key 'fault'"),
        ('[[fault]]\nfault = "rtde drop"', "fault 1: "),
        ('[[fault]]\nfault = "rtde drop"\nat = 1\nwaypoint = 2', "has at and waypoint"),
        ('[[fault]]\nfault = "rtde drop"\nat = -1', "key 'at'"),
        ('[[fault]]\nfault = "rtde drop"\nat = nan', "key 'at'"),
        ('[[fault]]\nfault = "rtde drop"\nat = 1\n[[fault]]\nfault = "reboot"\nat = 2', "fault 2: "),
        ('[[fault]]\nfault = "speed slider"\nat = 1', "takes `fraction`, 0 to 1"),
        ('[[fault]]\nfault = "speed slider"\nat = 1\nfraction = 2', "takes `fraction`, 0 to 1, not 2"),
        ('[[fault]]\nfault = "rtde drop"\nat = 1\nfraction = 0.5', "takes no values, not `fraction`"),
        ('[[fault]]\nfault = "rtde drop"\nat = 1\nlasts = 1', "nothing takes 'rtde drop' back"),
        ('[[fault]]\nfault = "rtde drop"\nwaypoint = 1\nevery = 1', "`every` goes with `at`"),
        ('[[fault]]\nfault = "rtde drop"\nat = 1\ntimes = 2', "`times` goes with `every`"),
        ('[[fault]]\nfault = "rtde drop"\nat = 1\never = 2', "did you mean 'every'"),
        ('[[fault]]\nfault = "rtde drop"\nwhen_near = {position = [1, 2], radius = 3}', "when_near.position"),
        (
            '[[fault]]\nfault = "rtde drop"\nwhen_near = {position = [1, 2, 3], radius = 0}',
            "when_near.radius",
        ),
        (
            '[[fault]]\nfault = "rtde drop"\nwhen_register = {name = "output_int_register_48", value = 1}',
            "there is no register 'output_int_register_48'",
        ),
        ("[random]\nmean_interval_s = 1\nfaults = []", "random: key 'faults'"),
        ('[random]\nmean_interval_s = 0\nfaults = ["rtde drop"]', "random: key 'mean_interval_s'"),
        ('[random]\nmean_interval_s = 1\nfaults = ["pump slow"]', "random: 'pump slow' takes"),
    ],
)
def test_what_is_wrong_is_told_in_one_sentence_with_its_place(script, text, says):
    with pytest.raises(ConfigurationError) as caught:
        script(text)
    assert "faults.toml: " in str(caught.value)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_script_that_is_not_there(tmp_path):
    with pytest.raises(ConfigurationError, match=r"none\.toml: cannot be read"):
        load_fault_script(tmp_path / "none.toml")


def test_a_fault_comes_at_its_time_and_is_taken_back(script, machine):
    found = script(
        '[[fault]]\nfault = "speed slider"\nfraction = 0.25\nat = 0.5\nlasts = 0.1\n'
        '[[fault]]\nfault = "rtde drop"\nat = 0.2\nevery = 0.3\ntimes = 3\n'
        '[[fault]]\nfault = "digital input"\nnumber = 5\nat = 0.1\nlasts = 0.2\n'
    )
    seen = happened(found, machine, 2.0)
    for now, planned, _, _ in seen:
        assert planned <= now < planned + CYCLE + 1e-9
    assert [(round(planned, 6), fault, values) for _, planned, fault, values in seen] == [
        (0.1, Fault.DIGITAL_INPUT, {"number": 5}),
        (0.2, Fault.RTDE_DROP, {}),
        (0.3, Fault.CLEAR_DIGITAL_INPUT, {"number": 5}),
        (0.5, Fault.SPEED_SLIDER, {"fraction": 0.25}),
        (0.5, Fault.RTDE_DROP, {}),
        (0.6, Fault.SPEED_SLIDER, {"fraction": 1.0}),
        (0.8, Fault.RTDE_DROP, {}),
    ]


def test_every_without_times_has_no_end(script, machine):
    found = script('[[fault]]\nfault = "rtde drop"\nat = 0\nevery = 0.1')
    assert len(happened(found, machine, 10.05)) == 101


def test_a_fault_waits_for_a_register(script, machine):
    found = script(
        '[[fault]]\nfault = "rtde drop"\ntimes = 2\nwhen_register = {name = "output_int_register_7", value = 4}'
    )

    def count(machine):
        machine.output_ints[7] = round(machine.time / 0.1) % 10

    seen = happened(found, machine, 5.0, count)
    assert len(seen) == 2
    assert seen[1][0] - seen[0][0] == pytest.approx(1.0, abs=2 * CYCLE)


def test_a_fault_waits_for_the_tool(script, machine):
    """A tool on a circle comes near a place of it once a turn, at the angle that the radius allows."""
    found = script(
        '[[fault]]\nfault = "rtde drop"\ntimes = 9\nwhen_near = {position = [100, 0, 0], radius = 10}'
    )

    class Tool:
        pose = (0.0,) * 6

    def turn(machine):
        machine.state = Tool()
        angle = 1.0 + 2.0 * math.pi * machine.time
        machine.state.pose = (100.0 * math.cos(angle), 100.0 * math.sin(angle), 0.0, 0.0, 0.0, 0.0)

    seen = happened(found, machine, 3.0, turn)
    assert len(seen) == 3
    half = 2.0 * math.asin(10.0 / 200.0)
    expected = 1.0 - (1.0 + half) / (2.0 * math.pi)
    assert [now for now, *_ in seen] == pytest.approx([expected, expected + 1, expected + 2], abs=CYCLE)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(1, 40), min_size=1, max_size=6), st.integers(1, 7))
def test_as_many_waypoints_pass_as_moves_have(lengths, cycles):
    """Each move tells its progress from 0 up, for some cycles each, and ends; its operation has another number."""
    machine = Machine.__new__(Machine)
    machine.output_ints = [0] * 48
    count = WaypointCount(2)
    passed = 0
    for number, length in enumerate(lengths):
        for progress in range(length):
            machine.output_ints[2] = (number + 1) % 128 << 24 | 1 << 15 | progress
            for _ in range(cycles):
                assert count.step(machine) == passed + progress
        machine.output_ints[2] &= ~(1 << 15)
        passed += length
        assert count.step(machine) == passed


def test_chance_is_the_same_for_the_same_seed(machine):
    def drawn(seed):
        return happened(with_seed(None, seed), machine, 600.0)

    assert CHANCES.mean_interval_s == 60.0
    first = drawn(4)
    assert first
    assert first == drawn(4)
    assert first != drawn(5)


def test_the_mean_interval_is_what_was_asked_for(machine):
    chances = RandomFaults(seed=1, mean_interval_s=0.02, faults=(Fault.RTDE_DROP, Fault.PUMP_RESET))
    times = [planned for _, planned, *_ in happened(FaultScript(random=chances), machine, 40.0)]
    assert np.mean(np.diff(times)) == pytest.approx(0.02, rel=5 / math.sqrt(len(times)))


def test_a_seed_of_the_command_replaces_the_files(script):
    found = with_seed(script('[random]\nseed = 3\nmean_interval_s = 1\nfaults = ["rtde drop"]'), 8)
    assert found.random is not None
    assert (found.random.seed, found.random.mean_interval_s) == (8, 1.0)


def test_what_takes_a_fault_back_can_be_asked_for():
    for fault, counterpart in LIFTED_BY.items():
        values = {VALUES[fault].name: VALUES[fault].least} if fault in VALUES else {}
        end, with_values = lifting(fault, values)
        assert end is counterpart
        assert checked(end, with_values) == with_values
    assert lifting(Fault.REBOOT, {"seconds": 1.0}) is None


def test_values_are_bounded():
    for taken in VALUES.values():
        for wrong in (math.nan, math.inf, taken.least - 1.0, taken.most + 1.0, True, "1", None, 10**400):
            with pytest.raises(ValueError, match=f"takes `{taken.name}`"):
                taken.checked(wrong)
        for right in itertools.islice(taken.steps or (taken.least, taken.most), 20):
            assert taken.checked(right) == right


def test_the_document_has_a_script_that_is_one_and_every_fault(script):
    text = (Path(__file__).resolve().parents[2] / "docs" / "simulator.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"^```toml\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert script(example).faults
    rows = re.findall(r"^\| (`.*?) \|", text, re.MULTILINE)
    told = {name for row in rows for name in re.findall("`(.*?)`", row)}
    assert {str(fault) for fault in Fault} - set(LIFTED_BY.values()) - {Fault.PUMP_REPORT} <= told
