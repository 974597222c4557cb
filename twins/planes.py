"""Plane stacks: where layers are cut and where the nozzle runs (seed paper, Section 2.1).

Parallel, rotary and custom stacks are three ways to make the same list; everything after it is one code.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .errors import PlanesError
from .toolpath import Plane

Array = npt.NDArray[np.float64]

PARALLEL = 1e-9
"""Sine of the angle below which two planes count as parallel."""

THINNEST = 1e-3
"""No layer is thinner, mm: as of a toolpath's thickness."""

ROUNDING = 1e-4
"""A height so little above a multiple of the layer thickness, as a share of a layer, takes no layer more: single
precision alone adds 1e-5 mm to heights of 300 mm.
"""

MOST = 20_000
"""Layers of a stack: more are a mistake in a unit."""


@dataclass(frozen=True, eq=False)
class Axis:
    """The line in which all planes of a rotary stack meet.

    Attributes:
        point: shape (3,), mm.
        direction: unit vector, shape (3,).
        radius: distance from the axis to the bed's origin, mm.
    """

    point: Array
    direction: Array
    radius: float


@dataclass(frozen=True, eq=False)
class PlaneStack:
    """Planes of a toolpath, from the bed up.

    Attributes:
        base: the bed.
        slicing, nozzle: one plane a layer: the middle of the layer and its top.
        thickness: nominal layer thickness t', mm.
        axis: of a rotary stack, otherwise None.
    """

    base: Plane
    slicing: tuple[Plane, ...]
    nozzle: tuple[Plane, ...]
    thickness: float
    axis: Axis | None = None

    def __post_init__(self) -> None:
        if not self.slicing or len(self.slicing) != len(self.nozzle):
            raise PlanesError(
                f"a plane stack needs as many slicing planes as nozzle planes and at least one, "
                f"not {len(self.slicing)} and {len(self.nozzle)}"
            )

    def __len__(self) -> int:
        return len(self.slicing)


def layer_planes(bed: Plane, top: Plane | float, thickness: float) -> PlaneStack:
    """Equally spaced layers between a bed plane and a top plane.

    The thickness is adjusted to the height: t' = h / n with n = ceil(h / t), where h is rounded down to whole layers
    if it is less than 1e-4 of a layer above them. Where bed and top are not parallel,
    the bed plane rotates to the top plane about the line in which they meet, and h is the arc that the bed's
    origin travels (seed paper, Section 2.1).

    Args:
        bed: plane of the bed; its origin is where the thickness is nominal.
        top: a height above the bed in mm, or a plane whose normal is within 90° of the bed's.
        thickness: wanted layer thickness t at the bed's origin, mm.

    Raises:
        PlanesError: the thickness is none, or makes too many layers, the top is not above the bed, or the planes meet
            too near the bed's origin.
    """
    if not thickness >= THINNEST or not math.isfinite(thickness):
        raise PlanesError(
            f"the layer thickness must be at least {THINNEST:g} mm, not {thickness}; lengths are in mm"
        )
    way = way_up(bed, top)
    if way.axis is not None and way.height < thickness:
        raise PlanesError(
            f"the bed and the top plane meet {way.axis.radius:.6g} mm from the bed's origin, too near for a layer of "
            f"{thickness:.6g} mm; move the top plane up, or tilt it less"
        )
    count = layer_count(way.height, thickness)
    step = way.height / count
    return PlaneStack(
        base=bed,
        slicing=tuple(way.at((k + 0.5) * step) for k in range(count)),
        nozzle=tuple(way.at((k + 1.0) * step) for k in range(count)),
        thickness=step,
        axis=way.axis,
    )


@dataclass(frozen=True, eq=False)
class Way:
    """How a bed plane gets to a top plane.

    Attributes:
        bed: where it starts.
        height: of parallel planes their distance, of others the arc that the bed's origin travels, mm.
        axis: that it turns about; None where it is raised.
    """

    bed: Plane
    height: float
    axis: Axis | None = None

    def at(self, height: float) -> Plane:
        """The plane that the bed has become where its origin has travelled so far, mm."""
        bed, axis = self.bed, self.axis
        if axis is None:
            return Plane(bed.origin + height * bed.normal, bed.x_axis, bed.y_axis)
        R = _rotation(axis.direction, height / axis.radius)
        return Plane(axis.point + R @ (bed.origin - axis.point), R @ bed.x_axis, R @ bed.y_axis)


def way_up(bed: Plane, top: Plane | float) -> Way:
    """The way from a bed to a top plane, or to a height.

    Raises:
        PlanesError: the top is not above the bed, its normal is 90° or more from the bed's, or the two meet at the
            bed's origin.
    """
    if isinstance(top, Plane):
        if float(bed.normal @ top.normal) <= 0.0:
            angle = math.degrees(math.acos(max(-1.0, float(bed.normal @ top.normal))))
            raise PlanesError(
                f"the top plane's normal is {angle:.1f}° from the bed's; turn the top plane so that it is below 90°"
            )
        if float(np.linalg.norm(np.cross(bed.normal, top.normal))) > PARALLEL:
            return _rotary(bed, top)
        height = float(bed.height_of(top.origin[None])[0])
    else:
        height = float(top)
    if not height > 0 or not math.isfinite(height):
        raise PlanesError(f"the top plane must lie above the bed, not at a height of {height:.6g} mm")
    return Way(bed, height)


def layer_count(height: float, thickness: float) -> int:
    """n = ceil(h / t), not one more where h is a multiple of t but for rounding, such as that of a file.

    Raises:
        PlanesError: more than `MOST`.
    """
    count = height / thickness - ROUNDING
    if not count <= MOST:
        raise PlanesError(
            f"a height of {height:.6g} mm would take {count:.3g} layers of {thickness:.6g} mm, more than {MOST:,}; "
            "check their units: lengths are in mm"
        )
    return max(1, math.ceil(count))


def custom_planes(
    base: Plane, slicing: Sequence[Plane], nozzle: Sequence[Plane], reach: float = 0.0
) -> PlaneStack:
    """A stack from any planes; its thickness is the mean distance of nozzle planes at their origins.

    Args:
        base: the bed.
        slicing, nozzle: one plane a layer: its middle and its top.
        reach: how far from the planes' origins the part extends, mm. Planes that are not parallel meet somewhere: no
            nozzle plane may meet the one before it so near.

    Raises:
        PlanesError: the lists differ in length or are empty, or a nozzle plane is not above the one before it, or
            faces the other way.
    """
    if not 0.0 <= reach < math.inf:
        raise PlanesError(f"the reach of a part must be at least 0 mm, not {reach}")
    floors = [base, *nozzle]
    gaps = []
    for k, (below, above) in enumerate(zip(floors, nozzle, strict=False)):
        gap = float(below.height_of(above.origin[None])[0])
        cosine = float(below.normal @ above.normal)
        if cosine <= 0.0:
            raise PlanesError(
                f"nozzle plane {k} is tilted by 90° or more against the plane before it; let all planes face upwards"
            )
        # Seen from both origins: one alone may lie beyond the line where the planes meet.
        lowest = min(gap, -float(above.height_of(below.origin[None])[0]))
        if lowest <= 0.0:
            raise PlanesError(
                f"nozzle plane {k} is {-lowest:.6g} mm below the plane before it; order the planes upwards"
            )
        sine = float(np.linalg.norm(np.cross(below.normal, above.normal)))
        if sine > PARALLEL and lowest <= reach * sine:
            raise PlanesError(
                f"nozzle plane {k} meets the plane before it {lowest / sine:.6g} mm from their origins, within the "
                f"part's reach of {reach:.6g} mm; tilt it less, or move it up"
            )
        gaps.append(gap)
    return PlaneStack(base, tuple(slicing), tuple(nozzle), float(np.mean(gaps)) if gaps else 0.0)


def _rotary(bed: Plane, top: Plane) -> Way:
    direction = np.cross(bed.normal, top.normal)
    sine = float(np.linalg.norm(direction))
    direction = direction / sine
    angle = math.atan2(sine, float(bed.normal @ top.normal))
    # The point of both planes that is nearest to the bed's origin: along the bed, across the axis.
    across = np.cross(direction, bed.normal)
    distance = float(top.normal @ (top.origin - bed.origin)) / float(top.normal @ across)
    point = bed.origin + distance * across
    radius = abs(distance)
    lift = float(np.cross(direction, bed.origin - point) @ bed.normal)
    if lift < 0:
        raise PlanesError(
            f"the top plane is below the bed at the bed's origin: they meet {radius:.6g} mm from it and the top plane "
            "falls from there; move the top plane up, or tilt it the other way"
        )
    if radius * angle < THINNEST:
        raise PlanesError(
            "the bed and the top plane meet at the bed's origin; move the top plane up, or the bed's origin to the part"
        )
    return Way(bed, radius * angle, Axis(point, direction, radius))


def _rotation(direction: Array, angle: float) -> Array:
    """Rotation by `angle` about a unit vector (Rodrigues), shape (3, 3)."""
    x, y, z = direction
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * (K @ K), dtype=np.float64)
