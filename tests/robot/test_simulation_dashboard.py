"""The simulated controller's dashboard: what it answers, and the states of power, safety and programs behind it."""

from __future__ import annotations

import socket
import time

import pytest

from planning import load_cell
from robot.simulation import Fault, SimulatedCell
from robot.simulation.interfaces.dashboard import Dashboard, DashboardSettings
from robot.simulation.interfaces.outputs import readers
from robot.simulation.interfaces.program_files import ProgramFiles
from robot.simulation.machine import Machine, RuntimeState
from robot.simulation.power import RobotMode, SafetyMode

HOST = "127.0.32.1"
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
    "play": "Failed to execute: play",
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


# -- programs in a folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    programs = tmp_path_factory.mktemp("programs")
    (programs / "hold.script").write_text("def hold():\n  while True:\n    sync()\n  end\nend\n")
    (programs / "body.script").write_text("# no function\nset_standard_digital_out(5, True)\nsleep(9)\n")
    (programs / "broken.script").write_text("def broken():\n  mvoe(1)\nend\n")
    (programs / "shelf").mkdir()
    (programs / "shelf" / "hold.script").write_text("def other():\n  sleep(9)\nend\n")
    (programs.parent / "outside.script").write_text("def outside():\n  sleep(9)\nend\n")
    return programs


def test_programs_are_found_in_their_folder_alone(folder) -> None:
    files = ProgramFiles(folder)
    assert (files.name, files.path) == ("<unnamed>", "")
    for name in ("hold.script", "hold.urp", "/programs/hold.urp", "shelf/hold.urp", "/shelf/hold.script"):
        assert files.load(name), name
    for name in (
        "missing.urp",
        "hold",
        "../outside.script",
        "/etc/passwd",
        "shelf",
        "",
        "a\0b.urp",
        "x" * 9999,
    ):
        assert not files.load(name), name
    assert files.name == "hold.script"
    assert files.text.startswith("def other")


@pytest.fixture(scope="module")
def cell(folder):
    with SimulatedCell.start("ur10e-demo", host=HOST, programs=folder) as simulated:
        yield simulated


class Client:
    """Talks with the dashboard."""

    def __init__(self):
        self.connection = socket.create_connection((HOST, 29999), 2.0)
        self.lines = self.connection.makefile("rwb")
        assert self.lines.readline() == b"Connected: Universal Robots Dashboard Server\n"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.lines.close()
        self.connection.close()

    def ask(self, line):
        self.lines.write(line.encode() + b"\n")
        self.lines.flush()
        return self.lines.readline().decode().removesuffix("\n")


def until(condition, seconds=3.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "did not happen in time"
        time.sleep(0.01)


def test_a_program_is_loaded_played_held_and_stopped(cell) -> None:
    with Client() as client:
        assert client.ask("get loaded program") == "No program loaded"
        assert client.ask("play") == "Failed to execute: play"
        assert client.ask("load missing.urp") == "File not found: missing.urp"
        assert client.ask("load hold.urp") == "Loading program: hold.urp"
        assert client.ask("get loaded program") == "Loaded program: /programs/hold.urp"
        assert client.ask("programState") == "STOPPED hold.urp"
        assert client.ask("play") == "Starting program"
        assert client.ask("programState") == "PLAYING hold.urp"
        assert client.ask("running") == "Program running: true"
        assert client.ask("pause") == "Pausing program"
        until(lambda: client.ask("programState") == "PAUSED hold.urp")
        assert client.ask("play") == "Starting program"
        assert client.ask("programState") == "PLAYING hold.urp"
        assert client.ask("stop") == "Stopped"
        assert client.ask("programState") == "STOPPED hold.urp"
        assert client.ask("isProgramSaved").lower() == "true hold.urp"


def test_a_program_s_body_alone_is_a_program_and_a_broken_one_does_not_start(cell) -> None:
    with Client() as client:
        client.ask("load body.script")
        assert client.ask("play") == "Starting program"
        assert client.ask("running") == "Program running: true"
        client.ask("stop")
        client.ask("load broken.script")
        assert client.ask("play") == "Failed to execute: play"
        assert client.ask("running") == "Program running: false"


def test_clients_are_served_at_once_and_what_one_sends_harms_no_other(cell) -> None:
    with Client() as one, Client() as other, Client() as odd:
        odd.lines.write(b"\xff\xfe\0\x01\n\r\nrobotmode\r\nrobotmode\n")
        odd.lines.flush()
        assert odd.lines.readline().startswith(UNKNOWN.encode())
        assert odd.lines.readline() == b"could not understand: ''\n"
        assert [odd.lines.readline() for _ in range(2)] == [b"Robotmode: RUNNING\n"] * 2
        odd.lines.write(b"x" * 200_000)
        odd.lines.flush()
        for client in (one, other, one):
            assert client.ask("robotmode") == "Robotmode: RUNNING"
        assert one.ask("quit") == "Disconnected"
        assert one.lines.readline() == b""
        assert other.ask("robotmode") == "Robotmode: RUNNING"


def test_faults_and_commands_meet(cell) -> None:
    with Client() as client:
        cell.inject(Fault.PROTECTIVE_STOP)
        assert client.ask("safetystatus") == "Safetystatus: PROTECTIVE_STOP"
        assert client.ask("unlock protective stop") == "Protective stop releasing"
        assert client.ask("safetystatus") == "Safetystatus: NORMAL"
        cell.inject(Fault.EMERGENCY_STOP)
        assert client.ask("robotmode") == "Robotmode: POWER_OFF"
        assert client.ask("power on").startswith("Failed to execute")
        cell.inject(Fault.RELEASE_EMERGENCY_STOP)
        assert client.ask("power on") == "Powering on"
        assert client.ask("robotmode") == "Robotmode: IDLE"
        client.ask("brake release")
        assert client.ask("robotmode") == "Robotmode: RUNNING"
