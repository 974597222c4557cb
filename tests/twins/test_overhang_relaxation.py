"""Overhang relaxation: its energy against a plain transcription, the limits it must reach, and what must not change."""

import numpy as np
import pytest
import trimesh
from shapes import box, brick, level_set, manifold_faults, quads, stepped_box, torus, vase_radius

from twins import (
    Plane,
    SurfaceError,
    check_surface,
    layer_planes,
    make_surface,
    signed_volume,
    slice_surface,
)
from twins.overhang.contact import Contact, FlatTop
from twins.overhang.energy import collapse_energy, normal_energy
from twins.overhang.inversions import inverted_faces, turned_back
from twins.overhang.locks import (
    as_flags,
    lock_base,
    lock_bounds,
    lock_box,
    lock_faces,
    lock_plane,
    lock_rim,
    lock_solid,
)
from twins.overhang.quasi_newton import QuasiNewton
from twins.overhang.relaxation import relax_overhang
from twins.overhang.rigid_shape import RigidShape
from twins.overhang.rotations import best_rotations
from twins.overhang.surfaces import surface_overhang
from twins.overhang.walls import across_walls


def revolved(profile, around):
    """The surface of revolution of a profile (n, 2) of radius and height, open at both ends."""
    angle = 2.0 * np.pi * np.arange(around) / around
    r, z = np.asarray(profile, dtype=float).T
    points = np.dstack([np.outer(r, np.cos(angle)), np.outer(r, np.sin(angle)), np.tile(z[:, None], around)])
    index = np.arange(len(r) * around).reshape(len(r), around)
    return make_surface(points.reshape(-1, 3), quads(index[:-1], index[1:]))


def hollow_vase(step=9.0, wall=12.0):
    """The vase of facts/shapes.md as a closed tube with even triangles, without its floor."""
    z = np.arange(0.0, 400.0 + step / 2, 400.0 / round(400.0 / step))
    outer, inner = np.column_stack([vase_radius(z), z]), np.column_stack([vase_radius(z) - wall, z])
    tube = revolved(np.vstack([outer, inner[::-1]]), round(2 * np.pi * 120 / step))
    around = round(2 * np.pi * 120 / step)
    ends = np.arange(len(tube.vertices)).reshape(-1, around)[[-1, 0]]
    return make_surface(tube.vertices, np.vstack([tube.faces, quads(ends[:1], ends[1:])]))


def ball(points=40):
    def field(x, y, z):
        return 150.0 - np.sqrt(x**2 + y**2 + (z - 150.0) ** 2)

    return level_set(field, [-150, -150, 0], [150, 150, 300], points)


def bridge(step=5.0):
    """A block with a tunnel through it, its ceiling level, 80 wide."""
    part = trimesh.boolean.difference(
        [
            trimesh.creation.box(bounds=[[-100, -40, 0], [100, 40, 160]]),
            trimesh.creation.box(bounds=[[-40, -50, -10], [40, 50, 60]]),
        ],
        engine="manifold",
    )
    vertices, faces = trimesh.remesh.subdivide_to_size(part.vertices, part.faces, step)
    merged = trimesh.Trimesh(vertices, faces, process=True)
    return make_surface(merged.vertices, merged.faces)


def crumpled(seed=0):
    mesh = trimesh.creation.icosphere(1, 10.0)
    moved = mesh.vertices + np.random.default_rng(seed).normal(0.0, 0.6, mesh.vertices.shape)
    return np.array(mesh.vertices), moved, np.array(mesh.faces, dtype=np.int64)


def procrustes(S):
    U, _, Vt = np.linalg.svd(S)
    R = Vt.T @ U.T
    if np.linalg.det(R) < 0:
        R = Vt.T @ np.diag([1.0, 1.0, -1.0]) @ U.T
    return R


# ---- rotations


def test_rotations_are_those_of_the_singular_value_decomposition():
    rng = np.random.default_rng(1)
    S = rng.normal(size=(500, 3, 3))
    S[:100] = np.einsum("ni,nj->nij", rng.normal(size=(100, 3)), rng.normal(size=(100, 3)))  # rank 1
    S[100:200] += 3.0 * np.eye(3)
    R = best_rotations(S)
    assert np.allclose(R @ R.transpose(0, 2, 1), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(R), 1.0)
    reached = np.einsum("nij,nji->n", R, S)
    possible = np.array([np.trace(procrustes(s) @ s) for s in S])
    assert np.allclose(reached, possible, atol=1e-9)
    assert np.allclose(R[100:], [procrustes(s) for s in S[100:]], atol=1e-5)


def test_a_start_changes_nothing_and_no_edges_no_turn():
    S = np.random.default_rng(2).normal(size=(100, 3, 3)) + 2.0 * np.eye(3)
    R = best_rotations(S)
    nudged = best_rotations(S + 1e-3)
    assert np.allclose(best_rotations(S, nudged), R, atol=1e-10)
    assert np.array_equal(best_rotations(np.zeros((2, 3, 3))), np.tile(np.eye(3), (2, 1, 1)))


# ---- energy


def test_energy_is_that_of_spokes_and_rims_ties_volume_and_place():
    old, new, faces = crumpled()
    shape = RigidShape(old, faces, np.ones(len(old), bool), 25.0, keep_volume=True)
    ties = list(zip(*across_walls(old, faces, 25.0), strict=True))
    assert ties
    area = np.zeros(len(old))
    edges = [[] for _ in old]
    for f in faces:
        a, b, c = old[f]
        for k in range(3):
            area[f[k]] += np.linalg.norm(np.cross(b - a, c - a)) / 6.0
            i, j = f[(k + 1) % 3], f[(k + 2) % 3]
            u, v = old[i] - old[f[k]], old[j] - old[f[k]]
            w = 0.5 * (u @ v) / np.linalg.norm(np.cross(u, v))
            for vertex in f:
                edges[vertex].append((i, j, w))
    for i, j in ties:
        edges[i].append((i, j, 2.0 * area[i] / ((old[i] - old[j]) @ (old[i] - old[j]))))
    energy = 0.0
    for around in edges:
        S = sum(w * np.outer(old[j] - old[i], new[j] - new[i]) for i, j, w in around)
        R = procrustes(S)
        energy += sum(w * ((R @ (old[j] - old[i]) - (new[j] - new[i])) ** 2).sum() for i, j, w in around)
    before, after = (signed_volume(make_surface(v, faces)) for v in (old, new))
    energy += 3.0 * area.sum() * (after / before - 1.0) ** 2
    energy += 10.0 * area @ ((new - old) ** 2).sum(axis=1) / (np.ptp(old, axis=0) ** 2).sum()
    assert shape.energy(new, np.zeros_like(new)) == pytest.approx(energy, rel=1e-9)


@pytest.mark.parametrize("both", [True, False])
def test_gradient_is_the_derivative(both):
    old, new, faces = crumpled(3)
    shape = RigidShape(old, faces, np.ones(len(old), bool), 25.0, keep_volume=True)
    rng = np.random.default_rng(4)
    up = np.tile([0.0, 0.0, 1.0], (len(faces), 1)) + 0.1 * rng.normal(size=(len(faces), 3))
    up /= np.linalg.norm(up, axis=1)[:, None]
    weight, aim = 10.0 * shape.areas, np.full(len(faces), 0.4)

    def energy(vertices, gradient):
        scratch = np.empty(len(faces)), np.empty(len(faces))
        return shape.energy(vertices, gradient) + normal_energy(
            vertices, faces, weight, up, aim, both, gradient, *scratch
        )

    gradient = np.zeros_like(new)
    energy(new, gradient)
    for _ in range(10):
        way = rng.normal(size=new.shape)
        rise = energy(new + 1e-5 * way, np.zeros_like(new)) - energy(new - 1e-5 * way, np.zeros_like(new))
        assert rise / 2e-5 == pytest.approx((gradient * way).sum(), rel=1e-5, abs=1e-3)


def test_a_face_may_not_collapse_or_turn_over():
    old, new, faces = crumpled(5)
    edges = np.stack([old[faces[:, (e + 2) % 3]] - old[faces[:, (e + 1) % 3]] for e in range(3)], axis=1)
    rest = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    R = best_rotations(np.random.default_rng(6).normal(0.0, 0.1, (len(old), 3, 3)) + np.eye(3))

    def energy(vertices, gradient, ratio=0.9):
        return collapse_energy(vertices, faces, edges, R, rest, ratio, gradient)

    expected = 0.0
    for f, face in enumerate(faces):
        across = R[face].sum(axis=0) @ np.cross(edges[f, 0], edges[f, 1])
        a, b, c = new[face]
        seen = 0.5 * np.cross(b - a, c - a) @ across / np.linalg.norm(across)
        expected += rest[f] * max(0.0, rest[f] / seen - 0.9) ** 2
    gradient = np.zeros_like(new)
    assert energy(new, gradient) == pytest.approx(expected)
    way = np.random.default_rng(7).normal(size=new.shape)
    rise = energy(new + 1e-5 * way, np.zeros_like(new)) - energy(new - 1e-5 * way, np.zeros_like(new))
    assert rise / 2e-5 == pytest.approx((gradient * way).sum(), rel=1e-5)
    assert energy(old, np.zeros_like(new), 2.0) == 0.0
    new[faces[0, 0]] += 3.0 * (new[faces[0, 1]] - new[faces[0, 0]])
    assert energy(new, np.zeros_like(new)) == np.inf


def test_a_rigid_motion_costs_only_the_way():
    old, _, faces = crumpled()
    shape = RigidShape(old, faces, np.ones(len(old), bool), 25.0, keep_volume=True)
    turned = old @ trimesh.transformations.rotation_matrix(1.0, [1, 2, 3])[:3, :3].T + [5.0, -3.0, 8.0]
    area = np.bincount(faces.ravel(), np.repeat(shape.areas / 3.0, 3))
    way = 10.0 * area[:, None] * (turned - old) / (np.ptp(old, axis=0) ** 2).sum()
    gradient = np.zeros_like(old)
    assert shape.energy(turned, gradient) == pytest.approx((way * (turned - old)).sum())
    assert np.allclose(gradient, 2.0 * way, atol=1e-6)


@pytest.mark.parametrize("level", [None, 3.0])
def test_a_flat_top_moves_as_one_in_a_preconditioned_step(level):
    old, _, faces = crumpled()
    free = np.arange(len(old)) > 0
    normal = np.array([0.6, 0.0, 0.8])
    top = free & (old @ normal > 5.0)
    flat = FlatTop(top, normal, level)
    shape = RigidShape(old, faces, free, 25.0, keep_volume=True, flat=flat)
    contact = Contact(old, free, Plane.horizontal(-100.0), flat)
    rng = np.random.default_rng(8)
    g, h = (rng.normal(size=(free.sum(), 3)).ravel() for _ in range(2))
    step = shape.precondition(g)
    rise = shape.full(step)[top] @ normal
    assert top.sum() > 3
    assert np.ptp(rise) < 1e-9 * np.abs(step).max()
    assert (level is None) or np.abs(rise).max() < 1e-9
    assert np.allclose(contact.along(step, np.zeros(free.sum(), bool)), step, atol=1e-9 * np.abs(step).max())
    # Symmetric and positive definite on what is left.
    assert h @ step == pytest.approx(g @ shape.precondition(h))
    assert g @ step > 0.0


def test_quasi_newton_finds_the_least_of_a_valley():
    scale = np.array([1.0, 30.0, 400.0])

    def evaluate(x):
        return float(scale @ (x - 1.0) ** 2 + ((x - 1.0) ** 4).sum()), 2 * scale * (x - 1.0) + 4 * (
            x - 1.0
        ) ** 3

    search = QuasiNewton(evaluate, lambda g: g / 2.0, np.array([3.0, -2.0, 0.0]))
    assert search.run(200, 1e-14)
    assert np.allclose(search.point, 1.0, atol=1e-5)


# ---- walls


def test_a_plate_is_tied_through_and_a_thick_block_is_not():
    plate = box(60.0, 60.0, 8.0).subdivide().subdivide().subdivide().subdivide()
    vertices, faces = np.array(plate.vertices), np.array(plate.faces)
    here, across = across_walls(vertices, faces, 20.0)
    inner = (np.abs(vertices[:, :2]) < 20.0).all(axis=1)
    assert inner[here].sum() == inner.sum()
    apart = vertices[across] - vertices[here]
    assert np.allclose(np.abs(apart[inner[here], 2]), 8.0)
    assert np.abs(apart[inner[here], :2]).max() < 4.0
    ball_ = trimesh.creation.icosphere(3, 50.0)
    assert len(across_walls(np.array(ball_.vertices), np.array(ball_.faces), 20.0)[0]) == 0


# ---- relaxation


def lower_rim(surface):
    return lock_plane(surface, Plane.horizontal(10.0))


def both_rims(surface):
    return lock_plane(surface, Plane.horizontal(0.0)) | lock_plane(surface, Plane.horizontal(400.0), 0.0)


CASES = {
    "sphere": (ball, 45.0, lower_rim, "below", 0.1),
    "sphere, both ways": (ball, 45.0, lower_rim, "both", 0.1),
    "vase, one rim locked": (hollow_vase, 30.0, lock_base, "below", 0.25),
    "vase, both rims locked": (hollow_vase, 30.0, both_rims, "below", 0.5),
    "vase, both rims locked, both ways": (hollow_vase, 30.0, both_rims, "both", 0.5),
    "gyroid brick": (lambda: brick(size=200.0, points=36), 45.0, lock_bounds, "below", 0.25),
    "bridge": (bridge, 45.0, lock_base, "below", 0.25),
}


@pytest.mark.parametrize("name", CASES)
def test_reaches_the_limit_and_keeps_the_part(name):
    make, limit, lock, side, bar = CASES[name]
    surface = make()
    locked = lock(surface)
    result = relax_overhang(surface, limit, locked=locked, side=side, tolerance=0.2 * bar)
    old, new = np.asarray(surface.vertices), np.asarray(result.surface.vertices)
    assert result.over_before > 0.05 * result.area
    assert result.remaining <= bar
    # The same figure from the public measure.
    free = ~locked[surface.faces].all(axis=1)
    for mesh, area in ((surface, result.over_before), (result.surface, result.over_after)):
        found = surface_overhang(mesh, side=side)
        over = found.weights[free & (found.values > np.tan(np.radians(limit)) + 1e-8)].sum()
        assert over == pytest.approx(area, rel=1e-6, abs=1e-6)
    diagonal = np.linalg.norm(np.ptp(old, axis=0))
    assert abs(signed_volume(result.surface) / signed_volume(surface) - 1.0) <= 0.06
    assert result.volume_change == pytest.approx(signed_volume(result.surface) / signed_volume(surface) - 1.0)
    moved = np.linalg.norm(new - old, axis=1)
    assert 0.0 < result.mean_displacement == pytest.approx(moved.mean())
    assert result.mean_displacement <= 0.03 * diagonal
    assert np.array_equal(new[locked], old[locked])
    assert np.array_equal(result.surface.faces, surface.faces)
    assert result.inverted == inverted_faces(old, new, np.asarray(surface.faces)).sum() == 0
    assert manifold_faults(result.surface) == (0, 0)


def test_walls_stay_walls():
    surface = hollow_vase()
    locked = both_rims(surface)
    faces = np.asarray(surface.faces)
    here, across = across_walls(np.asarray(surface.vertices), faces, 20.0)

    def thickness(mesh):
        return np.linalg.norm(np.asarray(mesh.vertices)[across] - np.asarray(mesh.vertices)[here], axis=1)

    tied, loose = (relax_overhang(surface, 30.0, locked=locked, walls=w).surface for w in (20.0, 0.0))
    change, wild = (np.abs(thickness(mesh) / thickness(surface) - 1.0) for mesh in (tied, loose))
    assert np.quantile(change, 0.95) < 0.15
    assert np.quantile(wild, 0.95) > 2.0 * np.quantile(change, 0.95)


def test_an_open_tube_with_both_rims_locked_reaches_the_limit():
    z = np.linspace(0.0, 200.0, 41)
    tube = revolved(np.column_stack([60.0 + 25.0 * np.cos(2 * np.pi * z / 200.0), z]), 80)
    locked = lock_rim(tube)
    assert locked.sum() == 160
    result = relax_overhang(tube, 32.0, locked=locked, side="both")
    assert result.worst_before_deg > 37.0
    assert result.reached
    assert result.remaining <= 0.02


@pytest.mark.parametrize("side", ["below", "both"])
@pytest.mark.parametrize("detail", [3, 4])
def test_a_ball_on_one_vertex_does_not_sink_through_the_bed(detail, side):
    mesh = trimesh.creation.icosphere(detail, 100.0)
    surface = make_surface(mesh.vertices + [0.0, 0.0, 100.0], mesh.faces)
    assert lock_base(surface).sum() == 1
    result = relax_overhang(surface, 45.0, side=side)
    assert result.reached
    assert result.inverted == 0
    z = np.asarray(result.surface.vertices)[:, 2]
    assert z.min() >= -1e-9
    found = surface_overhang(result.surface, side=side)
    assert found.above(1.0 + 1e-8) == pytest.approx(result.over_after)
    check_surface(result.surface)
    planes = layer_planes(Plane.horizontal(), float(z.max()), 10.0)
    assert all(layer.curves for layer in slice_surface(result.surface, planes).layers)


def test_nothing_sinks_below_a_tilted_bed():
    surface = ball(20)
    R = trimesh.transformations.rotation_matrix(0.2, [1, 0, 0])[:3, :3]
    bed = Plane(np.zeros(3), R[:, 0], R[:, 1])
    surface = make_surface(np.asarray(surface.vertices) @ R.T, surface.faces)
    planes = layer_planes(bed, 300.0, 10.0)
    # Locked by its middle it would lean on its lower half.
    locked = np.abs(bed.height_of(np.asarray(surface.vertices)) - 150.0) < 20.0
    result = relax_overhang(surface, 45.0, locked=locked, planes=planes)
    assert 0.0 < result.over_after < result.over_before
    assert bed.height_of(np.asarray(result.surface.vertices)).min() >= -1e-9


def test_what_is_below_the_bed_goes_no_lower():
    surface = ball(20)
    old = np.asarray(surface.vertices)
    planes = layer_planes(Plane.horizontal(30.0), 300.0, 10.0)
    locked = np.abs(old[:, 2] - 150.0) < 20.0
    new = np.asarray(relax_overhang(surface, 45.0, locked=locked, planes=planes).surface.vertices)
    assert (new[:, 2] >= np.minimum(old[:, 2], 30.0) - 1e-9).all()


@pytest.mark.parametrize("top_locked", [False, True])
def test_a_flat_top_stays_flat_where_both_sides_count(top_locked):
    surface = hollow_vase()
    old = np.asarray(surface.vertices)
    top = old[:, 2] > 399.999
    locked = lock_base(surface) | (top & (old[:, 0] > 0.0) if top_locked else False)
    result = relax_overhang(surface, 30.0, locked=locked, side="both")
    new = np.asarray(result.surface.vertices)
    assert result.reached
    assert np.ptp(new[top, 2]) < 1e-9
    assert new[top, 2].max() == new[:, 2].max()
    assert (abs(new[top, 2].max() - old[top, 2].max()) < 1e-9) == top_locked
    loose = ~locked[surface.faces].all(axis=1)
    found = surface_overhang(result.surface)
    over = found.weights[loose & (found.values > np.tan(np.radians(30.0)) + 1e-8)].sum()
    assert over == pytest.approx(result.over_after, abs=1e-6)


def test_a_ledge_counts_with_both_sides_but_is_left_alone():
    part = stepped_box()
    below, both = (relax_overhang(part, 45.0, side=side) for side in ("below", "both"))
    assert below.over_before == 0.0
    assert below.reached
    assert both.surface is part
    assert not both.reached
    assert both.over_before == both.over_after == pytest.approx(surface_overhang(part).above(1.0))
    assert (below.worst_before_deg, both.worst_before_deg) == (0.0, pytest.approx(90.0))


def test_where_no_face_counts_the_worst_angle_is_0():
    surface = torus()
    result = relax_overhang(surface, 45.0, locked=np.ones(len(surface.vertices), bool))
    assert result.worst_before_deg == result.worst_after_deg == result.area == 0.0


def test_nothing_over_the_limit_returns_the_surface_itself():
    surface = box()
    result = relax_overhang(surface, 45.0)
    assert result.surface is surface
    assert result.reached
    assert (result.iterations, result.over_before, result.remaining, result.max_displacement) == (0, 0, 0, 0)


def test_turning_and_scaling_the_part_turns_and_scales_the_result():
    surface = ball(20)
    old = np.asarray(surface.vertices)
    locked = lower_rim(surface)
    R = trimesh.transformations.rotation_matrix(0.7, [0, 0, 1])[:3, :3]
    plain = relax_overhang(surface, 45.0, locked=locked)
    turned = relax_overhang(make_surface(7.0 * old @ R.T, surface.faces), 45.0, locked=locked)
    assert np.allclose(turned.surface.vertices, 7.0 * np.asarray(plain.surface.vertices) @ R.T, atol=0.5)
    assert plain.remaining == pytest.approx(turned.remaining, abs=0.01)


def bent_tube():
    """A tube bent by 60° and swollen in its middle, open at both ends, and its planes."""
    angle, around = np.radians(np.linspace(0.0, 60.0, 49)), 48
    swell = 60.0 + 30.0 * np.sin(np.pi * angle / angle[-1]) ** 2
    turn = 2.0 * np.pi * np.arange(around) / around
    ring = 300.0 - np.outer(swell, np.cos(turn))
    points = np.dstack(
        [300.0 - ring * np.cos(angle)[:, None], np.outer(swell, np.sin(turn)), ring * np.sin(angle)[:, None]]
    )
    index = np.arange(49 * around).reshape(49, around)
    a = angle[-1]
    end = np.array([300.0 - 300.0 * np.cos(a), 0.0, 300.0 * np.sin(a)])
    top = Plane(end, np.array([np.cos(a), 0.0, -np.sin(a)]), np.array([0.0, 1.0, 0.0]))
    faces = quads(index[:-1], index[1:])
    return make_surface(points.reshape(-1, 3), faces), layer_planes(Plane.horizontal(), top, 10.0)


def test_rotary_layers_turn_the_build_direction():
    tube, planes = bent_tube()
    locked = lock_rim(tube)
    result = relax_overhang(tube, 16.0, locked=locked, planes=planes)
    assert result.reached
    assert result.over_before > 0.08 * result.area
    found = surface_overhang(result.surface, planes, side="below")
    over = found.weights[found.values > np.tan(np.radians(16.0)) + 1e-8].sum()
    assert over == pytest.approx(result.over_after, abs=1e-6 * result.area)
    # Judged by a vertical build direction the bend itself would be the overhang.
    assert surface_overhang(result.surface, side="below").share_above(np.tan(np.radians(16.0))) > 0.2


def test_the_flat_top_of_rotary_layers_stays_in_its_plane():
    tube, planes = bent_tube()
    vertices = np.asarray(tube.vertices)
    rims = np.arange(len(vertices)).reshape(49, 48)[[0, -1]]
    middles = vertices[rims].mean(axis=1)
    fans = [
        np.column_stack([one, np.roll(one, -1), np.full(48, len(vertices) + k)])[:, :: 2 * k - 1]
        for k, one in enumerate(rims)
    ]
    solid = make_surface(np.vstack([vertices, middles]), np.vstack([tube.faces, *fans]))
    check_surface(solid)
    result = relax_overhang(solid, 16.0, planes=planes, side="both")
    assert result.reached
    new = np.asarray(result.surface.vertices)
    assert planes.base.height_of(new).min() >= -1e-9
    assert np.abs(planes.nozzle[-1].height_of(new[[*rims[1], -1]])).max() < 1e-9
    assert np.abs(new - solid.vertices)[rims[1]].max() > 1.0
    found = surface_overhang(result.surface, planes)
    assert found.above(np.tan(np.radians(16.0)) + 1e-8) == pytest.approx(
        result.over_after, abs=1e-6 * result.area
    )


def test_parallel_planes_are_the_default():
    surface = ball(20)
    planes = layer_planes(Plane.horizontal(), 300.0, 10.0)
    results = [relax_overhang(surface, 45.0, locked=lower_rim(surface), planes=p) for p in (None, planes)]
    assert np.allclose(results[0].surface.vertices, results[1].surface.vertices, atol=1e-6)


def test_a_fold_is_turned_back():
    mesh = trimesh.creation.icosphere(3, 50.0)
    old, faces = np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)
    new = old * [1.0, 1.0, 1.3]
    assert not inverted_faces(old, new, faces).any()
    new[100] += 1.6 * (new[faces[(faces == 100).any(axis=1)][0]].sum(axis=0) - 3.0 * new[100])
    assert inverted_faces(old, new, faces).any()
    free = np.ones(len(old), dtype=bool)
    free[:20] = False
    back, left = turned_back(old, new, faces, free)
    assert left == 0
    assert not inverted_faces(old, back, faces).any()
    assert np.array_equal(back[:20], new[:20])


def test_progress_ends_at_one():
    heard = []
    relax_overhang(ball(20), 45.0, progress=heard.append)
    assert heard == sorted(heard)
    assert heard[-1] == 1.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"limit_deg": 90.0}, "between 0° and 90°"),
        ({"limit_deg": float("nan")}, "between 0° and 90°"),
        ({"strength": 0.0}, "strength"),
        ({"tolerance": 0.0}, "share of overhang"),
        ({"tolerance": 1.0}, "share of overhang"),
        ({"side": "above"}, "'both' or 'below'"),
        ({"rounds": 0}, "one round"),
        ({"rounds": 2.5}, "whole ones"),
        ({"locked": []}, "no vertex is locked"),
        ({"locked": np.zeros(len(torus().vertices), bool)}, "choose at least one"),
        ({"planes": layer_planes(Plane.horizontal(-500.0), 1000.0, 10.0)}, "no vertex lies on the bed"),
        ({"walls": float("inf")}, "walls"),
        ({"locked": [100000]}, "index 100000"),
        ({"locked": [0.5]}, "flags"),
        ({"locked": np.zeros(3, bool)}, "shape"),
    ],
)
def test_bad_arguments_are_refused(change, words):
    with pytest.raises(SurfaceError, match=words):
        relax_overhang(torus(), **({"limit_deg": 45.0} | change))


def test_bad_surfaces_are_refused():
    for surface, words in (
        (make_surface(np.zeros((0, 3)), np.zeros((0, 3))), "no faces"),
        (make_surface([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]], [[0, 1, 2]]), "finite"),
        (make_surface(np.eye(3).tolist() + [[0, 0, 0]], [[0, 1, 2], [0, 1, 3]]), "manifold"),
        (make_surface(box().vertices, np.asarray(box().faces)[:, ::-1]), "inside out"),
        (make_surface(np.vstack([box().vertices, [[0, 0, -9.0]]]), box().faces), "belong to no face"),
    ):
        with pytest.raises(SurfaceError, match=words):
            relax_overhang(surface, 45.0)


# ---- locks


def test_locks_choose_by_place():
    surface = ball(20)
    vertices = np.asarray(surface.vertices)
    z = vertices[:, 2]
    assert np.array_equal(lock_plane(surface, Plane.horizontal(40.0)), z <= 40.0)
    assert np.array_equal(lock_plane(surface, Plane.horizontal(40.0), 15.0), np.abs(z - 40.0) <= 15.0)
    assert lock_base(surface)[z.argmin()]
    assert lock_base(surface).sum() == (z <= z.min() + 1e-4).sum()
    assert np.array_equal(
        lock_box(surface, [-999, -999, 100], [999, 0, 200]), (z >= 100) & (z <= 200) & (vertices[:, 1] <= 0)
    )
    assert np.array_equal(lock_bounds(box()), np.ones(8, bool))
    group = surface.face_normals[:, 0] > 0.5
    expected = np.isin(np.arange(len(z)), np.asarray(surface.faces)[group])
    assert np.array_equal(lock_faces(surface, group), expected)
    assert np.array_equal(lock_faces(surface, np.flatnonzero(group)), expected)
    assert not as_flags([], 5).any()


def test_a_solid_locks_what_is_inside_it():
    rng = np.random.default_rng(5)
    points = make_surface(rng.uniform(-60, 60, (4000, 3)), [[0, 1, 2]])
    solid = trimesh.creation.icosphere(3, 50.0)
    radius = np.linalg.norm(points.vertices, axis=1)
    inside = lock_solid(points, make_surface(solid.vertices, solid.faces))
    assert inside[radius < 49.0].all()
    assert not inside[radius > 50.0].any()
    # Points above corners and edges, where a careless ray counts twice or not at all.
    axis = np.arange(-150.0, 151.0, 50.0)
    grid = np.stack(np.meshgrid(axis, axis, axis + 125.0, indexing="ij"), axis=-1).reshape(-1, 3)
    z = grid[:, 2]
    within = (np.abs(grid[:, :2]) < 100).all(axis=1) & (z > 0) & (z < 200)
    beside = (np.abs(np.abs(grid[:, :2]) - 100) > 0).all(axis=1)
    found = lock_solid(make_surface(grid, [[0, 1, 2]]), box().subdivide().subdivide())
    assert within.sum() > 20
    assert np.array_equal(found[beside], within[beside])
    with pytest.raises(SurfaceError, match="selected"):
        lock_solid(points, make_surface(solid.vertices, np.asarray(solid.faces)[1:]))
