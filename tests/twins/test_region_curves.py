"""Curves of regions joined into one, and toolpaths cleaned."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import SHAPES, manifold_faults

from twins import (
    Curve,
    Layer,
    Plane,
    Toolpath,
    ToolpathError,
    extrude,
    layer_planes,
    reconstruct,
    slice_surface,
)
from twins.regions import linked_layers
from twins.regions.cleaning import clean, loops_of
from twins.regions.merge_regions import merge_regions
from twins.regions.outlines import turned_round
from twins.regions.simplify_regions import simplify_regions

T = 10.0
W = 10.0


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


def ring(radius, center=(0.0, 0.0), points=60, width=None):
    angle = 2 * np.pi * np.arange(points) / points
    circle = np.asarray(center) + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return Curve(circle, width=None if width is None else np.full(points, width))


def hole(radius, center=(0.0, 0.0), points=30, width=None):
    return turned_round(ring(radius, center, points, width))


def box(x0, y0, x1, y1):
    return Curve([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def polygon(toolpath, layer=0):
    """What the layer's curves enclose: even-odd, by shapely alone."""
    rings = [shapely.Polygon(curve.points) for curve in toolpath.layers[layer].curves]
    region = shapely.Polygon()
    for part in sorted(rings, key=lambda part: -part.area):
        region = region ^ part
    return region


PLATE = [ring(100.0), hole(15.0, (40.0, 0.0)), hole(15.0, (-40.0, 10.0)), hole(12.0, (0.0, 50.0))]
ISLANDS = [ring(30.0), ring(20.0, (80.0, 0.0)), ring(20.0, (20.0, 90.0))]


def beads(toolpath, width=W):
    lines = [
        shapely.LineString(np.vstack([curve.points, curve.points[:1]])) for curve in toolpath.layers[0].curves
    ]
    return shapely.union_all([line.buffer(width / 2, quad_segs=12) for line in lines])


@pytest.mark.parametrize("order", ["inner first", "nearest"])
def test_walls_become_one_curve_without_the_strips_between_its_links(order):
    before = stack(PLATE)
    result = simplify_regions(before, W, order=order)
    (curve,) = result.toolpath.layers[0].curves
    figure = result.layers[0]
    assert shapely.LinearRing(curve.points).is_simple
    assert figure.curves == (4, 1)
    assert result.remarks == ()
    # The strips leave the region, W wide; their ends follow the curves by less than the sagitta of a small hole.
    lengths = np.hypot(*(figure.links[:, 1] - figure.links[:, 0]).T)
    assert figure.areas[0] - figure.areas[1] == pytest.approx(W * lengths.sum(), rel=0.05)
    assert curve.signed_area == figure.areas[1]
    off = polygon(before) - shapely.Polygon(curve.points)
    assert (shapely.Polygon(curve.points) - polygon(before)).area < 1e-6
    assert off.area == pytest.approx(figure.areas[0] - figure.areas[1])
    # Each link is as long as the way between the curves that it joins.
    assert lengths.max() < 40.0
    # Nothing is left bare but the corners that two round beads leave at the outside of a link.
    bare = (beads(before) - beads(result.toolpath)).area
    assert figure.uncovered == pytest.approx(bare, abs=0.01 * W**2)
    assert bare <= 2 * len(figure.links) * (1.0 - np.pi / 4) * W**2
    assert manifold_faults(reconstruct(result.toolpath)) == (0, 0)


def test_inner_walls_come_first_or_the_nearest_do():
    # Two holes near the outer wall and far from one another.
    curves = [box(0, 0, 300, 60), turned_round(box(20, 20, 40, 40)), turned_round(box(260, 20, 280, 40))]

    def longest(**how):
        made = simplify_regions(stack(curves), W, **how)
        lengths = [np.hypot(*(b - a)) for a, b in made.layers[0].links] if made.layers else []
        return sorted(round(length) for length in lengths), made

    assert longest()[0] == [20, 220]
    assert longest(order="nearest")[0] == [20, 20]
    lengths, made = longest(reach=50.0)
    assert lengths == [20, 20]  # beyond reach the inner walls are not joined to one another
    lengths, made = longest(reach=15.0)
    assert lengths == []
    assert "curves 0, 1, 2 stay apart: no link of at most 15 mm" in made.remarks[0]
    assert made.toolpath.layers[0].curves == tuple(curves)


def test_separate_regions_become_one_with_bridges_between():
    before = stack(ISLANDS)
    result = merge_regions(before, W)
    (curve,) = result.toolpath.layers[0].curves
    assert shapely.LinearRing(curve.points).is_simple
    assert (polygon(before) - shapely.Polygon(curve.points)).area < 1e-6
    lengths = np.hypot(*(result.layers[0].links[:, 1] - result.layers[0].links[:, 0]).T)
    assert sorted(lengths) == pytest.approx([30.0, np.hypot(20.0, 90.0) - 50.0], abs=0.5)
    assert curve.signed_area - before.layers[0].curves[0].signed_area > 0
    assert manifold_faults(reconstruct(result.toolpath)) == (0, 0)
    assert len(merge_regions(before, W, reach=35.0).toolpath.layers[0].curves) == 2


def test_a_wall_in_between_is_not_linked_across():
    nested = [ring(100.0), hole(70.0, points=60), ring(40.0)]
    result = merge_regions(stack(nested), W)
    assert result.toolpath.layers[0].curves == tuple(nested)
    assert "curves 0, 2 stay apart" in result.remarks[0]
    simple = simplify_regions(stack(nested), W).toolpath
    assert len(simple.layers[0].curves) == 2
    assert len(merge_regions(simple, W).toolpath.layers[0].curves) == 1


@pytest.mark.parametrize(("join", "curves"), [(simplify_regions, PLATE), (merge_regions, ISLANDS)])
def test_crossings_cover_the_same_and_cross_once_a_link(join, curves):
    before = stack(curves)
    result = join(before, W, "crossing")
    (curve,) = result.toolpath.layers[0].curves
    noded = shapely.node(shapely.LinearRing(curve.points))
    # Each crossing ends four pieces, and the ring's beginning two.
    assert len(shapely.get_parts(noded)) == 2 * len(result.layers[0].links) + 1
    assert np.isnan(result.layers[0].areas[1])
    assert result.layers[0].uncovered < 0.01 * result.layers[0].covered[0]
    assert manifold_faults(extrude(result.toolpath, W)) == (0, 0)


@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, 3), st.integers(0, 3), st.floats(6.0, 22.0), st.floats(0, 7), st.floats(0, 7)),
        min_size=1, max_size=6, unique_by=lambda cell: cell[:2],
    ),
    st.floats(2.0, 9.0),
)  # fmt: skip
def test_any_plate_with_holes_is_simplified(cells, width):
    curves = [box(0, 0, 240, 240)]
    curves += [hole(r, (30 + 60 * i + x - 3.5, 30 + 60 * j + y - 3.5)) for i, j, r, x, y in cells]
    before = stack(curves)
    result = simplify_regions(before, width)
    (curve,) = result.toolpath.layers[0].curves
    assert shapely.LinearRing(curve.points).is_simple
    after = shapely.Polygon(curve.points)
    # Points within a thousandth of the width of a cut go.
    assert (after - polygon(before)).area < 1e-3 * width**2 * len(cells)
    links = sum(np.hypot(*(b - a)) for a, b in result.layers[0].links)
    # A strip is W wide and ends on the curves, at most half a width deeper than its middle line.
    assert (polygon(before) - after).area <= width * links + len(cells) * 2 * 0.5 * width**2
    assert result.layers[0].uncovered <= 2 * len(cells) * (1.0 - np.pi / 4) * width**2 + 1e-6


def test_widths_and_seams_are_carried_and_links_aligned():
    outer, inner = ring(60.0, width=12.0), hole(40.0, points=60)
    joined = simplify_regions(stack([outer, inner]), W, near=(0.0, -100.0)).toolpath.layers[0].curves[0]
    assert set(joined.width) == {12.0, W}
    radius = np.hypot(*joined.points.T)
    assert (joined.width[radius > 50] == 12.0).all()
    assert joined.points[0].tolist() == outer.points[0].tolist()
    links = [
        simplify_regions(stack([ring(60.0), inner]), W, near=(x, y)).layers[0].links[0]
        for x, y in [(0, -99), (99, 0)]
    ]
    assert links[0] == pytest.approx(np.array([[0, -60], [0, -40]]), abs=1.0)
    assert links[1] == pytest.approx(np.array([[60, 0], [40, 0]]), abs=1.0)


def test_layers_without_holes_are_the_same_objects_and_an_executor_changes_nothing():
    toolpath = stack([ring(60.0)], [ring(60.0), hole(40.0)], [ring(9.0, (200.0, 0.0)), *PLATE])
    assert pickle.loads(pickle.dumps(linked_layers._of_layer)) is linked_layers._of_layer
    alone = simplify_regions(toolpath, W).toolpath
    assert alone.layers[0] is toolpath.layers[0]
    assert alone.layers[2].curves[0] is toolpath.layers[2].curves[0]
    with ThreadPoolExecutor(2) as executor:
        shared = simplify_regions(toolpath, W, executor=executor).toolpath
    for mine, theirs in zip(alone.curves(), shared.curves(), strict=True):
        assert np.array_equal(mine[3].points, theirs[3].points)
    assert simplify_regions(stack([ring(60.0)], []), W).toolpath.layers[1].curves == ()


def test_a_sliced_part_becomes_one_curve_a_region():
    surface = SHAPES["porous column"]()
    toolpath = slice_surface(surface, layer_planes(Plane.horizontal(), 410.0, 20.0))
    simple = simplify_regions(toolpath, W)
    assert simple.remarks == ()
    merged = merge_regions(simple.toolpath, W)
    assert merged.remarks == ()
    assert all(len(layer.curves) == 1 for layer in merged.toolpath.layers)
    for figure in (*simple.layers, *merged.layers):
        assert figure.uncovered <= 0.01 * figure.covered[0]
    assert manifold_faults(reconstruct(merged.toolpath)) == (0, 0)


def test_joining_refuses_bad_input():
    crossing = stack([ring(60.0), ring(60.0, (40.0, 0.0))])
    for join in (simplify_regions, merge_regions):
        with pytest.raises(ToolpathError, match="layer 0: curves cross"):
            join(crossing, W)
        for width in (0.0, float("nan"), float("inf")):
            with pytest.raises(ToolpathError, match="width"):
                join(stack(PLATE), width)
        with pytest.raises(ToolpathError, match="'u-turn' or a 'crossing'"):
            join(stack(PLATE), W, "bridge")
        with pytest.raises(ToolpathError, match="reach"):
            join(stack(PLATE), W, reach=float("nan"))
        for near in ((1, 2, 3), (1, float("nan")), "here"):
            with pytest.raises(ToolpathError, match="place that links should be near"):
                join(stack(PLATE), W, near=near)
    with pytest.raises(ToolpathError, match="order"):
        simplify_regions(stack(PLATE), W, order="random")


def test_short_and_double_curves_are_removed():
    disc = ring(50.0)
    again = Curve(np.roll(disc.points, 17, axis=0))
    line = Curve([[0.0, 0.0], [90.0, 0.0]], closed=False)
    curves = [disc, ring(1.0), again, turned_round(again), line, turned_round(line), hole(30.0)]
    result = clean(stack(curves, [disc]))
    assert result.toolpath.layers[0].curves == (disc, line, curves[6])
    assert [(f.curve, f.fault, f.done) for f in result.found if f.fault != "crosses another"] == [
        (1, "short", "removed"),
        (2, "double", "removed"),
        (3, "double", "removed"),
        (5, "double", "removed"),
    ]
    assert result.lengths[0] - result.lengths[1] == pytest.approx(
        ring(1.0).length + 2 * disc.length + line.length
    )
    assert [(f.curve, f.done) for f in result.found if f.fault == "crosses another"] == [
        (4, "kept"),
        (6, "kept"),
    ]
    assert clean(stack([disc], [hole(30.0)])).toolpath.layers[1].curves[0].signed_area < 0


def test_a_clean_toolpath_stays_the_same_object():
    toolpath = stack(PLATE, ISLANDS, [Curve([[0.0, 0.0], [90.0, 5.0]], closed=False)], [])
    result = clean(toolpath)
    assert result.toolpath is toolpath
    assert result.found == ()


def test_repeated_points_go_and_widths_stay_with_their_points():
    disc = ring(50.0, width=12.0)
    doubled = Curve(np.repeat(disc.points, 2, axis=0), width=np.repeat(disc.width, 2))
    result = clean(stack([doubled]))
    (curve,) = result.toolpath.layers[0].curves
    assert np.array_equal(curve.points, disc.points)
    assert np.array_equal(curve.width, disc.width)
    assert [f.fault for f in result.found] == ["repeated points"]


def test_small_loops_and_spikes_are_cut_off_and_what_is_ambiguous_is_kept():
    square = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]])
    knot = np.array([[50.0, 0.0], [52.0, 4.0], [48.0, 4.0], [50.5, -1e-9]])
    looped = Curve(np.vstack([square[:1], knot, square[1:]]), width=np.arange(8) + 5.0)
    spiked = Curve(np.vstack([square[:1], [[50.0, 0.0], [50.0, -70.0], [50.0, 0.0]], square[1:]]))
    eight = Curve([[0.0, 0.0], [80.0, 80.0], [80.0, 0.0], [0.0, 80.0]])
    tail = Curve(
        [[0.0, 0.0], [60.0, 0.0], [62.0, 3.0], [58.0, 3.0], [61.0, -2.0], [61.0, -80.0]], closed=False
    )
    result = clean(stack([looped], [spiked], [eight], [tail]))
    kept = [layer.curves for layer in result.toolpath.layers]
    assert kept[0][0].signed_area == pytest.approx(1e4, rel=1e-3)
    assert kept[0][0].width.min() >= 5.0
    assert shapely.Polygon(kept[1][0].points).equals(shapely.Polygon(square))
    assert kept[2] == (eight,)
    assert not kept[3][0].closed
    assert kept[3][0].points[[0, -1]].tolist() == tail.points[[0, -1]].tolist()
    for (curve,) in (kept[0], kept[1], kept[3]):
        assert (shapely.LinearRing if curve.closed else shapely.LineString)(curve.points).is_simple
    assert [f.done for f in result.found if f.fault == "crosses itself"] == [
        "repaired",
        "repaired",
        "kept",
        "repaired",
    ]
    assert str(result.found[-2]).startswith(
        "layer 2, curve 0 near (40.000, 40.000): it crosses or touches itself and has 2 long loops"
    )


TWO_LOOPS = [
    *([0, 0], [100, 0], [100, 100], [50, 100]),
    *([50, -50], [200, -50], [200, -150], [150, -150], [150, 200]),
]


@pytest.mark.parametrize("apart", [0.0, 1e-9, 5e-3])
def test_an_open_curve_that_ends_where_it_begins_is_closed(apart):
    disc = ring(50.0, width=12.0)
    drawn = Curve(
        np.vstack([disc.points, disc.points[0] + [0.0, apart]]),
        closed=False,
        width=np.append(disc.width, 9.0),
    )
    result = clean(stack([drawn, ring(20.0, (200.0, 0.0))]))
    curve = result.toolpath.layers[0].curves[0]
    assert curve.closed
    assert np.array_equal(curve.points, disc.points)
    assert np.array_equal(curve.width, disc.width)
    assert [(f.curve, f.fault, f.done) for f in result.found] == [(0, "not closed", "repaired")]
    assert clean(result.toolpath).toolpath is result.toolpath
    open_still = Curve(np.vstack([disc.points, disc.points[0] - [0.0, 0.5]]), closed=False)
    assert clean(stack([open_still])).found == ()


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([[0, 0], [0, 200], [100, 200], [100, 100], [-50, 100]], "a long loop"),  # a P
        ([[0, 0], [0, 200], [100, 200], [100, 100], [0, 100]], "a long loop"),  # that only touches itself
        (TWO_LOOPS, "2 long loops"),
        ([[0, 0], [100, 0], [0, 0]], "no part that is run once"),
    ],
)
def test_open_curves_with_long_loops_are_kept_and_reported(points, words):
    curve = Curve(np.array(points, float), closed=False)
    result = clean(stack([curve]))
    assert result.toolpath.layers[0].curves == (curve,)
    (found,) = result.found
    assert (found.fault, found.done) == ("crosses itself", "kept")
    assert f"has {words}:" in found.detail


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=3, max_size=12), st.booleans())
def test_loops_share_out_the_whole_path(points, closed):
    rows = np.array([p for k, p in enumerate(points) if p != points[k - 1]], float) * 10.0
    if len(rows) < 3:
        return
    loops, through, _ = loops_of(rows, closed=closed)
    path = np.vstack([rows, rows[:1]])

    def swept(line):
        x, y = line.T
        return 0.5 * (x[:-1] @ y[1:] - x[1:] @ y[:-1])

    total = sum(swept(np.vstack([loop, loop[:1]])) for loop in loops)
    total += 0.0 if through is None else swept(through)
    assert total == pytest.approx(swept(path if closed else rows), abs=1e-6)
    for loop in loops:
        # Simple, but for places where loops of no width were taken off.
        assert shapely.LinearRing(loop).is_simple or abs(swept(np.vstack([loop, loop[:1]]))) < 1e-6
    result = clean(stack([Curve(rows, closed)]), shortest=1.0)
    kept = any(f.fault == "crosses itself" and f.done == "kept" for f in result.found)
    for curve in result.toolpath.layers[0].curves:
        assert kept or (shapely.LinearRing if curve.closed else shapely.LineString)(curve.points).is_simple
        assert not kept or np.array_equal(curve.points, rows)
    again = clean(result.toolpath, shortest=1.0)
    assert again.toolpath is result.toolpath


def test_cleaning_refuses_bad_lengths():
    for how in ({"shortest": 0.0}, {"shortest": float("nan")}, {"apart": -1.0}):
        with pytest.raises(ToolpathError, match="above 0"):
            clean(stack(PLATE), **how)
    assert clean(replace(stack(PLATE), layers=())).found == ()
