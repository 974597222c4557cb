"""The simulated controller's dashboard as clients see it, and the programs that it finds in a folder."""

from __future__ import annotations

import socket

import pytest
from waiting import until

from robot.simulation import Fault, SimulatedCell
from robot.simulation.interfaces.program_files import ProgramFiles

HOST = "127.0.32.1"


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
        assert odd.lines.readline().startswith(b"could not understand: ")
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
