"""The guard stops on everything that says stop, once, and on nothing else."""

import asyncio
import re
import time

import numpy as np
import pytest

from robot.robot_state import RobotState
from robot.watch import SAFETY, SILENCE, Guard, unsafe


def state(*, playing=True, powered=True, safety=1):
    return RobotState(0.0, np.zeros(3), 0.0, np.zeros(6), playing, powered, safety, 1.0)


@pytest.fixture
def reasons():
    return []


@pytest.fixture
def guard(reasons):
    made = Guard(reasons.append)
    made.arm()
    return made


@pytest.mark.parametrize("bit", SAFETY)
def test_every_safety_bit_stops(guard, reasons, bit):
    guard.see(state())
    assert reasons == []
    guard.see(state(safety=1 << bit))
    assert len(reasons) == 1
    assert SAFETY[bit] in reasons[0]


def test_normal_and_reduced_do_not(guard, reasons):
    for safety in (0b01, 0b10, 0b11):
        guard.see(state(safety=safety))
    assert reasons == []
    assert unsafe(state(safety=0b11)) is None


def test_lost_power_stops(guard, reasons):
    guard.see(state(powered=False))
    assert "power" in reasons[0]


def test_only_the_first_reason_counts(guard, reasons):
    guard.see(state(safety=1 << 2))
    guard.see(state(safety=1 << 7))
    guard.lose("the connection is gone")
    guard.see(state())
    assert len(reasons) == 1


def test_a_stopped_program_is_forgiven_only_in_the_window(guard, reasons):
    guard.hear(window=0.2)
    guard.see(state(playing=False))
    assert reasons == []
    guard.hear(window=0.0)  # the upload is over; states from before may still arrive
    guard.see(state(playing=False))
    assert reasons == []
    time.sleep(0.06)
    guard.hear(window=0.0)
    guard.see(state(playing=False))
    assert "program" in reasons[0]


def test_an_order_is_enough_to_expect_the_upload(guard, reasons):
    """The robot may show the stopped program before the arm process's own word about it is read."""
    guard.hear(window=0.0)
    guard.expect()
    guard.hear(window=0.0)  # sent before it had read the order
    guard.see(state(playing=False))
    assert reasons == []
    guard.see(state(safety=1 << 2))
    assert len(reasons) == 1


def test_a_window_ends_by_itself(guard, reasons):
    guard.hear(window=0.05)
    time.sleep(0.06)
    guard.see(state(playing=False))
    assert len(reasons) == 1


@pytest.mark.parametrize("again", [True, False])
def test_a_program_that_stopped_for_want_of_a_kick_says_so(guard, reasons, again):
    guard.hear(window=0.0)
    time.sleep(0.08)
    if again:
        guard.hear(window=0.0)
    guard.see(state(playing=False))
    assert re.search(r"stopped or paused: the arm process had been silent for 0\.[01]\d s", reasons[0])


def test_a_program_that_stopped_long_after_a_silence_has_another_reason(guard, reasons):
    guard.hear(window=0.05)
    time.sleep(0.08)
    guard.hear(window=0.0)
    time.sleep(0.06)
    guard.hear(window=0.0)
    for _ in range(5):
        time.sleep(0.045)
        guard.hear(window=0.0)
    guard.see(state(playing=False))
    assert reasons[0].endswith("stopped or paused")


def test_a_safety_bit_counts_inside_the_window(guard, reasons):
    guard.hear(window=1.0)
    guard.see(state(playing=False, safety=1 << 4))
    assert "safeguard" in reasons[0]


def test_before_and_after_a_print_nothing_is_judged(reasons):
    guard = Guard(reasons.append)
    guard.see(state(safety=1 << 2))
    guard.lose("x")
    guard.arm()
    guard.disarm()
    guard.see(state(playing=False))
    assert reasons == []


@pytest.mark.parametrize("silent", ["robot", "arm process"])
def test_silence_is_noticed(silent):
    found = []

    async def watch():
        guard = Guard(lambda reason: found.append((time.monotonic(), reason)))
        guard.arm()
        patrol = asyncio.create_task(guard.patrol())
        last = time.monotonic()
        while not found and time.monotonic() - last < 1.0:
            if silent != "robot":
                guard.see(state())
            if silent != "arm process":
                guard.hear(0.0)
            await asyncio.sleep(0.005)
        patrol.cancel()
        return last

    last = asyncio.run(watch())
    assert len(found) == 1
    assert silent in found[0][1]
    assert SILENCE < found[0][0] - last < SILENCE + 0.15


def test_being_held_up_itself_is_no_silence():
    found = []

    async def watch():
        guard = Guard(found.append)
        guard.arm()
        patrol = asyncio.create_task(guard.patrol())
        for _ in range(3):
            await asyncio.sleep(0.03)
            time.sleep(0.2)  # noqa: ASYNC251 - the whole process stands
            await asyncio.sleep(0.001)  # the guard looks at its clocks before what arrived meanwhile is read
            guard.see(state())
            guard.hear(0.0)
        patrol.cancel()

    asyncio.run(watch())
    assert found == []
