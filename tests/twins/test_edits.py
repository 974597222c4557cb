"""Edits of toolpaths: what they do in the world, and what they undo."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from shapes import SHAPES, fan_top

from twins import (
    Curve,
    Layer,
    Plane,
    Toolpath,
    ToolpathError,
    layer_planes,
    reconstruct,
    signed_volume,
    slice_surface,
)
from twins.regions.edits import join_layers, mirror, move, reorder, reverse, rotate, scale, split_layers

BED = Plane.horizontal()


def sliced(name="Y-branch", rotary=False, thickness=20.0):
    surface = SHAPES[name]()
    top = fan_top(surface) if rotary else float(surface.vertices[:, 2].max())
    return slice_surface(surface, layer_planes(BED, top, thickness))


def in_world(toolpath):
    """Every point of every curve where the nozzle and where the slicing plane carry it, shape (n, 6)."""
    rows = [
        np.hstack([layer.nozzle.to_world(curve.points), layer.slicing.to_world(curve.points)])
        for *_, layer, curve in toolpath.curves()
    ]
    return np.concatenate(rows)


def interiors(toolpath):
    return [curve.signed_area for *_, curve in toolpath.curves()]


def same_layers(a, b):
    return len(a.layers) == len(b.layers) and all(p is q for p, q in zip(a.layers, b.layers, strict=True))


@pytest.mark.parametrize("rotary", [False, True])
def test_moving_and_rotating_the_toolpath_does_so_with_its_mesh(rotary):
    toolpath = sliced(rotary=rotary)
    R = Rotation.from_rotvec([0.3, -0.8, 1.2]).as_matrix()
    about = np.array([10.0, -20.0, 30.0])
    mesh = reconstruct(toolpath)
    for made, moved in (
        (move(toolpath, [5.0, 6.0, -7.0]), mesh.vertices + [5.0, 6.0, -7.0]),
        (rotate(toolpath, R, about), about + (mesh.vertices - about) @ R.T),
    ):
        after = reconstruct(made)
        assert np.array_equal(after.faces, mesh.faces)
        assert after.vertices == pytest.approx(moved, abs=1e-6)
        assert [c for *_, c in made.curves()] == [c for *_, c in toolpath.curves()]
    back = rotate(rotate(toolpath, R, about), R.T, about)
    assert in_world(back) == pytest.approx(in_world(toolpath), abs=1e-9)


def test_scaling_scales_lengths_thicknesses_widths_and_volumes():
    toolpath = sliced()
    made = scale(toolpath, 1.7, [1.0, 2.0, 3.0])
    assert made.thickness == pytest.approx(1.7 * toolpath.thickness)
    assert made.length == pytest.approx(1.7 * toolpath.length)
    assert in_world(made) - [1, 2, 3] * 2 == pytest.approx(1.7 * (in_world(toolpath) - [1, 2, 3] * 2))
    assert signed_volume(reconstruct(made)) == pytest.approx(
        1.7**3 * signed_volume(reconstruct(toolpath)), rel=1e-6
    )
    wide = Toolpath(BED, (Layer(BED, BED, (Curve([[0, 0], [9, 0]], closed=False, width=[4, 5]),)),), 10.0)
    assert scale(wide, 2.0).layers[0].curves[0].width.tolist() == [8.0, 10.0]


@pytest.mark.parametrize("rotary", [False, True])
def test_mirroring_keeps_the_interior_on_the_left_and_twice_is_nothing(rotary):
    toolpath = sliced(rotary=rotary)
    plane = Plane([30.0, 0.0, 0.0], [0.2, 1.0, 0.0], [0.0, 0.0, 1.0])
    made = mirror(toolpath, plane)
    assert interiors(made) == pytest.approx(interiors(toolpath))
    n = plane.normal
    wanted = [
        layer.nozzle.to_world(curve.points)
        - 2.0 * np.outer((layer.nozzle.to_world(curve.points) - plane.origin) @ n, n)
        for *_, layer, curve in toolpath.curves()
    ]
    for (*_, layer, curve), points in zip(made.curves(), wanted, strict=True):
        # It begins where it began and runs the other way.
        assert layer.nozzle.to_world(curve.points) == pytest.approx(
            np.roll(points[::-1], 1, axis=0), abs=1e-9
        )
    for layer in made.layers:
        assert layer.nozzle.normal @ layer.slicing.normal > 0
    assert in_world(mirror(made, plane)) == pytest.approx(in_world(toolpath), abs=1e-9)
    mesh = reconstruct(made)
    assert signed_volume(mesh) == pytest.approx(signed_volume(reconstruct(toolpath)), rel=1e-3)
    rib = Curve([[0.0, 0.0], [9.0, 1.0]], closed=False, width=[4.0, 5.0])
    ribs = mirror(Toolpath(BED, (Layer(BED, BED, (rib,)),), 10.0), plane)
    assert ribs.layers[0].curves[0].width.tolist() == [5.0, 4.0]


@pytest.mark.parametrize("rotary", [False, True])
def test_splitting_and_joining_is_nothing(rotary):
    toolpath = sliced(rotary=rotary)
    parts = split_layers(toolpath, [3, 4, 9])
    assert [len(part.layers) for part in parts] == [3, 1, 5, len(toolpath.layers) - 9]
    for part, start in zip(parts, (0, 3, 4, 9), strict=True):
        assert part.base is toolpath.floor_of(start)
    joined = join_layers(*parts)
    assert same_layers(joined, toolpath)
    assert joined.thickness == toolpath.thickness
    assert joined.base is toolpath.base
    assert len(split_layers(toolpath, np.int64(2))) == 2
    for at in (0, len(toolpath.layers), [4, 4], [5, 3], -1, 1.5, [2.0], "2"):
        with pytest.raises(ToolpathError, match="ascending layers"):
            split_layers(toolpath, at)


def test_joined_parts_follow_on_one_frame_and_stay_where_they_are():
    lower = sliced("box")
    # Another box on top, in frames that are turned and shifted in their planes.
    upper = rotate(move(sliced("box"), [20.0, 10.0, 200.0]), Rotation.from_rotvec([0, 0, 0.4]).as_matrix())
    joined = join_layers(lower, upper)
    assert in_world(joined) == pytest.approx(np.vstack([in_world(lower), in_world(upper)]), abs=1e-9)
    for layer in joined.layers:
        assert layer.nozzle.rotation == pytest.approx(np.eye(3), abs=1e-12)
    mesh = reconstruct(joined)
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).body_count == 1
    volumes = [signed_volume(reconstruct(part)) for part in (lower, upper)]
    # M runs over from the one section to the other within a layer.
    assert signed_volume(mesh) == pytest.approx(sum(volumes), rel=0.02)
    with pytest.raises(ToolpathError, match=r"nozzle plane of layer 9 .* 5 mm apart"):
        join_layers(lower, move(upper, [0.0, 0.0, 5.0]))
    with pytest.raises(ToolpathError, match="layer 9"):
        join_layers(lower, rotate(upper, Rotation.from_rotvec([0.0, 0.01, 0.0]).as_matrix()))
    finer = split_layers(scale(lower, 0.5), 5)[0]
    assert join_layers(lower, move(finer, [0, 0, 200.0])).thickness == pytest.approx((10 * 20 + 5 * 10) / 15)


def test_reversing_and_reordering():
    toolpath = sliced("porous column")
    turned = reverse(toolpath)
    assert interiors(turned) == pytest.approx([-a for a in interiors(toolpath)])
    assert turned.layers[0].curves[0].points[0].tolist() == toolpath.layers[0].curves[0].points[0].tolist()
    for mine, theirs in zip(reverse(turned).curves(), toolpath.curves(), strict=True):
        assert np.array_equal(mine[3].points, theirs[3].points)
    assert reverse(toolpath, lambda layer, j, curve: False) is toolpath
    holes = reverse(toolpath, lambda layer, j, curve: layer == 1 and curve.signed_area < 0)
    assert min(curve.signed_area for curve in holes.layers[1].curves) > 0
    assert holes.layers[0] is toolpath.layers[0]
    count = len(toolpath.layers[4].curves)
    made = reorder(toolpath, 4, range(count)[::-1])
    assert made.layers[4].curves == toolpath.layers[4].curves[::-1]
    assert made.layers[3] is toolpath.layers[3]
    assert reorder(toolpath, 4, range(count)) is toolpath
    with pytest.raises(ToolpathError, match="layer 4: an order"):
        reorder(toolpath, 4, [0] * count)
    with pytest.raises(ToolpathError, match="no layer 99"):
        reorder(toolpath, 99, [0])


def test_bad_input_is_refused():
    toolpath = sliced("box")
    with pytest.raises(ToolpathError, match="vector"):
        move(toolpath, [1.0, float("nan"), 0.0])
    with pytest.raises(ToolpathError, match="vector"):
        move(toolpath, [1.0, 2.0])
    for matrix in (2.0 * np.eye(3), np.diag([1.0, 1.0, -1.0])):
        with pytest.raises(ToolpathError, match="rotation"):
            rotate(toolpath, matrix)
    for factor in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ToolpathError, match="scaled by a factor"):
            scale(toolpath, factor)
