"""Overhang: local on toolpaths and surfaces, global, and distributions, against closed forms and shapely."""

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from shapes import quads, rotated, sphere

from twins import (
    Curve,
    Layer,
    Plane,
    Toolpath,
    ToolpathError,
    custom_planes,
    layer_planes,
    make_surface,
    slice_surface,
)
from twins.errors import SurfaceError
from twins.overhang.balance import beam, global_overhang
from twins.overhang.distribution import Measured, overhang_distribution
from twins.overhang.local import lengths_at, local_overhang
from twins.overhang.supporters import closest_places, supporters_of
from twins.overhang.surfaces import surface_overhang

BED = Plane.horizontal()
T = 10.0


def ring(radius, center=(0.0, 0.0), points=360, turn=0.0):
    angle = 2 * np.pi * np.arange(points) / points + turn
    return Curve(np.asarray(center) + radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def line(a, b, points=121):
    return Curve(np.linspace(a, b, points), closed=False)


def square(half, center=(0.0, 0.0), steps=10):
    side = np.linspace(-half, half, steps, endpoint=False)
    flat = np.full(steps, half)
    return Curve(
        np.asarray(center)
        + np.concatenate([np.c_[side, -flat], np.c_[flat, side], np.c_[-side, flat], np.c_[-flat, -side]])
    )


def stack(*layers, planes=None):
    if planes is None:
        planes = layer_planes(BED, T * len(layers), T)
    made = [Layer(s, n, tuple(c)) for s, n, c in zip(planes.slicing, planes.nozzle, layers, strict=True)]
    return Toolpath(planes.base, tuple(made), planes.thickness)


def fan(radius, degrees, thickness=T):
    """Rotary planes about an axis parallel to y, `radius` beside the bed's origin."""
    a = np.radians(degrees)
    top = Plane(
        radius * np.array([np.cos(a) - 1.0, 0.0, np.sin(a)]),
        np.array([np.cos(a), 0.0, np.sin(a)]),
        np.array([0.0, 1.0, 0.0]),
    )
    return layer_planes(BED, top, thickness)


def moved(toolpath, R, shift):
    def plane(p):
        return Plane(R @ p.origin + shift, R @ p.x_axis, R @ p.y_axis)

    layers = tuple(Layer(plane(x.slicing), plane(x.nozzle), x.curves) for x in toolpath.layers)
    return Toolpath(plane(toolpath.base), layers, toolpath.thickness)


def tube(radius_at, place_at, rows, around=360):
    """A solid whose sections at parameters `rows` are circles, closed by fans."""
    angle = 2 * np.pi * np.arange(around) / around
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    rings = [place_at(w, radius_at(w) * circle) for w in rows]
    ends = [place_at(rows[i], np.zeros((1, 2))) for i in (0, -1)]
    index = np.arange(len(rows) * around).reshape(len(rows), around)
    low, high, n = index[0], index[-1], index.size
    caps = [
        np.column_stack([np.roll(low, -1), low, np.full(around, n)]),
        np.column_stack([high, np.roll(high, -1), np.full(around, n + 1)]),
    ]
    return make_surface(
        np.concatenate([*rings, *ends]), np.concatenate([quads(index[:-1], index[1:]), *caps])
    )


def revolved(radius_at, rows):
    return tube(radius_at, lambda z, uv: np.column_stack([uv, np.full(len(uv), z)]), rows)


def rows_between(low, high, step):
    """Heights with a row of facets centred at every multiple of `step`."""
    return np.r_[low, np.arange(np.floor(low / step) + 1, np.ceil(high / step)) * step - 0.5 * step, high]


# --- supporters -----------------------------------------------------------------------------------------------------

places = st.tuples(st.floats(-60, 60), st.floats(-60, 60))


@st.composite
def tangles(draw):
    """Several curves, open and closed, of up to a few hundred points, some repeated."""
    curves = []
    for _ in range(draw(st.integers(1, 4))):
        rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
        points = np.cumsum(rng.normal(size=(draw(st.integers(3, 200)), 2)) * draw(st.floats(0.1, 20)), axis=0)
        points[rng.random(len(points)) < 0.1] = points[0]
        curves.append(Curve(points, draw(st.booleans())))
    return curves


@settings(max_examples=40, deadline=None)
@given(tangles(), st.integers(0, 2**32 - 1))
def test_the_closest_place_is_on_the_segment_named_and_as_far_as_shapely_says(curves, seed):
    points = np.random.default_rng(seed).uniform(-100, 100, (150, 2))
    distances, before, after, shares, found = closest_places(points, curves)
    row = np.concatenate([c.points for c in curves])
    lines = shapely.MultiLineString(
        [np.vstack([c.points, c.points[:1]]) if c.closed else c.points for c in curves]
    )
    exact = shapely.distance(shapely.points(points), lines)
    assert distances == pytest.approx(exact, abs=1e-9)
    assert np.linalg.norm(points - found, axis=1) == pytest.approx(exact, abs=1e-9)
    assert found == pytest.approx(row[before] + shares[:, None] * (row[after] - row[before]), abs=1e-9)
    ends = np.cumsum([len(c.points) for c in curves])
    assert (np.searchsorted(ends, before, side="right") == np.searchsorted(ends, after, side="right")).all()


def test_arcs_restore_the_circle_that_was_sampled_but_leave_corners_and_lines():
    angle = np.random.default_rng(1).uniform(0, 2 * np.pi, 500)
    for radius, off in ((150.0, 2.0), (40.0, -3.0)):
        points = (radius + off) * np.column_stack([np.cos(angle), np.sin(angle)])
        coarse = [ring(radius, points=int(2 * np.pi * radius / 10))]
        assert np.abs(closest_places(points, coarse)[0] - abs(off)).max() > 0.02 * abs(off)
        assert closest_places(points, coarse, arcs=True)[0] == pytest.approx(abs(off), rel=0.01)
    points = np.random.default_rng(2).uniform(-50, 50, (300, 2))
    for curve in (square(30.0), square(30.0, steps=1), line((-20.0, 0.0), (30.0, 10.0))):
        assert closest_places(points, [curve], arcs=True)[0] == pytest.approx(
            closest_places(points, [curve])[0], abs=1e-9
        )


# --- local overhang, against closed forms (bar 4) -------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [5.0, 30.0, 60.0])
@pytest.mark.parametrize("arcs", [False, True])
def test_of_a_sliced_cone_is_its_slope(degrees, arcs):
    slope = np.tan(np.radians(degrees))
    surface = revolved(lambda z: 40.0 + slope * z, [0.0, 60.0, 100.0])
    toolpath = slice_surface(surface, layer_planes(BED, 100.0, T), T if arcs else 1.0)
    for reference in ("ground", "layer"):
        ratios = local_overhang(toolpath, reference, arcs=arcs).ratios
        assert (ratios[0][0] == 0.0).all()
        for (above,) in ratios[1:]:
            assert above == pytest.approx(slope, rel=0.01)


@pytest.mark.parametrize("arcs", [False, True])
def test_of_a_sliced_sphere_is_the_offset_of_consecutive_circles(arcs):
    R = 150.0
    rows = R - R * np.cos(np.linspace(0.03, np.pi - 0.03, 500))
    surface = revolved(lambda z: np.sqrt(z * (2 * R - z)), rows)
    lift = rows[0]
    planes = layer_planes(Plane.horizontal(lift), rows[-1] - lift, T)
    toolpath = slice_surface(surface, planes, T if arcs else 1.0)
    heights = lift + planes.thickness * (np.arange(len(planes)) + 0.5)
    circles = np.sqrt(heights * (2 * R - heights))
    exact = np.abs(np.diff(circles)) / planes.thickness
    for (above,), value in zip(local_overhang(toolpath, arcs=arcs).ratios[1:], exact, strict=True):
        assert above == pytest.approx(value, rel=0.01, abs=1e-3)


def test_of_a_rotary_torus_quarter_by_ground_and_by_layer():
    R, r, planes = 300.0, 60.0, fan(300.0, 88.0)
    toolpath = stack(*([ring(r, points=720)] for _ in range(len(planes))), planes=planes)
    phi, delta = 2 * np.pi * np.arange(720) / 720, np.radians(88.0) / len(planes)
    ground, layer = local_overhang(toolpath, "ground"), local_overhang(toolpath, "layer")
    for k in range(1, len(planes)):
        # In the section across the axis: straight down from angle theta to theta - delta.
        theta = (k + 1) * delta
        rho = R + r * np.cos(phi)
        lower = rho * np.cos(theta) / np.cos(theta - delta)
        drop = rho * np.sin(theta) - lower * np.sin(theta - delta)
        exact = np.abs(np.hypot(lower - R, r * np.sin(phi)) - r) / drop
        assert ground.ratios[k][0] == pytest.approx(exact, rel=0.01, abs=1e-3)
        assert layer.ratios[k][0] == pytest.approx(0.0, abs=1e-9)


def test_of_a_rotary_horn_by_layer_is_the_step_of_its_radius():
    R, planes = 300.0, fan(300.0, 60.0)
    radii = 40.0 + 3.0 * np.arange(len(planes))
    toolpath = stack(*([ring(r, points=720)] for r in radii), planes=planes)
    delta, phi = np.radians(60.0) / len(planes), 2 * np.pi * np.arange(720) / 720
    for r, (above,) in zip(radii[1:], local_overhang(toolpath, "layer").ratios[1:], strict=True):
        assert above == pytest.approx(3.0 / ((R + r * np.cos(phi)) * np.sin(delta)), rel=0.01)


def midway(toolpath, overhang, reference, surface, values):
    """Toolpath values and those of the face nearest to the middle between each point and its supporter."""
    tree = cKDTree(np.asarray(surface.vertices)[surface.faces].mean(axis=1))
    mine, theirs = [], []
    for k in range(1, len(toolpath.layers)):
        below = supporters_of(toolpath, k, reference, arcs=True)
        points = toolpath.layers[k].nozzle.to_world(
            np.concatenate([c.points for c in toolpath.layers[k].curves])
        )
        middle = 0.5 * (points + toolpath.floor_of(k).to_world(below.places))
        mine += list(overhang.ratios[k])
        theirs.append(values[tree.query(middle)[1]])
    return np.concatenate(mine), np.concatenate(theirs)


@pytest.mark.parametrize("name", ["cone", "sphere", "vase"])
def test_mesh_and_toolpath_agree_midway_between_layers(name):
    radius = {
        "cone": lambda z: 250.0 - 0.7 * z,
        "sphere": lambda z: np.sqrt(150.0**2 - (z - 150.0) ** 2),
        "vase": lambda z: 120.0 + 60.0 * np.sin(2 * np.pi * z / 400.0 + 0.6),
    }[name]
    low, high = 20.0, 280.0
    rows = rows_between(low, high, T / 3)
    surface = revolved(radius, rows)
    planes = layer_planes(Plane.horizontal(low), high - low, T)
    toolpath = slice_surface(surface, planes)
    overhang = local_overhang(toolpath, arcs=True)
    # The nozzle runs half a layer above the place where the surface is cut.
    lifted = make_surface(np.asarray(surface.vertices) + [0, 0, T / 2], surface.faces)
    for reference in ("layer", "ground"):
        measured = surface_overhang(surface, planes, reference)
        assert measured.values == pytest.approx(surface_overhang(surface, reference=reference).values)
        mine, theirs = midway(toolpath, overhang, "ground", lifted, measured.values)
        flat = theirs <= np.tan(np.radians(60.0))
        assert mine[flat] == pytest.approx(theirs[flat], rel=0.02, abs=2e-3)


@pytest.mark.parametrize(("reference", "growth"), [("ground", 0.0), ("ground", 0.2), ("layer", 0.2)])
def test_mesh_and_toolpath_agree_on_rotary_layers(reference, growth):
    R, planes = 400.0, fan(400.0, 45.0)

    def place_at(a, uv):
        x = R + uv[:, 0]
        return np.column_stack([x * np.cos(a) - R, uv[:, 1], x * np.sin(a)])

    def radius(a):
        return 60.0 + growth * R * a

    delta = np.radians(45.0) / len(planes)
    rows = np.arange(-2, 3 * len(planes) + 4) * delta / 3 - delta / 6
    surface = tube(radius, place_at, rows, 720)
    toolpath = slice_surface(surface, planes)
    overhang = local_overhang(toolpath, reference, arcs=True)
    values = surface_overhang(surface, planes, reference).values
    # The nozzle runs half a layer further round the axis.
    turn = Rotation.from_rotvec([0.0, -delta / 2, 0.0]).as_matrix()
    turned = (np.asarray(surface.vertices) + [R, 0, 0]) @ turn.T - [R, 0, 0]
    printed = make_surface(turned, surface.faces)
    if reference == "ground":
        # Gravity does not turn with it.
        back = Plane(
            turn @ (planes.base.origin + [R, 0, 0]) - [R, 0, 0], turn @ planes.base.x_axis, planes.base.y_axis
        )
        ahead = layer_planes(back, toolpath.layers[-1].nozzle, planes.thickness)
        values = surface_overhang(printed, ahead, reference).values
    mine, theirs = midway(toolpath, overhang, reference, printed, values)
    some = theirs <= np.tan(np.radians(60.0))
    assert some.mean() > 0.6
    # A facet stands for half a degree of the circle: sin(0.25°) is its own error.
    assert mine[some] == pytest.approx(theirs[some], rel=0.02, abs=5e-3)


def quarter(R, r, thickness, points=360):
    """A torus quarter by ground: its toolpath's values, those of faces tangent to the torus midway, and the rest.

    Midway is halfway round the axis and halfway round the section, from each sample point to its supporter.

    Returns:
        both values; tilt of the layer's plane, and the angle that the section turns on the way down, degrees.
    """
    planes = fan(R, 88.0, thickness)
    toolpath = stack(*([ring(r, points=points)] for _ in range(len(planes))), planes=planes)
    delta, phi = np.radians(88.0) / len(planes), 2 * np.pi * np.arange(points) / points
    theta = (np.arange(1, len(planes)) + 1)[:, None] * delta
    lower = (R + r * np.cos(phi)) * np.cos(theta) / np.cos(theta - delta)
    ahead = (np.arctan2(r * np.sin(phi), lower - R) - phi + np.pi) % (2 * np.pi) - np.pi
    f = (phi + 0.5 * ahead).ravel()
    a = np.broadcast_to(theta - 0.5 * delta, ahead.shape).ravel()
    none = np.zeros(len(a))
    outwards, onwards = np.c_[np.cos(a), none, np.sin(a)], np.c_[-np.sin(a), none, np.cos(a)]
    y = np.array([0.0, 1.0, 0.0])
    spot = outwards * (R + r * np.cos(f))[:, None] + r * np.sin(f)[:, None] * y - [R, 0.0, 0.0]
    around = np.cos(f)[:, None] * y - np.sin(f)[:, None] * outwards
    corners = [spot + 0.01 * (np.cos(c) * around + np.sin(c) * onwards) for c in 2 * np.pi * np.arange(3) / 3]
    faces = make_surface(np.stack(corners, 1).reshape(-1, 3), np.arange(3 * len(a)).reshape(-1, 3))
    theirs = surface_overhang(faces, planes, "ground").values
    mine = local_overhang(toolpath, "ground").values[points:]
    return mine, theirs, np.degrees(a + 0.5 * delta), np.degrees(np.abs(ahead)).ravel()


@pytest.mark.parametrize("R", [300.0, 400.0])
def test_mesh_and_toolpath_part_on_the_rotary_quarter_only_where_the_wall_turns_on_the_way_down(R):
    mine, theirs, tilt, turn = quarter(R, 60.0, T)
    # The wall's lean is at most the tilt of its plane: here are all walls that lean by 60° at most, and more.
    assert turn[tilt <= 65.0].max() < 22.5
    for same in (tilt <= 65.0, turn <= 22.5):
        assert mine[same] == pytest.approx(theirs[same], rel=0.02, abs=1e-3)
    # Steeper, they part by what the law says, until the way leads past the middle of the tube.
    near = turn <= 90.0
    law = theirs / np.cos(np.radians(0.5 * turn))
    assert mine[near] == pytest.approx(law[near], rel=0.002, abs=1e-3)
    assert (mine / np.maximum(theirs, 1e-9))[near].max() > 1.3


def test_mesh_and_toolpath_agree_on_all_of_the_rotary_quarter_in_thin_layers():
    mine, theirs, tilt, _ = quarter(150.0, 60.0, 0.5, 120)
    assert tilt.max() == pytest.approx(88.0)
    assert theirs.max() > np.sin(np.radians(87.5))
    assert mine == pytest.approx(theirs, rel=0.02, abs=1e-3)


# --- local overhang, laws -------------------------------------------------------------------------------------------


def test_turning_part_and_gravity_together_changes_nothing():
    planes = fan(300.0, 40.0)
    rng = np.random.default_rng(5)
    toolpath = stack(
        *(
            [ring(40 + 3 * k, rng.normal(size=2) * 4, 90), line((-9, k), (20, 5), 20)]
            for k in range(len(planes))
        ),
        planes=planes,
    )
    R, shift = Rotation.random(None, np.random.default_rng(3)).as_matrix(), np.array([50.0, -20.0, 300.0])
    there = moved(toolpath, R, shift)
    for reference in ("ground", "layer"):
        here = local_overhang(toolpath, reference)
        assert local_overhang(there, reference, R @ [0, 0, -2.0]).values == pytest.approx(
            here.values, abs=1e-9
        )
    assert np.array_equal(local_overhang(toolpath, "layer", [0.3, 0.1, -1]).values, here.values)
    still, turned = global_overhang(toolpath, 20.0), global_overhang(there, 20.0, R @ [0, 0, -1.0])
    for i in range(len(planes)):
        assert turned.distances[i] == pytest.approx(still.distances[i], abs=1e-6)
        assert turned.centres[i] == pytest.approx(still.centres[i] @ R.T + shift, abs=1e-6)


def test_curves_support_what_they_enclose_does_not():
    toolpath = stack([ring(100.0)], [ring(100.0), ring(20.0)], [line((0.0, 0.0), (20.0, 0.0), 3)])
    ratios = local_overhang(toolpath).ratios
    assert ratios[1][0] == pytest.approx(0.0, abs=1e-9)
    assert ratios[1][1] == pytest.approx(80.0 / T, rel=1e-3)
    assert ratios[2][0] == pytest.approx([2.0, 1.0, 0.0], abs=1e-3)


def test_nothing_below_is_no_support():
    overhang = local_overhang(stack([ring(50.0)], [], [ring(50.0)], [ring(50.0)]))
    assert [len(layer) for layer in overhang.ratios] == [1, 0, 1, 1]
    assert np.isposinf(overhang.ratios[2][0]).all()
    assert overhang.ratios[3][0] == pytest.approx(0.0, abs=1e-12)
    assert overhang.maximum == np.inf
    assert local_overhang(stack([], [])).maximum == 0.0


def test_weights_are_lengths_and_worst_places_are_apart():
    toolpath = stack([ring(50.0)], [ring(56.0, (3.0, 0.0))], [ring(50.0, (3.0, 0.0)), line((0, 0), (90, 0))])
    overhang = local_overhang(toolpath)
    assert overhang.total == pytest.approx(toolpath.length)
    assert lengths_at(line((0, 0), (10, 0), 3)) == pytest.approx([2.5, 5.0, 2.5])
    found = overhang.worst(6, apart=30.0)
    assert found[0].ratio == overhang.maximum
    assert [p.ratio for p in found] == sorted((p.ratio for p in found), reverse=True)
    spots = np.array([p.place for p in found])
    assert (np.linalg.norm(spots[:, None] - spots, axis=2) + 1e3 * np.eye(len(spots)) > 30.0).all()
    for p in found:
        layer = toolpath.layers[p.layer]
        assert p.ratio == overhang.ratios[p.layer][p.curve][p.point]
        assert p.place == pytest.approx(layer.nozzle.to_world(layer.curves[p.curve].points[[p.point]])[0])
    # What is left is near one of them, or no worse.
    far = (np.linalg.norm(overhang.places[:, None] - spots, axis=2) > 30.0).all(axis=1)
    assert overhang.values[far].max(initial=0.0) <= found[-1].ratio


def test_mistakes_are_told():
    toolpath = stack([ring(50.0)], [ring(50.0)])
    with pytest.raises(ToolpathError, match="not by 'air'"):
        local_overhang(toolpath, "air")
    with pytest.raises(ToolpathError, match="zero vector"):
        local_overhang(toolpath, gravity=(0, 0, 0))
    with pytest.raises(ToolpathError, match="layer 0: gravity does not meet"):
        local_overhang(toolpath, gravity=(1, 0, 0))
    assert local_overhang(toolpath, "layer", (1, 0, 0)).maximum < 1e-12
    tilted = Plane([0.0, 0.0, 12.0], [1.0, 0.0, 1.0], [0.0, 1.0, 0.0])
    crossing = custom_planes(BED, [BED, BED], [Plane.horizontal(10.0), tilted])
    with pytest.raises(ToolpathError, match=r"layer 1, curve 1: at \(-49.*not above"):
        local_overhang(stack([ring(1.0)], [ring(1.0), ring(70.0, points=4)], planes=crossing))
    with pytest.raises(ToolpathError, match="at least 0 mm"):
        local_overhang(toolpath).worst(apart=float("nan"))
    for width in (0.0, float("nan"), -1.0):
        with pytest.raises(ToolpathError, match="width"):
            global_overhang(toolpath, width)


# --- surfaces -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [20.0, 45.0, 70.0])
def test_a_spheres_area_within_an_overhang_goes_by_its_sine(degrees):
    # Archimedes: a zone's area goes by its height.
    ball, limit = sphere(subdivisions=5), np.tan(np.radians(degrees))
    both, below = surface_overhang(ball), surface_overhang(ball, side="below")
    assert both.share_above(limit) == pytest.approx(1 - np.sin(np.radians(degrees)), abs=0.01)
    assert below.share_above(limit) == pytest.approx((1 - np.sin(np.radians(degrees))) / 2, abs=0.01)
    assert both.quantile(np.sin(np.radians(degrees))) == pytest.approx(limit, rel=0.03)


def test_faces_on_the_bed_are_carried_and_flat_ones_above_are_not():
    block = make_surface(*box_of(100.0, 60.0, 40.0))
    over = surface_overhang(block)
    assert over.weights.sum() == pytest.approx(2 * (100 * 60 + 100 * 40 + 60 * 40))
    assert over.maximum == surface_overhang(block, side="below").maximum == 0.0
    lifted = layer_planes(Plane.horizontal(-10.0), 50.0, T)
    for side in ("below", "both"):
        assert surface_overhang(block, lifted, side=side).above(1e6) == pytest.approx(100 * 60)


@pytest.mark.parametrize("planes", [None, layer_planes(Plane.horizontal(), 100.0, T)])
def test_flat_tops_do_not_count_and_ledges_do_with_both_sides(planes):
    block, tower = (
        trimesh.creation.box(bounds=[[-x, -40, z], [x, 40, z + h]]) for x, z, h in ((60, 0, 40), (30, 40, 60))
    )
    stairs = trimesh.boolean.union([block, tower], engine="manifold")
    stairs = make_surface(stairs.vertices, stairs.faces)
    assert surface_overhang(stairs, planes, side="below").maximum == 0.0
    assert surface_overhang(stairs, planes).above(1e6) == pytest.approx(60 * 80)
    # Slices agree: the tower's first curve has the block's for a neighbour below, 30 beside it.
    toolpath = slice_surface(stairs, layer_planes(BED, 100.0, T))
    assert local_overhang(toolpath).maximum == pytest.approx(30.0 / T, rel=0.02)


def box_of(x, y, z):
    corners = np.array([[i, j, k] for k in (0, z) for j in (0, y) for i in (0, x)], float)
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return corners, np.array([t for a, b, c, d in faces for t in ([a, b, c], [a, c, d])])


def test_the_build_direction_turns_along_the_part():
    planes = fan(300.0, 60.0)

    def place_at(a, uv):
        x = 300.0 + uv[:, 0]
        return np.column_stack([x * np.cos(a) - 300.0, uv[:, 1], x * np.sin(a)])

    surface = tube(lambda _: 50.0, place_at, np.linspace(0.0, np.radians(60.0), 61), 90)
    side = slice(0, 2 * 60 * 90)
    over = surface_overhang(surface, planes)
    centre = np.asarray(surface.vertices)[surface.faces].mean(axis=1)
    angle = np.arctan2(centre[:, 2], centre[:, 0] + 300.0)
    exact = np.column_stack([-np.sin(angle), np.zeros(len(angle)), np.cos(angle)])
    assert over.directions == pytest.approx(exact, abs=1e-4)
    assert over.values[side].max() < 0.02
    # Its ends lie on the bed and in the top plane.
    assert (over.values[side.stop :] == 0.0).all()
    assert surface_overhang(surface).values[side].max() > 1.5


def test_turning_a_surface_with_gravity_changes_nothing():
    ball = rotated(make_surface(*box_of(80.0, 50.0, 30.0)), 4)
    R = Rotation.random(None, np.random.default_rng(8)).as_matrix()
    there = make_surface(np.asarray(ball.vertices) @ R.T, ball.faces)
    for side in ("both", "below"):
        here = surface_overhang(ball, side=side).values
        assert surface_overhang(there, side=side, gravity=-R[:, 2]).values == pytest.approx(here, rel=1e-6)


def test_surfaces_that_cannot_be_measured():
    block = make_surface(*box_of(1.0, 1.0, 1.0))
    with pytest.raises(SurfaceError, match="no faces"):
        surface_overhang(make_surface(np.zeros((0, 3)), np.zeros((0, 3), int)))
    with pytest.raises(SurfaceError, match="side"):
        surface_overhang(block, side="above")
    with pytest.raises(SurfaceError, match="'ground' or by 'layer'"):
        surface_overhang(block, reference="air")
    broken = make_surface(np.full((3, 3), np.nan), [[0, 1, 2]])
    with pytest.raises(SurfaceError, match="face 0"):
        surface_overhang(broken)


# --- distributions --------------------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0, 5) | st.just(np.inf), st.floats(0.01, 10)), min_size=1, max_size=40),
    st.floats(0, 6),
    st.floats(0, 1),
)
def test_shares_and_quantiles_say_the_same(pairs, limit, share):
    values, weights = np.array(pairs).T
    measured = Measured(values, weights)
    table = overhang_distribution(
        {"a": measured, "b": Measured(values * 2, weights)}, [0.0, limit + 0.5, 7.0, 20.0]
    )
    assert table.names == ("a", "b")
    assert (np.diff(table.shares, axis=1) >= 0).all()
    for at, have in zip(table.overhang, table.shares[0], strict=True):
        assert have == pytest.approx(weights[values <= at].sum() / weights.sum())
        assert 1.0 - have == pytest.approx(measured.share_above(at), abs=1e-12)
    for anywhere in (limit, -1.0, 1e9, *values):
        assert table.share_above(anywhere)["a"] == measured.share_above(anywhere)
    assert table.shares[0] == pytest.approx(
        overhang_distribution({"b": Measured(values * 2, weights)}, 2 * table.overhang).shares[0]
    )
    q = measured.quantile(share)
    assert weights[values <= q].sum() >= share * weights.sum() * (1 - 1e-9)
    assert weights[values < q].sum() <= share * weights.sum() * (1 + 1e-9)
    assert measured.quantile(1.0) == measured.maximum


def test_a_distribution_compares_toolpaths_and_surfaces():
    surface = revolved(lambda z: 40.0 + 0.5 * z, [0.0, 100.0])
    toolpath = slice_surface(surface, layer_planes(BED, 100.0, T))
    table = overhang_distribution(
        {"toolpath": local_overhang(toolpath), "surface": surface_overhang(surface)}
    )
    assert table.totals == pytest.approx([toolpath.length, surface.area])
    assert table.overhang[0] == 0.0
    assert table.overhang[-1] == pytest.approx(min(2.0, local_overhang(toolpath).maximum))
    assert overhang_distribution({"ball": surface_overhang(sphere())}).overhang[-1] == 2.0
    first = toolpath.layers[0].curves[0].length / toolpath.length
    assert table.share_above(0.45)["toolpath"] == pytest.approx(1 - first)
    with pytest.raises(ToolpathError, match="nan"):
        table.share_above(float("nan"))
    with pytest.raises(ToolpathError, match="at least one scheme"):
        overhang_distribution({})
    with pytest.raises(ToolpathError, match="ascend"):
        overhang_distribution({"a": local_overhang(toolpath)}, [1.0, 1.0])


# --- global overhang ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shift", [2.0, 5.0, 8.0])
def test_a_leaning_cylinder_topples_when_its_centre_leaves_its_base(shift):
    r, n = 40.0, 12
    over = global_overhang(stack(*([ring(r, (shift * k, 0.0))] for k in range(n))))
    leans = [shift * (0.5 * (n - 1 + k) - max(k - 1, 0)) for k in range(n)]
    for k, lean in enumerate(leans):
        # The centre of layers k to n - 1, seen from the middle of the circle that they rest on.
        assert over.distances[k][0] == pytest.approx(max(lean - r, 0.0), abs=0.02)
        assert over.centres[k][0] == pytest.approx(
            [shift * 0.5 * (n - 1 + k), 0.0, T * 0.5 * (n + k)], abs=1e-6
        )
    assert over.maximum == pytest.approx(max(*leans, r) - r, abs=0.02)


def test_a_bridge_is_shared_out_by_its_piers_and_nothing_is_lost():
    piers = [square(10.0, (-50.0, 0.0)), square(10.0, (50.0, 0.0))]
    for offset, width in ((0.0, None), (0.0, 12.0), (15.0, 12.0)):
        span = line((-60.0 + offset, 0.0), (60.0 + offset, 0.0), 242)
        toolpath = stack(piers, piers, [span])
        over = global_overhang(toolpath, width)
        breadth = 1.0 if width is None else width
        assert over.volumes[0].sum() == pytest.approx(breadth * T * toolpath.length)
        assert over.volumes[0].sum() == pytest.approx(over.volumes[1].sum() + 160 * breadth * T)
        if offset == 0.0:
            assert over.volumes[0] == pytest.approx(breadth * T * np.array([220.0, 220.0]))
            assert over.maximum == 0.0
        # Moments close as well.
        moment = (over.volumes[0][:, None] * over.centres[0]).sum(axis=0)
        exact = 320 * T * breadth * np.array([0, 0, T]) + 120 * T * breadth * np.array([offset, 0, 2.5 * T])
        assert moment == pytest.approx(exact, rel=1e-9, abs=1e-3)


def test_a_cantilever_topples_off_its_pier():
    pier, arm = square(10.0), line((-10.0, 0.0), (110.0, 0.0), 241)
    for width in (None, 12.0):
        half = 0.0 if width is None else width / 2
        over = global_overhang(stack([pier], [pier], [arm]), width)
        assert over.distances[2][0] == pytest.approx(50.0 - 10.0 - half)
        assert over.distances[0][0] == pytest.approx(120 * 50 / 280 - 10.0 - half)
        assert over.worst()[0] == (2, 0, over.distances[2][0])


def test_what_hangs_in_the_air_has_no_support():
    over = global_overhang(stack([ring(40.0)], [ring(40.0), ring(5.0)], [ring(40.0), ring(5.0)]), 20.0)
    assert over.distances[1] == pytest.approx([0.0, np.inf])
    assert over.distances[2] == pytest.approx([0.0, 0.0])
    assert over.volumes[0] == pytest.approx(20.0 * T * 3 * ring(40.0).length)
    assert np.isposinf(global_overhang(stack([], [ring(9.0)])).distances[1]).all()
    assert global_overhang(stack([], [])).maximum == 0.0


def test_widths_of_curves_weigh_and_reach():
    wide = Curve(ring(40.0).points, width=np.full(360, 30.0))
    toolpath = stack([wide], [ring(60.0)])
    assert np.isposinf(global_overhang(toolpath, 5.0).distances[1]).all()  # 20 apart, beads of 30 and 5
    over = global_overhang(toolpath, 12.0)
    assert over.distances[1] == pytest.approx([0.0])
    assert over.volumes[0] == pytest.approx(T * (30.0 * wide.length + 12.0 * ring(60.0).length))


@pytest.mark.parametrize("closed", [False, True])
def test_loose_points_hang_between_the_next_resting_ones_by_the_lever(closed):
    rng = np.random.default_rng(11)
    curve = Curve(np.cumsum(rng.normal(size=(60, 2)), axis=0), closed)
    ends = np.vstack([curve.points, curve.points[:1]])
    place = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(ends, axis=0), axis=1))]
    for rests in (rng.random(60) < 0.2, np.arange(60) == 17):
        loose, at = np.flatnonzero(~rests), np.flatnonzero(rests)
        for i, a, b, share in zip(loose, *beam(curve, rests), strict=True):
            if closed:
                back, ahead = ((i - a - 1) % 60) + 1, ((b - i - 1) % 60) + 1
                assert not rests[[(i - k) % 60 for k in range(back)]].any()
                assert not rests[[(i + k) % 60 for k in range(ahead)]].any()
                before, after = (place[i] - place[a]) % curve.length, (place[b] - place[i]) % curve.length
                assert before * (1 - share) == pytest.approx(after * share)
            elif i < at[0] or i > at[-1]:
                assert (a if share < 0.5 else b) == (at[0] if i < at[0] else at[-1])
                assert share in (0.0, 1.0)
            else:
                assert (a, b) == (at[at < i].max(), at[at > i].min())
                assert (1 - share) * place[a] + share * place[b] == pytest.approx(place[i])
