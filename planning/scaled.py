"""The scaled model: the same toolpath, small enough for a desktop printer (seed paper, Section 5).

All lengths are multiplied by one scale: the curves, the bead's width and the local layer height. The nozzle of a
desktop printer stands upright whatever the layer's plane: on tilted layers it follows the plane in x, y and z, up to
the tilt at which its cone would touch the layer, and as long as the hot end stays clear of what is higher already.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from twins import Toolpath

from .desktop_printer import DesktopPrinter
from .errors import PlanningError
from .model_bead import ModelBead, bounds
from .model_scales import check_scale
from .order import Stop, print_order

Array = npt.NDArray[np.float64]

_NEAR = 1e-9


@dataclass(frozen=True, eq=False)
class ScaledModel:
    """A toolpath as a desktop printer prints it.

    Attributes:
        scale: length of the model over length of the part.
        beads: in the order of printing.
    """

    scale: float
    beads: tuple[ModelBead, ...]

    @property
    def volume(self) -> float:
        """Σ width · height · length, mm³; the bead volume of the part times scale³."""
        return float(sum(bead.sections @ bead.lengths for bead in self.beads))

    @property
    def size(self) -> Array:
        """Extent of the beads with their widths in x, y and z, shape (3,), mm."""
        low, high = bounds(self.beads)
        return np.asarray(np.r_[high[:2] - low[:2], high[2]], dtype=np.float64)

    @property
    def bead_width(self) -> tuple[float, float]:
        """Width of the narrowest bead and of the widest, mm."""
        return _range([bead.width for bead in self.beads])

    @property
    def bead_height(self) -> tuple[float, float]:
        """Height of the thinnest bead and of the thickest, mm."""
        return _range([bead.height for bead in self.beads])


def _range(values: list[Array]) -> tuple[float, float]:
    return min(float(v.min()) for v in values), max(float(v.max()) for v in values)


def scaled_model(toolpath: Toolpath, printer: DesktopPrinter, scale: float, width: float) -> ScaledModel:
    """Scale a toolpath and place it in the middle of a printer's bed, its base plane on the bed.

    Args:
        toolpath: of the part, mm.
        printer: what it is printed with.
        scale: length of the model over length of the part, such as 1 / 12.5.
        width: bead width of the part where a curve has none of its own, mm.

    Raises:
        PlanningError: the printer cannot print it; names the layer, the limit, and the scales that it can print.
    """
    for what, value in (("scale", scale), ("bead width", width)):
        if not (math.isfinite(value) and value > 0):
            raise PlanningError(f"the {what} of a scaled model must be above 0, not {value}")
    order = print_order(toolpath)
    if not order:
        raise PlanningError("the toolpath has no curves: there is nothing to print")
    beads = [_bead(toolpath, stop, width) for stop in order]
    _check_planes(toolpath, beads, printer)
    check_scale(beads, printer, scale)
    low, high = bounds(beads)
    shift = np.r_[printer.bed.centre - 0.5 * scale * (low[:2] + high[:2]), 0.0]
    return ScaledModel(
        scale,
        tuple(
            ModelBead(b.layer, b.curve, scale * b.points + shift, scale * b.width, scale * b.height)
            for b in beads
        ),
    )


def _bead(toolpath: Toolpath, stop: Stop, width: float) -> ModelBead:
    """A curve at full size, in the frame of the base."""
    layer = toolpath.layers[stop.layer]
    curve = layer.curves[stop.curve]
    n = len(curve.points)
    if curve.closed:
        order = np.r_[np.arange(stop.start, n), np.arange(stop.start + 1)]
    else:
        order = np.arange(n) if stop.start == 0 else np.arange(n)[::-1]
    points = layer.nozzle.to_world(curve.points[order])
    return ModelBead(
        stop.layer,
        stop.curve,
        toolpath.base.to_frame(points),
        np.full(len(order), float(width)) if curve.width is None else np.asarray(curve.width)[order],
        toolpath.floor_of(stop.layer).height_of(points),
    )


def _check_planes(toolpath: Toolpath, beads: list[ModelBead], printer: DesktopPrinter) -> None:
    for i in dict.fromkeys(bead.layer for bead in beads):
        if i > 0 and not toolpath.layers[i - 1].curves:
            raise PlanningError(
                f"layer {i} has curves, but layer {i - 1} below it has none: its beads would be laid in the air; set "
                "the part down on the bed, or print what stands apart by itself"
            )
    limit = printer.nozzle.max_tilt_deg
    tilt = {
        i: math.degrees(math.acos(np.clip(toolpath.layers[i].nozzle.normal @ toolpath.base.normal, -1, 1)))
        for i in sorted({bead.layer for bead in beads})
    }
    steep = [i for i, angle in tilt.items() if angle > limit + 1e-6]
    if steep:
        worst = max(steep, key=tilt.__getitem__)
        raise PlanningError(
            f"layer {steep[0]} is tilted by {tilt[steep[0]]:.1f}° from the bed (the steepest, layer {worst}, by "
            f"{tilt[worst]:.1f}°), and the upright nozzle of {printer.name} would touch it with its cone beyond "
            f"{limit:g}° (nozzle.max_tilt_deg); take a slimmer nozzle, tilt the top plane less, or print the part "
            "in shorter pieces"
        )
    for bead in beads:
        lowest = float(min(bead.height.min(), bead.points[:, 2].min()))
        if lowest <= _NEAR:
            raise PlanningError(
                f"layer {bead.layer}, curve {bead.curve} is {-lowest:.3g} mm below the layer or bed that it is "
                "printed on; correct the toolpath's planes"
            )
        if (high := bead.height > bead.width * (1.0 + _NEAR)).any():
            at = int(np.argmax(high))
            raise PlanningError(
                f"layer {bead.layer}, curve {bead.curve} has a bead {bead.height[at]:.4g} mm high and only "
                f"{bead.width[at]:.4g} mm wide, which does not hold at any scale; take wider beads or thinner layers"
            )
