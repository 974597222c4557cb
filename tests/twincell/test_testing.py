"""The pytest plugin, in a project that has nothing else of ours: its tests are run by a pytest of their own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from robot.simulation.addresses import ROBOT_PORTS, all_free, free_address

MODULE = "twincell.testing"
PROJECT = Path(__file__).resolve().parents[2]


def run_theirs(folder, text, *options):
    """Run tests in a folder of their own."""
    (folder / "test_theirs.py").write_text(textwrap.dedent(text), encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-p", MODULE, "-p", "no:cacheprovider", "-rA", *options]
    return subprocess.run(
        [*command, str(folder)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
    )


def test_the_documents_example_runs_in_each_worker(tmp_path):
    """At once, on ports that are the same: so each has an address of its own."""
    text = (PROJECT / "docs" / "simulator.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    done = run_theirs(tmp_path, example, "-n", "2", "--dist", "each")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 passed" in done.stdout


SHARING = r"""
import socket, time

@pytest.fixture(scope="module")
def shared(simulated_cells):
    return simulated_cells(time_scale=2.0)

def test_that_passes(shared):
    assert shared.inject("pump report")["volume"] == 0.0

def test_that_fails(shared):
    assert shared.time_scale == 2.0
    with socket.create_connection((shared.host, 30001)) as port:
        port.sendall(b"no_such_function()\n")
        time.sleep(0.5)
    assert False
"""
WRONG = {
    "(version='5.12', speed=3)": "twincell(): got an unexpected keyword argument 'speed'",
    "(4)": "name the options of twincell(), as in time_scale=4",
    "(cell='no-such-cell')": "no-such-cell: no such file",
    "(time_scale=0)": "`time_scale` must be 0.1 to 50, not 0",
}


@pytest.fixture(scope="module")
def theirs(tmp_path_factory):
    """Tests that share a cell, and tests with wrong markers, run by one pytest."""
    wrong = [
        f"@pytest.mark.twincell{marker}\ndef test_{k}(simulated_cell):\n    pass\n"
        for k, marker in enumerate(WRONG)
    ]
    done = run_theirs(
        tmp_path_factory.mktemp("theirs"), "\n".join(["import pytest", *wrong, SHARING]), "--strict-markers"
    )
    assert done.returncode == 1
    assert "1 failed, 1 passed, 4 errors" in done.stdout
    return done.stdout


def test_a_shared_cell_and_what_its_simulators_said_beside_a_failed_test(theirs):
    assert "FAILED test_theirs.py::test_that_fails" in theirs
    assert "PASSED test_theirs.py::test_that_passes" in theirs
    assert "no_such_function" in theirs.split("Captured stderr teardown")[1]


@pytest.mark.parametrize("marker", WRONG)
def test_a_wrong_marker_is_told(theirs, marker):
    assert WRONG[marker] in theirs
    assert "in simulated_cell" not in theirs  # no traceback


def test_the_plugin_loads_nothing_that_tests_did_not_ask_for():
    heavy = "numpy", "scipy", "pymodbus", "planning", "robot", "rich", "typer"
    done = subprocess.run(
        [sys.executable, "-c", f"import pytest, sys, {MODULE}; print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert not set(heavy) & set(done.stdout.split())


def test_the_plugin_is_announced():
    toml = (PROJECT / "pyproject.toml").read_text(encoding="utf-8")
    assert f'"{MODULE}" = "{MODULE}"' in toml.split("[project.entry-points.pytest11]")[1].split("[")[0]


def test_addresses_are_not_given_twice():
    with free_address(5020) as one, free_address(5020) as two:
        assert one != two
        assert all(address.startswith("127.") for address in (one, two))
        assert all_free(one, ROBOT_PORTS)
