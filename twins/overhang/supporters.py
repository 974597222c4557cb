"""Supporters: where the sample points of a layer rest on the layer below (seed paper, Section 3.1).

A point is taken to the nozzle plane below its own, and the closest point of the curves that run there supports it.
Beads are laid along curves, so curves support as polylines, not by their sample points, and what they enclose does
not. Two ways lead down:

- *by ground*, along gravity: what concrete does;
- *by layer*, by the rigid motion between the planes' frames (same u and v): what a stiff thread does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numba as nb
import numpy as np
import numpy.typing as npt

from twins.errors import ToolpathError
from twins.sampling import CORNER
from twins.toolpath import Curve, Plane, Toolpath, read_only

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Reference = Literal["ground", "layer"]

DOWN: Final = (0.0, 0.0, -1.0)
"""Gravity of the world."""

UPRIGHT: Final = 1e-6
"""Sine of the angle between a plane and gravity below which they do not meet."""

_FAN: Final = 8
_DEPTH: Final = 256  # nodes that wait at once: 7 a level and one more, for far more than 8^20 segments


@dataclass(frozen=True, eq=False)
class Supporters:
    """Where the n sample points of a layer rest, all curves in a row.

    Attributes:
        distances: d, to the closest place of the curves below, in their plane, shape (n,), mm; inf where there are
            none.
        heights: t, local height of the layer, shape (n,), mm.
        before, after: sample points of the layer below, in a row, that the supporting place lies between, shape
            (n,); -1 where there is none.
        shares: where between the two the place is, 0 to 1, shape (n,).
        places: the supporting places in the frame of the plane below, shape (n, 2), mm.
    """

    distances: Array
    heights: Array
    before: Indices
    after: Indices
    shares: Array
    places: Array


def checked_gravity(gravity: npt.ArrayLike) -> Array:
    """The direction of gravity as a unit vector, shape (3,).

    Raises:
        ToolpathError: it is no direction.
    """
    direction = read_only(gravity, (3,), "the direction of gravity")
    size = float(np.linalg.norm(direction))
    if size < 1e-9:
        raise ToolpathError("the direction of gravity must not be the zero vector")
    return np.asarray(direction / size, dtype=np.float64)


def supporters_of(
    toolpath: Toolpath,
    layer: int,
    reference: Reference = "ground",
    gravity: npt.ArrayLike = DOWN,
    *,
    arcs: bool = False,
) -> Supporters:
    """Where the sample points of a layer rest on the curves of the layer below.

    Args:
        toolpath: open or closed curves.
        layer: its index; of layer 0 the base carries every point right below it.
        reference: how a point is taken to the plane below. The height t is measured along gravity by ground, and
            square to the plane below by layer.
        gravity: direction, shape (3,).
        arcs: as in `closest_places`.

    Raises:
        ToolpathError: the nozzle plane is not above the one below it at a point, or gravity does not meet that plane;
            names layer, curve and place.
    """
    if reference not in get_args(Reference):
        raise ToolpathError(f"overhang is measured by 'ground' or by 'layer', not by {reference!r}")
    down = checked_gravity(gravity)
    own, floor = toolpath.layers[layer], toolpath.floor_of(layer)
    points = stacked(own.curves)
    world = own.nozzle.to_world(points)
    heights = floor.height_of(world)
    if reference == "ground":
        steepness = -float(floor.normal @ down)
        if steepness <= UPRIGHT:
            raise ToolpathError(
                f"layer {layer}: gravity does not meet the plane that it is printed on, which stands upright or hangs; "
                "measure overhang by layer"
            )
        heights = heights / steepness
    if len(points) and not heights.min() > 0.0:
        at = int(np.argmin(heights))
        curve = int(np.searchsorted(np.cumsum([len(c.points) for c in own.curves]), at, side="right"))
        x, y, z = world[at]
        raise ToolpathError(
            f"layer {layer}, curve {curve}: at ({x:.3f}, {y:.3f}, {z:.3f}) its nozzle plane is not above the one "
            "before it; planes must not cross inside the part"
        )
    below = points if reference == "layer" else _in_plane(floor, world + heights[:, None] * down)
    if layer == 0:
        nowhere = np.full(len(points), -1)
        return Supporters(
            np.zeros(len(points)), heights, nowhere, nowhere, np.zeros(len(points)), _in_plane(floor, world)
        )
    distances, before, after, shares, places = closest_places(
        below, toolpath.layers[layer - 1].curves, arcs=arcs
    )
    return Supporters(distances, heights, before, after, shares, places)


def closest_places(
    points: Array, curves: Sequence[Curve], *, arcs: bool = False
) -> tuple[Array, Indices, Indices, Array, Array]:
    """The closest places of curves to points, in one plane.

    Args:
        points: shape (n, 2), mm.
        curves: polylines.
        arcs: bend the segment that is closest into the arc that its neighbours suggest, except at corners. So a curve
            of radius R that was sampled at L is taken for what it was, not for chords up to L² / (8 R) beside it.

    Returns:
        distances, shape (n,), inf without curves; the sample points before and after each place in the row of all
        curves' points, shape (n,), -1 without curves; the place between them as a share, and the place, shape (n, 2).
    """
    if not curves:
        nowhere = np.full(len(points), -1)
        return (
            np.full(len(points), np.inf),
            nowhere,
            nowhere,
            np.zeros(len(points)),
            np.full_like(points, np.nan),
        )
    ends = stacked(curves)
    before, after = segments_of(curves)
    starts, stops = ends[before], ends[after]
    boxes, levels = _boxes(np.minimum(starts, stops), np.maximum(starts, stops))
    segment, shares = _closest_segments(np.ascontiguousarray(points), starts, stops, boxes, levels)
    places = starts[segment] + shares[:, None] * (stops[segment] - starts[segment])
    if arcs:
        left, right = (slope[segment] for slope in _slopes(ends, before, after))
        rise = shares * (1.0 - shares) * ((1.0 - shares) * left - shares * right)
        places = places + rise[:, None] * (stops - starts)[segment][:, ::-1] * [-1.0, 1.0]
    distances = np.hypot(*(points - places).T)
    return distances, before[segment], after[segment], shares, places


def stacked(curves: Sequence[Curve]) -> Array:
    """The points of curves in a row, shape (n, 2)."""
    return np.concatenate([c.points for c in curves]) if curves else np.empty((0, 2))


def segments_of(curves: Sequence[Curve]) -> tuple[Indices, Indices]:
    """Both ends of every segment, as indices into the row of all curves' points."""
    counts = np.array([len(c.points) for c in curves], dtype=np.int64)
    last = np.cumsum(counts) - 1
    before = np.arange(int(counts.sum()))
    after = before + 1
    after[last] = last + 1 - counts
    closed = np.array([c.closed for c in curves], dtype=bool)
    kept = np.ones(len(before), dtype=bool)
    kept[last[~closed]] = False
    return before[kept], after[kept]


def _slopes(points: Array, before: Indices, after: Indices) -> tuple[Array, Array]:
    """Slopes of the smooth curve against each of its chords, where it leaves and where it ends, shape (m,) each.

    At a point it has the direction of the circle through it and its neighbours; at a corner or an open end a chord
    has its own.
    """
    along = points[after] - points[before]
    length = np.hypot(*along.T)
    into = np.full(len(points), -1)
    into[after] = np.arange(len(before))
    previous = into[before]
    joined = np.flatnonzero(previous >= 0)
    one, two = previous[joined], joined
    turn = np.arctan2(
        along[one, 0] * along[two, 1] - along[one, 1] * along[two, 0], (along[one] * along[two]).sum(axis=1)
    )
    turn = np.where(np.abs(turn) <= CORNER, turn, 0.0) / np.maximum(length[one] + length[two], 1e-300)
    leaving, ending = np.zeros(len(before)), np.zeros(len(before))
    leaving[two] = np.tan(-turn * length[two])
    ending[one] = np.tan(turn * length[one])
    return leaving, ending


def _in_plane(plane: Plane, points: Array) -> Array:
    return np.ascontiguousarray(plane.to_frame(points)[:, :2])


def _boxes(lows: Array, highs: Array) -> tuple[Array, Indices]:
    """Bounds of every 8 segments, of every 8 of those, and so on to one: neighbours along a curve are near anyway.

    Returns:
        rows (least u, least v, greatest u, greatest v), level by level, and where each level begins; the last entry
        is the number of rows.
    """
    rows, begins = [], [0]
    while True:
        firsts = np.arange(0, len(lows), _FAN)
        lows, highs = np.minimum.reduceat(lows, firsts), np.maximum.reduceat(highs, firsts)
        rows.append(np.hstack([lows, highs]))
        begins.append(begins[-1] + len(lows))
        if len(lows) == 1:
            return np.concatenate(rows), np.array(begins)


@nb.njit(cache=True, nogil=True)
def _closest_segments(
    points: Array, starts: Array, stops: Array, boxes: Array, levels: Indices
) -> tuple[Indices, Array]:
    """For each point the nearest of the segments and where along it, 0 to 1."""
    top = len(levels) - 2
    segment = np.zeros(len(points), np.int64)
    shares = np.zeros(len(points))
    waiting = np.empty((_DEPTH, 2), np.int64)
    nearest = 0
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        # The point before lies beside: where it rests is a bound that leaves little to search.
        share, best = _along(x, y, starts, stops, nearest)
        waiting[0, 0], waiting[0, 1] = top, 0
        count = 1
        while count:
            count -= 1
            level, node = waiting[count, 0], waiting[count, 1]
            row = levels[level] + node
            aside = max(boxes[row, 0] - x, x - boxes[row, 2], 0.0)
            ahead = max(boxes[row, 1] - y, y - boxes[row, 3], 0.0)
            if aside * aside + ahead * ahead >= best:
                continue
            if level == 0:
                for s in range(_FAN * node, min(_FAN * node + _FAN, len(starts))):
                    at, square = _along(x, y, starts, stops, s)
                    if square < best:
                        nearest, share, best = s, at, square
            else:
                for child in range(_FAN * node, min(_FAN * node + _FAN, levels[level] - levels[level - 1])):
                    waiting[count, 0], waiting[count, 1] = level - 1, child
                    count += 1
        segment[i], shares[i] = nearest, share
    return segment, shares


@nb.njit(cache=True, nogil=True)
def _along(x: float, y: float, starts: Array, stops: Array, s: int) -> tuple[float, float]:
    """Where along segment s the place nearest to (x, y) is, and the square of its distance."""
    ax, ay = starts[s, 0], starts[s, 1]
    dx, dy = stops[s, 0] - ax, stops[s, 1] - ay
    square = dx * dx + dy * dy
    share = 0.0
    if square > 0.0:
        share = min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / square))
    ex, ey = x - ax - share * dx, y - ay - share * dy
    return share, ex * ex + ey * ey
