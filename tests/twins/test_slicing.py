import numpy as np
import pytest
import shapely
import trimesh
from shapes import SHAPES, box, fan_top, nested_cavity, sphere, stepped_box, torus

from twins import (
    Plane,
    PlanesError,
    SurfaceError,
    custom_planes,
    layer_planes,
    make_surface,
    reconstruct,
    signed_volume,
    slice_surface,
)
from twins.cutter import SurfaceCutter
from twins.half_edges import opposite_half_edges
from twins.sampling import sample_layer
from twins.slicing import cut, slice_reporting

BED = Plane.horizontal()


def area(points):
    x, y = points.T
    return 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))


def turn(seed):
    return trimesh.transformations.random_rotation_matrix(np.random.default_rng(seed).random(3))[:3, :3]


def turned(plane, R):
    return Plane(R @ plane.origin, R @ plane.x_axis, R @ plane.y_axis)


def tilted(height, x_slope, y_slope=0.0, at=(0.0, 0.0)):
    return Plane(np.array([*at, height]), np.array([1.0, 0.0, x_slope]), np.array([0.0, 1.0, y_slope]))


def cuts(surface, planes):
    return SurfaceCutter(surface.vertices, surface.faces).cut(planes)


def section_area(surface, plane):
    """What trimesh finds."""
    section = surface.section(plane_origin=plane.origin, plane_normal=plane.normal)
    return section.to_2D(normal=plane.normal)[0].area if section is not None else 0.0


def parallel_stack(surface):
    return layer_planes(BED, float(surface.vertices[:, 2].max()), 21.0).slicing


def rotary_stack(surface):
    return layer_planes(BED, fan_top(surface), 30.0).slicing


def custom_stack(surface):
    """Planes that wobble by less than their distance allows within the part."""
    low, high = np.asarray(surface.vertices).min(axis=0), np.asarray(surface.vertices).max(axis=0)
    step = (high[2] - low[2]) / 12.0
    slopes = np.random.default_rng(0).uniform(-0.2, 0.2, (11, 2)) * step / (high - low)[:2]
    return [
        tilted(low[2] + (k + 1) * step, *slope, at=0.5 * (low + high)[:2]) for k, slope in enumerate(slopes)
    ]


@pytest.mark.parametrize("stack", [parallel_stack, rotary_stack, custom_stack])
@pytest.mark.parametrize("name", SHAPES)
def test_cuts_have_the_area_that_an_independent_slicer_finds(name, stack):
    surface = SHAPES[name]()
    planes = stack(surface)
    areas = [sum(map(area, polygons)) for polygons in cuts(surface, planes)]
    assert areas == pytest.approx([section_area(surface, plane) for plane in planes], rel=1e-6)
    assert sum(areas) > 0.0


@pytest.mark.parametrize("seed", range(12))
def test_a_torus_however_it_is_turned_has_the_area_that_an_independent_slicer_finds(seed):
    lying = torus(around=48, across=20)
    surface = make_surface(np.asarray(lying.vertices) @ turn(seed).T, lying.faces)
    low, high = np.asarray(surface.vertices)[:, 2].min(), np.asarray(surface.vertices)[:, 2].max()
    planes = [Plane.horizontal(z) for z in np.linspace(low - 5.0, high + 5.0, 14)]
    areas = [sum(map(area, polygons)) for polygons in cuts(surface, planes)]
    assert areas == pytest.approx([section_area(surface, plane) for plane in planes], rel=1e-6)


@pytest.mark.parametrize("stack", [parallel_stack, rotary_stack])
@pytest.mark.parametrize("name", SHAPES)
def test_polygons_turn_by_their_depth(name, stack):
    surface = SHAPES[name]()
    for polygons in cuts(surface, stack(surface))[::3]:
        regions = [shapely.Polygon(points) for points in polygons]
        for points in polygons:
            depth = sum(region.contains(shapely.Point(points[0])) for region in regions)
            assert np.sign(area(points)) == (1 if depth % 2 == 0 else -1)


@pytest.mark.parametrize("name", SHAPES)
def test_section_areas_integrate_to_the_volume(name):
    surface = SHAPES[name]()
    planes = layer_planes(BED, float(surface.vertices[:, 2].max()), 1.0)
    total = sum(area(p) for polygons in cut(surface, planes) for p in polygons) * planes.thickness
    assert total == pytest.approx(signed_volume(surface), rel=2e-3)


def test_planes_through_vertices_edges_and_faces():
    surface = stepped_box()
    heights = (0.0, 100.0, 200.0)
    flat = [Plane.horizontal(z) for z in heights]
    planes = custom_planes(Plane.horizontal(-1.0), flat, flat)
    areas = [sum(map(area, polygons)) for polygons in cut(surface, planes)]
    # A vertex in the plane counts as above it: each cut shows what is just below.
    assert areas == pytest.approx([0.0, 40000.0, 30000.0])


def test_a_plane_in_a_step_shows_what_is_just_below():
    planes = layer_planes(BED, 200.0, 200.0 / 19.0)
    assert len(planes) == 19
    heights = [plane.origin[2] for plane in planes.slicing]
    assert min(abs(z - 100.0) for z in heights) < 1e-12
    areas = [sum(map(area, polygons)) for polygons in cut(stepped_box(), planes)]
    assert areas == pytest.approx([40000.0 if z <= 100.0 else 30000.0 for z in heights])


def test_planes_that_miss_the_part_cut_nothing():
    cutter = SurfaceCutter(box().vertices, box().faces)
    assert cutter.cut([]) == []
    assert cutter.cut([Plane.horizontal(-1.0), Plane.horizontal(300.0)]) == [[], []]
    assert area(cutter.cut([Plane.horizontal(70.0)])[0][0]) == pytest.approx(40000.0)


def test_two_hundred_and_fifty_planes_through_bodies_and_cavities():
    surface = nested_cavity()
    heights = np.linspace(0.4, 199.6, 250)
    cuts_of = cuts(surface, [Plane.horizontal(z) for z in heights])
    expected = [1 + (abs(z - 100.0) < 60.0) + (abs(z - 100.0) < 25.0) for z in heights]
    assert [len(polygons) for polygons in cuts_of] == expected


@pytest.mark.parametrize("stack", [parallel_stack, rotary_stack, custom_stack])
def test_a_plane_is_cut_the_same_alone_and_in_a_stack(stack):
    surface = torus(standing=True)
    planes = stack(surface)
    for plane, polygons in zip(planes, cuts(surface, planes), strict=True):
        (alone,) = cuts(surface, [plane])
        assert len(alone) == len(polygons)
        for one, other in zip(alone, polygons, strict=True):
            assert np.array_equal(one, other)


def test_points_lie_on_the_edges_that_cross_the_plane():
    surface = sphere(subdivisions=2)
    planes = rotary_stack(surface)
    edges = np.asarray(surface.vertices)[surface.edges_unique]
    for plane, polygons in zip(planes, cuts(surface, planes), strict=True):
        height = plane.height_of(edges.reshape(-1, 3)).reshape(-1, 2)
        crossed = (height >= 0).any(axis=1) & (height < 0).any(axis=1)
        ends, rise = edges[crossed], height[crossed]
        share = rise[:, :1] / (rise[:, :1] - rise[:, 1:])
        expected = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
        found = [plane.to_world(points) for points in polygons]
        assert sum(map(len, found)) == len(expected)
        for points in found:
            assert np.abs(points[:, None] - expected).max(axis=2).min(axis=1).max() < 1e-9


def test_frames_need_not_be_orthonormal():
    surface = torus(standing=True)
    planes = rotary_stack(surface)
    cutter = SurfaceCutter(surface.vertices, surface.faces)
    rng = np.random.default_rng(1)
    skew = rng.uniform(-1.0, 1.0, (len(planes), 2, 2)) + 2.0 * np.eye(2)  # of positive determinant
    shift = rng.uniform(-50.0, 50.0, (len(planes), 2))
    axes = np.array([[plane.x_axis, plane.y_axis] for plane in planes])
    origins = np.array([plane.origin for plane in planes]) + np.einsum("ka,kai->ki", shift, axes)
    u, v = np.einsum("kba,kai->bki", skew, axes)
    for plane, polygons, straight, k in zip(
        planes, cutter.cut_frames(origins, u, v), cutter.cut(planes), range(len(planes)), strict=True
    ):
        assert len(polygons) == len(straight)
        for points, wanted in zip(polygons, straight, strict=True):
            world = origins[k] + points[:, :1] * u[k] + points[:, 1:] * v[k]
            assert np.abs(world - plane.to_world(wanted)).max() < 1e-9


def test_a_frame_with_parallel_axes_is_refused():
    cutter = SurfaceCutter(box().vertices, box().faces)
    with pytest.raises(PlanesError, match="slicing plane 1 has parallel axes"):
        cutter.cut_frames(np.zeros((2, 3)), np.eye(3)[[0, 0]], np.eye(3)[[1, 0]])


@pytest.mark.parametrize("surface", [sphere(), box()], ids=["a vertex between", "no vertex between"])
def test_planes_that_cross_inside_the_part_are_refused_with_the_place(surface):
    stack = [Plane.horizontal(40.0), tilted(100.0, 0.1), tilted(100.0, -0.1), Plane.horizontal(180.0)]
    with pytest.raises(PlanesError, match=r"layers 1 and 2 cross inside the part: at \(.*order the planes"):
        cuts(surface, stack)


def test_planes_in_the_wrong_order_are_refused():
    # Nothing of the part is below plane 1, so that plane 0 could be missed.
    with pytest.raises(PlanesError, match="layers 0 and 1"):
        cuts(box(), [Plane.horizontal(5.0), Plane.horizontal(-5.0)])


def test_planes_may_cross_outside_the_part_within_its_bounding_box():
    low = trimesh.creation.box(bounds=[[0, 0, 0], [200, 200, 100]])
    high = trimesh.creation.box(bounds=[[0, 0, 100], [100, 200, 200]])
    part = trimesh.boolean.union([low, high], engine="manifold")
    stack = [tilted(150.0, 0.0), tilted(150.0, -0.1, at=(150.0, 0.0))]
    areas = [sum(map(area, polygons)) for polygons in cuts(part, stack)]
    assert areas == pytest.approx([20000.0, 20000.0 * np.sqrt(1.01)])


def test_the_same_plane_twice_gives_the_same_cut_twice():
    first, second = cuts(torus(), [Plane.horizontal(40.0), Plane.horizontal(40.0)])
    assert len(first) == 2
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize("name", SHAPES)
def test_opposite_half_edges_run_against_each_other(name):
    faces = np.asarray(SHAPES[name]().faces)
    across = opposite_half_edges(faces, int(faces.max()) + 1)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    assert (across[across] == np.arange(len(across))).all()
    assert (start[across] == end).all()
    assert (end[across] == start).all()


def test_open_half_edges_have_no_opposite():
    faces = np.asarray(box().faces)
    across = opposite_half_edges(faces[1:], 8)
    assert (across < 0).sum() == 3
    assert across.min() == -1


def test_a_face_without_its_vertex_is_refused():
    with pytest.raises(SurfaceError, match=r"face 2 names the vertices \[0, 1, 8\]"):
        SurfaceCutter(box().vertices, np.vstack([box().faces[:2], [[0, 1, 8]]]))


def test_bodies_that_touch_in_an_edge_bound_no_solid():
    block, other = box(), box()
    apart = np.abs(np.asarray(other.vertices)[:, None] + [200.0, 200.0, 0.0] - block.vertices).max(axis=2)
    index = np.where(apart.min(axis=1) < 1e-9, apart.argmin(axis=1), 8 + np.arange(8))
    surface = make_surface(
        np.vstack([block.vertices, np.asarray(other.vertices) + [200.0, 200.0, 0.0]]),
        np.vstack([block.faces, index[other.faces]]),
    )
    planes = layer_planes(BED, 200.0, 50.0)
    assert [sum(map(area, polygons)) for polygons in cut(surface, planes)] == pytest.approx([80000.0] * 4)
    with pytest.raises(SurfaceError, match="1 edges have more than two faces"):
        slice_surface(surface, planes)


def test_interior_is_on_the_left():
    planes = layer_planes(BED, 200.0, 20.0)
    middle = slice_surface(nested_cavity(), planes).layers[5].curves
    assert sorted(np.sign([curve.signed_area for curve in middle])) == [-1.0, 1.0, 1.0]


def test_rotating_the_part_and_the_planes_rotates_nothing_in_the_frames():
    surface = sphere()
    planes = [Plane.horizontal(z) for z in np.arange(7.3, 300.0, 29.1)]  # no vertex lies in a plane
    R = turn(7)
    same = make_surface(np.asarray(surface.vertices) @ R.T, surface.faces)
    for before, after in zip(cuts(surface, planes), cuts(same, [turned(p, R) for p in planes]), strict=True):
        for one, other in zip(before, after, strict=True):
            assert np.abs(one - other).max() < 1e-9


def test_a_rotary_stack_reaches_the_whole_part():
    surface = sphere(60.0)
    planes = layer_planes(BED, fan_top(surface), 5.0)
    toolpath = slice_surface(surface, planes)
    counts = [len(layer.curves) for layer in toolpath.layers]
    assert max(counts) == 1
    assert sum(counts) > 10
    assert counts[-1] == 0  # the top plane lies above the part


def test_an_axis_through_the_part_is_refused_with_its_distance():
    tilted = Plane(np.array([80.0, 0.0, 0.0]), np.array([1.0, 0.0, -0.5]), np.array([0.0, 1.0, 0.0]))
    with pytest.raises(PlanesError, match=r"80 mm from the bed's origin"):
        slice_surface(sphere(), layer_planes(BED, tilted, 10.0))


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda v, f: (v, f[:-1]), "open: 1 hole: hole of 3 edges"),
        (lambda v, f: (v, f[:, ::-1]), "inside out"),
        (lambda v, f: (v, np.vstack([f, f[0]])), "not manifold"),
        (lambda v, f: (v, np.vstack([f[1:], f[0][::-1]])), "not consistently oriented"),
        (lambda v, f: (np.where(np.arange(len(v))[:, None] == 3, np.nan, v), f), "not a finite point"),
        (lambda v, f: (v[:0], f[:0]), "empty"),
    ],
)
def test_surfaces_that_bound_no_solid_are_refused(spoil, says):
    good = sphere(subdivisions=2)
    with pytest.raises(SurfaceError, match=says):
        slice_surface(
            make_surface(*spoil(np.asarray(good.vertices), np.asarray(good.faces))),
            layer_planes(BED, 300.0, 10),
        )


def test_sampling_keeps_corners_and_small_loops():
    square = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]])
    small = np.array([[10.0, 10.0], [10.0, 11.0], [11.0, 11.0], [11.0, 10.0]])
    first, second = sample_layer([square, small], 9.0)
    for corner in square:
        assert np.linalg.norm(first - corner, axis=1).min() < 1e-9
    steps = np.linalg.norm(np.roll(first, -1, axis=0) - first, axis=1)
    assert steps.max() / steps.min() < 1.01
    assert len(second) >= 6
    assert area(second) == pytest.approx(-1.0)


@pytest.mark.parametrize("resolution", [5.0, 10.0, 20.0])
def test_sampling_deviates_by_the_sagitta_of_a_segment(resolution):
    angle = np.linspace(0.0, 2.0 * np.pi, 20000, endpoint=False)
    circle = 100.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    (points,) = sample_layer([circle], resolution)
    middle = 0.5 * (points + np.roll(points, -1, axis=0))
    assert (100.0 - np.linalg.norm(middle, axis=1)).max() <= resolution**2 / 800.0 * 1.05


@pytest.mark.parametrize("near", [90.0, 240.0])
def test_a_plane_through_a_saddle_gives_curves_that_do_not_touch(near):
    surface = torus(standing=True)
    heights = np.unique(surface.vertices[:, 2])
    saddle = heights[np.argmin(np.abs(heights - near))]
    flat = [Plane.horizontal(z) for z in (saddle - 10.0, saddle, saddle + 10.0)]
    nozzle = [Plane.horizontal(z + 5.0) for z in (saddle - 10.0, saddle, saddle + 10.0)]
    toolpath, said = slice_reporting(surface, custom_planes(BED, flat, nozzle), 5.0)
    said = [remark for remark in said if "the top plane" not in remark]
    assert len(said) == 1
    assert "layer 1 is cut" in said[0]
    rings = [shapely.LinearRing(curve.points) for curve in toolpath.layers[1].curves]
    assert shapely.MultiLineString(rings).is_simple
    below = sum(ring.length for ring in rings)
    exact = surface.section(plane_origin=[0, 0, saddle - 1e-3], plane_normal=[0, 0, 1]).length
    assert below == pytest.approx(exact, rel=2e-3)
    assert reconstruct(toolpath, 5.0).is_watertight


def test_loops_too_small_for_a_curve_are_reported():
    surface = sphere()
    top = float(surface.vertices[:, 2].max())
    just_below = [Plane.horizontal(150.0), Plane.horizontal(top - 1e-8)]
    toolpath, said = slice_reporting(surface, custom_planes(BED, just_below, just_below))
    assert [len(layer.curves) for layer in toolpath.layers] == [1, 0]
    assert len(said) == 1
    assert said[0].startswith("layer 1: loop 0 at")


def test_a_part_beyond_its_planes_is_told_and_one_outside_refused():
    surface = sphere(50.0)
    assert "50 mm above the top plane" in slice_reporting(surface, layer_planes(BED, 50.0, 5.0))[1][0]
    moved = make_surface(surface.vertices + [0.0, 0.0, 200.0], surface.faces)
    with pytest.raises(PlanesError, match="no layer meets the part"):
        slice_surface(moved, layer_planes(BED, 100.0, 5.0))
    tiny = make_surface(surface.vertices / 1000.0, surface.faces)
    with pytest.raises(PlanesError, match=r"below the middle of the first layer.*check its unit"):
        slice_surface(tiny, layer_planes(BED, 100.0, 5.0))
    for resolution in (0, -1.0, float("nan"), "10"):
        with pytest.raises(PlanesError, match="resolution"):
            slice_surface(surface, layer_planes(BED, 100.0, 5.0), resolution)
