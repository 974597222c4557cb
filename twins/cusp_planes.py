"""Adaptive planes: thin layers where the surface leans, thick ones where it is steep (after Dolenc and Mäkelä 1994:
Slicing procedures for layered manufacturing techniques).

A layer of local thickness t leaves steps of height c = t |n · b| on a face with normal n, where b is the direction in
which the layers rise there: t follows from the step that is wanted. Which stack then has the fewest layers is searched
in `fewest_layers.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import trimesh

from .entrances import checks_kinds
from .errors import PlanesError
from .fewest_layers import Bounds, fewest_layers
from .planes import THINNEST, Axis, PlaneStack, Way, layer_count, way_up
from .toolpath import Plane

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

RATIO = 1.25
"""Largest ratio of the thicknesses of neighbouring layers: pumps follow a change of flow slowly."""

NEAR = 1e-3
"""How far from bed or top plane a face has no steps, as a share of the thinnest layer: noise of a file."""

_STATES = 3_000_000  # heights x thicknesses that units are chosen for
_COARSEST = 12  # units in the thinnest layer, at least
_MOST_STATES = 200_000_000


@dataclass(frozen=True, eq=False)
class _Faces:
    """The triangles of a surface, as layers see them; n of them.

    Attributes:
        low, high: reach of heights, at the bed's origin, shape (n,), mm.
        slope: step over the thickness of the layer at the bed's origin; 0 where it counts none, shape (n,).
        near, far: least and largest local thickness over that at the bed's origin, shape (n,).
    """

    low: Array
    high: Array
    slope: Array
    near: Array
    far: Array

    def met_by(self, levels: Array) -> tuple[npt.NDArray[np.bool_], Counts, Counts]:
        """Which faces the layers between levels meet, and the first and the last layer of each of those."""
        tiny = 1e-6 * float(np.diff(levels).min())
        first = np.searchsorted(levels, self.low + tiny, "right") - 1
        last = np.searchsorted(levels, self.high - tiny, "left") - 1
        # A level face is of the layers below and above it.
        level = last < first
        first, last = np.where(level, last, first), np.where(level, first, last)
        count = len(levels) - 1
        met = (first < count) & (last >= 0)
        return met, np.clip(first[met], 0, count - 1), np.clip(last[met], 0, count - 1)


@checks_kinds
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

    Steps of the surface stay below `cusp` in every layer that may be so thin. Where that needs layers below
    `thinnest`, they are as near to it as layers that end at the top can be; so between bed and top, level faces always
    have larger steps. Where layers fan out, thickness is measured at each place of the part, and the stack's own is
    that at the bed's origin, as of `layer_planes`: a layer that is at its thinnest near the axis is thicker away from
    it, and its steps there may be larger than `cusp` though the layer is thicker than `thinnest`.

    Args:
        surface: what is to be sliced, mm; its heights beyond bed and top do not count.
        bed, top: as of `layer_planes`.
        thinnest, thickest: bounds of the local layer height, everywhere in the part, mm.
        cusp: wanted height of steps, square to the surface, mm.
        ratio: neighbouring layers differ at most by this factor.

    Returns:
        of the stacks that keep the steps best the one with the fewest layers, to a small unit of height; its thickness
        is the mean.

    Raises:
        PlanesError: the bounds are none, the planes do not suit (see `layer_planes`), no thickness keeps the local
            height within the bounds somewhere, or no stack of such layers ends at the top.
    """
    return adaptive_reporting(surface, bed, top, thinnest, thickest, cusp, ratio)[0]


@checks_kinds
def adaptive_reporting(
    surface: trimesh.Trimesh,
    bed: Plane,
    top: Plane | float,
    thinnest: float,
    thickest: float,
    cusp: float,
    ratio: float = RATIO,
) -> tuple[PlaneStack, list[str]]:
    """`adaptive_planes`, and a sentence on the layers whose steps are larger than wanted, if there are any."""
    if not THINNEST <= thinnest <= thickest or not math.isfinite(thickest):
        raise PlanesError(
            f"layer heights must run from at least {THINNEST:g} mm to no less, not from {thinnest} to {thickest} mm"
        )
    if not cusp > 0.0 or not ratio >= 1.0:
        raise PlanesError(
            f"steps must be above 0 mm and the ratio of neighbours at least 1, not {cusp} mm and {ratio}"
        )
    way = way_up(bed, top)
    faces = _faces(surface, way, thinnest)
    units = _units(way.height, thinnest, thickest)
    unit = way.height / units
    steps = fewest_layers(_bounds(faces, way, units, (thinnest, thickest), cusp), unit, ratio)
    if steps is None:
        raise PlanesError(
            f"no layers of {thinnest:.6g} to {thickest:.6g} mm whose neighbours differ by a factor of at most "
            f"{ratio:.6g} sum to the height of {way.height:.6g} mm; allow a wider range or ratio, or move the top plane"
        )
    levels = np.concatenate([[0], np.cumsum(steps)]) * unit
    stack = PlaneStack(
        base=bed,
        slicing=tuple(way.at(float(0.5 * (a + b))) for a, b in pairwise(levels)),
        nozzle=tuple(way.at(float(level)) for level in levels[1:]),
        thickness=way.height / len(steps),
        axis=way.axis,
    )
    return stack, _said(faces, levels, cusp)


def _said(faces: _Faces, levels: Array, cusp: float) -> list[str]:
    met, first, last = faces.met_by(levels)
    slope = -_least_over(first, last, -faces.slope[met], len(levels) - 1)
    steps = np.where(np.isfinite(slope), slope, 0.0) * np.diff(levels)
    large = np.flatnonzero(steps > cusp * (1.0 + 1e-6))
    if not len(large):
        return []
    worst = int(steps.argmax())
    sentence = (
        f"{len(large)} of {len(steps)} layers leave steps above {cusp:.6g} mm on the part, the largest of "
        f"{steps[worst]:.4g} mm (layer {worst}, {levels[worst]:.4g} to {levels[worst + 1]:.4g} mm above the bed): "
        "their bounds and the height to fill allow no thinner ones there"
    )
    return [sentence]


def _units(height: float, thinnest: float, thickest: float) -> int:
    """Units of height: as many as fit the work, and such that the fewest layers, and the most, can be equal."""
    fewest, most = layer_count(height, thickest), layer_count(height, thinnest)
    fine = math.sqrt(height * max(0.25 * thickest, thickest - thinnest) / _STATES)
    unit = min(fine, thinnest / _COARSEST)
    if height * thickest > _MOST_STATES * unit**2:
        raise PlanesError(
            f"layers of {thinnest:.6g} to {thickest:.6g} mm are too wide a range over {height:.6g} mm; "
            "make the thinnest layer thicker, or the thickest thinner"
        )
    most = max(1, math.floor(height / thinnest + 1e-9))
    # A multiple of the fewest; and of those the next in which as many of the thinnest find room as in the height.
    least = math.ceil(height / unit / fewest)
    some = fewest * np.arange(least, least + max(16, least // 4))
    room = np.floor(some / np.ceil(thinnest * some / height - 1e-9))
    return int(some[np.argmax(np.minimum(room, most))])


def _faces(surface: trimesh.Trimesh, way: Way, thinnest: float) -> _Faces:
    vertices, faces = np.asarray(surface.vertices, dtype=np.float64), np.asarray(surface.faces)
    bed = way.bed
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
    low, high = heights.min(axis=1), heights.max(axis=1)
    # What lies in the bed or the top plane has no steps.
    outer = far * np.minimum(np.abs(heights).max(axis=1), np.abs(heights - way.height).max(axis=1))
    return _Faces(low, high, np.where(outer <= NEAR * thinnest, 0.0, slope), near, far)


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


def _bounds(faces: _Faces, way: Way, units: int, allowed: tuple[float, float], cusp: float) -> Bounds:
    thinnest, thickest = allowed
    met, first, last = faces.met_by(np.linspace(0.0, way.height, units + 1))
    least = np.full(len(first), thinnest)
    if way.axis is not None:
        # Of the angle between two planes the sine is the height.
        radius = way.axis.radius
        least = radius * np.arcsin(np.minimum(thinnest / (faces.near[met] * radius), 1.0))
    with np.errstate(divide="ignore"):
        wanted = _least_over(first, last, cusp / faces.slope[met], units)
    needed = -_least_over(first, last, -least, units)
    most = _least_over(first, last, thickest / faces.far[met], units)
    _refuse_narrow(needed, most, way.height / units, allowed)
    empty = np.isinf(most)
    return Bounds(np.where(empty, thinnest, needed), np.where(empty, thickest, most), wanted)


def _least_over(first: Counts, last: Counts, values: Array, count: int) -> Array:
    """For each of so many places the least of the values whose range first ... last holds it; infinite where none."""
    # Two blocks of a power of two cover a range; from large to small, blocks hand on what holds for them.
    power = np.frexp(last - first + 1.0)[1].astype(np.int64) - 1
    row = np.full(count, np.inf)
    for k in range(int(power.max(initial=0)), -1, -1):
        here = power == k
        np.minimum.at(row, first[here], values[here])
        np.minimum.at(row, last[here] - (1 << k) + 1, values[here])
        if k:
            half = 1 << (k - 1)
            row[half:] = np.minimum(row[half:], row[:-half].copy())
    return row


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
