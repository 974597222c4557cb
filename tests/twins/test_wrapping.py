import re

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from shapes import REFERENCE, SHAPES, fan_top, manifold_faults, vase_radius

from twincell.springer import springer_top
from twins import (
    Curve,
    Layer,
    Plane,
    PlanesError,
    Toolpath,
    ToolpathError,
    layer_planes,
    reconstruct,
    save_toolpath,
    save_unwrapped,
    signed_volume,
    slice_surface,
    unwrap,
)
from twins.formats.curves import read_curves, save_curves
from twins.wrapping.section_planes import find_sections
from twins.wrapping.space_curve import SpaceCurve
from twins.wrapping.wrapping import wrap

BED = Plane.horizontal()
CLOSE = 1e-6  # mm, and of unit vectors
STACKS = 67  # of each kind

PARTS = {**{name: make for name, make in REFERENCE.items() if name in ("springer", "layered tube")}, **SHAPES}


def in_space(plane, curve):
    return plane.to_world(curve.points)


def scattered(toolpath, at, rng, opened=False):
    """A toolpath's curves as a designer may hand them over, and the layer and curve that each is."""
    curves, names = [], []
    for i, j, layer, curve in toolpath.curves():
        points = in_space(getattr(layer, at), curve)
        closed = not (opened and rng.random() < 0.3)
        if closed:
            points = np.roll(points, rng.integers(len(points)), axis=0)
        curves.append(SpaceCurve(points[:: rng.choice([-1, 1])], closed))
        names.append((i, j))
    order = rng.permutation(len(curves))
    return [curves[k] for k in order], [names[k] for k in order]


def assert_same_plane(found, plane, places):
    assert np.abs(found.height_of(places) - plane.height_of(places)).max() < CLOSE
    assert np.abs(found.normal - plane.normal).max() < CLOSE


def assert_same_points(found, points, closed):
    if closed:
        found = np.roll(found, -int(np.linalg.norm(found - points[0], axis=1).argmin()), axis=0)
    assert np.abs(found - points).max() < CLOSE


def assert_same_toolpath(wrapped, names, toolpath):
    printed = [i for i, layer in enumerate(toolpath.layers) if layer.curves]
    assert len(wrapped.toolpath.layers) == len(printed)
    for i, layer, sources in zip(printed, wrapped.toolpath.layers, wrapped.sources, strict=True):
        true = toolpath.layers[i]
        assert sorted(names[k] for k in sources) == [(i, j) for j in range(len(true.curves))]
        places = np.concatenate([in_space(true.nozzle, curve) for curve in true.curves])
        assert_same_plane(layer.slicing, true.slicing, places)
        assert_same_plane(layer.nozzle, true.nozzle, places)
        for k, curve in zip(sources, layer.curves, strict=True):
            drawn = true.curves[names[k][1]]
            # In both planes: their frames belong together as those of the sliced layers do.
            for plane in ("slicing", "nozzle"):
                points = in_space(getattr(true, plane), drawn)
                assert_same_points(in_space(getattr(layer, plane), curve), points, curve.closed)
    floor = toolpath.floor_of(printed[0])
    assert_same_plane(wrapped.toolpath.base, floor, places)


def sliced(name, rotary):
    surface = PARTS[name]()
    top = springer_top() if name == "springer" else fan_top(surface)
    planes = layer_planes(BED, top if rotary else float(surface.vertices[:, 2].max()), 10.0)
    return slice_surface(surface, planes)


@pytest.mark.parametrize("rotary", [False, True])
@pytest.mark.parametrize("name", PARTS)
def test_scattered_curves_of_a_toolpath_wrap_to_that_toolpath(name, rotary):
    toolpath = sliced(name, rotary)
    rng = np.random.default_rng(len(name))
    for at, opened in (("nozzle", True), ("slicing", False)):
        curves, names = scattered(toolpath, at, rng, opened)
        wrapped = wrap(curves, at=at)
        assert wrapped.kind == ("rotary" if rotary else "parallel")
        assert_same_toolpath(wrapped, names, toolpath)


@pytest.mark.parametrize("ending", [".dxf", ".3dm", ".json", ".csv"])
def test_a_toolpath_comes_back_from_a_file_of_its_curves(ending, tmp_path):
    toolpath = sliced("springer", rotary=True)
    curves, names = scattered(toolpath, "nozzle", np.random.default_rng(0), opened=True)
    save_curves(curves, tmp_path / f"curves{ending}")
    assert_same_toolpath(wrap(read_curves(tmp_path / f"curves{ending}")), names, toolpath)


@pytest.mark.parametrize("rotary", [False, True])
def test_coordinates_that_were_rounded_do_no_harm(rotary):
    """The planes of rounded curves are as sure as the whole part tells, and not only as their own curves do."""
    toolpath = sliced("torus standing", rotary)
    curves, names = scattered(toolpath, "nozzle", np.random.default_rng(0))
    wrapped = wrap([SpaceCurve(np.round(curve.points, 4), curve.closed) for curve in curves])
    assert wrapped.kind == ("rotary" if rotary else "parallel")
    for layer, sources in zip(wrapped.toolpath.layers, wrapped.sources, strict=True):
        (number,) = {names[k][0] for k in sources}
        true = toolpath.layers[number].nozzle
        assert np.abs(layer.nozzle.normal - true.normal).max() < 1e-6
        places = np.concatenate([curves[k].points for k in sources])
        assert np.abs(layer.nozzle.height_of(places)).max() < 1e-4


@pytest.mark.parametrize("degrees", [80.0, 120.0, 170.0])
def test_a_fan_may_turn_beyond_a_right_angle(degrees):
    turns = Rotation.from_rotvec(np.outer(np.radians(np.linspace(0.0, degrees, 30)), [0.0, 1.0, 0.0]))
    axis = np.array([400.0, 0.0, 0.0])
    planes = [Plane(axis - R @ axis, R[:, 0], R[:, 1]) for R in turns.as_matrix()]
    order = np.random.default_rng(0).permutation(len(planes))
    wrapped = wrap([ring(planes[k], 0.0, 50.0) for k in order])
    assert [int(order[k]) for (k,) in wrapped.sources] == list(range(len(planes)))
    for layer, plane in zip(wrapped.toolpath.layers, planes, strict=True):
        assert np.abs(layer.nozzle.normal - plane.normal).max() < CLOSE


def test_a_given_bed_lends_its_frame():
    surface = SHAPES["torus lying"]()
    turned = Plane(np.array([5.0, -3.0, 0.0]), np.array([3.0, 4.0, 0.0]), np.array([-4.0, 3.0, 0.0]))
    for top in (90.0, fan_top(surface)):
        toolpath = slice_surface(surface, layer_planes(turned, top, 10.0))
        toolpath = type(toolpath)(turned, tuple(x for x in toolpath.layers if x.curves), toolpath.thickness)
        curves, names = scattered(toolpath, "nozzle", np.random.default_rng(0))
        wrapped = wrap(curves, bed=turned)
        assert_same_toolpath(wrapped, names, toolpath)
        assert wrapped.toolpath.thickness == pytest.approx(toolpath.thickness, rel=1e-9)
        for layer, true in zip(wrapped.toolpath.layers, toolpath.layers, strict=True):
            assert np.abs(layer.nozzle.origin - true.nozzle.origin).max() < CLOSE
            assert np.abs(layer.slicing.rotation - true.slicing.rotation).max() < CLOSE


@pytest.mark.parametrize("at", ["nozzle", "slicing"])
@pytest.mark.parametrize("rotary", [False, True])
def test_heights_in_a_file_tell_the_bed_and_layers_of_any_thickness(rotary, at, tmp_path):
    axis = np.array([400.0, 0.0, 0.0])
    planes = []
    for height in (
        0.0,
        1.5,
        3.0,
        7.5,
        12.0,
        16.5,
        21.0,
        23.5,
        26.0,
    ):  # bed, slicing, nozzle, slicing, nozzle …
        R = Rotation.from_rotvec([0.0, height / 400.0, 0.0]).as_matrix()
        planes.append(Plane(axis - R @ axis, R[:, 0], R[:, 1]) if rotary else Plane.horizontal(height))
    u, v = np.array([0.0, 60.0, 30.0]), np.array([0.0, 10.0, 50.0])
    drawn = (Curve(np.column_stack([u, v])), Curve(np.column_stack([u - 90.0, v])[:2], closed=False))
    layers = [Layer(*pair, drawn) for pair in zip(planes[1::2], planes[2::2], strict=True)]
    toolpath = Toolpath(planes[0], tuple(layers), 6.5)
    files = [tmp_path / f"curves.{ending}" for ending in ("json", "csv", "dxf")]
    for file in files:
        save_unwrapped(unwrap(toolpath, at), file)
    if at == "nozzle":
        files.append(tmp_path / "toolpath.json")
        save_toolpath(toolpath, files[-1])
    names = [(curve.layer, curve.curve) for curve in unwrap(toolpath)]
    for file in files:
        curves = read_curves(file)
        assert_same_toolpath(wrap(curves, at=at), names, toolpath)
        # What is given is not told.
        lower = wrap(curves, at=at, bed=Plane.horizontal(-7.0)).toolpath
        assert lower.base.origin[2] == -7.0
        again = [SpaceCurve(c.points, c.closed, c.widths, c.heights) for c in curves]
        save_curves(again, file.with_suffix(".again.json"))
        for a, b in zip(curves, read_curves(file.with_suffix(".again.json")), strict=True):
            assert np.array_equal(a.heights, b.heights)


def test_heights_that_tell_no_bed_are_refused():
    curve = ring(Plane.horizontal(10.0), 0.0, 30.0)
    said = SpaceCurve(curve.points, True, heights=np.where(np.arange(24) < 3, 5.0, 10.0))
    with pytest.raises(PlanesError, match=r"layer 0: the heights .* do not tell"):
        wrap([said])
    assert wrap([said], thickness=4.0).toolpath.base.origin[2] == pytest.approx(6.0)


def test_far_tilted_curves_have_their_frames_under_the_part():
    R = Rotation.from_rotvec([0.3, 0.2, 0.1]).as_matrix()
    far = np.array([9e5, -9e5, 9e5])
    curves = [SpaceCurve(ring(Plane.horizontal(z), 0.0, 50.0).points @ R.T + far) for z in (10, 20, 30)]
    toolpath = wrap(curves).toolpath
    assert np.linalg.norm(toolpath.base.origin - far) < 1e-3
    for _, _, layer, curve in toolpath.curves():
        assert np.abs(np.linalg.norm(curve.points, axis=1) - np.hypot(*curve.points.T)).max() < CLOSE
        assert np.abs(curve.points).max() < 51.0
        assert np.abs(layer.nozzle.normal - R[:, 2]).max() < CLOSE


def test_the_place_where_planes_cross_is_one_of_the_part():
    here = np.array([4000.0, -700.0, 90.0])
    curves = [ring(FLAT[0], 0.0, 60.0), ring(tilted_plane(15.0, 0.3), 0.0, 60.0)]
    curves = [SpaceCurve(curve.points + here) for curve in curves]
    with pytest.raises(PlanesError, match="cross or meet") as caught:
        wrap(curves)
    place = [float(word) for word in re.search(r"at \((.*?)\)", str(caught.value))[1].split(",")]
    points = np.concatenate([curve.points for curve in curves])
    nearest = np.linalg.norm(points - place, axis=1)
    assert nearest.min() < 1e-3
    # There the planes are in the wrong order: it lies where the upper one has come down through the lower one.
    assert place[0] < here[0] - 5.0 / np.tan(0.3) + 1e-3


def legs(*heights):
    """Rings on columns side by side."""
    return [ring(Plane.horizontal(z), [200.0 * k, 0.0], 30.0) for k, zs in enumerate(heights) for z in zs]


def test_columns_with_layers_of_their_own_are_not_interleaved():
    same = wrap(legs((10, 20, 30), (10, 20, 30), (10, 20)))
    assert [len(layer.curves) for layer in same.toolpath.layers] == [3, 3, 2]
    assert same.hanging == ()
    for heights in (((10, 20, 30), (12, 24, 36)), ((9, 20), (10, 21)), ((10, 20, 30), (15, 25), (12, 24))):
        with pytest.raises(PlanesError, match=r"under it, only layer .* layers of their own"):
            wrap(legs(*heights))
    # Layers in common: the last ring of the first column is not measured from the one below it, and is listed.
    assert wrap(legs((10, 20, 30, 40), (10, 20, 30, 35))).hanging == (3,)
    # A gap in the middle of a part is thick, but rests on what is below it.
    gap = wrap(legs((10, 20, 50, 60), (10, 20, 50, 60)))
    assert len(gap.toolpath.layers) == 4
    # Every second plane of the other column: it may be a tip that hangs down each time.
    coarse = wrap(legs((10, 20, 30, 40, 50), (20, 40)))
    assert coarse.hanging == (6,)


def test_closed_curves_turned_because_of_an_open_one_are_named():
    plane = Plane.horizontal(10.0)
    wall = SpaceCurve(plane.to_world(np.array([[-40.0, 0], [-40, 40], [40, 40], [40, 0]])), closed=False)
    outside = ring(plane, [100.0, 20.0], 9.0)
    column, hole = ring(plane, [0.0, 20.0], 9.0), ring(plane, [0.0, 20.0], 4.0)
    assert wrap([wall, outside, column, hole], thickness=5.0).by_open == (2, 3)
    whole = SpaceCurve(wall.points)
    assert wrap([whole, outside, column, hole], thickness=5.0).by_open == ()
    assert wrap([outside, column, hole], thickness=5.0).by_open == ()


def test_a_thousand_sections_are_found():
    curves = [ring(Plane.horizontal(z), 0.0, 30.0, 100).points for z in range(1000)]
    found = find_sections(curves, 1e-3)
    assert sorted(tuple(section.members) for section in found) == [(k,) for k in range(1000)]


def ring(plane, centre, radius, n=24, share=1.0, squash=0.7):
    t = 2.0 * np.pi * share * np.arange(n) / (n if share == 1.0 else n - 1)
    points = centre + radius * np.column_stack([np.cos(t), squash * np.sin(t)])
    return SpaceCurve(plane.to_world(points), closed=share == 1.0)


def random_planes(kind, count, rng):
    """Planes from the bed up, about 3 to 30 mm apart over a part within 150 mm of the z axis."""
    if kind == "parallel":
        return [Plane.horizontal(z) for z in np.cumsum(rng.uniform(3.0, 30.0, count))]
    if kind == "rotary":
        reach = rng.uniform(250.0, 2000.0)
        angles = np.cumsum(rng.uniform(6.0, 30.0, count)) / reach
        turns = [Rotation.from_rotvec([0.0, a, 0.0]).as_matrix() for a in angles]
        axis = np.array([reach, 0.0, 0.0])
        return [Plane(axis - R @ axis, R[:, 0], R[:, 1]) for R in turns]
    tilts = Rotation.from_rotvec(np.column_stack([rng.uniform(-0.03, 0.03, (count, 2)), np.zeros(count)]))
    heights = np.cumsum(rng.uniform(15.0, 40.0, count))
    return [
        Plane(np.array([0.0, 0.0, z]), R[:, 0], R[:, 1])
        for z, R in zip(heights, tilts.as_matrix(), strict=True)
    ]


def random_layer(plane, rng):
    """1 to 6 curves in their cells of a grid: rings, nested rings, open arcs, straight lines."""
    cells = rng.permutation(6)[: rng.integers(1, 7)]
    curves = []
    for k, cell in enumerate(cells):
        centre = np.array([(cell % 3 - 1) * 80.0, (cell // 3 - 0.5) * 80.0])
        what = rng.choice(["ring", "small", "arc", "line"]) if k else "ring"
        if what == "ring":
            curves.append(ring(plane, centre, rng.uniform(20.0, 35.0), rng.integers(5, 40)))
        elif what == "small":
            curves.append(ring(plane, centre, rng.uniform(0.5, 5.0), rng.integers(3, 9)))
        elif what == "arc":
            curves.append(ring(plane, centre, rng.uniform(5.0, 35.0), 12, rng.uniform(0.2, 0.9)))
        else:
            ends = centre + rng.uniform(-30.0, 30.0, (2, 2))
            curves.append(SpaceCurve(plane.to_world(ends), closed=False))
    if rng.random() < 0.3 and len(curves) < 6:  # a hole
        centre = np.array([(cells[0] % 3 - 1) * 80.0, (cells[0] // 3 - 0.5) * 80.0])
        curves.append(ring(plane, centre, 9.0))
    return curves


@pytest.mark.parametrize("kind", ["parallel", "rotary", "custom"])
def test_layers_of_random_stacks_are_found(kind):
    for seed in range(STACKS):
        rng = np.random.default_rng([len(kind), seed])
        planes = random_planes(kind, rng.integers(2, 12), rng)
        layers = [random_layer(plane, rng) for plane in planes]
        R, shift = Rotation.random(None, rng).as_matrix(), rng.uniform(-3000.0, 3000.0, 3)
        tagged = [(i, curve) for i, curves in enumerate(layers) for curve in curves]
        tagged = [tagged[k] for k in rng.permutation(len(tagged))]
        moved = [
            SpaceCurve((curve.points @ R.T + shift)[:: rng.choice([-1, 1])], curve.closed)
            for _, curve in tagged
        ]
        at = str(rng.choice(["nozzle", "slicing"]))
        wrapped = wrap(moved, at=at, up=R @ (0.0, 0.0, 1.0))
        found = [sorted(sources) for sources in wrapped.sources]
        assert found == [[k for k, (i, _) in enumerate(tagged) if i == n] for n in range(len(planes))], seed
        assert wrapped.kind == kind or len(planes) == 2, seed
        for plane, layer in zip(planes, wrapped.toolpath.layers, strict=True):
            places = plane.to_world(np.array([[-120.0, -80.0], [120.0, -80.0], [0.0, 80.0]])) @ R.T + shift
            assert np.abs(getattr(layer, at).height_of(places)).max() < CLOSE, seed
            assert np.abs(getattr(layer, at).normal - R @ plane.normal).max() < CLOSE, seed


@pytest.mark.parametrize(("apart", "layers"), [(0.019, 2), (0.021, 0), (0.039, 0), (0.041, 3)])
def test_a_tolerance_is_one_layer_up_to_twice_and_two_from_four_times(apart, layers):
    curves = [
        ring(Plane.horizontal(z), 0.0, r) for z, r in ((10.0, 50.0), (30.0, 40.0), (30.0 + apart, 60.0))
    ]
    if layers:
        assert len(wrap(curves, tolerance=0.01).toolpath.layers) == layers
    else:
        with pytest.raises(PlanesError, match=r"curve 1 and curve 2 are only 0\.\d* mm apart, too near"):
            wrap(curves, tolerance=0.01)


@pytest.mark.parametrize("seed", range(5))
def test_layers_are_found_in_single_precision(seed):
    rng = np.random.default_rng(seed)
    planes = random_planes("rotary", 10, rng)
    curves = [curve for plane in planes for curve in random_layer(plane, rng)]
    coarse = [SpaceCurve(np.float32(curve.points), curve.closed) for curve in curves]
    assert wrap(coarse).sources == wrap(curves).sources


def test_nested_curves_have_the_interior_on_their_left():
    plane = Plane.horizontal(10.0)
    radii = [40.0, 30.0, 20.0, 10.0]
    for share in (1.0, 0.8):
        rings = [ring(plane, 0.0, radius, share=share, squash=1.0) for radius in radii]
        rings = [SpaceCurve(curve.points[::-1], curve.closed) for curve in rings[::2]] + rings[1::2]
        (layer,) = wrap(rings, thickness=10.0).toolpath.layers
        for curve in layer.curves:
            assert curve.closed == (share == 1.0)
            x, y = curve.points.T
            area = 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))
            outer = np.linalg.norm(curve.points, axis=1).max() in (pytest.approx(40.0), pytest.approx(20.0))
            assert (area > 0) == outer


def test_open_curves_that_enclose_nothing_run_as_drawn():
    plane = Plane.horizontal(10.0)
    zigzag = np.column_stack([np.repeat([-9.0, 0.0, 9.0], 2), [-9.0, 9.0, 9.0, -9.0, -9.0, 9.0]])
    half = np.array(
        [[-40.0, 0.0], [-40.0, 40.0], [40.0, 40.0], [40.0, 0.0]]
    )  # its ends join through the ring
    line = np.array([[12.0, 0.0], [18.0, 3.0]])
    curves = [SpaceCurve(plane.to_world(points), closed=False) for points in (zigzag, half, line)]
    wrapped = wrap([ring(plane, 0.0, 30.0), *curves], thickness=10.0)
    (layer,) = wrapped.toolpath.layers
    assert wrapped.as_drawn == (1, 2, 3)
    for curve, points in zip(layer.curves[1:], (zigzag, half, line), strict=True):
        assert not curve.closed
        assert np.allclose(curve.points, points)


def test_widths_follow_their_points():
    plane = Plane.horizontal(10.0)
    points = ring(plane, 0.0, 30.0).points
    width = 20.0 + 0.1 * points[:, 0]
    (layer,) = wrap([SpaceCurve(points[::-1], True, width[::-1])], thickness=10.0).toolpath.layers
    (curve,) = layer.curves
    assert np.allclose(curve.width, 20.0 + 0.1 * layer.nozzle.to_world(curve.points)[:, 0])


def test_open_curves_with_near_ends_close():
    plane = Plane.horizontal(10.0)
    arc = ring(plane, 0.0, 30.0, 60, 0.99, 1.0)
    gap = float(np.linalg.norm(arc.points[0] - arc.points[-1]))
    for within, closed in ((None, False), (0.9 * gap, False), (1.1 * gap, True)):
        (layer,) = wrap([arc], thickness=10.0, close_within=within).toolpath.layers
        assert layer.curves[0].closed is closed
        assert len(layer.curves[0].points) == 60
    again = SpaceCurve(np.vstack([arc.points, arc.points[:1]]), closed=False)
    (layer,) = wrap([again], thickness=10.0).toolpath.layers
    assert layer.curves[0].closed
    assert len(layer.curves[0].points) == 60


def test_one_layer_takes_its_thickness_from_what_is_given():
    curve = [ring(Plane.horizontal(30.0), 0.0, 30.0)]
    for given in ({"thickness": 8.0}, {"bed": Plane.horizontal(22.0)}):
        path = wrap(curve, **given).toolpath
        assert path.thickness == pytest.approx(8.0)
        assert path.layers[0].slicing.origin[2] == pytest.approx(26.0)
    for given in ({"thickness": 8.0}, {"bed": Plane.horizontal(26.0)}, {"top": Plane.horizontal(34.0)}):
        path = wrap(curve, at="slicing", **given).toolpath
        assert path.thickness == pytest.approx(8.0)
        heights = [path.base.origin[2], path.layers[0].slicing.origin[2], path.layers[0].nozzle.origin[2]]
        assert heights == pytest.approx([26.0, 30.0, 34.0])


@pytest.mark.parametrize(("inner", "genus"), [(0, 0), (3, 0), (4, 1)])
@pytest.mark.parametrize("tilted", [False, True])
def test_four_sections_of_a_shell_become_a_closed_surface(inner, genus, tilted):
    """A solid vase, a cup whose lowest section has no hole, and a tube."""
    heights = np.array([20.0, 130.0, 260.0, 380.0])
    # Walls lean by less than their width from section to section, or M could not tell that they are one.
    radii = 120.0 + 0.25 * (vase_radius(heights) - 120.0)
    curves = []
    for k, (z, radius) in enumerate(zip(heights, radii, strict=True)):
        R = Rotation.from_rotvec([0.0, 0.1 * (k - 1.5) * tilted, 0.0]).as_matrix()
        plane = Plane(np.array([0.0, 0.0, z]), R[:, 0], R[:, 1])
        curves.append(ring(plane, 0.0, radius, 72, squash=1.0))
        if k >= 4 - inner:
            curves.append(ring(plane, 0.0, radius - 40.0, 72, squash=1.0))
    rng = np.random.default_rng(inner)
    curves = [SpaceCurve(curves[k].points[:: rng.choice([-1, 1])]) for k in rng.permutation(len(curves))]
    path = wrap(curves, at="slicing", thickness=2.0).toolpath
    assert [len(layer.curves) for layer in path.layers] == [1 + (k >= 4 - inner) for k in range(4)]
    surface = reconstruct(path, resolution=12.0)
    assert manifold_faults(surface) == (0, 0)
    assert surface.body_count == 1
    assert surface.euler_number == 2 - 2 * genus
    drawn = np.concatenate([curve.points for curve in curves])
    assert trimesh.proximity.closest_point(surface, drawn)[1].max() < 0.01
    if inner == 0 and not tilted:
        z = np.linspace(heights[0], heights[-1], 2000)
        frusta = np.pi * np.trapezoid(np.interp(z, heights, radii) ** 2, z)
        assert signed_volume(surface) == pytest.approx(frusta, rel=0.03)


FLAT = [Plane.horizontal(z) for z in (10.0, 20.0, 30.0)]
STACK = [ring(plane, 0.0, 30.0) for plane in FLAT]
EIGHT = SpaceCurve([[0, 0, 40], [50, 30, 40], [50, 0, 40], [0, 30, 40]])
SADDLE = SpaceCurve([[0, 0, 40], [50, 0, 41], [50, 50, 40], [0, 50, 41]])


def tilted_plane(height, angle):
    c, s = np.cos(angle), np.sin(angle)
    return Plane(np.array([0.0, 0.0, height]), np.array([c, 0.0, s]), np.array([0.0, 1.0, 0.0]))


AMBIGUOUS = {
    "none": ([], {}, "no curves"),
    "not a curve": ([*STACK, np.zeros((4, 3))], {}, "curve 3 must be a SpaceCurve"),
    "not planar": ([*STACK, SADDLE], {}, "curve 3 is not planar: its points lie up to 0.5 mm"),
    "a helix": (
        [SpaceCurve(ring(FLAT[0], 0.0, 30.0).points + np.outer(np.arange(24), [0, 0, 0.1]), closed=False)],
        {"thickness": 5.0},
        "curve 0 is not planar",
    ),
    "too near": (
        [*STACK, ring(Plane.horizontal(20.03), 0.0, 60.0)],
        {"tolerance": 0.01},
        "curve 1 and curve 3 are only 0.03 mm apart, too near",
    ),
    "straight in no plane": (
        [*STACK, SpaceCurve([[0, 0, 12], [50, 0, 12]], closed=False)],
        {},
        "curve 3 is straight, so it has no plane of its own, and lies in no layer's plane, by 2 mm",
    ),
    "straight in two planes": (
        [
            ring(FLAT[0], [-100.0, 0.0], 30.0),
            ring(tilted_plane(10.0, 0.3), [100.0, 0.0], 30.0),
            SpaceCurve([[0, -10, 10], [0, 40, 10]], closed=False),
        ],
        {},
        "curve 2 is straight.*lies in the planes of curves",
    ),
    "all straight": ([SpaceCurve([[0, 0, z], [50, 0, z]], closed=False) for z in (5, 10)], {}, "all curves"),
    "crossing in the part": (
        [ring(FLAT[0], 0.0, 60.0), ring(tilted_plane(15.0, 0.3), 0.0, 60.0)],
        {},
        "curve 0 and curve 1 cross or meet inside the part",
    ),
    "one layer": (STACK[:1], {}, "give a `bed` or a `thickness`"),
    "layers of their own": (
        [*STACK, *(ring(Plane.horizontal(z), [200.0, 0.0], 30.0) for z in (12, 24, 36))],
        {},
        r"layer 2 \(curve 1\) has nothing of layer 1 \(curve 3\) under it, only layer 0 \(curve 0\)",
    ),
    "parallel to up": (STACK, {"up": (0.0, 1.0, 0.0)}, r"curve \d is parallel to up"),
    "up is nothing": (STACK, {"up": (0.0, 0.0, 0.0)}, "up must be"),
    "up is not a number": (STACK, {"up": (0.0, np.nan, 1.0)}, "up must be"),
    "crosses itself": ([*STACK, EIGHT], {}, "layer 3: curve 3 touches or crosses itself"),
    "cross one another": (
        [*STACK, ring(FLAT[1], [30.0, 0.0], 30.0)],
        {},
        "layer 1: curves 1 and 3 cross",
    ),
    "drawn twice": ([*STACK, STACK[2]], {}, "layer 2: curves 2 and 3 lie on one another"),
    "bed above": (STACK, {"bed": Plane.horizontal(15.0)}, "layer 0 reaches 5 mm below the bed"),
    "bed upside down": (STACK, {"bed": Plane([0, 0, 0], [1, 0, 0], [0, -1, 0])}, "turn the bed over"),
    "top below": (
        STACK,
        {"at": "slicing", "top": Plane.horizontal(28.0)},
        "layer 2 reaches 2 mm above its top",
    ),
    "top of nozzle planes": (STACK, {"top": Plane.horizontal(50.0)}, "a top is for"),
    "at": (STACK, {"at": "middle"}, "not at 'middle'"),
    "negative thickness": (STACK, {"thickness": -1.0}, "`thickness` must be"),
    "tolerance is not a number": (STACK, {"tolerance": np.nan}, "`tolerance` must be"),
    "one place": ([SpaceCurve(np.ones((4, 3)))], {}, "the same place"),
    "a point": ([*STACK, SpaceCurve(np.ones((4, 3)))], {}, "curve 3 has too few different points"),
}


@pytest.mark.parametrize("case", AMBIGUOUS)
def test_what_cannot_be_told_is_named(case):
    curves, given, said = AMBIGUOUS[case]
    with pytest.raises((ToolpathError, PlanesError), match=said) as caught:
        wrap(curves, **given)
    assert "\n" not in str(caught.value)


def test_points_that_are_no_numbers_are_refused():
    points = STACK[0].points.copy()
    points[3, 1] = np.nan
    with pytest.raises(ToolpathError, match="finite"):
        SpaceCurve(points)
