"""The simulated controller's RTDE variables at each version."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from planning import load_cell
from robot import rtde
from robot.simulation.interfaces.outputs import readers
from robot.simulation.interfaces.variables import known_inputs, known_outputs
from robot.simulation.machine import Machine

VERSIONS = ((3, 2), (3, 9), (3, 15), (5, 0), (5, 12), (5, 22), (5, 23))


@pytest.mark.parametrize("version", VERSIONS)
def test_every_variable_packs_to_its_type_and_its_value(version) -> None:
    machine = Machine(load_cell("ur10e-demo"), (*version, 0, 0))
    for i in range(48):
        machine.output_ints[i], machine.input_doubles[i] = i - 24, i / 7.0
    known = known_outputs(machine.version)
    names = tuple(known)
    values = [read() for read in readers(machine, names)]
    recipe = rtde.Recipe(names, [known[name] for name in names])
    unpacked = recipe.unpack(recipe.pack(values))
    for name, value in zip(names, values, strict=True):
        assert unpacked[name] == (tuple(value) if isinstance(value, list | tuple) else value), name
        flat = np.atleast_1d(value)
        assert len(flat) == {"VECTOR3D": 3, "VECTOR6D": 6, "VECTOR6INT32": 6}.get(known[name], 1), name
        assert np.isfinite(flat).all(), name


@pytest.mark.parametrize("family", [3, 5])
def test_newer_versions_know_what_older_ones_know(family) -> None:
    versions = [(family, minor, bugfix, 0) for minor in range(26) for bugfix in (0, 1)]
    for known in (known_outputs, known_inputs):
        for older, newer in itertools.pairwise(versions):
            assert known(older).items() <= known(newer).items()
    assert known_outputs((5, 25)) == dict(rtde.OUTPUTS)
    assert known_inputs((5, 25)) == dict(rtde.INPUTS)


@pytest.mark.parametrize(
    ("name", "cb3", "e"),
    [
        ("elbow_position", (3, 5), (5, 0)),
        ("safety_status", (3, 10), (5, 4)),
        ("payload_cog", (3, 11), (5, 5, 1)),
        ("payload_inertia", (3, 15), (5, 11)),
        ("output_bit_register_64", (3, 9), (5, 3)),
        ("input_int_register_24", (3, 9), (5, 3)),
        ("ft_raw_wrench", None, (5, 9)),
        ("time_scale_source", None, (5, 17)),
        ("actual_robot_energy_consumed", None, (5, 23)),
        ("actual_current_as_torque", None, (5, 23)),
        ("input_int_register_23", (3, 0), (5, 0)),
    ],
)
def test_variables_came_with_their_version(name, cb3, e) -> None:
    for family, since in ((3, cb3), (5, e)):
        for minor, bugfix in itertools.product(range(24), (0, 1)):
            version = (family, minor, bugfix, 0)
            assert (name in known_outputs(version)) == (since is not None and version >= since)


def test_inputs_other_than_registers_are_not_told() -> None:
    assert {name for name in rtde.INPUTS if name not in rtde.OUTPUTS} == {
        name for name in rtde.INPUTS if not name.startswith("input_")
    }
