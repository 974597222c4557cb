"""The toolpath: planar curves in layers (seed paper, Section 2).

A layer has two planes. The *slicing plane* is the middle of the layer, where the surface is cut; the *nozzle
plane* is the top of the bead, where the nozzle runs. A point (u, v) of a curve means the same place in the
frame of either plane, so a curve is carried from one to the other by the rigid motion between the frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from .errors import ToolpathError

Array = npt.NDArray[np.float64]

FAR = 1e6
"""Coordinates beyond this are no part of a cell, mm."""


def read_only(values: npt.ArrayLike, shape: tuple[int | None, ...], what: str) -> Array:
    """A finite, read-only float64 copy of `values` with the given shape (None: any length)."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        wanted = ", ".join("n" if n is None else str(n) for n in shape)
        raise ToolpathError(
            f"{what} must be numbers of shape ({wanted}), each row of the same length"
        ) from None
    if array.ndim != len(shape) or any(
        n is not None and n != m for n, m in zip(shape, array.shape, strict=True)
    ):
        wanted = ", ".join("n" if n is None else str(n) for n in shape)
        raise ToolpathError(f"{what} must have shape ({wanted}), not {array.shape}")
    if not (near := np.abs(array) <= FAR).all():
        at = int(np.argwhere(~near)[0][0])
        raise ToolpathError(f"{what} must be finite and within 1 km; value {at} is {array[at].tolist()}")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Plane:
    """An oriented plane with a frame of its own.

    Attributes:
        origin: shape (3,), mm.
        x_axis, y_axis: shape (3,), made orthonormal; their cross product is the plane's normal.
    """

    origin: Array
    x_axis: Array
    y_axis: Array

    def __post_init__(self) -> None:
        origin = read_only(self.origin, (3,), "a plane's origin")
        x = read_only(self.x_axis, (3,), "a plane's x_axis")
        y = read_only(self.y_axis, (3,), "a plane's y_axis")
        if np.linalg.norm(x) < 1e-12 or np.linalg.norm(np.cross(x, y)) < 1e-9 * np.linalg.norm(
            x
        ) * np.linalg.norm(y):
            raise ToolpathError(f"a plane needs two directions that are not parallel, not {x} and {y}")
        x = x / np.linalg.norm(x)
        y = y - (y @ x) * x
        y = y / np.linalg.norm(y)
        object.__setattr__(self, "origin", origin)
        object.__setattr__(self, "x_axis", read_only(x, (3,), "a plane's x_axis"))
        object.__setattr__(self, "y_axis", read_only(y, (3,), "a plane's y_axis"))

    @classmethod
    def horizontal(cls, height: float = 0.0) -> Plane:
        """The plane z = height, with the world's x and y axes."""
        return cls(np.array([0.0, 0.0, height]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))

    @property
    def normal(self) -> Array:
        """Unit normal, shape (3,)."""
        return np.cross(self.x_axis, self.y_axis)

    @property
    def rotation(self) -> Array:
        """Columns x_axis, y_axis, normal: shape (3, 3)."""
        return np.column_stack([self.x_axis, self.y_axis, self.normal])

    def to_world(self, points: Array) -> Array:
        """Points of the plane's frame, shape (n, 2) or (n, 3), in world coordinates, shape (n, 3)."""
        axes = self.rotation[:, : points.shape[1]]
        return np.asarray(self.origin + points @ axes.T, dtype=np.float64)

    def to_frame(self, points: Array) -> Array:
        """World points, shape (n, 3), in the plane's frame, shape (n, 3); the last column is the height above it."""
        return np.asarray((points - self.origin) @ self.rotation, dtype=np.float64)

    def height_of(self, points: Array) -> Array:
        """Signed distance of world points, shape (n, 3), from the plane: shape (n,), mm."""
        return np.asarray((points - self.origin) @ self.normal, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Curve:
    """A polyline in its layer's plane, interior on the left.

    Attributes:
        points: shape (n, 2), mm; a closed curve does not repeat its first point.
        closed: whether the last point is joined to the first.
        width: bead width at each point, shape (n,), mm, or None where the print settings decide.
    """

    points: Array
    closed: bool = True
    width: Array | None = None

    def __post_init__(self) -> None:
        points = read_only(self.points, (None, 2), "a curve's points")
        if len(points) < (3 if self.closed else 2):
            raise ToolpathError(
                f"a {'closed' if self.closed else 'open'} curve needs at least "
                f"{3 if self.closed else 2} points, not {len(points)}"
            )
        object.__setattr__(self, "points", points)
        if self.width is not None:
            width = read_only(self.width, (len(points),), "a curve's width")
            if (width <= 0).any():
                raise ToolpathError("a curve's width must be above 0 at every point")
            object.__setattr__(self, "width", width)

    @property
    def length(self) -> float:
        """Length in mm."""
        ends = np.vstack([self.points, self.points[:1]]) if self.closed else self.points
        return float(np.linalg.norm(np.diff(ends, axis=0), axis=1).sum())

    @property
    def signed_area(self) -> float:
        """Enclosed area in mm², positive for a counter-clockwise (outer) curve; 0 for an open one."""
        if not self.closed:
            return 0.0
        x, y = self.points.T
        return float(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)))

    @property
    def centroid(self) -> Array:
        """Centroid of the enclosed area, or of the points where the curve encloses none; shape (2,)."""
        x, y = (self.points - self.points.mean(axis=0)).T
        cross = x * np.roll(y, -1) - y * np.roll(x, -1)
        if not self.closed or abs(cross.sum()) < 1e-12:
            return np.asarray(self.points.mean(axis=0), dtype=np.float64)
        moment = np.array([((x + np.roll(x, -1)) * cross).sum(), ((y + np.roll(y, -1)) * cross).sum()])
        return np.asarray(self.points.mean(axis=0) + moment / (3.0 * cross.sum()), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Layer:
    """The curves printed between two nozzle planes.

    Attributes:
        slicing: plane in which the surface is cut; the middle of the layer.
        nozzle: plane in which the nozzle runs; the top of the layer.
        curves: may be none.
    """

    slicing: Plane
    nozzle: Plane
    curves: tuple[Curve, ...] = ()


@dataclass(frozen=True, eq=False)
class Toolpath:
    """Layers of curves above a base plane.

    Attributes:
        base: the plane that the first layer is printed on.
        layers: from the bottom up.
        thickness: nominal layer thickness t', mm.
    """

    base: Plane
    layers: tuple[Layer, ...]
    thickness: float

    def __post_init__(self) -> None:
        if not 1e-3 <= self.thickness <= FAR:
            raise ToolpathError(
                f"a toolpath's thickness must be between 0.001 mm and 1 km, not {self.thickness} mm"
            )

    def curves(self) -> Iterator[tuple[int, int, Layer, Curve]]:
        """Every curve with its layer index, its index in the layer, and its layer."""
        for i, layer in enumerate(self.layers):
            for j, curve in enumerate(layer.curves):
                yield i, j, layer, curve

    def floor_of(self, layer: int) -> Plane:
        """The plane that a layer is printed on: the nozzle plane below it, or the base."""
        return self.base if layer == 0 else self.layers[layer - 1].nozzle

    @property
    def length(self) -> float:
        """Length of all curves, mm."""
        return sum(curve.length for *_, curve in self.curves())

    @property
    def is_rotary(self) -> bool:
        """Whether any two neighbouring nozzle planes are not parallel."""
        planes = [self.base, *(layer.nozzle for layer in self.layers)]
        return any(float(np.linalg.norm(np.cross(a.normal, b.normal))) > 1e-9 for a, b in pairwise(planes))
