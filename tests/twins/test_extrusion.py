"""M' and M_vis: what beads cover, by distances alone, and closed manifolds from any curves."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import SHAPES, fan_top, manifold_faults, printed_volume

from twins import (
    Curve,
    Layer,
    Plane,
    Toolpath,
    ToolpathError,
    bead_outlines,
    extrude,
    layer_planes,
    signed_volume,
    slice_surface,
)
from twins.extrusion import _layer_outlines, bead_region
from twins.visual import LEVELS, visual_mesh

BED = Plane.horizontal()


def ring(radius, center=(0.0, 0.0), points=60, clockwise=False):
    angle = 2 * np.pi * np.arange(points) / points
    circle = np.asarray(center) + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return circle[::-1] if clockwise else circle


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


def outlined_area(toolpath):
    return sum(curve.signed_area for *_, curve in toolpath.curves())


def beyond_beads(points, curves, width):
    """Distance of points from the rim of the nearest bead, negative inside, from the definition of a bead."""
    nearest = np.full(len(points), np.inf)
    for curve in curves:
        path, radii = curve.points, np.full(len(curve.points), width) if curve.width is None else curve.width
        if curve.closed:
            path, radii = np.vstack([path, path[:1]]), np.r_[radii, radii[:1]]
        for a, b, r, s in zip(path[:-1], path[1:], radii[:-1] / 2, radii[1:] / 2, strict=True):
            length = np.linalg.norm(b - a)
            along, taper = ((b - a) / length, (s - r) / length) if length else (np.array([1.0, 0.0]), 0.0)
            ahead, aside = (points - a) @ along, np.abs((points - a) @ [-along[1], along[0]])
            # The disc that comes nearest; where one end holds the other it is the larger of the two.
            lean = aside * taper / np.sqrt(1.0 - taper**2) if abs(taper) < 1.0 else np.sign(taper) * np.inf
            at = np.clip(ahead + lean, 0.0, length)
            gap = np.hypot(ahead - at, aside) - (r + taper * at if length else max(r, s))
            nearest = np.minimum(nearest, gap)
    return nearest


coordinates = st.tuples(st.floats(-60, 60), st.floats(-60, 60))


@st.composite
def scribbles(draw):
    """A curve that may cross itself, with or without widths of its own."""
    points = np.array(draw(st.lists(coordinates, min_size=3, max_size=12)))
    width = None
    if draw(st.booleans()):
        width = draw(st.lists(st.floats(2.0, 40.0), min_size=len(points), max_size=len(points)))
    return Curve(points, draw(st.booleans()), width)


@settings(max_examples=30, deadline=None)
@given(st.lists(scribbles(), min_size=1, max_size=2), st.integers(0, 2**32 - 1))
def test_beads_cover_what_is_within_half_a_width(curves, seed):
    width = 14.0
    region = bead_region(curves, width, 0.0)
    points = np.random.default_rng(seed).uniform(-85, 85, (400, 2))
    gap = beyond_beads(points, curves, width)
    widest = max([width, *(float(c.width.max()) for c in curves if c.width is not None)])
    covered = shapely.contains_xy(region, *points.T)
    # 0.2 % of a width for the chords of an arc; the steps of the reference are finer still.
    sure = np.abs(gap) > 2e-3 * widest + 1e-2
    assert (covered == (gap < 0))[sure].all()


@pytest.mark.parametrize("curve", [ring(100.0), ring(1000.0, points=630), ring(3.0, points=7)])
@pytest.mark.parametrize("own_width", [False, True])
def test_the_rim_of_a_bead_lies_half_a_width_from_its_curve(curve, own_width):
    width = 25.0
    bead = Curve(curve, width=np.full(len(curve), width) if own_width else None)
    rim = bead_region([bead], width, 0.0).boundary.segmentize(0.5)
    off = (
        shapely.distance(shapely.points(shapely.get_coordinates(rim)), shapely.LinearRing(curve)) - width / 2
    )
    assert np.abs(off).max() < 2e-3 * width


def test_a_tapering_bead_is_the_hull_of_its_end_discs():
    length, R, r = 80.0, 15.0, 5.0
    bead = Curve([[0.0, 0.0], [length, 0.0]], closed=False, width=[2 * R, 2 * r])
    tangent = np.arccos((R - r) / length)
    exact = np.sqrt(length**2 - (R - r) ** 2) * (R + r) + R**2 * (np.pi - tangent) + r**2 * tangent
    assert bead_region([bead], 1.0, 0.0).area == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize("own_width", [False, True])
def test_both_sides_of_rings_or_the_outer_side_alone(own_width):
    width, outer, inner = 20.0, 150.0, 90.0
    curves = [
        Curve(points, width=np.full(len(points), width) if own_width else None)
        for points in (ring(outer, points=300), ring(inner, points=300, clockwise=True))
    ]
    nominal = 7.0 if own_width else width  # must not matter where curves have widths of their own
    both = bead_outlines(stack(curves), nominal, 5.0)
    assert outlined_area(both) == pytest.approx(2 * np.pi * (outer + inner) * width, rel=2e-3)
    shell = bead_outlines(stack(curves), nominal, 5.0, side="outer")
    exact = np.pi * ((outer + width / 2) ** 2 - (inner - width / 2) ** 2)
    assert outlined_area(shell) == pytest.approx(exact, rel=2e-3)
    assert len(shell.layers[0].curves) == 2


def test_a_hole_narrower_than_the_bead_is_printed_over_by_the_outer_side():
    curves = [Curve(ring(80.0)), Curve(ring(8.0, points=20, clockwise=True))]
    assert len(bead_outlines(stack(curves), 20.0, 5.0, side="outer").layers[0].curves) == 1
    assert len(bead_outlines(stack(curves), 12.0, 5.0, side="outer").layers[0].curves) == 2


@pytest.mark.parametrize("gap", [0.0, 1e-9, 1e-4, 1e-2, -1e-9, -1e-2])
def test_beads_that_just_touch_are_one(gap):
    width = 20.0
    lines = [
        Curve([[0.0, k * (width + gap)], [150.0, k * (width + gap)]], closed=False, width=None)
        for k in range(4)
    ]
    rings = [Curve(ring(40.0, (300.0, 0.0))), Curve(ring(40.0, (400.0 + gap, 0.0)))]
    volume = extrude(stack(lines + rings, lines + rings), width)
    assert manifold_faults(volume) == (0, 0)
    assert volume.body_count == 2
    exact = 20.0 * (4 * 150 * width + 16 * (np.pi / 4) * width**2 / 4 + 2 * 2 * np.pi * 40 * width)
    assert signed_volume(volume) == pytest.approx(exact, rel=0.02)


@st.composite
def printable_stacks(draw):
    """Layers of rings, lines and scribbles, on a grid of the bead's width so that beads often just touch."""
    width = draw(st.sampled_from([8.0, 20.0, 25.0]))
    off = draw(st.sampled_from([0.0, 1e-9, -1e-9, 1e-6, 1e-3, -1e-3, 2e-2, 0.1]))
    layers = []
    for _ in range(draw(st.integers(1, 3))):
        curves = []
        for _ in range(draw(st.integers(0, 4))):
            kind = draw(st.sampled_from(["ring", "tiny", "grid", "scribble"]))
            if kind == "ring":
                radius = (width + off) * draw(st.sampled_from([0.5, 1.0, 1.5, 2.0]))
                center = (width + off) * np.array(draw(st.tuples(st.integers(-3, 3), st.integers(-3, 3))))
                curves.append(Curve(ring(radius, center, draw(st.integers(6, 50)))))
            elif kind == "tiny":
                curves.append(Curve(ring(draw(st.sampled_from([1e-4, 0.01, 1.0])), draw(coordinates), 6)))
            elif kind == "grid":
                steps = st.tuples(st.integers(-3, 3), st.integers(-3, 3))
                nodes = draw(st.lists(steps, min_size=2, max_size=8, unique=True))
                curves.append(Curve((width + off) * np.array(nodes), closed=False))
            else:
                curves.append(draw(scribbles()))
        layers.append(curves)
    return stack(*layers), width


@settings(max_examples=40, deadline=None)
@given(printable_stacks(), st.booleans())
def test_whatever_can_be_printed_gives_closed_manifolds(printable, rounded):
    toolpath, width = printable
    make = visual_mesh if rounded else extrude
    if not any(layer.curves for layer in toolpath.layers):
        with pytest.raises(ToolpathError, match="no curves"):
            make(toolpath, width)
        return
    volume = make(toolpath, width)
    assert manifold_faults(volume) == (0, 0)
    assert signed_volume(volume) > 0


@pytest.mark.parametrize(
    ("name", "rotary", "width"),
    [
        ("torus standing", False, 20.0),
        pytest.param("porous column", True, 25.0, marks=pytest.mark.soak),
        ("Y-branch", True, 30.0),
        ("nested cavity", True, 20.0),
    ],
)
def test_sliced_shapes_have_the_volume_of_their_outlines(name, rotary, width):
    surface = SHAPES[name]()
    top = fan_top(surface) if rotary else float(surface.vertices[:, 2].max())
    toolpath = slice_surface(surface, layer_planes(BED, top, 10.0))
    for side in ("both", "outer"):
        volume = extrude(toolpath, width, side=side)
        assert manifold_faults(volume) == (0, 0)
        beads = bead_outlines(toolpath, width, toolpath.thickness, side)
        assert signed_volume(volume) == pytest.approx(printed_volume(beads), rel=0.015)
    shown = visual_mesh(toolpath, width)
    assert manifold_faults(shown) == (0, 0)
    assert 0.8 < signed_volume(shown) / signed_volume(extrude(toolpath, width)) < 1.0
    last = toolpath.layers[-1].nozzle
    assert BED.height_of(np.asarray(shown.vertices)).min() > -1e-6
    assert last.height_of(np.asarray(shown.vertices)).max() < 1e-6


@pytest.mark.parametrize("width", [25.0, 6.0])
def test_flanks_are_half_circles_or_ellipses_with_a_line_between_layers(width):
    t = 10.0
    wall = [Curve([[0.0, 0.0], [200.0, 0.0]], closed=False)]
    shown = visual_mesh(stack(wall, wall, wall, thickness=t), width)
    x, y, z = np.asarray(shown.vertices).T
    bulge = 0.5 * min(t, 0.9 * width)
    for layer in range(3):
        for level in LEVELS:
            there = (np.abs(z - (layer + 0.5 + level / 2) * t) < 1e-9) & (np.abs(x - 100.0) < 90.0)
            inset = bulge * (1.0 - np.sqrt(1.0 - level**2))
            assert np.abs(y[there]).max() == pytest.approx(width / 2 - inset, rel=2e-3)
    on_line = (np.abs(z - t) < 1e-9) & (np.abs(x - 100.0) < 90.0)
    assert on_line.any()
    assert np.abs(y[on_line]).max() < width / 2 - 0.5 * bulge


def test_layers_of_M_vis_join_where_beads_rest_on_one_another_and_nowhere_else():
    def wall(y):
        return [Curve([[0.0, y], [200.0, y]], closed=False)]

    assert visual_mesh(stack(wall(0.0), wall(12.0), wall(24.0)), 25.0).body_count == 1
    assert visual_mesh(stack(wall(0.0), wall(24.0)), 25.0).body_count == 2


def test_an_executor_changes_nothing():
    toolpath = stack(*([Curve(ring(50.0 + i)), Curve(ring(30.0 + i, clockwise=True))] for i in range(4)))
    calls = pickle.loads(pickle.dumps((_layer_outlines, toolpath.layers[0].curves)))
    assert calls[0] is _layer_outlines
    with ThreadPoolExecutor(2) as executor:
        for make in (extrude, visual_mesh):
            alone, shared = make(toolpath, 12.0), make(toolpath, 12.0, executor=executor)
            assert np.array_equal(alone.vertices, shared.vertices)
            assert np.array_equal(alone.faces, shared.faces)


def test_what_cannot_be_extruded_is_refused_with_its_layer():
    circle, line = Curve(ring(30.0)), Curve([[0.0, 0.0], [50.0, 0.0]], closed=False)
    for make in (extrude, visual_mesh):
        with pytest.raises(ToolpathError, match="layer 1: an open curve"):
            make(stack([circle], [line]), 20.0, side="outer")
        with pytest.raises(ToolpathError, match="layer 0: curves cross or enclose nothing on their left"):
            make(stack([Curve(ring(30.0, clockwise=True))]), 20.0, side="outer")
        with pytest.raises(ToolpathError, match="layer 0: curves cross"):
            make(stack([circle, Curve(ring(30.0, (20.0, 0.0)))]), 20.0, side="outer")
        with pytest.raises(ToolpathError, match="'inner'"):
            make(stack([circle]), 20.0, side="inner")
        with pytest.raises(ToolpathError, match="width"):
            make(stack([circle]), float("nan"))
        with pytest.raises(ToolpathError, match="resolution"):
            make(stack([circle]), 20.0, -1.0)
        with pytest.raises(ToolpathError, match="no curves"):
            make(stack([], []), 20.0)
    for levels in ((), (0.5, 0.0), (-1.0, 0.0), (0.0, float("nan"))):
        with pytest.raises(ToolpathError, match="levels"):
            visual_mesh(stack([circle]), 20.0, levels=levels)
