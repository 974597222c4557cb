import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from shapes import SHAPES, box, manifold_faults, nested_cavity, sphere, springer, y_branch

from twins import (
    Plane,
    SurfaceError,
    best_orientation,
    layer_planes,
    make_surface,
    reconstruct,
    signed_volume,
    slice_reporting,
    slice_surface,
)
from twins.shaping.end_faces import orient_to_slice, set_down
from twins.shaping.remeshing import remesh
from twins.shaping.splitting import split
from twins.shaping.trimming import trim


def plane_at(point, normal):
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    x = np.cross(normal, [0.0, 0.0, 1.0] if abs(normal[2]) < 0.9 else [1.0, 0.0, 0.0])
    return Plane(np.asarray(point, float), x, np.cross(normal, x))


def euler(surface):
    faces = np.asarray(surface.faces)
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    return len(np.unique(faces)) - len(edges) + len(faces)


def edge_lengths(surface):
    return np.asarray(surface.edges_unique_length)


ARMS = [
    np.array(arm) / np.linalg.norm(arm)
    for arm in ([1, 0, 0.35], [-0.5, 0.8, 0.35], [-0.4, -0.9, 0.3], [0.05, 0.1, 1])
]
CUT, END = 110.0, 260.0


def node():
    """Four tubes of radius 40 from a ball of radius 55 at the origin, along the arms."""
    tubes = []
    for arm in ARMS:
        tube = trimesh.creation.cylinder(40.0, 300.0, sections=48).apply_translation([0, 0, 150.0])
        tubes.append(tube.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], arm)))
    part = trimesh.boolean.union([trimesh.creation.icosphere(3, 55.0), *tubes], engine="manifold")
    return make_surface(part.vertices, part.faces)


# Remesh


@pytest.mark.parametrize("name", ["torus standing", "Y-branch", "nested cavity"])
def test_remeshing_keeps_the_surface_and_evens_its_edges(name):
    before = SHAPES[name]()
    after = remesh(before, 18.0)
    assert manifold_faults(after) == (0, 0)
    assert euler(after) == euler(before)
    assert signed_volume(after) == pytest.approx(signed_volume(before), rel=0.025)
    lengths = edge_lengths(after)
    assert np.median(lengths) == pytest.approx(18.0, rel=0.15)
    assert np.quantile(lengths, 0.99) < 1.5 * 18.0
    assert np.quantile(lengths, 0.01) > 0.35 * 18.0
    # Both ways: nothing sticks out, and nothing is lost.
    for one, other in ((before, after), (after, before)):
        samples = trimesh.sample.sample_surface(one, 300, seed=1)[0]
        assert trimesh.proximity.closest_point(other, samples)[1].max() < 0.2 * 18.0


def test_sharp_edges_stay_where_they_are_and_only_if_wanted():
    corners = np.asarray(box().vertices)
    kept, rounded = remesh(box(), 15.0), remesh(box(), 15.0, keep_edges_deg=None)
    assert signed_volume(kept) == pytest.approx(200.0**3, rel=1e-9)
    assert cKDTree(kept.vertices).query(corners)[0].max() < 1e-9
    on_edge = (np.isclose(np.abs(np.asarray(kept.vertices) - [0, 0, 100.0]), 100.0).sum(axis=1) >= 2).sum()
    assert on_edge >= 12 * 200.0 / (1.5 * 15.0)
    assert signed_volume(rounded) < signed_volume(kept)


def test_the_surface_of_a_toolpath_is_remeshed_and_sliced_again():
    planes = layer_planes(Plane.horizontal(), 330.0, 15.0)
    first = slice_surface(y_branch(), planes)
    surface = remesh(reconstruct(first), 15.0, keep_edges_deg=None)
    assert manifold_faults(surface) == (0, 0)
    again, said = slice_reporting(surface, planes)
    assert said == []
    assert [len(layer.curves) for layer in again.layers] == [len(layer.curves) for layer in first.layers]
    assert again.length == pytest.approx(first.length, rel=0.02)


@pytest.mark.parametrize(
    ("length", "deg", "says"),
    [
        (0.0, 30.0, "edge length"),
        (np.nan, 30.0, "edge length"),
        (150.0, 30.0, "half of the part"),
        (1e-3, 30.0, "longer"),
        (10.0, 0.0, "keep_edges_deg"),
    ],
)
def test_impossible_remeshing_is_refused(length, deg, says):
    with pytest.raises(SurfaceError, match=says):
        remesh(box(), length, deg)


def test_an_open_surface_is_not_remeshed():
    part = box()
    with pytest.raises(SurfaceError, match="open"):
        remesh(make_surface(part.vertices, part.faces[1:]), 10.0)


# Trim and split


def test_trimming_a_sphere_leaves_a_cap_of_known_volume_with_a_flat_face():
    r, h = 150.0, 100.0
    part = trim(sphere(r, 5), Plane.horizontal(h))
    assert signed_volume(part) == pytest.approx(np.pi * h**2 * (3 * r - h) / 3, rel=2e-3)
    assert manifold_faults(part) == (0, 0)
    top = np.isclose(np.asarray(part.triangles)[:, :, 2], h, atol=1e-9).all(axis=1)
    assert np.asarray(part.area_faces)[top].sum() == pytest.approx(np.pi * (2 * r * h - h**2), rel=2e-3)
    assert np.asarray(part.vertices)[:, 2].max() == pytest.approx(h, abs=1e-9)


def test_trimming_by_many_planes_keeps_what_is_below_all():
    planes = [
        plane_at([50, 0, 0], [1, 0, 0]),
        plane_at([0, 50, 0], [0, 1, 0]),
        Plane.horizontal(50.0),
        Plane.horizontal(500.0),
    ]
    assert signed_volume(trim(box(), planes)) == pytest.approx(150.0 * 150.0 * 50.0)


def test_trimming_everything_away_is_refused():
    with pytest.raises(SurfaceError, match=r"nothing .* plane 1"):
        trim(box(), [Plane.horizontal(100.0), Plane.horizontal(-1.0)])


@pytest.mark.parametrize("name", list(SHAPES))
def test_parts_of_planes_sum_to_the_whole(name):
    whole = SHAPES[name]()
    middle = np.asarray(whole.vertices).mean(axis=0)
    parts = split(whole, [plane_at(middle, [0.1, 0.2, 1.0]), plane_at(middle + 7.0, [1.0, -0.3, 0.2])])
    assert len(parts) >= 4
    assert sum(map(signed_volume, parts)) == pytest.approx(signed_volume(whole), rel=1e-6)
    assert all(manifold_faults(part)[0] == 0 for part in parts)


def test_parallel_planes_give_parts_from_the_bottom_up():
    parts = split(box(), [Plane.horizontal(40.0), Plane.horizontal(150.0)])
    assert [signed_volume(part) for part in parts] == pytest.approx(
        [200.0**2 * h for h in (40.0, 110.0, 50.0)]
    )
    assert [part.vertices[:, 2].min() for part in parts] == pytest.approx([0.0, 40.0, 150.0])


def test_a_cavity_stays_with_the_body_around_it():
    parts = split(nested_cavity(), plane_at([-80.0, 0, 100.0], [1, 0, 0]))
    # Off comes a slab; left are the box with its cavity, and the ball in it.
    assert [euler(part) for part in parts] == [2, 4, 2]


def test_a_closed_cutting_surface_gives_its_inside_first():
    inside, outside = split(box(), trimesh.creation.icosphere(3, 60.0).apply_translation([0, 0, 200.0]))
    assert signed_volume(inside) == pytest.approx(2.0 / 3.0 * np.pi * 60.0**3, rel=0.02)
    assert signed_volume(inside) + signed_volume(outside) == pytest.approx(200.0**3)


def sheet(reach=150.0, height=lambda x, _: 100.0 + 20.0 * np.sin(x / 30.0)):
    """An open surface over a square, and its normals point up."""
    n = 41
    x, y = np.meshgrid(np.linspace(-reach, reach, n), np.linspace(-reach, reach, n), indexing="ij")
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return make_surface(np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3), faces)


def test_an_open_cutting_surface_cuts_across_the_part():
    below, above = split(box(), sheet())
    # The sine is odd, so the wave has the middle plane's volume below it.
    assert signed_volume(below) == pytest.approx(200.0**2 * 100.0, rel=1e-3)
    assert signed_volume(below) + signed_volume(above) == pytest.approx(200.0**3)
    assert np.asarray(below.vertices)[:, 2].min() == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("by", "says"),
    [
        (Plane.horizontal(300.0), "plane 0 .* does not cut"),
        ([Plane.horizontal(100.0), plane_at([500, 0, 0], [1, 0, 0])], "plane 1 .* does not cut"),
        (sphere(20.0).apply_translation([0, 0, 900.0]), "does not cut the part"),
        (sheet(reach=60.0), "reach across"),
        (
            sheet(height=lambda x, y: np.where(np.abs(x) < 70, -9.0 * np.abs(x), x) + y + 100.0),
            "reach across|folds",
        ),
    ],
)
def test_what_does_not_cut_is_refused(by, says):
    with pytest.raises(SurfaceError, match=says):
        split(box(), by)


def test_a_plane_can_cut_one_branch_only():
    part = y_branch()
    plane = Plane(np.array([80.0, 0.0, 280.0]), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
    everywhere, here = trim(part, plane), trim(part, plane, at_origin=True)
    cut = signed_volume(part) - signed_volume(here)
    # Two branches alike: one is cut off, or both.
    assert cut == pytest.approx(0.5 * (signed_volume(part) - signed_volume(everywhere)), rel=1e-3)
    high = np.asarray(here.vertices)[np.asarray(here.vertices)[:, 2] > 280.0 + 1e-6]
    assert (high[:, 0] < 0.0).all()
    with pytest.raises(SurfaceError, match="not inside the part"):
        trim(part, Plane.horizontal(280.0), at_origin=True)


# End faces


def test_a_branching_node_is_made_of_parts_that_stand_and_slice():
    whole = trim(node(), [plane_at(END * arm, arm) for arm in ARMS], at_origin=True)
    parts = split(whole, [plane_at(CUT * arm, arm) for arm in ARMS], at_origin=True)
    assert len(parts) == len(ARMS) + 1
    assert sum(map(signed_volume, parts)) == pytest.approx(signed_volume(whole), rel=0.005)
    circle = 48 / 2 * 40.0**2 * np.sin(2 * np.pi / 48)
    for arm, part in zip(ARMS, parts, strict=False):
        assert signed_volume(part) == pytest.approx(circle * (END - CUT), rel=1e-5)
        bed, top = orient_to_slice(part, arm)
        np.testing.assert_allclose([bed.normal, top.normal], [arm, arm], atol=1e-6)
        np.testing.assert_allclose([bed.origin, top.origin], [CUT * arm, END * arm], atol=1e-4)
        moved, moved_top = set_down(part, bed, top)
        assert manifold_faults(moved) == (0, 0)
        vertices = np.asarray(moved.vertices)
        assert vertices[:, 2].min() >= -1e-6
        on_bed = (vertices[moved.faces][:, :, 2] <= 1e-6).all(axis=1)
        assert np.asarray(moved.area_faces)[on_bed].sum() == pytest.approx(circle, rel=1e-5)
        toolpath, said = slice_reporting(moved, layer_planes(Plane.horizontal(), moved_top, 10.0))
        assert said == []
        assert [len(layer.curves) for layer in toolpath.layers] == [1] * 15


def test_a_fork_is_made_of_two_arms_and_a_foot_that_stand_and_slice():
    joint, arms = (
        np.array([0.0, 0.0, 150.0]),
        [np.array(a) / np.hypot(110, 180) for a in ([110, 0, 180], [-110, 0, 180])],
    )
    whole = trim(y_branch(), [plane_at(joint + 160.0 * arm, arm) for arm in arms], at_origin=True)
    *branches, foot = split(whole, [plane_at(joint + 90.0 * arm, arm) for arm in arms], at_origin=True)
    assert len(branches) == 2
    assert sum(map(signed_volume, [*branches, foot])) == pytest.approx(signed_volume(whole), rel=0.005)
    for part, up in zip([*branches, foot], [*arms, np.array([0.0, 0.0, 1.0])], strict=True):
        bed, top = orient_to_slice(part, up)
        np.testing.assert_allclose(bed.normal, up, atol=1e-5)
        moved, moved_top = set_down(part, bed, top)
        vertices = np.asarray(moved.vertices)
        assert vertices[:, 2].min() >= -1e-6
        assert (
            np.asarray(moved.area_faces)[(vertices[moved.faces][:, :, 2] <= 1e-6).all(axis=1)].sum() > 5000.0
        )
        # The foot ends in two cut faces, and level layers up to its highest point reach both.
        end = moved_top if part is not foot else float(vertices[:, 2].max())
        assert slice_reporting(moved, layer_planes(Plane.horizontal(), end, 8.0))[1] == []


def test_a_springer_is_laid_between_its_two_ends():
    part = springer()
    bed, top = orient_to_slice(part)
    np.testing.assert_allclose(bed.normal, [0, 0, 1], atol=1e-9)
    assert np.degrees(np.arccos(bed.normal @ top.normal)) == pytest.approx(28.0, abs=0.5)
    turn = trimesh.transformations.rotation_matrix(2.0, [1.0, 2.0, -1.0], [5.0, 6.0, 7.0])
    moved = make_surface(trimesh.transformations.transform_points(part.vertices, turn), part.faces)
    planes = orient_to_slice(moved, turn[:3, 2])
    down, moved_top = set_down(moved, *planes)
    assert slice_reporting(down, layer_planes(Plane.horizontal(), moved_top, 10.0))[1] == []
    np.testing.assert_allclose(turn[:3, :3] @ bed.normal, planes[0].normal, atol=1e-9)
    np.testing.assert_allclose(turn[:3, :3] @ top.normal, planes[1].normal, atol=1e-9)


def test_end_faces_are_not_the_best_direction_to_build_in():
    """A flat plate on edge: it stands between its narrow ends as given, and prints with less overhang lying down."""
    slab = trimesh.creation.box((300.0, 40.0, 100.0))
    slab = trim(
        make_surface(slab.vertices, slab.faces),
        [plane_at([0, 0, -20], [0.6, 0, -1]), plane_at([0, 0, 20], [0.6, 0, 1])],
    )
    bed, top = orient_to_slice(slab)
    assert bed.normal[2] > 0.8
    assert top.normal[2] > 0.8
    assert best_orientation(slab).best.direction @ bed.normal < 0.99


def test_a_part_without_end_faces_is_refused():
    with pytest.raises(SurfaceError, match="trim its ends"):
        orient_to_slice(sphere())
    with pytest.raises(SurfaceError, match="direction"):
        orient_to_slice(box(), [0.0, 0.0, 0.0])
