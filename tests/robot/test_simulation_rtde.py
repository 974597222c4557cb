"""The simulated controller's RTDE, as a raw client sees it."""

from __future__ import annotations

import contextlib
import itertools
import math
import socket
import struct
import time

import numpy as np
import pytest
from rtde_client import Client, of_all

from planning import ARMS, load_cell
from robot import rtde
from robot.simulation import SimulatedCell
from robot.simulation.interfaces.variables import known_outputs

NEWEST, CB3 = "127.0.32.2", "127.0.32.3"


@pytest.fixture(scope="module")
def newest():
    """A controller that counts its cycles in what it sends."""
    with SimulatedCell.start("ur10e-demo", host=NEWEST, version="5.23") as simulated:
        yield simulated


@pytest.fixture(scope="module")
def cb3():
    with SimulatedCell.start("ur10e-demo", host=CB3, version="3.15") as simulated:
        yield simulated


def test_a_name_of_a_later_version_is_not_found(cb3) -> None:
    with Client(CB3) as client:
        names = ["timestamp", "actual_robot_energy_consumed", "nonsense", "payload_inertia"]
        number, types = client.outputs(names)
        assert number == 0
        assert types == ("DOUBLE", rtde.NOT_FOUND, rtde.NOT_FOUND, "VECTOR6D")
        assert client.start() == b"\x00"
        assert client.inputs(["nonsense", "input_int_register_40"]) == (0, (rtde.NOT_FOUND, "INT32"))
        assert client.inputs(["input_int_register_40"]) == (1, ("INT32",))


@pytest.mark.parametrize(("host", "version", "fixture"), [(NEWEST, (5, 23), "newest"), (CB3, (3, 15), "cb3")])
def test_everything_that_is_known_is_sent_at_once(request, host, version, fixture) -> None:
    request.getfixturevalue(fixture)
    names = list(known_outputs(version))
    with of_all(host, names) as client:
        values = client.values()
        assert list(values) == names
        told = rtde.read_controller_version(client.ask(rtde.ask_controller_version()))
        assert told[:2] == version
        home = load_cell("ur10e-demo").robot.home
        assert values["actual_q"] == pytest.approx(home)
        assert (values["robot_mode"], values["runtime_state"], values["safety_mode"]) == (7, 1, 1)


@pytest.mark.parametrize(
    ("asked", "every"),
    [(500.0, 1), (125.0, 4), (1e9, 1), (0.0, 1), (-1.0, 1), (math.nan, 1), (100.0, 5), (50.0, 10), (7.0, 71)],
)
def test_packages_come_every_so_many_cycles(newest, asked, every) -> None:
    with Client(NEWEST) as client:
        assert client.outputs(["control_step", "timestamp"], asked)[0] == 1
        client.start()
        told = [client.values() for _ in range(6)]
    steps = np.diff([values["control_step"] for values in told])
    assert ((steps > 0) & (steps <= every)).all()  # fewer where the controller has dropped cycles
    times = [values["timestamp"] for values in told]
    assert (np.diff(times) > 0.0).all()
    assert times[-1] - times[0] > ((len(steps) - 1) * every - 2) * 0.002


def test_a_frequency_next_to_nothing_is_allowed(newest) -> None:
    with Client(NEWEST) as client:
        assert client.outputs(["timestamp"], 5e-324)[0] == 1
        assert client.start() == b"\x01"
        assert client.outputs(["timestamp"], math.inf)[0] == 1
        client.values()


def test_a_cb3_sends_every_eight_milliseconds(cb3) -> None:
    with Client(CB3) as client:
        client.outputs(["timestamp"], 500.0)
        client.start()
        times = [client.values()["timestamp"] for _ in range(60)]
    assert np.median(np.diff(times)) == pytest.approx(0.008, rel=0.15)


def test_a_pause_ends_the_values_and_a_start_brings_them_back(newest) -> None:
    with of_all(NEWEST, ["timestamp"]) as client:
        client.values()
        assert client.ask(rtde.ask_pause()) == b"\x01"
        client.connection.settimeout(0.1)
        assert not client.pending
        with pytest.raises(TimeoutError):
            client.next()
        client.connection.settimeout(2.0)
        assert client.start() == b"\x01"
        client.values()
        assert client.start() == b"\x01"
        client.values()


def test_the_last_recipe_counts_whether_values_flow_or_not(newest) -> None:
    with of_all(NEWEST, ["timestamp"]) as client:
        client.values()
        assert client.outputs(["actual_q", "control_step"])[0] == 1
        assert set(client.values()) == {"actual_q", "control_step"}
        assert client.outputs(["actual_q", "nonsense"]) == (0, ("VECTOR6D", rtde.NOT_FOUND))
        client.pending.clear()
        assert client.start() == b"\x00"


def test_the_protocol_before_the_second_has_no_frequency_and_no_number(newest) -> None:
    for protocol in (None, 1):
        with Client(NEWEST, protocol=protocol) as client:
            names = ["timestamp", "control_step", "actual_q"]
            types = client.ask(rtde.package(rtde.Package.OUTPUTS, ",".join(names).encode()))
            recipe = rtde.Recipe(names, types.decode().split(","))
            assert client.start() == b"\x01"
            told = [recipe.unpack(client.next_of(rtde.Package.VALUES)) for _ in range(6)]
            steps = np.diff([values["control_step"] for values in told])
            assert ((steps > 0) & (steps <= 4)).all()
            assert told[-1]["timestamp"] - told[0]["timestamp"] > (4 * 4 - 2) * 0.002


def test_only_two_protocols_are_spoken(newest) -> None:
    with Client(NEWEST, protocol=None) as client:
        for asked in (0, 3, 65535):
            request = rtde.package(rtde.Package.PROTOCOL, struct.pack(">H", asked))
            assert client.ask(request) == b"\x00"


def test_nothing_is_told_that_was_not_asked_for_before_the_start(newest) -> None:
    with Client(NEWEST) as client:
        client.write(9, ">i", 1)
        client.connection.sendall(rtde.package(rtde.Package.MESSAGE, b"\x05hello\x02me\x03"))
        client.connection.sendall(rtde.package(250, b"?"))
        client.outputs(["timestamp"])
        client.start()
        client.write(9, ">i", 1)
        message = client.next_of(rtde.Package.MESSAGE)
        text = message[1 : 1 + message[0]]
        assert b"9" in text
        rest = message[1 + message[0] :]
        assert rest[1:-1] == b"RTDE interface"[: rest[0]]
        client.values()


def test_a_client_that_asks_and_does_not_read_is_not_heard_until_it_does(newest) -> None:
    request = rtde.ask_outputs(["nonsense"] * 2000, 1.0)
    answer = rtde.package(rtde.Package.OUTPUTS, b"\0" + ",".join([rtde.NOT_FOUND] * 2000).encode())
    with Client(NEWEST) as deaf, of_all(NEWEST, ["timestamp"]) as other:
        deaf.connection.settimeout(0.3)
        sent = 0
        with contextlib.suppress(TimeoutError):
            while sent < 100_000_000:
                sent += deaf.connection.send(request)
        assert sent < 100_000_000
        other.until(lambda values: values["timestamp"] > 0.0)
        deaf.connection.settimeout(2.0)
        received = b""
        while len(received) < sent // len(request) * len(answer):
            received += deaf.connection.recv(1 << 20)
        assert received[: len(answer)] == answer


# -- inputs


def test_an_input_belongs_to_one_connection_until_that_ends(newest) -> None:
    names = ["input_int_register_3", "input_double_register_3"]
    with Client(NEWEST) as owner, Client(NEWEST) as other:
        assert owner.inputs(names)[0] == 1
        assert owner.inputs([names[0]])[0] == 2  # one connection may share it among its recipes
        assert other.inputs(names) == (0, (rtde.IN_USE, rtde.IN_USE))
        assert other.inputs(["input_int_register_4", names[1]]) == (0, ("INT32", rtde.IN_USE))
        assert other.inputs(["input_int_register_4"]) == (1, ("INT32",))
        other.outputs([*names, "input_int_register_4"])
        other.start()
        owner.write(1, ">id", -77, 0.25)
        other.until(lambda values: [values[name] for name in names] == [-77, 0.25])
        owner.write(2, ">i", 78)
        other.write(1, ">i", 5)
        values = other.until(lambda values: values[names[0]] == 78)
        assert values[names[1]] == 0.25
        other.until(lambda values: values["input_int_register_4"] == 5)
    with Client(NEWEST) as client:
        end = time.monotonic() + 2.0
        while client.inputs(names)[0] == 0:
            assert time.monotonic() < end


def test_every_input_register_reads_back_what_was_written(newest) -> None:
    names = [name for name in rtde.INPUTS if name.startswith("input_")]
    with Client(NEWEST) as client:
        number, types = client.inputs(names)
        recipe = rtde.Recipe(names, types)
        written = dict.fromkeys(names, True) | {
            name: i + 0.5 if kind == "DOUBLE" else i - 20
            for i, (name, kind) in enumerate(zip(names, types, strict=True))
            if kind in ("DOUBLE", "INT32")
        }
        written |= {"input_bit_registers0_to_31": 0xA5A5F00F, "input_bit_registers32_to_63": 1 << 31}
        client.outputs(names)
        client.start()
        package = rtde.values_package(number, recipe.pack([written[name] for name in names]))
        client.connection.sendall(package)
        client.until(lambda values: values == written)


def test_masks_choose_the_outputs_that_are_written(newest) -> None:
    with Client(NEWEST) as client:
        digital, _ = client.inputs(["standard_digital_output_mask", "standard_digital_output"])
        tool, _ = client.inputs(["tool_digital_output_mask", "tool_digital_output"])
        configurable, _ = client.inputs(["configurable_digital_output_mask", "configurable_digital_output"])
        client.outputs(["actual_digital_output_bits", "actual_configurable_digital_output_bits"])
        client.start()
        client.write(digital, ">BB", 0b0110, 0xFF)
        client.until(lambda values: values["actual_digital_output_bits"] == 0b0110)
        client.write(digital, ">BB", 0b0011, 0b0001)
        client.write(tool, ">BB", 0xFF, 0xFF)
        client.write(configurable, ">BB", 0x80, 0x80)
        told = client.until(
            lambda values: values["actual_digital_output_bits"] == 0b11 << 16 | 0x80 << 8 | 0b0101
        )
        assert told["actual_configurable_digital_output_bits"] == 0x80
        for number in (digital, tool, configurable):
            client.write(number, ">BB", 0xFF, 0)
        client.until(lambda values: values["actual_digital_output_bits"] == 0)


def test_analog_outputs_are_volts_or_amperes_within_their_range(newest) -> None:
    names = ["standard_analog_output_mask", "standard_analog_output_type"]
    names += ["standard_analog_output_0", "standard_analog_output_1"]
    with Client(NEWEST) as client:
        number, _ = client.inputs(names)
        told = [
            "standard_analog_output0",
            "standard_analog_output1",
            "analog_io_types",
            "tool_output_voltage",
        ]
        client.outputs(told)
        client.start()
        client.write(number, ">BBdd", 0b11, 0b01, 0.25, 0.25)
        told = client.until(lambda values: values["standard_analog_output0"] == 2.5)
        assert told["standard_analog_output1"] == pytest.approx(0.008)
        assert told["analog_io_types"] == 0b0100
        client.write(number, ">BBdd", 0b01, 0b01, math.nan, math.nan)
        client.write(number, ">BBdd", 0b01, 0b01, 7.0, math.nan)
        told = client.until(lambda values: values["standard_analog_output0"] == 10.0)
        assert told["standard_analog_output1"] == pytest.approx(0.008)
        with socket.create_connection((NEWEST, 30002), 2.0) as scripts:
            scripts.sendall(b"def half():\n  set_standard_analog_out(0, 0.5)\n  set_tool_voltage(12)\nend\n")
            client.until(lambda values: values["standard_analog_output0"] == 5.0)
        client.until(lambda values: values["tool_output_voltage"] == 12)


def test_the_slider_takes_numbers_within_its_range_and_nothing_else(newest) -> None:
    with Client(NEWEST) as client:
        number, _ = client.inputs(["speed_slider_mask", "speed_slider_fraction"])
        client.outputs(["target_speed_fraction"])
        client.start()
        for written, told in ((0.5, 0.5), (-3.0, 0.0), (1.7, 1.0), (0.25, 0.25), (math.inf, 1.0)):
            client.write(number, ">Id", 1, written)
            client.until(lambda values, told=told: values["target_speed_fraction"] == told)
        client.write(number, ">Id", 1, 0.75)
        client.write(number, ">Id", 1, math.nan)
        client.write(number, ">Id", 0, 0.1)
        client.until(lambda values: values["target_speed_fraction"] == 0.75)
        time.sleep(0.05)
        client.pending.clear()
        assert client.values()["target_speed_fraction"] == 0.75
        client.write(number, ">Id", 1, 1.0)
        client.until(lambda values: values["target_speed_fraction"] == 1.0)


def test_a_register_may_hold_what_is_no_number(newest) -> None:
    with Client(NEWEST) as client:
        number, _ = client.inputs(["input_double_register_9", "external_force_torque"])
        client.outputs(["input_double_register_9", "actual_TCP_force", "tcp_force_scalar"])
        client.start()
        client.write(number, ">7d", math.nan, *[math.nan] * 6)
        told = client.until(lambda values: math.isnan(values["input_double_register_9"]))
        assert told["tcp_force_scalar"] == 0.0
        client.write(number, ">7d", 1.0, 3.0, -4.0, 0.0, 0.1, 0.2, 0.3)
        told = client.until(lambda values: values["tcp_force_scalar"] > 0.0)
        assert told["tcp_force_scalar"] == pytest.approx(5.0)
        assert told["actual_TCP_force"] == pytest.approx((3.0, -4.0, 0.0, 0.1, 0.2, 0.3))
        client.write(number, ">7d", *[0.0] * 7)


# -- what is told while the arm moves


def test_speeds_and_accelerations_are_those_of_the_motion(newest) -> None:
    names = ["timestamp", "control_step", "runtime_state", "actual_q", "actual_qd", "target_q", "target_qdd"]
    names += ["actual_TCP_speed", "actual_TCP_acceleration", "elbow_position", "elbow_velocity"]
    names += ["actual_tool_accelerometer", "actual_TCP_pose"]
    with of_all(NEWEST, names) as client, socket.create_connection((NEWEST, 30002), 2.0) as scripts:
        scripts.sendall(b"def turn():\n  movej([0.5,-1.2,-1.4,-1.6,1.4,0.3], a=3, v=1)\nend\n")
        client.until(lambda values: values["runtime_state"] == 2)
        told = []
        while not told or told[-1]["runtime_state"] == 2:
            told.append(client.values())
    assert len(told) > 100
    arm = ARMS["ur10e"]
    turned = 0
    for before, now in itertools.pairwise(told):
        elbow = np.array(now["elbow_position"]) * 1e3
        assert np.linalg.norm(elbow - [0.0, 0.0, arm.d1]) == pytest.approx(abs(arm.a2))
        assert np.linalg.norm(now["actual_tool_accelerometer"]) == pytest.approx(9.82)
        assert now["target_q"] == now["actual_q"]
        seconds = now["timestamp"] - before["timestamp"]
        if now["control_step"] - before["control_step"] != 1 or seconds > 0.01:
            continue
        turned += 1
        for speed, acceleration in (
            ("actual_qd", "target_qdd"),
            ("actual_TCP_speed", "actual_TCP_acceleration"),
        ):
            change = (np.array(now[speed]) - before[speed]) / seconds
            assert np.allclose(change, now[acceleration], atol=1e-6)
        moved = np.array(now["elbow_position"]) - before["elbow_position"]
        mean = 0.5 * (np.array(now["elbow_velocity"]) + before["elbow_velocity"])
        assert np.allclose(moved, mean * seconds, atol=2e-4)
    assert turned > 50
