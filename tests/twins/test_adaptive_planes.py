import re
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from shapes import REFERENCE, SHAPES, box, fan_top, manifold_faults, printed_volume, sphere, springer

from planning import PrintSettings, load_cell, load_mix, plan
from twins import (
    Plane,
    PlanesError,
    extrude,
    layer_planes,
    make_surface,
    reconstruct,
    signed_volume,
    slice_reporting,
    slice_surface,
)
from twins.cusp_planes import adaptive_planes, adaptive_reporting
from twins.fewest_layers import Bounds, fewest_layers

BED = Plane.horizontal()


def levels(planes):
    return np.array([0.0, *(plane.origin[2] for plane in planes.nozzle)])


def cone(slope_deg=60.0, height=200.0, wide=150.0):
    """A cone's frustum whose side leans by `slope_deg` from the horizontal."""
    narrow = wide - height / np.tan(np.radians(slope_deg))
    frustum = trimesh.creation.revolve([[0, 0], [wide, 0], [narrow, height], [0, height]], sections=96)
    return make_surface(frustum.vertices, frustum.faces)


def local_heights(toolpath):
    return np.concatenate(
        [
            toolpath.floor_of(i).height_of(layer.nozzle.to_world(curve.points))
            for i, _, layer, curve in toolpath.curves()
        ]
    )


def sphere_limit(z, radius, cusp, thinnest, thickest):
    """What a sphere's slope allows at a height: c / |n · b|."""
    return np.clip(cusp * radius / np.maximum(np.abs(z - radius), 1e-12), thinnest, thickest)


@pytest.mark.parametrize("cusp", [4.0, 6.0, 9.0])
def test_a_sphere_gets_about_the_fewest_layers_that_its_steps_allow(cusp):
    planes = adaptive_planes(sphere(150.0, 5), BED, 300.0, 5.0, 15.0, cusp)
    z = (np.arange(100_000) + 0.5) * 300.0 / 100_000
    # Of any stack that keeps the steps, a layer is at most as thick as the limit anywhere in it: ∫ dz / limit ≤ layers.
    fewest = np.ceil((1.0 / sphere_limit(z, 150.0, cusp, 5.0, 15.0)).mean() * 300.0)
    assert fewest <= len(planes) <= 1.06 * fewest + 1
    z = levels(planes)
    t = np.diff(z)
    at_ends = np.minimum(*(sphere_limit(ends, 150.0, cusp, 5.0, 15.0) for ends in (z[:-1], z[1:])))
    # Facets of the sphere lean otherwise than it by up to a degree; the unit of height adds 1 % to the thinnest.
    assert (t <= at_ends * 1.01 + 0.05).all()
    assert t[len(t) // 2] == pytest.approx(t.max())
    assert t.max() > 1.5 * t[[0, -1]].max()


@pytest.mark.parametrize("slope_deg", [30.0, 45.0, 75.0])
def test_a_cone_gets_equal_layers_of_the_thickness_that_its_slope_allows(slope_deg):
    part = cone(slope_deg, 60.0)
    allowed = 4.0 / np.cos(np.radians(slope_deg))
    planes = adaptive_planes(part, BED, 60.0, 2.0, 20.0, 4.0)
    # A polygon's sides lean a little less than the cone.
    assert len(planes) in {np.ceil(60.0 / allowed), np.ceil(60.0 / allowed * 1.001)}
    # Equal to a few units of height, which 60 mm need not be whole multiples of in that many layers.
    t = np.diff(levels(planes))
    assert np.ptp(t) < 0.02 * t.mean()


def test_upright_walls_get_the_thickest_layers_as_uniform_slicing_has_them():
    planes = adaptive_planes(box(), BED, 200.0, 4.0, 11.0, 1.0)
    np.testing.assert_allclose(
        levels(planes)[1:], [p.origin[2] for p in layer_planes(BED, 200.0, 11.0).nozzle]
    )


@pytest.mark.parametrize("ratio", [1.05, 1.25, 3.0])
def test_layers_reach_the_top_within_their_bounds_and_ratio(ratio):
    planes = adaptive_planes(sphere(), BED, 300.0, 3.0, 17.0, 3.0, ratio)
    t = np.diff(levels(planes))
    assert t.sum() == pytest.approx(300.0, abs=1e-9)
    assert planes.thickness == pytest.approx(t.mean())
    assert t.min() >= 3.0 - 1e-9
    assert t.max() <= 17.0 + 1e-9
    assert np.maximum(t[1:] / t[:-1], t[:-1] / t[1:]).max() <= ratio + 1e-6
    middles = [plane.origin[2] for plane in planes.slicing]
    np.testing.assert_allclose(middles, 0.5 * (levels(planes)[1:] + levels(planes)[:-1]))


def test_a_wider_ratio_never_takes_more_layers():
    counts = [len(adaptive_planes(sphere(), BED, 300.0, 3.0, 17.0, 3.0, ratio)) for ratio in (1.1, 1.25, 2.0)]
    assert counts == sorted(counts, reverse=True)


def test_turning_part_and_planes_turns_the_stack():
    turn = trimesh.transformations.rotation_matrix(1.0, [1.0, 2.0, 3.0], [10.0, 20.0, 30.0])
    part = sphere()
    moved = make_surface(trimesh.transformations.transform_points(part.vertices, turn), part.faces)
    bed = Plane(turn[:3, 3], turn[:3, 0], turn[:3, 1])
    one, other = (adaptive_planes(s, b, 300.0, 5.0, 15.0, 6.0) for s, b in ((part, BED), (moved, bed)))
    for p, q in zip(one.nozzle, other.nozzle, strict=True):
        np.testing.assert_allclose(turn[:3, :3] @ p.origin + turn[:3, 3], q.origin, atol=0.1)


def test_a_fan_keeps_local_heights_everywhere_and_ends_at_the_top_plane():
    part = springer()
    angle = np.radians(28.0)
    top = Plane(
        np.array([-900.0, 0.0, 0.0]), np.array([np.cos(angle), 0.0, np.sin(angle)]), np.array([0.0, 1.0, 0.0])
    )
    planes = adaptive_planes(part, BED, top, 6.0, 13.0, 3.0)
    toolpath, said = slice_reporting(part, planes)
    assert said == []
    heights = local_heights(toolpath)
    assert heights.min() >= 6.0 * (1 - 1e-6)
    assert heights.max() <= 13.0 * (1 + 1e-6)
    assert planes.nozzle[-1].normal == pytest.approx(top.normal)
    assert top.height_of(planes.nozzle[-1].origin[None])[0] == pytest.approx(0.0, abs=1e-9)
    # The fan turns about one line, and its layers are not all alike.
    turns = [
        np.arcsin(np.linalg.norm(np.cross(p.normal, q.normal)))
        for p, q in zip([planes.base, *planes.nozzle], planes.nozzle, strict=False)
    ]
    assert planes.axis.radius * sum(turns) == pytest.approx(len(planes) * planes.thickness)
    assert max(turns) > 1.2 * min(turns)


def test_a_fan_over_a_sphere_keeps_its_steps():
    part = sphere(60.0)
    top = fan_top(part)
    planes = adaptive_planes(part, BED, top, 1.0, 14.0, 3.0)
    centers, normals = np.asarray(part.triangles_center), np.asarray(part.face_normals)
    floors = [planes.base, *planes.nozzle]
    for floor, nozzle in zip(floors, planes.nozzle, strict=False):
        here = (floor.height_of(centers) > 0.0) & (nozzle.height_of(centers) < 0.0)
        arms = centers[here] - planes.axis.point
        arms = arms - np.outer(arms @ planes.axis.direction, planes.axis.direction)
        distance = np.linalg.norm(arms, axis=1)
        rises = np.cross(planes.axis.direction, arms) / distance[:, None]
        local = distance * np.arcsin(np.linalg.norm(np.cross(floor.normal, nozzle.normal)))
        steps = local * np.abs(np.einsum("ij,ij->i", normals[here], rises))
        assert (steps <= np.maximum(3.0 * (1 + 1e-6), 1.1 * local.min(initial=np.inf))).all()


@pytest.mark.parametrize("fan", [False, True])
def test_the_whole_chain_takes_uneven_layers(fan):
    part = sphere(60.0, 4)
    top = fan_top(part) if fan else 120.0
    planes = adaptive_planes(part, BED, top, 3.0, 9.0, 3.0)
    toolpath = slice_surface(part, planes, 4.0)
    assert (
        np.ptp(
            [
                np.linalg.norm(p.origin - q.origin)
                for p, q in zip(planes.nozzle, planes.nozzle[1:], strict=False)
            ]
        )
        > 1.0
    )
    mesh = reconstruct(toolpath, 4.0)
    assert manifold_faults(mesh) == (0, 0)
    assert signed_volume(mesh) == pytest.approx(printed_volume(toolpath), rel=0.03)
    assert signed_volume(mesh) == pytest.approx(4.0 / 3.0 * np.pi * 60.0**3, rel=0.03)
    bead = extrude(toolpath, 8.0)
    assert manifold_faults(bead) == (0, 0)
    program = plan(
        toolpath, load_cell("ur10e-demo"), load_mix("fresh-mortar"), PrintSettings(width=8.0, speed=60.0)
    )
    printing = program.flow > 0.0
    np.testing.assert_allclose(
        program.flow[printing], (program.speed * program.width * program.height)[printing]
    )
    np.testing.assert_allclose(program.height[printing].min(), local_heights(toolpath).min())
    np.testing.assert_allclose(program.height.max(), local_heights(toolpath).max())


def wedge(slope_deg, height):
    """A ramp that leans by `slope_deg` from the horizontal."""
    wide = height / np.tan(np.radians(slope_deg))
    vertices = np.array(
        [[x, y, 0.0] for x in (0.0, wide) for y in (0.0, 80.0)] + [[0, 0, height], [0, 80.0, height]]
    )
    return make_surface(vertices, trimesh.convex.convex_hull(vertices).faces)


@pytest.mark.parametrize("height", [60.0, 61.3, 95.0, 103.0, 109.9, 150.0, 151.0])
def test_a_ramp_too_flat_for_its_steps_gets_as_many_equal_layers_as_find_room(height):
    part = wedge(30.0, height)
    height = float(part.vertices[:, 2].max())
    # Steps of 2 mm would take layers of 2.3 mm.
    planes, said = adaptive_reporting(part, BED, height, 5.0, 15.0, 2.0)
    t = np.diff(levels(planes))
    assert len(t) == np.floor(height / 5.0 + 1e-9)
    assert np.ptp(t) < 0.01 * t.mean()
    assert t.min() >= 5.0 - 1e-9
    step = float(re.search(r"the largest of ([\d.]+) mm", said[0])[1])
    assert step == pytest.approx(t.max() * np.cos(np.radians(30.0)), rel=1e-3)


@pytest.mark.parametrize("name", [*SHAPES, "springer"])
@pytest.mark.parametrize("cusp", [0.5, 3.0])
def test_every_shape_has_layers(name, cusp):
    part = (SHAPES.get(name) or REFERENCE[name])()
    low, high = part.bounds[:, 2]
    planes, said = adaptive_reporting(part, Plane.horizontal(low), high - low, 5.0, 15.0, cusp)
    t = np.diff(levels(planes)[1:], prepend=low)
    assert t.sum() == pytest.approx(high - low)
    assert (t.min(), t.max()) >= (5.0 - 1e-9, 0.0)
    assert t.max() <= 15.0 + 1e-9
    assert np.maximum(t[1:] / t[:-1], t[:-1] / t[1:]).max() <= 1.25 + 1e-6
    # The sentence is right: steps of faces by their own heights, as many as there are.
    z = np.asarray(part.triangles)[:, :, 2]
    slope = np.abs(np.asarray(part.face_normals)[:, 2])
    tops = np.cumsum(t) + low
    faces = (z.max(axis=1) > low + 5e-3) & (z.min(axis=1) < high - 5e-3)
    steps = [
        t[k]
        * slope[faces & (z.max(axis=1) > top - t[k] + 1e-3) & (z.min(axis=1) < top - 1e-3)].max(initial=0.0)
        for k, top in enumerate(tops)
    ]
    told = float(re.search(r"the largest of ([\d.]+) mm", said[0])[1]) if said else 0.0
    assert max(steps) <= max(cusp, told) * 1.001
    if said:
        assert told > cusp


@pytest.mark.parametrize(("bottom", "top"), [(1e-5, 0.0), (0.0, -1e-5), (-1e-5, 1e-5), (3e-3, -3e-3)])
def test_noise_of_bottom_and_top_costs_no_layers(bottom, top):
    vertices, faces = (np.array(of) for of in (box().vertices, box().faces))
    low, high = vertices[:, 2] == 0.0, vertices[:, 2] == 200.0
    vertices[low, 2] += np.resize([0.0, bottom, 0.5 * bottom], low.sum())
    vertices[high, 2] += np.resize([0.0, top, 0.5 * top], high.sum())
    planes, said = adaptive_reporting(make_surface(vertices, faces), BED, 200.0, 5.0, 15.0, 2.0)
    assert said == []
    np.testing.assert_allclose(
        levels(planes)[1:], [p.origin[2] for p in layer_planes(BED, 200.0, 15.0).nozzle], atol=1e-6
    )


def test_steps_that_a_fan_leaves_far_from_its_axis_are_told():
    near = trimesh.creation.box((20.0, 50.0, 200.0)).apply_translation([-390.0, 0.0, 100.0])
    far = trimesh.creation.revolve([[0, 0], [160, 0], [60, 100], [60, 200], [0, 200]], sections=64)
    both = trimesh.util.concatenate([near, far.apply_translation([240.0, 0.0, 0.0])])
    part = make_surface(both.vertices, both.faces)
    angle = np.radians(14.0)
    top = Plane(
        np.array([0.0, 0, 200]), np.array([np.cos(angle), 0.0, np.sin(angle)]), np.array([0.0, 1.0, 0.0])
    )
    planes, said = adaptive_reporting(part, BED, top, 5.0, 25.0, 4.0)
    normals = np.asarray(part.face_normals)
    found = 0.0
    for floor, nozzle in pairwise([planes.base, *planes.nozzle]):
        # Sides of the cone reach over many layers; none of its level faces lies between the planes.
        rise = floor.normal + nozzle.normal
        rise /= np.linalg.norm(rise)
        leaning = (np.abs(normals[:, 2]) > 0.1) & (np.abs(normals[:, 2]) < 0.9)
        sharpest = np.argmax(np.where(leaning, np.abs(normals @ rise), 0.0))
        x = np.asarray(part.triangles)[sharpest][:, 0]
        distance = x.min() - planes.axis.point[0]
        local = distance * np.arcsin(np.linalg.norm(np.cross(floor.normal, nozzle.normal)))
        z = np.asarray(part.triangles)[sharpest]
        if floor.height_of(z).max() > 0.0 > nozzle.height_of(z).min():
            found = max(found, local * abs(normals[sharpest] @ rise))
    told = float(re.search(r"the largest of ([\d.]+) mm", said[0])[1])
    # A thinnest layer would keep the steps there; the part near the axis forbids it.
    assert 5.0 / np.sqrt(2.0) < 4.0 < 0.5 * found
    assert told >= found * 0.99


def best_of_all(least, most, wanted, ratio):
    """The least (sum of prices, number of layers) of all stacks, or None."""

    @cache
    def best_from(at, last):
        if at == len(least):
            return (0, 0)
        found = []
        for t in range(1, len(least) - at + 1):
            here = slice(at, at + t)
            low = least[here].max()
            if low <= t <= most[here].min() and (
                last is None or (t <= last * ratio + 1e-9 and last <= t * ratio + 1e-9)
            ):
                above, layers = best_from(at + t, t)
                excess = t - max(low, wanted[here].min())
                found.append((above + max(0, excess * cheap // wanted[here].min()) ** 2, 1 + layers))
        return min(found, default=(np.inf, np.inf))

    # A common multiple of all that is wanted, so that prices are whole.
    cheap = 27720
    return best_from(0, None)


def test_no_stack_is_better():
    rng = np.random.default_rng(5)
    solved = exceeding = 0
    for _ in range(150):
        units, ratio = int(rng.integers(5, 40)), float(rng.choice([1.0, 1.3, 1.6, 2.5]))
        least = np.repeat(rng.integers(2, 4, units), 5)[:units]
        most = np.repeat(rng.integers(4, 9, units), 7)[:units]
        wanted = np.repeat(rng.integers(1, 12, units), 4)[:units]
        steps = fewest_layers(Bounds(*(of.astype(float) for of in (least, most, wanted))), 1.0, ratio)
        expected = best_of_all(least, most, wanted, ratio)
        if steps is None:
            assert expected[0] == np.inf
            continue
        solved += 1
        assert steps.sum() == units
        assert all(a <= b * ratio + 1e-9 and b <= a * ratio + 1e-9 for a, b in pairwise(steps))
        ends = np.cumsum(steps)
        excess = 0.0
        for end, t in zip(ends, steps, strict=True):
            here = slice(end - t, end)
            assert least[here].max() <= t <= most[here].min()
            excess += (max(0, t - max(least[here].max(), wanted[here].min())) / wanted[here].min()) ** 2
        # Prices are rounded up, to 1/4096 of the largest.
        assert excess == pytest.approx(expected[0] / 27720**2, rel=1e-2)
        assert expected[0] > 0 or len(steps) == expected[1]
        exceeding += expected[0] > 0
    assert solved > 50
    assert 20 < exceeding < solved - 20


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((0.0, 10.0, 3.0), "layer heights must run"),
        ((12.0, 10.0, 3.0), "layer heights must run"),
        ((5.0, np.inf, 3.0), "layer heights must run"),
        ((5.0, 10.0, 0.0), "steps must be above 0"),
        ((5.0, 10.0, 3.0, 0.9), "ratio"),
        ((140.0, 150.0, 3.0), "sum to the height of 200 mm"),
        ((1e-4, 10.0, 3.0), "layer heights must run"),
        ((0.02, 50.0, 3.0), "too wide a range"),
        ((1e-3, 2e-3, 3.0), "more than 20,000"),
        ((250.0, 300.0, 3.0), "sum to the height of 200 mm"),
    ],
)
def test_bounds_that_allow_no_stack_are_refused(arguments, says):
    with pytest.raises(PlanesError, match=says):
        adaptive_planes(box(), BED, 200.0, *arguments)


def test_a_part_too_wide_for_a_fan_is_refused_with_the_place():
    part = box(300.0, 100.0, 100.0)
    with pytest.raises(PlanesError, match=r"above the bed.*distances from the axis"):
        adaptive_planes(part, BED, fan_top(part), 9.5, 10.5, 3.0)
