"""Shapes that the tests slice; all stand on z = 0, mm."""

from __future__ import annotations

import numpy as np
import trimesh

from twins import Plane, make_surface


def box(x=200.0, y=200.0, z=200.0):
    mesh = trimesh.creation.box((x, y, z))
    mesh.apply_translation([0, 0, z / 2])
    return make_surface(mesh.vertices, mesh.faces)


def stepped_box():
    part = trimesh.boolean.difference(
        [
            trimesh.creation.box(bounds=[[0, 0, 0], [200, 200, 200]]),
            trimesh.creation.box(bounds=[[100, 100, 100], [300, 300, 300]]),
        ],
        engine="manifold",
    )
    return make_surface(part.vertices, part.faces)


def sphere(radius=150.0, subdivisions=4):
    mesh = trimesh.creation.icosphere(subdivisions, radius)
    return make_surface(mesh.vertices + [0, 0, radius], mesh.faces)


def torus(standing=False, R=120.0, r=45.0, around=96, across=40):
    a, b = np.meshgrid(
        np.linspace(0, 2 * np.pi, around, endpoint=False),
        np.linspace(0, 2 * np.pi, across, endpoint=False),
        indexing="ij",
    )
    ring = R + r * np.cos(b)
    points = np.stack([ring * np.cos(a), ring * np.sin(a), r * np.sin(b)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")

    def index(i, j):
        return ((i % around) * across + j % across).ravel()

    faces = np.concatenate(
        [
            np.column_stack([index(i, j), index(i + 1, j), index(i + 1, j + 1)]),
            np.column_stack([index(i, j), index(i + 1, j + 1), index(i, j + 1)]),
        ]
    )
    if standing:
        points = points[:, [2, 0, 1]]
    points = points - [0, 0, points[:, 2].min()] + 0.37 * np.array([0.01, 0.02, 0.0])
    return make_surface(points, faces)


def y_branch(radius=45.0):
    """Three capsules from a node, cut flat below and above."""

    def capsule(a, b):
        hull = [trimesh.creation.icosphere(3, radius).apply_translation(p) for p in (a, b)]
        return trimesh.convex.convex_hull(np.vstack([m.vertices for m in hull]))

    node = np.array([0.0, 0.0, 150.0])
    union = trimesh.boolean.union(
        [capsule(node, np.array(e)) for e in ([0.0, 0, 0], [110.0, 0, 330], [-110.0, 0, 330])],
        engine="manifold",
    )
    slab = trimesh.creation.box(bounds=[[-500, -500, 0], [500, 500, 330]])
    part = trimesh.boolean.intersection([union, slab], engine="manifold")
    return make_surface(part.vertices, part.faces)


def porous_column():
    """A hollow cylinder with 24 radial holes in four staggered rings: Euler characteristic -48."""
    outer = trimesh.creation.cylinder(150.0, 410.0, sections=128).apply_translation([0, 0, 205])
    inner = trimesh.creation.cylinder(90.0, 500.0, sections=96).apply_translation([0, 0, 205])
    holes = []
    for ring, z in enumerate((70.0, 160.0, 250.0, 340.0)):
        for k in range(6):
            hole = trimesh.creation.cylinder(32.0, 120.0, sections=48)
            turn = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0])
            angle = np.pi / 3 * (k + 0.5 * (ring % 2))
            hole.apply_transform(turn)
            hole.apply_translation([120.0, 0, 0])
            hole.apply_transform(trimesh.transformations.rotation_matrix(angle, [0, 0, 1]))
            hole.apply_translation([0, 0, z])
            holes.append(hole)
    part = trimesh.boolean.difference([outer, inner, *holes], engine="manifold")
    return make_surface(part.vertices, part.faces)


def nested_cavity():
    """A box with a spherical cavity and a solid sphere inside it."""
    block = trimesh.creation.box((200, 200, 200))
    cavity = trimesh.creation.icosphere(3, 60.0)
    cavity.invert()
    core = trimesh.creation.icosphere(3, 25.0)
    mesh = trimesh.util.concatenate([block, cavity, core])
    return make_surface(mesh.vertices + [0, 0, 100.0], mesh.faces)


SHAPES = {
    "box": box,
    "stepped box": stepped_box,
    "sphere": sphere,
    "torus lying": torus,
    "torus standing": lambda: torus(standing=True),
    "Y-branch": y_branch,
    "porous column": porous_column,
    "nested cavity": nested_cavity,
}


def fan_top(surface, degrees=28.0):
    """A top plane tilted by `degrees`, above the part."""
    low, high = np.asarray(surface.vertices).min(axis=0), np.asarray(surface.vertices).max(axis=0)
    a = np.radians(degrees)
    pivot = low[0] - 0.2 * (high[0] - low[0])  # the axis beside the part, parallel to y
    # Far enough beside the part that the fan's last plane clears its top.
    pivot = min(pivot, high[0] - 0.0 - (high[2]) / np.tan(a) - (high[0] - low[0]))
    return Plane(
        np.array([pivot, 0.0, 0.0]), np.array([np.cos(a), 0.0, np.sin(a)]), np.array([0.0, 1.0, 0.0])
    )


def manifold_faults(surface):
    """Edges without exactly two opposite faces and vertices without exactly one fan, counted on the face list alone."""
    faces = np.asarray(surface.faces)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    key = {tuple(edge): 0 for edge in edges.tolist()}
    bad_edges = 0
    for edge in edges.tolist():
        key[tuple(edge)] += 1
    for (a, b), count in key.items():
        if count != 1 or key.get((b, a)) != 1:
            bad_edges += 1
    step = {}
    for a, b, c in faces.tolist():
        step.setdefault(a, {})[b] = c
        step.setdefault(b, {})[c] = a
        step.setdefault(c, {})[a] = b
    bad_vertices = 0
    for ring in step.values():
        start = next(iter(ring))
        seen, at = 1, ring[start]
        while at != start and seen <= len(ring):
            at = ring.get(at, start)
            seen += 1
        bad_vertices += seen != len(ring)
    return bad_edges, bad_vertices
