"""Unwrapping: a toolpath as polylines in space with everything on them that a designer draws with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.toolpath import Plane, Toolpath, read_only

from .space_curve import SpaceCurve

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class UnwrappedCurve:
    """A curve of a toolpath in space.

    Attributes:
        layer, curve: indices of the layer, and of the curve in it.
        points: shape (n, 3), mm, in `plane`; a closed curve does not repeat its first point.
        closed: whether the last point is joined to the first.
        plane: the layer's nozzle or slicing plane.
        tangents: unit vectors along the curve, shape (n, 3); where it turns, halfway between the directions before
            and after.
        heights: local height of the bead: distance of the nozzle from the plane that the layer is printed on,
            shape (n,), mm.
        widths: of the bead, shape (n,), mm, or None where the print settings decide.
    """

    layer: int
    curve: int
    points: Array
    closed: bool
    plane: Plane
    tangents: Array
    heights: Array
    widths: Array | None = None

    def __post_init__(self) -> None:
        n = len(self.points)
        for name, shape in (("points", (None, 3)), ("tangents", (n, 3)), ("heights", (n,))):
            object.__setattr__(
                self, name, read_only(getattr(self, name), shape, f"an unwrapped curve's {name}")
            )

    @property
    def space_curve(self) -> SpaceCurve:
        """Its points, widths and heights alone."""
        return SpaceCurve(self.points, self.closed, self.widths, self.heights)


@checks_kinds
def unwrap(toolpath: Toolpath, at: Literal["nozzle", "slicing"] = "nozzle") -> tuple[UnwrappedCurve, ...]:
    """The curves of a toolpath in space, layer by layer.

    Args:
        toolpath: of any planes.
        at: the planes that they lie in: those of the nozzle, or those where the surface is cut. Heights are those of
            the nozzle either way.

    Raises:
        ToolpathError: `at` is neither.
    """
    if at not in {"nozzle", "slicing"}:
        raise ToolpathError(f'curves are unwrapped at "nozzle" or at "slicing", not at {at!r}')
    unwrapped = []
    for i, j, layer, curve in toolpath.curves():
        plane = layer.nozzle if at == "nozzle" else layer.slicing
        axes = plane.rotation[:, :2]
        unwrapped.append(
            UnwrappedCurve(
                layer=i,
                curve=j,
                points=plane.to_world(curve.points),
                closed=curve.closed,
                plane=plane,
                tangents=_tangents(curve.points, closed=curve.closed) @ axes.T,
                heights=toolpath.floor_of(i).height_of(layer.nozzle.to_world(curve.points)),
                widths=curve.width,
            )
        )
    return tuple(unwrapped)


def _tangents(points: Array, *, closed: bool) -> Array:
    """Unit tangents at the vertices of a polyline, shape (n, 2); points that repeat have that of their place."""
    steps = np.diff(points, axis=0, append=points[:1])
    lengths = np.linalg.norm(steps, axis=1)
    n = len(points)
    moving = np.flatnonzero(lengths[: n if closed else n - 1] > 0)
    if not len(moving):
        return np.tile([1.0, 0.0], (n, 1))
    unit = steps[moving] / lengths[moving][:, None]
    # The segment that leaves each vertex for another place, and the one that came there; an end has only one.
    after = np.searchsorted(moving, np.arange(n))
    if closed:
        out, back = unit[after % len(moving)], unit[(after - 1) % len(moving)]
    else:
        out, back = unit[np.minimum(after, len(moving) - 1)], unit[np.maximum(after - 1, 0)]
    mean = out + back
    size = np.linalg.norm(mean, axis=1, keepdims=True)
    # Where the curve turns right back there is no direction halfway.
    return np.asarray(np.where(size > 1e-9, mean / np.where(size > 1e-9, size, 1.0), out), dtype=np.float64)
