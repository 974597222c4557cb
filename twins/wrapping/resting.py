"""Resting: whether layers lie on those directly below them.

The planes of parts that stand side by side and have layers of their own are all different, so one part's layers come
between the other's, and a bead's height would be measured from a plane on which nothing is below it. Two such parts
are refused: a layer that lies on an earlier layer and nowhere on the one directly below it, where what lies over one
another through all layers makes two parts that share no layer.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely.geometry.base import BaseGeometry

from twins.errors import PlanesError
from twins.toolpath import Curve, Layer

Shapes = npt.NDArray[np.object_]

REACH = 2.0
"""Curves whose places are no farther apart than this many layer thicknesses may lie on one another."""


def hanging(layers: Sequence[Layer], sources: Sequence[Sequence[int]], thickness: float) -> tuple[int, ...]:
    """The numbers of curves that have nothing of the layer directly below under them, but something of an earlier one.

    They hang from what is printed later, or belong to a part whose layers are not those of its neighbours. What is
    under a curve is seen in (u, v), which is the same place of the part in the frames of all layers.

    Args:
        layers: from the bottom up, curves with their interior on the left.
        sources: for each layer and curve its number.
        thickness: of the layers, nominal, mm.

    Raises:
        PlanesError: they make two parts that share no layer.
    """
    reach = REACH * thickness
    laid = np.array([_laid(layer.curves) for layer in layers], dtype=object)
    shapely.prepare(laid)
    found: list[int] = []
    for k in range(1, len(layers)):
        alone = _alone(layers[k].curves)
        beside = ~shapely.dwithin(alone, laid[k - 1], reach)
        if not beside.any():
            continue
        off = np.flatnonzero(beside)
        over = np.array(
            [bool(shapely.dwithin(alone[j], laid[: k - 1], reach).any()) for j in off], dtype=bool
        )
        if len(off) == len(alone) and over.any():
            j = int(off[over][0])
            if _apart(layers, k, j, reach):
                below = int(np.flatnonzero(shapely.dwithin(alone[j], laid[: k - 1], reach))[-1])
                raise PlanesError(
                    f"layer {k} (curve {sources[k][j]}) has nothing of layer {k - 1} (curve {sources[k - 1][0]}) under "
                    f"it, only layer {below} (curve {sources[below][0]}): these are parts side by side with layers of "
                    "their own; wrap each part by itself, or draw them with the same layers"
                )
        found += [sources[k][j] for j in off[over]]
    return tuple(sorted(found))


def _apart(layers: Sequence[Layer], k: int, j: int, reach: float) -> bool:
    """Whether curve `j` of layer `k` and what is in the layer below belong to parts that share no layer.

    What lies over one another, through whatever layers, is a part.
    """
    shapes = np.concatenate([_alone(layer.curves) for layer in layers])
    of_layer = np.repeat(np.arange(len(layers)), [len(layer.curves) for layer in layers])
    one, other = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=reach)
    links = coo_array((np.ones(len(one), dtype=bool), (one, other)), shape=(len(shapes), len(shapes)))
    part = connected_components(links, directed=False)[1]
    first = int(np.searchsorted(of_layer, k))
    mine = set(of_layer[part == part[first + j]].tolist())
    beneath = part[of_layer == k - 1]
    theirs = set(of_layer[np.isin(part, beneath)].tolist())
    return len(mine) > 1 and len(theirs) > 1 and mine.isdisjoint(theirs)


def _laid(curves: Sequence[Curve]) -> BaseGeometry:
    """What a layer covers: all that its closed curves enclose, and its open ones."""
    enclosed: BaseGeometry = shapely.Polygon()
    for curve in curves:
        if curve.closed:
            ring = shapely.Polygon(curve.points)
            # What lies in an odd number of curves.
            enclosed = ring if enclosed.is_empty else shapely.symmetric_difference(enclosed, ring)
    lines = [shapely.LineString(curve.points) for curve in curves if not curve.closed]
    return shapely.GeometryCollection([enclosed, *lines]) if lines else enclosed


def _alone(curves: Sequence[Curve]) -> Shapes:
    """Each curve with what it encloses."""
    return np.array(
        [shapely.Polygon(c.points) if c.closed else shapely.LineString(c.points) for c in curves],
        dtype=object,
    )
