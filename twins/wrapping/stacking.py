"""Stacking: sections in any order become layers from the bottom up, parallel, rotary or freely tilted.

What the sections have in common makes their planes surer: where all points fit parallel planes, or planes through
one axis, those are taken. Sections that cross in the part, or that are too near to tell apart, are refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt

from twins.errors import PlanesError

from .section_planes import Section, fit_plane

Array = npt.NDArray[np.float64]
Kind = Literal["parallel", "rotary", "custom"]

UPRIGHT = 1e-3
"""Sine of the angle between a section and `up` below which neither of its sides is the upper one."""

APART = 4.0
"""Sections are told apart if they are more than this many tolerances from one another."""

FARTHEST = 1e9
"""An axis beyond this is one of parallel planes, mm."""


@dataclass(frozen=True, eq=False)
class Stack:
    """Sections from the bottom up, their normals upwards.

    Attributes:
        kind: whether planes are parallel, share an axis, or neither.
        sections: at least one.
    """

    kind: Kind
    sections: tuple[Section, ...]


def stack(
    sections: Sequence[Section], curves: Sequence[Array], up: Array, tolerance: float, middle: Array
) -> Stack:
    """Order sections along `up`.

    Args:
        sections: see `find_sections`.
        curves: points of all curves, each shape (n, 3), mm.
        up: unit vector, shape (3,).
        tolerance: how far a point may lie off its plane, mm.
        middle: the world's place of the points' origin, shape (3,), mm, for messages.

    Raises:
        PlanesError: a section is parallel to `up`, two sections cross in the part, or are too near to tell apart.
    """
    points = [np.concatenate([curves[i] for i in section.members]) for section in sections]
    centres = np.array([p.mean(axis=0) for p in points])  # these lie in the planes
    kind: Kind = "parallel"
    planes = _parallel(points, tolerance)
    axis: Array | None = None
    sense: Array | None = None
    if planes is None:
        kind = "rotary"
        fan = _fan(sections, points, tolerance)
        if fan is None:
            kind = "custom"
            planes = np.array([[*s.normal, s.offset] for s in sections])
        else:
            planes, axis, place = fan
            sense = np.cross(axis, centres - place)
    upward = planes[:, :3] @ up
    if axis is None or sense is None:
        lying = np.abs(upward)
        sign = np.where(upward < 0.0, -1.0, 1.0)
    else:
        # Round an axis the upper side is known for all planes from one: a fan may turn beyond 90°.
        sign = np.where(np.einsum("ij,ij->i", planes[:, :3], sense) < 0.0, -1.0, 1.0)
        total = float((sign * upward).mean())
        lying = np.full(len(planes), abs(total))
        if total < 0.0:
            sign, axis = -sign, -axis
    k = int(lying.argmin())
    if lying[k] <= UPRIGHT:
        raise PlanesError(
            f"the plane of curve {sections[k].members[0]} is parallel to up = {np.round(up, 6).tolist()}, so neither "
            "of its sides is the upper one; give `up` in the direction in which the layers follow one another"
        )
    planes = sign[:, None] * planes
    order = np.argsort(_ranks(planes, centres, axis), kind="stable")
    ordered = tuple(
        Section(planes[k, :3].copy(), float(planes[k, 3]), sections[k].members) for k in order.tolist()
    )
    _check_order(ordered, [points[k] for k in order.tolist()], tolerance, middle)
    return Stack(kind, ordered)


def _parallel(points: Sequence[Array], tolerance: float) -> Array | None:
    """Rows of normal and offset with one normal that fits all sections, or None."""
    means = np.array([p.mean(axis=0) for p in points])
    apart = [p - mean for p, mean in zip(points, means, strict=True)]
    normal = fit_plane(np.concatenate(apart)).normal
    heights = [a @ normal for a in apart]
    if max(float(np.abs(h).max()) for h in heights) > tolerance:
        return None
    return np.column_stack([np.tile(normal, (len(points), 1)), means @ normal])


def _fan(
    sections: Sequence[Section], points: Sequence[Array], tolerance: float
) -> tuple[Array, Array, Array] | None:
    """Rows of normal and offset of planes through one axis, the axis' direction and a point of it, or None."""
    normals = np.array([s.normal for s in sections])
    offsets = np.array([s.offset for s in sections])
    # The wider a section, the surer its normal.
    weights = np.array([fit_plane(p).width for p in points])[:, None]
    across = np.linalg.svd(weights * normals, full_matrices=True)[2]
    axis, plane = across[2], across[:2]
    try:
        place, *_ = np.linalg.lstsq(weights * (normals @ plane.T), weights[:, 0] * offsets, rcond=1e-14)
    except np.linalg.LinAlgError:
        return None
    if not np.linalg.norm(place) < FARTHEST:
        return None
    rows = []
    for p in points:
        # Through the axis, nearest to the points.
        apart = p @ plane.T - place
        normal = np.linalg.svd(apart, full_matrices=False)[2][1]
        if np.abs(apart @ normal).max() > tolerance:
            return None
        rows.append([*(normal @ plane), float(normal @ place)])
    return np.array(rows), np.asarray(axis, dtype=np.float64), np.asarray(place @ plane, dtype=np.float64)


def _ranks(planes: Array, centres: Array, axis: Array | None) -> Array:
    """How far up each section is among the others; parallel ones come out in the order of their offsets."""
    if axis is not None:
        return _turns(planes[:, :3], axis)
    # A section is above another one if its middle is above the other's plane more than the other's above its own.
    height = centres @ planes[:, :3].T - planes[:, 3]
    return np.asarray((height > height.T).sum(axis=1), dtype=np.float64)


def _turns(normals: Array, axis: Array) -> Array:
    """Angle of each normal about the axis of a fan, from the one after the widest gap, rad."""
    u = normals[0]
    v = np.cross(axis, u)
    angle = np.arctan2(normals @ v, normals @ u)
    order = np.sort(angle)
    gaps = np.diff(np.append(order, order[0] + 2.0 * np.pi))
    start = order[(int(gaps.argmax()) + 1) % len(order)]
    return np.asarray(np.mod(angle - start + 1e-12, 2.0 * np.pi), dtype=np.float64)


def _check_order(
    sections: Sequence[Section], points: Sequence[Array], tolerance: float, middle: Array
) -> None:
    for k, (lower, upper) in enumerate(pairwise(sections)):
        above = points[k + 1] @ lower.normal - lower.offset
        below = upper.offset - points[k] @ upper.normal
        gaps = np.concatenate([above, below])
        least = float(gaps.min())
        if least > APART * tolerance:
            continue
        names = f"curve {lower.members[0]} and curve {upper.members[0]}"
        if float(np.abs(gaps).max()) <= 10.0 * APART * tolerance:
            raise PlanesError(
                f"the planes of {names} are only {float(np.abs(gaps).max()):.3g} mm apart, too near to be told apart "
                f"or counted as one with a tolerance of {tolerance:.3g} mm; give another `tolerance`, or move them"
            )
        x, y, z = middle + np.concatenate([points[k + 1], points[k]])[int(gaps.argmin())]
        raise PlanesError(
            f"the planes of {names} cross or meet inside the part, at ({x:.3f}, {y:.3f}, {z:.3f}); draw sections that "
            "meet only outside the part, or wrap the curves in pieces"
        )
