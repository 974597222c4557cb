"""Global overhang: whether what a curve supports would topple off what supports it.

The global overhang of a curve is the distance of the projected centre of gravity of what it supports from the convex
hull of its support, 0 if inside. A local overhang deforms a bead; a global one tips the part over.

What a curve supports is itself and everything above that rests on it. Who rests on whom is settled point by point,
from the top down:

1. A sample point carries the bead along half of either segment beside it: a volume of length x width x local height,
   with its centre in the middle of the layer.
2. It rests on the closest place of the curves below, by ground, if that is within reach: if the beads overlap, where
   widths are known, and otherwise always.
3. Points out of reach are carried by their own curve, as by a beam: by the next points to either side along the curve
   that do rest, by the lever, or by the one on its side where an open curve sticks out.
4. What a point carries goes to the two sample points that its supporting place lies between, by the lever, with its
   volume and its centre. So what rests on several curves is shared out among them.

A curve that rests nowhere hangs in the air: its global overhang is inf, and it weighs on nothing.
The support of a curve are the places that its points rest on; in the first layer, those on the bed right below. Where
widths are known, half a width around them belongs to it as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.toolpath import Curve, Layer, Toolpath

from .local import lengths_at
from .supporters import DOWN, Supporters, checked_gravity, supporters_of

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class GlobalOverhang:
    """Global overhang of every curve of a toolpath.

    Attributes:
        distances: for each layer, of the centre of what a curve supports from the hull of its support, shape
            (curves,), mm; inf where a curve rests nowhere.
        centres: for each layer, centres of gravity of what its curves support, shape (curves, 3), mm, in the world.
        volumes: for each layer, what its curves support, themselves included, shape (curves,), mm³. Where neither
            curves nor the call know a width, in mm² of bead of unit width.
    """

    distances: tuple[Array, ...]
    centres: tuple[Array, ...]
    volumes: tuple[Array, ...]

    @property
    def maximum(self) -> float:
        """The greatest distance, mm; 0 without curves."""
        return max((float(layer.max()) for layer in self.distances if len(layer)), default=0.0)

    def worst(self, count: int = 10) -> list[tuple[int, int, float]]:
        """Layer, curve and distance in mm of the curves with the greatest global overhang above 0."""
        above = [
            (i, int(j), float(layer[j]))
            for i, layer in enumerate(self.distances)
            for j in np.flatnonzero(layer > 0.0)
        ]
        return sorted(above, key=lambda entry: -entry[2])[:count]


@checks_kinds
def global_overhang(
    toolpath: Toolpath, width: float | None = None, gravity: npt.ArrayLike = DOWN
) -> GlobalOverhang:
    """The global overhang of every curve of a toolpath, of the finished print.

    Args:
        toolpath: open or closed curves.
        width: bead width where a curve has none of its own, mm. Without it such beads are equally wide, support
            whatever is above them at any distance, and have no breadth to stand on.
        gravity: direction, shape (3,).

    Raises:
        ToolpathError: the width is not above 0, or as `local_overhang` by ground.
    """
    if width is not None and not (width > 0 and np.isfinite(width)):
        raise ToolpathError(f"the bead width must be above 0 mm, not {width}")
    down = checked_gravity(gravity)
    aside = _square_to(down)
    distances: list[Array] = []
    centres: list[Array] = []
    volumes: list[Array] = []
    received = np.zeros((0, 4))
    for i in range(len(toolpath.layers) - 1, -1, -1):
        layer = toolpath.layers[i]
        own, breadth = _beads(toolpath, i, width)
        # Volume and first moments of what every sample point carries.
        carried = own + (received if len(received) else 0.0)
        curve_of = np.repeat(np.arange(len(layer.curves)), [len(c.points) for c in layer.curves])
        total = np.zeros((len(layer.curves), 4))
        np.add.at(total, curve_of, carried)
        centre = total[:, 1:] / total[:, :1]
        below = supporters_of(toolpath, i, "ground", down)
        under = breadth if i == 0 else _breadth_below(below, toolpath.layers[i - 1], width)
        rests = below.distances <= np.where(np.isnan(breadth + under), np.inf, 0.5 * (breadth + under))
        rests &= np.isfinite(below.distances)
        support = toolpath.floor_of(i).to_world(below.places[rests]) @ aside.T
        far = _from_hull(centre @ aside.T, support, curve_of[rests])
        distances.append(np.maximum(far - 0.5 * _mean_by(curve_of[rests], under[rests], len(far)), 0.0))
        centres.append(centre)
        volumes.append(total[:, 0])
        if i:
            received = _handed_down(_to_resting(carried, layer, rests), rests, below, toolpath.layers[i - 1])
    return GlobalOverhang(tuple(distances[::-1]), tuple(centres[::-1]), tuple(volumes[::-1]))


def _beads(toolpath: Toolpath, index: int, width: float | None) -> tuple[Array, Array]:
    """Volume and first moments of the bead of every sample point of a layer, shape (n, 4), and its width, or nan."""
    layer = toolpath.layers[index]
    if not layer.curves:
        return np.zeros((0, 4)), np.zeros(0)
    points = np.concatenate([c.points for c in layer.curves])
    breadth = np.concatenate([_breadth(c, width) for c in layer.curves])
    height = toolpath.floor_of(index).height_of(layer.nozzle.to_world(points))
    length = np.concatenate([lengths_at(c) for c in layer.curves])
    # A trifle, so that a curve of repeated points has a centre.
    volume = np.maximum(length, 1e-12) * np.where(np.isnan(breadth), 1.0, breadth) * height
    return np.column_stack([volume, volume[:, None] * layer.slicing.to_world(points)]), breadth


def _breadth(curve: Curve, width: float | None) -> Array:
    if curve.width is not None:
        return curve.width
    return np.full(len(curve.points), np.nan if width is None else width)


def _breadth_below(below: Supporters, layer: Layer, width: float | None) -> Array:
    """Width of the bead below at every supporting place, or nan."""
    if not layer.curves:
        return np.full(len(below.distances), np.nan)
    breadth = np.concatenate([_breadth(c, width) for c in layer.curves])
    return np.asarray((1.0 - below.shares) * breadth[below.before] + below.shares * breadth[below.after])


def _to_resting(carried: Array, layer: Layer, rests: Flags) -> Array:
    """What each point of a layer carries once those out of reach have handed theirs on along their curves."""
    result = np.where(rests[:, None], carried, 0.0)
    first = 0
    for curve in layer.curves:
        some = slice(first, first + len(curve.points))
        if rests[some].any() and not rests[some].all():
            before, after, share = beam(curve, rests[some])
            np.add.at(result, first + before, (1.0 - share)[:, None] * carried[some][~rests[some]])
            np.add.at(result, first + after, share[:, None] * carried[some][~rests[some]])
        first = some.stop
    return result


def beam(curve: Curve, rests: Flags) -> tuple[Indices, Indices, Array]:
    """For each point of a curve that does not rest, the resting points before and after it, and the latter's share.

    The share is the lever's: how far along between the two the point is.
    """
    step = np.linalg.norm(np.roll(curve.points, -1, axis=0) - curve.points, axis=1)
    place = np.concatenate([[0.0], np.cumsum(step)])
    around, place = place[-1], place[:-1]
    resting, loose = np.flatnonzero(rests), np.flatnonzero(~rests)
    after = np.searchsorted(resting, loose)
    before = after - 1
    count = len(resting)
    if curve.closed:
        start = place[resting[before]] - np.where(before < 0, around, 0.0)
        stop = place[resting[after % count]] + np.where(after == count, around, 0.0)
    else:
        before, after = np.maximum(before, 0), np.minimum(after, count - 1)
        start, stop = place[resting[before]], place[resting[after]]
    span = stop - start
    share = np.divide(place[loose] - start, span, out=np.zeros(len(loose)), where=span > 0.0)
    return resting[before], resting[after % count], np.clip(share, 0.0, 1.0)


def _handed_down(carried: Array, rests: Flags, below: Supporters, layer: Layer) -> Array:
    """What the sample points of the layer below receive, shape (n, 4)."""
    received = np.zeros((sum(len(c.points) for c in layer.curves), 4))
    share = below.shares[rests, None]
    np.add.at(received, below.before[rests], (1.0 - share) * carried[rests])
    np.add.at(received, below.after[rests], share * carried[rests])
    return received


def _from_hull(centres: Array, support: Array, curve_of: Indices) -> Array:
    """Distance of each centre from the convex hull of its curve's support; inf where there is none."""
    far = np.full(len(centres), np.inf)
    some, index = np.unique(curve_of, return_inverse=True)
    if len(some):
        hulls = shapely.convex_hull(shapely.multipoints(support, indices=index))
        far[some] = shapely.distance(shapely.points(centres[some]), hulls)
    return far


def _mean_by(curve_of: Indices, values: Array, curves: int) -> Array:
    """The mean of values that are known, for each curve; 0 where none is."""
    known = ~np.isnan(values)
    count = np.bincount(curve_of[known], minlength=curves)
    return np.bincount(curve_of[known], values[known], curves) / np.maximum(count, 1)


def _square_to(direction: Array) -> Array:
    """Two unit vectors square to a direction and to one another, shape (2, 3)."""
    least = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = least - (least @ direction) * direction
    first = first / np.linalg.norm(first)
    return np.array([first, np.cross(direction, first)])
