from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twins import Plane, PlanesError, custom_planes, layer_planes
from twins.planes import MOST, layer_count, way_up

BED = Plane.horizontal()


def test_thickness_is_adjusted_to_the_height():
    planes = layer_planes(BED, 95.0, 10.0)
    assert len(planes) == 10
    assert planes.thickness == pytest.approx(9.5)
    assert [p.origin[2] for p in planes.nozzle] == pytest.approx(np.arange(1, 11) * 9.5)
    assert [p.origin[2] for p in planes.slicing] == pytest.approx((np.arange(10) + 0.5) * 9.5)


def test_a_height_that_is_a_multiple_of_the_thickness_has_no_layer_more():
    assert len(layer_planes(BED, 0.3, 0.1)) == 3


@pytest.mark.parametrize("height", [100.0, 300.0, 1000.0, 3000.0])
def test_rounding_to_single_precision_makes_no_layer_more(height):
    rounded = float(np.nextafter(np.float32(height), np.float32(np.inf)))
    assert rounded > height
    assert len(layer_planes(Plane.horizontal(), rounded, 10.0)) == height / 10.0
    # What is more than rounding does, and the layers fill it.
    stack = layer_planes(Plane.horizontal(), height + 0.01, 10.0)
    assert len(stack) == height / 10.0 + 1
    assert len(stack) * stack.thickness == pytest.approx(height + 0.01, rel=1e-12)


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
        (100.0, 0.0, "at least 0.001 mm"),
        (100.0, 5e-4, "at least 0.001 mm"),
        (100.0, float("nan"), "at least 0.001 mm"),
        (101.0, 1e-3, "1.01e.05 layers of 0.001 mm, more than 20,000"),
        (
            Plane(np.zeros(3), np.array([1.0, 0, 0.3]), np.array([0, 1.0, 0])),
            10.0,
            "meet at the bed's origin",
        ),
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


def tilted(height, degrees, x=0.0):
    a = np.radians(degrees)
    return Plane(np.array([x, 0.0, height]), np.array([np.cos(a), 0.0, np.sin(a)]), np.array([0.0, 1.0, 0.0]))


def test_the_most_layers_are_allowed():
    assert layer_count(MOST * 0.1, 0.1) == MOST
    assert layer_count(MOST * 1e-3 * (1 + 1e-15), 1e-3) == MOST


def test_a_way_knows_its_bed():
    bed = tilted(7.0, 20.0)
    for top in (50.0, tilted(90.0, 35.0)):
        way = way_up(bed, top)
        for axis in ("origin", "x_axis", "y_axis"):
            np.testing.assert_allclose(getattr(way.at(0.0), axis), getattr(bed, axis), atol=1e-12)
        end = way.at(way.height)
        if isinstance(top, Plane):
            np.testing.assert_allclose(end.normal, top.normal, atol=1e-12)
            assert top.height_of(end.origin[None])[0] == pytest.approx(0.0, abs=1e-9)
        else:
            assert bed.height_of(end.origin[None])[0] == pytest.approx(top)


def test_custom_planes_must_rise():
    flat = [BED, BED]
    with pytest.raises(PlanesError, match="nozzle plane 1 is 5 mm below"):
        custom_planes(BED, flat, [Plane.horizontal(10.0), Plane.horizontal(5.0)])
    with pytest.raises(PlanesError, match="as many"):
        custom_planes(BED, [], [])
    upside_down = Plane(np.array([0.0, 0, 20]), np.array([1.0, 0, 0]), np.array([0, -1.0, 0]))
    with pytest.raises(PlanesError, match="nozzle plane 1 is tilted by 90° or more"):
        custom_planes(BED, flat, [Plane.horizontal(10.0), upside_down])
    # From its own origin it is above, from that of the plane below it is not.
    with pytest.raises(PlanesError, match=r"nozzle plane 0 is .* mm below"):
        custom_planes(BED, [BED], [tilted(10.0, 30.0, 100.0)])


def test_custom_planes_that_meet_within_the_parts_reach_are_refused():
    # 10 mm apart and 40° against one another they meet 10 / tan 40° = 11.9 mm from the lower one's origin.
    flat, nozzle = [BED, BED], [Plane.horizontal(10.0), tilted(20.0, 40.0)]
    assert len(custom_planes(BED, flat, nozzle)) == 2
    assert len(custom_planes(BED, flat, nozzle, reach=11.0)) == 2
    with pytest.raises(PlanesError, match=r"nozzle plane 1 meets .* 11\.9\d* mm from"):
        custom_planes(BED, flat, nozzle, reach=12.0)
    assert len(custom_planes(BED, flat, [Plane.horizontal(10.0), Plane.horizontal(20.0)], reach=1e5)) == 2
    with pytest.raises(PlanesError, match="reach"):
        custom_planes(BED, flat, nozzle, reach=-1.0)
