"""Smoothing: the paper's steps against a transcription, and constraints that hold to the micrometre."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import shapely
from jagged import around, divided, jagged

from twins import Curve, Layer, Plane, Toolpath, ToolpathError
from twins.curves.resampling import resample
from twins.curves.smoothing import smooth
from twins.curves.smoothing_loop import relax
from twins.curves.smoothing_step import displacements
from twins.curves.turning import curvature, largest_turning, turning_angles
from twins.curves.zones import Zones

BEAD = 20.0
SPACING = BEAD / 4


def layer_of(*curves, height=10.0):
    return Layer(Plane.horizontal(height - 5.0), Plane.horizontal(height), tuple(curves))


def flat(*curves):
    return Toolpath(Plane.horizontal(), (layer_of(*curves),), 10.0)


def only(toolpath):
    ((*_, curve),) = toolpath.curves()
    return curve


def ring(radius, count):
    return around(np.full(count, radius))


def linked(count, closed=True):
    index = np.arange(count)
    before, after = (index - 1) % count, (index + 1) % count
    if not closed:
        before[0] = after[-1] = -1
    return before, after


def beyond(before, after, side):
    """What the second closed curve encloses beyond a millionth of a millimetre on the locked side of the first."""
    outward = (side > 0) != shapely.is_ccw(shapely.LinearRing(before))
    old, new = shapely.Polygon(before), shapely.make_valid(shapely.Polygon(after))
    if outward:
        return shapely.difference(shapely.buffer(old, -1e-6, quad_segs=32), new).area
    return shapely.difference(new, shapely.buffer(old, 1e-6, quad_segs=32)).area


def paper_curvature(h, p, j, inscribed):
    into, out = p - h, j - p
    u, v = np.sqrt(into @ into), np.sqrt(out @ out)
    bend = out / v - into / u
    return np.sqrt(bend @ bend) / (min(u, v) if inscribed else u / 2 + v / 2)


def paper_step(points, side, s_0, s_1, largest):
    """Lines 2 to 16 of Algorithm 1, word for word."""
    n = len(points)
    f, adjusted, kappa, normal = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(n), np.zeros((n, 2))
    for i in range(n):
        h, j = points[i - 1], points[(i + 1) % n]
        left = np.array([-(j - h)[1], (j - h)[0]])
        normal[i] = side * left / np.sqrt(left @ left)
        kappa[i] = paper_curvature(h, points[i], j, True)
    for i in range(n):
        f[i] = s_0 * (points[i - 1] - 2 * points[i] + points[(i + 1) % n]) / 4
        if f[i] @ normal[i] < 0:
            adjusted[i - 1] -= f[i] / 2
            adjusted[(i + 1) % n] -= f[i] / 2
        else:
            f[i] = s_1 * f[i]
    new = points.copy()
    for i in range(n):
        new[i] = new[i] + adjusted[i]
        if f[i] @ normal[i] >= 0 and (adjusted[i].any() or kappa[i] > largest):
            new[i] = new[i] + f[i]
    return new


@pytest.mark.parametrize("side", [-1, 1])
def test_one_step_is_algorithm_1(side):
    for seed in range(4):
        points = jagged(seed)
        step, kappa = displacements(
            points, *linked(len(points)), side, (0.7, 0.05), np.full(len(points), 0.03), False
        )
        assert np.abs(points + step - paper_step(points, side, 0.7, 0.05, 0.03)).max() < 1e-12
        assert np.allclose(kappa, curvature(points), rtol=1e-12)


def test_without_a_side_a_step_is_equation_1():
    points = jagged(3)
    step, _ = displacements(points, *linked(len(points)), 0, (0.6, 0.05), np.zeros(len(points)), True)
    for i, p in enumerate(points):
        assert np.allclose(
            step[i], 0.6 * (points[i - 1] - 2 * p + points[(i + 1) % len(points)]) / 4, atol=1e-13
        )


def test_the_curvature_stop_leaves_out_what_is_less_bent():
    points = jagged(3)
    limit = float(np.median(curvature(points)))
    step, _ = displacements(points, *linked(len(points)), 0, (1.0, 0.05), np.full(len(points), limit), True)
    assert np.array_equal(step.any(axis=1), curvature(points) > limit)


def test_curvatures_are_equations_2_and_3():
    points = jagged(5)
    for estimate in ("mean", "inscribed"):
        found = curvature(points, estimate=estimate)
        for i, p in enumerate(points):
            wanted = paper_curvature(points[i - 1], p, points[(i + 1) % len(points)], estimate == "inscribed")
            assert found[i] == pytest.approx(wanted, rel=1e-12)


def test_a_circle_has_the_curvature_and_turning_of_a_circle():
    points = ring(50.0, 720)
    assert np.allclose(curvature(points), 1 / 50.0)
    assert turning_angles(points).sum() == pytest.approx(2 * np.pi)
    window = 40 * np.linalg.norm(points[1] - points[0])
    assert largest_turning(Curve(points), window) == pytest.approx(41 * 2 * np.pi / 720)
    assert largest_turning(Curve(points), 1e4) == pytest.approx(2 * np.pi)


def test_turning_of_corners_within_a_window():
    steps = Curve(np.array([[0, 0], [100, 0], [100, 10], [200, 10]], float), closed=False)
    assert largest_turning(steps, 9.9) == pytest.approx(np.pi / 2)
    assert largest_turning(steps, 10.0) == pytest.approx(np.pi)


def smoothed_by_half(seed, side):
    """A random closed curve, smoothed with what should halve its turning; what is true of every result.

    Segments of d / 4 turn by up to 1.25 κ_max d within d. A radius of d is enough where that halves the turning. It
    may not be where the region is too narrow for the radius or a point stays held; then segments are halved.
    """
    points = jagged(seed)
    turning = largest_turning(Curve(points), BEAD)
    limit = min(1.0, 0.39 * turning) / BEAD
    result = smooth(flat(Curve(points)), side, limit, window=BEAD)
    if result.layers[0].largest_turning > 0.5 * turning:
        assert result.layers[0].eased or result.layers[0].unfinished
        result = smooth(flat(Curve(divided(points, SPACING / 2))), side, limit, window=BEAD)
    smoothed, (figures,) = only(result.toolpath).points, result.layers
    if side:
        assert beyond(points, smoothed, side) == 0.0
    assert shapely.LinearRing(smoothed).is_simple
    assert largest_turning(Curve(smoothed), BEAD) <= 0.5 * turning
    assert not figures.left_alone
    reached = max([limit, *(to for _, to in figures.eased)])
    assert (curvature(smoothed).max() > reached * (1 + 1e-9)) == bool(figures.unfinished)
    return figures


@pytest.mark.parametrize("seed", range(25))
def test_the_locked_side_is_never_entered_and_turning_halves(seed):
    smoothed_by_half(seed, (-1, 1, 0)[seed % 3])


@pytest.mark.soak
def test_the_locked_side_of_a_thousand_curves():
    figures = [smoothed_by_half(seed, 1 if seed // 2 % 2 else -1) for seed in range(1000)]
    assert sum(bool(figure.unfinished) for figure in figures) < 20
    assert sum(bool(figure.eased) for figure in figures) < 20


@pytest.mark.parametrize("side", [-1, 1])
def test_flipped_fillets_stay_on_their_side_where_the_steps_alone_do_not(side):
    crossed = 0
    for seed in range(12):
        points = new = jagged(seed)
        count = len(points)
        for _ in range(30):  # the steps alone: above they are shown to be the paper's
            new = (
                new
                + displacements(new, *linked(count), side, (0.5, 0.05), np.full(count, 1 / BEAD), False)[0]
            )
        crossed += beyond(points, only(flat(Curve(new))).points, side) > 1.0
        room = [np.concatenate([a, np.full(count, -2)]) for a in linked(count)]
        moved = np.vstack([points, np.zeros((count, 2))])
        relax(
            moved, *room, np.zeros(2 * count, int), np.zeros(2 * count, bool), np.zeros(2 * count),
            np.full(2 * count, 1 / BEAD), count, side, (0.5, 0.05), SPACING, 1e-9, 30, False,
        )  # fmt: skip
        assert not np.array_equal(moved[:count], points)
        assert beyond(points, moved[:count], side) == 0.0
        assert shapely.LinearRing(moved[:count]).is_simple
    assert crossed


def test_a_curve_that_bends_gently_stays_the_same_object():
    curve = Curve(ring(100.0, 200))
    toolpath = flat(curve, Curve(jagged(1) + [600.0, 0.0]))
    result = smooth(toolpath, 1, 1 / BEAD)
    assert result.toolpath.layers[0].curves[0] is curve
    assert result.toolpath.layers[0].curves[1] is not toolpath.layers[0].curves[1]
    assert smooth(flat(curve), 1, 1 / BEAD).toolpath.layers[0].curves[0] is curve


@pytest.mark.parametrize("side", [-1, 0, 1])
def test_a_square_gets_the_radius_asked_for_and_straight_parts_stay(side):
    square = only(resample(flat(Curve(np.array([[0, 0], [200, 0], [200, 200], [0, 200.0]]))), 2.0))
    result = smooth(flat(square), side, 1 / BEAD)
    smoothed = only(result.toolpath)
    assert curvature(smoothed.points).max() <= (1 + 1e-9) / BEAD
    assert result.layers[0].remaining == 0
    old = {tuple(p) for p in square.points}
    middle = [tuple(p) in old for p in smoothed.points if 75 < p[0] < 125 or 75 < p[1] < 125]
    assert len(middle) == 4 * 24 + 4 or all(middle)
    if side == 1:  # inwards: no less than the corner beyond an arc of the radius, cut off four times
        assert result.layers[0].area_change < -(4 - np.pi) * BEAD**2 * 0.9
    if side == -1:
        assert result.layers[0].area_change > 0


def test_figures_are_those_of_the_curves():
    points = jagged(2)
    result = smooth(flat(Curve(points)), 1, 1 / BEAD, window=BEAD)
    smoothed, figures = only(result.toolpath), result.layers[0]
    assert figures.largest_turning_before == largest_turning(Curve(points), BEAD)
    assert figures.largest_turning == largest_turning(smoothed, BEAD)
    assert figures.largest_curvature == curvature(smoothed.points).max()
    assert figures.area_change == pytest.approx(smoothed.signed_area - Curve(points).signed_area)
    lines = shapely.LinearRing(points), shapely.LinearRing(smoothed.points)
    assert figures.largest_displacement == pytest.approx(shapely.hausdorff_distance(*lines))


@pytest.mark.parametrize("side", [-1, 0, 1])
@pytest.mark.parametrize("seed", range(10))
def test_what_lies_in_a_zone_is_the_same_to_the_bit(seed, side):
    points = jagged(seed)
    curve = Curve(points, width=np.linspace(10.0, 12.0, len(points)))
    center = points[len(points) // 3]
    zone = shapely.Point(center).buffer(30.0)
    zones = Zones(polygons=[zone])
    (flags,) = zones.protected(flat(curve))[0]
    assert 4 < flags.sum() < len(points)
    smoothed = only(smooth(flat(curve), side, 1 / BEAD, locked=zones).toolpath)
    kept = {(*p, w) for p, w in zip(smoothed.points, smoothed.width, strict=True)}
    assert kept >= {(*p, w) for p, w in zip(points[flags], curve.width[flags], strict=True)}
    inside = [shapely.intersection(zone, shapely.LinearRing(p)) for p in (points, smoothed.points)]
    assert shapely.equals(*inside)
    assert inside[0].length == pytest.approx(inside[1].length, abs=1e-9)
    if side:
        assert beyond(points, smoothed.points, side) == 0.0


def test_locked_layers_and_curves_are_the_same_objects():
    one, two = Curve(jagged(0)), Curve(jagged(1) + [700.0, 0.0])
    toolpath = replace(flat(one), layers=(layer_of(one, two), layer_of(one, two, height=20.0)))
    after = smooth(toolpath, 0, 1 / BEAD, locked=Zones(layers=[0], curves=[(1, 1)])).toolpath
    assert after.layers[0] is toolpath.layers[0]
    assert after.layers[1].curves[1] is two
    assert after.layers[1].curves[0] is not one


@pytest.mark.parametrize("side", [-1, 0, 1])
def test_open_curves_keep_their_ends_and_their_side(side):
    rng = np.random.default_rng(5)
    for _ in range(5):
        x = np.arange(0.0, 300.0, SPACING)
        points = np.column_stack([x, rng.uniform(-6, 6, len(x))])
        before = largest_turning(Curve(points, closed=False), BEAD)
        smoothed = only(smooth(flat(Curve(points, closed=False)), side, 0.6 / BEAD, window=BEAD).toolpath)
        assert not smoothed.closed
        assert np.array_equal(smoothed.points[[0, -1]], points[[0, -1]])
        assert largest_turning(smoothed, BEAD) < 0.7 * before
        far = [[x[-1], 1e3 * side], [0.0, 1e3 * side]]  # what is permitted, closed far away
        if side:
            ways = [np.vstack([p, far])[::side] for p in (points, smoothed.points)]
            assert beyond(*ways, 1) == 0.0


def test_neighbours_do_not_come_to_touch():
    outer = jagged(8)
    outline = shapely.buffer(shapely.Polygon(outer), -1.0, join_style="mitre")
    inner = shapely.get_coordinates(max(shapely.get_parts(outline), key=shapely.area).exterior)[:-1]
    walls = resample(flat(Curve(outer), Curve(inner[::-1])), 3.0, corner_deg=20.0)
    for side in (-1, 0, 1):
        after = smooth(walls, side, 1 / BEAD, steps=100).toolpath.layers[0].curves
        lines = [np.vstack([c.points, c.points[:1]]) for c in after]
        assert shapely.MultiLineString(lines).is_simple
        assert shapely.contains(*(shapely.Polygon(line) for line in lines))


def test_a_region_too_narrow_for_the_radius_is_left_alone():
    slit = resample(flat(Curve(np.array([[0, 0], [100, 0], [100, 3], [0, 3.0]]))), 1.0)
    result = smooth(slit, 1, 1 / BEAD)
    assert result.toolpath is slit
    assert result.layers[0].left_alone == (0,)
    assert result.layers[0].remaining > 0


def test_a_curve_without_room_for_the_radius_gets_the_next_that_fits():
    room = np.array([[-54, 24], [-53, -49], [10, 60], [53, 80], [29, 90.0]])
    points = divided(room, BEAD / 8)
    radius = shapely.length(shapely.maximum_inscribed_circle(shapely.Polygon(room)))
    result = smooth(flat(Curve(points), Curve(ring(100.0, 250) + 300.0)), 1, 1 / (1.05 * radius), window=BEAD)
    (figures,) = result.layers
    smoothed = result.toolpath.layers[0].curves[0].points
    ((curve, limit),) = figures.eased
    assert curve == 0
    assert 1 / radius < limit <= 2 / (1.05 * radius)
    assert curvature(smoothed).max() <= limit * (1 + 1e-9)
    assert figures.remaining > 0
    assert (figures.left_alone, figures.unfinished) == ((), ())
    assert beyond(points, smoothed, 1) == 0.0


@pytest.mark.parametrize("width", [0.5, 1.0, 1.5, 2.5])
def test_a_blunt_tip_is_rounded_though_its_end_is_shorter_than_a_segment(width):
    notch = [[-15, 0], [-width / 2, -60], [width / 2, -60 - width / 2], [15, 0]]
    block = np.array([[-150, 0], *notch, [150, 0], [150, -200], [-150, -200]])
    points = divided(block, SPACING)[::-1]
    result = smooth(flat(Curve(points)), 1, 1 / BEAD, window=BEAD)
    (figures,) = result.layers
    assert (figures.eased, figures.left_alone, figures.unfinished, figures.remaining) == ((), (), (), 0)
    assert beyond(points, only(result.toolpath).points, 1) == 0.0


def test_curves_that_steps_do_not_suffice_for_are_named():
    straight, bent = Curve(ring(100.0, 250)), Curve(divided(jagged(2), SPACING) + [900.0, 0.0])
    result = smooth(flat(straight, bent), -1, 1 / BEAD, steps=5)
    assert result.layers[0].unfinished == (1,)
    assert result.layers[0].steps == 5


def test_short_segments_collapse_and_long_ones_are_divided():
    points = jagged(0)
    new = only(smooth(flat(Curve(points)), -1, 1 / BEAD, min_segment=0.3 * SPACING).toolpath).points
    lengths = np.linalg.norm(np.roll(new, -1, axis=0) - new, axis=1)
    kept = {tuple(p) for p in points}
    moved = np.array([tuple(p) not in kept for p in new])
    assert lengths[moved & np.roll(moved, -1)].max() < 4 * SPACING


def test_no_steps_and_no_curves_change_nothing():
    points = np.zeros((8, 2))
    points[:6] = ring(10.0, 6)
    before, after = np.full(8, -2), np.full(8, -2)
    before[:6], after[:6] = linked(6)
    owner, still, value = np.zeros(8, int), np.zeros(8, bool), np.zeros(8)
    count, done, _ = relax(
        points, before, after, owner, still, value, np.ones(8), 6, 1, (1.0, 0.05), 10.0, 1.0, 5, True
    )
    assert (count, done) == (6, 0)
    empty = flat()
    assert smooth(empty, 1, 0.1).toolpath is empty


def test_layers_side_by_side_give_the_same():
    layers = tuple(layer_of(Curve(jagged(i)), height=10.0 * (i + 1)) for i in range(4))
    toolpath = Toolpath(Plane.horizontal(), layers, 10.0)
    shares = []
    one = smooth(toolpath, 1, 1 / BEAD, progress=shares.append)
    assert shares == [0.25, 0.5, 0.75, 1.0]
    with ThreadPoolExecutor(2) as pool:
        two = smooth(toolpath, 1, 1 / BEAD, executor=pool)
    assert one.layers == two.layers
    for (*_, a), (*_, b) in zip(one.toolpath.curves(), two.toolpath.curves(), strict=True):
        assert np.array_equal(a.points, b.points)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"side": 2}, "side must be 1"),
        ({"max_curvature": 0.0}, "largest curvature"),
        ({"max_curvature": np.nan}, "largest curvature"),
        ({"strength": 1.5}, "at most 1"),
        ({"steps": 0}, "number of steps"),
        ({"min_segment": -1.0}, "length of segments"),
        ({"window": 0.0}, "window"),
        ({"fillet": "round"}, "rolled"),
        ({"locked": Zones(layers=[3])}, "layer 3"),
    ],
)
def test_arguments_out_of_range(changes, message):
    with pytest.raises(ToolpathError, match=message):
        smooth(flat(Curve(ring(50, 60))), **({"side": 1, "max_curvature": 0.05} | changes))


def test_what_is_protected_and_sharp_keeps_nothing_else_from_being_rounded():
    # A square with a needle in a zone: its other corners are rounded all the same.
    corners = [[-100, -100], [100, -100], [100, 100], [2, 100], [0, 20], [-2, 100], [-100, 100]]
    square = Curve(divided(np.array(corners, dtype=float), 2.0))
    zone = Zones(polygons=[shapely.box(-60.0, 0.0, 60.0, 120.0)])
    result = smooth(flat(square), 1, 1.0 / 15.0, window=BEAD, locked=zone)
    smoothed = only(result.toolpath).points
    free = np.abs(smoothed[:, 0]) > 62.0
    assert curvature(smoothed)[free].max() <= 1.0 / 15.0 * (1 + 1e-9)
    assert not result.layers[0].left_alone
