"""NURBS surfaces of 3DM files: points, derivatives, and the parameters of points that lie on them."""

from __future__ import annotations

from typing import Any, Self

import numba as nb
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
        self.control = np.ascontiguousarray(control, dtype=np.float64)
        spread = control[..., :3] / control[..., 3:]
        self.size = float(np.ptp(spread.reshape(-1, 3), axis=0).max())
        self.flat = self._is_plane()
        self.closed = tuple(self._meets_itself(axis) for axis in range(2))
        self.poles = tuple(self._poles(axis) for axis in range(2))
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

    def _is_plane(self) -> bool:
        """Whether the surface is a plane with even parameters."""
        if self.degrees != (1, 1) or self.control.shape[:2] != (2, 2):
            return False
        weights = self.control[..., 3]
        (a, b), (c, d) = self.control[..., :3] / weights[..., None]
        return bool(
            np.ptp(weights) <= 1e-12 * weights.max() and np.abs(a - b - c + d).max() <= 1e-9 * self.size
        )

    def _poles(self, axis: int) -> tuple[tuple[float, Array], ...]:
        """The ends of an axis at which the surface is a single point, and that point."""
        borders = [(end, self.points(_border(axis, end))) for end in (0.0, 1.0)]
        return tuple((end, line[0]) for end, line in borders if np.ptp(line, axis=0).max() < 1e-7 * self.size)

    def _meets_itself(self, axis: int) -> bool:
        """Whether the surface's end along an axis is its beginning."""
        one, two = (self.points(_border(axis, end)) for end in (0.0, 1.0))
        return bool(np.abs(one - two).max() < 1e-7 * self.size)

    def derivatives(self, uv: Array) -> tuple[Array, Array, Array]:
        """Points and both first derivatives at parameters of shape (n, 2); shape (n, 3) each."""
        S, Su, Sv = _evaluated(self.knots[0], self.knots[1], *self.degrees, self.control, np.asarray(uv))
        weight = S[:, 3:]
        point = S[:, :3] / weight
        return (
            point,
            (Su[:, :3] - Su[:, 3:] * point) / weight,
            (Sv[:, :3] - Sv[:, 3:] * point) / weight,
        )

    def points(self, uv: Array) -> Array:
        return self.derivatives(uv)[0]

    def parameters(self, points: Array, near: float = 0.0) -> Array:
        """Parameters of the surface's nearest points to the given ones, shape (n, 3), by Gauss and Newton's method.

        Where the search ends further off than `near` it starts again from other places. A plane goes on beyond its
        ends.
        """
        tree, samples = self._samples()
        best, miss = self._nearest(points, samples[tree.query(points)[1]])
        stuck = np.flatnonzero(miss > max(near, 1e-9 * self.size))
        if len(stuck) and not self.flat:
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
        going = np.arange(len(points))
        for _ in range(30):
            uv, a, b = best[going], Su[going], Sv[going]
            way = self._step(uv, a, b, points[going] - here[going])
            tried = uv + step[going, None] * way
            if not self.flat:
                for axis in range(2):
                    tried[:, axis] = (
                        tried[:, axis] % 1.0 if self.closed[axis] else np.clip(tried[:, axis], 0.0, 1.0)
                    )
            there, Tu, Tv = self.derivatives(tried)
            off = np.linalg.norm(there - points[going], axis=1)
            better = off < miss[going]
            to = going[better]
            best[to], miss[to], here[to], Su[to], Sv[to] = (v[better] for v in (tried, off, there, Tu, Tv))
            step[going] = np.where(better, 1.0, 0.5 * step[going])
            moved = np.abs(way[:, 0]) * np.linalg.norm(a, axis=1) + np.abs(way[:, 1]) * np.linalg.norm(
                b, axis=1
            )
            going = going[(better | (step[going] >= 1e-3)) & (moved > 1e-13 * self.size)]
            if not len(going):
                break
        return best, miss

    def _step(self, uv: Array, Su: Array, Sv: Array, gap: Array) -> Array:
        """The step of Gauss and Newton's method towards points at a distance `gap`, shape (n, 3), within the ends."""
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
            room = np.clip(uv[:, 0] + du, 0.0, 1.0) - uv[:, 0]
            dv = np.where(room != du, (f - b * room) / np.maximum(c, 1e-300), dv)
            du = room
        if not self.flat and not self.closed[1]:
            room = np.clip(uv[:, 1] + dv, 0.0, 1.0) - uv[:, 1]
            du = np.where(room != dv, (e - b * room) / np.maximum(a, 1e-300), du)
            dv = room
        return np.column_stack([du, dv])

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


@nb.njit(cache=True, nogil=True)
def _evaluated(
    knots_u: Array, knots_v: Array, p: int, q: int, control: Array, uv: Array
) -> tuple[Array, Array, Array]:
    """Homogeneous points and both first derivatives, shape (n, 4) each."""
    S, Su, Sv = np.zeros((len(uv), 4)), np.zeros((len(uv), 4)), np.zeros((len(uv), 4))
    N, dN, M, dM = np.empty(p + 1), np.empty(p + 1), np.empty(q + 1), np.empty(q + 1)
    for k in range(len(uv)):
        row = _basis(knots_u, p, uv[k, 0], N, dN)
        column = _basis(knots_v, q, uv[k, 1], M, dM)
        for i in range(p + 1):
            for j in range(q + 1):
                for axis in range(4):
                    value = control[row + i, column + j, axis]
                    S[k, axis] += N[i] * M[j] * value
                    Su[k, axis] += dN[i] * M[j] * value
                    Sv[k, axis] += N[i] * dM[j] * value
    return S, Su, Sv


@nb.njit(cache=True, nogil=True)
def _basis(knots: Array, degree: int, at: float, values: Array, slopes: Array) -> int:
    """Values and derivatives of the p + 1 basis functions that are not 0; the first one's control point."""
    last = len(knots) - degree - 2
    span = max(degree, min(last, int(np.searchsorted(knots, at, side="right")) - 1))
    values[0] = 1.0
    for p in range(1, degree + 1):
        if p == degree:
            slopes[:] = 0.0
            for i in range(degree):
                share = degree * values[i] / (knots[span + 1 + i] - knots[span - degree + 1 + i])
                slopes[i] -= share
                slopes[i + 1] += share
        kept = 0.0
        for i in range(p):
            left, right = knots[span - p + 1 + i], knots[span + 1 + i]
            share = values[i] / (right - left)
            values[i] = kept + (right - at) * share
            kept = (at - left) * share
        values[p] = kept
    return span - degree


def _border(axis: int, end: float) -> Array:
    """Parameters along one end of an axis."""
    uv = np.full((17, 2), end)
    uv[:, 1 - axis] = np.linspace(0.0, 1.0, 17)
    return uv
