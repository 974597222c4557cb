"""Predicates, 2D triangulation and overlay, against whole-number arithmetic and a general Delaunay code."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, Delaunay

from twins import ToolpathError
from twins.overlay import neighbours, overlay_tetrahedra, slab_between
from twins.predicates import in_circle, sign_of_sum, turn
from twins.triangulation import Lattice, region_of, triangulate

LATTICE = Lattice.around(np.full(2, -500.0), np.full(2, 500.0))

whole = st.integers(-(2**61), 2**61)
coordinate = st.integers(-(2**29), 2**29)


def sign(x):
    return (x > 0) - (x < 0)


def volumes(points, tets):
    a, b, c, d = (points[tets[:, k]] for k in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0


def stacked(lower, upper, height=10.0):
    return np.vstack([np.column_stack([p, np.full(len(p), z)]) for p, z in ((lower, 0.0), (upper, height))])


def wavy(n, radius, wave, phase, start=0.0):
    angle = 2 * np.pi * np.arange(n) / n + start
    return (radius + wave * np.sin(7 * angle + phase))[:, None] * np.column_stack(
        [np.cos(angle), np.sin(angle)]
    )


@settings(deadline=None)
@given(st.lists(whole, min_size=6, max_size=6))
def test_signs_of_sums_are_those_of_whole_numbers(x):
    assert sign_of_sum(*x) == sign(x[0] * x[1] + x[2] * x[3] + x[4] * x[5])


@settings(deadline=None)
@given(st.lists(whole, min_size=4, max_size=4), st.integers(-3, 3))
def test_signs_of_sums_that_nearly_cancel(x, rest):
    a, b, c, d = x
    assert sign_of_sum(a, b, -b, a, rest, 1) == sign(rest)
    assert sign_of_sum(a, b, c, d, -a, b) == sign(c * d)


@settings(deadline=None)
@given(st.lists(coordinate, min_size=8, max_size=8))
def test_turn_and_circle_are_those_of_whole_numbers(x):
    P = np.array(x).reshape(4, 2)
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = P.tolist()
    assert sign(turn(P, 0, 1, 2)) == sign((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
    rows = [(px - dx, py - dy, (px - dx) ** 2 + (py - dy) ** 2) for px, py in ((ax, ay), (bx, by), (cx, cy))]
    (a, b, c), (d, e, f), (g, h, i) = rows
    assert in_circle(P, 0, 1, 2, 3) == sign(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))


@pytest.mark.parametrize("seed", range(40))
def test_overlay_is_the_delaunay_of_both_layers(seed):
    rng = np.random.default_rng(seed)
    if seed % 2:
        lower, upper = (
            rng.random((rng.integers(4, 500), 2)) * 400,
            rng.random((rng.integers(4, 500), 2)) * 400,
        )
    else:
        count, other = rng.integers(20, 250, 2)
        lower = np.vstack([wavy(count, 200, 15, 0.1), wavy(count, 170, 15, 0.1)]) + rng.normal(
            0, 1e-3, (2 * count, 2)
        )
        upper = np.vstack([wavy(other, 196, 15, 0.2, 0.01), wavy(other, 166, 15, 0.2, 0.01)])
        upper += rng.normal(0, 1e-3, upper.shape)
    lower, upper = (np.round(points / LATTICE.unit) * LATTICE.unit for points in (lower, upper))
    tets, _ = overlay_tetrahedra(region_of(lower, LATTICE), region_of(upper, LATTICE))
    points = stacked(lower, upper)
    peer = Delaunay(points).simplices
    peer = peer[np.abs(volumes(points, peer)) > 1e-9]
    assert {tuple(sorted(t)) for t in tets.tolist()} == {tuple(sorted(t)) for t in peer.tolist()}
    assert (volumes(points, tets) > 0).all()
    assert volumes(points, tets).sum() == pytest.approx(ConvexHull(points).volume, rel=1e-9)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.5, 0.5), (0.5, 0.0), (1.0, 0.0), (0.25, 0.125)])
@pytest.mark.parametrize("layer", ["grid", "ring"])
def test_layers_that_tie_everywhere_fill_their_hull_without_flat_tetrahedra(layer, shift):
    grid = np.stack(np.meshgrid(np.arange(8.0), np.arange(8.0)), axis=-1).reshape(-1, 2)
    # Points on one circle, exactly: 5² + 0² = 3² + 4².
    ring = np.array(
        [[5, 0], [4, 3], [3, 4], [0, 5], [-3, 4], [-4, 3], [-5, 0], [-4, -3], [-3, -4], [0, -5], [3, -4]]
    )
    lower = grid if layer == "grid" else ring.astype(float)
    upper = lower + shift
    tets, _ = overlay_tetrahedra(region_of(lower, LATTICE), region_of(upper, LATTICE))
    points = stacked(lower, upper, 1.0)
    assert volumes(points, tets).min() > 1e-6
    assert volumes(points, tets).sum() == pytest.approx(ConvexHull(points).volume, rel=1e-12)
    across = neighbours(tets, len(points))
    for t, k in zip(*np.nonzero(across >= 0), strict=True):
        assert t in across[across[t, k]]


def test_equal_layers_are_joined_by_plain_prisms():
    curves = [wavy(60, 100, 12, 0.0), wavy(40, 60, 5, 0.0)[::-1]]
    region = triangulate(curves, LATTICE, 10.0, "layer 0")
    slab = slab_between(region, region)
    n = len(region)
    assert len(slab.tets) == 3 * len(region.triangles)
    assert slab.under.all()
    assert slab.over.all()
    prisms = {frozenset(t) for t in region.triangles.tolist()}
    assert {frozenset((t % n).tolist()) for t in slab.tets} == prisms


def test_a_region_is_the_exact_union_of_its_triangles():
    curves = [wavy(300, 150, 20, 0.0), wavy(150, 90, 10, 0.3)[::-1], wavy(50, 30, 2, 0.0)]
    region = triangulate(curves, LATTICE, 10.0, "layer 0")
    a, b, c = (region.points[region.triangles[:, k]] for k in range(3))
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert doubled.min() > 0
    shoelace = sum(x @ np.roll(y, -1) - y @ np.roll(x, -1) for x, y in (curve.T for curve in curves))
    assert doubled.sum() == pytest.approx(shoelace, rel=1e-12)


def test_no_point_lies_in_the_circle_over_a_segment():
    spike = np.array(
        [[0.0, 0.0], [100.0, 0.0], [100.0, 48.0], [5.0, 50.0], [100.0, 50.5], [100.0, 100.0], [0.0, 100.0]]
    )
    region = triangulate([spike], LATTICE, 10.0, "layer 0")
    P, after = region.diagram.P, region.diagram.following
    for i, j in enumerate(after):
        sees = ((P[i] - P) * (P[j] - P)).sum(axis=1)
        sees[[i, j]] = 1
        assert (sees > 0).all()
    # The new points lie on the segments.
    ring = np.vstack([spike, spike[:1]])
    gap = np.full(len(region), np.inf)
    for p, q in pairwise(ring):
        share = np.clip((region.points - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
        gap = np.minimum(gap, np.linalg.norm(p + share[:, None] * (q - p) - region.points, axis=1))
    assert gap.max() < 1e-9


@settings(deadline=None)
@given(st.integers(0, 2**32), st.integers(5, 60), st.integers(5, 60), st.sampled_from([1.0, 5.0, 20.0]))
def test_points_of_a_coarse_grid_in_any_order(seed, m, n, step):
    """Random subsets of a grid: collinear and cocircular points, hulls with long straight edges."""
    rng = np.random.default_rng(seed)
    layers = []
    for count in (m, n):
        cells = rng.choice(100, size=min(count, 90), replace=False)
        layers.append(np.column_stack([cells % 10, cells // 10]) * step)
    try:
        regions = [region_of(points, LATTICE) for points in layers]
    except ToolpathError:
        for points in layers:
            if np.linalg.matrix_rank(points - points[0]) < 2:
                return
        raise
    tets, _ = overlay_tetrahedra(*regions)
    points = stacked(*layers)
    assert volumes(points, tets).min() > 0
    assert volumes(points, tets).sum() == pytest.approx(ConvexHull(points).volume, rel=1e-9)
