"""Half-edges: which triangles of a mesh share an edge.

Half-edge 3 f + e runs from corner e of face f to the next. In a closed, oriented mesh each has exactly one that runs
against it.
"""

from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np
import numpy.typing as npt

from .errors import SurfaceError

Indices = npt.NDArray[Any]
"""Whole numbers: int32, or int64 where the mesh is too large for that."""


def opposite_half_edges(faces: npt.NDArray[np.integer], vertex_count: int) -> Indices:
    """For half-edge 3 f + e (corner e to the next of face f) the one that runs against it, or -1; shape (3 m,).

    Raises:
        SurfaceError: a face names a vertex that is not there.
    """
    _, across, _ = adjacency(faces, vertex_count)
    return np.maximum(across, -1, out=across)


def adjacency(faces: npt.NDArray[np.integer], vertex_count: int) -> tuple[Indices, Indices, int]:
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
def is_crowded(faces: Indices, head: Indices, link: Indices) -> bool:
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
