"""Curved lines as polylines within a chord tolerance.

Lines, arcs, ellipses and splines are all rational Bézier pieces, and an affine map of a piece is the map of its
control points. A piece is halved (de Casteljau) until a bound on its distance from its chord is small enough: with
s = 1 - 2^(1-d) the largest share that the inner control points have in a point of a piece of degree d, the distance is
at most s max |P_i - chord|, weights taken into the share. The bound is exact for parabolas and arcs.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

MOST = 1_000_000
"""Points of one curve beyond which the chord tolerance is taken for a mistake."""

QUARTER = 0.5 * math.pi


def homogeneous(points: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """Control points, shape (n, 3), as (w x, w y, w z, w), shape (n, 4)."""
    places = np.asarray(points, dtype=np.float64)
    w = np.ones(len(places)) if weights is None else np.asarray(weights, dtype=np.float64)
    if w.shape != (len(places),) or not (w > 0).all():
        raise ValueError("its weights are not all above 0")
    return np.column_stack([places * w[:, None], w])


def arc_pieces(centre: Array, u: Array, v: Array, start: float, sweep: float) -> Array:
    """Pieces of centre + u cos a + v sin a for a from start to start + sweep, radians: shape (m, 3, 4).

    u and v, shape (3,), are conjugate radii: of a circle they are at right angles and equally long.
    """
    count = max(1, math.ceil(abs(sweep) / QUARTER - 1e-9))
    step = sweep / count
    ends: Array = np.asarray(start + step * np.arange(count + 1), dtype=np.float64)
    middles: Array = np.asarray(ends[:-1] + 0.5 * step, dtype=np.float64)
    w = math.cos(0.5 * step)

    def on(angles: Array, scale: float) -> Array:
        return np.asarray(
            centre * scale + np.cos(angles)[:, None] * u + np.sin(angles)[:, None] * v, dtype=np.float64
        )

    corners = on(ends, 1.0)
    pieces = np.ones((count, 3, 4))
    pieces[:, 0, :3], pieces[:, 2, :3] = corners[:-1], corners[1:]
    pieces[:, 1, :3], pieces[:, 1, 3] = on(middles, w), w  # w times (centre + (u cos a + v sin a) / w)
    return pieces


def spline_pieces(control: Array, knots: npt.ArrayLike, degree: int) -> Array:
    """Pieces of a B-spline, one for each span of its knots: shape (m, degree + 1, 4).

    Args:
        control: shape (n, 4), from `homogeneous`.
        knots: shape (n + degree + 1,), not falling.
        degree: at least 1.
    """
    t = np.asarray(knots, dtype=np.float64)
    n = len(control)
    if degree < 1 or n < degree + 1 or len(t) != n + degree + 1:
        raise ValueError(f"{n} control points and {len(t)} knots do not make a spline of degree {degree}")
    if not np.isfinite(t).all() or (np.diff(t) < 0).any():
        raise ValueError("its knots fall, or are not finite")
    spans = np.flatnonzero(t[degree:n] < t[degree + 1 : n + 1]) + degree
    if not len(spans):
        raise ValueError("its knots are all the same")
    pieces = np.empty((len(spans), degree + 1, 4))
    for j in range(degree + 1):
        pieces[:, j] = _blossoms(control, t, degree, spans, [spans] * (degree - j) + [spans + 1] * j)
    return pieces


def _blossoms(control: Array, t: Array, degree: int, spans: Indices, at: list[Indices]) -> Array:
    """The polar form of each span (de Boor's recursion with an argument of its own at each level), shape (m, 4).

    Args:
        control, t, degree: of the spline.
        spans: indices of knots where spans begin, shape (m,).
        at: the arguments, indices of knots, each shape (m,).
    """
    d = [control[spans - degree + j] for j in range(degree + 1)]
    for level, knots in enumerate(at, start=1):
        for j in range(degree, level - 1, -1):
            low = t[spans - degree + j]
            share = (t[knots] - low) / (t[spans + j + 1 - level] - low)
            d[j] = (1.0 - share)[:, None] * d[j - 1] + share[:, None] * d[j]
    return d[degree]


def flatten(pieces: Array, chord: float) -> Array:
    """The polyline of pieces that follow one another, shape (m, d + 1, 4), within `chord`: shape (n, 3).

    Pieces of degree 1 stay as they are.

    Raises:
        ValueError: a control point is not finite, or the polyline would have more than `MOST` points.
    """
    return corners_of(flat_pieces(pieces, chord))


def flat_pieces(pieces: Array, chord: float) -> Array:
    """Pieces that follow one another, halved until each lies within `chord` of the straight line between its ends.

    Raises:
        ValueError: as `flatten`.
    """
    if not np.isfinite(pieces).all():
        raise ValueError("it has a control point that is not finite")
    order = np.arange(len(pieces), dtype=np.float64)
    half = 0.5
    orders, found = [], []
    while len(pieces):
        flat = _distances(pieces) <= chord
        orders.append(order[flat])
        found.append(pieces[flat])
        low, high = halves(pieces[~flat])
        if sum(len(part) for part in orders) + 2 * len(low) > MOST:
            raise ValueError(f"it needs more than {MOST} points within {chord:.3g}; give a larger chord")
        order = np.concatenate([order[~flat], order[~flat] + half])
        pieces = np.concatenate([low, high])
        half *= 0.5
    ranks = np.argsort(np.concatenate(orders), kind="stable")
    return np.asarray(np.concatenate(found)[ranks], dtype=np.float64)


def corners_of(pieces: Array) -> Array:
    """The ends of pieces that follow one another, shape (m + 1, 3)."""
    ends = np.vstack([pieces[:, 0], pieces[-1:, -1]])
    return np.asarray(ends[:, :3] / ends[:, 3:], dtype=np.float64)


def _distances(pieces: Array) -> Array:
    """The bound on each piece's distance from its chord, shape (m,)."""
    degree = pieces.shape[1] - 1
    if degree == 1:
        return np.zeros(len(pieces))
    w = pieces[..., 3]
    points = pieces[..., :3] / w[..., None]
    start, along = points[:, :1], points[:, -1:] - points[:, :1]
    inner = points[:, 1:-1] - start
    square = (along * along).sum(axis=-1)
    share = np.clip((inner * along).sum(axis=-1) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    far = np.linalg.norm(inner - share[..., None] * along, axis=-1).max(axis=1)
    inside = (1.0 - 0.5 ** (degree - 1)) * w[:, 1:-1].max(axis=1)
    outside = 0.5 ** (degree - 1) * np.minimum(w[:, 0], w[:, -1])
    return np.asarray(far * inside / (inside + outside), dtype=np.float64)


def halves(pieces: Array) -> tuple[Array, Array]:
    """Both halves of each piece."""
    low, high = np.empty_like(pieces), np.empty_like(pieces)
    rest = pieces
    for k in range(pieces.shape[1]):
        low[:, k], high[:, pieces.shape[1] - 1 - k] = rest[:, 0], rest[:, -1]
        rest = 0.5 * (rest[:, :-1] + rest[:, 1:])
    return low, high
