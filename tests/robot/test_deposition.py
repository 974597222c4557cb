"""The deposition trace: no volume is lost between robot and pump, and nothing is where the tool never was."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from robot.errors import RobotError
from robot.simulation.deposition import PumpFlow, RobotMotion, deposition, read_deposition, write_deposition


@st.composite
def times(draw, least):
    steps = draw(arrays.arrays(np.float64, st.integers(least, 30), elements=st.floats(1e-3, 2.0)))
    return draw(st.floats(-5.0, 5.0)) + np.cumsum(steps)


@st.composite
def traces(draw):
    robot, pump = draw(times(1)), draw(times(2))
    places = draw(arrays.arrays(np.float64, (len(robot), 3), elements=st.floats(-1e3, 1e3)))
    volume = np.cumsum(draw(arrays.arrays(np.float64, len(pump), elements=st.floats(0.0, 1e5))))
    return RobotMotion(robot, places), PumpFlow(pump, volume, pump - pump[0])


@settings(max_examples=60, deadline=None)
@given(traces())
def test_flow_over_time_is_the_pumps_volume(both):
    robot, pump = both
    found = deposition(robot, pump)
    pumped = pump.volume[-1] - pump.volume[0]
    assert np.sum(found.flow[1:] * np.diff(found.time)) == pytest.approx(pumped, rel=1e-9, abs=1e-6)
    assert found.volume[-1] == pytest.approx(pumped, rel=1e-12, abs=1e-9)
    assert np.all(np.diff(found.time) > 0.0)
    assert np.all(found.flow >= -1e-6)
    assert set(map(tuple, found.position)) == set(map(tuple, robot.position))
    assert set(robot.time) <= set(found.time)
    assert found.path[-1] == pytest.approx(np.linalg.norm(np.diff(robot.position, axis=0), axis=1).sum())


def test_an_even_flow_along_a_line():
    """A tool at 50 mm/s with 1000 mm³/s leaves 20 mm³ on each mm, whenever either was looked at."""
    t, s = np.linspace(0.0, 10.0, 1001), np.linspace(-0.003, 10.003, 777)
    robot = RobotMotion(t, np.column_stack([50.0 * t, 0.0 * t, 0.0 * t]))
    found = deposition(robot, PumpFlow(s, 1000.0 * (s - s[0]), np.full(len(s), 3.0)))
    inside = slice(2, -2)
    np.testing.assert_allclose(found.flow[inside], 1000.0, rtol=1e-9)
    np.testing.assert_allclose(np.diff(found.volume)[inside] / np.diff(found.path)[inside], 20.0, rtol=1e-9)
    np.testing.assert_allclose(found.age, 3.0)
    assert found.path[-1] == pytest.approx(500.0)


def test_a_pump_that_never_said_anything_laid_nothing():
    robot = RobotMotion(np.array([0.0, 1.0]), np.zeros((2, 3)))
    none = np.zeros(0)
    found = deposition(robot, PumpFlow(none, none, none))
    assert not found.flow.any()
    assert np.isnan(found.age).all()


ROBOT = "time_s,x_mm,y_mm,z_mm,speed_mm_s\n0.0,1,2,3,0\n1.0,4,6,3,5\n"
PUMP = "time_s,flow_mm3_s,volume_mm3,age_s\n0.0,0,0,1\n2.0,10,20,3\n"


def test_files_are_joined_though_a_last_line_is_cut_off(tmp_path):
    (tmp_path / "robot.csv").write_text(ROBOT + "1.01,7.", encoding="ascii")
    (tmp_path / "pump.csv").write_text(PUMP + "3.0,1", encoding="ascii")
    found = read_deposition(tmp_path)
    np.testing.assert_allclose(found.time, [0.0, 1.0, 2.0])
    np.testing.assert_allclose(found.position, [[1, 2, 3], [4, 6, 3], [4, 6, 3]])
    np.testing.assert_allclose(found.flow, [0.0, 10.0, 10.0])
    np.testing.assert_allclose(found.age, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(found.path, [0.0, 5.0, 5.0])
    written = np.genfromtxt(write_deposition(tmp_path), delimiter=",", names=True)
    np.testing.assert_allclose(written["flow_mm3_s"], found.flow)
    np.testing.assert_allclose(written["z_mm"], found.position[:, 2])
    np.testing.assert_allclose(written["path_mm"], found.path)


@pytest.mark.parametrize(
    ("robot", "pump", "says"),
    [
        (None, PUMP, "robot.csv: cannot be read"),
        (ROBOT.replace("y_mm", "why"), PUMP, "robot.csv: no column 'y_mm'"),
        (ROBOT, PUMP.replace("20", "much"), "pump.csv: not a trace"),
        ("time_s,x_mm,y_mm,z_mm\n", PUMP, "robot.csv: no rows"),
    ],
)
def test_a_wrong_trace_is_named(tmp_path, robot, pump, says):
    for name, text in (("robot.csv", robot), ("pump.csv", pump)):
        if text is not None:
            (tmp_path / name).write_text(text, encoding="ascii")
    with pytest.raises(RobotError, match=says.replace(".", r"\.")):
        read_deposition(tmp_path)
