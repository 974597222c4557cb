"""Where beads of a layer press into one another: runs nearer than half of both their widths together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.toolpath import Layer, Toolpath

from .close_points import ALONG, CLOSE, SAMPLES, Runs, nearest_runs
from .dividing import divided

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class BeadOverlap:
    """How far the beads of a layer press into one another.

    Attributes:
        length: of all curves, mm.
        overlapping: length of curve whose nearest neighbour is nearer than 0.95 times half of both widths, mm.
        least: the smallest distance over half of both widths; infinite where no bead has another beside it.
        place: where that is, in the world on the nozzle plane, mm; None where `least` is infinite.
    """

    length: float
    overlapping: float
    least: float
    place: tuple[float, float, float] | None


@checks_kinds
def bead_overlap(toolpath: Toolpath, width: float) -> tuple[BeadOverlap, ...]:
    """How far the beads of each layer press into one another; every bead counts with its width where it is.

    Args:
        toolpath: open or closed curves.
        width: of the beads of curves that have none of their own, mm.

    Raises:
        ToolpathError: the width is not above 0.
    """
    if not 0.0 < width < np.inf:
        raise ToolpathError(f"the bead width must be above 0 mm, not {width}")
    return tuple(_of_layer(layer, float(width)) for layer in toolpath.layers)


def _of_layer(layer: Layer, width: float) -> BeadOverlap:
    if not layer.curves:
        return BeadOverlap(0.0, 0.0, float("inf"), None)
    narrowest = min(width if curve.width is None else float(curve.width.min()) for curve in layer.curves)
    curves = [divided(curve, narrowest / SAMPLES)[0] for curve in layer.curves]
    widths = np.concatenate([np.full(len(c.points), width) if c.width is None else c.width for c in curves])
    runs = Runs.of(curves)
    _, left, right, on_left, on_right = nearest_runs(runs, float(widths.max()), ALONG * narrowest)
    share = np.full(len(widths), np.inf)
    for away, segment in ((left, on_left), (right, on_right)):
        # Widths change slowly along a bead: the middle of the segment beside stands for it.
        beside = 0.5 * (widths[segment] + widths[runs.following[segment]])
        share = np.minimum(share, away / (0.5 * (widths + beside)))
    weights = runs.share
    at = int(np.argmin(share))
    place = None
    if np.isfinite(share[at]):
        x, y, z = (float(value) for value in layer.nozzle.to_world(runs.points[at : at + 1])[0])
        place = (x, y, z)
    return BeadOverlap(float(weights.sum()), float(weights[share < CLOSE].sum()), float(share[at]), place)
