"""What ends, replaces and holds the script that ur-rtde uploads: all as the control interface does it."""

from __future__ import annotations

import numpy as np
import pytest

from robot.simulation.machine import RuntimeState

POWERED, RUNNING = 1, 2
"""Bits of the robot's status."""


def test_scripts_of_the_user_s_own_run_and_the_control_script_comes_back(tour) -> None:
    told = tour["custom_scripts"]
    bits = 0
    for add, (answer, runs, (integer, number, outputs)) in enumerate(told["found"], start=1):
        bits |= 1 << add
        assert answer
        assert runs
        assert integer == 2 * 21 + add
        assert number == 2.5
        assert outputs & 0b1110 == bits
    assert told["moves_again"]


def test_another_control_script_takes_the_place_of_the_client_s(tour) -> None:
    told = tour["another_control_script"]
    assert told["changed"]
    assert told["told"] == 77
    assert told["moves"]
    assert told["end"]["q"][0] == pytest.approx(0.1, abs=1e-6)


def test_the_script_is_stopped_and_sent_again(tour) -> None:
    told = tour["the_script_stops_and_is_sent_again"]
    assert told["stopped"] == [False, RuntimeState.STOPPED, POWERED]
    assert told["refused"] is False
    assert told["answer"]
    assert told["runs"] == [True, RuntimeState.PLAYING, POWERED | RUNNING]
    assert told["moves"]
    assert told["status"] == POWERED | RUNNING


def test_the_watchdog_lets_a_kicked_program_run_and_stops_a_silent_one(tour) -> None:
    told = tour["the_watchdog"]
    assert all(told["answers"])
    assert told["kicked"] == RuntimeState.PLAYING
    assert 0.15 < told["silent"] < 1.0  # 0.25 s of wall time after the last kick
    assert told["refused"] is False
    gone = np.array(told["end"]["pose"][:3]) - np.array(told["start"][:3])
    assert 0.05 < gone[0] < 0.39


def test_a_protective_stop_holds_the_arm_until_it_is_released(tour) -> None:
    told = tour["a_protective_stop"]
    assert told["answer"]
    assert told["stopped"] == [True, False]
    mode, bits = told["modes"]
    assert mode == 3
    assert bits >> 2 & 1
    assert told["refused"] is False
    held, still = told["held"]
    assert held == still
    assert told["runs"]
    assert told["end"]["pose"] == pytest.approx(told["target"], abs=1e-6)


def test_clients_leave_and_come_back(tour) -> None:
    told = tour["reconnecting"]
    assert told["connected"] == [[True] * 3, [False] * 3, [True] * 3]
    assert told["answers"] == [True] * 3
    assert told["moves"]
    assert told["end"]["q"][0] == pytest.approx(0.2, abs=1e-6)
    assert told["bit"]
