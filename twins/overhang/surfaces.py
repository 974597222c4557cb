"""Local overhang of a surface: what `local.py` measures on a toolpath, in the limit of thin layers.

It is the tangent of the angle between a face's normal and the layer plane (seed paper, Section 3.1). Where layers are
rotary, that plane and with it the build direction turn along the part.

A toolpath's layers are not thin. Its value is near that of the surface midway between sample point and supporter: on a
round section it is greater by 1 / cos of half the angle through which the normal turns on that way, by 2 % where it
turns by 23°. By ground, the way leads t tan α across a layer whose plane is tilted by α, so that the two agree on steep
planes only if layers are thin: to 2 % on a tube of radius 60 in layers of 10 mm up to a tilt of 65°, in layers of
0.5 mm up to 88°.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
import trimesh

from twins.errors import SurfaceError
from twins.frames import Frames
from twins.planes import PlaneStack

from .distribution import Measured
from .supporters import DOWN, Reference, checked_gravity

Array = npt.NDArray[np.float64]
FacingSide = Literal["both", "below"]

FLAT = 1e-7
"""Sine of the angle between a face and its layer below which it has no curve to print."""

ON_BED = 1e-5
"""How near to the bed the vertices of a face are that lies on it, as a share of the part's extent."""


@dataclass(frozen=True, eq=False)
class SurfaceOverhang(Measured):
    """Local overhang of every face of a surface.

    It can be asked for `maximum`, `quantile(share)`, `above(limit)` and `share_above(limit)`, weighted by area.

    Attributes:
        values: tangent of the overhang angle of each face, shape (m,); 0 on the bed, inf where a face lies flat in
            its layer.
        weights: area of each face, shape (m,), mm².
        directions: unit normal of the layer plane at each face, shape (m, 3): the build direction.
        reference: "ground" or "layer".
    """

    directions: Array
    reference: Reference


def surface_overhang(
    surface: trimesh.Trimesh,
    planes: PlaneStack | None = None,
    reference: Reference = "layer",
    side: FacingSide = "both",
    gravity: npt.ArrayLike = DOWN,
) -> SurfaceOverhang:
    """The local overhang of every face of a surface, as of the toolpath that thin layers would give.

    With n the face's normal, m the normal of the layer plane at the face's centre and g gravity, it is
    |n · m| / |n × m| by layer and |n · g| / |n × m| by ground: a step down the way of the reference, and from there
    in the layer plane to the surface. Where m is vertical, both are the tangent of the angle of n with the plane.

    Faces on the bed are carried by it: 0. A toolpath's first layer has overhang 0 as a whole; here only the faces
    that touch the bed have.

    Args:
        surface: in mm.
        planes: that slice it; default parallel planes, square to gravity, on a bed at the surface's lowest point.
        reference: "ground" or "layer".
        side: "both" as toolpaths are measured, whose bead hangs over inwards as well; "below" leaves out faces that
            look up, as far as the step down leads: 0.
        gravity: direction, shape (3,).

    Raises:
        SurfaceError: the surface has no faces, or a vertex that is not a number.
        ToolpathError: gravity is no direction.
    """
    if reference not in get_args(Reference):
        raise SurfaceError(f"overhang is measured by 'ground' or by 'layer', not by {reference!r}")
    if side not in get_args(FacingSide):
        raise SurfaceError(f"overhang is measured on side 'both' or 'below', not {side!r}")
    up = -checked_gravity(gravity)
    normals, areas = face_normals(surface)
    vertices = np.asarray(surface.vertices, dtype=np.float64)
    faces = np.asarray(surface.faces)
    if planes is None:
        directions = np.broadcast_to(up, normals.shape)
        heights = vertices @ up
        heights = heights - heights[faces].min()
    else:
        directions = build_directions(vertices[faces].mean(axis=1), planes)
        heights = np.abs(planes.base.height_of(vertices))
    along = np.einsum("ij,ij->i", normals, directions if reference == "layer" else up[None])
    across = np.linalg.norm(np.cross(normals, directions), axis=1)
    values = np.full(len(faces), np.inf)
    np.divide(np.abs(along), across, out=values, where=across > FLAT)
    values[areas <= 0.0] = 0.0
    if side == "below":
        values[along >= 0.0] = 0.0
    extent = float(np.ptp(vertices[faces].reshape(-1, 3), axis=0).max())
    values[(heights[faces] <= ON_BED * extent).all(axis=1)] = 0.0
    return SurfaceOverhang(values, areas, directions, reference)


def build_directions(points: Array, planes: PlaneStack) -> Array:
    """Unit normals of the layer planes through points, shape (n, 3); beyond the stack of its first or last plane.

    Between two planes frames are blended, so that the direction turns along the part without steps.
    """
    stack = [planes.base]
    for slicing, nozzle in zip(planes.slicing, planes.nozzle, strict=True):
        stack += [slicing, nozzle]
    frames = Frames(stack, 0.5 * planes.thickness)
    rows = frames.at(np.clip(frames.height_of(points), 0.0, frames.top))
    normals = np.cross(rows[:, 1], rows[:, 2])
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True), dtype=np.float64)


def face_normals(surface: trimesh.Trimesh) -> tuple[Array, Array]:
    """Unit normals of faces, shape (m, 3), and their areas, shape (m,); 0 both where a face has none.

    Raises:
        SurfaceError: the surface has no faces, or a vertex that is not a number.
    """
    vertices, faces = np.asarray(surface.vertices, dtype=np.float64), np.asarray(surface.faces)
    if not len(faces):
        raise SurfaceError("the surface has no faces: there is no overhang to measure")
    a, b, c = vertices[faces].transpose(1, 0, 2)
    doubled = np.cross(b - a, c - a)
    size = np.linalg.norm(doubled, axis=1)
    if not np.isfinite(size).all():
        at = int(np.flatnonzero(~np.isfinite(size))[0])
        raise SurfaceError(f"face {at} has a vertex that is not a number; repair the surface")
    normals = np.zeros_like(doubled)
    np.divide(doubled, size[:, None], out=normals, where=size[:, None] > 0.0)
    return normals, 0.5 * size
