"""Slicing: a surface becomes a toolpath (seed paper, Section 2.1).

A plane cuts a closed triangle mesh in closed polygons. Each vertex gets a *level*, the number of planes that it is
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
import trimesh

from .errors import PlanesError, SurfaceError
from .planes import PlaneStack
from .sampling import sample_layer
from .surface import check_surface, make_surface
from .toolpath import Curve, Layer, Plane, Toolpath

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[Any]
"""Whole numbers: int32, or int64 where the mesh or its cuts are too many for that."""

_BLOCK = 128
"""Faces that share one bounding box where the order of planes is checked."""


def slice_surface(surface: trimesh.Trimesh, planes: PlaneStack, resolution: float | None = None) -> Toolpath:
    """Cut a surface into a toolpath.

    Args:
        surface: closed and oriented outwards, mm.
        planes: from `layer_planes` or `custom_planes`.
        resolution: distance L_R of sample points along the curves, mm; default the layer thickness t'.

    Returns:
        closed curves, outer ones counter-clockwise. Layers above or below the part have none.

    Raises:
        SurfaceError: the mesh does not bound a solid.
        PlanesError: the axis of a rotary stack does not clear the part, or slicing planes cross inside it.
    """
    cutter = SurfaceCutter(surface.vertices, surface.faces)
    if not cutter.bounds_a_solid():
        check_surface(surface)
    if resolution is not None and not resolution > 0:
        raise PlanesError(f"the resolution must be above 0 mm, not {resolution}")
    _check_axis(surface, planes)
    step = planes.thickness if resolution is None else float(resolution)
    layers = []
    for polygons, slicing, nozzle in zip(
        cutter.cut(planes.slicing), planes.slicing, planes.nozzle, strict=True
    ):
        layers.append(Layer(slicing, nozzle, tuple(Curve(points) for points in sample_layer(polygons, step))))
    return Toolpath(planes.base, tuple(layers), planes.thickness)


def cut(surface: trimesh.Trimesh, planes: PlaneStack) -> list[list[Array]]:
    """The polygons in which each slicing plane cuts a surface: closed, interior left, shape (n, 2) in plane frames.

    Raises:
        SurfaceError: the mesh is not closed or not consistently oriented.
        PlanesError: two planes cross inside the part.
    """
    return SurfaceCutter(surface.vertices, surface.faces).cut(planes.slicing)


def opposite_half_edges(faces: npt.NDArray[np.integer], vertex_count: int) -> Indices:
    """For half-edge 3 f + e (corner e to the next of face f) the one that runs against it, or -1; shape (3 m,).

    Raises:
        SurfaceError: a face names a vertex that is not there.
    """
    _, across, _ = _adjacency(faces, vertex_count)
    return np.maximum(across, -1, out=across)


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
        self._faces, self._across, unmatched = _adjacency(np.asarray(faces), len(self._vertices))
        if unmatched:
            check_surface(make_surface(vertices, faces))
            raise SurfaceError(f"{unmatched} edges of the surface have no partner; make it a closed solid")
        self._low, self._high = _bounds(self._vertices)

    def bounds_a_solid(self) -> bool:
        """Whether the mesh also has two faces at each edge, finite corners and its normals outwards."""
        size = float((self._high - self._low).max(initial=0.0))
        volume = _volume(self._vertices, self._faces)
        return bool(volume > 1e-12 * size**3) and not _is_crowded(
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
        origin, u, v = (
            np.array(values, dtype=np.float64).reshape(-1, 3) for values in (origins, u_axes, v_axes)
        )
        if len(origin) == 0:
            return []
        normal = np.cross(u, v)
        size = np.linalg.norm(normal, axis=1)
        flat = ~(size > 1e-12 * np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1))
        if flat.any():
            raise PlanesError(
                f"the frame of slicing plane {int(np.argmax(flat))} has parallel axes; "
                "give it two directions that span the plane"
            )
        normal /= size[:, None]
        planes = np.column_stack([normal, (origin * normal).sum(axis=1)])
        # Rows of the dual basis give the coordinates of a point of the plane in its frame.
        dual = np.stack([np.cross(v, normal), np.cross(normal, u)], axis=1) / size[:, None, None]
        doubtful = self._doubtful(planes)
        rounding = 1e-9 * float(np.abs([self._low, self._high]).max() + np.abs(planes[:, 3]).max())
        if len(doubtful):
            boxes = _face_boxes(self._vertices, self._faces)
            _refuse(*_vertex_out_of_order(self._vertices, self._faces, boxes, planes, doubtful))
        points, start, loops, loop_start = self._cut(origin, planes, dual)
        if len(doubtful):
            _refuse(*_point_out_of_order(points, start, origin, u, v, planes, doubtful, rounding))
        polygons = [points[a:b] for a, b in pairwise(loop_start.tolist())]
        return [polygons[a:b] for a, b in pairwise([0, *loops.tolist()])]

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
        padded = np.vstack([[0.0, 0.0, 0.0, -1.0], planes, [0.0, 0.0, 0.0, 1.0]])
        level = np.empty(len(self._vertices), np.int32)
        _levels(self._vertices, padded, level)
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


def _check_axis(surface: trimesh.Trimesh, planes: PlaneStack) -> None:
    """A fan opens on one side of its axis: the part must lie there, where the bed's origin is."""
    axis = planes.axis
    if axis is None:
        return
    outward = planes.base.origin - axis.point
    outward = outward / np.linalg.norm(outward)
    vertices = np.asarray(surface.vertices)
    if float((vertices @ outward).min()) <= float(axis.point @ outward):
        offset = vertices - axis.point
        offset = offset - np.outer(offset @ axis.direction, axis.direction)
        distance = float(np.linalg.norm(offset, axis=1).min())
        raise PlanesError(
            f"the axis in which bed and top plane meet does not clear the part: it is "
            f"{axis.radius:.6g} mm from the bed's origin and {distance:.6g} mm from the part's nearest "
            "vertex, and some of the part lies beyond it; tilt the top plane less or the other way, or move it up"
        )


def _refuse(plane: int, x: float, y: float, z: float) -> None:
    if plane >= 0:
        raise PlanesError(
            f"the slicing planes of layers {plane} and {plane + 1} cross inside the part: at "
            f"({x:.3f}, {y:.3f}, {z:.3f}) plane {plane + 1} is below plane {plane}; order the planes from the bed up "
            "and tilt them so that they meet outside the part, or slice the part in pieces"
        )


def _adjacency(faces: npt.NDArray[np.integer], vertex_count: int) -> tuple[Indices, Indices, int]:
    """Faces in the smallest fitting type, opposite half-edges (negative where there is none), unmatched half-edges."""
    given = np.ascontiguousarray(faces).reshape(-1, 3)
    if given.dtype.kind not in "iu":
        given = given.astype(np.int64)
    index = np.int32 if max(3 * len(given), vertex_count) < 2**31 else np.int64
    own = np.empty(given.shape, index)
    across = np.empty(3 * len(given), index)
    unmatched = _link(given, own, across, np.full(vertex_count, -1, index))
    if unmatched < 0:
        face = -1 - unmatched
        raise SurfaceError(
            f"face {face} names the vertices {given[face].tolist()}, but there are only {vertex_count}; "
            "the mesh is damaged, export it again"
        )
    return own, across, unmatched


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _link(given: Indices, faces: Indices, across: Indices, head: Indices) -> int:
    """Copy faces and pair opposite half-edges; the number without a partner, or -1 - f for a wrong face f.

    Half-edges that wait for their partner form a list at their lower vertex, through `across` itself: -2 - the
    next one. In meshes whose faces are stored near their neighbours these lists stay very short.
    """
    vertex_count = len(head)
    waiting = 0
    for f in range(len(given)):
        for e in range(3):
            v = given[f, e]
            if v < 0 or v >= vertex_count:
                return -1 - f
            faces[f, e] = v
        a = faces[f, 0]
        for e in range(3):
            b = faces[f, e + 1] if e < 2 else faces[f, 0]
            h = 3 * f + e
            low = min(a, b)
            before, g = -1, head[low]
            while g >= 0:
                other, corner = g // 3, g % 3
                if faces[other, corner] == b and faces[other, corner + 1 if corner < 2 else 0] == a:
                    break
                before, g = g, -2 - across[g]
            if g >= 0:
                if before < 0:
                    head[low] = -2 - across[g]
                else:
                    across[before] = across[g]
                across[g] = h
                across[h] = g
                waiting -= 1
            else:
                across[h] = -2 - head[low]
                head[low] = h
                waiting += 1
            a = b
    return waiting


@nb.njit(cache=True, nogil=True)
def _is_crowded(faces: Indices, head: Indices, link: Indices) -> bool:
    """Whether any half-edge occurs twice: of paired half-edges, those from the lower vertex are looked at."""
    for f in range(len(faces)):
        for e in range(3):
            a, b = faces[f, e], faces[f, e + 1 if e < 2 else 0]
            if a < b:
                g = head[a]
                while g >= 0:
                    corner = g % 3
                    if faces[g // 3, corner + 1 if corner < 2 else 0] == b:
                        return True
                    g = link[g]
                link[3 * f + e] = head[a]
                head[a] = 3 * f + e
    return False


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


@nb.njit(cache=True, nogil=True)
def _height(planes: Array, k: int, x: float, y: float, z: float) -> float:
    """The one evaluation of a point's height over plane k that everything is decided by, mm."""
    return float(planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z - planes[k, 3])


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
        below = _height(padded, near, x, y, z)
        above = _height(padded, near + 1, x, y, z)
        at = near
        if below > above:
            at += int(np.floor(min(max(above / (below - above), -float(count)), float(count)))) + 1
            at = max(0, min(at, count))
        if not (_height(padded, at, x, y, z) >= 0.0 > _height(padded, at + 1, x, y, z)):
            at, end = 0, count
            while at < end:
                middle = (at + end) // 2
                if _height(padded, middle + 1, x, y, z) >= 0.0:
                    at = middle + 1
                else:
                    end = middle
        level[v] = at


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
            drop = _height(planes, k, x, y, z)
            to_x, to_y, to_z = vertices[lower, 0], vertices[lower, 1], vertices[lower, 2]
            share = drop / (drop - _height(planes, k, to_x, to_y, to_z))
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


@nb.njit(cache=True, nogil=True)
def _face_boxes(vertices: Array, faces: Indices) -> Array:
    """Least and greatest coordinates of every _BLOCK faces, shape (blocks, 2, 3), mm."""
    boxes = np.empty((-(-len(faces) // _BLOCK), 2, 3))
    boxes[:, 0], boxes[:, 1] = np.inf, -np.inf
    for f in range(len(faces)):
        box = boxes[f // _BLOCK]
        for e in range(3):
            for axis in range(3):
                value = vertices[faces[f, e], axis]
                box[0, axis] = min(box[0, axis], value)
                box[1, axis] = max(box[1, axis], value)
    return boxes


@nb.njit(cache=True, nogil=True)
def _least(box: Array, x: float, y: float, z: float) -> float:
    """Least scalar product of (x, y, z) with a point of a box."""
    least_x, least_y = min(x * box[0, 0], x * box[1, 0]), min(y * box[0, 1], y * box[1, 1])
    return float(least_x + least_y + min(z * box[0, 2], z * box[1, 2]))


@nb.njit(cache=True, nogil=True)
def _vertex_out_of_order(
    vertices: Array, faces: Indices, boxes: Array, planes: Array, doubtful: Indices
) -> tuple[int, float, float, float]:
    """A vertex on or above plane k + 1 but below plane k, for the k that are in doubt: k and the place, or -1."""
    rise = planes[:-1] - planes[1:]
    for i in range(len(boxes)):
        box = boxes[i]
        for k in doubtful:
            if (
                _least(box, rise[k, 0], rise[k, 1], rise[k, 2]) > rise[k, 3]
                or _least(box, planes[k, 0], planes[k, 1], planes[k, 2]) >= planes[k, 3]
                or _least(box, -planes[k + 1, 0], -planes[k + 1, 1], -planes[k + 1, 2]) > -planes[k + 1, 3]
            ):
                continue
            for f in range(i * _BLOCK, min(len(faces), (i + 1) * _BLOCK)):
                for e in range(3):
                    v = faces[f, e]
                    x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
                    if _height(planes, k, x, y, z) < 0.0 <= _height(planes, k + 1, x, y, z):
                        return k, x, y, z
    return -1, 0.0, 0.0, 0.0


@nb.njit(cache=True, nogil=True)
def _point_out_of_order(
    points: Array,
    start: Indices,
    origin: Array,
    u: Array,
    v: Array,
    planes: Array,
    doubtful: Indices,
    rounding: float,
) -> tuple[int, float, float, float]:
    """A cut point of plane k above plane k + 1, or of plane k + 1 below plane k: k and the place, or -1.

    With no vertex out of order, planes that cross in the part cross in a face: on its boundary one of its cuts has
    a point on the wrong side of the other plane.
    """
    for k in doubtful:
        for own, other, sign in ((k, k + 1, 1.0), (k + 1, k, -1.0)):
            for s in range(start[own], start[own + 1]):
                a, b = points[s, 0], points[s, 1]
                x = origin[own, 0] + a * u[own, 0] + b * v[own, 0]
                y = origin[own, 1] + a * u[own, 1] + b * v[own, 1]
                z = origin[own, 2] + a * u[own, 2] + b * v[own, 2]
                if sign * _height(planes, other, x, y, z) > rounding:
                    return k, x, y, z
    return -1, 0.0, 0.0, 0.0
