import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from analysis import MeshingError, TetMesh
from analysis.quadratic import quadratic
from analysis.tetrahedra import EDGES, oriented, signed_volumes

REGULAR = np.array([[1.0, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1]])
UNIT = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
ONE = np.array([[0, 1, 2, 3]])
finite = st.floats(-5, 5)


def test_a_unit_tetrahedron_has_a_sixth_of_a_cube():
    assert TetMesh(UNIT, ONE, [0]).volume == pytest.approx(1 / 6)


def test_a_regular_tetrahedron_has_quality_one_and_a_flat_one_approaches_zero():
    assert TetMesh(REGULAR, oriented(REGULAR, ONE), [0]).quality[0] == pytest.approx(1.0)
    flat = UNIT * [1, 1, 1e-6]
    assert TetMesh(flat, ONE, [0]).quality[0] < 1e-3


@settings(max_examples=30, deadline=None)
@given(st.lists(finite, min_size=12, max_size=12), st.floats(0.1, 100), st.integers(0, 2**31))
def test_quality_does_not_change_with_size_place_or_turn(values, scale, seed):
    points = np.reshape(values, (4, 3))
    tets = oriented(points, ONE)
    if signed_volumes(points, tets)[0] < 1e-3:
        return
    moved = scale * Rotation.random(rng=seed).apply(points) + [3.0, -7.0, 11.0]
    before, after = TetMesh(points, tets, [0]), TetMesh(moved, tets, [0])
    assert after.quality == pytest.approx(before.quality, rel=1e-6)
    assert after.volume == pytest.approx(before.volume * scale**3, rel=1e-6)
    assert 0 < before.quality[0] <= 1 + 1e-12


def test_oriented_turns_only_what_is_inside_out(box_mesh):
    mesh = box_mesh((2, 2, 2), (1.0, 1.0, 1.0))
    turned = np.array(mesh.tets)
    turned[::3, :2] = turned[::3, 1::-1]
    assert (signed_volumes(mesh.points, turned) < 0).sum() == len(turned[::3])
    assert (signed_volumes(mesh.points, oriented(mesh.points, turned)) > 0).all()
    assert np.array_equal(oriented(mesh.points, mesh.tets), mesh.tets)


def test_the_boundary_of_a_box_is_closed_faces_out_and_has_its_area_and_volume(box_mesh):
    mesh = box_mesh((2, 3, 4), (2.0, 3.0, 5.0))
    a, b, c = (mesh.points[mesh.boundary()[:, k]] for k in range(3))
    areas = 0.5 * np.cross(b - a, c - a)
    assert np.linalg.norm(areas, axis=1).sum() == pytest.approx(2 * (6 + 10 + 15))
    assert areas.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    assert (a * areas).sum() / 3 == pytest.approx(30)  # divergence theorem: positive when faces look outwards


def test_arrays_cannot_be_written(box_mesh):
    mesh = box_mesh((1, 1, 1), (1.0, 1.0, 1.0))
    for array in (mesh.points, mesh.tets, mesh.layer):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


@pytest.mark.parametrize(
    ("points", "tets", "layer", "says"),
    [
        (UNIT, [[0, 2, 1, 3]], [0], "inside out"),
        (UNIT * [1, 1, 0], ONE, [0], "flat"),
        (UNIT, [[0, 1, 2, 4]], [0], "outside the 4 points"),
        (UNIT, ONE, [0, 1], "layers of shape"),
        (UNIT, ONE, [-1], "below 0"),
        (np.where(UNIT == 1, np.nan, UNIT), ONE, [0], "not finite"),
        (UNIT, np.empty((0, 4), dtype=int), [], "no tetrahedra"),
        (UNIT[:, :2], ONE, [0], "need points"),
    ],
)
def test_what_is_no_mesh_is_refused(points, tets, layer, says):
    with pytest.raises(MeshingError, match=says):
        TetMesh(points, tets, layer)


def test_mid_side_nodes_are_shared_and_lie_in_the_middle(box_mesh):
    mesh = box_mesh((2, 2, 3), (2.0, 2.0, 3.0))
    fine = quadratic(mesh)
    corners = fine.points[fine.tets[:, :4]]
    assert fine.points[fine.tets[:, 4:]] == pytest.approx(corners[:, EDGES].mean(axis=2))
    assert len(np.unique(fine.points.round(9), axis=0)) == len(fine.points)
    assert np.array_equal(np.unique(fine.tets), np.arange(len(fine.points)))


def test_nodal_volumes_reproduce_volume_and_first_and_second_moments(box_mesh):
    # Consistent loads are exact for every quadratic field: sum N_i f(x_i) = ∫ f dV over the box.
    mesh = box_mesh((2, 3, 2), (2.0, 3.0, 5.0))
    fine = quadratic(mesh)
    nodal = fine.nodal_volumes(mesh.volumes)
    x, y, z = fine.points.T
    assert nodal.sum() == pytest.approx(30.0)
    assert nodal @ z == pytest.approx(30.0 * 2.5)
    assert nodal @ x**2 == pytest.approx(2.0**3 / 3 * 15)
    assert nodal @ (y * z) == pytest.approx(2 * 4.5 * 12.5)


def test_middles_belong_to_a_node_set_when_both_corners_do(box_mesh):
    mesh = box_mesh((2, 2, 2), (1.0, 1.0, 1.0))
    fine = quadratic(mesh)
    standing = np.flatnonzero(mesh.points[:, 2] == 0)
    assert np.array_equal(fine.with_middles(standing), np.flatnonzero(fine.points[:, 2] == 0))
