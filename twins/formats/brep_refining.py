"""Faces of 3DM files as triangles: divided in the parameters of their surfaces until they lie within the tolerance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import manifold3d
import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from twins.mesh_edges import equal_rows

from .brep_boundary import Boundary, off_segments
from .nurbs import Nurbs

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

MOST: Final = 4_000_000
"""Triangles of one face: beyond this the tolerance is too fine for the part."""

SAFE: Final = 0.8
"""Part of the tolerance that samples of a triangle may use: between them it may lie a little further off."""

ROUNDS: Final = 20
"""How often edges that fall together are halved."""


@dataclass(frozen=True)
class Patch:
    """The triangles of one face.

    Attributes:
        surface: that they lie near.
        uv: parameters of their corners, shape (n, 2).
        xyz: the corners, shape (n, 3).
        number: of each corner in the whole mesh, shape (n,); several corners of a patch may be one, at a seam or pole.
        triangles: shape (m, 3), into the corners.
    """

    surface: Nurbs
    uv: Array
    xyz: Array
    number: Faces
    triangles: Faces

    def corners(self) -> Faces:
        """The triangles in the numbers of the whole mesh, without those that have lost a side; shape (k, 3)."""
        a, b, c = self.number[self.triangles].T
        proper = (a != b) & (b != c) & (c != a)
        return np.asarray(np.column_stack([a, b, c])[proper])


def patch_of(boundary: Boundary, points: Array, runs: list[Faces], chord: float, first: int) -> Patch:
    """The triangles of a face, facing the way of its surface; points inside it are numbered from `first`.

    Raises:
        ValueError: the boundary encloses nothing, or the face needs more than `MOST` triangles.
    """
    rings = [boundary.ring(loop, runs) for loop in boundary.loops]
    number = np.concatenate([number for number, _ in rings])
    uv = np.concatenate([uv for _, uv in rings])
    scale = _lengths(boundary.surface)
    triangles = np.asarray(
        manifold3d.triangulate([np.ascontiguousarray(ring * scale) for _, ring in rings]), dtype=np.int64
    ).reshape(-1, 3)
    if not len(triangles):
        raise ValueError("its boundary encloses nothing")
    uv, xyz, triangles = _refined(boundary.surface, points[number], uv, triangles, chord)
    inner = np.arange(len(xyz) - len(number))
    return Patch(boundary.surface, uv, xyz, np.r_[number, first + inner], triangles)


def _lengths(surface: Nurbs) -> Array:
    """How long a surface is along u and v, about."""
    line = np.linspace(0.0, 1.0, 9)
    uv = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    _, Su, Sv = surface.derivatives(uv)
    lengths = np.array([np.linalg.norm(Su, axis=1).mean(), np.linalg.norm(Sv, axis=1).mean()])
    return np.asarray(np.maximum(lengths, 1e-9 * lengths.max()))


def pulled_apart(patches: list[Patch], count: int) -> list[Patch]:
    """Edges inside faces halved where they fall together, so that every edge of the mesh has two faces.

    Two edges join the same two points where corners of a face are one (at a pole, on a seam), or where two faces share
    two points. What is new is numbered from `count`.
    """
    for _ in range(ROUNDS):
        sides = [_Sides.of(patch) for patch in patches]
        keys = np.concatenate([side.keys for side in sides])
        rim = np.concatenate([side.rim for side in sides])
        # On a boundary two faces meet, or one meets itself: that is one edge of the mesh.
        first, index, _ = equal_rows(np.column_stack([keys, np.where(rim, -1, np.arange(len(keys)))]))
        _, of, copies = equal_rows(keys[first])
        crowded = np.split(
            (copies[of] > 1)[index] & ~rim & (keys[:, 0] != keys[:, 1]),
            np.cumsum([len(side.keys) for side in sides])[:-1],
        )
        done = True
        for i, (side, flags) in enumerate(zip(sides, crowded, strict=True)):
            wanted = side.loops | flags[side.group]
            if wanted.any():
                done = False
                patches[i] = _halved(patches[i], side, wanted, count)
                count += int(wanted.sum())
        if done:
            break
    return patches


@dataclass(frozen=True)
class _Sides:
    """The edges of a patch, and how they fall together when triangles that have lost a side are left out.

    `edges` shape (e, 2) into the corners; `own` shape (m, 3), the edges of each triangle; `loops` those inside the face
    that begin and end in the same point of the mesh; `group` of edges that become one, shape (e,); `keys` the ends of
    each group in the mesh, shape (g, 2); `rim` the groups with an edge of the boundary.
    """

    edges: Faces
    own: Faces
    loops: Flags
    group: Faces
    keys: Faces
    rim: Flags

    @classmethod
    def of(cls, patch: Patch) -> _Sides:
        sides = np.sort(patch.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        first, index, count = equal_rows(sides)
        edges = sides[first]
        own, inner = index.reshape(-1, 3), count == 2
        ends = patch.number[edges]
        closed = ends[:, 0] == ends[:, 1]
        # An edge in a pole has no length; its triangle falls away, and the other two sides of that become one.
        middles = patch.surface.points(0.5 * (patch.uv[edges[closed, 0]] + patch.uv[edges[closed, 1]]))
        loops = np.zeros(len(edges), dtype=bool)
        loops[closed] = (
            np.linalg.norm(middles - patch.xyz[edges[closed, 0]], axis=1) > 1e-6 * patch.surface.size
        )
        loops &= inner
        base = closed[own] & ~loops[own]
        lost = np.flatnonzero(base.sum(axis=1) == 1)
        at = base[lost].argmax(axis=1)
        pair = own[lost[:, None], (at[:, None] + [1, 2]) % 3]
        graph = coo_matrix((np.ones(len(pair)), (pair[:, 0], pair[:, 1])), shape=(len(edges), len(edges)))
        _, group = connected_components(graph, directed=False)
        _, leader = np.unique(group, return_index=True)
        rim = np.bincount(group, ~inner) > 0
        return cls(edges, own, loops, group.astype(np.int64), np.sort(ends[leader], axis=1), rim)


def _halved(patch: Patch, sides: _Sides, wanted: Flags, first: int) -> Patch:
    """Some edges inside a face halved; their middles are numbered from `first`."""
    middle = np.full(len(sides.edges), -1)
    middle[wanted] = len(patch.uv) + np.arange(wanted.sum())
    new = 0.5 * (patch.uv[sides.edges[wanted, 0]] + patch.uv[sides.edges[wanted, 1]])
    xyz = np.concatenate([patch.xyz, patch.surface.points(new)])
    return replace(
        patch,
        uv=np.concatenate([patch.uv, new]),
        xyz=xyz,
        number=np.r_[patch.number, first + np.arange(len(new))],
        triangles=_split(patch.triangles, middle[sides.own], xyz),
    )


def _refined(
    surface: Nurbs, xyz: Array, uv: Array, triangles: Faces, chord: float
) -> tuple[Array, Array, Faces]:
    """Edges inside a face halved until the surface lies within the tolerance; those of its boundary stay."""
    if surface.flat:
        return uv, xyz, triangles
    keys, misses, lengths = np.empty(0, dtype=np.int64), np.empty(0), np.empty(0)
    bulges = np.empty(0)
    for _ in range(200):
        sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        first, index, count = equal_rows(sides)
        edges, own, inner = sides[first], index.reshape(-1, 3), count == 2
        # What is known of edges and triangles that stayed is kept.
        found = edges[:, 0] * MOST * 4 + edges[:, 1]
        at = np.minimum(np.searchsorted(keys, found), max(len(keys) - 1, 0))
        new = keys[at] != found if len(keys) else np.ones(len(found), dtype=bool)
        off, long = (known[at] if len(keys) else np.empty(len(found)) for known in (misses, lengths))
        off[new], long[new] = _edge_misses(surface, xyz, uv, edges[new])
        keys, misses, lengths = found, off, long
        bulges = np.concatenate([bulges, _middle_misses(surface, xyz, uv, triangles[len(bulges) :])])

        # Shorter edges lie near enough; that their ends do not lie quite on the surface is the file's own tolerance.
        divisible = inner & (lengths > chord)
        wanted = (misses > SAFE * chord) & divisible
        # With any other the longest edge goes too, or halving could go on for ever beside it. A triangle may also lie
        # off the surface between edges that do not.
        bulging = (bulges > SAFE * chord) | wanted[own].any(axis=1)
        wanted[_longest(own, np.where(divisible, lengths, -1.0))[bulging]] = True
        wanted &= divisible
        if not wanted.any():
            return uv, xyz, triangles
        middle = np.full(len(edges), -1)
        middle[wanted] = len(xyz) + np.arange(wanted.sum())
        halves = 0.5 * (uv[edges[wanted, 0]] + uv[edges[wanted, 1]])
        uv, xyz = np.concatenate([uv, halves]), np.concatenate([xyz, surface.points(halves)])
        bulges = bulges[~wanted[own].any(axis=1)]
        triangles = _split(triangles, middle[own], xyz)
        if len(triangles) > MOST:
            break
    raise ValueError("it needs too many triangles for the tolerance")


def _longest(own: Faces, lengths: Array) -> Faces:
    """Of each triangle's three edges the one with the greatest length."""
    return np.asarray(own[np.arange(len(own)), lengths[own].argmax(axis=1)])


def _edge_misses(surface: Nurbs, xyz: Array, uv: Array, edges: Faces) -> tuple[Array, Array]:
    """How far the surface lies off edges, at quarters of them; and how long they are along the surface."""
    a, b = edges.T
    way = [xyz[a], *(surface.points((1 - s) * uv[a] + s * uv[b]) for s in (0.25, 0.5, 0.75)), xyz[b]]
    misses = [off_segments(points, xyz[a], xyz[b]) for points in way[1:-1]]
    steps = [np.linalg.norm(q - p, axis=1) for p, q in pairwise(way)]
    return np.max(misses, axis=0), np.sum(steps, axis=0)


def _middle_misses(surface: Nurbs, xyz: Array, uv: Array, triangles: Faces) -> Array:
    """How far the surface lies off triangles, at their middles: off their planes, or their edges if that is less."""
    a, b, c = (xyz[triangles[:, i]] for i in range(3))
    middle = surface.points(uv[triangles].mean(axis=1))
    normal = np.cross(b - a, c - a)
    length = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    planes = np.abs(np.einsum("ij,ij->i", middle - a, normal)) / length
    # The plane of a sliver is anyone's guess; such a triangle is hardly more than its edges.
    edges = [off_segments(middle, p, q) for p, q in ((a, b), (b, c), (c, a))]
    return np.asarray(np.minimum(planes, np.min(edges, axis=0)))


def _split(triangles: Faces, middles: Faces, xyz: Array) -> Faces:
    """Triangles divided along their halved edges; `middles` holds the points on the edges 01, 12, 20, or -1."""
    halved = middles >= 0
    count = halved.sum(axis=1)
    # Turned so that of one halved edge it is the first, and of two they are the first and second.
    turn = np.select([count == 1, count == 2], [halved.argmax(axis=1), ((~halved).argmax(axis=1) + 1) % 3], 0)
    order = (np.arange(3) + turn[:, None]) % 3
    t, m = np.take_along_axis(triangles, order, axis=1), np.take_along_axis(middles, order, axis=1)
    made = [t[count == 0]]
    (a, b, c), p = t[count == 1].T, m[count == 1, 0]
    made += [np.column_stack(k) for k in ((a, p, c), (p, b, c))]
    (a, b, c), (p, q) = t[count == 2].T, m[count == 2, :2].T
    shorter = ((xyz[a] - xyz[q]) ** 2).sum(axis=1) <= ((xyz[p] - xyz[c]) ** 2).sum(axis=1)
    made.append(np.column_stack([p, b, q]))
    made += [np.column_stack(k)[shorter] for k in ((a, p, q), (a, q, c))]
    made += [np.column_stack(k)[~shorter] for k in ((a, p, c), (p, q, c))]
    (a, b, c), (p, q, r) = t[count == 3].T, m[count == 3].T
    made += [np.column_stack(k) for k in ((a, p, r), (p, b, q), (r, q, c), (p, q, r))]
    return np.concatenate(made)
