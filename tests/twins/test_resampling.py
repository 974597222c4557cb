"""Resampling and protected zones: equal parts of the same curve; zones by their definition."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import sphere

from twins import Curve, Layer, Plane, SurfaceError, Toolpath, ToolpathError, layer_planes
from twins.curves.resampling import resample
from twins.curves.zones import Zones


def flat(*curves, count=1):
    layers = tuple(
        Layer(Plane.horizontal(10.0 * i + 5.0), Plane.horizontal(10.0 * i + 10.0), curves)
        for i in range(count)
    )
    return Toolpath(Plane.horizontal(), layers, 10.0)


def only(toolpath):
    ((*_, curve),) = toolpath.curves()
    return curve


def star(seed, closed=True):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(5, 40))
    angle = 2 * np.pi * np.arange(count) / count * (1.0 if closed else 0.9)
    return np.column_stack([np.cos(angle), np.sin(angle)]) * rng.uniform(60, 100, (count, 1))


def places_on(old, new):
    """Distance along an old curve of each point of a new one, and how far it lies beside it."""
    points = np.vstack([old.points, old.points[:1]]) if old.closed else old.points
    line = shapely.LineString(points)
    new = shapely.points(new.points)
    return shapely.line_locate_point(line, new), shapely.distance(line, new)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.5, 40.0), st.booleans())
def test_parts_are_equal_along_the_curve_and_no_longer_than_asked(seed, length, closed):
    old = Curve(star(seed, closed), closed)
    new = only(resample(flat(old), length))
    along, beside = places_on(old, new)
    assert beside.max() < 1e-9
    along = np.append(along, old.length) if closed else along
    parts = np.diff(along)
    assert np.ptp(parts) < 1e-6
    assert parts.max() <= length * (1 + 1e-9)
    assert len(parts) == max(6 if closed else 1, int(np.ceil(old.length / length - 1e-9))) or length < 10
    assert np.array_equal(new.points[0], old.points[0])
    if not closed:
        assert np.array_equal(new.points[-1], old.points[-1])


def test_equal_parts_stay_the_same_objects():
    square = Curve(np.array([[0, 0], [100, 0], [100, 70], [0, 70.0]]))
    once = resample(flat(square), 3.0, corner_deg=30.0)
    again = resample(once, 3.0, corner_deg=30.0)
    assert again.layers[0] is once.layers[0]


def test_corners_stay():
    square = Curve(np.array([[0, 0], [100, 0], [100, 70], [0, 70.0]]))
    kept = only(resample(flat(square), 15.0, corner_deg=45.0)).points
    assert {tuple(p) for p in square.points} <= {tuple(p) for p in kept}
    assert shapely.Polygon(kept).area == pytest.approx(7000.0)
    cut = only(resample(flat(square), 15.0)).points
    assert shapely.Polygon(cut).area < 7000.0


@pytest.mark.parametrize("closed", [True, False])
def test_widths_are_linear_along_the_curve(closed):
    points = star(4, closed)
    old = Curve(points, closed, width=10.0 + 0.01 * points[:, 0])
    for corner in (None, 20.0):
        new = only(resample(flat(old), 2.5, corner_deg=corner))
        assert np.allclose(new.width, 10.0 + 0.01 * new.points[:, 0])


def test_protected_segments_stay_and_the_rest_is_divided():
    old = Curve(star(7))
    zone = shapely.box(0, -200, 200, 200)
    zones = Zones(polygons=[zone])
    flags = zones.protected(flat(old))[0][0]
    new = only(resample(flat(old), 1.0, locked=zones)).points
    assert {tuple(p) for p in old.points[flags]} <= {tuple(p) for p in new}
    assert {tuple(p) for p in old.points[flags]} >= {tuple(p) for p in new if p[0] >= 0}
    assert len(new) > 100


def test_walls_that_coarse_chords_would_cross_are_divided_finer():
    outer = star(11)
    inner = np.array(shapely.Polygon(outer).buffer(-0.5).exterior.coords[:-1])[::-1]
    walls = flat(Curve(outer), Curve(inner))
    curves = resample(walls, 20.0).layers[0].curves
    lines = [shapely.LinearRing(c.points) for c in curves]
    assert not shapely.intersects(*lines)


def test_layers_side_by_side_give_the_same():
    toolpath = flat(Curve(star(1)), Curve(star(2) + 300.0), count=4)
    with ThreadPoolExecutor(2) as pool:
        shares = []
        together = resample(toolpath, 4.0, progress=shares.append, executor=pool)
        assert shares == sorted(shares)
        assert shares[-1] == 1.0
    for (*_, a), (*_, b) in zip(resample(toolpath, 4.0).curves(), together.curves(), strict=True):
        assert np.array_equal(a.points, b.points)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"length": 0.0}, "above 0"),
        ({"length": np.nan}, "above 0"),
        ({"length": 1e-7}, "layer 0, curve 0"),
        ({"corner_deg": 180.0}, "corner"),
    ],
)
def test_arguments_out_of_range(changes, message):
    with pytest.raises(ToolpathError, match=message):
        resample(flat(Curve(star(1))), **({"length": 5.0} | changes))


def test_a_solid_protects_where_slicing_planes_cut_it():
    ball = sphere(60.0, 4)
    toolpath = flat(Curve(star(3)[:, ::-1][::-1]), count=14)
    for layer, region in zip(toolpath.layers, Zones(solids=[ball]).regions(toolpath), strict=True):
        square = 60.0**2 - (layer.slicing.origin[2] - 60.0) ** 2
        assert region.area == pytest.approx(np.pi * max(square, 0.0), rel=0.02)


def test_a_solid_is_cut_by_planes_that_turn():
    planes = layer_planes(
        Plane.horizontal(),
        Plane(np.array([0, 0, 100.0]), np.array([1, 0, -0.3]), np.array([0, 1.0, 0])),
        10.0,
    )
    layers = tuple(Layer(s, n) for s, n in zip(planes.slicing, planes.nozzle, strict=True))
    toolpath = Toolpath(planes.base, layers, planes.thickness)
    post = trimesh.creation.box(bounds=[[-5, -5, -50], [5, 5, 200]])
    for layer, region in zip(layers, Zones(solids=[post]).regions(toolpath), strict=True):
        assert region.area == pytest.approx(100.0 / layer.slicing.normal[2])


def test_a_hollow_solid_protects_its_walls_only():
    hollow = trimesh.boolean.difference(
        [trimesh.creation.box((60, 60, 60)), trimesh.creation.box((40, 40, 70))], engine="manifold"
    )
    assert Zones(solids=[hollow]).regions(flat())[0].area == pytest.approx(60**2 - 40**2)


def test_points_are_protected_with_both_ends_of_segments_that_a_zone_touches():
    line = Curve(np.column_stack([np.arange(10.0), np.zeros(10)]), closed=False)
    flags = Zones(polygons=[[[3.4, -1], [3.6, -1], [3.6, 1], [3.4, 1]]]).protected(flat(line))[0][0]
    assert np.flatnonzero(flags).tolist() == [3, 4]
    away = Zones(polygons=[[[3.4, 1], [3.6, 1], [3.6, 2], [3.4, 2]]]).protected(flat(line))[0][0]
    assert not away.any()


def test_locks_name_layers_and_curves():
    toolpath = flat(Curve(star(1)), Curve(star(2) + 300.0), count=3)
    flags = Zones(layers=[0], curves=[(2, 1)]).protected(toolpath)
    assert [[f.all() for f in layer] for layer in flags] == [[True, True], [False, False], [False, True]]
    assert not any(f.any() for f in Zones().protected(toolpath)[1])


def test_zones_that_cannot_be():
    with pytest.raises(ToolpathError, match="polygon 1 is no simple polygon"):
        Zones(polygons=[[[0, 0], [1, 0], [0, 1]], [[0, 0], [1, 1], [1, 0], [0, 1]]])
    with pytest.raises(ToolpathError, match="corners"):
        Zones(polygons=[[[0, 0], [1, 0]]])
    box = trimesh.creation.box((1, 1, 1))
    opened = trimesh.Trimesh(box.vertices, box.faces[:-1], process=False)
    with pytest.raises(SurfaceError):
        Zones(solids=[opened])
    with pytest.raises(ToolpathError, match="layer 5"):
        Zones(layers=[5]).protected(flat(Curve(star(1))))
    with pytest.raises(ToolpathError, match="curve 2 of layer 0"):
        Zones(curves=[(0, 2)]).protected(flat(Curve(star(1))))


@pytest.mark.parametrize(
    ("zones", "message"),
    [
        ({"polygons": [[[0, 0], [1, 0], [0, 1]], [[0, 0], [1]]]}, "protected polygon 1 .*same length"),
        ({"polygons": ["left"]}, "protected polygon 0 .*numbers"),
        ({"polygons": [[[0, 0], [1, "a"], [0, 1]]]}, "protected polygon 0 .*numbers"),
        ({"polygons": [[0, 0], [1, 0], [0, 1]]}, "protected polygon 0 .*give a list of polygons"),
        ({"polygons": [shapely.Point(0, 0)]}, "protected polygon 0 must be a Polygon"),
        ({"polygons": 5}, "polygons must be a list"),
        ({"layers": 5}, "layers must be a list"),
        ({"layers": [0.5]}, "layers must be a list"),
        ({"curves": [3]}, "pairs"),
    ],
)
def test_zones_that_are_no_zones_are_refused_in_words(zones, message):
    with pytest.raises(ToolpathError, match=message):
        Zones(**zones)


def test_a_single_zone_needs_no_list():
    box, ball = shapely.box(0, 0, 5, 5), trimesh.creation.icosphere(radius=20.0)
    for one, listed in (
        (Zones(polygons=box), Zones(polygons=[box])),
        (Zones(solids=ball), Zones(solids=[ball])),
    ):
        (a,), (b,) = one.regions(flat()), listed.regions(flat())
        assert a.area > 0
        assert a.equals(b)


def test_zones_that_hold_nothing_are_named():
    toolpath = flat(Curve(star(1)), count=2)
    inside, beside = shapely.box(-500, -500, 500, 500), shapely.box(800, 0, 900, 90)
    big, above = (trimesh.creation.box((900, 900, 100)) for _ in range(2))
    above.apply_translation([0, 0, 500])
    zones = Zones(
        polygons=[inside, beside], solids=[big, above, trimesh.creation.box((1, 1, 99))], layers=[1]
    )
    idle = zones.idle(toolpath)
    assert [text.split(" touches")[0] for text in idle] == [
        "protected polygon 1",
        "protected solid 1",
        "protected solid 2",
    ]
    assert "(800, 0) to (900, 90)" in idle[0]
    assert "(-450, -450, 450) to (450, 450, 550)" in idle[1]
    assert Zones().idle(toolpath) == Zones(polygons=inside, layers=[0]).idle(toolpath) == []
    assert Zones(layers=[0], polygons=inside).idle(flat()) == [
        Zones(polygons=inside).idle(flat())[0],
        "locked layer 0 has no curves",
    ]
