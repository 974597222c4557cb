"""Every setter of ur-rtde's IO interface, read back by the receiving client."""

from __future__ import annotations

import pytest
from rtde_io import RTDEIOInterface


def test_every_method_is_called(tour) -> None:
    methods = {name for name in vars(RTDEIOInterface) if name[0] != "_"}
    assert methods - tour.called("io") == set()


def test_each_digital_output_is_set_alone(tour) -> None:
    told = tour["outputs"]
    assert all(told["answers"])
    assert told["cleared"] == told["afterwards"] == 0
    assert [place for place, _ in told["set"]] == list(range(18))
    for place, bits in told["set"]:
        assert bits == 1 << place


def test_analog_outputs_are_volts_or_milliamperes(tour) -> None:
    """Up to 10 V, or from 4 to 20 mA, told in A."""
    first, second, third, fourth = tour["outputs"]["analog"]
    assert first[0] == pytest.approx(2.5)
    assert second == pytest.approx([2.5, 7.5])
    assert third == pytest.approx([0.012, 7.5])
    assert fourth == pytest.approx([0.012, 0.004])


def test_the_slider_scales_the_move(tour) -> None:
    told = tour["the_slider"]  # each speed was reached, or the step had failed
    assert told["answers"] == [True] * 3
    for share, fraction, combined in told["told"]:
        assert fraction == pytest.approx(share)
        assert combined == pytest.approx(share, abs=1e-3)


def test_registers_reach_the_program(tour) -> None:
    told = tour["input_registers"]
    assert all(told["answers"])
    assert told["ints"] == [-1000 - i for i in range(18, 23)]
    assert told["doubles"] == [0.5 * i for i in range(18, 23)]
    assert told["refused"] == 2  # a register of the control interface
