"""Exact signs: predicates on points of an integer lattice.

Coordinates are integers within ±2^29, so that differences have 31 bits, products of two of them fit in 64, and
every determinant here is a sum of three products of two 62-bit numbers. A float filter answers nearly always;
what it leaves is added up in limbs of 31 bits. No answer is ever rounded.

A slab compares points of two layers, where ties are the rule (two equal layers tie everywhere). They are broken by
moving the upper layer by an infinitesimal (δ, δ²) against the lower: one and the same move for all of a slab,
which keeps all answers consistent and gives equal layers the plain prisms between them.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

LATTICE_BITS = 29
"""Coordinates lie within ±2^29 lattice units."""


class Diagram(NamedTuple):
    """A Delaunay triangulation and its dual, the Voronoi diagram, n points and m triangles.

    Attributes:
        P: points in lattice units, shape (n, 2).
        following: the next point on the curve, or the point itself, shape (n,).
        triangles: corners, turning left, shape (m, 3); the last is -1 beyond a hull edge.
        across: the triangles opposite to the corners, shape (m, 3).
        at: a triangle of each point, shape (n,).
        inside: whether a triangle lies in the region, shape (m,).
        inner: the triangles inside, shape (k,).
        centers, bounds: of the triangles, see `circumcenters`.
    """

    P: Indices
    following: Indices
    triangles: Indices
    across: Indices
    at: Indices
    inside: npt.NDArray[np.bool_]
    inner: Indices
    centers: Array
    bounds: Array


_LOW = 2147483647
_ROUND_OFF = 2.0**-53


@nb.njit(cache=True, nogil=True)
def _limbs(a: int, b: int) -> tuple[int, int, int]:
    """a b as H 2^62 + M 2^31 + L with 0 <= M, L < 2^31; |a|, |b| <= 2^62, one of them <= 2^61."""
    a_high, a_low = a >> 31, a & _LOW
    b_high, b_low = b >> 31, b & _LOW
    low = a_low * b_low
    middle = a_high * b_low + a_low * b_high + (low >> 31)
    return a_high * b_high + (middle >> 31), middle & _LOW, low & _LOW


@nb.njit(cache=True, nogil=True)
def sign_of_sum(a0: int, b0: int, a1: int, b1: int, a2: int, b2: int) -> int:
    """Sign of a0 b0 + a1 b1 + a2 b2."""
    p, q, r = float(a0) * float(b0), float(a1) * float(b1), float(a2) * float(b2)
    total = p + q + r
    if abs(total) > 8.0 * _ROUND_OFF * (abs(p) + abs(q) + abs(r)):
        return 1 if total > 0.0 else -1
    h0, m0, l0 = _limbs(a0, b0)
    h1, m1, l1 = _limbs(a1, b1)
    h2, m2, l2 = _limbs(a2, b2)
    low = l0 + l1 + l2
    middle = m0 + m1 + m2 + (low >> 31)
    high = h0 + h1 + h2 + (middle >> 31)
    if high < 0:
        return -1
    return 1 if high > 0 or (middle & _LOW) or (low & _LOW) else 0


@nb.njit(cache=True, nogil=True)
def turn(P: Indices, a: int, b: int, c: int) -> int:
    """Twice the signed area of a triangle of points: above 0 if it turns left."""
    return int((P[b, 0] - P[a, 0]) * (P[c, 1] - P[a, 1]) - (P[b, 1] - P[a, 1]) * (P[c, 0] - P[a, 0]))


@nb.njit(cache=True, nogil=True)
def in_circle(P: Indices, a: int, b: int, c: int, d: int) -> int:
    """Above 0 if d lies inside the circle through a, b, c, which turn left; 0 on it."""
    ax, ay = P[a, 0] - P[d, 0], P[a, 1] - P[d, 1]
    bx, by = P[b, 0] - P[d, 0], P[b, 1] - P[d, 1]
    cx, cy = P[c, 0] - P[d, 0], P[c, 1] - P[d, 1]
    return sign_of_sum(
        ax * ax + ay * ay,
        bx * cy - by * cx,
        bx * bx + by * by,
        cx * ay - cy * ax,
        cx * cx + cy * cy,
        ax * by - ay * bx,
    )


@nb.njit(cache=True, nogil=True)
def first_sign(x: int, y: int) -> int:
    """Sign of x δ + y δ²: of the first that is not 0."""
    if x != 0:
        return 1 if x > 0 else -1
    return 1 if y > 0 else (-1 if y < 0 else 0)


@nb.njit(cache=True, nogil=True)
def circumcenters(P: Indices, triangles: Indices) -> tuple[Array, Array]:
    """Centres of triangles, shape (m, 2), and bounds of their rounding errors, shape (m,), in lattice units.

    A triangle with corner -1, beyond a hull edge, has its centre at infinity: the bound is infinite.
    """
    m = len(triangles)
    centers = np.zeros((m, 2))
    bounds = np.empty(m)
    for t in range(m):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        if c < 0:
            bounds[t] = np.inf
            continue
        bx, by = P[b, 0] - P[a, 0], P[b, 1] - P[a, 1]
        cx, cy = P[c, 0] - P[a, 0], P[c, 1] - P[a, 1]
        d = 2.0 * float(bx * cy - by * cx)
        bb, cc = float(bx * bx + by * by), float(cx * cx + cy * cy)
        p, q, r, s = cy * bb / d, by * cc / d, bx * cc / d, cx * bb / d
        centers[t, 0] = P[a, 0] + (p - q)
        centers[t, 1] = P[a, 1] + (r - s)
        size = abs(p) + abs(q) + abs(r) + abs(s) + abs(P[a, 0]) + abs(P[a, 1])
        bounds[t] = 16.0 * _ROUND_OFF * size
    return centers, bounds


@nb.njit(cache=True, nogil=True)
def nearer(cx: float, cy: float, bound: float, ux: int, uy: int, vx: int, vy: int) -> int:
    """1 if a centre is nearer to v, -1 if nearer to u, 0 if rounding leaves that open (then ask `nearer_exactly`).

    Takes numbers, not arrays: those would be reference counted at every question.
    """
    dx, dy = vx - ux, vy - uy
    px, py = (2.0 * cx - (ux + vx)) * dx, (2.0 * cy - (uy + vy)) * dy
    value = px + py
    rounding = 4.0 * _ROUND_OFF * (abs(px) + abs(py)) + 2.5 * bound * (abs(dx) + abs(dy))
    if value > rounding:
        return 1
    return -1 if value < -rounding else 0


@nb.njit(cache=True, nogil=True)
def nearer_exactly(
    P: Indices, triangles: Indices, across: Indices, t: int, Q: Indices, u: int, v: int, shift: int
) -> int:
    """Whether the centre of a triangle of layer P lies nearer to point v of layer Q, 1, or to u, -1.

    `shift` is 1 if Q is the upper layer, -1 if P is. The centre of a triangle beyond a hull edge is the point at
    infinity in the direction of its outward normal; where that is parallel to the bisector, its inner neighbour's.
    """
    dx, dy = Q[v, 0] - Q[u, 0], Q[v, 1] - Q[u, 1]
    if triangles[t, 2] < 0:  # outwards is to the left of the hull edge
        a, b = triangles[t, 0], triangles[t, 1]
        ahead = dy * (P[b, 0] - P[a, 0]) - dx * (P[b, 1] - P[a, 1])
        if ahead != 0:
            return 1 if ahead > 0 else -1
        t = across[t, 2]
    a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    bx, by = P[b, 0] - P[a, 0], P[b, 1] - P[a, 1]
    cx, cy = P[c, 0] - P[a, 0], P[c, 1] - P[a, 1]
    ux, uy = Q[u, 0] - P[a, 0], Q[u, 1] - P[a, 1]
    vx, vy = Q[v, 0] - P[a, 0], Q[v, 1] - P[a, 1]
    sign = sign_of_sum(
        bx * bx + by * by, cy * dx - cx * dy,
        cx * cx + cy * cy, bx * dy - by * dx,
        (ux * ux + uy * uy) - (vx * vx + vy * vy), bx * cy - by * cx,
    )  # fmt: skip
    return sign or -shift * first_sign(dx, dy)


@nb.njit(cache=True, nogil=True)
def center_side(P: Indices, triangles: Indices, t: int, Q: Indices, u: int, v: int, shift: int) -> int:
    """Side of the line u -> v of layer Q on which the centre of a triangle of layer P lies: 1 left, -1 right."""
    a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    return _center_sign(
        P[b, 0] - P[a, 0], P[b, 1] - P[a, 1], P[c, 0] - P[a, 0], P[c, 1] - P[a, 1],
        Q[u, 0] - P[a, 0], Q[u, 1] - P[a, 1], Q[v, 0] - Q[u, 0], Q[v, 1] - Q[u, 1], shift,
    )  # fmt: skip


@nb.njit(cache=True, nogil=True)
def _center_sign(bx: int, by: int, cx: int, cy: int, ux: int, uy: int, mx: int, my: int, shift: int) -> int:
    sign = sign_of_sum(
        -(bx * bx + by * by), mx * cx + my * cy,
        cx * cx + cy * cy, mx * bx + my * by,
        2 * (bx * cy - by * cx), my * ux - mx * uy,
    )  # fmt: skip
    return sign or shift * first_sign(my, -mx)


@nb.njit(cache=True, nogil=True)
def crossing_side(P: Indices, a: int, b: int, Q: Indices, u: int, v: int, shift: int) -> int:
    """Side of the line a -> b of layer P on which the bisector of a, b meets that of u, v of layer Q: 1 left, -1 right.

    `shift` is 1 if Q is the upper layer, -1 if P is.
    """
    ex, ey = P[b, 0] - P[a, 0], P[b, 1] - P[a, 1]
    gx, gy = Q[v, 0] - Q[u, 0], Q[v, 1] - Q[u, 1]
    ux, uy = Q[u, 0] - P[a, 0], Q[u, 1] - P[a, 1]
    vx, vy = Q[v, 0] - P[a, 0], Q[v, 1] - P[a, 1]
    ahead = (vx * vx + vy * vy) - (ux * ux + uy * uy) - (ex * gx + ey * gy)
    if ahead == 0:
        ahead = shift * first_sign(gx, gy)
    return 1 if (ahead > 0) == (ex * gy - ey * gx > 0) else -1
