"""NURBS surfaces of 3DM files: points, derivatives, and the parameters of points that lie on them."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

Array = npt.NDArray[np.float64]


class Nurbs:
    """A tensor product surface; both parameters run from 0 to 1.

    Args:
        degrees: in u and v.
        knots: of u and v, as many as control points and degree + 1; clamped or periodic.
        control: homogeneous control points (w x, w y, w z, w), shape (n, m, 4).
    """

    def __init__(self, degrees: tuple[int, int], knots: tuple[Array, Array], control: Array) -> None:
        self.degrees = degrees
        self.knots = tuple((k - k[p]) / (k[-p - 1] - k[p]) for k, p in zip(knots, degrees, strict=True))
        self.control = control
        spread = control[..., :3] / control[..., 3:]
        self.size = float(np.ptp(spread.reshape(-1, 3), axis=0).max())
        self.closed = tuple(self._meets_itself(axis) for axis in range(2))
        self._tree: tuple[cKDTree[Any], Array] | None = None

    @classmethod
    def of(cls, surface: Any) -> Self:
        """The same surface as rhino3dm's NurbsSurface, whose knot vectors leave out the first and the last."""
        points = surface.Points
        control = np.array(
            [
                [(p.X, p.Y, p.Z, p.W) for p in (points[i, j] for j in range(points.CountV))]
                for i in range(points.CountU)
            ],
            dtype=np.float64,
        )
        knots = [np.array([k[0], *k, k[len(k) - 1]]) for k in map(list, (surface.KnotsU, surface.KnotsV))]
        return cls((surface.Degree(0), surface.Degree(1)), (knots[0], knots[1]), control)

    @property
    def flat(self) -> bool:
        """A bilinear patch goes on beyond its ends; others do not."""
        return self.degrees == (1, 1) and self.control.shape[:2] == (2, 2)

    def has_pole(self, axis: int, end: float) -> bool:
        """Whether the surface is a single point at one end of an axis."""
        return bool(np.ptp(self.points(_border(axis, end)), axis=0).max() < 1e-7 * self.size)

    def _meets_itself(self, axis: int) -> bool:
        """Whether the surface's end along an axis is its beginning."""
        one, two = (self.points(_border(axis, end)) for end in (0.0, 1.0))
        return bool(np.abs(one - two).max() < 1e-7 * self.size)

    def derivatives(self, uv: Array) -> tuple[Array, Array, Array]:
        """Points and both first derivatives at parameters of shape (n, 2); shape (n, 3) each."""
        (first_u, N, dN), (first_v, M, dM) = (
            _basis(self.knots[i], self.degrees[i], uv[:, i]) for i in range(2)
        )
        rows = first_u[:, None] + np.arange(self.degrees[0] + 1)
        columns = first_v[:, None] + np.arange(self.degrees[1] + 1)
        local = self.control[rows[:, :, None], columns[:, None, :]]
        S, Su, Sv = (np.einsum("ni,nj,nijk->nk", a, b, local) for a, b in ((N, M), (dN, M), (N, dM)))
        weight = S[:, 3:]
        point = S[:, :3] / weight
        return (
            point,
            (Su[:, :3] - Su[:, 3:] * point) / weight,
            (Sv[:, :3] - Sv[:, 3:] * point) / weight,
        )

    def points(self, uv: Array) -> Array:
        return self.derivatives(uv)[0]

    def parameters(self, points: Array) -> Array:
        """Parameters of the surface's nearest points to the given ones, shape (n, 3), by Gauss and Newton's method."""
        tree, samples = self._samples()
        best, miss = self._nearest(points, samples[tree.query(points)[1]])
        stuck = np.flatnonzero(miss > 1e-9 * self.size)
        if len(stuck):
            starts = np.asarray(tree.query(points[stuck], k=np.arange(2, min(6, len(samples) + 1)))[1])
            for start in starts.T:
                other, off = self._nearest(points[stuck], samples[start])
                better = off < miss[stuck]
                best[stuck[better]], miss[stuck[better]] = other[better], off[better]
        return best

    def _nearest(self, points: Array, start: Array) -> tuple[Array, Array]:
        """Parameters of near points, from the given ones on, and the distances that are left."""
        best = start.copy()
        here, Su, Sv = self.derivatives(best)
        miss = np.linalg.norm(here - points, axis=1)
        step = np.ones(len(points))
        for _ in range(30):
            gap = points - here
            a, b, c = (np.einsum("ij,ij->i", p, q) for p, q in ((Su, Su), (Su, Sv), (Sv, Sv)))
            e, f = (np.einsum("ij,ij->i", p, gap) for p in (Su, Sv))
            det = a * c - b * b
            regular = det > 1e-14 * np.maximum(a, c) ** 2
            det = np.where(regular, det, 1.0)
            # At a pole only one direction moves the point.
            du = np.where(regular, (c * e - b * f) / det, e / np.maximum(a + c, 1e-300))
            dv = np.where(regular, (a * f - b * e) / det, f / np.maximum(a + c, 1e-300))
            if not self.flat and not self.closed[0]:
                # Where one parameter stops at the end of the surface the other goes its own way.
                room = np.clip(best[:, 0] + du, 0.0, 1.0) - best[:, 0]
                dv = np.where(room != du, (f - b * room) / np.maximum(c, 1e-300), dv)
                du = room
            if not self.flat and not self.closed[1]:
                room = np.clip(best[:, 1] + dv, 0.0, 1.0) - best[:, 1]
                du = np.where(room != dv, (e - b * room) / np.maximum(a, 1e-300), du)
                dv = room
            tried = best + step[:, None] * np.column_stack([du, dv])
            if not self.flat:
                for axis in range(2):
                    tried[:, axis] = (
                        tried[:, axis] % 1.0 if self.closed[axis] else np.clip(tried[:, axis], 0.0, 1.0)
                    )
            there, Tu, Tv = self.derivatives(tried)
            off = np.linalg.norm(there - points, axis=1)
            better = off < miss
            best[better], miss[better], here[better] = tried[better], off[better], there[better]
            Su[better], Sv[better] = Tu[better], Tv[better]
            step = np.where(better, 1.0, 0.5 * step)
            if not better.any() and step.max() < 1e-3:
                break
        return best, miss

    def _samples(self) -> tuple[cKDTree[Any], Array]:
        """Points to start from: some within every span, off its ends, where a surface may meet itself."""
        if self._tree is None:
            lines = []
            for knots, degree in zip(self.knots, self.degrees, strict=True):
                # The knots of periodic surfaces go on beyond their ends.
                spans = np.unique(np.clip(knots, 0.0, 1.0))
                share = (np.arange(4 * degree) + 0.5) / (4 * degree)
                lines.append((spans[:-1, None] + share * np.diff(spans)[:, None]).reshape(-1))
            uv = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
            self._tree = (cKDTree(self.points(uv)), uv)
        return self._tree


def _basis(knots: Array, degree: int, at: Array) -> tuple[npt.NDArray[np.int64], Array, Array]:
    """First control point, values and derivatives of the p + 1 basis functions that are not 0, shape (n, p + 1)."""
    span = np.clip(np.searchsorted(knots, at, side="right") - 1, degree, len(knots) - degree - 2)
    values = np.ones((len(at), 1))
    lower = values
    for p in range(1, degree + 1):
        lower = values
        values = np.zeros((len(at), p + 1))
        for i in range(p):
            left, right = knots[span - p + 1 + i], knots[span + 1 + i]
            share = lower[:, i] / (right - left)
            values[:, i] += (right - at) * share
            values[:, i + 1] += (at - left) * share
    slopes = np.zeros_like(values)
    for i in range(degree):
        share = degree * lower[:, i] / (knots[span + 1 + i] - knots[span - degree + 1 + i])
        slopes[:, i] -= share
        slopes[:, i + 1] += share
    return span - degree, values, slopes


def _border(axis: int, end: float) -> Array:
    """Parameters along one end of an axis."""
    uv = np.full((17, 2), end)
    uv[:, 1 - axis] = np.linspace(0.0, 1.0, 17)
    return uv
