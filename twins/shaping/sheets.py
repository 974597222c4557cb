"""Sheets: an open cutting surface, closed to a solid that reaches beyond the part."""

from __future__ import annotations

import numpy as np
import shapely
import trimesh

from twins.errors import SurfaceError
from twins.holes import boundary_loops
from twins.mesh_edges import arrays_of
from twins.surface import make_surface


def prism_on(sheet: trimesh.Trimesh, part: trimesh.Trimesh) -> trimesh.Trimesh:
    """The solid below an open sheet, deep enough to hold all of a part that is on that side.

    Below is the direction that the sheet's mean normal points away from.

    Raises:
        SurfaceError: the sheet has no one rim, folds over itself seen along its mean normal, or does not reach across
            the part.
    """
    vertices, faces = arrays_of(sheet)
    rims = boundary_loops(faces)
    if len(rims) != 1:
        raise SurfaceError(
            f"the cutting surface has {len(rims)} rims; use a closed surface, or an open one with a single rim"
        )
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    up = normals.sum(axis=0)
    if not np.linalg.norm(up) > 0.0 or (normals @ up <= 0.0).any():
        raise SurfaceError(
            "the cutting surface folds over itself seen along its mean normal; cut with flatter pieces, one by one"
        )
    up = up / np.linalg.norm(up)
    x = np.linalg.svd(up[None])[2][1]
    axes = np.column_stack([x, np.cross(up, x)])
    outline = shapely.Polygon(vertices[rims[0]] @ axes)
    reached = shapely.convex_hull(shapely.LineString(np.asarray(part.vertices) @ axes))
    if not outline.is_valid or not outline.contains(reached):
        raise SurfaceError(
            "the cutting surface does not reach across the whole part; extend it on all sides beyond the part"
        )
    depth = float((vertices @ up).max() - min((np.asarray(part.vertices) @ up).min(), (vertices @ up).min()))
    floor = vertices - 2.0 * depth * up - 1.0 * up
    n = len(vertices)
    # Rims run as a closing face has them, and so do the walls.
    p, q = rims[0], np.roll(rims[0], -1)
    walls = np.concatenate([np.column_stack([p, q, q + n]), np.column_stack([p, q + n, p + n])])
    solid = make_surface(np.vstack([vertices, floor]), np.vstack([faces, faces[:, ::-1] + n, walls]))
    used = np.unique(solid.faces)
    return make_surface(solid.vertices[used], np.searchsorted(used, solid.faces))
