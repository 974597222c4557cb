"""Build directions: figures against closed forms and against slicing, and rankings that everyone would make."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from shapes import SHAPES, box, rotated, sphere, stepped_box, y_branch

from twins import Plane, SurfaceError, layer_planes, make_surface, slice_surface
from twins.overhang.orientation import STANDS_DEG, best_orientation, candidate_directions
from twins.overhang.surfaces import surface_overhang

Z = [[0.0, 0.0, 1.0]]


def cone(radius=100.0, height=250.0):
    mesh = trimesh.creation.cone(radius, height, sections=256)
    return make_surface(mesh.vertices, mesh.faces)


def leaning(shift, side=100.0, height=200.0):
    """A prism on a square, its top moved aside."""
    part = box(side, side, height)
    vertices = np.array(part.vertices)
    vertices[:, 0] += shift * vertices[:, 2] / height
    return make_surface(vertices, part.faces)


def angle_between(a, b):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b)))


def test_figures_of_a_sphere():
    R, t = 150.0, 10.0
    for degrees in (30.0, 45.0):
        theta = np.radians(degrees)
        (o,) = best_orientation(sphere(R, 5), degrees, t, Z).ranked
        assert o.share_over == pytest.approx((1 - np.sin(theta)) / 2, abs=0.01)
        assert o.area_over == pytest.approx(o.share_over * sphere(R, 5).area)
        # The integral of (angle - theta) cos(angle) from theta to 90°, by parts.
        assert np.radians(o.excess_deg) == pytest.approx((np.pi / 2 - theta - np.cos(theta)) / 2, rel=0.02)
        assert o.height == pytest.approx(2 * R, rel=1e-3)
        assert o.print_length == pytest.approx(np.pi**2 * R**2 / t, rel=5e-3)
        assert o.base_area == pytest.approx(np.pi * (2 * R * t / 2 - (t / 2) ** 2), rel=0.01)
        stand = np.arctan2(np.sqrt(R * t - (t / 2) ** 2), R)
        assert o.tilt_deg == pytest.approx(np.degrees(stand), rel=0.01)
    # 99 % of the area: the last one hangs over more than arcsin(0.98).
    assert np.tan(np.radians(o.worst_deg)) == pytest.approx(np.tan(np.arcsin(0.98)), rel=0.03)


@pytest.mark.parametrize("side", ["below", "both"])
@pytest.mark.parametrize("name", [*SHAPES, "turned Y-branch"])
def test_figures_are_those_of_the_sliced_part(name, side):
    part = rotated(y_branch(), 5) if name == "turned Y-branch" else SHAPES[name]()
    (o,) = best_orientation(part, 35.0, 5.0, Z, side).ranked
    height = float(np.ptp(part.vertices[:, 2]))
    planes = layer_planes(Plane.horizontal(), height, 5.0)
    toolpath = slice_surface(part, planes)
    assert o.height == pytest.approx(height)
    assert o.print_length == pytest.approx(toolpath.length * planes.thickness / 5.0, rel=0.03)
    first = sum(curve.signed_area for curve in toolpath.layers[0].curves)
    assert o.base_area == pytest.approx(first, rel=0.03, abs=50.0)
    over = surface_overhang(part, side=side)
    assert o.area_over == pytest.approx(over.above(np.tan(np.radians(35.0))))
    assert o.worst_deg == pytest.approx(np.degrees(np.arctan(over.quantile(0.99))), abs=0.06)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_cone_stands_on_its_base_however_it_comes(seed):
    part = rotated(cone(), seed)
    tip = np.argmax(np.linalg.norm(part.vertices - part.centroid, axis=1))
    base_normal = part.face_normals[(part.faces != tip).all(axis=1)][0]
    ranking = best_orientation(part, 17.0)
    up = ranking.best.direction
    assert angle_between(up, -base_normal) < 0.2
    assert up @ (part.vertices[tip] - part.centroid) > 0
    assert ranking.best.area_over == 0.0
    assert ranking.best.base_area == pytest.approx(np.pi * (100 * (1 - 5 / 250)) ** 2, rel=2e-3)
    stood = ranking.best.applied_to(part)
    assert stood.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    assert stood.vertices[:, 2].max() == pytest.approx(250.0)
    # Stood up, it is best as it is.
    again = best_orientation(stood, 17.0)
    assert angle_between(again.best.direction, [0, 0, 1]) < 0.2
    assert again.as_given.area_over == 0.0


def test_turning_the_part_turns_the_ranking():
    part, directions = y_branch(), np.random.default_rng(3).normal(size=(12, 3))
    R = Rotation.random(None, np.random.default_rng(6)).as_matrix()
    turned = make_surface(np.asarray(part.vertices) @ R.T, part.faces)
    here = best_orientation(part, 27.0, candidates=np.vstack([Z, R.T @ [0, 0, 1], directions]))
    there = best_orientation(turned, 27.0, candidates=np.vstack([R @ [0, 0, 1], Z, directions @ R.T]))
    assert len(here.ranked) == len(there.ranked) == 14
    assert np.array([o.direction for o in here.ranked]) @ R.T == pytest.approx(
        np.array([o.direction for o in there.ranked]), abs=1e-9
    )
    for a, b in zip(here.ranked, there.ranked, strict=True):
        assert [a.area_over, a.height, a.base_area, a.print_length, a.tilt_deg] == pytest.approx(
            [b.area_over, b.height, b.base_area, b.print_length, b.tilt_deg], rel=1e-6
        )
        for o in (a, b):
            assert o.rotation @ o.direction == pytest.approx([0, 0, 1], abs=1e-12)
            assert o.rotation @ o.rotation.T == pytest.approx(np.eye(3), abs=1e-12)
            assert np.linalg.det(o.rotation) == pytest.approx(1.0)


def test_a_plate_lies_flat_and_a_part_that_would_fall_does_not_stand():
    plate = rotated(box(300.0, 200.0, 20.0), 2)
    assert best_orientation(plate).best.height == pytest.approx(20.0)
    # A prism falls once its middle is beside its base; 5 mm of it are below the section.
    for shift, stands in ((60.0, True), (140.0, False)):
        (o,) = best_orientation(leaning(shift), 45.0, 10.0, Z).ranked
        assert (o.tilt_deg > STANDS_DEG) == stands
        reach = 50.0 - 0.5 * shift + shift * 5.0 / 200.0
        assert o.tilt_deg == pytest.approx(np.degrees(np.arctan2(reach, 100.0)), abs=1.0)
    assert best_orientation(leaning(140.0)).best.tilt_deg >= STANDS_DEG


def test_the_way_up_that_stands_and_hangs_over_less_is_better():
    # Upside down the branch stands on two feet; on its side it hangs over along its whole length.
    ranking = best_orientation(y_branch(), 17.0)
    over = [o.excess_deg for o in ranking.ranked if o.tilt_deg >= STANDS_DEG]
    assert ranking.best.excess_deg <= min(over) + 0.5
    assert all(o.tilt_deg < STANDS_DEG for o in ranking.ranked[len(over) :])
    assert sum(o is ranking.as_given for o in ranking.ranked) == 1


def test_candidates_hold_axes_flat_faces_and_ways_to_lie():
    for part in (rotated(box(100.0, 70.0, 40.0), 7), rotated(stepped_box(), 8)):
        found = candidate_directions(part, spread=0)
        for normal in part.face_normals:
            assert min(angle_between(normal, d) for d in found) < 0.1
    assert np.array_equal(found[0], [0, 0, 1])
    ball = candidate_directions(sphere(), spread=200)
    everywhere = Rotation.random(300, np.random.default_rng(1)).as_matrix()[:, :, 0]
    assert np.degrees(np.arccos((everywhere @ ball.T).max(axis=1))).max() < 15.0
    assert np.linalg.norm(ball, axis=1) == pytest.approx(1.0)


def test_the_plane_through_three_feet_is_a_way_to_stand():
    tips = np.array([[80.0, 20.0, 0.0], [-60.0, 60.0, 12.0], [-30.0, -80.0, -15.0]])
    legs = [
        trimesh.convex.convex_hull(np.vstack([tip, tip * [1, 1, 0] + corners]))
        for tip, corners in ((t, [[x, y, 70.0] for x in (-15, 15) for y in (-15, 15)]) for t in tips)
    ]
    disc = trimesh.creation.cylinder(120.0, 20.0).apply_translation([0, 0, 70])
    table = trimesh.boolean.union([disc, *legs], engine="manifold")
    part = make_surface(table.vertices, table.faces)
    normal = np.cross(tips[1] - tips[0], tips[2] - tips[0])
    up = normal / np.linalg.norm(normal)
    found = candidate_directions(part, spread=0)
    closest = found[np.argmax(found @ up)]
    assert angle_between(closest, up) < 0.2
    (stood,) = (o for o in best_orientation(part, candidates=[up]).ranked if o.direction[2] < 1.0)
    assert stood.tilt_deg > STANDS_DEG


def test_an_executor_changes_nothing_and_progress_is_told():
    told = []
    alone = best_orientation(y_branch(), progress=told.append)
    with ThreadPoolExecutor(2) as executor:
        shared = best_orientation(y_branch(), executor=executor)
    assert [o.direction.tolist() for o in alone.ranked] == [o.direction.tolist() for o in shared.ranked]
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_what_cannot_be_ranked_is_refused():
    part = box()
    for arguments, says in (
        ({"limit_deg": 0.0}, "between 0° and 90°"),
        ({"limit_deg": 90.0}, "between 0° and 90°"),
        ({"limit_deg": float("nan")}, "between 0° and 90°"),
        ({"thickness": -1.0}, "thickness"),
        ({"side": "above"}, "side"),
        ({"candidates": [[0.0, 0.0, 0.0]]}, "candidate 0 is the zero vector"),
    ):
        with pytest.raises(SurfaceError, match=says):
            best_orientation(part, **arguments)
    with pytest.raises(SurfaceError, match="flat"):
        best_orientation(make_surface([[0, 0, 0], [1, 0, 0], [0, 1, 0.0], [1, 1, 0]], [[0, 1, 2], [1, 3, 2]]))
    with pytest.raises(SurfaceError, match="no faces"):
        best_orientation(make_surface(np.zeros((0, 3)), np.zeros((0, 3), int)))


@pytest.mark.parametrize("seed", range(4))
def test_the_base_is_the_section_in_the_middle_of_the_first_layer(seed):
    part = rotated(box(120.0, 80.0, 50.0), seed)
    height = float(np.ptp(part.vertices[:, 2]))
    for layers in (2, 3, 7):
        (o,) = best_orientation(part, 45.0, height / layers, Z).ranked
        toolpath = slice_surface(part, layer_planes(Plane.horizontal(), height, height / layers), 5.0)
        exact = sum(curve.signed_area for curve in toolpath.layers[0].curves)
        assert o.base_area == pytest.approx(exact, rel=1e-6)
