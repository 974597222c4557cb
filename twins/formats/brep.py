"""Boundary representations of 3DM files as meshes, within a chord tolerance.

Edges are sampled once, so that the faces on both sides share their points: a closed solid gives a closed mesh. Of a
face the boundary is carried over into the parameters of its surface, triangulated there, and every edge inside the
face is halved until the surface lies within the tolerance of it.

The file names the edges around a face, but not their curves in the parameters. Those follow from the points, except on
seams and poles of closed surfaces: the face lies left of its boundary, so the boundary runs up the seam at the end of
the parameter and down the one at its beginning; at a pole it goes straight from one to the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import manifold3d
import numpy as np
import numpy.typing as npt

from twins.errors import FormatError
from twins.mesh_edges import equal_rows

from .nurbs import Nurbs
from .polygons import Polygons

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

MOST: Final = 4_000_000
"""Triangles of one face: beyond this the tolerance is too fine for the part."""

SAFE: Final = 0.8
"""Part of the tolerance that samples of a triangle may use: between them it may lie a little further off."""

POLE: Final = 31
"""Points along the side of the parameters that is a pole."""

NEAR: Final = 1e-6
"""Parameters nearer than this to a seam or a pole, or the end of the surface, lie on it."""


@dataclass(frozen=True)
class _Edges:
    """Points on all edges: `points` shape (n, 3), and the numbers of each edge's points from its start to its end."""

    points: Array
    runs: tuple[Faces, ...]


def mesh_of_brep(brep: Any, chord: float, path: Path) -> Polygons:
    """Triangles of all faces, with shared points along shared edges.

    Args:
        brep: rhino3dm's Brep.
        chord: how far the mesh may lie off the faces, in the unit of the file.
        path: of the file, for messages.

    Raises:
        FormatError: a face that cannot be meshed; the message gives its number and place.
    """
    edges = _sampled(brep, 0.5 * chord)
    points = [edges.points]
    faces = []
    count = len(edges.points)
    for i in range(len(brep.Faces)):
        face = brep.Faces[i]
        try:
            own, triangles = _mesh_of_face(face, edges, chord, count)
        except (ValueError, IndexError, FloatingPointError, AttributeError) as error:
            raise FormatError(
                f"{path}: face {i} of a polysurface cannot be meshed: {error}; "
                "rebuild it in Rhino, or export the part to STEP"
            ) from error
        points.append(own)
        faces.append(triangles[:, ::-1] if face.OrientationIsReversed else triangles)
        count += len(own)
    triangles = np.concatenate([np.empty((0, 3), dtype=np.int64), *faces])
    return Polygons(np.concatenate(points), (triangles,), exact=True)


def _sampled(brep: Any, chord: float) -> _Edges:
    """Points on the edges, within the tolerance of them; the ends are the vertices that edges share."""
    ends = [(v.X, v.Y, v.Z) for v in (brep.Vertices[i].Location for i in range(len(brep.Vertices)))]
    points: list[Array] = [np.array(ends, dtype=np.float64).reshape(-1, 3)]
    joined = _ends_of_edges(brep)
    runs: list[Faces] = []
    count = len(ends)
    for i in range(len(brep.Edges)):
        inner = _curve(brep.Edges[i], chord)[1:-1]
        start, end = joined.get(i, (-1, -1))
        runs.append(np.r_[start, count + np.arange(len(inner)), end])
        points.append(inner)
        count += len(inner)
    return _Edges(np.concatenate(points), tuple(runs))


def _ends_of_edges(brep: Any) -> dict[int, tuple[int, int]]:
    """The vertices at which each edge starts and ends, as the boundaries of the faces tell."""
    joined = {}
    for i in range(len(brep.Faces)):
        for trim in (t for loop in _loops(brep.Faces[i]) for t in loop):
            if trim.EdgeIndex >= 0:
                ends = (trim.StartVertexIndex, trim.EndVertexIndex)
                joined[trim.EdgeIndex] = ends[::-1] if trim.IsReversed else ends
    return joined


def _loops(face: Any) -> list[list[Any]]:
    return [list(face.Loops[i].Trims) for i in range(len(face.Loops))]


def _curve(edge: Any, chord: float) -> Array:
    """Points along an edge: between neighbours it lies within the tolerance of the straight line."""
    curve = edge.ToNurbsCurve()
    if curve is None:
        raise ValueError("an edge has no curve")
    low, high = curve.Domain.T0, curve.Domain.T1
    knots = np.unique([low, *(k for k in curve.Knots if low < k < high), high])
    closed = edge.IsClosed
    for halvings in range(16):
        pieces = 2**halvings
        share = np.arange(2 * pieces) / (2 * pieces)
        at = np.append((knots[:-1, None] + share * np.diff(knots)[:, None]).reshape(-1), high)
        points = np.array([(p.X, p.Y, p.Z) for p in map(curve.PointAt, at)])
        kept, between = points[::2], points[1::2]
        if closed and len(kept) < 5:
            continue
        if _off_segments(between, kept[:-1], kept[1:]).max() <= chord:
            return kept
    raise ValueError("an edge needs more than 32768 points for the tolerance")


def _off_segments(points: Array, a: Array, b: Array) -> Array:
    """Distances of points from the segments a, b."""
    along = b - a
    length2 = np.maximum(np.einsum("ij,ij->i", along, along), 1e-300)
    share = np.clip(np.einsum("ij,ij->i", points - a, along) / length2, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - a - share[:, None] * along, axis=1))


def _mesh_of_face(face: Any, edges: _Edges, chord: float, first: int) -> tuple[Array, Faces]:
    """Points inside a face, numbered from `first`, and its triangles, facing the way of its surface."""
    surface = Nurbs.of(face.UnderlyingSurface().ToNurbsSurface())
    rings = [_ring(surface, trims, edges, chord) for trims in _loops(face)]
    if not rings:
        raise ValueError("it has no boundary")
    number = np.concatenate([number for number, _ in rings])
    uv = np.concatenate([uv for _, uv in rings])
    xyz = edges.points[number]
    scale = _lengths(surface)
    contours = [np.ascontiguousarray(ring * scale) for _, ring in rings]
    triangles = np.asarray(manifold3d.triangulate(contours), dtype=np.int64).reshape(-1, 3)
    if not len(triangles):
        raise ValueError("its boundary encloses nothing")
    fixed = len(number)
    xyz, triangles = _refined(surface, xyz, uv, triangles, chord)
    numbers = np.r_[number, first + np.arange(len(xyz) - fixed)]
    corners = numbers[triangles]
    a, b, c = corners.T
    return xyz[fixed:], corners[(a != b) & (b != c) & (c != a)]


def _lengths(surface: Nurbs) -> Array:
    """How long a surface is along u and v, about."""
    line = np.linspace(0.0, 1.0, 9)
    uv = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    _, Su, Sv = surface.derivatives(uv)
    lengths = np.array([np.linalg.norm(Su, axis=1).mean(), np.linalg.norm(Sv, axis=1).mean()])
    return np.asarray(np.maximum(lengths, 1e-9 * lengths.max()))


def _ring(surface: Nurbs, trims: list[Any], edges: _Edges, chord: float) -> tuple[Faces, Array]:
    """One boundary of a face: numbers of its points, and their parameters."""
    sides: list[tuple[Faces, Array] | None] = []
    for trim in trims:
        if trim.EdgeIndex < 0:
            sides.append(None)
            continue
        run = edges.runs[trim.EdgeIndex]
        run = run[::-1] if trim.IsReversed else run
        uv = surface.parameters(edges.points[run])
        miss = np.linalg.norm(surface.points(uv) - edges.points[run], axis=1).max()
        if miss > max(chord, 1e-6 * np.abs(edges.points).max()):
            raise ValueError(f"its boundary lies {miss:.3g} beside its surface")
        sides.append((run, _on_one_side(surface, uv)))
    numbers, parameters = [], []
    for i, side in enumerate(sides):
        before, after = sides[i - 1], sides[(i + 1) % len(sides)]
        if side is not None:
            run, uv = side
            # The end of one side is the beginning of the next, unless a pole lies between them.
            numbers.append(run if after is None else run[:-1])
            parameters.append(uv if after is None else uv[:-1])
        elif before is not None and after is not None:
            # All points at a pole are one; many of them keep the triangles there from turning around it.
            share = np.linspace(0.0, 1.0, POLE + 2)[1:-1, None]
            numbers.append(np.full(POLE, before[0][-1]))
            parameters.append((1.0 - share) * before[1][-1] + share * after[1][0])
    return np.concatenate(numbers), np.concatenate(parameters)


def _on_one_side(surface: Nurbs, uv: Array) -> Array:
    """Parameters along a side of a face, made unambiguous where the surface meets itself, or ends in a pole."""
    uv = uv.copy()
    if surface.flat:
        return uv
    along: list[int] = []
    for axis in range(2):
        other = 1 - axis
        snapped = np.where(uv[:, axis] < NEAR, 0.0, np.where(uv[:, axis] > 1.0 - NEAR, 1.0, uv[:, axis]))
        uv[:, axis] = snapped
        poles = [end for end in (0.0, 1.0) if surface.has_pole(other, end)]
        loose = np.isin(np.where(np.abs(uv[:, other] - 0.5) > 0.5 - NEAR, np.round(uv[:, other]), 0.5), poles)
        firm = np.flatnonzero(~loose)
        if len(firm) == 0:
            raise ValueError("a side of it lies in a pole")
        if loose.any():
            nearest = firm[np.abs(np.flatnonzero(loose)[:, None] - firm).argmin(axis=1)]
            uv[loose, axis] = uv[nearest, axis]
        at_seam = surface.closed[axis] & ((uv[:, axis] == 0.0) | (uv[:, axis] == 1.0))
        if at_seam.all():
            along.append(axis)
        elif at_seam.any():
            inner = np.flatnonzero(~at_seam)
            nearest = inner[np.abs(np.flatnonzero(at_seam)[:, None] - inner).argmin(axis=1)]
            uv[at_seam, axis] = np.round(uv[nearest, axis])
    for axis in along:
        rising = uv[-1, 1 - axis] > uv[0, 1 - axis]
        uv[:, axis] = float(rising) if axis == 0 else float(not rising)
    return uv


def _refined(surface: Nurbs, xyz: Array, uv: Array, triangles: Faces, chord: float) -> tuple[Array, Faces]:
    """Edges inside a face halved until the surface lies within the tolerance; those of its boundary stay."""
    if surface.flat:
        return xyz, triangles
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
            return xyz, triangles
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
    misses = [_off_segments(points, xyz[a], xyz[b]) for points in way[1:-1]]
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
    edges = [_off_segments(middle, p, q) for p, q in ((a, b), (b, c), (c, a))]
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
