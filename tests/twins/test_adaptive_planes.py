from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from shapes import box, fan_top, manifold_faults, printed_volume, sphere, springer

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
from twins.adaptive_planes import _Bounds, _fewest, adaptive_planes

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
    assert t.argmax() in range(len(t) // 2 - 3, len(t) // 2 + 4)


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


def fewest_of_all(least, most, wanted, ratio):
    """The fewest layers by trying all of them, or None."""

    @cache
    def fewest_from(at, last):
        if at == len(least):
            return 0
        found = []
        for t in range(1, len(least) - at + 1):
            here = slice(at, at + t)
            low = least[here].max()
            fits = low <= t <= min(most[here].min(), max(low, wanted[here].min()))
            if fits and (last is None or (t <= last * ratio + 1e-9 and last <= t * ratio + 1e-9)):
                found.append(1 + fewest_from(at + t, t))
        return min(found, default=np.inf)

    return fewest_from(0, None)


def test_no_stack_has_fewer_layers():
    rng = np.random.default_rng(5)
    solved = 0
    for _ in range(150):
        units, ratio = int(rng.integers(5, 40)), float(rng.choice([1.0, 1.3, 1.6, 2.5]))
        least = np.repeat(rng.integers(2, 4, units), 5)[:units]
        most = np.repeat(rng.integers(4, 9, units), 7)[:units]
        wanted = np.repeat(rng.integers(1, 12, units), 4)[:units]
        steps = _fewest(_Bounds(*(of.astype(float) for of in (least, most, wanted))), 1.0, ratio)
        expected = fewest_of_all(least, most, wanted, ratio)
        assert (np.inf if steps is None else len(steps)) == expected
        if steps is not None:
            solved += 1
            assert steps.sum() == units
            assert all(a <= b * ratio + 1e-9 and b <= a * ratio + 1e-9 for a, b in pairwise(steps))
    assert 50 < solved < 150


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((0.0, 10.0, 3.0), "layer heights must run"),
        ((12.0, 10.0, 3.0), "layer heights must run"),
        ((5.0, np.inf, 3.0), "layer heights must run"),
        ((5.0, 10.0, 0.0), "steps must be above 0"),
        ((5.0, 10.0, 3.0, 0.9), "ratio"),
        ((140.0, 150.0, 3.0), "sum to the height of 200 mm"),
        ((1e-4, 10.0, 3.0), "too wide a range"),
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
