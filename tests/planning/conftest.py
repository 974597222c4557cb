import numpy as np
import pytest
from shapes import box

from planning import PrintSettings, load_cell, load_mix, plan
from twins import Plane, layer_planes, slice_surface


@pytest.fixture(scope="session")
def cell():
    return load_cell("ur10e-demo")


@pytest.fixture(scope="session")
def mix():
    return load_mix("fresh-mortar")


@pytest.fixture(scope="session")
def settings():
    return PrintSettings(width=12.0, speed=60.0)


@pytest.fixture(scope="session")
def rotary():
    """A box under a tilted plane that cuts it all around: its walls are upright, and nothing hangs over."""
    tilt = np.radians(15.0)
    top = Plane(
        np.array([0.0, 0.0, 45.0]), np.array([np.cos(tilt), 0.0, np.sin(tilt)]), np.array([0.0, 1.0, 0.0])
    )
    return slice_surface(box(100.0, 80.0, 60.0), layer_planes(Plane.horizontal(), top, 6.0))


@pytest.fixture(scope="session")
def program(rotary, cell, mix, settings):
    return plan(rotary, cell, mix, settings)
