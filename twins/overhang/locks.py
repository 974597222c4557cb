"""Which vertices of a surface stay: by plane, by box, by faces, by a solid around them.

Each lock is an array of flags, one a vertex, so that locks combine with `|`, `&` and `~`.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np
import numpy.typing as npt
import trimesh

from twins.entrances import checks_kinds
from twins.errors import SurfaceError
from twins.planes import PlaneStack
from twins.surface import check_surface
from twins.toolpath import Plane

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_ON = 1e-6
"""A vertex this near to a plane lies on it, as a share of the surface's diagonal."""


@checks_kinds
def lock_plane(surface: trimesh.Trimesh, plane: Plane, within: float | None = None) -> Flags:
    """Vertices on a plane or below it, shape (n,); with `within` only those no farther from it than that, mm."""
    vertices = _vertices(surface)
    height, touch = plane.height_of(vertices), _ON * _diagonal(vertices)
    if within is None:
        return np.asarray(height <= touch)
    if not within >= 0 or not math.isfinite(within):
        raise SurfaceError(f"a lock reaches 0 mm or more from its plane, not {within}")
    return np.asarray(np.abs(height) <= within + touch)


@checks_kinds
def lock_base(surface: trimesh.Trimesh, planes: PlaneStack | None = None) -> Flags:
    """Vertices on the bed: the base of the layers' planes, by default the height of the lowest vertex."""
    if planes is None:
        vertices = _vertices(surface)
        return lock_plane(surface, Plane.horizontal(float(vertices[:, 2].min())))
    return lock_plane(surface, planes.base)


@checks_kinds
def lock_box(surface: trimesh.Trimesh, low: npt.ArrayLike, high: npt.ArrayLike) -> Flags:
    """Vertices in a box with sides along the axes, rim included, shape (n,); corners (3,), mm."""
    vertices = _vertices(surface)
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    if low.shape != (3,) or high.shape != (3,) or not (low <= high).all():
        raise SurfaceError(f"a box needs a low corner (3,) below its high corner, not {low} and {high}")
    touch = _ON * _diagonal(vertices)
    return np.asarray(((vertices >= low - touch) & (vertices <= high + touch)).all(axis=1))


@checks_kinds
def lock_bounds(surface: trimesh.Trimesh, within: float = 0.0) -> Flags:
    """Vertices on the sides of the surface's bounding box, or nearer to one than `within` mm; shape (n,)."""
    if not within >= 0 or not math.isfinite(within):
        raise SurfaceError(f"a lock reaches 0 mm or more from the sides of the box, not {within}")
    vertices = _vertices(surface)
    depth = np.minimum(vertices - vertices.min(axis=0), vertices.max(axis=0) - vertices).min(axis=1)
    return np.asarray(depth <= within + _ON * _diagonal(vertices))


@checks_kinds
def lock_rim(surface: trimesh.Trimesh) -> Flags:
    """Vertices on the open edges of a surface that is not closed, shape (n,)."""
    faces = np.asarray(surface.faces, dtype=np.int64)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    distinct, count = np.unique(edges, axis=0, return_counts=True)
    flags = np.zeros(len(surface.vertices), dtype=bool)
    flags[distinct[count == 1]] = True
    return flags


@checks_kinds
def lock_faces(surface: trimesh.Trimesh, faces: npt.ArrayLike) -> Flags:
    """Vertices of a group of faces, given as flags (m,) or indices; shape (n,)."""
    group = as_flags(faces, len(surface.faces), "faces")
    flags = np.zeros(len(surface.vertices), dtype=bool)
    flags[np.asarray(surface.faces)[group]] = True
    return flags


@checks_kinds
def lock_solid(surface: trimesh.Trimesh, solid: trimesh.Trimesh) -> Flags:
    """Vertices inside a closed surface, shape (n,): those that more of its faces cover from above looking up than down.

    Raises:
        SurfaceError: the selection does not bound a solid.
    """
    try:
        check_surface(solid)
    except SurfaceError as error:
        raise SurfaceError(f"vertices cannot be selected: {error}") from error
    vertices = _vertices(surface)
    order = np.argsort(vertices[:, 0], kind="stable")
    corners = np.asarray(solid.vertices, dtype=np.float64)
    inside = np.empty(len(vertices), dtype=bool)
    crossings = _faces_above(vertices[order], corners, np.asarray(solid.faces, dtype=np.int64))
    inside[order] = crossings > 0
    return inside


def as_flags(chosen: npt.ArrayLike, n: int, what: str = "vertices") -> Flags:
    """Flags (n,) as they are, or indices made flags.

    Raises:
        SurfaceError: neither flags of that length nor indices within it.
    """
    array = np.asarray(chosen)
    if array.dtype == np.bool_:
        if array.shape != (n,):
            raise SurfaceError(f"flags of {what} must have shape ({n},), not {array.shape}")
        return array.copy()
    if array.size == 0:
        return np.zeros(n, dtype=bool)
    if array.ndim != 1 or not np.issubdtype(array.dtype, np.integer):
        raise SurfaceError(
            f"{what} are chosen by flags of shape ({n},) or by indices, not by an array of {array.dtype} "
            f"and shape {array.shape}"
        )
    if array.min() < 0 or array.max() >= n:
        wrong = array.min() if array.min() < 0 else array.max()
        raise SurfaceError(f"index {wrong} is chosen, but there are {n} {what}")
    flags = np.zeros(n, dtype=bool)
    flags[array] = True
    return flags


def _vertices(surface: trimesh.Trimesh) -> Array:
    vertices = np.asarray(surface.vertices, dtype=np.float64)
    if len(vertices) == 0:
        raise SurfaceError("the surface is empty: it has no vertex to lock")
    return vertices


def _diagonal(vertices: Array) -> float:
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


@nb.njit(cache=True, nogil=True)
def _faces_above(P: Array, V: Array, F: Faces) -> npt.NDArray[np.int64]:
    """Faces above each point that face up, less those that face down; P (n, 3) ascending in x.

    A face covers a point if two of its sides' half-open x-intervals hold the point's x with the sides on either side
    of it in y: sides are evaluated from their lower vertex index, so that neighbours agree on every point.
    """
    counts = np.zeros(len(P), dtype=np.int64)
    x = P[:, 0].copy()
    for f in range(len(F)):
        low = min(V[F[f, 0], 0], V[F[f, 1], 0], V[F[f, 2], 0])
        high = max(V[F[f, 0], 0], V[F[f, 1], 0], V[F[f, 2], 0])
        first, last = np.searchsorted(x, low), np.searchsorted(x, high)
        for p in range(first, last):
            turns, sides = 0, 0
            y0, y1, z0, z1 = 0.0, 0.0, 0.0, 0.0
            for e in range(3):
                i, j = F[f, e], F[f, (e + 1) % 3]
                a, b = (i, j) if i < j else (j, i)
                if (V[a, 0] <= x[p]) == (V[b, 0] <= x[p]):
                    continue
                t = (x[p] - V[a, 0]) / (V[b, 0] - V[a, 0])
                y, z = V[a, 1] + t * (V[b, 1] - V[a, 1]), V[a, 2] + t * (V[b, 2] - V[a, 2])
                if y <= P[p, 1]:
                    # Of a face that looks up, the side with the lesser y runs up in x.
                    turns += 1 if V[i, 0] < V[j, 0] else -1
                if sides == 0:
                    y0, z0 = y, z
                else:
                    y1, z1 = y, z
                sides += 1
            # With both sides on one side of the point in y, the turns cancel out or are none.
            if turns != 0:
                share = (P[p, 1] - y0) / (y1 - y0)
                if z0 + share * (z1 - z0) > P[p, 2]:
                    counts[p] += turns
    return counts
