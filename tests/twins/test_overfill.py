"""Overfill optimisation: equation 4 to the letter, runs that end at d_min, curves that never cross."""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import pytest
import shapely
from shapes import REFERENCE, SHAPES

from twins import (
    Curve,
    Layer,
    Plane,
    Toolpath,
    ToolpathError,
    Zones,
    largest_turning,
    layer_planes,
    resample,
    slice_surface,
)
from twins.curves.close_points import Runs, near_segments, nearest_runs, spacing
from twins.curves.dividing import divided
from twins.curves.fairing import fair
from twins.curves.overfill import equation_4, relieve_overfill
from twins.curves.thinning import carried_over, thinned

BED = Plane.horizontal()
D = 20.0


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


def line(y, start=0.0, end=300.0, step=D / 4):
    x = np.arange(start, end + 1e-9, step)
    return Curve(np.column_stack([x, np.full(len(x), y)]), closed=False)


def ring(radius, center=(0.0, 0.0), points=60, clockwise=False):
    angle = 2 * np.pi * np.arange(points) / points
    circle = np.asarray(center) + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return Curve(circle[::-1] if clockwise else circle)


def star(seed, points=80, radius=60.0, jag=0.5):
    """A jagged closed curve, simple because it is seen whole from the origin."""
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * (np.arange(points) + rng.uniform(0, 0.8, points)) / points
    r = radius * (1.0 + rng.uniform(-jag, jag, points))
    return Curve(r[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def polyline(curve):
    return shapely.LineString(np.vstack([curve.points, curve.points[:1]]) if curve.closed else curve.points)


def simple(layer):
    return shapely.MultiLineString([polyline(curve) for curve in layer.curves]).is_simple


def transcribed(curves, d, strength):
    """Equation 4 as the paper has it, but for the points that are near along their own curve."""
    result = []
    for c, curve in enumerate(curves):
        moves = np.zeros_like(curve.points)
        for i, p in enumerate(curve.points):
            terms = []
            for k, other in enumerate(curves):
                for j, q in enumerate(other.points):
                    if k == c:
                        ends = np.vstack([curve.points, curve.points[:1]])
                        way = np.linalg.norm(np.diff(ends, axis=0), axis=1)
                        along = way[min(i, j) : max(i, j)].sum()
                        if curve.closed:
                            along = min(along, way.sum() - along)
                        if along < np.pi / 2 * d:
                            continue
                    r = np.linalg.norm(p - q)
                    if 0.0 < r < d:
                        terms.append((p - q) / r * (d - r))
            if terms:
                moves[i] = strength / len(terms) * np.sum(terms, axis=0)
        result.append(moves)
    return result


@pytest.mark.parametrize("seed", range(4))
def test_one_step_is_equation_4(seed):
    rng = np.random.default_rng(seed)
    wild = Curve(np.cumsum(rng.normal(0, 4.0, (40, 2)), axis=0), closed=False)
    curves = [star(seed, 40, 25.0), wild, ring(15.0, (20.0, 10.0), 20, clockwise=True)]
    for found, expected in zip(equation_4(curves, 12.0, 0.3), transcribed(curves, 12.0, 0.3), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-12)
    assert any(moves.any() for moves in transcribed(curves, 12.0, 0.3))


def test_nothing_pushes_where_nothing_is_near():
    assert not any(moves.any() for moves in equation_4([line(0.0), line(D)], D, 1.0))
    assert equation_4([], D, 1.0) == []


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("reach", [0.5, 15.0, 500.0])
def test_all_segments_within_reach_are_found(seed, reach):
    runs = Runs.of([star(seed), line(3.0, -50.0, 50.0), ring(20.0, (300.0, 0.0))])
    start, found = near_segments(runs.points, runs.following, reach)
    segments = shapely.linestrings(np.stack([runs.points, runs.points[runs.following]], axis=1))
    away = shapely.distance(shapely.points(runs.points)[:, None], segments[None, :])
    for i in range(len(runs.points)):
        listed = found[start[i] : start[i + 1]]
        assert len(np.unique(listed)) == len(listed)
        others = np.flatnonzero((runs.following != i) & (np.arange(len(runs.points)) != i))
        assert set(others[away[i, others] <= reach]) <= set(listed) <= set(others)


def test_spacing_is_the_distance_from_other_curves():
    curves = [star(5, 50), ring(90.0), line(100.0, -100.0, 100.0)]
    runs = Runs.of(curves)
    reach = 30.0  # nothing of the circle or the line is so near to itself but for what is near along it
    nearest, left, right, *_ = nearest_runs(runs, reach)
    np.testing.assert_array_equal(nearest, np.minimum(left, right))
    for c in (1, 2):
        others = shapely.union_all([polyline(curve) for k, curve in enumerate(curves) if k != c])
        away = shapely.distance(shapely.points(curves[c].points), others)
        np.testing.assert_allclose(nearest[runs.curve == c], np.where(away < reach, away, np.inf), rtol=1e-12)
    # The star lies on the left of the circle around it, the line on its right.
    in_circle = runs.curve == 1
    top = runs.points[:, 1] > 80.0
    np.testing.assert_allclose(right[in_circle & top], 100.0 - runs.points[in_circle & top, 1], rtol=1e-12)


@pytest.mark.parametrize(("diameter", "close"), [(1.02 * D, False), (0.9 * D, True)])
def test_a_turn_of_d_min_is_just_wide_enough(diameter, close):
    """Half circles between straight legs: the way around one is (pi / 2) times its diameter."""
    angle = np.linspace(0.0, np.pi, 33)
    bend = 0.5 * diameter * np.column_stack([np.sin(angle), -np.cos(angle)])
    legs = np.arange(-100.0, 0.0, 4.0)
    low = np.column_stack([legs, np.full(len(legs), -0.5 * diameter)])
    hairpin = Curve(np.vstack([low, bend, (low * [1, -1])[::-1]]), closed=False)
    assert (spacing(stack([hairpin]), D)[0].close > 0.0) == close


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.9])
@pytest.mark.parametrize("stagger", [0.0, 0.25, 0.5])
def test_parallel_runs_end_at_d_min(share, stagger):
    lower, upper = line(0.0), line(share * D, stagger * D / 4, 300.0 + stagger * D / 4)
    result = relieve_overfill(stack([lower, upper]), D, steps=300)
    a, b = result.toolpath.layers[0].curves
    middle = shapely.points([p for p in a.points if 60.0 < p[0] < 240.0])
    np.testing.assert_allclose(shapely.distance(middle, polyline(b)), D, rtol=0.005)
    assert result.before.close == pytest.approx(600.0)
    assert result.after.close == 0.0
    assert result.displacement <= 0.6 * D


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("strength", [0.3, 1.0])
def test_simple_curves_stay_simple(seed, strength):
    curves = [star(seed, jag=0.7), ring(110.0), star(seed + 50, jag=0.3, radius=30.0)]
    curves[2] = Curve(curves[2].points + [155.0, 0.0])
    layer = stack(curves)
    assert simple(layer.layers[0])
    result = relieve_overfill(layer, D, strength=strength, steps=60, fairing=0.1 * (seed % 3))
    assert result.before.close > 0.0
    assert simple(result.toolpath.layers[0])
    assert result.displacement <= D * (1 + 1e-9)


def test_locked_points_do_not_move():
    lower, upper = line(0.0), line(0.5 * D, 1.0, 301.0)
    locks = [[np.ones(len(lower.points), dtype=bool), upper.points[:, 0] < 100.0]]
    given = stack([lower, upper])
    result = relieve_overfill(given, D, locks, steps=400)
    a, b = result.toolpath.layers[0].curves
    assert a is lower
    assert (b.points[locks[0][1]] == upper.points[locks[0][1]]).all()
    far = b.points[(b.points[:, 0] > 160.0) & (b.points[:, 0] < 280.0)]
    np.testing.assert_allclose(far[:, 1], D, rtol=0.005)
    # The same from a function of the divided toolpath.
    again = relieve_overfill(given, D, lambda i, _: locks[i], steps=400)
    np.testing.assert_array_equal(again.toolpath.layers[0].curves[1].points, b.points)
    # And from zones: the lower curve, and what lies left of a line between two points of the upper.
    left = shapely.box(-50.0, -50.0, 97.0, 50.0)
    zones = Zones(polygons=[left], curves=[(0, 0)])
    flags = zones.protected(given)[0]
    zoned = relieve_overfill(given, D, zones, steps=400).toolpath.layers[0].curves
    assert zoned[0] is lower
    assert 0 < flags[1].sum() < len(flags[1])
    assert (zoned[1].points[flags[1]] == upper.points[flags[1]]).all()
    np.testing.assert_allclose(
        zoned[1].points[(upper.points[:, 0] > 160.0) & (upper.points[:, 0] < 280.0), 1], D, rtol=0.005
    )


def test_segments_of_locked_points_stay_where_curves_are_divided():
    lower, upper = (
        Curve(np.array([[0.0, y], [100.0, y], [200.0, y], [300.0, y]]), closed=False) for y in (0.0, 10.0)
    )
    locks = [[[True] * 4, [False, True, False, False]]]
    b = relieve_overfill(stack([lower, upper]), D, locks).toolpath.layers[0].curves[1]
    inside = (b.points[:, 0] > 0.0) & (b.points[:, 0] < 200.0)
    assert inside.sum() > 30
    assert (b.points[inside, 1] == 10.0).all()
    assert (b.points[b.points[:, 0] > 220.0, 1] > 15.0).all()


@pytest.mark.parametrize("half", [8.0, 14.0, 30.0])
def test_a_notch_has_no_shoulders_however_it_is_sampled(half):
    """A pushed stretch ends in the tip, where the runs are near along the curve; what is pushed must not fold there."""
    mouth = [(-100, -100), (100, -100), (100, -half), (30, 0), (100, half), (100, 100), (-100, 100)]
    square = stack([Curve(np.array(mouth, float))])
    turns, areas = [], []
    for length in (5.5, 4.0, 2.0, 1.0, 0.5):
        given = resample(square, length, corner_deg=10.0)
        result = relieve_overfill(given, 22.0)
        assert result.after.close == 0.0
        turns.append(largest_turning(result.toolpath.layers[0].curves[0], 22.0))
        areas.append(result.area_change)
        before = largest_turning(given.layers[0].curves[0], 22.0)
    assert max(turns) <= 1.15 * before
    assert np.ptp(turns) <= 0.2 * before
    assert np.ptp(areas) <= 0.005


@pytest.mark.parametrize("closed", [True, False])
def test_fairing_solves_its_equations(closed):
    """Against NumPy, row by row as they are written down; and far from what is pushed everything follows it."""
    rng = np.random.default_rng(5)
    curves = [Curve(star(1, 30).points, closed), ring(20.0, (300.0, 0.0), 12), line(400.0, 0.0, 30.0)]
    runs = Runs.of(curves)
    n = len(runs.points)
    points = runs.points + rng.normal(0.0, 1.0, (n, 2))
    free = rng.random(n) < 0.9
    push = rng.normal(0.0, 1.0, (n, 2)) * (rng.random(n) < 0.2)[:, None]
    push[runs.curve == 1] = 0.0  # a whole circle that nothing pushes or holds
    free[runs.curve == 1] = True
    step = push.copy()
    fair(step, points, runs.points, runs.previous, runs.following, runs.starts, free, 0.3, 5.0)
    pushed = push.any(axis=1)
    assert (step[~free] == 0.0).all()
    assert (step[free & pushed] == push[free & pushed]).all()
    A, b = np.eye(n), points + np.where(free[:, None], push, 0.0) - runs.points
    for i in np.flatnonzero(free & ~pushed):
        p, f = runs.previous[i], runs.following[i]
        to_last, to_next = (np.linalg.norm(runs.points[k] - runs.points[i]) for k in (p, f))
        if p == i:
            parts = [(f, 0.3 * 25.0 / to_next**2)]
        elif f == i:
            parts = [(p, 0.3 * 25.0 / to_last**2)]
        else:
            parts = [(k, 0.3 * 25.0 / (to_last + to_next) / way) for k, way in ((p, to_last), (f, to_next))]
        for k, part in parts:
            A[i, i] += part
            A[i, k] -= part
    np.testing.assert_allclose(points + step - runs.points, np.linalg.solve(A, b), atol=1e-9)


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("longest", [0.1, 3.0, 20.0, 1e4])
def test_thinned_curves_are_as_sparse_as_they_may_be(closed, longest):
    curve = Curve(star(7, 200, jag=0.05).points, closed)
    kept = np.random.default_rng(1).random(200) < 0.03
    found = thinned(curve, longest, kept)
    assert found[0] == 0
    assert set(np.flatnonzero(kept)) <= set(found)
    assert (np.diff(found) > 0).all()
    ends = np.vstack([curve.points, curve.points[:1]]) if closed else curve.points
    place = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(ends, axis=0), axis=1)))
    stops = np.append(found, 200) if closed else found
    assert closed or found[-1] == 199
    for a, b in pairwise(stops):
        assert b == a + 1 or place[b] - place[a] <= longest * (1 + 1e-6)
        if b not in (199, 200) and not kept[b]:
            assert place[b + 1] - place[a] > longest
    # A displacement that is linear along the curve between them is carried over as it is.
    at = np.arange(len(found))
    gone = np.column_stack([np.cos(at), at % 3])
    everywhere = carried_over(curve, found, gone)
    np.testing.assert_allclose(everywhere[found], gone, atol=1e-12)
    for k, (a, b) in enumerate(pairwise(stops)):
        share = ((place[a:b] - place[a]) / (place[b] - place[a]))[:, None]
        between = (1 - share) * gone[k] + share * gone[(k + 1) % len(gone)]
        np.testing.assert_allclose(everywhere[a:b], between, atol=1e-9)


def test_what_is_far_enough_apart_is_returned_itself():
    near, far = [ring(40.0), ring(30.0, clockwise=True)], [ring(40.0)]
    given = stack(near, far, [])
    result = relieve_overfill(given, D)
    assert result.toolpath.layers[0] is not given.layers[0]
    assert result.toolpath.layers[1:] == given.layers[1:]
    assert result.layers[1].displacement == result.layers[2].displacement == 0.0
    assert relieve_overfill(stack(far), D).toolpath.layers[0].curves[0] is far[0]
    # Of a layer only what moves is new.
    layer = [ring(40.0), ring(30.0, clockwise=True), ring(40.0, (200.0, 0.0))]
    assert relieve_overfill(stack(layer), D).toolpath.layers[0].curves[2] is layer[2]


def test_rings_part_evenly():
    """By symmetry rings of a tube stay round; the gap opens to d_min."""
    result = relieve_overfill(
        stack([ring(50.0, points=80), ring(38.0, points=80, clockwise=True)]), D, steps=400
    )
    outer, inner = (np.linalg.norm(c.points, axis=1) for c in result.toolpath.layers[0].curves)
    np.testing.assert_allclose([outer.std(), inner.std()], 0.0, atol=0.02)
    assert outer.mean() - inner.mean() == pytest.approx(D, rel=0.005)
    assert result.layers[0].area_after == pytest.approx(
        np.pi * (outer.mean() ** 2 - inner.mean() ** 2), rel=0.01
    )


def test_turning_and_moving_the_input_turns_and_moves_the_result():
    curves = [ring(40.0), ring(30.0, (75.0, 5.0)), line(-45.0, -60.0, 60.0)]
    c, s = np.cos(0.7), np.sin(0.7)
    turn, shift = np.array([[c, -s], [s, c]]), np.array([1000.0, -300.0])
    there = [Curve(curve.points @ turn.T + shift, curve.closed) for curve in curves]
    a, b = (relieve_overfill(stack(layer), D, steps=20).toolpath for layer in (curves, there))
    for one, other in zip(a.layers[0].curves, b.layers[0].curves, strict=True):
        np.testing.assert_allclose(one.points @ turn.T + shift, other.points, atol=1e-6)


def test_the_leash_holds():
    result = relieve_overfill(stack([line(0.0), line(4.0, 2.0)]), D, max_displacement=3.0)
    assert result.displacement == pytest.approx(3.0, rel=1e-9)
    assert relieve_overfill(stack([line(0.0), line(4.0)]), D, max_displacement=0.0).displacement == 0.0


def test_curves_that_coincide_or_cross_stay_finite():
    cross = Curve(np.array([[150.0, -40.0], [150.0, 40.0]]), closed=False)
    result = relieve_overfill(stack([line(0.0), line(0.0), cross]), D)
    assert all(np.isfinite(curve.points).all() for *_, curve in result.toolpath.curves())


def test_division_keeps_every_vertex_and_width():
    for closed in (True, False):
        points = star(3, 12).points
        curve = Curve(points, closed, np.linspace(5.0, 9.0, len(points)))
        finer, segment = divided(curve, 3.0)
        first = np.searchsorted(segment, np.arange(len(points)))
        np.testing.assert_array_equal(finer.points[first], points)
        np.testing.assert_array_equal(finer.width[first], curve.width)
        assert finer.length == pytest.approx(curve.length)
        lengths = np.linalg.norm(np.diff(polyline(finer).coords, axis=0), axis=1)
        assert lengths.max() <= 3.0 * (1 + 1e-9)
        assert divided(finer, 3.0)[0] is finer


def test_gyroid_brick_is_relieved():
    surface = REFERENCE["gyroid shell brick"]()
    given = slice_surface(surface, layer_planes(BED, float(surface.vertices[:, 2].max()), 10.0))
    told = []
    with ThreadPoolExecutor(2) as pool:
        result = relieve_overfill(given, 14.0, progress=told.append, executor=pool)
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert result.before.close > 4000.0
    assert result.after.close <= 0.1 * result.before.close
    assert result.displacement <= 14.0
    assert abs(result.largest_area_change) <= 0.03
    assert all(simple(layer) for layer in result.toolpath.layers)
    bottom = relieve_overfill(Toolpath(BED, given.layers[:1], 10.0), 14.0).toolpath
    for one, other in zip(bottom.layers[0].curves, result.toolpath.layers[0].curves, strict=True):
        np.testing.assert_array_equal(one.points, other.points)


def test_porous_column_is_relieved():
    """At layers of 10 mm no cut comes near the top or bottom of a hole; at 2.5 mm walls of holes are 12.7 mm apart."""
    surface = SHAPES["porous column"]()
    planes = layer_planes(BED, float(surface.vertices[:, 2].max()), 10.0)
    given = slice_surface(surface, planes)
    assert relieve_overfill(given, D).before.close == 0.0
    fine = slice_surface(surface, layer_planes(BED, float(surface.vertices[:, 2].max()), 2.5), 10.0)
    given = Toolpath(BED, fine.layers[:64], 2.5)
    result = relieve_overfill(given, D)
    assert result.before.close > 1000.0
    assert result.after.close <= 0.1 * result.before.close
    assert result.displacement <= D
    assert abs(result.area_change) <= 0.03
    assert all(simple(layer) for layer in result.toolpath.layers)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"min_distance": 0.0}, "minimal distance"),
        ({"min_distance": float("nan")}, "minimal distance"),
        ({"strength": 0.0}, "strength"),
        ({"strength": 1.5}, "strength"),
        ({"steps": -1}, "negative"),
        ({"max_displacement": -1.0}, "largest displacement"),
        ({"locked": []}, "0 layers"),
        ({"locked": [[None]]}, "layer 0: locks are given for 1 curves"),
        ({"locked": [[None, [True, False]]]}, "layer 0, curve 1"),
        ({"locked": [[None, np.zeros(61)]]}, "layer 0, curve 1.*float64"),
    ],
)
def test_bad_arguments(arguments, message):
    with pytest.raises(ToolpathError, match=message):
        relieve_overfill(stack([line(0.0), line(10.0)]), **{"min_distance": D, **arguments})


def test_beside_a_lock_a_curve_steps_aside_gradually():
    lower, upper = line(0.0), line(0.4 * D)
    locked = upper.points[:, 0] < 100.0
    result = relieve_overfill(
        stack([lower, upper]), D, [[np.ones(len(lower.points), bool), locked]], steps=400
    )
    moved = result.toolpath.layers[0].curves[1].points
    gone = np.linalg.norm(moved - upper.points, axis=1)
    place = upper.points[:, 0]
    assert (gone <= np.maximum(place - place[locked].max(), 0.0) + 1e-9).all()
    np.testing.assert_allclose(moved[(place > 160.0) & (place < 280.0), 1], D, rtol=0.005)
