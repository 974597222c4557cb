"""The demo part: a vault springer, swept along an arc, with an opening through its sides.

A square section with rounded corners is swept along a circular arc; an elliptical cylinder across the sweep is
taken away at mid-length. Sliced rotary, between the plane at the arc's start and the plane at its end, every
layer is a section of the sweep, and the local layer height varies with the distance from the arc's axis.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely
import trimesh

from twins import Plane, make_surface
from twins.surface import welded

Array = npt.NDArray[np.float64]

SIDE = 180.0
CORNER = 30.0
RADIUS = 900.0
ANGLE = np.radians(28.0)
OPENING = (70.0, 110.0)  # across and along the sweep


def springer(scale: float = 1.0, steps: int = 112, corner_points: int = 12) -> trimesh.Trimesh:
    """The springer as a closed surface that stands on z = 0 and leans towards -x, mm."""
    section = (
        shapely.box(-SIDE / 2, -SIDE / 2, SIDE / 2, SIDE / 2).buffer(-CORNER).buffer(CORNER, corner_points)
    )
    ring = np.asarray(shapely.segmentize(shapely.normalize(section).exterior, 10.0).coords)[:-1]
    if not shapely.LinearRing(ring).is_ccw:
        ring = ring[::-1]
    sweep = _sweep(ring, steps)
    opening = trimesh.creation.cylinder(radius=1.0, height=2.0 * SIDE, sections=96)
    opening.apply_scale([0.5 * OPENING[0], 0.5 * OPENING[1], 1.0])
    # The cylinder's axis along y, its long diameter along the sweep at mid-length.
    middle = 0.5 * ANGLE
    axes = np.eye(4)
    axes[:3, 0] = [np.cos(middle), 0.0, np.sin(middle)]
    axes[:3, 1] = [-np.sin(middle), 0.0, np.cos(middle)]
    axes[:3, 2] = np.cross(axes[:3, 0], axes[:3, 1])
    axes[:3, 3] = [RADIUS * (np.cos(middle) - 1.0), 0.0, RADIUS * np.sin(middle)]
    opening.apply_transform(axes)
    part = trimesh.boolean.difference([sweep, opening], engine="manifold")
    return make_surface(*_clean(np.asarray(part.vertices) * scale, np.asarray(part.faces)))


def springer_top(scale: float = 1.0) -> Plane:
    """The plane at the end of the sweep."""
    c, s = float(np.cos(ANGLE)), float(np.sin(ANGLE))
    return Plane(
        np.array([RADIUS * (c - 1.0), 0.0, RADIUS * s]) * scale,
        np.array([c, 0.0, s]),
        np.array([0.0, 1.0, 0.0]),
    )


def _sweep(ring: Array, steps: int) -> trimesh.Trimesh:
    angle = np.linspace(0.0, ANGLE, steps + 1)
    radius = RADIUS + ring[:, 0]
    x = radius * np.cos(angle)[:, None] - RADIUS
    z = radius * np.sin(angle)[:, None]
    y = np.broadcast_to(ring[:, 1], x.shape)
    n = len(ring)
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    a = (np.arange(steps)[:, None] * n + np.arange(n)).ravel()
    b = (np.arange(steps)[:, None] * n + (np.arange(n) + 1) % n).ravel()
    sides = np.concatenate([np.column_stack([a, b, b + n]), np.column_stack([a, b + n, a + n])])
    ends = np.concatenate([[[-RADIUS + RADIUS, 0.0, 0.0]], [springer_top().origin]])
    first, last = len(vertices), len(vertices) + 1
    i = np.arange(n)
    j = (i + 1) % n
    bottom = np.column_stack([j, i, np.full(n, first)])
    top = np.column_stack([i, j, np.full(n, last)]) + np.array([steps * n, steps * n, 0])
    return make_surface(np.vstack([vertices, ends]), np.concatenate([sides, bottom, top]))


def _clean(vertices: Array, faces: npt.NDArray[np.int64]) -> tuple[Array, npt.NDArray[np.int64]]:
    mesh = welded(vertices, faces)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)
