"""Remeshing what is made here and elsewhere: toolpath meshes, volumes, and shells of marching cubes."""

import numpy as np
import pytest
import trimesh
from shapes import SHAPES, box, brick, manifold_faults, schwarz_d, sphere, torus

from twins import Plane, extrude, layer_planes, make_surface, reconstruct, signed_volume, slice_surface
from twins.crossings import check_self_intersection
from twins.errors import SurfaceError
from twins.half_edges import opposite_half_edges
from twins.shaping.facing_points import face_tree, facing_point
from twins.shaping.moves import flip_edges, split_long, spread
from twins.shaping.net import collapse, flip, mesh_of, net_of, packed, split
from twins.shaping.remeshing import remesh
from twins.surface import check_surface

NEAR, LEFT = 0.3, 0.5
"""Shares of the edge length that `remesh` promises: of its faces to the surface, and of the surface to it."""


def toolpath_of(surface, thickness=10.0):
    top = float(np.asarray(surface.vertices)[:, 2].max())
    return slice_surface(surface, layer_planes(Plane.horizontal(), top, thickness))


def euler(surface):
    faces = np.asarray(surface.faces)
    return len(np.unique(faces)) - len(faces) // 2


def bodies(surface):
    return len(
        trimesh.graph.connected_components(surface.face_adjacency, nodes=np.arange(len(surface.faces)))
    )


def away(points, surface):
    points = points[:: max(1, len(points) // 400)]
    return trimesh.proximity.closest_point(surface, points)[1].max()


def check_kept(before, after, length):
    """The laws of every remeshing."""
    check_surface(after)
    assert manifold_faults(after) == (0, 0)
    assert (euler(after), bodies(after)) == (euler(before), bodies(before))
    check_self_intersection(after)
    assert away(np.asarray(after.triangles_center), before) <= NEAR * length
    assert away(np.asarray(before.vertices), after) <= LEFT * length


def mean_edge(surface):
    return float(np.asarray(surface.edges_unique_length).mean())


LARGE = [pytest.param(name, marks=pytest.mark.soak) for name in SHAPES if name == "porous column"]


@pytest.mark.parametrize("name", [*(name for name in SHAPES if name != "porous column"), *LARGE])
def test_the_toolpath_mesh_of_every_shape_is_remeshed(name):
    before = reconstruct(toolpath_of(SHAPES[name]()))
    for degrees in (30.0, None):
        after = remesh(before, 18.0, degrees)
        check_kept(before, after, 18.0)
        assert mean_edge(after) == pytest.approx(18.0, rel=0.1)


@pytest.mark.parametrize("name", ["box", "torus standing", "Y-branch"])
def test_the_printed_volume_is_remeshed(name):
    before = extrude(toolpath_of(SHAPES[name]()), 30.0)
    after = remesh(before, 12.0)
    check_kept(before, after, 12.0)
    assert mean_edge(after) == pytest.approx(12.0, rel=0.1)


@pytest.mark.parametrize(
    ("degrees", "size"),
    [(30.0, 110.0), (None, 110.0), *(pytest.param(d, 200.0, marks=pytest.mark.soak) for d in (30.0, None))],
)
def test_shells_of_marching_cubes_are_remeshed_whatever_edges_are_kept(degrees, size):
    before = brick(schwarz_d, size=size, points=round(0.18 * size))
    after = remesh(before, 9.0, degrees)
    check_kept(before, after, 9.0)
    assert mean_edge(after) == pytest.approx(9.0, rel=0.1)
    assert signed_volume(after) == pytest.approx(signed_volume(before), rel=0.02)


@pytest.mark.soak
def test_a_gyroid_sliced_in_thin_layers_is_remeshed():
    before = reconstruct(toolpath_of(brick(size=200.0, points=60), 8.0))
    for degrees in (30.0, None):
        after = remesh(before, 8.0, degrees)
        check_kept(before, after, 8.0)
        assert mean_edge(after) == pytest.approx(8.0, rel=0.1)


def test_walls_thinner_than_the_bend_of_an_edge_do_not_cut_through():
    """A ball whose cavity is 0.3 below its skin: an edge of 18 bends by 0.6."""
    skin, cavity = trimesh.creation.icosphere(4, 60.0), trimesh.creation.icosphere(4, 59.7)
    cavity.invert()
    both = trimesh.util.concatenate([skin, cavity])
    before = make_surface(both.vertices, both.faces)
    after = remesh(before, 18.0)
    check_kept(before, after, 18.0)


def test_details_finer_than_an_edge_stay():
    """A ring thinner than an edge is long keeps its hole, with shorter edges."""
    before = torus(R=120.0, r=12.0)
    after = remesh(before, 90.0)
    check_kept(before, after, 90.0)
    assert euler(after) == 0
    assert mean_edge(after) < 90.0


def test_a_surface_that_cuts_itself_is_remeshed_and_cuts_itself_only_there():
    one, two = trimesh.creation.box((100.0, 100.0, 100.0)), trimesh.creation.icosphere(3, 50.0)
    both = trimesh.util.concatenate([one, two.apply_translation([80.0, 0.0, 0.0])])
    before = make_surface(both.vertices, both.faces)
    after = remesh(before, 10.0)
    assert manifold_faults(after) == (0, 0)
    assert (euler(after), bodies(after)) == (4, 2)
    with pytest.raises(SurfaceError, match="cuts itself"):
        check_self_intersection(before)
    first, second = after.split()
    for part in (first, second):
        check_self_intersection(make_surface(part.vertices, part.faces))


def test_a_circular_edge_is_kept():
    part = trimesh.creation.cylinder(80.0, 100.0, sections=96)
    after = remesh(make_surface(part.vertices, part.faces), 12.0)
    high = np.asarray(after.vertices)[np.isclose(np.asarray(after.vertices)[:, 2], 50.0)]
    rim = high[np.isclose(np.hypot(high[:, 0], high[:, 1]), 80.0, rtol=1e-3)]
    angles = np.sort(np.arctan2(rim[:, 1], rim[:, 0]))
    gaps = 80.0 * np.diff(np.r_[angles, angles[0] + 2.0 * np.pi])
    assert gaps.max() < 1.5 * 12.0
    # The top is flat, and the edge of the polygon of chords that the rim allows.
    flat = np.isclose(np.asarray(after.triangles)[:, :, 2], 50.0, atol=1e-9).all(axis=1)
    assert np.asarray(after.area_faces)[flat].sum() == pytest.approx(np.pi * 80.0**2, rel=0.01)


def test_the_same_part_elsewhere_is_remeshed_as_well():
    turn = trimesh.transformations.rotation_matrix(1.0, [1.0, 2.0, 3.0], [100.0, 0.0, 0.0])
    part = box()
    moved = make_surface(trimesh.transformations.transform_points(part.vertices, turn), part.faces)
    after = remesh(moved, 15.0)
    assert signed_volume(after) == pytest.approx(200.0**3, rel=1e-9)


# The steps


def net(subdivisions=2):
    ball = trimesh.creation.icosphere(subdivisions, 50.0)
    faces = np.asarray(ball.faces, dtype=np.int64)
    return net_of(np.asarray(ball.vertices), faces, np.zeros(3 * len(faces), dtype=np.bool_))


def check_net(one):
    """Half-edges fit what they are told from the faces alone."""
    points, faces = mesh_of(packed(one))
    surface = make_surface(points, faces)
    assert manifold_faults(surface) == (0, 0)
    assert euler(surface) == 2
    plain = packed(one)
    np.testing.assert_array_equal(plain.across, opposite_half_edges(faces, len(points)))
    np.testing.assert_array_equal(plain.corner[plain.out], np.arange(len(points)))
    np.testing.assert_array_equal(plain.sharp, plain.sharp[plain.across])


def test_splits_flips_and_collapses_keep_a_net_whole():
    one = packed(net(), room=400)
    rng = np.random.default_rng(1)
    room = np.empty(64, np.int64)
    for _ in range(300):
        h = int(rng.integers(3 * one.used[1]))
        split(one, h)
    check_net(one)
    for v in range(one.used[0] - 100, one.used[0]):
        # The middle of an edge has four edges: flipping one that it is not an end of is always possible.
        h = one.out[v]
        ahead = h + 1 if h % 3 < 2 else h - 2
        t = one.across[ahead]
        a, b = one.corner[ahead - 2 if ahead % 3 == 2 else ahead + 1], one.corner[t]
        c, d = one.corner[ahead - 1 if ahead % 3 else ahead + 2], one.corner[t - 1 if t % 3 else t + 2]
        del a, b
        points, faces = mesh_of(packed(one))
        edges = {tuple(sorted(e)) for e in make_surface(points, faces).edges_unique.tolist()}
        if (
            tuple(sorted((c, d))) not in edges
            and min(np.bincount(faces.ravel())[[one.corner[ahead], one.corner[t]]]) > 3
        ):
            flip(one, ahead)
            check_net(one)
            break
    # A vertex put into an edge and drawn back to its end leaves the net as it was.
    two = packed(net(), room=1)
    points, faces = mesh_of(packed(two))
    v = split(two, 7)
    h = next(
        h
        for h in range(3 * two.used[1])
        if two.corner[h] == v and two.corner[two.across[h]] == faces.ravel()[7]
    )
    collapse(two, h, room)
    check_net(two)
    again = make_surface(*mesh_of(packed(two)))
    assert signed_volume(again) == pytest.approx(signed_volume(make_surface(points, faces)), rel=1e-12)


def test_splitting_says_when_there_is_no_room_and_goes_on_after():
    one = net()
    assert not split_long(one, 2.0)
    while not split_long(one, 8.0):
        one = packed(one, room=len(one.points))
    check_net(one)
    points, faces = mesh_of(packed(one))
    assert np.asarray(make_surface(points, faces).edges_unique_length).max() <= 8.0


def test_locked_vertices_stay_where_they_are():
    one = net(3)
    one.points[:] += np.random.default_rng(2).uniform(-2.0, 2.0, one.points.shape)
    points, faces = mesh_of(one)
    one.locked[:] = points[:, 2] > 0.0
    tree = face_tree(points, faces)
    for _ in range(3):
        flip_edges(one, 100.0, tree, 5.0, 0.5, True)
        spread(one, 100.0, tree, 5.0)
    np.testing.assert_array_equal(one.points[one.locked], points[one.locked])
    assert not np.array_equal(one.points, points)


def test_the_nearest_point_is_that_of_another_library_and_faces_the_same_way():
    part = sphere(50.0, 3)
    tree = face_tree(np.asarray(part.vertices), np.asarray(part.faces, dtype=np.int64))
    points = np.random.default_rng(3).uniform(-60, 110, (200, 3))
    wanted = trimesh.proximity.closest_point(part, points)[1]
    zero = (0.0, 0.0, 0.0)
    found = [facing_point(tree, tuple(p), zero, 1e3, 0.0)[0] for p in points]
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    # From the top, a look downwards meets the bottom; out of reach there is nothing.
    away, x, y, z = facing_point(tree, (0.0, 0.0, 100.0), (0.0, 0.0, -1.0), 1e3, 0.0)
    assert z < 60.0
    assert away == pytest.approx(np.linalg.norm([x, y, 100.0 - z]))
    assert facing_point(tree, (0.0, 0.0, 200.0), zero, 50.0, 0.0)[0] == np.inf
