"""Cutting: a closed mesh, cut by any number of planes in one pass.

Each vertex gets a *level*, the number of planes that it is
on or above, and a triangle is cut by the planes between its lowest and highest level. That is pure combinatorics:
each cut triangle joins the edge where the surface goes down through the plane to the edge where it comes up again,
so the polygons follow from the mesh's own adjacency, close always, and have the interior on the left, without any
tolerance. A vertex that lies in a plane counts as above it, which puts every vertex, edge and face in a plane right
by one rule. All planes are cut in one pass over the triangles, whether they are parallel, a fan, or any others that
do not cross inside the part.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numba as nb
import numpy as np
import numpy.typing as npt

from .errors import PlanesError, SurfaceError
from .half_edges import adjacency, is_crowded
from .plane_order import face_boxes, height_over, point_out_of_order, refuse_crossing, vertex_out_of_order
from .surface import check_surface, make_surface
from .toolpath import Plane

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[Any]
"""Whole numbers: int32, or int64 where the mesh or its cuts are too many for that."""


class SurfaceCutter:
    """A closed mesh, ready to be cut by any number of plane stacks; its adjacency is found once."""

    def __init__(self, vertices: npt.ArrayLike, faces: npt.ArrayLike) -> None:
        """Find which triangles share an edge.

        Args:
            vertices: shape (n, 3), mm.
            faces: outward oriented triangles, shape (m, 3).

        Raises:
            SurfaceError: the mesh is not closed or not consistently oriented; the message names the places.
        """
        self._vertices = np.ascontiguousarray(vertices, dtype=np.float64).reshape(-1, 3)
        self._faces, self._across, unmatched = adjacency(np.asarray(faces), len(self._vertices))
        if unmatched:
            check_surface(make_surface(vertices, faces))
            raise SurfaceError(f"{unmatched} edges of the surface have no partner; make it a closed solid")
        self._low, self._high = _bounds(self._vertices)

    def bounds_a_solid(self) -> bool:
        """Whether the mesh also has two faces at each edge, finite corners and its normals outwards."""
        size = float((self._high - self._low).max(initial=0.0))
        volume = _volume(self._vertices, self._faces)
        return bool(volume > 1e-12 * size**3) and not is_crowded(
            self._faces, np.full(len(self._vertices), -1, self._faces.dtype), np.empty_like(self._across)
        )

    def cut(self, planes: Sequence[Plane]) -> list[list[Array]]:
        """The polygons in which each plane cuts the mesh.

        Args:
            planes: from the bed up.

        Returns:
            for each plane its closed polygons, shape (n, 2), in the plane's frame, mm, interior on the left. Where
            a face lies in a plane they show what is just below it.

        Raises:
            PlanesError: two planes cross inside the part, or are in the wrong order there.
        """
        return self.cut_frames(
            np.array([plane.origin for plane in planes]),
            np.array([plane.x_axis for plane in planes]),
            np.array([plane.y_axis for plane in planes]),
        )

    def cut_frames(
        self, origins: npt.ArrayLike, u_axes: npt.ArrayLike, v_axes: npt.ArrayLike
    ) -> list[list[Array]]:
        """The polygons in which planes cut the mesh, in frames that need not be orthonormal.

        Args:
            origins: a point of each plane, shape (k, 3), mm; the planes are ordered from the bed up.
            u_axes, v_axes: shape (k, 3); the plane's normal is u_axis × v_axis.

        Returns:
            as `cut`; a polygon's point (u, v) is at origin + u u_axis + v v_axis.

        Raises:
            PlanesError: as `cut`, or the axes of a frame are parallel.
        """
        origin, u, v = _axes(origins, u_axes, v_axes)
        if len(origin) == 0:
            return []
        planes, normal, size = _planes(origin, u, v)
        # Rows of the dual basis give the coordinates of a point of the plane in its frame.
        dual = np.stack([np.cross(v, normal), np.cross(normal, u)], axis=1) / size[:, None, None]
        doubtful = self._doubtful(planes)
        rounding = 1e-9 * float(np.abs([self._low, self._high]).max() + np.abs(planes[:, 3]).max())
        if len(doubtful):
            boxes = face_boxes(self._vertices, self._faces)
            refuse_crossing(*vertex_out_of_order(self._vertices, self._faces, boxes, planes, doubtful))
        points, start, loops, loop_start = self._cut(origin, planes, dual)
        if len(doubtful):
            refuse_crossing(*point_out_of_order(points, start, origin, u, v, planes, doubtful, rounding))
        polygons = [points[a:b] for a, b in pairwise(loop_start.tolist())]
        return [polygons[a:b] for a, b in pairwise([0, *loops.tolist()])]

    def levels(self, origins: npt.ArrayLike, u_axes: npt.ArrayLike, v_axes: npt.ArrayLike) -> Indices:
        """The number of planes, given as for `cut_frames`, that each vertex is on or above, shape (n,)."""
        planes, _, _ = _planes(*_axes(origins, u_axes, v_axes))
        return self._levels(planes)[0]

    def grazed(self, planes: Sequence[Plane], margin: float) -> list[int]:
        """Planes that pass a vertex within a margin, mm, so that curves may touch in them."""
        rows = np.array([[*plane.normal, plane.origin @ plane.normal] for plane in planes]).reshape(-1, 4)
        level, padded = self._levels(rows)
        return np.flatnonzero(_near(self._vertices, padded, level, margin)[1:-1]).tolist()

    def _levels(self, planes: Array) -> tuple[Indices, Array]:
        """Each vertex's level, and the planes with one below everything and one above everything."""
        padded = np.vstack([[0.0, 0.0, 0.0, -1.0], planes, [0.0, 0.0, 0.0, 1.0]])
        level = np.empty(len(self._vertices), np.int32)
        _levels(self._vertices, padded, level)
        return level, padded

    def _doubtful(self, planes: Array) -> npt.NDArray[np.int64]:
        """Planes k for which the mesh's bounding box does not rule out that plane k + 1 runs below them."""
        rise = planes[:-1] - planes[1:]
        least = np.minimum(rise[:, :3] * self._low, rise[:, :3] * self._high).sum(axis=1) - rise[:, 3]
        scale = float(np.abs([self._low, self._high]).max() + np.abs(planes[:, 3]).max())
        return np.flatnonzero(~(least > 1e-12 * scale))

    def _cut(
        self, origin: Array, planes: Array, dual: Array
    ) -> tuple[Array, Indices, npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Points of all loops by plane, where each plane's begin, loops up to each plane, where each loop begins."""
        level, _ = self._levels(planes)
        crossed = np.empty(len(self._faces), self._faces.dtype)
        count, total = _crossed_faces(self._faces, level, crossed)
        crossed = crossed[:count]
        index = np.int32 if total < 2**31 else np.int64
        first = np.empty(len(self._faces), index)
        slot = np.empty(total, index)
        start = np.zeros(len(planes) + 1, np.int64)
        _place(self._faces, level, crossed, first, slot, start)
        points, following = np.empty((total, 2)), np.empty(total, index)
        _intersect(
            self._vertices,
            self._faces,
            self._across,
            level,
            crossed,
            first,
            slot,
            start,
            origin,
            planes,
            dual,
            points,
            following,
        )
        ordered = np.empty((total, 2))
        loop_start = np.empty(total // 2 + 1, np.int64)
        loops = np.empty(len(planes), np.int64)
        found = _chain(points, following, start, ordered, loop_start, loops)
        return ordered, start, loops, loop_start[: found + 1]


def _axes(origins: npt.ArrayLike, u_axes: npt.ArrayLike, v_axes: npt.ArrayLike) -> tuple[Array, Array, Array]:
    origin, u, v = (np.array(a, dtype=np.float64).reshape(-1, 3) for a in (origins, u_axes, v_axes))
    return origin, u, v


def _planes(origin: Array, u: Array, v: Array) -> tuple[Array, Array, Array]:
    """Normal and offset of each plane, shape (k, 4); the normals; the lengths of u × v."""
    normal = np.cross(u, v)
    size = np.linalg.norm(normal, axis=1)
    flat = ~(size > 1e-12 * np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1))
    if flat.any():
        raise PlanesError(
            f"the frame of slicing plane {int(np.argmax(flat))} has parallel axes; "
            "give it two directions that span the plane"
        )
    normal /= size[:, None]
    return np.column_stack([normal, (origin * normal).sum(axis=1)]), normal, size


@nb.njit(cache=True, nogil=True)
def _bounds(vertices: Array) -> tuple[Array, Array]:
    low, high = np.zeros(3), np.zeros(3)
    for k in range(3):
        if len(vertices):
            low[k] = high[k] = vertices[0, k]
    for v in range(len(vertices)):
        for k in range(3):
            low[k] = min(low[k], vertices[v, k])
            high[k] = max(high[k], vertices[v, k])
    return low, high


@nb.njit(cache=True, nogil=True)
def _volume(vertices: Array, faces: Indices) -> float:
    """Enclosed volume, mm³; not a number where a corner is none."""
    total = 0.0
    if len(faces) == 0:
        return total
    start = faces[0, 0]
    x, y, z = vertices[start, 0], vertices[start, 1], vertices[start, 2]
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = vertices[i, 0] - x, vertices[i, 1] - y, vertices[i, 2] - z
        bx, by, bz = vertices[j, 0] - x, vertices[j, 1] - y, vertices[j, 2] - z
        cx, cy, cz = vertices[k, 0] - x, vertices[k, 1] - y, vertices[k, 2] - z
        total += ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    return float(total / 6.0)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _levels(vertices: Array, padded: Array, level: Indices) -> None:
    """For each vertex the number of planes that it is on or above.

    `padded` has a plane below everything before the planes and one above everything after them, so that level
    n is where padded plane n is at or below the vertex and n + 1 above it. Heights are nearly linear in the
    plane's index for parallel planes and fans: one step along the secant at a recent vertex's level is mostly
    right, and tested. Otherwise the level is bisected. The very last vertex would make the processor wait.
    """
    count = len(padded) - 2
    for v in range(len(vertices)):
        x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        near = max(1, min(level[v - 8], count - 1)) if v >= 8 else 1
        below = height_over(padded, near, x, y, z)
        above = height_over(padded, near + 1, x, y, z)
        at = near
        if below > above:
            at += int(np.floor(min(max(above / (below - above), -float(count)), float(count)))) + 1
            at = max(0, min(at, count))
        if not (height_over(padded, at, x, y, z) >= 0.0 > height_over(padded, at + 1, x, y, z)):
            at, end = 0, count
            while at < end:
                middle = (at + end) // 2
                if height_over(padded, middle + 1, x, y, z) >= 0.0:
                    at = middle + 1
                else:
                    end = middle
        level[v] = at


@nb.njit(cache=True, nogil=True)
def _near(vertices: Array, padded: Array, level: Indices, margin: float) -> npt.NDArray[np.bool_]:
    """Which planes, padded as for `_levels`, a vertex is within a margin of."""
    near = np.zeros(len(padded), np.bool_)
    for v in range(len(vertices)):
        x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        for k in range(level[v], level[v] + 2):
            if abs(height_over(padded, k, x, y, z)) <= margin:
                near[k] = True
    return near


@nb.njit(cache=True, nogil=True)
def _crossed_faces(faces: Indices, level: Indices, crossed: Indices) -> tuple[int, int]:
    """Write the faces that any plane cuts to `crossed`; how many there are, and how often they are cut."""
    count, total = 0, 0
    for f in range(len(faces)):
        a, b, c = level[faces[f, 0]], level[faces[f, 1]], level[faces[f, 2]]
        times = max(a, b, c) - min(a, b, c)
        # Without a branch: whether a face is cut is as good as random to the processor.
        crossed[count] = f
        count += times > 0
        total += times
    return count, total


@nb.njit(cache=True, nogil=True)
def _place(
    faces: Indices, level: Indices, crossed: Indices, first: Indices, slot: Indices, start: Indices
) -> None:
    """Number the cuts of each plane: that of face f by plane k is slot[first[f] + k]; a plane's begin at start[k]."""
    q = 0
    for i in range(len(crossed)):
        f = crossed[i]
        a, b, c = level[faces[f, 0]], level[faces[f, 1]], level[faces[f, 2]]
        low = min(a, b, c)
        first[f] = q - low
        for k in range(low, max(a, b, c)):
            slot[q] = start[k + 1]
            start[k + 1] += 1
            q += 1
    for k in range(len(start) - 1):
        start[k + 1] += start[k]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _intersect(
    vertices: Array,
    faces: Indices,
    across: Indices,
    level: Indices,
    crossed: Indices,
    first: Indices,
    slot: Indices,
    start: Indices,
    origin: Array,
    planes: Array,
    dual: Array,
    points: Array,
    following: Indices,
) -> None:
    """For each cut the point where the face's boundary goes down through the plane, and the cut after it."""
    q = 0
    for i in range(len(crossed)):
        f = crossed[i]
        a, b, c = level[faces[f, 0]], level[faces[f, 1]], level[faces[f, 2]]
        for k in range(min(a, b, c), max(a, b, c)):
            # Which corners are above, as bits, tells the edge that goes down and the edge that comes up: two
            # bits each in a constant, again to spare the processor a branch that it cannot foresee.
            corners = (a > k) | ((b > k) << 1) | ((c > k) << 2)
            down = (0x2250 >> (2 * corners)) & 3
            up = (0x0588 >> (2 * corners)) & 3
            upper = faces[f, down]
            lower = faces[f, down + 1 if down < 2 else 0]
            x, y, z = vertices[upper, 0], vertices[upper, 1], vertices[upper, 2]
            drop = height_over(planes, k, x, y, z)
            to_x, to_y, to_z = vertices[lower, 0], vertices[lower, 1], vertices[lower, 2]
            share = drop / (drop - height_over(planes, k, to_x, to_y, to_z))
            x += share * (to_x - x) - origin[k, 0]
            y += share * (to_y - y) - origin[k, 1]
            z += share * (to_z - z) - origin[k, 2]
            s = start[k] + slot[q]
            q += 1
            points[s, 0] = x * dual[k, 0, 0] + y * dual[k, 0, 1] + z * dual[k, 0, 2]
            points[s, 1] = x * dual[k, 1, 0] + y * dual[k, 1, 1] + z * dual[k, 1, 2]
            following[s] = start[k] + slot[first[across[3 * f + up] // 3] + k]


@nb.njit(cache=True, nogil=True)
def _chain(
    points: Array, following: Indices, start: Indices, ordered: Array, loop_start: Indices, loops: Indices
) -> int:
    """Walk each plane's loops; `loops` counts them up to each plane. Points of a plane lie together: in cache."""
    written, found = 0, 0
    for k in range(len(start) - 1):
        for seed in range(start[k], start[k + 1]):
            if following[seed] < 0:
                continue
            loop_start[found] = written
            found += 1
            s = seed
            while following[s] >= 0:
                ordered[written, 0] = points[s, 0]
                ordered[written, 1] = points[s, 1]
                written += 1
                after = following[s]
                following[s] = -1
                s = after
        loops[k] = found
    loop_start[found] = written
    return found
