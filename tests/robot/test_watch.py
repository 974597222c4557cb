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


class Clock:
    """A clock that is put forward by hand, in place of the guard's."""

    def __init__(self):
        self.now = 1000.0

    def monotonic(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr("robot.watch.time", made)
    return made


@pytest.fixture
def go_on(clock, guard):
    """Let time pass in which the robot speaks every 2 ms and the arm process every 8 ms, or does not."""

    def pass_time(seconds, *, arm=True, robot=True):
        for i in range(round(seconds / 0.002)):
            clock.now += 0.002
            if robot:
                guard.see(state())
            if arm and i % 4 == 3:
                guard.hear(0.0)

    guard.arm()
    pass_time(0.5)
    return pass_time


STOPPED = "the program on the controller was stopped or paused"


@pytest.mark.parametrize("later", [0.0, 0.008, 0.04])
def test_a_program_that_stopped_while_the_arm_process_was_silent_says_so(guard, reasons, go_on, later):
    go_on(0.08, arm=False)
    go_on(later)
    guard.see(state(playing=False))
    assert re.match(rf"{STOPPED}; the arm process had been silent for 0\.0[89] s, and ", reasons[0])


@pytest.mark.parametrize(("silent", "later"), [(0.06, 0.0), (0.09, 0.08), (0.0, 0.0)])
def test_a_program_that_stopped_for_another_reason_does_not(guard, reasons, go_on, silent, later):
    go_on(silent, arm=False)
    go_on(later)
    guard.see(state(playing=False))
    assert reasons == [STOPPED]


@pytest.mark.parametrize("arm_first", [True, False])
def test_being_held_up_itself_is_no_silence_of_the_arm_process(guard, reasons, go_on, clock, arm_first):
    clock.now += 0.09
    if arm_first:
        guard.hear(0.0)
    guard.see(state(playing=False))
    assert reasons == [STOPPED]


@pytest.mark.parametrize(("window", "silent", "says"), [(0.3, 0.36, STOPPED), (0.3, 0.38, "for 0.08 s")])
def test_in_an_upload_the_arm_process_may_be_silent(guard, reasons, go_on, window, silent, says):
    guard.hear(window)
    go_on(silent, arm=False)
    guard.see(state(playing=False))
    assert says in reasons[0]
    assert (says == STOPPED) == (reasons[0] == STOPPED)


def test_a_silence_right_behind_an_upload_counts(guard, reasons, go_on):
    guard.hear(1.0)
    go_on(0.2, arm=False)
    guard.hear(0.0)
    go_on(0.09, arm=False)
    guard.see(state(playing=False))
    assert "silent for 0.09 s" in reasons[0]


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
