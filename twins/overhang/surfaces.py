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

from twins.entrances import checks_kinds
from twins.errors import SurfaceError
from twins.frames import Frames
from twins.planes import PlaneStack

from .distribution import Measured
from .supporters import DOWN, Reference, checked_gravity

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
FacingSide = Literal["both", "below"]
"""Which faces count. "below": those that look down, since what hangs from a solid hangs below it. "both": those that
look up as well, since a shell that is printed as one bead along each curve falls inwards as it does outwards, and so
toolpaths are measured."""

FLAT = 1e-7
"""Sine of the angle between a face and its layer below which it has no curve to print."""

ON_BED = 1e-5
"""How near to the bed the vertices of a face are that lies on it, as a share of the part's extent."""

ON_TOP = 1e-6
"""How near to the highest layer plane a flat top is, as a share of the part's extent, and 1 less the cosine between
its normal and that plane's."""

_HIGHEST = 0.01  # of a layer: faces this near to the highest place may lie in the highest of blended planes


@dataclass(frozen=True, eq=False)
class SurfaceOverhang(Measured):
    """Local overhang of every face of a surface.

    It can be asked for `maximum`, `quantile(share)`, `above(limit)` and `share_above(limit)`, weighted by area.

    Attributes:
        values: tangent of the overhang angle of each face, shape (m,); 0 on the bed and on flat tops, inf where
            another face lies flat in its layer.
        weights: area of each face, shape (m,), mm².
        directions: unit normal of the layer plane at each face, shape (m, 3): the build direction.
        reference: "ground" or "layer".
    """

    directions: Array
    reference: Reference


@checks_kinds
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

    Faces on the bed are carried by it: 0. On those flat in the highest layer plane nothing is printed: 0 as well. A
    level face further down counts with both sides: the curves that begin on it have none below. A toolpath's first
    layer has overhang 0 as a whole; here only the faces that touch the bed have.

    Args:
        surface: in mm.
        planes: that slice it; default parallel planes, square to gravity, on a bed at the surface's lowest point.
        reference: "ground" or "layer".
        side: "both", the default, as toolpaths are measured, whose bead hangs over inwards as well; "below" leaves out
            faces that look up, as far as the step down leads: 0.
        gravity: direction, shape (3,).

    Raises:
        SurfaceError: the surface has no faces, or a vertex that is not a number.
        ToolpathError: gravity is no direction.
    """
    if reference not in get_args(Reference):
        raise SurfaceError(f"overhang is measured by 'ground' or by 'layer', not by {reference!r}")
    check_side(side)
    up = -checked_gravity(gravity)
    normals, areas = face_normals(surface)
    vertices = np.asarray(surface.vertices, dtype=np.float64)
    faces = np.asarray(surface.faces)
    if planes is None:
        directions = np.broadcast_to(up, normals.shape)
    else:
        directions = build_directions(vertices[faces].mean(axis=1), planes)
    rise = np.einsum("ij,ij->i", normals, directions)
    along = rise if reference == "layer" else normals @ up
    across = np.linalg.norm(np.cross(normals, directions), axis=1)
    values = np.full(len(faces), np.inf)
    np.divide(np.abs(along), across, out=values, where=across > FLAT)
    values[areas <= 0.0] = 0.0
    if side == "below":
        values[along >= 0.0] = 0.0
    else:
        values[flat_tops(vertices, faces, rise, planes, up)] = 0.0
    values[on_bed(vertices, faces, planes, up)] = 0.0
    return SurfaceOverhang(values, areas, directions, reference)


def check_side(side: str) -> None:
    """Raise SurfaceError where a side is none."""
    if side not in get_args(FacingSide):
        raise SurfaceError(f"overhang is measured on side 'both' or 'below', not {side!r}")


def on_bed(vertices: Array, faces: Indices, planes: PlaneStack | None, up: Array) -> Flags:
    """Faces that lie on the bed, shape (m,): the base of the planes, or the lowest corner's height by `up` (3,)."""
    if planes is None:
        heights = vertices @ up
        heights = heights - heights[faces].min()
    else:
        heights = np.abs(planes.base.height_of(vertices))
    return np.asarray((heights[faces] <= ON_BED * _extent(vertices, faces)).all(axis=1))


def flat_tops(vertices: Array, faces: Indices, rise: Array, planes: PlaneStack | None, up: Array) -> Flags:
    """Faces that lie flat in the highest layer plane, shape (m,).

    Args:
        vertices, faces: shapes (n, 3), mm, and (m, 3).
        rise: cosine between each face's normal and that of the layer plane there, shape (m,).
        planes: of the layers, or None if they are square to `up`.
        up: shape (3,).
    """
    tops = np.abs(rise) > 1.0 - ON_TOP
    if not tops.any():
        return np.asarray(tops)
    near = ON_TOP * _extent(vertices, faces)
    if planes is not None:
        # Heights among blended planes are not exact, and only say which faces are the highest.
        heights = _frames(planes).height_of(vertices)
        tops &= (heights[faces] >= heights[faces].max() - max(near, _HIGHEST * planes.thickness)).all(axis=1)
        if not tops.any():
            return np.asarray(tops)
        up = mean_normal(vertices, faces[tops], build_directions(vertices[faces[tops]].mean(axis=1), planes))
    heights = vertices @ up
    highest = heights[faces].max() if planes is None else heights[faces[tops]].max()
    return np.asarray(tops & (heights[faces] >= highest - near).all(axis=1))


def mean_normal(vertices: Array, faces: Indices, toward: Array) -> Array:
    """Unit normal of faces in one plane, each turned to its side of `toward`, shape (m, 3) or (3,)."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    normal = (normals * np.sign((normals * toward).sum(axis=1))[:, None]).sum(axis=0)
    return np.asarray(normal / np.linalg.norm(normal))


def build_directions(points: Array, planes: PlaneStack) -> Array:
    """Unit normals of the layer planes through points, shape (n, 3); beyond the stack of its first or last plane.

    Between two planes frames are blended, so that the direction turns along the part without steps.
    """
    frames = _frames(planes)
    rows = frames.at(np.clip(frames.height_of(points), 0.0, frames.top))
    normals = np.cross(rows[:, 1], rows[:, 2])
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True), dtype=np.float64)


def _frames(planes: PlaneStack) -> Frames:
    stack = [planes.base]
    for slicing, nozzle in zip(planes.slicing, planes.nozzle, strict=True):
        stack += [slicing, nozzle]
    return Frames(stack, 0.5 * planes.thickness)


def _extent(vertices: Array, faces: Indices) -> float:
    return float(np.ptp(vertices[faces].reshape(-1, 3), axis=0).max())


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
