"""Local overhang of a toolpath: how far each sample point hangs over (seed paper, Section 3.1).

LOH = d / t: the distance d of a point from its supporter on the layer below over the local layer thickness t.
`supporters.py` says what supports a point, by ground and by layer. The first layer lies on the bed and has none.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.toolpath import Curve, Toolpath

from .distribution import Measured
from .supporters import DOWN, Reference, supporters_of

Array = npt.NDArray[np.float64]

APART = 5.0
"""Distance of two places that are told apart as the worst ones, in layer thicknesses."""


@dataclass(frozen=True, eq=False)
class OverhangPlace:
    """A sample point and how far it hangs over.

    Attributes:
        layer, curve, point: indices.
        place: in the world, mm.
        ratio: d / t.
    """

    layer: int
    curve: int
    point: int
    place: tuple[float, float, float]
    ratio: float

    def __str__(self) -> str:
        x, y, z = self.place
        return (
            f"{self.ratio:.2f} at layer {self.layer}, curve {self.curve}, point {self.point} "
            f"({x:.1f}, {y:.1f}, {z:.1f})"
        )


@dataclass(frozen=True, eq=False)
class LocalOverhang(Measured):
    """Local overhang d / t of every sample point of a toolpath.

    It can be asked for `maximum`, `quantile(share)`, `above(limit)` and `share_above(limit)`, weighted by length.

    Attributes:
        values: d / t of all sample points in a row, layer by layer, shape (n,); 0 in the first layer, inf above a
            layer without curves.
        weights: length that each sample point stands for: half of either segment beside it, shape (n,), mm.
        toolpath: that was measured.
        reference: "ground" or "layer".
    """

    toolpath: Toolpath
    reference: Reference

    @cached_property
    def ratios(self) -> tuple[tuple[Array, ...], ...]:
        """d / t for each layer and each of its curves, one value a point, shape (n,)."""
        counts = [len(curve.points) for *_, curve in self.toolpath.curves()]
        parts = iter(np.split(self.values, np.cumsum(counts)[:-1]))
        return tuple(tuple(next(parts) for _ in layer.curves) for layer in self.toolpath.layers)

    @cached_property
    def places(self) -> Array:
        """Where the nozzle is at all sample points in a row, shape (n, 3), mm, in the world."""
        return np.concatenate(
            [np.empty((0, 3)), *(layer.nozzle.to_world(c.points) for *_, layer, c in self.toolpath.curves())]
        )

    def worst(self, count: int = 10, apart: float | None = None) -> list[OverhangPlace]:
        """The places that hang over most, the worst first.

        Args:
            count: of places at most.
            apart: no two are closer than this, mm: neighbours of a bad place are bad too; default five layer
                thicknesses.

        Raises:
            ToolpathError: the distance is negative or not a number.
        """
        distance = APART * self.toolpath.thickness if apart is None else apart
        if not distance >= 0.0:
            raise ToolpathError(f"places can be told apart by a distance of at least 0 mm, not {distance}")
        curves = [(i, j, k) for i, j, _, c in self.toolpath.curves() for k in range(len(c.points))]
        left = np.where(self.values > 0.0, self.values, -1.0)
        found: list[OverhangPlace] = []
        while len(found) < count and len(left) and left.max() > 0.0:
            at = int(np.argmax(left))
            x, y, z = (float(value) for value in self.places[at])
            found.append(OverhangPlace(*curves[at], (x, y, z), float(self.values[at])))
            left[np.linalg.norm(self.places - self.places[at], axis=1) <= distance] = -1.0
        return found


@checks_kinds
def local_overhang(
    toolpath: Toolpath,
    reference: Reference = "ground",
    gravity: npt.ArrayLike = DOWN,
    *,
    arcs: bool = True,
) -> LocalOverhang:
    """The local overhang of every sample point of a toolpath (seed paper, Section 3.1).

    By ground, a point is projected along gravity to the nozzle plane below; d is its distance there from the curves of
    that layer, and t the way down. By layer, the point is carried to that plane by the rigid motion between the
    planes' frames, and t is its height above the plane. Where layers are parallel and horizontal the two are the same.

    Suggested maxima are a material's: see `max_overhang_by_ground` and `max_overhang_by_layer` of a mix.

    Args:
        toolpath: open or closed curves.
        reference: "ground" or "layer".
        gravity: direction, shape (3,).
        arcs: measure to the smooth curve that the sample points below suggest, except at corners, as the nozzle blends
            them; False measures to their chords, which are up to L² / (8 R) beside it.

    Raises:
        ToolpathError: a nozzle plane is not above the one before it inside the part, or gravity does not meet it.
    """
    below = [supporters_of(toolpath, i, reference, gravity, arcs=arcs) for i in range(len(toolpath.layers))]
    values = _row([layer.distances / layer.heights for layer in below])
    weights = _row([lengths_at(curve) for *_, curve in toolpath.curves()])
    return LocalOverhang(values, weights, toolpath, reference)


def lengths_at(curve: Curve) -> Array:
    """The length that each point of a curve stands for: half of either segment beside it, shape (n,), mm."""
    step = np.hypot(*(np.roll(curve.points, -1, axis=0) - curve.points).T)
    if not curve.closed:
        step[-1] = 0.0
    return np.asarray(0.5 * (step + np.roll(step, 1)), dtype=np.float64)


def _row(arrays: list[Array]) -> Array:
    row = np.concatenate([np.empty(0), *arrays])
    row.setflags(write=False)
    return row
