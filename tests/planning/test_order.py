"""The order of printing."""

import numpy as np
from models import stack

from planning.order import print_order
from twins import Curve


def nearest_by_nearest(toolpath):
    """The order by looking at every point of every curve that is left."""
    place, order = None, []
    for i, layer in enumerate(toolpath.layers):
        left = list(range(len(layer.curves)))
        while left:
            found = []
            for j in left:
                points = layer.nozzle.to_world(layer.curves[j].points)
                starts = range(len(points)) if layer.curves[j].closed else (0, len(points) - 1)
                distances = [0.0 if place is None else np.linalg.norm(points[k] - place) for k in starts]
                found.append(
                    (min(distances), j, list(starts)[int(np.argmin(distances))] if place is not None else 0)
                )
            _, j, start = min(found)
            left.remove(j)
            order.append((i, j, start))
            curve = layer.curves[j]
            end = start if curve.closed else (len(curve.points) - 1 if start == 0 else 0)
            place = layer.nozzle.to_world(curve.points)[end]
    return order


def test_the_order_is_nearest_by_nearest():
    rng = np.random.default_rng(3)
    turns = np.linspace(0, 2 * np.pi, 9, endpoint=False)
    ring = np.column_stack([np.cos(turns), np.sin(turns)])
    # A raster, whose distances are equal in pairs, and curves that reach into each other's spheres.
    raster = tuple(
        Curve(np.array([[0.0, y], [300.0, y]])[:: int(rng.choice([1, -1]))], closed=False)
        for y in np.arange(0.0, 200.0, 10.0)
    )
    rings = tuple(
        Curve(ring * rng.uniform(2, 60) + rng.uniform(-200, 200, 2), closed=bool(k % 3)) for k in range(60)
    )
    toolpath = stack([10.0, 20.0, 30.0], (*raster, *rings))
    assert [(s.layer, s.curve, s.start) for s in print_order(toolpath)] == nearest_by_nearest(toolpath)
