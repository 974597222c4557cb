"""What is loaded when: a word of help waits for no kernel, and the engine's names are those of its stub."""

import ast
import importlib.metadata
import subprocess
import sys
from pathlib import Path

import pytest

import twins

HEAVY = ("numba", "scipy", "trimesh", "shapely", "matplotlib", "ezdxf", "rhino3dm", "numpy")


def loaded_by(program):
    """Which of the heavy libraries are loaded at the end of a program of its own."""
    done = subprocess.run(
        [sys.executable, "-c", f"{program}\nimport sys; print(*sys.modules)"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    return set(done.stdout.splitlines()[-1].split()) & set(HEAVY)


def test_help_loads_no_heavy_library():
    program = "import sys; from twincell.cli import main\nsys.argv[1:] = ['plan', '--help']\n"
    assert loaded_by(f"{program}try: main()\nexcept SystemExit as e: assert not e.code") == set()


def test_the_cell_is_run_without_the_engine():
    """Each printed job starts three processes that import the planner; none needs kernels or meshes."""
    program = "import robot.arm_process, robot.simulation.controller, robot.simulation.pump.__main__"
    assert loaded_by(program) <= {"numpy"}


@pytest.mark.parametrize("name", sorted(twins.__all__))
def test_a_public_name_is_what_its_home_defines(name):
    stub = ast.parse((Path(twins.__file__).parent / "__init__.pyi").read_text(encoding="utf-8"))
    homes = {a.name: node.module for node in stub.body for a in node.names}
    assert getattr(twins, name) is getattr(importlib.import_module(f"twins.{homes[name]}"), name)


def test_no_public_name_is_that_of_a_module():
    """Loading such a module would put the module in the place of what it defines."""
    modules = {path.stem for path in Path(twins.__file__).parent.iterdir()}
    assert not modules & set(twins.__all__)


def test_version(twincell):
    code, out, err = twincell("--version")
    assert (code, out.split(), err) == (0, ["twincell", importlib.metadata.version("twincell")], "")
