"""Order: which curve is printed when, and where each starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from twins import Curve, Toolpath

Array = npt.NDArray[np.float64]


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
        waiting = dict(enumerate(layer.curves))
        while waiting:
            best: tuple[float, int, int] | None = None
            for j, curve in waiting.items():
                distance, start = _nearest_start(curve, layer.nozzle.to_world(curve.points), place)
                if best is None or distance < best[0]:
                    best = (distance, j, start)
            assert best is not None
            _, j, start = best
            curve = waiting.pop(j)
            order.append(Stop(i, j, start))
            end = start if curve.closed else (len(curve.points) - 1 if start == 0 else 0)
            place = layer.nozzle.to_world(curve.points[[end]])[0]
    return order


def _nearest_start(curve: Curve, points: Array, place: Array | None) -> tuple[float, int]:
    if place is None:
        return 0.0, 0
    distance = np.linalg.norm(points - place, axis=1)
    candidates = np.arange(len(points)) if curve.closed else np.array([0, len(points) - 1])
    start = int(candidates[np.argmin(distance[candidates])])
    return float(distance[start]), start
