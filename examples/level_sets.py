"""Solids as level sets, for the examples: where a function of the place is above 0."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot

import manifold3d
import numpy as np
import trimesh

from twins import check_surface, make_surface

Field = Callable[[float, float, float], float]
Corner = tuple[float, float, float]


def level_set(field: Field, low: Corner, high: Corner, edge: float) -> trimesh.Trimesh:
    """The surface of the solid in a box in which a field is above 0: its largest body, closed, normals outwards.

    Where the box cuts it there are small triangles: lock what is cut.

    Args:
        field: of x, y, z in mm; near its surface about the distance to it, mm.
        low, high: corners of the box, mm; what reaches beyond is cut off flat.
        edge: of the triangles, mm.
    """
    beyond = [*(a - 2.0 * edge for a in low), *(a + 2.0 * edge for a in high)]
    whole = manifold3d.Manifold.level_set(field, beyond, edge, 0.0)
    box = manifold3d.Manifold.cube([b - a for a, b in zip(low, high, strict=True)]).translate(low)
    body = max((whole ^ box).decompose(), key=lambda part: part.volume())
    mesh = body.to_mesh64()
    surface = make_surface(np.asarray(mesh.vert_properties)[:, :3], mesh.tri_verts)
    check_surface(surface)
    return surface


def rounded(a: float, b: float, radius: float) -> float:
    """The lesser of two depths, both in mm; where the solids' faces meet, their edge is round with a radius."""
    near, far = max(radius - a, 0.0), max(radius - b, 0.0)
    return max(min(a, b), radius) - hypot(near, far) if near or far else min(a, b)
