"""Orientation: which way up a part is best printed.

Build directions are ranked by the overhang, the toolpath and the stand that parallel layers square to them would give.
All figures come from the faces alone, nothing is sliced:

- overhang of a face as `surface_overhang` measures it, by default of faces that look down;
- length of the toolpath: a face of area A, its normal at an angle φ to the build direction, is crossed by layers of
  thickness t along A sin φ / t;
- base: the section half a layer above the lowest point, the first layer's; its area is what the faces below it
  project downwards;
- centre of gravity: of the bead along the surface, of which every face has A sin φ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Final

import numba as nb
import numpy as np
import numpy.typing as npt
import shapely
import trimesh
from scipy.spatial import ConvexHull, QhullError

from twins.entrances import checks_kinds
from twins.errors import SurfaceError
from twins.surface import make_surface
from twins.toolpath import read_only

from .surfaces import ON_BED, ON_TOP, FacingSide, check_side, face_normals

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

STANDS_DEG: Final = 5.0
"""Tilt that a part must bear to stand on the bed, degrees."""

SPREAD: Final = 200
"""Directions that are spread over the sphere: neighbours are about 14° apart."""

FLAT_SHARE: Final = 0.01
"""Share of the area from which faces of one direction are a flat face of the part."""

WORST: Final = 0.99
"""The worst overhang is the one that this share of the area does not exceed: single slivers do not count."""

SAME: Final = float(np.radians(0.1))
"""Angle below which two directions are one, rad."""

_BINS: Final = 1800  # of the angle of overhang, 0.05° each
_ALIKE: Final = 1000  # steps to one: normals that agree to a step are of one flat face
_MOST: Final = 24  # flat faces, and stands, that are tried


@dataclass(frozen=True, eq=False)
class Orientation:
    """A build direction and what it means for the print.

    Attributes:
        direction: unit vector of the part that shall point up, shape (3,).
        rotation: turns the part so that it does, by the least angle, shape (3, 3).
        area_over: with an overhang above the limit, mm².
        share_over: the same as a share of all area.
        excess_deg: angle by which overhang exceeds the limit, the mean over all area, degrees.
        worst_deg: angle of overhang that 99 % of the area do not exceed, to 0.05°; 90 of level faces.
        height: of the part, mm.
        print_length: of the toolpath, mm.
        base_area: of the first layer, mm².
        tilt_deg: by which the part can be tilted before it topples off its base, degrees; negative if it does not
            stand.
    """

    direction: Array
    rotation: Array
    area_over: float
    share_over: float
    excess_deg: float
    worst_deg: float
    height: float
    print_length: float
    base_area: float
    tilt_deg: float

    def applied_to(self, surface: trimesh.Trimesh) -> trimesh.Trimesh:
        """The surface turned this way up, standing on z = 0 with the middle of its bounds over the origin."""
        vertices = np.asarray(surface.vertices, dtype=np.float64) @ self.rotation.T
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        middle = 0.5 * (low + high)
        return make_surface(vertices - [middle[0], middle[1], low[2]], surface.faces)


@dataclass(frozen=True, eq=False)
class OrientationRanking:
    """Build directions, the best first.

    Attributes:
        ranked: all candidates.
        as_given: the way the part was given, z up; one of them.
    """

    ranked: tuple[Orientation, ...]
    as_given: Orientation

    @property
    def best(self) -> Orientation:
        """The first of them."""
        return self.ranked[0]


@dataclass(frozen=True, eq=False)
class _Faces:
    """A surface: vertices that faces use, shape (n, 3); faces, their unit normals and centres, (m, 3); areas, (m,)."""

    vertices: Array
    faces: Indices
    normals: Array
    centres: Array
    areas: Array


@checks_kinds
def best_orientation(
    surface: trimesh.Trimesh,
    limit_deg: float = 45.0,
    thickness: float = 10.0,
    candidates: npt.ArrayLike | None = None,
    side: FacingSide = "below",
    progress: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> OrientationRanking:
    """Rank build directions of a surface.

    They are ranked by, in this order and in steps, so that what hardly differs does not decide: whether the part
    stands, that is bears a tilt of 5°; mean excess of overhang over the limit (0.5°); share of the area above the
    limit (1 %); worst overhang beyond the limit (3°); length of the toolpath (2 % of the least); area of the base, the
    larger the better (2 % of the largest); height.

    Args:
        surface: closed and oriented outwards, mm.
        limit_deg: angle of overhang that the material takes, between 0 and 90; its tangent is the limit of d / t.
        thickness: of layers, mm.
        candidates: build directions, shape (n, 3); default those of `candidate_directions`. The present one, z, is
            always among them.
        side: "below", the default, counts faces that look down, as in a solid; "both" those that look up as well: a
            bead along the surface hangs over inwards there.
        progress: is told the share done.
        executor: works on directions side by side; threads do, since the work is outside the interpreter.

    Raises:
        SurfaceError: the mesh has no faces or is flat, the limit is not between 0 and 90, the thickness is not above
            0, or a candidate is no direction.
    """
    if not 0.0 < limit_deg < 90.0:
        raise SurfaceError(f"the limit of overhang must be between 0° and 90°, not {limit_deg}")
    if not thickness > 0 or not np.isfinite(thickness):
        raise SurfaceError(f"the layer thickness must be above 0, not {thickness}")
    check_side(side)
    faces = _faces_of(surface)
    if candidates is None:
        directions = _candidates(faces, SPREAD)
    else:
        directions = read_only(candidates, (None, 3), "candidate directions")
        size = np.linalg.norm(directions, axis=1, keepdims=True)
        if (size < 1e-9).any():
            raise SurfaceError(f"candidate {int(np.argmin(size))} is the zero vector, no direction")
        directions = _distinct([np.array([[0.0, 0.0, 1.0]]), directions / size])
    chunks = np.array_split(directions, max(1, len(directions) // 8))
    found: list[Orientation] = []
    n = len(chunks)
    calls = (chunks, [faces] * n, [(np.radians(limit_deg), thickness, side == "both")] * n)
    for done in map(_judged, *calls) if executor is None else executor.map(_judged, *calls):
        found += done
        if progress is not None:
            progress(len(found) / len(directions))
    shortest = min(o.print_length for o in found)
    widest = max(o.base_area for o in found)

    def rank(o: Orientation) -> tuple[float, ...]:
        return (
            float(o.tilt_deg < STANDS_DEG),
            _step(o.excess_deg, 0.5),
            _step(o.share_over, 0.01),
            _step(max(o.worst_deg - limit_deg, 0.0), 3.0),
            _step(o.print_length, 0.02 * shortest),
            -_step(o.base_area, 0.02 * widest),
            o.height,
        )

    return OrientationRanking(tuple(sorted(found, key=rank)), found[0])


def candidate_directions(surface: trimesh.Trimesh, spread: int = SPREAD) -> Array:
    """Build directions worth trying, unit vectors of shape (n, 3), the first of them z.

    The world's axes and the part's principal axes, either way; the normals of its flat faces, either way; what is up
    when it lies on a flat of its convex hull; and `spread` directions evenly over the sphere.

    Raises:
        SurfaceError: the mesh has no faces or is flat.
    """
    return _candidates(_faces_of(surface), spread)


def _faces_of(surface: trimesh.Trimesh) -> _Faces:
    normals, areas = face_normals(surface)
    used, index = np.unique(np.asarray(surface.faces, dtype=np.int64), return_inverse=True)
    vertices, faces = np.asarray(surface.vertices, dtype=np.float64)[used], index.reshape(-1, 3)
    return _Faces(vertices, faces, normals, vertices[faces].mean(axis=1), areas)


def _candidates(part: _Faces, spread: int) -> Array:
    centred = part.centres - np.average(part.centres, axis=0, weights=part.areas)
    principal = np.linalg.eigh((centred * part.areas[:, None]).T @ centred)[1].T
    axes = np.vstack([np.eye(3)[::-1], -np.eye(3)[::-1], principal, -principal])
    flat = _largest(part.normals, part.areas)
    try:
        hull = ConvexHull(part.vertices)
    except QhullError as error:
        raise SurfaceError("the surface is flat: it does not bound a solid") from error
    a, b, c = hull.points[hull.simplices].transpose(1, 0, 2)
    stands = -_largest(hull.equations[:, :3], 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))
    k = np.arange(spread) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * k / max(spread, 1)), np.pi * (1.0 + 5.0**0.5) * k
    sphere = np.column_stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)])
    return _distinct([axes, flat, -flat, stands, sphere])


def _largest(normals: Array, areas: Array) -> Array:
    """The directions that a notable share of the area has, the largest first."""
    steps = np.rint(normals * _ALIKE).astype(np.int64)
    # One number for three steps sorts far faster than rows do.
    key, index = np.unique((steps + _ALIKE) @ (2 * _ALIKE + 1) ** np.arange(3)[::-1], return_inverse=True)
    area = np.bincount(index, areas, len(key))
    mean = np.column_stack([np.bincount(index, areas * part, len(key)) for part in normals.T])
    largest = np.argsort(-area, kind="stable")[:_MOST]
    largest = largest[(area[largest] >= FLAT_SHARE * area.sum()) & mean[largest].any(axis=1)]
    return np.asarray(mean[largest] / np.linalg.norm(mean[largest], axis=1, keepdims=True), dtype=np.float64)


def _distinct(parts: Sequence[Array]) -> Array:
    directions = np.vstack(parts)
    kept: list[int] = []
    for i, direction in enumerate(directions):
        if not kept or float((directions[kept] @ direction).max()) < np.cos(SAME):
            kept.append(i)
    return directions[kept]


def _judged(directions: Array, part: _Faces, how: tuple[float, float, bool]) -> list[Orientation]:
    return [_judge(direction, part, *how) for direction in directions]


def _judge(up: Array, part: _Faces, limit: float, thickness: float, both: bool) -> Orientation:
    heights = part.vertices @ up
    lowest = float(heights.min())
    heights -= lowest
    height = float(heights.max())
    cut = 0.5 * min(thickness, height)
    low = np.zeros(len(part.faces), dtype=np.bool_)
    over, excess, printed, base_area, moment, histogram = _sums(
        part.faces,
        part.normals,
        part.centres,
        part.areas,
        heights,
        up,
        limit,
        cut,
        ON_BED * height,
        ON_TOP * height,
        both,
        low,
    )
    total = float(histogram.sum())
    # Where nothing is printed but flat faces, they stand in for it.
    centre = moment / printed if printed > 0.0 else np.average(part.centres, axis=0, weights=part.areas)
    at = int(np.searchsorted(np.cumsum(histogram), WORST * total * (1.0 - 1e-12)))
    rotation = _least_turn(up)
    # A line through the points has their hull, and is one object in place of thousands.
    base = shapely.convex_hull(shapely.LineString(_base(part, low, heights, cut) @ rotation[:2].T))
    over_base = shapely.Point(rotation[:2] @ centre)
    aside = -over_base.distance(base)
    if aside == 0.0 and isinstance(base, shapely.Polygon):
        aside = over_base.distance(base.exterior)
    return Orientation(
        direction=read_only(up, (3,), "a build direction"),
        rotation=read_only(rotation, (3, 3), "a rotation"),
        area_over=over,
        share_over=over / total,
        excess_deg=float(np.degrees(excess / total)),
        worst_deg=90.0 * min(at, _BINS) / _BINS,
        height=height,
        print_length=printed / thickness,
        base_area=max(base_area, 0.0),
        tilt_deg=float(np.degrees(np.arctan2(aside, float(centre @ up) - lowest))),
    )


@nb.njit(cache=True, nogil=True)
def _sums(
    faces: Indices,
    normals: Array,
    centres: Array,
    areas: Array,
    heights: Array,
    up: Array,
    limit: float,
    cut: float,
    on_bed: float,
    on_top: float,
    both: bool,
    below: npt.NDArray[np.bool_],
) -> tuple[float, float, float, float, Array, Array]:
    """Sums over faces for one direction: area over the limit in rad, area x excess angle, area x sin φ, area of the
    section at a height, first moments of area x sin φ, and area by angle of overhang, each bin named by its upper end.

    Marks in `below` the faces that reach below the section.
    """
    over = excess = printed = base = 0.0
    highest = heights.max()
    moment = np.zeros(3)
    histogram = np.zeros(_BINS + 1)
    for f in range(len(faces)):
        along = normals[f, 0] * up[0] + normals[f, 1] * up[1] + normals[f, 2] * up[2]
        across = np.sqrt(max(1.0 - along * along, 0.0))
        area = areas[f]
        printed += area * across
        for axis in range(3):
            moment[axis] += area * across * centres[f, axis]
        a, b, c = heights[faces[f, 0]], heights[faces[f, 1]], heights[faces[f, 2]]
        low, high = min(a, b, c), max(a, b, c)
        if low < cut:
            below[f] = True
            share = 1.0
            if high > cut:
                middle = a + b + c - low - high
                if cut < middle:
                    share = (cut - low) ** 2 / ((middle - low) * (high - low))
                else:
                    share = 1.0 - (high - cut) ** 2 / ((high - middle) * (high - low))
            base -= area * along * share
        angle = 0.0
        top = low >= highest - on_top and abs(along) > 1.0 - ON_TOP
        if (both or along < 0.0) and high > on_bed and not (both and top):
            angle = np.arctan2(abs(along), across)
        if angle > limit:
            over += area
            excess += area * (angle - limit)
        histogram[min(int(np.ceil(angle * (2.0 * _BINS / np.pi) - 1e-6)), _BINS)] += area
    return over, excess, printed, base, moment, histogram


def _base(part: _Faces, below: npt.NDArray[np.bool_], heights: Array, cut: float) -> Array:
    """Points up to a height of the faces that reach below it, those on edges that cross it included, shape (n, 3)."""
    low = part.faces[below]
    points = [part.vertices[low[heights[low] <= cut]]]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        p, q = low[:, i], low[:, j]
        crosses = (heights[p] < cut) != (heights[q] < cut)
        p, q = p[crosses], q[crosses]
        share = (cut - heights[p]) / (heights[q] - heights[p])
        points.append(part.vertices[p] + share[:, None] * (part.vertices[q] - part.vertices[p]))
    return np.concatenate(points)


def _least_turn(up: Array) -> Array:
    """The rotation by the least angle that turns a unit vector to z, shape (3, 3)."""
    x, y, z = (float(value) for value in up)
    if z < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    K = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
    return np.asarray(np.eye(3) + K + (K @ K) / (1.0 + z), dtype=np.float64)


def _step(value: float, size: float) -> float:
    return float(np.floor(value / size + 0.5)) if size > 0.0 and np.isfinite(value) else value
