"""End faces: the two flat faces of a part between which its layers are laid.

`best_orientation` ranks directions to build in, by the overhang that they would give; here nothing is ranked by what
it prints like. A part that was cut for printing (a branch of a node, a springer) has a face to stand on and a face to
end with: `orient_to_slice` finds those two as planes, and `set_down` moves the part onto the first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

from twins.entrances import checks_kinds
from twins.errors import SurfaceError
from twins.surface import check_surface, make_surface
from twins.toolpath import Plane

Array = npt.NDArray[np.float64]

LEAST_AREA = 0.002
"""Share of a part's area from which faces in a plane are a flat face."""

ALIKE_DEG = 0.5
"""Angle between normals of one flat face, degrees."""

LOOKS_DOWN_DEG = 60.0
"""A face within this angle of straight down is one that the part stands on as it is given, degrees."""

MOST_TURN_DEG = 80.0
"""Largest angle between bed and top, degrees: a fan of layers opens by less than 90°."""

_NOTABLE = 0.25
"""Pairs of end faces with less than this share of the largest pair's area are no ends: facets of a round side."""

_FLAT = 1e-4  # distance from the plane of a flat face, as a share of the part's size
_STEPS = 1000  # to one: normals that agree to a step are tried as one direction
_MOST = 64  # directions that are tried


@dataclass(frozen=True, eq=False)
class _Flat:
    """A flat face that the whole part lies on one side of: unit outward normal, offset along it, area, centroid."""

    normal: Array
    offset: float
    area: float
    center: Array


@checks_kinds
def orient_to_slice(surface: trimesh.Trimesh, up: npt.ArrayLike = (0.0, 0.0, 1.0)) -> tuple[Plane, Plane]:
    """The bed and the top plane between which a part's layers are laid: its two flat end faces.

    An end face is flat and has the whole part on one side. Of all pairs that face each other within 80°, and have at
    least a quarter of the largest pair's area (facets of a round side have less), those count first whose bed looks
    down within 60°, and of them the pair with most area; of a part lying on its side the pair with most area of all,
    its larger face as the bed. Where areas are equal, the bed that looks down most.

    Args:
        surface: closed and oriented outwards, mm.
        up: direction in which the part is to grow, roughly; of a branch the direction of its skeleton.

    Returns:
        planes through the middles of the faces, their normals pointing up the part. Parallel faces give parallel
        layers, others rotary ones: `layer_planes` takes both.

    Raises:
        SurfaceError: the mesh does not bound a solid, or has no two such faces.
    """
    check_surface(surface)
    upward = np.asarray(up, dtype=np.float64)
    if upward.shape != (3,) or not np.isfinite(upward).all() or not np.linalg.norm(upward) > 0.0:
        raise SurfaceError(f"up must be a direction of three numbers that are not all 0, not {up!r}")
    upward = upward / np.linalg.norm(upward)
    flats = _end_faces(surface)
    pairs = [
        (bed, top)
        for bed in flats
        for top in flats
        if -float(bed.normal @ top.normal) > np.cos(np.radians(MOST_TURN_DEG))
    ]
    if not pairs:
        raise SurfaceError(
            f"the part has {len(flats)} flat faces with all of it on one side, and no two that face each other within "
            f"{MOST_TURN_DEG:.0f}°; trim its ends by planes first (trim)"
        )
    size = max(bed.area + top.area for bed, top in pairs)
    pairs = [(bed, top) for bed, top in pairs if bed.area + top.area >= _NOTABLE * size]

    def rank(pair: tuple[_Flat, _Flat]) -> tuple[bool, float, float, float]:
        bed, top = pair
        down = -float(bed.normal @ upward)
        looks_down = down > np.cos(np.radians(LOOKS_DOWN_DEG))
        area, own = (round(value / size, 6) for value in (bed.area + top.area, bed.area))
        # Of a pair that stands, the lower face is the bed, be it larger or not.
        return looks_down, area, 0.0 if looks_down else own, round(down, 6)

    bed, top = max(pairs, key=rank)
    return _plane(bed, -bed.normal), _plane(top, top.normal)


@checks_kinds
def set_down(surface: trimesh.Trimesh, bed: Plane, top: Plane) -> tuple[trimesh.Trimesh, Plane]:
    """A part moved so that its bed plane is z = 0, the bed's origin at (0, 0, 0), and its top plane moved with it.

    Slice it by `layer_planes(Plane.horizontal(), top, thickness)`.
    """
    vertices = bed.to_frame(np.asarray(surface.vertices, dtype=np.float64))
    vertices[np.abs(vertices[:, 2]) <= 1e-9 * np.abs(vertices).max(), 2] = 0.0
    moved = Plane(bed.to_frame(top.origin[None])[0], top.x_axis @ bed.rotation, top.y_axis @ bed.rotation)
    return make_surface(vertices, surface.faces), moved


def _end_faces(surface: trimesh.Trimesh) -> list[_Flat]:
    vertices = np.asarray(surface.vertices, dtype=np.float64)
    faces = np.asarray(surface.faces)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    doubled = np.cross(b - a, c - a)
    length = np.linalg.norm(doubled, axis=1)
    normals = doubled / np.where(length > 0.0, length, 1.0)[:, None]
    areas, centers = 0.5 * length, (a + b + c) / 3.0
    near = _FLAT * float(np.ptp(vertices, axis=0).max())
    found: list[_Flat] = []
    for direction in _directions(normals, areas):
        if any(float(flat.normal @ direction) > np.cos(np.radians(ALIKE_DEG)) for flat in found):
            continue
        heights = vertices @ direction
        flat = (heights[faces] >= heights.max() - near).all(axis=1)
        flat &= normals @ direction > np.cos(np.radians(ALIKE_DEG))
        area = float(areas[flat].sum())
        if area < LEAST_AREA * float(areas.sum()):
            continue
        normal = doubled[flat].sum(axis=0)
        normal = normal / np.linalg.norm(normal)
        center = np.average(centers[flat], axis=0, weights=areas[flat])
        found.append(_Flat(normal, float((vertices @ normal).max()), area, center))
    return found


def _directions(normals: Array, areas: Array) -> Array:
    """Mean normals of the faces that point the same way to a step, those with most area first."""
    key, index = np.unique(
        (np.rint(normals * _STEPS).astype(np.int64) + _STEPS) @ (2 * _STEPS + 1) ** np.arange(3),
        return_inverse=True,
    )
    area = np.bincount(index, areas, len(key))
    mean = np.column_stack([np.bincount(index, areas * part, len(key)) for part in normals.T])
    size = np.linalg.norm(mean, axis=1)
    largest = np.argsort(-area, kind="stable")[:_MOST]
    largest = largest[size[largest] > 0.0]
    return np.asarray(mean[largest] / size[largest, None], dtype=np.float64)


def _plane(flat: _Flat, normal: Array) -> Plane:
    """Through the face's middle; x along the world's, or along its y where the face looks that way."""
    origin = flat.center + (flat.offset - float(flat.center @ flat.normal)) * flat.normal
    x = np.array([1.0, 0.0, 0.0])
    if abs(normal[0]) > 0.9:
        x = np.array([0.0, 1.0, 0.0])
    x = x - (x @ normal) * normal
    return Plane(origin, x, np.cross(normal, x))
