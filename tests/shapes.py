"""Shapes that the tests slice, mm; all stand on z = 0.

`SHAPES` are quick, mostly exact meshes for tests that run over many of them. `REFERENCE` holds the shapes that
figures are stated for, as level sets of their definition, with a grid of 100 points along the longest side. Each
call returns a mesh of its own.
"""

from __future__ import annotations

from functools import cache, wraps

import numpy as np
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation
from skimage.measure import marching_cubes

from twincell.springer import springer
from twins import Plane, make_surface


def once(make):
    """A shape is made once and copied after that, so that no test can spoil it for another."""
    made = cache(make)

    @wraps(make)
    def copied(*args, **kwargs):
        return made(*args, **kwargs).copy()

    return copied


def box(x=200.0, y=200.0, z=200.0):
    mesh = trimesh.creation.box((x, y, z))
    mesh.apply_translation([0, 0, z / 2])
    return make_surface(mesh.vertices, mesh.faces)


@once
def stepped_box():
    part = trimesh.boolean.difference(
        [
            trimesh.creation.box(bounds=[[0, 0, 0], [200, 200, 200]]),
            trimesh.creation.box(bounds=[[100, 100, 100], [300, 300, 300]]),
        ],
        engine="manifold",
    )
    return make_surface(part.vertices, part.faces)


@once
def sphere(radius=150.0, subdivisions=4):
    mesh = trimesh.creation.icosphere(subdivisions, radius)
    return make_surface(mesh.vertices + [0, 0, radius], mesh.faces)


def quads(lower, upper):
    """Triangles between rings of vertex indices, shape (rings, n) each, facing right of the way from lower to upper."""
    a, b, c, d = lower, np.roll(lower, -1, axis=1), np.roll(upper, -1, axis=1), upper
    return np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).reshape(-1, 3)


@once
def torus(standing=False, R=120.0, r=45.0, around=96, across=40):
    a, b = np.meshgrid(
        np.linspace(0, 2 * np.pi, around, endpoint=False),
        np.linspace(0, 2 * np.pi, across, endpoint=False),
        indexing="ij",
    )
    ring = R + r * np.cos(b)
    points = np.stack([ring * np.cos(a), ring * np.sin(a), r * np.sin(b)], axis=-1).reshape(-1, 3)
    index = np.arange(around * across).reshape(around, across).T
    faces = quads(index, np.roll(index, -1, axis=0))
    if standing:
        points = points[:, [2, 0, 1]]
    points = points - [0, 0, points[:, 2].min()] + 0.37 * np.array([0.01, 0.02, 0.0])
    return make_surface(points, faces)


@once
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


@once
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


@once
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


def level_set(field, low, high, points=100, every_body=False):
    """The surface where a field of (x, y, z), positive inside, is 0, by marching cubes.

    Args:
        field: of three arrays that broadcast, in mm or nearly so: cuts by planes then come out flat.
        low, high: bounds of the solid, shape (3,), mm.
        points: of the grid, along the longest side.
        every_body: keep all bodies instead of the largest.
    """
    low, high = np.asarray(low, float), np.asarray(high, float)
    cell = (high - low).max() / (points - 1)
    counts = np.ceil((high - low) / cell - 1e-9).astype(int) + 5
    start = low + (0.37 - 2.0) * cell
    x, y, z = np.ix_(*(a + cell * np.arange(n) for a, n in zip(start, counts, strict=True)))
    values = np.array(np.broadcast_to(field(x, y, z), counts))
    # A node on the surface would give triangles without area.
    values = np.where(np.abs(values) < 1e-3 * cell, np.copysign(1e-3 * cell, values), values)
    # "descent" turns its faces clockwise around an inside above the level.
    vertices, faces, _, _ = marching_cubes(values, 0.0, gradient_direction="ascent")
    surface = make_surface(start + cell * _refined(vertices, values), faces)
    if not every_body:
        surface = _largest_body(surface)
    return _standing(surface)


def _refined(vertices, values):
    """Vertices on grid edges interpolated again: marching cubes works in single precision."""
    node = np.floor(vertices).astype(np.int64)
    along = vertices - node
    on_edge = np.flatnonzero((along > 0).sum(axis=1) == 1)
    node, direction = node[on_edge], (along[on_edge] > 0).astype(np.int64)
    here, there = values[tuple(node.T)], values[tuple((node + direction).T)]
    exact = vertices.astype(float)
    exact[on_edge] = node + direction * (here / (here - there))[:, None]
    return exact


def _largest_body(surface):
    """The component that encloses the most."""
    vertices, faces = np.asarray(surface.vertices), np.asarray(surface.faces)
    links = coo_matrix(
        (np.ones(2 * len(faces)), (faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel())),
        shape=(len(vertices), len(vertices)),
    )
    body = connected_components(links, directed=False)[1][faces[:, 0]]
    a, b, c = vertices[faces].transpose(1, 0, 2)
    volume = np.bincount(body, np.einsum("ij,ij->i", a, np.cross(b, c)))
    faces = faces[body == volume.argmax()]
    kept = np.zeros(len(vertices), dtype=bool)
    kept[faces] = True
    return make_surface(vertices[kept], (np.cumsum(kept) - 1)[faces])


def _standing(surface, centred=False):
    """Moved to stand on z = 0 exactly, and if wanted with the middle of its bounds over the origin."""
    vertices = np.array(surface.vertices)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle = 0.5 * (low + high)
    vertices -= [middle[0], middle[1], low[2]] if centred else [0.0, 0.0, low[2]]
    return make_surface(vertices, surface.faces)


def _ball(x, y, z, center, radius):
    return radius - np.sqrt((x - center[0]) ** 2 + (y - center[1]) ** 2 + (z - center[2]) ** 2)


def _slab(u, low, high):
    return np.minimum(u - low, high - u)


def _capsules(x, y, z):
    """The Y-branch before it is cut: distance inside three capsules that meet at (0, 0, 150)."""
    node, depth = np.array([0.0, 0.0, 150.0]), -np.inf
    for end in ([0.0, 0.0, 0.0], [110.0, 0.0, 330.0], [-110.0, 0.0, 330.0]):
        arm = np.array(end) - node
        share = ((x - node[0]) * arm[0] + (y - node[1]) * arm[1] + (z - node[2]) * arm[2]) / (arm @ arm)
        share = np.clip(share, 0.0, 1.0)
        depth = np.maximum(
            depth, _ball(x, y, z, [n + share * a for n, a in zip(node, arm, strict=True)], 45.0)
        )
    return depth


def reference_sphere():
    return level_set(lambda x, y, z: _ball(x, y, z, (0, 0, 150), 150.0), [-150, -150, 0], [150, 150, 300])


def reference_torus(standing=False):
    def field(x, y, z):
        axis, *across = (x, y, z - 165.0) if standing else (z - 45.0, x, y)
        return 45.0 - np.hypot(np.hypot(*across) - 120.0, axis)

    side, height = (45.0, 330.0) if standing else (165.0, 90.0)
    return level_set(field, [-side, -165, 0], [side, 165, height])


def vase_radius(z):
    """Outer radius of the vase at a height, mm."""
    return 120.0 + 60.0 * np.sin(2.0 * np.pi * z / 400.0 + 0.6)


def vase(hollow=True):
    def field(x, y, z):
        depth = vase_radius(z) - np.hypot(x, y)
        solid = np.minimum(depth, _slab(z, 0, 400))
        return np.minimum(solid, np.maximum(12.0 - depth, 20.0 - z)) if hollow else solid

    return level_set(field, [-180, -180, 0], [180, 180, 400])


def reference_y_branch():
    def field(x, y, z):
        return np.minimum(_capsules(x, y, z), _slab(z, 0, 330))

    return level_set(field, [-155, -45, 0], [155, 45, 330])


def trousers():
    """The Y-branch upside down, with a window through the crotch."""

    def field(x, y, z):
        window = np.hypot(x, z - 180.0) - 25.0
        return np.minimum(np.minimum(_capsules(x, y, 330.0 - z), _slab(z, 0, 330)), window)

    return level_set(field, [-155, -45, 0], [155, 45, 330])


def reference_nested_cavity():
    def field(x, y, z):
        block = np.minimum(np.minimum(_slab(x, -100, 100), _slab(y, -100, 100)), _slab(z, 0, 200))
        cavity, core = (_ball(x, y, z, (0, 0, 100), radius) for radius in (60.0, 25.0))
        return np.maximum(np.minimum(block, -cavity), core)

    return level_set(field, [-100, -100, 0], [100, 100, 200], every_body=True)


def gyroid(X, Y, Z):
    return np.sin(X) * np.cos(Y) + np.sin(Y) * np.cos(Z) + np.sin(Z) * np.cos(X)


def schwarz_d(X, Y, Z):
    return np.cos(X) * np.cos(Y) * np.cos(Z) - np.sin(X) * np.sin(Y) * np.sin(Z)


def brick(minimal=gyroid, size=400.0, points=100):
    """A cube of a minimal surface of period 200, thickened to |value| ≤ 0.35."""
    k = 2.0 * np.pi / 200.0

    def field(x, y, z):
        block = np.minimum(np.minimum(_slab(x, 0, size), _slab(y, 0, size)), _slab(z, 0, size))
        # Divided by k the values are near to mm, as those of the block are.
        return np.minimum((0.35 - np.abs(minimal(k * x, k * y, k * z))) / k, block)

    return _standing(level_set(field, [0, 0, 0], [size] * 3, points), centred=True)


def reference_porous_column():
    def field(x, y, z):
        radius, angle = np.hypot(x, y), np.arctan2(y, x)
        depth = np.minimum(_slab(radius, 90, 150), _slab(z, 0, 410))
        for ring, height in enumerate((70.0, 160.0, 250.0, 340.0)):
            # The six holes of a ring folded onto one.
            turn = np.pi / 3.0
            folded = (angle - 0.5 * turn * (ring % 2) + 0.5 * turn) % turn - 0.5 * turn
            depth = np.minimum(depth, np.hypot(radius * np.sin(folded), z - height) - 32.0)
        return depth

    return level_set(field, [-150, -150, 0], [150, 150, 410])


def layered_tube():
    """A square tube 500 × 500 × 300 of wall 40, whose layers of 10 mm bulge by 1.5 mm at mid-height, both ways."""
    z = np.linspace(0.0, 300.0, 30 * 8 + 1)
    bulge = 0.75 * (1.0 - np.cos(2.0 * np.pi * z / 10.0))
    pieces = 51  # to a side, so that edges stay below 10
    around = 4 * pieces
    t = np.arange(pieces) / pieces
    side = np.column_stack([np.full(pieces, 0.5), t - 0.5])
    square = np.vstack([side, side[:, ::-1] * [-1, 1], -side, side[:, ::-1] * [1, -1]])
    walls = [
        np.dstack([width[:, None, None] * square, np.repeat(z[:, None], around, axis=1)])
        for width in (500.0 + 2.0 * bulge, 420.0 - 2.0 * bulge)
    ]
    outer, inner = np.arange(2 * len(z) * around).reshape(2, len(z), around)
    faces = [
        quads(outer[:-1], outer[1:]),
        quads(inner[1:], inner[:-1]),
        quads(inner[:1], outer[:1]),
        quads(outer[-1:], inner[-1:]),
    ]
    return make_surface(np.concatenate(walls).reshape(-1, 3), np.concatenate(faces))


REFERENCE = {
    name: once(make)
    for name, make in {
        "sphere": reference_sphere,
        "torus lying": reference_torus,
        "torus standing": lambda: reference_torus(standing=True),
        "vase": vase,
        "spiral vase": lambda: vase(hollow=False),
        "Y-branch": reference_y_branch,
        "trousers with window": trousers,
        "stepped box": stepped_box,
        "nested cavity": reference_nested_cavity,
        "gyroid shell brick": brick,
        "Schwarz-D brick": lambda: brick(schwarz_d),
        "porous column": reference_porous_column,
        "springer": springer,
        "layered tube": layered_tube,
    }.items()
}

# Of the surface, not of the solid; the bricks' follows from no formula.
EULER = dict.fromkeys(("sphere", "vase", "spiral vase", "Y-branch", "stepped box"), 2)
EULER |= dict.fromkeys(
    ("torus lying", "torus standing", "trousers with window", "springer", "layered tube"), 0
)
EULER |= {"nested cavity": 6, "porous column": -48}


def rotated(surface, seed):
    """The surface in a random attitude, put back on z = 0 over the origin."""
    R = Rotation.random(None, np.random.default_rng(seed)).as_matrix()
    return _standing(make_surface(np.asarray(surface.vertices) @ R.T, surface.faces), centred=True)


def fan_top(surface, degrees=28.0):
    """A top plane tilted by `degrees`, above the part."""
    low, high = np.asarray(surface.vertices).min(axis=0), np.asarray(surface.vertices).max(axis=0)
    a = np.radians(degrees)
    # The axis beside the part, parallel to y, far enough away that the fan's last plane clears the part's top.
    pivot = low[0] - max(0.2 * (high[0] - low[0]), high[2] / np.tan(a))
    return Plane(
        np.array([pivot, 0.0, 0.0]), np.array([np.cos(a), 0.0, np.sin(a)]), np.array([0.0, 1.0, 0.0])
    )


def printed_volume(toolpath):
    """Σ region area × local thickness: the thickness of a layer between two planes is linear, so exact at centroids."""
    total = 0.0
    for i, _, layer, curve in toolpath.curves():
        centroid = layer.nozzle.to_world(curve.centroid[None])
        total += curve.signed_area * toolpath.floor_of(i).height_of(centroid)[0]
    return total


def manifold_faults(surface):
    """Edges without exactly two opposite faces, and vertices without exactly one closed fan, from the faces alone."""
    faces = np.asarray(surface.faces, dtype=np.int64)
    n = faces.max() + 1
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    forward, backward = start * n + end, end * n + start
    edges, first, index, count = np.unique(
        forward, return_index=True, return_inverse=True, return_counts=True
    )
    at = np.minimum(np.searchsorted(edges, backward), len(edges) - 1)
    paired = (edges[at] == backward) & (count[at] == 1) & (count[index] == 1)
    # The corner at a of edge (a, b) and the corner behind edge (b, a) are neighbours in a's fan.
    behind = np.roll(np.arange(faces.size).reshape(-1, 3), -1, axis=1).ravel()[first[at]]
    links = coo_matrix(
        (np.ones(paired.sum()), (np.flatnonzero(paired), behind[paired])), shape=(faces.size, faces.size)
    )
    _, corner = np.unique(connected_components(links, directed=False)[1], return_index=True)
    bad = np.bincount(start[corner], minlength=n) > 1
    bad[start[~paired]] = bad[end[~paired]] = True
    return int(len(edges) - paired.sum()), int(bad.sum())
