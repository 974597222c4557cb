"""Every command of ur-rtde's dashboard client; it raises an error itself where an answer is not the controller's."""

from __future__ import annotations

import re

import pytest
from dashboard_client import DashboardClient


def test_every_method_is_called(tour) -> None:
    methods = {name for name in vars(DashboardClient) if name[0] != "_"}
    assert methods - tour.called("dashboard") == set()


def test_the_controller_is_described(tour) -> None:
    told = tour["the_dashboard"]
    version = tour.variant.version
    assert told["connected"] == [True]
    assert told["polyscopeVersion"].startswith(f"{version}.")
    assert version in told["version"]
    assert re.fullmatch(r"\d{11}", told["getSerialNumber"])
    assert told["getRobotModel"].startswith("UR10")
    assert told["isInRemoteControl"] is True


def test_states_are_told(tour) -> None:
    told = tour["the_dashboard"]
    assert told["running"] is True
    assert told["programState"].startswith("PLAYING")
    assert told["robotmode"] == "Robotmode: RUNNING"
    assert told["safetymode"] == "Safetymode: NORMAL"
    assert told["safetystatus"] == "Safetystatus: NORMAL"


def test_a_program_is_held_played_on_and_stopped(tour) -> None:
    told = tour["a_program_is_held"]
    states = [state.split()[0] if isinstance(state, str) else state for state in told["states"]]
    assert states == ["PAUSED", False, "PLAYING", True, "STOPPED", False]
    assert told["held"] == told["still"]
    assert told["held"] != pytest.approx(told["target"], abs=1e-3)
    assert told["end"] == pytest.approx(told["target"], abs=1e-6)


def test_power_and_brakes_follow_the_commands(tour) -> None:
    told = tour["power"]
    running, off, idle, again = told["found"]
    assert running == again == [7, "Robotmode: RUNNING", 1, 253]
    assert off[:3] == [3, "Robotmode: POWER_OFF", 0]
    assert idle[:3] == [5, "Robotmode: IDLE", 1]
    assert off[3] != 253
    assert told["refused"] is False


def test_the_client_leaves_and_comes_back(tour) -> None:
    told = tour["the_dashboard_leaves"]
    assert told["connected"] == [False, True, False]
    assert "UserRole" in told["refused"]  # the wheel does not have the type of the argument
