"""Regions, booleans and offsets: laws of sets and areas, and that reconstruction takes what comes out."""

import pickle
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from twins import (
    Curve,
    Layer,
    Plane,
    Toolpath,
    ToolpathError,
    layer_planes,
    reconstruct,
    signed_volume,
)
from twins.regions import booleans
from twins.regions.booleans import difference, intersection, union
from twins.regions.offsetting import offset
from twins.regions.outlines import oriented, outlines, regions_of, turned_round, walls
from twins.regions.touching import GAP, accepted, settled

T = 10.0
OPERATIONS = (union, difference, intersection)


def stack(*layers, thickness=T):
    """A toolpath of horizontal layers, each a list of curves."""
    return Toolpath(
        Plane.horizontal(),
        tuple(
            Layer(
                Plane.horizontal(thickness * (i + 0.5)), Plane.horizontal(thickness * (i + 1)), tuple(curves)
            )
            for i, curves in enumerate(layers)
        ),
        thickness,
    )


def box(x0, y0, x1, y1, width=None):
    corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
    return Curve(corners, width=None if width is None else [width] * 4)


def hole(x0, y0, x1, y1):
    return turned_round(box(x0, y0, x1, y1))


def ring(radius, center=(0.0, 0.0), points=60):
    angle = 2 * np.pi * np.arange(points) / points
    return Curve(np.asarray(center) + radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def area(toolpath):
    return sum(curve.signed_area for *_, curve in toolpath.curves())


def place_in(remark, what):
    return [float(value) for value in re.search(rf"{what} near \((.*), (.*)\)", remark).groups()]


def as_set(toolpath, layer=0):
    return shapely.union_all(regions_of(toolpath.layers[layer]))


def check_valid(curves):
    """Closed, of distinct points, simple, apart, and each hole inside its outer wall."""
    for curve in curves:
        assert curve.closed
        assert len(np.unique(curve.points, axis=0)) == len(curve.points) >= 3
        assert shapely.LinearRing(curve.points).is_simple
    polygons = regions_of(Layer(Plane.horizontal(), Plane.horizontal(), tuple(curves)))
    assert all(polygon.is_valid for polygon in polygons)
    assert sum(polygon.area for polygon in polygons) == pytest.approx(sum(c.signed_area for c in curves))
    outer = sum(curve.signed_area > 0 for curve in curves)
    assert len(polygons) == outer
    assert sum(len(polygon.interiors) for polygon in polygons) == len(curves) - outer


numbers = st.integers(-6, 6).map(lambda k: 10.0 * k) | st.floats(-60, 60)
sizes = st.integers(1, 5).map(lambda k: 10.0 * k) | st.floats(1.0, 50.0)


@st.composite
def primitives(draw):
    x, y, a, b = draw(numbers), draw(numbers), draw(sizes), draw(sizes)
    form = draw(st.sampled_from(["box", "disc", "frame", "turned"]))
    if form == "disc":
        return shapely.Point(x, y).buffer(a, quad_segs=draw(st.integers(1, 9)))
    shape = shapely.box(x - a, y - b, x + a, y + b)
    if form == "frame":
        return shape - shapely.box(x - a / 2, y - b / 2, x + a / 2, y + b / 2)
    return shapely.affinity.rotate(shape, draw(st.sampled_from([45.0, 30.0]))) if form == "turned" else shape


@st.composite
def outlined(draw):
    """Curves of a region made of one to three primitives, that keep apart."""
    made = draw(primitives())
    for _ in range(draw(st.integers(0, 2))):
        made = getattr(made, draw(st.sampled_from(["union", "difference", "symmetric_difference"])))(
            draw(primitives())
        )
    done = settled(made if made.area > 1.0 else shapely.box(0, 0, 20, 20), T, "part", "layer 0")
    return done.curves if done.curves and accepted(done.curves, T) else (box(0, 0, 20, 20),)


@st.composite
def pairs(draw):
    """Two toolpaths of one layer: of any kind, equal, nearly equal, nested or side by side."""
    a = draw(outlined())
    relation = draw(st.sampled_from(["any", "any", "equal", "shifted", "nested", "beside"]))
    if relation == "any":
        return stack(a), stack(draw(outlined()))
    b = tuple(Curve(curve.points) for curve in a)
    if relation == "shifted":
        by = draw(st.sampled_from([1e-12, 1e-9, 1e-6, 1e-4, 1e-2])) * np.array([1.0, draw(st.floats(-1, 1))])
        b = tuple(Curve(curve.points + by) for curve in a)
    if relation == "nested":
        b = settled(
            shapely.union_all(regions_of(stack(a).layers[0])).buffer(-draw(sizes) / 5), T, "part", ""
        ).curves
    if relation == "beside":
        x = max(curve.points[:, 0].max() for curve in a) - min(curve.points[:, 0].min() for curve in a)
        b = tuple(Curve(curve.points + [x, 0.0]) for curve in a)
    return stack(a), stack(b)


@settings(max_examples=60, deadline=None)
@given(pairs())
def test_booleans_obey_the_laws_of_sets(pair):
    a, b = pair
    A, B = as_set(a), as_set(b)
    size = area(a) + area(b)
    made = {operation.__name__: operation(a, b) for operation in OPERATIONS}
    wanted = {"union": A | B, "difference": A - B, "intersection": A & B}
    mended = dict.fromkeys(made, 0.0)
    for name, result in made.items():
        curves = result.toolpath.layers[0].curves
        check_valid(curves)
        mended[name] = sum(layer.mended for layer in result.layers)
        assert bool(result.remarks) or mended[name] == 0.0
        # What was done to keep curves apart reaches no further than a few gaps.
        off = as_set(result.toolpath) ^ wanted[name]
        assert off.area <= 1e-7 * size or result.remarks
        with np.errstate(all="ignore"):  # GEOS leaves flags of its own
            assert off.buffer(-3.0 * GAP * T).area == 0.0
        if curves:
            assert signed_volume(reconstruct(result.toolpath)) == pytest.approx(
                T * area(result.toolpath), rel=1e-6, abs=1e-3
            )
    areas = {name: area(result.toolpath) - mended[name] for name, result in made.items()}
    assert areas["union"] + areas["intersection"] == pytest.approx(size, rel=1e-6)
    assert areas["difference"] + areas["intersection"] == pytest.approx(area(a), rel=1e-6, abs=1e-6 * size)
    left = as_set(made["difference"].toolpath)
    assert (left & B).area <= 1e-7 * size + max(mended["difference"], 0.0)
    swapped = union(b, a)
    assert (as_set(swapped.toolpath) ^ as_set(made["union"].toolpath)).area <= 1e-6 * size + 2 * sum(
        abs(layer.mended) for layer in (*made["union"].layers, *swapped.layers)
    )


@pytest.mark.parametrize(
    "b",
    [
        [box(50, 50, 100, 100)],  # a corner in a corner
        [box(50, 0, 100, 50)],  # a whole edge
        [box(50, 20, 100, 90)],  # part of an edge
        [box(10, 10, 30, 30)],  # nested
        [box(0, 0, 50, 50)],  # equal
        [box(0, 0, 20, 20)],  # nested with shared edges
        [box(200, 0, 250, 50)],  # apart
        [Curve([[50.0, 25.0], [90.0, 0.0], [90.0, 50.0]])],  # a corner on an edge
        [box(50 + 1e-7, 0, 100, 50)],  # nearly touching
        [box(-20, -20, 70, 70), hole(0, 0, 50, 50)],  # a filled hole
    ],
)
def test_touching_shapes_unite_to_the_sum_of_their_areas_to_a_millionth(b):
    a, b = stack([box(0, 0, 50, 50)]), stack(b)
    size = area(a) + area(b)
    # Mended places included: joining at points costs less than the bar.
    assert area(union(a, b).toolpath) + area(intersection(a, b).toolpath) == pytest.approx(size, rel=1e-6)
    for operation in OPERATIONS:
        result = operation(a, b).toolpath
        if result.layers[0].curves:
            reconstruct(result)


def test_what_touches_in_a_point_is_joined_or_parted_and_reported():
    a, b = stack([box(0, 0, 50, 50)]), stack([box(50, 50, 100, 100)])
    joined = union(a, b)
    assert len(joined.toolpath.layers[0].curves) == 1
    assert "layer 0" in joined.remarks[0]
    assert place_in(joined.remarks[0], "joined") == pytest.approx([50.0, 50.0], abs=GAP * T)
    frame = stack([box(0, 0, 90, 90), hole(30, 30, 60, 60)])
    parted = difference(frame, stack([box(60, 60, 120, 120)]))
    assert len(parted.toolpath.layers[0].curves) == 1  # the hole opens to the outside
    assert place_in(parted.remarks[0], "parted") == pytest.approx([60.0, 60.0], abs=GAP * T)
    sliver = intersection(a, stack([box(50 - 1e-3, 0, 90, 50)]))
    assert sliver.toolpath.layers[0].curves == ()
    assert sliver.layers[0].mended == pytest.approx(-0.05)


@pytest.mark.parametrize("shift", [3.0, 0.3, 0.03, 0.005])
def test_crescents_lose_their_tips_and_little_else(shift):
    a, b = stack([ring(100.0, points=63)]), stack([ring(100.0, (shift, 0.01), 63)])
    result = difference(a, b)
    exact = (as_set(a) - as_set(b)).area
    assert area(result.toolpath) - exact == pytest.approx(
        sum(layer.mended for layer in result.layers), abs=1e-6
    )
    # What is thinner than the gap is no more than that times the way round.
    assert abs(area(result.toolpath) - exact) < 2.0 * GAP * T * 700.0
    if result.toolpath.layers[0].curves:
        reconstruct(result.toolpath)
    else:
        assert "thinner" in result.remarks[0]


def test_what_an_operation_leaves_alone_is_the_same_object():
    far, near = ring(20.0, (200.0, 0.0)), box(0, 0, 50, 50)
    rib = Curve([[0.0, 0.0], [9.0, 9.0]], closed=False)
    a = stack([rib, far, near], [far], [near, rib])
    b = stack([box(30, 10, 80, 40)], [], [])
    made = union(a, b).toolpath
    assert made.layers[1] is a.layers[1]
    assert made.layers[2] is a.layers[2]
    assert made.layers[0].curves[:2] == (rib, far)
    assert difference(a, b).toolpath.layers[1:] == a.layers[1:]
    assert union(a, stack([box(5, 5, 9, 9)])).toolpath is a
    assert difference(a, stack([box(-50, -50, -9, -9)])).toolpath is a
    kept = union(a, b, only=lambda i, mine, theirs: len(theirs.curves) > 1)
    assert kept.toolpath is a
    assert kept.layers == ()
    assert intersection(a, b).toolpath.layers[1].curves == ()


def test_layers_are_paired_by_their_planes():
    tall = stack([ring(50.0)], [ring(50.0)], [ring(50.0)], [ring(50.0)])
    plate = box(-80, -10, 80, 10)
    some = replace(tall, layers=tuple(replace(layer, curves=(plate,)) for layer in tall.layers[1:3]))
    made = union(tall, some).toolpath
    assert [layer is old for layer, old in zip(made.layers, tall.layers, strict=True)] == [
        True,
        False,
        False,
        True,
    ]
    assert (as_set(union(some, tall).toolpath, 1) ^ as_set(made, 1)).area < 1e-6
    assert [len(layer.curves) for layer in difference(some, tall).toolpath.layers] == [2, 2]
    # The frame may lie otherwise in the same planes.
    x, y = np.array([0.6, 0.8, 0.0]), np.array([-0.8, 0.6, 0.0])

    def turned(plane):
        return Plane(plane.origin + [7.0, -3.0, 0.0], x, y)

    def carried(layer):
        points = turned(layer.nozzle).to_frame(layer.nozzle.to_world(plate.points))[:, :2]
        return Layer(turned(layer.slicing), turned(layer.nozzle), (Curve(points),))

    other = replace(some, layers=tuple(map(carried, some.layers)))
    assert (as_set(union(tall, other).toolpath, 2) ^ as_set(made, 2)).area < 1e-6
    with pytest.raises(ToolpathError, match=r"layer 0 of the second toolpath .* 2 mm off"):
        union(tall, stack([plate], thickness=8.0))
    with pytest.raises(ToolpathError, match="layer 1 of the first toolpath"):
        union(replace(tall, layers=(tall.layers[0], stack([plate], thickness=8.0).layers[0])), tall)
    fan = layer_planes(Plane.horizontal(), Plane([0, 0, 40], [0.96, 0, 0.28], [0, 1, 0]), T)
    rotary = Toolpath(
        fan.base,
        tuple(Layer(s, n, (ring(50.0),)) for s, n in zip(fan.slicing, fan.nozzle, strict=True)),
        fan.thickness,
    )
    with pytest.raises(ToolpathError, match=r"layer 0 of the .* toolpath"):
        union(tall, rotary)
    plates = replace(rotary, layers=tuple(replace(layer, curves=(plate,)) for layer in rotary.layers))
    assert len(union(rotary, plates).layers) == len(fan)


def test_bad_input_is_refused_with_its_layer():
    good = stack([box(0, 0, 50, 50)], [box(0, 0, 50, 50)])
    bad = stack([box(0, 0, 50, 50)], [hole(10, 0, 60, 50)])
    with pytest.raises(
        ToolpathError, match="layer 1 of the second toolpath: curves cross or enclose nothing"
    ):
        union(good, bad)
    for resolution in (0.0, float("nan")):
        with pytest.raises(ToolpathError, match="resolution"):
            union(good, good, resolution=resolution)


def test_widths_are_carried_along_curves_that_have_them():
    a, b = box(0, 0, 50, 50, 12.0), box(30, 10, 80, 40, 20.0)
    made = union(stack([a]), stack([b])).toolpath.layers[0].curves[0]
    right = made.points[:, 0] > 51
    assert made.width == pytest.approx(np.where(right, 20.0, 12.0))
    taper = replace(a, width=np.array([10.0, 10.0, 20.0, 20.0]))
    cut = difference(stack([taper]), stack([box(-10, 25, 60, 60, 7.0)])).toolpath.layers[0].curves[0]
    assert cut.width[cut.points[:, 1] == 25.0] == pytest.approx(15.0)
    assert union(stack([a]), stack([b])).remarks == ()
    assert made.points[0].tolist() == a.points[0].tolist()  # the seam stays


def with_sine(curve):
    return replace(curve, width=20.0 + 4.0 * np.sin(np.arange(len(curve.points))))


@pytest.mark.parametrize("operation", OPERATIONS)
@pytest.mark.parametrize("width", [None, 15.0])
def test_widths_survive_where_curves_without_any_are_met(operation, width):
    wall = with_sine(ring(200.0, points=90))
    plate = ring(60.0, (200.0, 1.0))
    own = {point.tobytes(): value for point, value in zip(wall.points, wall.width, strict=True)}
    result = operation(stack([wall]), stack([plate]), width=width)
    (made,) = result.toolpath.layers[0].curves
    kept = np.array([point.tobytes() in own for point in made.points])
    assert 5 < kept.sum() < len(kept)
    assert (made.width[kept] == [own[point.tobytes()] for point in made.points[kept]]).all()
    on_wall = shapely.distance(shapely.points(made.points), shapely.LinearRing(wall.points)) < 1e-6
    assert 1 <= (on_wall & ~kept).sum() <= 2  # where the two cross
    if width is None:
        low, high = made.width[on_wall].min(), made.width[on_wall].max()
        assert (made.width >= low).all()
        assert (made.width <= high).all()
        assert "without bead widths" in result.remarks[0]
        # Linear along the curve: between the two crossings it changes at one rate.
        start = int(np.flatnonzero(on_wall & ~np.roll(on_wall, -1))[0])
        here = np.roll(np.arange(len(kept)), -start)
        count = int(np.flatnonzero(on_wall[here][1:])[0]) + 2
        way = np.hypot(*np.diff(made.points[here[:count]], axis=0).T)
        rates = np.diff(made.width[here[:count]]) / way
        assert rates == pytest.approx(np.full(len(rates), rates.mean()), abs=1e-9)
    else:
        assert (made.width[~on_wall] == width).all()
        assert result.remarks == ()
    bare = operation(stack([replace(wall, width=None)]), stack([plate]), width=width)
    assert bare.toolpath.layers[0].curves[0].width is None
    with pytest.raises(ToolpathError, match="bead width"):
        operation(stack([wall]), stack([plate]), width=0.0)


@pytest.mark.parametrize("side", ["region", "both", "left", "right"])
def test_an_offset_takes_the_width_beside(side):
    wall = with_sine(ring(200.0, points=90))
    result = offset(stack([wall, ring(10.0, (500.0, 0.0))]), 5.0, side)
    for curve in result.toolpath.layers[0].curves:
        if curve.points[:, 0].max() > 400.0:
            assert curve.width is None
            continue
        # Interpolated at the same angle: 5 mm beside a chord of 14 mm that is less than a degree off.
        there = np.arctan2(*curve.points.T[::-1]) % (2 * np.pi) / (2 * np.pi) * 90
        expected = np.interp(there, np.arange(91), np.append(wall.width, wall.width[0]))
        assert curve.width == pytest.approx(expected, abs=0.15)
    assert result.remarks == ()


def test_open_curves_are_cut_but_enclose_nothing():
    rib = Curve([[-20.0, 25.0], [120.0, 25.0]], closed=False, width=[10.0, 17.0])
    a, b = stack([rib]), stack([box(0, 0, 50, 50)])
    outside = difference(a, b).toolpath.layers[0].curves
    assert [c.points.tolist() for c in outside] == [[[-20, 25], [0, 25]], [[50, 25], [120, 25]]]
    assert outside[0].width == pytest.approx([10.0, 11.0])
    for inside in (intersection(a, b), intersection(b, a)):
        (part,) = inside.toolpath.layers[0].curves
        assert part.points.tolist() == [[0, 25], [50, 25]]
        assert not part.closed
    assert len(union(a, b).toolpath.layers[0].curves) == 2
    # One that both have comes once, whichever way it runs.
    both, again = stack([rib, b.layers[0].curves[0]]), stack([turned_round(rib), b.layers[0].curves[0]])
    for other in (both, again):
        assert len(intersection(both, other).toolpath.layers[0].curves) == 2
        assert union(both, other).toolpath is both


def test_an_executor_changes_nothing():
    a = stack(*([ring(50.0 + i), ring(10.0, (200.0, 0.0))] for i in range(4)))
    b = stack(*([box(-80, -10, 80, 10 + i)] for i in range(3)))
    assert pickle.loads(pickle.dumps(booleans._of_layer)) is booleans._of_layer
    shares = []
    union(a, b, progress=shares.append)
    assert len(shares) == len(a.layers)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    with ThreadPoolExecutor(2) as executor:
        for make in (lambda e: union(a, b, executor=e), lambda e: offset(a, 5.0, executor=e)):
            for alone, shared in zip(
                make(None).toolpath.curves(), make(executor).toolpath.curves(), strict=True
            ):
                assert np.array_equal(alone[3].points, shared[3].points)


def test_regions_and_walls_belong_together():
    curves = (
        box(0, 0, 90, 90),
        hole(10, 10, 80, 80),
        box(20, 20, 70, 70),
        hole(30, 30, 60, 60),
        box(200, 0, 210, 9),
    )
    assert walls(curves, "") == [(0, (1,)), (2, (3,)), (4, ())]
    layer = stack(curves).layers[0]
    found = regions_of(layer)
    assert len(found) == 3
    for polygon in found:
        assert polygon.exterior.is_ccw
        assert not any(ring.is_ccw for ring in polygon.interiors)
    assert outlines(shapely.union_all(found), curves) == curves
    shuffled = stack([turned_round(c) if k % 3 else c for k, c in enumerate(curves)])
    assert [c.signed_area for c in oriented(shuffled).layers[0].curves] == [c.signed_area for c in curves]
    assert oriented(stack(curves)).layers[0].curves == curves


@settings(max_examples=30, deadline=None)
@given(outlined(), sizes, st.sampled_from(["round", "mitre"]))
def test_an_offset_region_grows_by_the_distance_and_no_more(curves, distance, corners):
    toolpath = stack(curves)
    before = as_set(toolpath)
    grown, shrunk = (offset(toolpath, d, corners=corners) for d in (distance, -distance))
    for result, sign in ((grown, 1.0), (shrunk, -1.0)):
        made = result.toolpath.layers[0].curves
        check_valid(made)
        assert sign * (area(result.toolpath) - before.area) >= 0
        assert result.layers[0].areas == pytest.approx((before.area, area(result.toolpath)))
        if made and not result.remarks and corners == "round":
            points = shapely.points(np.concatenate([curve.points for curve in made]))
            # Within the sagitta of an arc's chords, and notches of 1 % of the distance.
            assert shapely.distance(points, before.boundary) == pytest.approx(distance, rel=1.2e-2)
        if made:
            reconstruct(result.toolpath)
        else:
            assert "nothing of it is left" in result.remarks[-1]


@settings(max_examples=30, deadline=None)
@given(outlined(), st.floats(0.5, 15.0), st.sampled_from(["left", "right"]))
def test_parallels_keep_their_side_distance_and_direction(curves, distance, side):
    for curve in curves:
        inside = shapely.Polygon(curve.points)
        for made in offset(stack([curve]), distance, side).toolpath.layers[0].curves:
            points = shapely.points(made.points)
            assert shapely.distance(points, inside.boundary) == pytest.approx(distance, rel=1.2e-2)
            interior = shapely.contains(inside, points)
            inwards = (curve.signed_area > 0) == (side == "left")
            assert interior.all() if inwards else not interior.any()
            # A pocket that the outer side encloses runs the other way, as a hole does.
            pocket = not inwards and shapely.Polygon(made.points).disjoint(inside)
            assert (made.signed_area * curve.signed_area > 0) != pocket


def test_offsets_of_lines():
    line = Curve([[0.0, 0.0], [100.0, 0.0], [100.0, 80.0]], closed=False)
    for corners in ("round", "mitre"):
        (left,) = offset(stack([line]), 8.0, "left", corners).toolpath.layers[0].curves
        assert left.points.tolist() == [[0, 8], [92, 8], [92, 80]]
        assert not left.closed
        (right,) = offset(stack([line]), 8.0, "right", corners).toolpath.layers[0].curves
        assert right.points[0].tolist() == [0, -8]
        assert right.points[-1].tolist() == [108, 80]
        (wall,) = offset(stack([line]), 8.0, "both", corners).toolpath.layers[0].curves
        assert wall.signed_area > 16.0 * 180 - 64
    assert (
        offset(stack([line]), 8.0, "both", "mitre").toolpath.layers[0].curves[0].signed_area == 16.0 * 180.0
    )
    made = offset(stack([line, box(0, 20, 50, 70)]), 5.0, "region").toolpath.layers[0].curves
    assert made[0] is line
    assert len(made) == 2
    # Open curves keep their places, and a layer of nothing else is left alone.
    far = Curve(line.points + 300.0, closed=False)
    made = offset(stack([line, box(0, 20, 50, 70), far, ring(9.0, (-90.0, 0.0))]), 5.0).toolpath.layers[0]
    assert [curve.closed for curve in made.curves] == [False, True, True, False]
    alone = offset(stack([line]), 5.0)
    assert alone.toolpath.layers[0].curves == (line,)
    assert alone.remarks == ()
    tube = offset(stack([ring(50.0)]), 10.0, "both").toolpath.layers[0].curves
    assert sum(c.signed_area for c in tube) == pytest.approx(np.pi * (60**2 - 40**2), rel=5e-3)
    assert offset(stack([ring(5.0)], []), 10.0, "left").layers[0].lost == (0,)
    for bad in ({"distance": 0.0}, {"distance": float("nan")}, {"distance": -1.0, "side": "both"},
                {"distance": 1.0, "side": "up"}, {"distance": 1.0, "corners": "sharp"}):  # fmt: skip
        with pytest.raises(ToolpathError, match="offset"):
            offset(stack([line]), **bad)
    eight = Curve([[0.0, 0.0], [50.0, 50.0], [50.0, 0.0], [0.0, 50.0]])
    with pytest.raises(ToolpathError, match="layer 0, curve 0 crosses"):
        offset(stack([eight]), 2.0, "left")
