"""The command `simulate`: it runs until it is ended, shows what happens, and refuses in one line."""

from __future__ import annotations

import re
import select
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from robot.simulation import inject
from robot.simulation.addresses import free_address


@pytest.fixture
def host():
    with free_address(5020) as address:
        yield address


class Running:
    """The command in a process of its own, read line by line."""

    def __init__(self, *words):
        self.process = subprocess.Popen(
            [sys.executable, "-m", "twincell", "simulate", *map(str, words)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            bufsize=0,
        )
        self.lines = []

    def until(self, says, seconds=30.0):
        deadline = time.monotonic() + seconds
        while not any(says in line for line in self.lines):
            readable, _, _ = select.select([self.process.stdout], [], [], deadline - time.monotonic())
            assert readable, self.lines
            line = self.process.stdout.readline()
            assert line, (self.lines, self.process.stderr.read())
            self.lines.append(line.rstrip())

    def end(self, with_signal=signal.SIGTERM):
        """End it; exit code and the rest of what it said."""
        self.process.send_signal(with_signal)
        out, err = self.process.communicate(timeout=20)
        return self.process.returncode, out, err

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        self.process.stderr.close()


def test_it_runs_a_script_of_faults_and_writes_traces(host, tmp_path):
    script = tmp_path / "faults.toml"
    script.write_text('[[fault]]\nfault = "speed slider"\nfraction = 0.5\nat = 0\n', encoding="ascii")
    folder = tmp_path / "traces"
    words = ("--host", host, "--time-scale", 3, "--script", script, "--trace", folder, "--version", "5.22")
    with Running(*words) as command:
        command.until("fault at 0.000 s: speed slider, fraction 0.5")
        assert command.lines[0] == (
            f"simulated cell at {host}: robot, version 5.22, on 30004 (RTDE), 29999, 30001 to 30003; pump on 5020; "
            "time scale 3; Ctrl-C ends it"
        )
        assert inject(host, "pump report")["volume"] == 0.0
        inject(host, "speed slider", fraction=0.25)
        command.until("controller: asked for: speed slider, fraction 0.25")
        inject(host, "pump trip")
        command.until("pump: asked for: pump trip")
        code, out, err = command.end(signal.SIGINT)
    assert (code, err) == (0, "")
    assert out.strip().splitlines()[-1] == f"traces in {folder}"
    for name in ("robot", "pump", "deposition"):
        assert len(np.genfromtxt(folder / f"{name}.csv", delimiter=",", names=True)) > 0


def test_it_tells_which_simulator_ended(host):
    with Running("--host", host, "--faults-seed", 3) as command:
        command.until("simulated cell at")
        pump = subprocess.run(
            ["pgrep", "-f", f"robot.simulation.pump --child .*--host {host} "],
            check=True,
            capture_output=True,
            text=True,
        )
        subprocess.run(["kill", "-9", pump.stdout.split()[0]], check=True)
        _, err = command.process.communicate(timeout=20)
    assert command.process.returncode == 1
    assert err.strip() == "the simulated pump ended with code -9:"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--time-scale", "0"), "time-scale"),
        (("--start-delay", "0.6"), "start-delay"),
        (("--trip", "-1"), "trip"),
        (("--reply-delay", "nan"), "reply-delay"),
        (("--hopper", "-3"), "hopper"),
        (("--script", "no-such.toml"), "script"),
        (("--programs", "no-such-folder"), "programs"),
    ],
)
def test_a_value_out_of_its_range_is_a_matter_of_usage(twincell, words, says):
    code, _, err = twincell("simulate", "--host", "127.0.35.9", *words)
    assert code in {1, 2}
    assert f"--{says}" in re.sub(r"\x1b\[[\d;]*m", "", err)


def test_a_dry_run_is_no_slower_than_real(twincell, tmp_path):
    code, _, err = twincell("run", str(tmp_path), "--simulate", "--time-scale", "0.5")
    assert code == 2
    assert "'--time-scale': Input should be greater than or equal to 1" in re.sub(r"\x1b\[[\d;]*m", "", err)


def test_a_wrong_version_is_one_sentence(twincell, one_sentence):
    result = twincell("simulate", "--host", "127.0.35.9", "--version", "five")
    one_sentence(result, "--version five: a PolyScope version looks like")


def test_a_wrong_script_is_one_sentence(twincell, one_sentence, tmp_path):
    script = tmp_path / "faults.toml"
    script.write_text('[[fault]]\nfault = "speed slider"\nat = 1\n', encoding="ascii")
    result = twincell("simulate", "--host", "127.0.35.9", "--script", script)
    one_sentence(result, f"{script}: fault 1: 'speed slider' takes")


def test_a_cell_that_is_not_there_is_one_sentence(twincell, one_sentence):
    one_sentence(twincell("simulate", "--cell", "no-such-cell"), "no-such-cell", "ur10e-demo")
