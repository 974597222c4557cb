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
from scipy.ndimage import maximum_filter

from twins import Toolpath

from .desktop_printer import DesktopPrinter
from .errors import PlanningError
from .order import Stop, print_order

Array = npt.NDArray[np.float64]

_NEAR = 1e-9
_CELL = 1.0
"""Cells of the map of heights, and distance at which beads are entered in it, mm."""


@dataclass(frozen=True, eq=False)
class ModelBead:
    """A curve as the desktop printer prints it, n points.

    Attributes:
        layer, curve: indices in the toolpath.
        points: on the printer's bed, shape (n, 3), mm; a closed curve ends where it starts.
        width, height: of the bead, shape (n,), mm.
    """

    layer: int
    curve: int
    points: Array
    width: Array
    height: Array

    @property
    def lengths(self) -> Array:
        """Length of each move, shape (n - 1,), mm."""
        return np.asarray(np.linalg.norm(np.diff(self.points, axis=0), axis=1), dtype=np.float64)

    @property
    def sections(self) -> Array:
        """Mean of width · height over each move, shape (n - 1,), mm²."""
        section = self.width * self.height
        return np.asarray(0.5 * (section[1:] + section[:-1]), dtype=np.float64)


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
        low, high = _bounds(self.beads)
        return np.asarray(np.r_[high[:2] - low[:2], high[2]], dtype=np.float64)


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
    _check_scale(beads, printer, scale)
    low, high = _bounds(beads)
    shift = np.r_[printer.bed.centre - 0.5 * scale * (low[:2] + high[:2]), 0.0]
    model = ScaledModel(
        scale,
        tuple(
            ModelBead(b.layer, b.curve, scale * b.points + shift, scale * b.width, scale * b.height)
            for b in beads
        ),
    )
    _check_hot_end(model, printer)
    return model


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


def _bounds(beads: list[ModelBead] | tuple[ModelBead, ...]) -> tuple[Array, Array]:
    """Lowest and highest coordinates of beads with half their width to all sides, shape (3,) each."""
    points = np.vstack([bead.points for bead in beads])
    half = 0.5 * np.concatenate([bead.width for bead in beads])[:, None] * [1.0, 1.0, 0.0]
    return (points - half).min(axis=0), (points + half).max(axis=0)


def _check_planes(toolpath: Toolpath, beads: list[ModelBead], printer: DesktopPrinter) -> None:
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


def _check_scale(beads: list[ModelBead], printer: DesktopPrinter, scale: float) -> None:
    """Whether beads and model suit nozzle and bed, and which scales would."""
    narrow = min(beads, key=lambda bead: float(bead.width.min()))
    wide = max(beads, key=lambda bead: float(bead.width.max()))
    thick = max(beads, key=lambda bead: float(bead.height.max()))
    tall = max(beads, key=lambda bead: float(bead.points[:, 2].max()))
    low, high = _bounds(beads)
    size = np.r_[high[:2] - low[:2], high[2]]
    room = printer.bed.room - [0.0, 0.0, printer.motion.hop]
    least, most = printer.nozzle.widths
    thickest = printer.nozzle.height_max * printer.nozzle.diameter
    bore = f"the {printer.nozzle.diameter:g} mm nozzle of {printer.name}"

    def told(what: str, value: float, bead: ModelBead) -> str:
        return f"the {what} at {ratio(scale)} would be {scale * value:.3g} mm (layer {bead.layer}, curve {bead.curve})"

    def told_size(k: int) -> str:
        where = f" (layer {tall.layer})" if k == 2 else ""
        return (
            f"the model at {ratio(scale)} would be {scale * size[k]:.4g} mm {'long' if k < 2 else 'high'} in "
            f"{'xyz'[k]}{where}, more than the {room[k]:g} mm that {printer.name} has"
        )

    widest, heights = float(wide.width.max()), float(thick.height.max())
    # What sets a largest scale, which, and how it is told where it is passed.
    demands = [
        (
            "the nozzle's widest bead",
            most / widest,
            f"{told('bead width', widest, wide)}, more than the {most:g} mm of {bore}",
        ),
        (
            "the nozzle's thickest layer",
            thickest / heights,
            f"{told('layer height', heights, thick)}, more than the {thickest:g} mm of {bore}",
        ),
        *(
            (("the bed", "the bed", "the printer's height")[k], room[k] / size[k], told_size(k))
            for k in range(3)
        ),
    ]
    narrowest = float(narrow.width.min())
    bottom = least / narrowest
    by, top, passed = min(demands, key=lambda demand: demand[1])
    if scale < bottom * (1 - _NEAR):
        wrong = f"{told('bead width', narrowest, narrow)}, less than the {least:g} mm of {bore}"
    elif scale > top * (1 + _NEAR):
        wrong = passed
    else:
        return
    if bottom <= top:
        remedy = f"choose a scale of at least {ratio(bottom, -1)} and at most {ratio(top, 1)}"
    else:
        remedy = (
            f"no scale suits: the nozzle's narrowest bead asks for at least {ratio(bottom)}, and {by} for at most "
            f"{ratio(top)}; change the bead's width, or take another nozzle or printer"
        )
    raise PlanningError(f"{wrong}; {remedy}")


def _check_hot_end(model: ScaledModel, printer: DesktopPrinter) -> None:
    """Refuse where something printed reaches above the nozzle into the hot end: only tilted layers can."""
    nozzle = printer.nozzle
    low, high = _bounds(model.beads)
    map_size = np.ceil((high - low)[:2] / _CELL).astype(int) + 1
    top = np.zeros(map_size)
    reach = 2 * math.ceil(0.5 * nozzle.hot_end / _CELL) + 1
    hit: dict[int, float] = {}
    for layer in dict.fromkeys(bead.layer for bead in model.beads):
        points = np.vstack([_dense(bead.points) for bead in model.beads if bead.layer == layer])
        x, y = ((points[:, :2] - low[:2]) / _CELL).astype(int).T
        np.maximum.at(top, (x, y), points[:, 2])
        if float(top.max() - points[:, 2].min()) > nozzle.length:
            above = float((maximum_filter(top, size=reach)[x, y] - points[:, 2]).max())
            if above > nozzle.length:
                hit[layer] = above
    if hit:
        worst = max(hit.values())
        raise PlanningError(
            f"layer {min(hit)}: the model at {ratio(model.scale)} reaches {hit[min(hit)]:.3g} mm above the nozzle "
            f"within {0.5 * nozzle.hot_end:g} mm of it (the highest in all layers: {worst:.3g} mm), into the hot end "
            f"of {printer.name}, whose nozzle is {nozzle.length:g} mm long (nozzle.length); choose a scale of "
            f"{ratio(model.scale * nozzle.length / worst, 1)} or less, tilt the top plane less, or take a longer nozzle"
        )


def _dense(points: Array) -> Array:
    """Points of a polyline no farther apart than a cell of the map, shape (m, 3)."""
    place = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    places = np.union1d(place, np.arange(0.0, place[-1], _CELL))
    return np.column_stack([np.interp(places, place, points[:, k]) for k in range(3)])


def ratio(scale: float, rounded: int = 0) -> str:
    """A scale as 1:n.

    Args:
        rounded: to three digits of n, up (1: a smaller scale) or down (-1: a larger one); 0: not.
    """
    n = 1.0 / scale
    step = 10.0 ** (math.floor(math.log10(n)) - 2)
    if rounded:
        n = step * (math.ceil(n / step - _NEAR) if rounded > 0 else math.floor(n / step + _NEAR))
    return f"1:{n:.6g}"
