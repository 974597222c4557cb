"""Thinning: a curve by some of its points, and what is done to these carried over to all the others.

What works point by point does the same to a curve however finely it is sampled if it is done to points that are
equally far apart.
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

from twins.toolpath import Curve

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


def thinned(curve: Curve, longest: float, kept: Flags) -> Indices:
    """Points of a curve, by index, as few as there may be to be no further apart than `longest` along it, mm.

    Those to keep are among them, shape (n,), and so are the first and, of an open curve, the last, and the ends of
    segments that are longer. Of a closed curve at least three are left.
    """
    place = _place(curve)
    stops = kept.copy()
    stops[0] = True
    stops[-1] |= not curve.closed
    found = _picked(place, stops, longest * (1.0 + 1e-9))
    return found if len(found) >= (3 if curve.closed else 2) else np.arange(len(stops))


def carried_over(curve: Curve, found: Indices, gone: Array) -> Array:
    """How far all points of a curve go, shape (n, 2), where those `found` go as in `gone`; linear along it."""
    place = _place(curve)
    at, way = place[found], gone
    if curve.closed:
        at, way = np.append(at, place[-1]), np.vstack([gone, gone[:1]])
    n = len(curve.points)
    return np.column_stack([np.interp(place[:n], at, way[:, axis]) for axis in range(2)])


def _place(curve: Curve) -> Array:
    """How far along it each point lies, mm; of a closed curve also where it is back at the first."""
    points = np.vstack([curve.points, curve.points[:1]]) if curve.closed else curve.points
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


@nb.njit(cache=True, nogil=True)
def _picked(place: Array, stops: Flags, longest: float) -> Indices:
    """From each point on to the furthest within reach, but past none that stays."""
    n = len(stops)
    found = np.empty(n, np.int64)
    found[0] = 0
    count = 1
    last = 0
    # A place behind the last point is where a closed curve is back at its first one.
    for i in range(1, len(place) - 1):
        if stops[i] or place[i + 1] - place[last] > longest:
            found[count] = last = i
            count += 1
    if len(place) == n:
        found[count] = n - 1
        count += 1
    return found[:count]
