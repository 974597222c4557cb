import pytest
from shapes import box, fan_top

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
    part = box(100.0, 80.0, 60.0)
    return slice_surface(part, layer_planes(Plane.horizontal(), fan_top(part, 20.0), 6.0))


@pytest.fixture(scope="session")
def program(rotary, cell, mix, settings):
    return plan(rotary, cell, mix, settings)
