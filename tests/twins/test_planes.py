from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twins import Plane, PlanesError, custom_planes, layer_planes

BED = Plane.horizontal()


def test_thickness_is_adjusted_to_the_height():
    planes = layer_planes(BED, 95.0, 10.0)
    assert len(planes) == 10
    assert planes.thickness == pytest.approx(9.5)
    assert [p.origin[2] for p in planes.nozzle] == pytest.approx(np.arange(1, 11) * 9.5)
    assert [p.origin[2] for p in planes.slicing] == pytest.approx((np.arange(10) + 0.5) * 9.5)


def test_a_height_that_is_a_multiple_of_the_thickness_has_no_layer_more():
    assert len(layer_planes(BED, 0.3, 0.1)) == 3


def test_a_parallel_top_plane_is_its_height():
    top = Plane(np.array([50.0, 7.0, 95.0]), np.array([0.0, 1.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    assert len(layer_planes(BED, top, 10.0)) == 10


@settings(max_examples=60, deadline=None)
@given(
    tilt=st.floats(0.5, 80.0),
    heading=st.floats(0.0, 360.0),
    height=st.floats(100.0, 900.0),
    thickness=st.floats(2.0, 20.0),
)
def test_a_rotary_stack_turns_the_bed_into_the_top_plane(tilt, heading, height, thickness):
    a, b = np.radians(tilt), np.radians(heading)
    normal = np.array([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)])
    x = np.cross([0.0, 0.0, 1.0], normal)
    top = Plane(np.array([0.0, 0.0, height]), x, np.cross(normal, x))
    planes = layer_planes(BED, top, thickness)
    # The last nozzle plane is the top plane; every plane turns by the same angle about one line.
    assert planes.nozzle[-1].normal == pytest.approx(top.normal, abs=1e-9)
    assert abs(top.height_of(planes.nozzle[-1].origin[None])[0]) < 1e-6
    floors = [planes.base, *planes.nozzle]
    turns = [np.degrees(np.arccos(np.clip(p.normal @ q.normal, -1, 1))) for p, q in pairwise(floors)]
    assert turns == pytest.approx([tilt / len(planes)] * len(planes), rel=1e-4, abs=1e-5)
    # The origin travels an arc: every step has the nominal thickness, which is at most the wanted one.
    arc = planes.axis.radius * np.radians(tilt) / len(planes)
    assert planes.thickness == pytest.approx(arc)
    assert planes.thickness <= thickness * (1 + 1e-9)
    assert planes.thickness * (len(planes) / max(1, len(planes) - 1)) > thickness or len(planes) == 1
    for plane in planes.nozzle:
        assert np.linalg.norm(
            np.cross(plane.origin - planes.axis.point, planes.axis.direction)
        ) == pytest.approx(planes.axis.radius)


@pytest.mark.parametrize(
    ("top", "thickness", "says"),
    [
        (-5.0, 10.0, "above the bed"),
        (100.0, 0.0, "above 0 mm"),
        (float("nan"), 10.0, "above the bed"),
        (Plane(np.array([0, 0, 50.0]), np.array([1.0, 0, 0]), np.array([0, -1.0, 0])), 10.0, "below 90°"),
        (
            Plane(np.array([0, 0, -50.0]), np.array([1.0, 0, 0.3]), np.array([0, 1.0, 0])),
            10.0,
            "below the bed",
        ),
        (
            Plane(np.array([0, 0, 1.0]), np.array([1.0, 0, 0.3]), np.array([0, 1.0, 0])),
            10.0,
            "mm from the bed's origin",
        ),
    ],
)
def test_impossible_planes_are_refused(top, thickness, says):
    with pytest.raises(PlanesError, match=says):
        layer_planes(BED, top, thickness)


def test_custom_planes_must_rise():
    with pytest.raises(PlanesError, match="nozzle plane 1"):
        custom_planes(BED, [BED, BED], [Plane.horizontal(10.0), Plane.horizontal(5.0)])
    with pytest.raises(PlanesError, match="as many"):
        custom_planes(BED, [], [])
