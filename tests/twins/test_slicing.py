import numpy as np
import pytest
import trimesh
from shapes import SHAPES, fan_top, nested_cavity, sphere, stepped_box

from twins import (
    Plane,
    PlanesError,
    SurfaceError,
    custom_planes,
    layer_planes,
    make_surface,
    signed_volume,
    slice_surface,
)
from twins.sampling import sample_layer
from twins.slicing import cut

BED = Plane.horizontal()


def area(points):
    x, y = points.T
    return 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))


@pytest.mark.parametrize("name", SHAPES)
def test_cuts_have_the_area_that_an_independent_slicer_finds(name):
    surface = SHAPES[name]()
    planes = layer_planes(BED, float(surface.vertices[:, 2].max()), 21.0)
    for polygons, plane in zip(cut(surface, planes), planes.slicing, strict=True):
        section = surface.section(plane_origin=plane.origin, plane_normal=plane.normal)
        flat = section.to_2D(normal=plane.normal)[0] if section is not None else None
        assert sum(map(area, polygons)) == pytest.approx(flat.area if flat else 0.0, rel=1e-6)


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


def test_interior_is_on_the_left():
    planes = layer_planes(BED, 200.0, 20.0)
    middle = slice_surface(nested_cavity(), planes).layers[5].curves
    assert sorted(np.sign([curve.signed_area for curve in middle])) == [-1.0, 1.0, 1.0]


def test_rotating_the_part_and_the_planes_rotates_nothing_in_the_frames():
    surface = sphere()
    planes = layer_planes(BED, 300.0, 30.0)
    turn = trimesh.transformations.rotation_matrix(0.7, [1.0, 2.0, 3.0])
    R = turn[:3, :3]

    def turned(plane):
        return Plane(R @ plane.origin, R @ plane.x_axis, R @ plane.y_axis)

    rotated = custom_planes(
        turned(planes.base), [turned(p) for p in planes.slicing], [turned(p) for p in planes.nozzle]
    )
    same = make_surface(np.asarray(surface.vertices) @ R.T, surface.faces)
    for a, b in zip(slice_surface(surface, planes).layers, slice_surface(same, rotated).layers, strict=True):
        for one, two in zip(a.curves, b.curves, strict=True):
            assert one.signed_area == pytest.approx(two.signed_area, rel=1e-6)


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
        (lambda v, f: (v, f[:-1]), "3 open edges in 1 holes"),
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
