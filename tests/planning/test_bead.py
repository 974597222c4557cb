import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planning.bead import Ramp, drive
from twins import Curve


@settings(max_examples=100, deadline=None)
@given(
    length=st.floats(2.0, 2000.0),
    speed=st.floats(5.0, 300.0),
    end=st.floats(0.02, 0.5),
    lag=st.floats(0.0, 1.0),
    room=st.floats(0.9, 9.0),
)
def test_speed_rises_and_falls_no_faster_than_the_pump(length, speed, end, lag, room):
    ramp = Ramp.along(length, speed, end, lag, 500.0, room)
    places = np.linspace(0.0, length, 4001)
    v = ramp.speed_at(places)
    assert v.max() <= speed * (1 + 1e-9)
    assert v[-1] <= max(end * speed, v.max()) * (1 + 1e-6)
    assert v[0] == 0.0
    rate = np.diff(0.5 * v**2) / np.diff(places)  # dv/dt = v dv/ds
    assert rate.max() <= 500.0 * (1 + 1e-3)
    middle = 0.5 * (v[1:] + v[:-1])
    if lag > 0:
        # Rising, v + T dv/dt stays within the pump's head room; falling, it stays above 0.
        command = middle + lag * rate
        assert command.max() <= speed * 1.5 * (1 + 1e-3)
        if room > 1.1:
            assert command.max() <= speed * room * (1 + 1e-3)
        assert (command >= -1e-3 * middle).all()


def test_a_closed_curve_is_driven_once_around_from_its_start():
    square = Curve(np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0], [0.0, 50.0]]))
    bead = drive(square, 2, 10.0, 50.0, 0.05, 0.2)
    assert bead.points[0] == pytest.approx([50.0, 50.0])
    assert bead.points[-1] == pytest.approx([50.0, 50.0])
    assert np.linalg.norm(np.diff(bead.points, axis=0), axis=1).sum() == pytest.approx(200.0)
    for corner in square.points:
        assert np.linalg.norm(bead.points - corner, axis=1).min() < 1e-12
    assert (bead.speed[1:] > 0).all()
