"""What is said of a drive by what it measures: nothing of one that follows, however slowly; something of one that does
not.
"""

import re
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planning import load_cell
from robot.pump_judge import BEATS, DOUBT, GLITCH, STANDSTILL, PumpJudge
from robot.pump_link import PumpReading
from robot.pump_map import pump_map
from robot.simulation.pump.plant import Plant, PlantSettings

STEP = 0.02
PUMP = load_cell("ur10e-demo").pump
DRIVES = [
    {},
    {"ramp": 3.0},
    {"motor": True},
    {"motor": True, "ramp": 3.0},
    {"dead_time": 0.0, "lag": 0.0},
    {"dead_time": 0.5, "lag": 0.6},
]
"""As calibrated, with a slow ramp, measuring the motor, quicker, and much slower than calibrated."""
ANSWER = PUMP.dead_time_s + PUMP.lag_s
commands = st.lists(
    st.tuples(st.floats(0.0, PUMP.flow_max), st.floats(0.02, 3.0)), min_size=1, max_size=12
).map(lambda parts: [flow for flow, seconds in parts for _ in range(round(seconds / STEP))])


def readings(flows, *, dead_time=PUMP.dead_time_s, lag=PUMP.lag_s, ramp=0.0, counts=2.0, motor=False):
    """What a drive measures while it is told flows, one each `STEP`."""
    plant = Plant(PlantSettings(PUMP.flow_max, dead_time, lag, ramp=ramp))
    for k, flow in enumerate(flows):
        plant.run(k * STEP, flow)
        measured = plant.speed if motor else plant.hose.flow
        beat = int(k * STEP / 0.1)
        yield PumpReading(flow, round(measured / counts) * counts, running=flow > 0.0, beat=beat, echo=beat)
        plant.advance((k + 1) * STEP)


def first_fault(given):
    """When a fault is said at first, s, and which; None without one."""
    judge = PumpJudge(PUMP, pump_map(PUMP))
    for k, reading in enumerate(given):
        fault = judge.fault(reading, k * STEP)
        if fault is not None:
            return k * STEP, fault
    return None


@settings(max_examples=60, deadline=None)
@given(
    commands,
    st.sampled_from(DRIVES),
    st.sampled_from([0.01, 2.0, 67.0]),
)
def test_nothing_is_said_of_a_drive_that_follows(flows, drive, counts):
    assert first_fault(readings(flows, **drive, counts=counts)) is None


def test_nothing_is_said_of_a_drive_at_one_flow():
    assert first_fault(readings([9000.0] * round(60.0 / STEP))) is None
    assert first_fault(PumpReading(9000.0, 9000.0) for _ in range(3000)) is None


@pytest.mark.parametrize("then", [0.0, 5000.0, 14000.0])
def test_registers_that_stand_still_are_noticed(then):
    flows = [9000.0] * 200 + [then] * 200
    frozen = [replace(reading, running=None, echo=None) for reading in readings(flows)]
    frozen[200:] = [replace(reading, flow=frozen[199].flow) for reading in frozen[200:]]
    at, fault = first_fault(frozen)
    assert 0.0 < at - 200 * STEP - DOUBT - ANSWER < 3.0 * PUMP.lag_s
    assert "stand still" in fault
    assert "9000" in fault


def test_a_heartbeat_that_stands_still_is_noticed_where_it_was_seen_to_count():
    living = list(readings([9000.0] * 400))
    stuck = [replace(r, echo=min(r.echo, 20)) for r in living]
    at, fault = first_fault(stuck)
    assert at == pytest.approx(0.1 * (20 + BEATS + 1), abs=0.1)
    assert "heartbeat, register 3, stands still at 20" in fault
    assert first_fault(replace(r, echo=0) for r in living) is None  # a drive that shows nothing there


def test_a_heartbeat_may_come_round():
    living = [replace(r, beat=(65530 + r.beat) & 0xFFFF) for r in readings([9000.0] * 400)]
    assert first_fault(replace(r, echo=r.beat) for r in living) is None
    stuck = [replace(r, echo=r.beat if 65530 <= r.beat < 65533 else 65533) for r in living]
    assert "stands still at 65533" in first_fault(stuck)[1]


@pytest.mark.parametrize(
    ("wrong", "after", "says"),
    [
        ({"flow": 2.1 * PUMP.flow_max}, GLITCH, "says that it pumps 42000 mm³"),
        ({"flow": -1e30}, GLITCH, r"-1e\+30 mm³/s.*register 2 \(measured_flow\)"),
        ({"flow": 0.0}, STANDSTILL + ANSWER, "is told 9000 mm³/s and measures none"),
        ({"flow": 1e-38}, STANDSTILL + ANSWER, "measures none"),
        ({"flow": 296.0}, DOUBT + ANSWER, "measures 296"),
        ({"running": False}, STANDSTILL + ANSWER, "says that it does not run"),
    ],
)
def test_what_makes_no_sense_is_noticed_when_it_lasts(wrong, after, says):
    living = list(readings([9000.0] * 400))
    at, fault = first_fault(living[:200] + [replace(r, **wrong) for r in living[200:]])
    assert at - 200 * STEP == pytest.approx(after, abs=2.0 * STEP)
    assert re.search(says, fault)
    short = round(0.8 * after / STEP)
    again = living[:200] + [replace(r, **wrong) for r in living[200 : 200 + short]] + living[200 + short :]
    assert first_fault(again) is None


def test_a_map_without_measurements_gives_no_means():
    told = (PumpReading(flow, flow) for flow in [0.0, 9000.0] * 1000)
    assert first_fault(told) is None
