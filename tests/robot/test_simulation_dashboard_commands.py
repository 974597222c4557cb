"""What the simulated controller's dashboard answers, and the states of power and safety behind it."""

from __future__ import annotations

import pytest

from planning import load_cell
from robot.simulation.interfaces.dashboard import Dashboard, DashboardSettings
from robot.simulation.interfaces.outputs import readers
from robot.simulation.machine import Machine, RuntimeState
from robot.simulation.power import RobotMode, SafetyMode

CYCLE = 0.002
UNKNOWN = "could not understand: "


def machine_of(version=(5, 12, 0, 0)):
    return Machine(load_cell("ur10e-demo"), version)


def run(machine, seconds):
    for _ in range(round(seconds / CYCLE)):
        now = machine.time + CYCLE
        machine.cycle(now, now)


def endless():
    while True:
        yield


def playing(machine):
    machine.load(endless(), 0.0)
    run(machine, CYCLE)
    assert machine.runtime is RuntimeState.PLAYING


def told(machine, *names):
    return [read() for read in readers(machine, names)]


EVERYWHERE = {
    "PolyscopeVersion": "URSoftware {}.{}.0.0 (simulated)",
    "robotmode": "Robotmode: RUNNING",
    "safetymode": "Safetymode: NORMAL",
    "safetystatus": "Safetystatus: NORMAL",
    "running": "Program running: false",
    "programState": "STOPPED unnamed.urp",
    "get loaded program": "Loaded program: /programs/unnamed.urp",
    "get robot model": "UR10",
    "load there.urp": "Loading program: there.urp",
    "load installation default.installation": "Loading installation: default.installation",
    "play": "Starting program",
    "pause": "Failed to execute: pause",
    "stop": "Stopped",
    "power on": "Powering on",
    "brake release": "Brake releasing",
    "unlock protective stop": "Protective stop releasing",
    "popup two words": "showing popup",
    "close popup": "closing popup",
    "close safety popup": "closing safety popup",
    "addToLog a word": "Added log message",
    "addToLog": "No log message to add",
    "generate flight report system": "Flight Report generated with id: 1",
    "generate support file .": "Completed successfully: ursupport_1.zip",
    "saveLog": "Log saved to disk",
    "restart safety": "Restarting safety",
    "power off": "Powering off",
    "shutdown": "Shutting down",
    "quit": "Disconnected",
    "nonsense": UNKNOWN + "'nonsense'",
    "": UNKNOWN + "''",
}
CB3_ONLY = {"setUserRole operator": "Setting user role: operator", "getUserRole": "OPERATOR"}
E_SERIES_ONLY = {
    "version": "{}.{}.0.0",
    "is in remote control": "true",
    "get operational mode": "NONE",
    "set operational mode automatic": "Operational mode automatic is set",
    "set operational mode asleep": "Failed setting operational mode: asleep",
    "clear operational mode": "No longer controlling the operational mode. Current operational mode: NONE",
}


@pytest.mark.parametrize(
    ("version", "own", "other"),
    [
        ((3, 15), CB3_ONLY, E_SERIES_ONLY),
        ((5, 12), E_SERIES_ONLY, CB3_ONLY),
        ((5, 22), E_SERIES_ONLY, CB3_ONLY),
    ],
)
def test_every_command_is_answered_as_the_version_answers_it(version, own, other) -> None:
    dashboard = Dashboard(machine_of((*version, 0, 0)))
    for asked, answer in (EVERYWHERE | own).items():
        assert dashboard.answer(asked) == answer.format(*version)
    for asked in other:
        assert dashboard.answer(asked) == f"{UNKNOWN}'{asked}'"


def test_commands_are_understood_in_any_case_and_with_any_space() -> None:
    dashboard = Dashboard(machine_of())
    for asked in ("POWER OFF", "Power  off", " power\toff "):
        assert dashboard.answer(asked) == "Powering off"
    assert dashboard.answer("load a folder/and a name.urp") == "Loading program: a folder/and a name.urp"


def test_older_versions_lack_the_newer_commands() -> None:
    lacking = {
        command
        for command in EVERYWHERE | E_SERIES_ONLY
        if command and Dashboard(machine_of((5, 0, 0, 0))).answer(command).startswith(UNKNOWN)
    }
    assert lacking == {
        "nonsense",
        "safetystatus",
        "restart safety",
        "is in remote control",
        "get operational mode",
        "get robot model",
        "generate flight report system",
        "generate support file .",
        "saveLog",
    }


def test_power_rises_step_by_step_and_falls_at_once() -> None:
    machine = machine_of()
    machine.power.seconds = 0.1
    dashboard = Dashboard(machine)
    dashboard.answer("power off")
    assert dashboard.answer("robotmode") == "Robotmode: POWER_OFF"
    assert told(machine, "robot_status_bits", "joint_mode", "actual_robot_voltage") == [0, (239,) * 6, 0.0]
    assert dashboard.answer("power on") == "Powering on"
    seen = []
    for _ in range(6):
        seen.append(dashboard.answer("robotmode").split()[1])
        run(machine, 0.05)
    assert seen == ["BOOTING"] * 2 + ["POWER_ON"] * 2 + ["IDLE"] * 2
    run(machine, 1.0)
    assert machine.mode is RobotMode.IDLE
    assert told(machine, "robot_status_bits", "joint_mode", "actual_robot_voltage") == [1, (255,) * 6, 48.0]
    assert not machine.may_move
    dashboard.answer("brake release")
    assert machine.mode is RobotMode.RUNNING
    assert told(machine, "joint_mode") == [(253,) * 6]
    dashboard.answer("power on")
    assert machine.mode is RobotMode.RUNNING


def test_released_brakes_can_be_asked_for_while_the_robot_boots() -> None:
    machine = machine_of()
    machine.power.seconds = 0.1
    machine.mode = RobotMode.POWER_OFF
    dashboard = Dashboard(machine)
    dashboard.answer("power on")
    dashboard.answer("brake release")
    run(machine, 0.29)
    assert machine.mode is RobotMode.IDLE
    run(machine, 0.02)
    assert machine.may_move


def test_power_that_is_taken_while_it_rises_stays_off() -> None:
    machine = machine_of()
    machine.power.seconds = 0.1
    machine.mode = RobotMode.POWER_OFF
    dashboard = Dashboard(machine)
    dashboard.answer("power on")
    run(machine, 0.15)
    dashboard.answer("power off")
    run(machine, 1.0)
    assert machine.mode is RobotMode.POWER_OFF


def test_a_protective_stop_is_unlocked_after_its_time_and_the_program_is_played_on() -> None:
    machine = machine_of()
    dashboard = Dashboard(machine, settings=DashboardSettings(unlock_after=5.0))
    playing(machine)
    machine.protective_stop()
    assert dashboard.answer("safetystatus") == "Safetystatus: PROTECTIVE_STOP"
    assert dashboard.answer("safetymode") == "Safetymode: PROTECTIVE_STOP"
    assert dashboard.answer("programState") == "PAUSED unnamed.urp"
    assert told(machine, "safety_mode", "safety_status", "safety_status_bits") == [3, 3, 1 << 2 | 1 << 10]
    run(machine, 4.9)
    assert dashboard.answer("unlock protective stop") == (
        "Cannot unlock protective stop until 5s after occurrence."
        " Always inspect cause of protective stop before unlocking"
    )
    assert dashboard.answer("play") == "Failed to execute: play"
    run(machine, 0.2)
    assert dashboard.answer("unlock protective stop") == "Protective stop releasing"
    assert machine.may_move
    assert dashboard.answer("programState").startswith("PAUSED")
    assert dashboard.answer("play") == "Starting program"
    assert dashboard.answer("running") == "Program running: true"


@pytest.mark.parametrize("mode", [SafetyMode.ROBOT_EMERGENCY_STOP, SafetyMode.SYSTEM_EMERGENCY_STOP])
def test_an_emergency_stop_keeps_the_power_off_until_it_is_released(mode) -> None:
    machine = machine_of()
    dashboard = Dashboard(machine)
    playing(machine)
    machine.emergency_stop(mode)
    assert dashboard.answer("programState").startswith("STOPPED")
    assert dashboard.answer("safetystatus") == f"Safetystatus: {mode.name}"
    for asked in ("power on", "brake release"):
        assert dashboard.answer(asked).startswith("Failed to execute")
    dashboard.answer("unlock protective stop")
    dashboard.answer("restart safety")
    assert machine.safety is mode
    assert machine.mode is RobotMode.POWER_OFF
    assert told(machine, "safety_status_bits")[0] & 1 << 7
    machine.clear_stop()
    assert dashboard.answer("brake release") == "Brake releasing"
    assert machine.may_move


@pytest.mark.parametrize("mode", [SafetyMode.VIOLATION, SafetyMode.FAULT])
def test_only_a_restart_of_the_safety_system_ends_a_violation(mode) -> None:
    machine = machine_of()
    dashboard = Dashboard(machine)
    machine.emergency_stop(mode)
    dashboard.answer("unlock protective stop")
    assert dashboard.answer("power on").startswith("Failed to execute")
    dashboard.answer("restart safety")
    assert dashboard.answer("safetystatus") == "Safetystatus: NORMAL"
    assert dashboard.answer("robotmode") == "Robotmode: POWER_OFF"


def test_every_safety_mode_has_its_bits_and_its_older_name() -> None:
    machine = machine_of()
    dashboard = Dashboard(machine)
    for mode in SafetyMode:
        machine.safety = mode
        assert dashboard.answer("safetystatus") == f"Safetystatus: {mode.name}"
        older, newer, bits = told(machine, "safety_mode", "safety_status", "safety_status_bits")
        assert newer == mode
        assert older == (mode if mode <= 11 else SafetyMode.SAFEGUARD_STOP)
        stopped = not machine.may_move and mode is not SafetyMode.RECOVERY
        assert bool(bits >> 10 & 1) == stopped


def test_without_remote_control_the_robot_only_tells() -> None:
    machine = machine_of()
    dashboard = Dashboard(machine, settings=DashboardSettings(remote=False))
    assert dashboard.answer("is in remote control") == "false"
    for asked in ("play", "stop", "pause"):
        assert dashboard.answer(asked) == f"Failed to execute: {asked}"
    for asked in ("power off", "brake release", "unlock protective stop", "restart safety", "shutdown"):
        assert dashboard.answer(asked) == "Not in remote control"
    assert dashboard.answer("load x.urp") == "Error while loading program: x.urp"
    assert dashboard.answer("robotmode") == "Robotmode: RUNNING"
    assert dashboard.answer("popup hello") == "showing popup"


def test_a_popup_is_shown_until_it_is_closed() -> None:
    machine = machine_of()
    dashboard = Dashboard(machine)
    dashboard.answer("popup two  words")
    assert machine.popup == "two  words"
    dashboard.answer("close popup")
    assert machine.popup is None


def test_operational_modes_and_roles_are_kept() -> None:
    dashboard = Dashboard(machine_of())
    for mode in ("manual", "automatic"):
        dashboard.answer(f"set operational mode {mode}")
        assert dashboard.answer("get operational mode") == mode.upper()
    dashboard.answer("clear operational mode")
    assert dashboard.answer("get operational mode") == "NONE"
    older = Dashboard(machine_of((3, 15, 0, 0)))
    assert older.answer("getUserRole") == "PROGRAMMER"
    assert older.answer("setUserRole chief") == "Failed setting user role: chief"
    for role in ("programmer", "operator", "none", "locked", "restricted"):
        assert older.answer(f"setUserRole {role}") == f"Setting user role: {role}"
        assert older.answer("getUserRole") == role.upper()
