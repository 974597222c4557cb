"""The part of `fig14_springer.py`: a branching vault springer as a subdivision surface.

A cage of quadrilaterals, a tube with six corners that becomes three tubes with four, is subdivided after Catmull and
Clark. Its straight axis is then bent to an arc, so that levels of the cage become planes through the arc's axis: the
planes of rotary layers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from twins import Plane, check_surface, make_surface

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

RADIUS, HEIGHT = 900.0, 440.0  # of the arc that the springer's axis follows, and its length, mm

# The cage that the surface is subdivided from, before its axis is bent; heights along the axis, mm.
TRUNK = (
    (0.0, 160.0, 160.0),
    (60.0, 138.0, 138.0),
    (125.0, 100.0, 92.0),
)  # height; radius below arms, between them
CROTCH = 160.0
# Height; distances from the axis of the inner corner and of the outer one; length of the inner sides.
ARMS = ((205.0, 2.0, 295.0, 185.0), (320.0, 10.0, 305.0, 185.0), (440.0, 85.0, 290.0, 115.0))


def branching_springer(subdivisions: int) -> tuple[trimesh.Trimesh, Plane]:
    """The springer, closed, on z = 0 and leaning towards -x, and the plane that its arms end in."""
    points, quads = _cage()
    for _ in range(subdivisions):
        points, quads = catmull_clark(points, quads)
    points, caps = _lids(points, quads)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]], caps])
    across, y, along = points.T
    turn = along / RADIUS
    bent = np.column_stack([(RADIUS + across) * np.cos(turn) - RADIUS, y, (RADIUS + across) * np.sin(turn)])
    c, s = np.cos(HEIGHT / RADIUS), np.sin(HEIGHT / RADIUS)
    top = Plane(
        np.array([RADIUS * (c - 1.0), 0.0, RADIUS * s]), np.array([c, 0.0, s]), np.array([0.0, 1.0, 0.0])
    )
    surface = make_surface(bent, faces)
    check_surface(surface)
    return surface, top


def _cage() -> tuple[Array, Faces]:
    """Points and quadrilaterals of an open tube that becomes three: six corners around, two of them to an arm."""
    points: list[Any] = []
    quads: list[list[int]] = []

    def ring(corners: list[Any]) -> list[int]:
        points.extend(corners)
        return list(range(len(points) - len(corners), len(points)))

    def tube(lower: list[int], upper: list[int]) -> list[int]:
        n = len(lower)
        quads.extend([lower[i], lower[(i + 1) % n], upper[(i + 1) % n], upper[i]] for i in range(n))
        return upper

    def around(k: float, radius: float, height: float) -> Array:
        return np.array([radius * np.cos(k * np.pi / 3.0), radius * np.sin(k * np.pi / 3.0), height])

    trunk: list[int] = []
    for height, below, between in TRUNK:
        upper = ring([around(k, between if k % 2 else below, height) for k in range(6)])
        trunk = tube(trunk, upper) if trunk else upper
    crotch = ring([around(0, 0.0, CROTCH)])[0]
    for k in (0, 2, 4):
        arm = [crotch, trunk[k - 1], trunk[k], trunk[k + 1]]
        for height, inner, outer, side in ARMS:
            start = around(k, inner, height)
            sides = [start + around(k + turn, side, 0.0) for turn in (-1, 1)]
            arm = tube(arm, ring([start, sides[0], around(k, outer, height), sides[1]]))
    return np.array(points), np.array(quads, dtype=np.int64)


def catmull_clark(points: Array, quads: Faces) -> tuple[Array, Faces]:
    """One step of Catmull-Clark subdivision; open rims become cubic B-splines, so flat ones stay flat."""
    n, m = len(points), len(quads)
    sides = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    edges, of_side, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    of_side, on_rim = of_side.ravel(), count == 1
    middles, centres = points[edges].mean(axis=1), points[quads].mean(axis=1)

    def gathered(at: Faces, values: Array, size: int) -> Array:
        total = np.zeros((size, 3))
        np.add.at(total, at, values)
        return total

    beside = gathered(of_side, np.repeat(centres, 4, axis=0), len(edges))
    on_edges = np.where(on_rim[:, None], middles, 0.25 * (2.0 * middles + beside))
    faces_at = np.bincount(quads.ravel(), minlength=n)[:, None]
    edges_at = np.bincount(edges.ravel(), minlength=n)[:, None]
    centre = gathered(quads.ravel(), np.repeat(centres, 4, axis=0), n) / faces_at
    middle = gathered(edges.ravel(), np.repeat(middles, 2, axis=0), n) / edges_at
    moved = (centre + 2.0 * middle + (faces_at - 3.0) * points) / faces_at
    rim = edges[on_rim]
    along = gathered(rim.ravel(), np.repeat(middles[on_rim], 2, axis=0), n)
    corners = np.unique(rim)
    moved[corners] = 0.5 * points[corners] + 0.25 * along[corners]
    at_edge, at_face = of_side.reshape(m, 4) + n + m, np.arange(m) + n
    new = [np.stack([quads[:, k], at_edge[:, k], at_face, at_edge[:, k - 1]], axis=1) for k in range(4)]
    return np.vstack([moved, centres, on_edges]), np.concatenate(new)


def _lids(points: Array, quads: Faces) -> tuple[Array, Faces]:
    """The points and one in the middle of each open rim, and the triangles that close the rims."""
    sides = np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2).tolist()
    known = {(a, b) for a, b in sides}
    following = {b: a for a, b in sides if (b, a) not in known}
    middles: list[Array] = []
    lids: list[list[int]] = []
    while following:
        start, here = following.popitem()
        rim = [start]
        while here != start:
            rim.append(here)
            here = following.pop(here)
        middle = len(points) + len(middles)
        middles.append(points[rim].mean(axis=0))
        lids += [[a, b, middle] for a, b in zip(rim, rim[1:] + rim[:1], strict=True)]
    return np.vstack([points, *middles]), np.array(lids, dtype=np.int64)
