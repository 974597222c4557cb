"""Boundaries of faces of 3DM files: edges as points that both faces share, and their parameters on each face.

The file names the edges around a face, but not their curves in the parameters. Those follow from the points, except on
seams and poles of closed surfaces: the face lies left of its boundary, so the boundary runs up the seam at the end of
the parameter and down the one at its beginning; at a pole it goes straight from one to the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from twins.mesh_edges import equal_rows

from .flattening import corners_of, flat_pieces, halves, spline_pieces
from .nurbs import Nurbs

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

POLE: Final = 31
"""Points along the side of the parameters that is a pole."""

SHARE: Final = 0.5
"""Part of the tolerance that edges may use; the rest is left to the triangles beside them."""

NEAR: Final = 0.01
"""Part of the tolerance within which a point counts as one of a seam or a pole, if its edge lies no further off."""

ROUNDS: Final = 12
"""How often a piece of an edge is halved at most for the sake of the surfaces beside it."""


@dataclass(frozen=True)
class Edges:
    """Edges as pieces within the tolerance of straight lines.

    Attributes:
        vertices: at which edges end, shape (n, 3).
        ends: the vertices at which each edge starts and ends.
        pieces: rational Bézier pieces of each edge, shape (m, d + 1, 4).
    """

    vertices: Array
    ends: tuple[tuple[int, int], ...]
    pieces: tuple[Array, ...]

    def numbered(self) -> tuple[Array, list[Faces]]:
        """All points, shape (n, 3), vertices first; the numbers of each edge's points from its start to its end."""
        inner = [corners_of(pieces)[1:-1] for pieces in self.pieces]
        first = np.cumsum([len(self.vertices), *(len(points) for points in inner)])
        runs = [
            np.r_[start, at + np.arange(len(points)), end]
            for (start, end), at, points in zip(self.ends, first, inner, strict=False)
        ]
        return np.concatenate([self.vertices, *inner]), runs

    def coincident(self) -> list[Flags]:
        """Which pieces join the same two points as another one does."""
        _, runs = self.numbered()
        pairs = [np.sort(np.column_stack([run[:-1], run[1:]]), axis=1) for run in runs]
        _, index, count = equal_rows(np.concatenate(pairs))
        return np.split(count[index] > 1, np.cumsum([len(pair) for pair in pairs])[:-1])

    def halved(self, edge: int, wanted: Flags) -> Edges:
        """The same with some pieces of an edge halved."""
        pieces = self.pieces[edge]
        at = np.flatnonzero(wanted)
        low, high = halves(pieces[at])
        pieces = pieces.copy()
        pieces[at] = low
        return replace(
            self,
            pieces=(*self.pieces[:edge], np.insert(pieces, at + 1, high, axis=0), *self.pieces[edge + 1 :]),
        )


@dataclass(frozen=True)
class Side:
    """An edge on the boundary of a face: parameters of its points, shape (k, 2), in the direction of the edge."""

    edge: int
    against: bool
    uv: Array
    near: float


@dataclass(frozen=True)
class Boundary:
    """A surface and the loops around the face in it; a side that is a pole is None."""

    surface: Nurbs
    loops: tuple[tuple[Side | None, ...], ...]

    def ring(self, loop: Sequence[Side | None], runs: list[Faces]) -> tuple[Faces, Array]:
        """One loop: numbers of its points, and their parameters."""
        ways = [
            None if side is None else _way(side, runs[side.edge], _on_one_side(self.surface, side))
            for side in loop
        ]
        numbers, parameters = [], []
        for i, way in enumerate(ways):
            before, after = ways[i - 1], ways[(i + 1) % len(ways)]
            if way is not None:
                run, uv = way
                # The end of one side is the beginning of the next, unless a pole lies between them.
                numbers.append(run if after is None else run[:-1])
                parameters.append(uv if after is None else uv[:-1])
            elif before is not None and after is not None:
                # All points at a pole are one; many of them keep the triangles there from turning around it.
                share = np.linspace(0.0, 1.0, POLE + 2)[1:-1, None]
                numbers.append(np.full(POLE, before[0][-1]))
                parameters.append((1.0 - share) * before[1][-1] + share * after[1][0])
        return np.concatenate(numbers), np.concatenate(parameters)


def sampled_edges(brep: Any, chord: float) -> Edges:
    """The edges of a Brep, halved until each piece lies within the tolerance of a straight line.

    Raises:
        ValueError: an edge has no curve, or none that can be sampled.
    """
    places = [brep.Vertices[i].Location for i in range(len(brep.Vertices))]
    vertices = np.array([(p.X, p.Y, p.Z) for p in places], dtype=np.float64).reshape(-1, 3)
    joined: dict[int, tuple[int, int]] = {}
    for i in range(len(brep.Faces)):
        for trim in (t for loop in loops_of(brep.Faces[i]) for t in loop):
            if trim.EdgeIndex >= 0:
                ends = (trim.StartVertexIndex, trim.EndVertexIndex)
                joined[trim.EdgeIndex] = ends[::-1] if trim.IsReversed else ends
    ends_of = tuple(joined.get(i, (-1, -1)) for i in range(len(brep.Edges)))
    pieces = tuple(
        _pieces(brep.Edges[i], chord, closed=start == end) for i, (start, end) in enumerate(ends_of)
    )
    return Edges(vertices, ends_of, pieces)


def loops_of(face: Any) -> list[list[Any]]:
    return [list(face.Loops[i].Trims) for i in range(len(face.Loops))]


def _pieces(edge: Any, chord: float, *, closed: bool) -> Array:
    curve = edge.ToNurbsCurve()
    if curve is None:
        raise ValueError("an edge has no curve")
    control = np.array([(p.X, p.Y, p.Z, p.W) for p in curve.Points], dtype=np.float64)
    if not (control[:, 3] > 0).all():
        raise ValueError("the weights of an edge are not all above 0")
    knots = list(curve.Knots)
    pieces = flat_pieces(spline_pieces(control, [knots[0], *knots, knots[-1]], curve.Degree), chord)
    while closed and len(pieces) < 4:
        pieces = np.stack(halves(pieces), axis=1).reshape(-1, *pieces.shape[1:])
    return pieces


def boundary_of(face: Any, edges: Edges, chord: float) -> Boundary:
    """The surface of a face, and the parameters of the points around it.

    Raises:
        ValueError: an edge lies further beside the surface than the tolerance; there is no boundary.
    """
    surface = Nurbs.of(face.UnderlyingSurface().ToNurbsSurface())
    loops = []
    for trims in loops_of(face):
        sides: list[Side | None] = []
        for trim in trims:
            if trim.EdgeIndex < 0:
                sides.append(None)
                continue
            points = _points(edges, trim.EdgeIndex)
            uv = surface.parameters(points, NEAR * chord)
            miss = float(np.linalg.norm(surface.points(uv) - points, axis=1).max())
            if miss > max(chord, 1e-6 * np.abs(points).max()):
                raise ValueError(
                    f"its boundary lies {miss:.3g} beside its surface, more than the tolerance {chord:.3g}"
                )
            near = max(NEAR * chord, 2.0 * miss, 1e-9 * surface.size)
            sides.append(Side(trim.EdgeIndex, bool(trim.IsReversed), uv, near))
        loops.append(tuple(sides))
    if not loops:
        raise ValueError("it has no boundary")
    return Boundary(surface, tuple(loops))


def _points(edges: Edges, edge: int) -> Array:
    """The points of an edge; its ends are the vertices, which edges share."""
    points = corners_of(edges.pieces[edge])
    points[[0, -1]] = edges.vertices[list(edges.ends[edge])]
    return points


def settled(boundaries: list[Boundary], edges: Edges, chord: float) -> tuple[list[Boundary], Edges]:
    """Edges halved until straight lines between their points do as well in the parameters of both faces.

    Without it a face could not be divided finely enough beside its boundary. Pieces that join the same two points are
    halved too, for an edge of the mesh has two faces.
    """
    changed = set(range(len(edges.pieces)))
    for _ in range(ROUNDS):
        wanted = edges.coincident()
        for boundary in boundaries:
            for side in (side for loop in boundary.loops for side in loop if side is not None):
                if side.edge in changed:
                    wanted[side.edge] |= _bulges(boundary.surface, side, chord)
        changed = {i for i, flags in enumerate(wanted) if flags.any()}
        if not changed:
            break
        for i in changed:
            edges = edges.halved(i, wanted[i])
        boundaries = [
            replace(
                boundary,
                loops=tuple(
                    tuple(
                        side
                        if side is None or side.edge not in changed
                        else _followed(boundary.surface, side, edges, wanted[side.edge], chord)
                        for side in loop
                    )
                    for loop in boundary.loops
                ),
            )
            for boundary in boundaries
        ]
    return boundaries, edges


def _bulges(surface: Nurbs, side: Side, chord: float) -> Flags:
    """Between which points of a side the surface, along straight lines in its parameters, is not straight enough."""
    if surface.flat:
        return np.zeros(len(side.uv) - 1, dtype=bool)
    uv = _on_one_side(surface, side)
    ends = surface.points(uv)
    middles = surface.points(0.5 * (uv[:-1] + uv[1:]))
    a, b = ends[:-1], ends[1:]
    long = np.linalg.norm(middles - a, axis=1) + np.linalg.norm(b - middles, axis=1)
    return np.asarray((off_segments(middles, a, b) > SHARE * chord) & (long > chord))


def _followed(surface: Nurbs, side: Side, edges: Edges, halved: Flags, chord: float) -> Side:
    """A side with the parameters of the points at which its edge was halved."""
    at = np.flatnonzero(halved)
    middles = _points(edges, side.edge)[at + 1 + np.arange(len(at))]
    return replace(side, uv=np.insert(side.uv, at + 1, surface.parameters(middles, NEAR * chord), axis=0))


def off_segments(points: Array, a: Array, b: Array) -> Array:
    """Distances of points from the segments a, b."""
    along = b - a
    length2 = np.maximum(np.einsum("ij,ij->i", along, along), 1e-300)
    share = np.clip(np.einsum("ij,ij->i", points - a, along) / length2, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - a - share[:, None] * along, axis=1))


def _way(side: Side, run: Faces, uv: Array) -> tuple[Faces, Array]:
    return (run[::-1], uv) if side.against else (run, uv)


def _on_one_side(surface: Nurbs, side: Side) -> Array:
    """Parameters in the direction of the boundary, unambiguous where the surface meets itself, or ends in a pole."""
    uv = side.uv[::-1].copy() if side.against else side.uv.copy()
    if surface.flat or not (any(surface.closed) or any(surface.poles)):
        return uv
    here = surface.points(uv)
    along: list[int] = []
    for axis in range(2):
        loose = np.zeros(len(uv), dtype=bool)
        for end, pole in surface.poles[1 - axis]:
            at_pole = np.linalg.norm(here - pole, axis=1) <= side.near
            if not at_pole.all():
                uv[at_pole, 1 - axis] = end
                loose |= at_pole
        firm = ~loose
        if surface.closed[axis]:
            seam = uv.copy()
            seam[:, axis] = 0.0
            at_seam = firm & (np.linalg.norm(surface.points(seam) - here, axis=1) <= side.near)
            if at_seam[firm].all():
                along.append(axis)
            elif at_seam.any():
                uv[at_seam, axis] = np.round(uv[_nearest(at_seam, firm & ~at_seam), axis])
        if loose.any() and firm.any():
            uv[loose, axis] = uv[_nearest(loose, firm), axis]
    for axis in along:
        rising = uv[-1, 1 - axis] > uv[0, 1 - axis]
        uv[:, axis] = float(rising) if axis == 0 else float(not rising)
    return uv


def _nearest(these: Flags, those: Flags) -> Faces:
    """For each of these points of a side, which of those comes next before or after it."""
    others = np.flatnonzero(those)
    return np.asarray(others[np.abs(np.flatnonzero(these)[:, None] - others).argmin(axis=1)])
