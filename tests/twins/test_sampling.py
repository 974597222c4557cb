import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from twins import ToolpathError
from twins.sampling import sample_layer, sample_layer_reporting
from twins.simplicity import are_apart


def ring(radius, count=2000, center=(0.0, 0.0), clockwise=False):
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    points = np.asarray(center) + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return points[::-1] if clockwise else points


def area(points):
    x, y = points.T
    return 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))


def steps(points):
    return np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)


def lines(curves):
    return shapely.MultiLineString([np.vstack([curve, curve[:1]]) for curve in curves])


def containment(curves):
    parts = [shapely.Polygon(curve) for curve in curves]
    return [[a is not b and a.contains(b) for b in parts] for a in parts]


def deviations(polygon, points):
    """Of every vertex of a polygon from the chord that spans it, with the chord's ends as places along the polygon."""
    closed = np.vstack([polygon, polygon[:1]])
    place = np.r_[0.0, np.cumsum(steps(polygon))]
    line = shapely.LineString(closed)
    # Where each sampled point lies along the polygon, found by shapely, not by the sampling itself.
    at = shapely.line_locate_point(line, shapely.points(points))
    first = int(np.argmin(at))
    at = np.roll(at, -first)
    points = np.roll(points, -first, axis=0)
    assert (np.diff(at) > 0).all()
    chord = np.searchsorted(at, place[:-1], side="right") - 1
    segments = shapely.linestrings(np.stack([points, np.roll(points, -1, axis=0)], axis=1))
    far = shapely.distance(shapely.points(polygon), segments[chord])
    middle = 0.5 * (at + np.r_[at[1:], at[0] + place[-1]])
    return far, middle[chord]


def curves_with_curvature(name, count=20000):
    t = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    if name == "ellipse":
        x, y = 150.0 * np.cos(t), 60.0 * np.sin(t)
        first, second = (-150.0 * np.sin(t), 60.0 * np.cos(t)), (-150.0 * np.cos(t), -60.0 * np.sin(t))
    else:
        lobes = 5 if name == "flower" else 17
        r, dr, ddr = 120.0 + 14.0 * np.cos(lobes * t), -14.0 * lobes * np.sin(lobes * t), 0.0
        ddr = -14.0 * lobes**2 * np.cos(lobes * t)
        c, s = np.cos(t), np.sin(t)
        x, y = r * c, r * s
        first = (dr * c - r * s, dr * s + r * c)
        second = (ddr * c - 2 * dr * s - r * c, ddr * s + 2 * dr * c - r * s)
    curvature = np.abs(first[0] * second[1] - first[1] * second[0]) / np.hypot(*first) ** 3
    return np.column_stack([x, y]), curvature


@pytest.mark.parametrize("name", ["ellipse", "flower", "many lobes"])
@pytest.mark.parametrize("resolution", [5.0, 10.0, 20.0])
def test_deviation_is_at_most_the_sagitta_of_the_analytic_radius(name, resolution):
    polygon, curvature = curves_with_curvature(name)
    (points,) = sample_layer([polygon], resolution)
    far, middle = deviations(polygon, points)
    place = np.r_[0.0, np.cumsum(steps(polygon))]
    total = place[-1]
    sharpest = np.empty(len(points))
    middles, index = np.unique(middle, return_inverse=True)
    sharpest = np.array(
        [
            curvature[
                np.abs((place[:-1] - m + total / 2) % total - total / 2) <= 0.5 * resolution + 1.0
            ].max()
            for m in middles
        ]
    )[index]
    allowed = np.maximum(resolution**2 / 8.0 * sharpest, 1e-3 * resolution)
    assert (far <= 1.001 * allowed).all()


@given(
    corners=st.integers(13, 300),
    radius=st.floats(20.0, 500.0),
    resolution=st.floats(2.0, 40.0),
    turned=st.floats(0.0, 1.0),
)
@settings(max_examples=60, deadline=None)
def test_regular_polygons_of_any_fineness_keep_the_bound(corners, radius, resolution, turned):
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False) + turned
    polygon = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    (points,) = sample_layer([polygon], resolution)
    edge = 2.0 * radius * np.sin(np.pi / corners)
    local_radius = edge / (2.0 * np.pi / corners)
    step = min(resolution, corners * edge / 6.0)
    bound = max(step**2 / (8.0 * local_radius), 1e-3 * step)
    far, _ = deviations(polygon, points)
    assert far.max() <= bound * (1 + 1e-9)
    assert steps(points).max() <= step * (1 + 1e-6)
    assert len(points) >= 6


@given(radii=st.lists(st.floats(40.0, 160.0), min_size=5, max_size=30), resolution=st.floats(3.0, 30.0))
@settings(max_examples=80, deadline=None)
def test_star_polygons_keep_corners_bound_and_turn(radii, resolution):
    angle = np.linspace(0.0, 2.0 * np.pi, len(radii), endpoint=False)
    polygon = np.asarray(radii)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    (points,) = sample_layer([polygon], resolution)
    before = polygon - np.roll(polygon, 1, axis=0)
    after = np.roll(before, -1, axis=0)
    cosine = (before * after).sum(axis=1) / np.linalg.norm(before, axis=1) / np.linalg.norm(after, axis=1)
    lone = np.minimum(np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)) > 0.25 * resolution
    corners = polygon[(cosine < np.cos(np.radians(30.01))) & lone]
    gaps = (
        np.linalg.norm(points[None] - corners[:, None], axis=2).min(axis=1) if len(corners) else np.zeros(1)
    )
    assert gaps.max() <= 1e-9
    assert steps(points).max() <= resolution * (1 + 1e-9)
    assert area(points) > 0
    assert lines([points]).is_simple
    # Between corners every vertex turns by less than 30 deg: even all of it within one chord stays below this.
    assert lines([points]).hausdorff_distance(lines([polygon])) <= resolution * np.radians(30.0) / 8.0 * 2.0


@given(
    seed=st.integers(0, 2**32 - 1),
    holes=st.integers(1, 8),
    resolution=st.sampled_from([2.0, 7.0, 20.0, 60.0]),
)
@settings(max_examples=60, deadline=None)
def test_simple_layers_stay_simple_nested_and_turned(seed, holes, resolution):
    rng = np.random.default_rng(seed)
    body = shapely.union_all([shapely.Point(p).buffer(r) for p, r in zip(
        rng.uniform(-100, 100, (6, 2)), rng.uniform(20, 80, 6), strict=True)])  # fmt: skip
    cuts = [shapely.Point(p).buffer(r, quad_segs=int(q)) for p, r, q in zip(
        rng.uniform(-120, 120, (holes, 2)), 10.0 ** rng.uniform(-2, 1.5, holes), rng.integers(1, 20, holes),
        strict=True)]  # fmt: skip
    region = shapely.difference(body, shapely.union_all(cuts))
    polygons = []
    for part in shapely.get_parts(region):
        oriented = shapely.geometry.polygon.orient(part)
        polygons += [np.asarray(r.coords)[:-1] for r in (oriented.exterior, *oriented.interiors)]
    if not lines(polygons).is_simple:
        return
    curves, dropped = sample_layer_reporting(polygons, resolution)
    kept = [p for i, p in enumerate(polygons) if i not in {loop.index for loop in dropped}]
    assert lines(curves).is_simple
    assert [np.sign(area(c)) for c in curves] == [np.sign(area(p)) for p in kept]
    assert containment(curves) == containment(kept)
    assert min(map(len, curves)) >= 6


def test_small_holes_behind_the_chords_stay_inside():
    # Each hole lies between the circle and where a chord of L_R would cut it off.
    outer = ring(100.0, 5000)
    holes = [
        ring(0.05, 40, 99.8 * np.array([np.cos(a), np.sin(a)]), clockwise=True) for a in np.arange(40) / 6.4
    ]
    curves = sample_layer([outer, *holes], 20.0)
    assert lines(curves).is_simple
    assert containment(curves) == containment([outer, *holes])


def test_walls_thinner_than_the_sagitta_do_not_cross():
    half_a_chord = np.radians(5.8)
    turn = np.array(
        [[np.cos(half_a_chord), -np.sin(half_a_chord)], [np.sin(half_a_chord), np.cos(half_a_chord)]]
    )
    polygons = [ring(100.0, 4001), ring(99.7, 3000, clockwise=True) @ turn]
    curves = sample_layer(polygons, 20.0)
    assert lines(curves).is_simple
    assert containment(curves) == containment(polygons)


@pytest.mark.parametrize("count", [300, 1000, 10000])
def test_smooth_fine_polygons_get_equal_segments_and_no_more_than_needed(count):
    (points,) = sample_layer([ring(160.0, count)], 10.0)
    assert steps(points).max() / steps(points).min() < 1.01
    assert len(points) <= 1.15 * (2.0 * np.pi * 160.0 / 10.0) + 1


def test_a_chamfer_is_kept_where_it_shows_and_one_corner_where_it_does_not():
    def chamfered(d):
        return np.array([[0.0, 0.0], [100.0 - d, 0.0], [100.0, d], [100.0, 100.0], [0.0, 100.0]])

    for d, shown in ((2.0, True), (0.05, False)):
        (points,) = sample_layer([chamfered(d)], 10.0)
        near = np.linalg.norm(points[:, None] - chamfered(d)[1:3], axis=2).min(axis=0) < 1e-9
        assert near.sum() == (2 if shown else 1)


def test_a_needle_is_kept_and_does_not_refine_its_neighbours():
    needle = np.array([[200.0, 0.0], [300.0, 0.0], [300.0, 1e-4]])
    circle, thin = sample_layer([ring(100.0, 5000), needle], 10.0)
    assert len(circle) <= 2.0 * np.pi * 100.0 / 10.0 * 1.05
    assert len(thin) >= 6
    assert area(thin) == pytest.approx(0.5 * 100.0 * 1e-4, rel=0.2)


def test_edges_shorter_than_rounding_make_no_corners():
    """A cut close to a vertex of a mesh leaves edges so short that their direction means nothing."""
    smooth = ring(160.0, 3000)
    rng = np.random.default_rng(2)
    at = np.unique(rng.integers(1, 3000, 40))
    specks = smooth[at - 1] + rng.uniform(-5e-6, 5e-6, (len(at), 2))
    (points,) = sample_layer([np.insert(smooth, at, specks, axis=0)], 10.0)
    assert steps(points).max() / steps(points).min() < 1.02


def test_noise_below_the_floor_is_not_followed():
    noise = np.random.default_rng(1).normal(0.0, 1e-5, (1, 400, 2))[0]
    side = np.linspace([0.0, 0.0], [100.0, 0.0], 100, endpoint=False)
    square = (
        np.concatenate([side, side[:, ::-1] + [100, 0], [100, 100] - side, [0, 100] - side[:, ::-1]]) + noise
    )
    (points,) = sample_layer([square], 10.0)
    assert len(points) <= 44


@pytest.mark.parametrize(
    ("polygon", "says"),
    [
        (np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 0.0]]), "fewer than 3"),
        (np.zeros((0, 2)), "fewer than 3"),
        (np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]]), "no area"),
        (np.array([[0.0, 0.0], [1e-6, 0.0], [0.0, 1e-6]]), "millionth"),
    ],
)
def test_what_cannot_be_kept_is_reported(polygon, says):
    curves, dropped = sample_layer_reporting([ring(50.0), polygon, ring(20.0, clockwise=True)], 10.0)
    assert len(curves) == 2
    assert [loop.index for loop in dropped] == [1]
    assert says in str(dropped[0])
    assert sample_layer([polygon], 10.0) == []


@pytest.mark.parametrize("scale", [1e-2, 1e-1, 1.0])
def test_small_loops_are_kept_with_six_points(scale):
    (points,) = sample_layer([scale * ring(1.0, 50, clockwise=True)], 10.0)
    assert len(points) >= 6
    assert area(points) == pytest.approx(-np.pi * scale**2, rel=0.2)


@pytest.mark.parametrize("resolution", [0.0, -1.0, np.nan, np.inf, 1e-9])
def test_useless_resolutions_are_refused(resolution):
    with pytest.raises(ToolpathError, match="resolution"):
        sample_layer([ring(100.0)], resolution)


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=3, max_size=9, unique=True))
@settings(max_examples=300, deadline=None)
def test_are_apart_never_certifies_what_touches(grid):
    """On a coarse grid most polygons touch or cross themselves exactly."""
    points = np.array(grid, dtype=np.float64)
    if are_apart(points, np.array([0, len(points)]), 1.5):
        assert lines([points]).is_simple


def test_are_apart_certifies_what_is_clearly_apart():
    curves = [ring(100.0, 300), ring(80.0, 200, clockwise=True), ring(3.0, 10)]
    starts = np.cumsum([0, *map(len, curves)])
    assert are_apart(np.concatenate(curves), starts, 2.0)
