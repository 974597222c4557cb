"""Variable bead width: beads share the room between runs, within what the nozzle can lay, and everybody reads it."""

import numpy as np
import pytest
import shapely
from shapes import REFERENCE

from twins import (
    Curve,
    Layer,
    Plane,
    Toolpath,
    ToolpathError,
    extrude,
    layer_planes,
    signed_volume,
    slice_surface,
    visual_mesh,
)
from twins.curves.bead_width import bead_cover, vary_width

BED = Plane.horizontal()
W_MIN, W_MAX, WIDTH = 8.0, 24.0, 14.0


def stack(*layers, thickness=10.0):
    """A toolpath of horizontal layers, each a list of curves."""
    return Toolpath(
        BED,
        tuple(
            Layer(
                Plane.horizontal(thickness * (i + 0.5)), Plane.horizontal(thickness * (i + 1)), tuple(curves)
            )
            for i, curves in enumerate(layers)
        ),
        thickness,
    )


def line(y, length=400.0):
    x = np.linspace(0.0, length, 81)
    return Curve(np.column_stack([x, y + np.zeros(len(x))]), closed=False)


def ring(radius, clockwise=False, points=90):
    angle = 2 * np.pi * np.arange(points) / points
    circle = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return Curve(circle[::-1] if clockwise else circle)


def middle(curve):
    return curve.width[(curve.points[:, 0] > 150.0) & (curve.points[:, 0] < 250.0)]


@pytest.mark.parametrize("distance", [8.0, 11.0, 14.0, 19.0, 24.0])
def test_two_runs_share_the_room(distance):
    result = vary_width(stack([line(0.0), line(distance)]), W_MIN, W_MAX, WIDTH)
    for curve in result.toolpath.layers[0].curves:
        np.testing.assert_allclose(WIDTH if curve.width is None else middle(curve), distance, rtol=1e-6)
    assert result.after.overlap == pytest.approx(0.0, abs=0.03 * result.after.covered)
    assert result.after.gap == pytest.approx(0.0, abs=1.0)
    assert result.after.overlap <= result.before.overlap + 5.0  # of rounded ends
    # Where a run lies d from another over its whole length, gap and overlap are known.
    assert result.before.gap == pytest.approx(max(distance - WIDTH, 0.0) * 400.0, rel=0.08, abs=1.0)
    assert result.before.overlap == pytest.approx(max(WIDTH - distance, 0.0) * 400.0, rel=0.08, abs=5.0)


def test_widths_stay_in_the_range_of_the_nozzle():
    narrow = vary_width(stack([line(0.0), line(5.0)]), W_MIN, W_MAX, WIDTH)
    assert middle(narrow.toolpath.layers[0].curves[0]) == pytest.approx(W_MIN)
    # Too far for any bead: not a gap, and nothing changes.
    far = stack([line(0.0), line(W_MAX + 0.1)])
    result = vary_width(far, W_MIN, W_MAX, WIDTH)
    assert result.toolpath is far
    assert result.before == result.after
    assert (result.layers[0].narrowest, result.layers[0].widest) == (WIDTH, WIDTH)


def test_three_runs_share_different_rooms():
    a, b, c = (
        middle(curve)
        for curve in vary_width(stack([line(0.0), line(11.0), line(27.0)]), W_MIN, W_MAX, WIDTH)
        .toolpath.layers[0]
        .curves
    )
    np.testing.assert_allclose(a + b, 22.0, rtol=1e-3)
    np.testing.assert_allclose(b + c, 32.0, rtol=1e-3)


@pytest.mark.parametrize("gaps", ["both", "inside", "none"])
@pytest.mark.parametrize("rate", [0.02, 0.2])
def test_rate_and_range_hold_everywhere(gaps, rate):
    rng = np.random.default_rng(3)
    angle = 2 * np.pi * np.arange(100) / 100
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    wave = 60.0 + 10.0 * np.sin(5 * angle) + rng.uniform(-2.0, 2.0, 100)
    curves = [Curve(wave[:, None] * circle), Curve((0.6 * wave + 8.0)[:, None] * circle[::-1]), ring(85.0)]
    result = vary_width(stack(curves), W_MIN, W_MAX, WIDTH, gaps=gaps, rate=rate)
    for curve in result.toolpath.layers[0].curves:
        width = curve.width
        assert W_MIN - 1e-9 <= width.min() <= width.max() <= (WIDTH if gaps == "none" else W_MAX) + 1e-9
        around = np.vstack([curve.points, curve.points[:1]])
        along = np.linalg.norm(np.diff(around, axis=0), axis=1)
        change = np.abs(np.diff(np.append(width, width[0])))
        assert (change <= rate * along + 1e-9).all()
    assert result.layers[0].steepest <= rate + 1e-9
    if gaps == "none":
        assert result.after.overlap < result.before.overlap
        assert result.after.printed < result.before.printed
    else:
        assert result.after.gap < result.before.gap


def test_inside_gaps_are_those_on_the_left():
    """Two tubes, one in the other: the walls are 18 mm thick, the slot between them is 20 mm wide."""
    tubes = stack([ring(100.0), ring(82.0, True), ring(62.0), ring(44.0, True)])
    inside = vary_width(tubes, W_MIN, W_MAX, WIDTH, gaps="inside").toolpath.layers[0].curves
    for outer, inner in (inside[:2], inside[2:]):
        np.testing.assert_allclose((outer.width.mean() + inner.width.mean()) / 2, 18.0, rtol=0.005)
    # Only growing was limited to the inside; 18 / 2 + 18 / 2 < 20 overlaps nowhere.
    none = vary_width(tubes, W_MIN, W_MAX, WIDTH, gaps="none").toolpath
    assert none is tubes


def test_locked_points_keep_their_width_and_the_other_run_makes_up_for_it():
    lower, upper = line(0.0), line(19.0)
    locks = [[np.ones(81, dtype=bool), None]]
    a, b = vary_width(stack([lower, upper]), W_MIN, W_MAX, WIDTH, locks).toolpath.layers[0].curves
    assert a is lower
    np.testing.assert_allclose(middle(b), 24.0, rtol=1e-6)


def test_widths_of_their_own_are_where_curves_start_from():
    own = Curve(line(0.0).points, False, np.full(81, 10.0))
    given = stack([own])
    assert vary_width(given, W_MIN, W_MAX, WIDTH).toolpath is given
    a, b = vary_width(stack([own, line(19.0)]), W_MIN, W_MAX, WIDTH).toolpath.layers[0].curves
    np.testing.assert_allclose([middle(a).mean(), middle(b).mean()], [17.0, 21.0], rtol=1e-3)


def test_cover_of_a_crossing_and_of_a_ring():
    cross = [line(0.0), Curve(np.array([[200.0, -150.0], [200.0, 150.0]]), closed=False)]
    cover = bead_cover(cross, WIDTH, W_MAX)
    assert cover.printed == pytest.approx(700.0 * WIDTH)
    assert cover.overlap == pytest.approx(WIDTH**2, rel=0.01)
    around = bead_cover([ring(50.0, points=720)], WIDTH, W_MAX)
    assert around.covered == pytest.approx(np.pi * (57.0**2 - 43.0**2), rel=1e-3)
    assert around.overlap == pytest.approx(0.0, abs=2e-3 * around.covered)
    assert bead_cover([], WIDTH, W_MAX).printed == 0.0


def test_extrusion_and_looks_follow_the_width():
    """M' of a wall in which two beads share what room there is: the volume is what covers, times the height."""
    angle = 2 * np.pi * np.arange(90) / 90
    inner = (80.0 + 3.0 * np.sin(3 * angle))[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    walls = [[ring(100.0), Curve(inner[::-1])]] * 2
    result = vary_width(stack(*walls), W_MIN, W_MAX, WIDTH)
    assert result.after.gap < 0.05 * result.before.gap
    volumes = []
    for toolpath, cover in ((stack(*walls), result.before), (result.toolpath, result.after)):
        volume = signed_volume(extrude(toolpath, WIDTH, 5.0))
        assert volume == pytest.approx(10.0 * cover.covered, rel=0.015)
        volumes.append((volume, signed_volume(visual_mesh(toolpath, WIDTH, 5.0))))
    extruded, seen = np.array(volumes[1]) - np.array(volumes[0])
    assert extruded == pytest.approx(10.0 * (result.after.covered - result.before.covered), rel=0.05)
    assert seen > 0.8 * extruded


def test_gyroid_walls_are_filled():
    surface = REFERENCE["gyroid shell brick"]()
    given = slice_surface(surface, layer_planes(BED, float(surface.vertices[:, 2].max()), 10.0))
    told = []
    result = vary_width(
        Toolpath(BED, given.layers[:6], 10.0), 9.0, 20.0, 14.0, gaps="inside", progress=told.append
    )
    assert told[-1] == 1.0
    assert result.after.gap <= 0.1 * result.before.gap
    assert result.after.overlap <= result.before.overlap
    for layer in result.layers:
        assert layer.after.printed == pytest.approx(layer.after.covered, rel=0.01)
        assert 9.0 - 1e-9 <= layer.narrowest <= layer.widest <= 20.0 + 1e-9
    for old, new in zip(given.layers[:6], result.toolpath.layers, strict=True):
        for before, after in zip(old.curves, new.curves, strict=True):
            assert shapely.MultiPoint(before.points).difference(shapely.MultiPoint(after.points)).is_empty


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"w_min": 0.0}, "above 0 and ascend"),
        ({"w_min": 30.0}, "above 0 and ascend"),
        ({"w_max": float("nan")}, "above 0 and ascend"),
        ({"width": 30.0}, "nominal width"),
        ({"rate": 0.0}, "rate"),
        ({"gaps": "all"}, "gaps"),
        ({"locked": []}, "0 layers"),
    ],
)
def test_bad_arguments(arguments, message):
    with pytest.raises(ToolpathError, match=message):
        vary_width(stack([line(0.0)]), **{"w_min": W_MIN, "w_max": W_MAX, "width": WIDTH, **arguments})
