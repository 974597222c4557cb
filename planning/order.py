"""Order: which curve is printed when, and where each starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from twins import Curve, Toolpath

Array = npt.NDArray[np.float64]

_ROUNDING = 1e-6  # of coordinates within 1 km, mm


@dataclass(frozen=True)
class Stop:
    """One curve in the order of printing.

    Attributes:
        layer, curve: indices in the toolpath.
        start: index of the curve's point where it starts.
    """

    layer: int
    curve: int
    start: int


def print_order(toolpath: Toolpath) -> list[Stop]:
    """Layers from the bottom up; in a layer always the curve that starts nearest to where the last one ended.

    A closed curve starts at its point nearest to there, which also lines up the seams of a wall.
    """
    order: list[Stop] = []
    place: Array | None = None
    for i, layer in enumerate(toolpath.layers):
        curves = [layer.nozzle.to_world(curve.points) for curve in layer.curves]
        if not curves:
            continue
        middles = np.array([points.mean(axis=0) for points in curves])
        radii = np.array(
            [np.linalg.norm(points - m, axis=1).max() for points, m in zip(curves, middles, strict=True)]
        )
        waiting = np.ones(len(curves), dtype=bool)
        for _ in curves:
            best: tuple[float, int, int] | None = None
            # No point of a curve is nearer than the sphere around it: most curves need no look at their points.
            near = np.zeros(len(curves)) if place is None else np.linalg.norm(middles - place, axis=1) - radii
            near[~waiting] = np.inf
            while near[j := int(near.argmin())] < np.inf and (best is None or near[j] <= best[0] + _ROUNDING):
                near[j] = np.inf
                distance, start = _nearest_start(layer.curves[j], curves[j], place)
                if best is None or (distance, j) < best[:2]:
                    best = (distance, j, start)
            assert best is not None
            _, j, start = best
            waiting[j] = False
            order.append(Stop(i, j, start))
            # A closed curve ends where it starts, an open one at its other end.
            end = start if layer.curves[j].closed else (-1 if start == 0 else 0)
            place = curves[j][end]
    return order


def _nearest_start(curve: Curve, points: Array, place: Array | None) -> tuple[float, int]:
    if place is None:
        return 0.0, 0
    distance = np.linalg.norm(points - place, axis=1)
    candidates = np.arange(len(points)) if curve.closed else np.array([0, len(points) - 1])
    start = int(candidates[np.argmin(distance[candidates])])
    return float(distance[start]), start
