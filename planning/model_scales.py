"""Scales of a model: which of them suit a printer's nozzle, bed and hot end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby

import numpy as np
import numpy.typing as npt

from .desktop_printer import DesktopPrinter
from .errors import PlanningError
from .model_bead import ModelBead, bounds

Array = npt.NDArray[np.float64]

_NEAR = 1e-9
_CELL = 1.0
"""Cells of the map of heights, and distance at which beads are entered in it, mm of the model."""


def check_scale(beads: Sequence[ModelBead], printer: DesktopPrinter, scale: float) -> None:
    """Whether beads and model suit nozzle, bed and hot end.

    Args:
        beads: at full size, in the order of printing.
        printer: that prints them.
        scale: length of the model over length of the part.

    Raises:
        PlanningError: they do not; names the place, the limit, and the scales that do.
    """
    wrong: str | None = None
    bottom, asks, too_small = max(_least_scales(beads, printer, scale), key=_scale_of)
    top, allows, too_large = min(_largest_scales(beads, printer, scale), key=_scale_of)
    if scale < bottom * (1 - _NEAR):
        wrong = too_small
    elif scale > top * (1 + _NEAR):
        wrong = too_large
    else:
        rises = _rises(beads, printer, scale)
        if not rises:
            return
        worst, layer = max(rises.values()), min(rises)
        wrong = (
            f"layer {layer}: the model at {ratio(scale)} reaches {rises[layer]:.3g} mm above the nozzle within "
            f"{0.5 * printer.nozzle.hot_end:g} mm of it (the highest in all layers: {worst:.3g} mm), into the hot "
            f"end of {printer.name}, whose nozzle is {printer.nozzle.length:g} mm long (nozzle.length)"
        )
    raise PlanningError(f"{wrong}; {_remedy(beads, printer, (bottom, asks), (top, allows))}")


def ratio(scale: float, rounded: int = 0, digits: int = 3) -> str:
    """A scale as 1:n.

    Args:
        rounded: to the digits of n, up (1: a smaller scale) or down (-1: a larger one); 0: not.
        digits: of n.
    """
    n = 1.0 / scale
    step = 10.0 ** (math.floor(math.log10(n)) + 1 - digits)
    if rounded:
        n = step * (math.ceil(n / step - _NEAR) if rounded > 0 else math.floor(n / step + _NEAR))
    return f"1:{n:.{max(6, digits)}g}"


def _least_scales(
    beads: Sequence[ModelBead], printer: DesktopPrinter, scale: float
) -> list[tuple[float, str, str]]:
    """Of what sets a least scale: that, what it is, and how it is told where it is not reached."""
    narrow = min(beads, key=lambda bead: float(bead.width.min()))
    thin = min(beads, key=lambda bead: float(bead.height.min()))
    narrowest, thinnest = float(narrow.width.min()), float(thin.height.min())
    width, height = printer.nozzle.widths[0], printer.nozzle.heights[0]
    return [
        (
            width / narrowest,
            "the nozzle's narrowest bead",
            f"{_told('bead width', narrowest, narrow, scale)}, less than the {width:g} mm of {_bore(printer)}",
        ),
        (
            height / thinnest,
            "the nozzle's thinnest layer",
            f"{_told('layer height', thinnest, thin, scale)}, less than the {height:g} mm of {_bore(printer)}",
        ),
    ]


def _largest_scales(
    beads: Sequence[ModelBead], printer: DesktopPrinter, scale: float
) -> list[tuple[float, str, str]]:
    """The same of what sets a largest scale, but for the hot end."""
    wide = max(beads, key=lambda bead: float(bead.width.max()))
    thick = max(beads, key=lambda bead: float(bead.height.max()))
    tall = max(beads, key=lambda bead: float(bead.points[:, 2].max()))
    widest, thickest = float(wide.width.max()), float(thick.height.max())
    width, height = printer.nozzle.widths[1], printer.nozzle.heights[1]
    low, high = bounds(beads)
    size = np.r_[high[:2] - low[:2], high[2]]
    room = printer.bed.room - [0.0, 0.0, printer.motion.hop]
    demands = [
        (
            width / widest,
            "the nozzle's widest bead",
            f"{_told('bead width', widest, wide, scale)}, more than the {width:g} mm of {_bore(printer)}",
        ),
        (
            height / thickest,
            "the nozzle's thickest layer",
            f"{_told('layer height', thickest, thick, scale)}, more than the {height:g} mm of {_bore(printer)}",
        ),
    ]
    for k, by in enumerate(("the bed", "the bed", "the printer's height")):
        where = f" (layer {tall.layer})" if k == 2 else ""
        told = (
            f"the model at {ratio(scale)} would be {scale * size[k]:.4g} mm {'long' if k < 2 else 'high'} in "
            f"{'xyz'[k]}{where}, more than the {room[k]:g} mm that {printer.name} has"
        )
        demands.append((float(room[k] / size[k]), by, told))
    return demands


def _scale_of(demand: tuple[float, str, str]) -> float:
    return demand[0]


def _told(what: str, value: float, bead: ModelBead, scale: float) -> str:
    return f"the {what} at {ratio(scale)} would be {scale * value:.3g} mm (layer {bead.layer}, curve {bead.curve})"


def _bore(printer: DesktopPrinter) -> str:
    return f"the {printer.nozzle.diameter:g} mm nozzle of {printer.name}"


def _remedy(
    beads: Sequence[ModelBead],
    printer: DesktopPrinter,
    least: tuple[float, str],
    largest: tuple[float, str],
) -> str:
    """Which scales suit, or what stands against all of them.

    Args:
        beads: at full size.
        printer: that prints them.
        least, largest: scale that the demands but the hot end's allow, and which of them.
    """
    (bottom, asks), (top, allows) = least, largest
    if bottom <= top * (1 + _NEAR):
        for digits in range(3, 11):
            # As many digits as it takes to stay between the two.
            low, high = _rounded(bottom, -1, digits), _rounded(top, 1, digits)
            under = _under_hot_end(beads, printer, high, digits)
            if low > under * (1 + _NEAR):
                continue
            if not _rises(beads, printer, low):
                first, last = ratio(low, 0, digits), ratio(under, 0, digits)
                return f"choose a scale of {f'at least {first} and at most ' if first != last else ''}{last}"
            # The smaller the scale, the farther the hot end reaches over the part: not all below suit.
            return f"choose a scale of {ratio(under, 0, digits)}, the largest that the hot end allows"
        if under < high:
            top, allows = under, "the hot end"
    return (
        f"no scale suits: {asks} asks for at least {ratio(bottom)}, and {allows} for at most {ratio(top)}; change "
        "the bead's width or the layer's thickness, or take another nozzle or printer"
    )


def _rounded(scale: float, rounded: int, digits: int) -> float:
    return 1.0 / float(ratio(scale, rounded, digits).removeprefix("1:"))


def _under_hot_end(beads: Sequence[ModelBead], printer: DesktopPrinter, scale: float, digits: int) -> float:
    """The largest scale up to a given one at which nothing reaches into the hot end, to so many digits.

    What it reaches over, at full size, only grows as the scale falls. So from a scale at which that is too high to the
    one that would bring the same just low enough, all are too large.
    """
    while rises := _rises(beads, printer, scale):
        share = min(printer.nozzle.length / max(rises.values()), 1.0 - 10.0**-digits)
        scale = _rounded(share * scale, 1, digits)
    return scale


def _rises(beads: Sequence[ModelBead], printer: DesktopPrinter, scale: float) -> dict[int, float]:
    """By layer, how far what is printed reaches above the nozzle into the hot end, mm: only tilted layers let it."""
    from scipy.ndimage import maximum_filter  # noqa: PLC0415 - every process of a cell loads the planner, and none this

    nozzle = printer.nozzle
    low, high = (scale * ends for ends in bounds(beads))
    top = np.zeros(np.ceil((high - low)[:2] / _CELL).astype(int) + 1)
    reach = 2 * math.ceil(0.5 * nozzle.hot_end / _CELL) + 1
    hit: dict[int, float] = {}
    for layer, of_layer in groupby(beads, lambda bead: bead.layer):
        points = np.vstack([_dense(scale * bead.points) for bead in of_layer])
        x, y = ((points[:, :2] - low[:2]) / _CELL).astype(int).T
        np.maximum.at(top, (x, y), points[:, 2])
        if float(top.max() - points[:, 2].min()) > nozzle.length:
            above = float((maximum_filter(top, size=reach)[x, y] - points[:, 2]).max())
            if above > nozzle.length * (1 + _NEAR):
                hit[layer] = above
    return hit


def _dense(points: Array) -> Array:
    """Points of a polyline no farther apart than a cell of the map, shape (m, 3)."""
    place = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    places = np.union1d(place, np.arange(0.0, place[-1], _CELL))
    return np.column_stack([np.interp(places, place, points[:, k]) for k in range(3)])
