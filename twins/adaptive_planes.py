"""Adaptive planes: thin layers where the surface leans, thick ones where it is steep (after Dolenc and Mäkelä 1994:
Slicing procedures for layered manufacturing techniques).

A layer of local thickness t leaves steps of height c = t |n · b| on a face with normal n, where b is the direction in
which the layers rise there: t follows from the step that is wanted. Thicknesses are whole numbers of a small unit, and
of all stacks that keep the steps, the bounds and the ratio of neighbours, one with the fewest layers is found by
dynamic programming over height and last thickness. A greedy choice from below can not do that: it runs into places
from which no thickness within the ratio leads on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numba as nb
import numpy as np
import numpy.typing as npt
import trimesh

from .errors import PlanesError
from .planes import Axis, PlaneStack, Way, layer_count, way_up
from .toolpath import Plane

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

RATIO = 1.25
"""Largest ratio of the thicknesses of neighbouring layers: pumps follow a change of flow slowly."""

_STATES = 12_000_000  # heights x thicknesses that are looked at
_COARSEST = 12  # units in the thinnest layer, at least
_MOST_STATES = 100_000_000
_NEVER = 1 << 28


@dataclass(frozen=True, eq=False)
class _Bounds:
    """Of each unit of height: thickness that a layer there must have at least and at most, and that its steps want."""

    least: Array
    most: Array
    wanted: Array


def adaptive_planes(
    surface: trimesh.Trimesh,
    bed: Plane,
    top: Plane | float,
    thinnest: float,
    thickest: float,
    cusp: float,
    ratio: float = RATIO,
) -> PlaneStack:
    """Layers between a bed and a top plane, each as thick as the surface's slope allows.

    Steps of the surface stay below `cusp` wherever layers of the thinnest do not exceed it themselves; level faces
    between bed and top always do. Where layers fan out, thickness is measured at each place of the part, and the
    stack's own is that at the bed's origin, as of `layer_planes`.

    Args:
        surface: what is to be sliced, mm; its heights beyond bed and top do not count.
        bed, top: as of `layer_planes`.
        thinnest, thickest: bounds of the local layer height, everywhere in the part, mm.
        cusp: wanted height of steps, square to the surface, mm.
        ratio: neighbouring layers differ at most by this factor.

    Returns:
        the stack with the fewest layers, to a small unit of height; its thickness is the mean.

    Raises:
        PlanesError: the bounds are none, the planes do not suit (see `layer_planes`), no thickness keeps the local
            height within the bounds somewhere, or no stack of such layers ends at the top.
    """
    if not 0.0 < thinnest <= thickest or not math.isfinite(thickest):
        raise PlanesError(
            f"layer heights must run from above 0 mm to no less, not from {thinnest} to {thickest} mm"
        )
    if not cusp > 0.0 or not ratio >= 1.0:
        raise PlanesError(
            f"steps must be above 0 mm and the ratio of neighbours at least 1, not {cusp} mm and {ratio}"
        )
    way = way_up(bed, top, thinnest)
    units = _units(way.height, thinnest, thickest)
    unit = way.height / units
    bounds = _bounds(surface, bed, way, units, (thinnest, thickest), cusp)
    steps = _fewest(bounds, unit, ratio)
    if steps is None:
        raise PlanesError(
            f"no layers of {thinnest:.6g} to {thickest:.6g} mm whose neighbours differ by a factor of at most "
            f"{ratio:.6g} sum to the height of {way.height:.6g} mm; allow a wider range or ratio, or move the top plane"
        )
    levels = np.concatenate([[0], np.cumsum(steps)]) * unit
    return PlaneStack(
        base=bed,
        slicing=tuple(way.at(bed, float(0.5 * (a + b))) for a, b in pairwise(levels)),
        nozzle=tuple(way.at(bed, float(level)) for level in levels[1:]),
        thickness=way.height / len(steps),
        axis=way.axis,
    )


def _units(height: float, thinnest: float, thickest: float) -> int:
    """Units of height: as many as fit the work, and a multiple of the fewest layers, so that those can be equal."""
    fewest = layer_count(height, thickest)
    fine = math.sqrt(height * max(thickest, 4.0 * (thickest - thinnest)) / _STATES)
    unit = min(fine, thinnest / _COARSEST)
    if height * (thickest - thinnest) > _MOST_STATES * unit**2:
        raise PlanesError(
            f"layers of {thinnest:.6g} to {thickest:.6g} mm are too wide a range over {height:.6g} mm; "
            "make the thinnest layer thicker, or the thickest thinner"
        )
    return fewest * math.ceil(height / unit / fewest)


def _bounds(
    surface: trimesh.Trimesh, bed: Plane, way: Way, units: int, allowed: tuple[float, float], cusp: float
) -> _Bounds:
    thinnest, thickest = allowed
    vertices, faces = np.asarray(surface.vertices, dtype=np.float64), np.asarray(surface.faces)
    if way.axis is not None and len(faces):
        # A face must not reach over more heights and radii than those at which layers are compared with it.
        edge = max(2.0 * thinnest, float(np.ptp(vertices, axis=0).max()) / 100.0)
        vertices, faces = trimesh.remesh.subdivide_to_size(vertices, faces, edge, max_iter=20)  # type: ignore[no-untyped-call]
    corners = vertices[faces]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(doubled, axis=1)
    corners, normals = corners[area > 0.0], doubled[area > 0.0] / area[area > 0.0, None]
    if way.axis is None:
        heights = np.einsum("ijk,k->ij", corners - bed.origin, bed.normal)
        slope, near, far = np.abs(normals @ bed.normal), np.ones(len(corners)), np.ones(len(corners))
    else:
        heights, slope, near, far = _about(corners, normals, bed, way.axis)
    unit = way.height / units
    low, high = heights.min(axis=1) / unit, heights.max(axis=1) / unit
    first, last = np.floor(low + 1e-6), np.ceil(high - 1e-6) - 1
    # A level face is of the layers below and above it; where it lies in the bed or the top plane it has no steps.
    level = last < first
    first = np.where(level, first - 1, first)
    slope = np.where(level & ((np.abs(low) < 1e-6) | (np.abs(high - units) < 1e-6)), 0.0, slope)
    last = np.where(level, first + 1, last)
    met = (first < units) & (last >= 0)
    first, last = (np.clip(of[met], 0, units - 1).astype(np.int64) for of in (first, last))
    least = np.full(int(met.sum()), thinnest)
    if way.axis is not None:
        # Of the angle between two planes the sine is the height.
        radius = way.axis.radius
        least = radius * np.arcsin(np.minimum(thinnest / (near[met] * radius), 1.0))
    with np.errstate(divide="ignore"):
        wanted = _least_over(first, last, cusp / slope[met], units)
    needed = -_least_over(first, last, -least, units)
    most = _least_over(first, last, thickest / far[met], units)
    _refuse_narrow(needed, most, unit, allowed)
    empty = np.isinf(most)
    return _Bounds(np.where(empty, thinnest, needed), np.where(empty, thickest, most), wanted)


def _about(corners: Array, normals: Array, bed: Plane, axis: Axis) -> tuple[Array, Array, Array, Array]:
    """Of triangles around an axis: heights of their corners as arcs at the bed's origin, shape (n, 3), mm; and as
    shares of what holds there the largest step, the least distance from the axis and the largest, shape (n,) each.
    """
    outward = (bed.origin - axis.point) / axis.radius
    forward = np.cross(axis.direction, outward)
    arms = corners - axis.point
    x, y = arms @ outward, arms @ forward
    heights = axis.radius * np.arctan2(y, x)
    # The way that a point takes is the axis x its arm: as long as its distance, and linear over a face.
    slope = np.abs(np.einsum("ijk,ik->ij", np.cross(axis.direction, arms), normals)).max(axis=1)
    near = np.full(len(corners), np.inf)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        along = np.column_stack([x[:, j] - x[:, i], y[:, j] - y[:, i]])
        length = (along**2).sum(axis=1)
        share = -(x[:, i] * along[:, 0] + y[:, i] * along[:, 1]) / np.where(length > 0.0, length, 1.0)
        share = np.clip(share, 0.0, 1.0)
        near = np.minimum(near, np.hypot(x[:, i] + share * along[:, 0], y[:, i] + share * along[:, 1]))
    far = np.hypot(x, y).max(axis=1)
    r = axis.radius
    return heights, slope / r, np.maximum(near, 1e-9 * r) / r, far / r


def _least_over(first: Counts, last: Counts, values: Array, units: int) -> Array:
    """For each of the units the least of the values whose range first ... last holds it; infinite where none does."""
    depth = max(1, units.bit_length())
    table = np.full((depth, units), np.inf)
    # Two blocks of a power of two cover a range; from large to small, blocks hand on what holds for them.
    k = np.frexp(last - first + 1.0)[1].astype(np.int64) - 1
    np.minimum.at(table, (k, first), values)
    np.minimum.at(table, (k, last - (1 << k) + 1), values)
    for j in range(depth - 1, 0, -1):
        half = 1 << (j - 1)
        table[j - 1] = np.minimum(table[j - 1], table[j])
        table[j - 1, half:] = np.minimum(table[j - 1, half:], table[j, :-half])
    return np.asarray(table[0], dtype=np.float64)


def _refuse_narrow(needed: Array, most: Array, unit: float, allowed: tuple[float, float]) -> None:
    """Refuse heights at which the part is too wide for any thickness."""
    narrow = np.flatnonzero(needed > most * (1.0 + 1e-9))
    if len(narrow):
        at = narrow[0]
        raise PlanesError(
            f"{at * unit:.6g} mm above the bed, a layer must be {needed[at]:.6g} mm thick at the bed's origin so that "
            f"it is nowhere below {allowed[0]:.6g} mm, and at most {most[at]:.6g} mm so that it is nowhere above "
            f"{allowed[1]:.6g} mm: the part reaches over too wide a range of distances from the axis there; allow a "
            "wider range, tilt the top plane less, or slice the part in pieces"
        )


def _fewest(bounds: _Bounds, unit: float, ratio: float) -> Counts | None:
    """Thicknesses of the layers in units, from the bed up, or None where nothing sums to the height."""
    least = np.ceil(bounds.least / unit - 1e-9).astype(np.int64)
    most = np.floor(bounds.most / unit + 1e-9).astype(np.int64)
    wanted = np.floor(np.minimum(bounds.wanted / unit, float(_NEVER)) + 1e-9).astype(np.int64)
    thickest = int(most.max())
    thinnest = max(1, int(least.min()))
    if thickest < thinnest:
        return None
    counts = _counts(least, most, wanted, thinnest, thickest, ratio)
    last = counts[-1]
    if int(last.min()) >= _NEVER:
        return None
    n = int(last.min())
    steps: list[int] = []
    at = len(least)
    thickness = at / n
    for left in range(n, 0, -1):
        # Of all layers that lead on, the one most like the last.
        fits = np.flatnonzero(counts[at] == left) + thinnest
        if steps:
            fits = fits[(fits <= steps[-1] * ratio + 1e-9) & (fits * ratio + 1e-9 >= steps[-1])]
        thickness = int(fits[np.abs(fits - thickness).argmin()])
        steps.append(thickness)
        at -= thickness
    return np.array(steps[::-1], dtype=np.int64)


@nb.njit(cache=True, nogil=True)
def _counts(
    least: Counts, most: Counts, wanted: Counts, thinnest: int, thickest: int, ratio: float
) -> npt.NDArray[np.int32]:
    """The fewest layers up to a height whose last has a thickness, shape (units + 1, thicknesses).

    A layer may have a thickness if that lies between `least` and `most` everywhere in it, and does not exceed what is
    `wanted` anywhere in it, unless it is the least that it may have.
    """
    units, width = len(least), thickest - thinnest + 1
    counts = np.full((units + 1, width), _NEVER, dtype=np.int32)
    before = np.empty(width, dtype=np.int32)
    queue = np.empty(width, dtype=np.int64)
    for at in range(units):
        if at == 0:
            before[:] = 0
        else:
            # Least count over the thicknesses within the ratio: both ends of that window only grow.
            row = counts[at]
            head, tail, reached = 0, 0, 0
            for j in range(width):
                t = thinnest + j
                while reached < width and thinnest + reached <= t * ratio + 1e-9:
                    while tail > head and row[queue[tail - 1]] >= row[reached]:
                        tail -= 1
                    queue[tail] = reached
                    tail += 1
                    reached += 1
                while (thinnest + queue[head]) * ratio + 1e-9 < t:
                    head += 1
                before[j] = row[queue[head]]
        low, high, wish = 0, _NEVER, _NEVER
        for t in range(1, min(thickest, units - at) + 1):
            above = at + t - 1
            low, high, wish = max(low, least[above]), min(high, most[above]), min(wish, wanted[above])
            if t > high:
                break
            j = t - thinnest
            if j >= 0 and t >= low and t <= max(low, wish) and before[j] < _NEVER:
                counts[at + t, j] = min(counts[at + t, j], before[j] + 1)
    return counts
