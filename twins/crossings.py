"""Crossings: where faces of a mesh cut one another."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
import numpy.typing as npt
import trimesh

from .errors import SurfaceError
from .mesh_edges import arrays_of

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

TOUCHING = 3e-7
"""Faces that cut less deep into one another only touch, as a share of the largest coordinate: single precision."""


def check_self_intersection(surface: trimesh.Trimesh) -> None:
    """Make sure that no face cuts, or lies on, another one that it shares no vertex with.

    Faces that touch in points, or along edges of both, do not count; nor do faces without an area.

    Raises:
        SurfaceError: some do; the message counts the pairs and names the place of the first.
    """
    vertices, faces = arrays_of(surface)
    refuse_cuts(find_cuts(vertices, faces, np.zeros(len(faces), dtype=np.int64), 1))


@dataclass(frozen=True, eq=False)
class _Cuts:
    """Faces that cut or lie on one another.

    Attributes:
        crossing: which bodies cut each other, shape (count, count).
        meeting, face: where the first two bodies do, and a face of one of them there.
        number, place: of the pairs of faces of one body that cut each other; where the first do.
    """

    crossing: Flags
    meeting: Array
    face: int
    number: int
    place: Array


def find_cuts(vertices: Array, faces: Faces, label: npt.NDArray[np.int64], count: int) -> _Cuts:
    corners = vertices[faces]
    tolerance = TOUCHING * float(np.abs(vertices).max(initial=0.0))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(normal, axis=1)
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1, initial=0.0)
    wide = np.flatnonzero(
        twice > tolerance * longest
    )  # thinner ones are lines: their neighbours cut what they cut
    crossing = np.zeros((count, count), dtype=np.bool_)
    if len(wide) == 0:
        return _Cuts(crossing, np.zeros(3), 0, 0, np.zeros(3))
    low, high = corners[wide].min(axis=1), corners[wide].max(axis=1)
    extent = (high - low).mean(axis=0)
    size = np.maximum(np.ptp(corners.reshape(-1, 3), axis=0), 1e-300)
    axes = np.argsort(extent / size)
    bounds = np.hstack([low[:, axes], high[:, axes]])
    # Faces are filed in strips across the second axis, and in each strip by where they begin on the first.
    strips = int(np.clip(0.5 * size[axes[1]] / max(extent[axes[1]], 1e-300), 1, 4096))
    strip = ((bounds[:, [1, 4]] - bounds[:, 1].min()) * (strips / size[axes[1]])).astype(np.int64)
    times = strip[:, 1] - strip[:, 0] + 1
    entry = np.repeat(np.arange(len(wide)), times)
    place_in = strip[entry, 0] + np.arange(len(entry)) - np.repeat(np.cumsum(times) - times, times)
    order = np.lexsort((bounds[entry, 0], place_in))
    meeting, face, number, place = _sweep(
        entry[order],
        place_in[order],
        strip[:, 0].copy(),
        bounds,
        corners[wide],
        normal[wide] / twice[wide, None],
        faces[wide],
        label[wide],
        tolerance,
        crossing,
    )
    return _Cuts(crossing, meeting, int(wide[face]), number, place)


def refuse_cuts(cuts: _Cuts) -> None:
    if cuts.number:
        x, y, z = cuts.place
        raise SurfaceError(
            f"the surface cuts itself: {cuts.number} pairs of faces cross or lie on one another, the first at "
            f"({x:.3f}, {y:.3f}, {z:.3f}); make a solid without overlaps there"
        )


@nb.njit(cache=True, nogil=True)
def _sweep(
    entry: npt.NDArray[np.int64],
    strip: npt.NDArray[np.int64],
    first: npt.NDArray[np.int64],
    bounds: Array,
    corners: Array,
    normals: Array,
    faces: Faces,
    label: npt.NDArray[np.int64],
    tolerance: float,
    crossing: Flags,
) -> tuple[Array, int, int, Array]:
    """Compare the faces that share a strip, a pair in the first one that it shares; marks `crossing`."""
    number, face, flat = 0, -1, False
    meeting, place = np.zeros(3), np.zeros(3)
    for e in range(len(entry)):
        i = entry[e]
        for other in range(e + 1, len(entry)):
            j = entry[other]
            if strip[other] != strip[e] or bounds[j, 0] > bounds[i, 3]:
                break
            if strip[e] != max(first[i], first[j]):
                continue
            if bounds[j, 1] > bounds[i, 4] or bounds[i, 1] > bounds[j, 4]:
                continue
            if bounds[j, 2] > bounds[i, 5] or bounds[i, 2] > bounds[j, 5]:
                continue
            a, b = label[i], label[j]
            if a != b and crossing[a, b] and flat:
                continue
            shared = False
            for k in range(3):
                for m in range(3):
                    shared = shared or faces[i, k] == faces[j, m]
            if shared:
                continue
            cut, x, y, z = _cut(corners, normals, i, j, tolerance)
            if cut > 0 and a != b:
                crossing[a, b] = True
                crossing[b, a] = True
                # A face that another body lies on says more than one that is cut.
                if face < 0 or (cut > 1 and not flat):
                    face, flat = i, cut > 1
                    meeting[0], meeting[1], meeting[2] = x, y, z
            elif cut > 0:
                if number == 0:
                    place[0], place[1], place[2] = x, y, z
                number += 1
    return meeting, face, number, place


@nb.njit(cache=True, nogil=True)
def _cut(corners: Array, normals: Array, i: int, j: int, tolerance: float) -> tuple[int, float, float, float]:
    """1 where two triangles cut each other, 2 where they overlap in a plane; and the place.

    Möller's intervals (1997): heights within the tolerance are 0.
    """
    b0, b1, b2 = _heights(corners, normals, i, j, tolerance)
    if (b0 > 0 and b1 > 0 and b2 > 0) or (b0 < 0 and b1 < 0 and b2 < 0):
        return 0, 0.0, 0.0, 0.0
    a0, a1, a2 = _heights(corners, normals, j, i, tolerance)
    if (a0 > 0 and a1 > 0 and a2 > 0) or (a0 < 0 and a1 < 0 and a2 < 0):
        return 0, 0.0, 0.0, 0.0
    if (a0 == 0 and a1 == 0 and a2 == 0) or (b0 == 0 and b1 == 0 and b2 == 0):
        return _overlap(corners, normals, i, j, tolerance)
    dx = normals[i, 1] * normals[j, 2] - normals[i, 2] * normals[j, 1]
    dy = normals[i, 2] * normals[j, 0] - normals[i, 0] * normals[j, 2]
    dz = normals[i, 0] * normals[j, 1] - normals[i, 1] * normals[j, 0]
    size = np.sqrt(dx * dx + dy * dy + dz * dz)
    if size == 0.0:
        return 0, 0.0, 0.0, 0.0
    line = (dx / size, dy / size, dz / size)
    one = _interval(corners, i, (a0, a1, a2), line)
    two = _interval(corners, j, (b0, b1, b2), line)
    start, end = max(one[0], two[0]), min(one[1], two[1])
    if end - start <= tolerance or (one[2] and two[2]):
        return 0, 0.0, 0.0, 0.0
    # Nearly parallel planes meet far from where corners within the tolerance of both lie: compare the points.
    s = 0.5 * (start + end)
    p = (s - one[0]) / (one[1] - one[0])
    q = (s - two[0]) / (two[1] - two[0])
    far = 0.0
    for k in range(3):
        far += (one[3][k] + p * (one[4][k] - one[3][k]) - two[3][k] - q * (two[4][k] - two[3][k])) ** 2
    x = one[3][0] + p * (one[4][0] - one[3][0])
    y = one[3][1] + p * (one[4][1] - one[3][1])
    z = one[3][2] + p * (one[4][2] - one[3][2])
    return 1 if far <= (4.0 * tolerance) ** 2 else 0, x, y, z


@nb.njit(cache=True, nogil=True)
def _heights(
    corners: Array, normals: Array, of: int, tri: int, tolerance: float
) -> tuple[float, float, float]:
    """Heights of the corners of one triangle over the plane of another, 0 within tolerance."""
    h0 = _height(corners, normals, of, tri, 0)
    h1 = _height(corners, normals, of, tri, 1)
    h2 = _height(corners, normals, of, tri, 2)
    return (
        h0 if abs(h0) > tolerance else 0.0,
        h1 if abs(h1) > tolerance else 0.0,
        h2 if abs(h2) > tolerance else 0.0,
    )


@nb.njit(cache=True, nogil=True)
def _height(corners: Array, normals: Array, of: int, tri: int, k: int) -> float:
    height = 0.0
    for axis in range(3):
        height += normals[of, axis] * (corners[tri, k, axis] - corners[of, 0, axis])
    return height


@nb.njit(cache=True, nogil=True)
def _interval(
    corners: Array, tri: int, height: tuple[float, float, float], line: tuple[float, float, float]
) -> tuple[float, float, bool, tuple[float, float, float], tuple[float, float, float]]:
    """Where a triangle cuts a plane: from, to along the line; whether in an edge of its own; the two points."""
    low, high = np.inf, -np.inf
    start, end = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    flat = 0
    for k in range(3):
        m = (k + 1) % 3
        if height[k] == 0.0:
            flat += 1
            share = 0.0
        elif height[k] * height[m] < 0.0:
            share = height[k] / (height[k] - height[m])
        else:
            continue
        x = corners[tri, k, 0] + share * (corners[tri, m, 0] - corners[tri, k, 0])
        y = corners[tri, k, 1] + share * (corners[tri, m, 1] - corners[tri, k, 1])
        z = corners[tri, k, 2] + share * (corners[tri, m, 2] - corners[tri, k, 2])
        at = x * line[0] + y * line[1] + z * line[2]
        if at < low:
            low, start = at, (x, y, z)
        if at > high:
            high, end = at, (x, y, z)
    return low, high, flat == 2, start, end


@nb.njit(cache=True, nogil=True)
def _overlap(
    corners: Array, normals: Array, i: int, j: int, tolerance: float
) -> tuple[int, float, float, float]:
    """2 where two triangles in one plane overlap by more than the tolerance: no edge of either separates them."""
    for tri in (i, j):
        for k in range(3):
            m = (k + 1) % 3
            ex = corners[tri, m, 0] - corners[tri, k, 0]
            ey = corners[tri, m, 1] - corners[tri, k, 1]
            ez = corners[tri, m, 2] - corners[tri, k, 2]
            nx = normals[tri, 1] * ez - normals[tri, 2] * ey
            ny = normals[tri, 2] * ex - normals[tri, 0] * ez
            nz = normals[tri, 0] * ey - normals[tri, 1] * ex
            size = np.sqrt(nx * nx + ny * ny + nz * nz)
            low_i, high_i, low_j, high_j = np.inf, -np.inf, np.inf, -np.inf
            for c in range(3):
                p = (nx * corners[i, c, 0] + ny * corners[i, c, 1] + nz * corners[i, c, 2]) / size
                q = (nx * corners[j, c, 0] + ny * corners[j, c, 1] + nz * corners[j, c, 2]) / size
                low_i, high_i = min(low_i, p), max(high_i, p)
                low_j, high_j = min(low_j, q), max(high_j, q)
            if min(high_i, high_j) - max(low_i, low_j) <= tolerance:
                return 0, 0.0, 0.0, 0.0
    x, y, z = 0.0, 0.0, 0.0
    for c in range(3):
        x += (corners[i, c, 0] + corners[j, c, 0]) / 6.0
        y += (corners[i, c, 1] + corners[j, c, 1]) / 6.0
        z += (corners[i, c, 2] + corners[j, c, 2]) / 6.0
    return 2, x, y, z
