"""Variable bead width: where runs lie further apart or closer than a bead is wide, beads share the room there is.

The nozzle lays beads of w_min to w_max. Two runs at distance d are side by side without gap or overlap where half the
one width and half the other add up to d. On each side of each point the nearest place of another run is such a
neighbour (`close_points.py`), or of its own curve where that comes back; one that is further than w_max is none, as no
bead reaches it. Starting from the nominal width, every point takes its part of what is missing or too much, over and
over, so widths change no more than they need to; after each round they are brought to the nozzle's range and to a
largest rate of change along the curve.

What this does is measured by areas, from the shapes of the beads:

- printed: Σ width · length, times the layer's height the volume that flows out;
- covered: the area that beads cover together;
- overlap: printed - covered, for which there is no room in the layer;
- gap: what lies between runs that are nearer than w_max to one another (the curves widened by w_max / 2 and drawn back
  by as much) and is not covered. It does not depend on the widths chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Final, Literal

import numba as nb
import numpy as np
import numpy.typing as npt
from shapely.geometry.base import BaseGeometry

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.extrusion import QUAD_SEGS, bead_region
from twins.toolpath import Curve, Layer, Toolpath

from .close_points import ALONG, SAMPLES, Runs, nearest_runs, places
from .dividing import Locks, divided_layers
from .overfill import each_layer

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
Gaps = Literal["both", "inside", "none"]

_SHARE: Final = 0.7  # of what is missing at a point that it takes in a round
_ROUNDS: Final = 60
_SAME: Final = 1e-6  # mm; widths closer to what they were count as unchanged


@dataclass(frozen=True)
class BeadCover:
    """What the beads of a layer, or of several, cover: areas in mm², as at the head of this file."""

    printed: float
    covered: float
    overlap: float
    gap: float

    @classmethod
    def total(cls, layers: Sequence[BeadCover]) -> BeadCover:
        """Of several layers together."""
        return cls(
            *(
                sum(getattr(layer, name) for layer in layers)
                for name in ("printed", "covered", "overlap", "gap")
            )
        )


@dataclass(frozen=True)
class LayerWidths:
    """What variable width did to one layer.

    Attributes:
        before, after: what its beads cover.
        narrowest, widest: of its beads, mm; infinite and 0 if it has none.
        steepest: the largest change of width along a curve, mm per mm.
    """

    before: BeadCover
    after: BeadCover
    narrowest: float
    widest: float
    steepest: float


@dataclass(frozen=True, eq=False)
class WidthVariation:
    """A toolpath whose beads share the room between them, and what it took.

    Attributes:
        toolpath: curves whose width did not change are the same objects as before.
        layers: figures of each layer.
    """

    toolpath: Toolpath
    layers: tuple[LayerWidths, ...]

    @property
    def before(self) -> BeadCover:
        """What the beads of all layers covered."""
        return BeadCover.total([layer.before for layer in self.layers])

    @property
    def after(self) -> BeadCover:
        """What the beads of all layers cover."""
        return BeadCover.total([layer.after for layer in self.layers])


@checks_kinds
def vary_width(
    toolpath: Toolpath,
    w_min: float,
    w_max: float,
    width: float,
    locked: Locks = None,
    *,
    gaps: Gaps = "both",
    rate: float = 0.2,
    progress: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> WidthVariation:
    """Choose bead widths along curves so that gaps between runs close and overfill is relieved.

    Curves whose width varies are divided into segments of at most a quarter of `width`; every vertex stays. Where a
    point has no neighbour within w_max it keeps its width, but for the transition to where it has one.

    Args:
        toolpath: open or closed curves.
        w_min, w_max: bead widths that the nozzle can lay, mm.
        width: nominal bead width where a curve has none of its own, mm. Widths of their own are where a curve starts
            from, brought into the range.
        locked: points that keep their width, as in `relieve_overfill`; the rate may be exceeded beside them.
        gaps: which gaps beads grow into: "inside" for those on the left of a curve, where the interior is, "none" to
            relieve overfill only.
        rate: the largest change of width along a curve, mm per mm.
        progress: is told the share of layers done.
        executor: works on layers side by side.

    Raises:
        ToolpathError: an argument is out of its range, or locks do not fit the layers, curves or points.
    """
    if not 0.0 < w_min <= w_max < np.inf:
        raise ToolpathError(f"a nozzle's widths must be above 0 and ascend, not {w_min} and {w_max} mm")
    if not w_min <= width <= w_max:
        raise ToolpathError(
            f"the nominal width must be one that the nozzle can lay, {w_min} to {w_max} mm, not {width}"
        )
    if not 0.0 < rate < np.inf:
        raise ToolpathError(f"the largest rate of change of the width must be above 0, not {rate}")
    if gaps not in ("both", "inside", "none"):
        raise ToolpathError(f"gaps are closed 'both', 'inside' or 'none', not {gaps!r}")
    finer, stay = divided_layers(toolpath, width / SAMPLES, locked)
    jobs = [
        (coarse.curves, layer.curves, flags, float(w_min), float(w_max), float(width), gaps, float(rate))
        for coarse, layer, flags in zip(toolpath.layers, finer, stay, strict=True)
    ]
    results = each_layer(_vary_layer, jobs, progress, executor)
    layers = tuple(
        _with_widths(layer, divisions.curves, widths)
        for layer, divisions, (widths, _) in zip(toolpath.layers, finer, results, strict=True)
    )
    if any(new is not old for new, old in zip(layers, toolpath.layers, strict=True)):
        toolpath = replace(toolpath, layers=layers)
    return WidthVariation(toolpath, tuple(figures for _, figures in results))


def bead_cover(curves: Sequence[Curve], width: float, w_max: float) -> BeadCover:
    """What the beads of a layer's curves cover, mm²; gaps are those between runs nearer than `w_max`.

    Args:
        curves: of a layer.
        width: where a curve has none of its own, mm.
        w_max: mm.
    """
    return _cover(curves, width, _between(curves, w_max))


def _between(curves: Sequence[Curve], w_max: float) -> BaseGeometry:
    """What lies between runs nearer than `w_max` to one another, and next to nothing else."""
    # Drawn a little wider, so that runs exactly w_max apart count.
    wide = bead_region([replace(curve, width=None) for curve in curves], w_max, 1e-6 * w_max)
    return wide.buffer(-0.5 * w_max, quad_segs=QUAD_SEGS)


def _cover(curves: Sequence[Curve], width: float, between: BaseGeometry) -> BeadCover:
    if not curves:
        return BeadCover(0.0, 0.0, 0.0, 0.0)
    printed = ends = 0.0
    for curve in curves:
        widths = np.full(len(curve.points), float(width)) if curve.width is None else curve.width
        points = np.vstack([curve.points, curve.points[:1]]) if curve.closed else curve.points
        around = np.append(widths, widths[0]) if curve.closed else widths
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        printed += float(lengths @ (0.5 * (around[1:] + around[:-1])))
        if not curve.closed:
            ends += float(np.pi / 8.0 * (widths[0] ** 2 + widths[-1] ** 2))
    region = bead_region(curves, width, 0.0)
    covered = float(region.area)
    # The rounded ends of open beads are covered, but no width times length.
    overlap = max(printed + ends - covered, 0.0)
    return BeadCover(printed, covered, overlap, float(between.difference(region).area))


def _with_widths(layer: Layer, finer: Sequence[Curve], widths: Sequence[Array | None]) -> Layer:
    """A layer with the curves whose width varies put in their places."""
    if all(varied is None for varied in widths):
        return layer
    curves = zip(layer.curves, finer, widths, strict=True)
    return replace(
        layer,
        curves=tuple(old if varied is None else replace(new, width=varied) for old, new, varied in curves),
    )


def _vary_layer(
    coarse: Sequence[Curve],
    curves: Sequence[Curve],
    stay: Sequence[Flags],
    w_min: float,
    w_max: float,
    width: float,
    gaps: Gaps,
    rate: float,
) -> tuple[list[Array | None], LayerWidths]:
    """New widths of the curves where they vary, None for the others; and the layer's figures."""
    between = _between(coarse, w_max)
    before = _cover(coarse, width, between)
    if not curves:
        return [], LayerWidths(before, before, np.inf, 0.0, 0.0)
    runs = Runs.of(curves)
    start = np.concatenate(
        [np.full(len(curve.points), width) if curve.width is None else curve.width for curve in curves]
    )
    free = ~np.concatenate(stay)
    _, *away, left, right = nearest_runs(runs, w_max * (1.0 + 1e-9), ALONG * w_min)
    sides = np.column_stack([left, right])
    grows = np.array([gaps != "none", gaps == "both"])
    shares = _shares(runs.points, runs.following, sides)
    place, total = places(runs.points, runs.following, runs.starts)
    widths = _shared(
        start, free, np.column_stack(away), sides, shares, grows, runs.following, runs.starts, runs.closed,
        place, total, w_min, w_max, rate,
    )  # fmt: skip
    varied: list[Array | None] = []
    final = []
    steepest = 0.0
    for c, (a, b) in enumerate(zip(runs.starts[:-1], runs.starts[1:], strict=True)):
        curve, new = curves[c], widths[a:b]
        changed = bool((np.abs(new - start[a:b]) > _SAME).any())
        varied.append(new if changed else None)
        final.append(replace(curve, width=new) if changed else curve)
        steepest = max(steepest, _steepest(widths, place, total[c], a, b, bool(curve.closed)))
    after = _cover(final, width, between) if any(v is not None for v in varied) else before
    return varied, LayerWidths(before, after, float(widths.min()), float(widths.max()), steepest)


def _steepest(widths: Array, place: Array, total: float, a: int, b: int, closed: bool) -> float:
    along, wide = place[a:b], widths[a:b]
    if closed:
        along, wide = np.append(along, total), np.append(wide, wide[0])
    ahead = np.diff(along)
    return float((np.abs(np.diff(wide))[ahead > 0.0] / ahead[ahead > 0.0]).max(initial=0.0))


@nb.njit(cache=True, nogil=True)
def _shares(points: Array, following: Indices, sides: Indices) -> Array:
    """Where along each neighbouring segment the place nearest to a point lies, shape (n, 2)."""
    shares = np.zeros(sides.shape)
    for i in range(len(points)):
        for side in range(2):
            j = sides[i, side]
            if j >= 0:
                k = following[j]
                bx, by = points[k, 0] - points[j, 0], points[k, 1] - points[j, 1]
                along = (points[i, 0] - points[j, 0]) * bx + (points[i, 1] - points[j, 1]) * by
                square = bx * bx + by * by
                shares[i, side] = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
    return shares


@nb.njit(cache=True, nogil=True)
def _shared(
    start: Array,
    free: Flags,
    away: Array,
    sides: Indices,
    shares: Array,
    grows: Flags,
    following: Indices,
    starts: Indices,
    closed: Flags,
    place: Array,
    total: Array,
    w_min: float,
    w_max: float,
    rate: float,
) -> Array:
    """Widths after all rounds."""
    n = len(start)
    widths = np.empty(n)
    for i in range(n):
        widths[i] = min(max(start[i], w_min), w_max) if free[i] else start[i]
    wanted = np.empty(n)
    for _ in range(_ROUNDS):
        for i in range(n):
            missing, count = 0.0, 0
            for side in range(2):
                j = sides[i, side]
                if j >= 0:
                    beside = widths[j] + shares[i, side] * (widths[following[j]] - widths[j])
                    lacks = away[i, side] - 0.5 * (widths[i] + beside)
                    if lacks < 0.0 or grows[side]:
                        missing += lacks
                        count += 1
            wanted[i] = widths[i]
            if free[i] and count > 0:
                wanted[i] = min(max(widths[i] + _SHARE * missing / count, w_min), w_max)
        for c in range(len(starts) - 1):
            _limit_rate(wanted, widths, place, total[c], starts[c], starts[c + 1], closed[c], rate)
        for i in range(n):
            if not free[i]:
                widths[i] = start[i]
    return widths


@nb.njit(cache=True, nogil=True)
def _limit_rate(
    wanted: Array, widths: Array, place: Array, total: float, a: int, b: int, closed: bool, rate: float
) -> None:
    """Put into `widths` those of one curve that change at most at a rate, as near as can be to those wanted.

    That is the middle between the largest such function below them and the smallest above.
    """
    low = wanted[a:b].copy()
    high = wanted[a:b].copy()
    m = b - a
    for back in range(2):
        # Twice around a closed curve, so that every point has seen all the others.
        for step in range(1, 2 * m if closed else m):
            i = step % m if not back else (2 * m - 1 - step) % m
            j = (i - 1) % m if not back else (i + 1) % m
            gap = abs(place[a + i] - place[a + j])
            change = rate * (min(gap, total - gap) if closed else gap)
            low[i] = min(low[i], low[j] + change)
            high[i] = max(high[i], high[j] - change)
    for i in range(m):
        widths[a + i] = 0.5 * (low[i] + high[i])
