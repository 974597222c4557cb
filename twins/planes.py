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

_PARALLEL = 1e-9
"""Sine of the angle below which two planes count as parallel."""


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

    The thickness is adjusted to the height: t' = h / n with n = ceil(h / t). Where bed and top are not parallel,
    the bed plane rotates to the top plane about the line in which they meet, and h is the arc that the bed's
    origin travels (seed paper, Section 2.1).

    Args:
        bed: plane of the bed; its origin is where the thickness is nominal.
        top: a height above the bed in mm, or a plane whose normal is within 90° of the bed's.
        thickness: wanted layer thickness t at the bed's origin, mm.

    Raises:
        PlanesError: the top is not above the bed, or the axis runs through the bed's origin.
    """
    if not thickness > 0 or not math.isfinite(thickness):
        raise PlanesError(f"the layer thickness must be above 0 mm, not {thickness}")
    way = way_up(bed, top, thickness)
    count = layer_count(way.height, thickness)
    step = way.height / count
    if way.axis is None:
        slicing = tuple(raised(bed, (k + 0.5) * step) for k in range(count))
        nozzle = tuple(raised(bed, (k + 1.0) * step) for k in range(count))
    else:
        slicing = tuple(turned(bed, way.axis, way.angle * ((k + 0.5) / count)) for k in range(count))
        nozzle = tuple(turned(bed, way.axis, way.angle * ((k + 1.0) / count)) for k in range(count))
    return PlaneStack(bed, slicing, nozzle, step, way.axis)


@dataclass(frozen=True, eq=False)
class Way:
    """How the bed plane gets to the top plane.

    Attributes:
        height: of parallel planes their distance, of others the arc that the bed's origin travels, mm.
        axis: that it turns about; None where it is raised.
        angle: that it turns by, rad.
    """

    height: float
    axis: Axis | None = None
    angle: float = 0.0

    def at(self, bed: Plane, height: float) -> Plane:
        """The plane that the bed has become where its origin has travelled so far, mm."""
        return raised(bed, height) if self.axis is None else turned(bed, self.axis, height / self.axis.radius)


def way_up(bed: Plane, top: Plane | float, thickness: float) -> Way:
    """The way from a bed to a top plane, or to a height, that layers of a thickness fit into.

    Raises:
        PlanesError: as of `layer_planes`.
    """
    if isinstance(top, Plane):
        if float(bed.normal @ top.normal) <= 0.0:
            angle = math.degrees(math.acos(max(-1.0, float(bed.normal @ top.normal))))
            raise PlanesError(
                f"the top plane's normal is {angle:.1f}° from the bed's; turn the top plane so that it is below 90°"
            )
        if float(np.linalg.norm(np.cross(bed.normal, top.normal))) > _PARALLEL:
            return _rotary(bed, top, thickness)
        height = float(bed.height_of(top.origin[None])[0])
    else:
        height = float(top)
    if not height > 0 or not math.isfinite(height):
        raise PlanesError(f"the top plane must lie above the bed, not at a height of {height:.6g} mm")
    return Way(height)


def raised(bed: Plane, distance: float) -> Plane:
    """The plane moved along its normal, mm."""
    return Plane(bed.origin + distance * bed.normal, bed.x_axis, bed.y_axis)


def turned(bed: Plane, axis: Axis, angle: float) -> Plane:
    """The plane turned about an axis, rad."""
    R = _rotation(axis.direction, angle)
    return Plane(axis.point + R @ (bed.origin - axis.point), R @ bed.x_axis, R @ bed.y_axis)


def layer_count(height: float, thickness: float) -> int:
    """n = ceil(h / t), not one more where h is a multiple of t but for rounding."""
    return max(1, math.ceil(height / thickness - 1e-9))


def custom_planes(base: Plane, slicing: Sequence[Plane], nozzle: Sequence[Plane]) -> PlaneStack:
    """A stack from any planes; its thickness is the mean distance of nozzle planes at their origins.

    Raises:
        PlanesError: the lists differ in length or are empty, or a nozzle plane is not above the one before it.
    """
    floors = [base, *nozzle]
    gaps = [float(a.height_of(b.origin[None])[0]) for a, b in zip(floors, nozzle, strict=False)]
    for k, gap in enumerate(gaps):
        if gap <= 0:
            raise PlanesError(
                f"nozzle plane {k} is {-gap:.6g} mm below the plane before it; order the planes upwards"
            )
    return PlaneStack(base, tuple(slicing), tuple(nozzle), float(np.mean(gaps)) if gaps else 0.0)


def _rotary(bed: Plane, top: Plane, thickness: float) -> Way:
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
    if radius < thickness / angle:
        raise PlanesError(
            f"the bed and the top plane meet {radius:.6g} mm from the bed's origin, too near for a layer of "
            f"{thickness:.6g} mm; move the top plane up, or tilt it less"
        )
    return Way(radius * angle, Axis(point, direction, radius), angle)


def _rotation(direction: Array, angle: float) -> Array:
    """Rotation by `angle` about a unit vector (Rodrigues), shape (3, 3)."""
    x, y, z = direction
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * (K @ K), dtype=np.float64)
