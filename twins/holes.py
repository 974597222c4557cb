"""Holes of a mesh: their rims, and the faces that close them."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
import numpy.typing as npt

from .crossings import find_cuts
from .mesh_edges import edge_faults

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_LONGEST_RIM = 400  # of a patch of least area, whose search grows with the third power


@dataclass(frozen=True)
class Hole:
    """A hole that was closed.

    Attributes:
        center: mean of its rim, shape (3,), mm.
        edges: number of edges of the rim.
        length: of the rim, mm.
    """

    center: tuple[float, float, float]
    edges: int
    length: float

    def __str__(self) -> str:
        x, y, z = self.center
        return f"hole of {self.edges} edges, {self.length:.1f} mm around, at ({x:.1f}, {y:.1f}, {z:.1f})"


def boundary_loops(faces: Faces) -> list[npt.NDArray[np.int64]]:
    """Rims of the holes of a mesh, each as vertex indices in the order that a closing face would have."""
    open_edges, _, _ = edge_faults(faces)
    following: dict[int, list[int]] = {}
    for start, end in open_edges:
        following.setdefault(int(end), []).append(int(start))
    loops: list[npt.NDArray[np.int64]] = []
    while following:
        # Walk until a vertex comes back: where holes touch in a vertex this splits them into simple rims.
        walk = [next(iter(following))]
        seen = {walk[0]: 0}
        while walk and following.get(walk[-1]):
            step = following[walk[-1]].pop()
            if step in seen:
                at = seen[step]
                loops.append(np.array(walk[at:], dtype=np.int64))
                for vertex in walk[at + 1 :]:
                    del seen[vertex]
                walk = walk[: at + 1]
            else:
                seen[step] = len(walk)
                walk.append(step)
        following = {vertex: ends for vertex, ends in following.items() if ends}
    return [loop for loop in loops if len(loop) >= 3]


def hole_at(vertices: Array, rim: npt.NDArray[np.int64]) -> Hole:
    ring = vertices[rim]
    x, y, z = (float(value) for value in ring.mean(axis=0))
    return Hole((x, y, z), len(rim), float(np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum()))


def with_holes_closed(
    vertices: Array, faces: Faces, rims: list[npt.NDArray[np.int64]]
) -> tuple[Array, Faces]:
    """Holes closed by fans; by the patches of least area where the fans would cut the surface."""
    fans = _with_fans(vertices, faces, rims)
    if max(map(len, rims)) > _LONGEST_RIM or number_of_cuts(*fans) == 0:
        return fans
    patches = [rim[_least_area(vertices[rim])] for rim in rims]
    taut = np.concatenate([faces, *patches])
    return (vertices, taut) if number_of_cuts(vertices, taut) == 0 else fans


def number_of_cuts(vertices: Array, faces: Faces) -> int:
    return find_cuts(vertices, faces, np.zeros(len(faces), dtype=np.int64), 1).number


def _with_fans(vertices: Array, faces: Faces, rims: list[npt.NDArray[np.int64]]) -> tuple[Array, Faces]:
    points, patches = [vertices], [faces]
    at = len(vertices)
    for rim in rims:
        if len(rim) == 3:
            patches.append(rim[None])
            continue
        points.append(vertices[rim].mean(axis=0)[None])
        patches.append(np.column_stack([rim, np.roll(rim, -1), np.full(len(rim), at)]))
        at += 1
    return np.concatenate(points), np.concatenate(patches)


@nb.njit(cache=True, nogil=True)
def _least_area(rim: Array) -> Faces:
    """The triangles of least area over a closed polygon in space, shape (n - 2, 3) (Barequet and Sharir 1995)."""
    n = len(rim)
    cost = np.zeros((n, n))
    middle = np.zeros((n, n), np.int64)
    for reach in range(2, n):
        for i in range(n - reach):
            j = i + reach
            cost[i, j] = np.inf
            for k in range(i + 1, j):
                ax, ay, az = rim[k, 0] - rim[i, 0], rim[k, 1] - rim[i, 1], rim[k, 2] - rim[i, 2]
                bx, by, bz = rim[j, 0] - rim[i, 0], rim[j, 1] - rim[i, 1], rim[j, 2] - rim[i, 2]
                area = (ay * bz - az * by) ** 2 + (az * bx - ax * bz) ** 2 + (ax * by - ay * bx) ** 2
                total = cost[i, k] + cost[k, j] + 0.5 * np.sqrt(area)
                if total < cost[i, j]:
                    cost[i, j] = total
                    middle[i, j] = k
    triangles = np.empty((n - 2, 3), np.int64)
    waiting = np.empty((n, 2), np.int64)
    waiting[0, 0], waiting[0, 1] = 0, n - 1
    depth, count = 1, 0
    while depth > 0:
        depth -= 1
        i, j = waiting[depth, 0], waiting[depth, 1]
        if j - i < 2:
            continue
        k = middle[i, j]
        triangles[count, 0], triangles[count, 1], triangles[count, 2] = i, k, j
        count += 1
        waiting[depth, 0], waiting[depth, 1] = i, k
        waiting[depth + 1, 0], waiting[depth + 1, 1] = k, j
        depth += 2
    return triangles
