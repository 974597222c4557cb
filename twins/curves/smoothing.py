"""Smoothing of curves with a side and a curvature constraint (seed paper, Section 4.1, equations 1 to 3).

Sharp turns become arcs no sharper than κ_max, by shifting what is sharper and nothing else. Where one side of the
curves is locked (a void has to stay open, a face has to stay in its place), no place of the result, at a point or
between points, is on that side of the curve as it was.

The steps are in `smoothing_step.py` (the paper's), `smoothing_loop.py` and `guarded_moves.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt
import shapely

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.toolpath import Curve, Layer, Toolpath

from .smoothing_loop import FEWEST, relax
from .turning import curvature, largest_turning
from .zones import Flags, Zones

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

_ROOM = 4  # points a layer may have at most while it is smoothed, over those that it began with
_EASED = (1.1, 1.25, 1.5, 2.0)  # over κ_max: tried one after the other on a curve that has no room for κ_max


@dataclass(frozen=True)
class SmoothedLayer:
    """What smoothing did to a layer.

    Attributes:
        steps: made; fewer than allowed where the layer was done.
        largest_curvature_before, largest_curvature: by equation (3), 1/mm; points that are protected count too.
        largest_turning_before, largest_turning: within the window, rad.
        largest_displacement: of a point of a curve, before or after, from the other curve, mm.
        area_change: of the region enclosed, mm²; open curves enclose none.
        held: points that the last step would have moved and could not: for the side, or for another curve.
        remaining: points above κ_max at the end, without the protected ones.
        eased: curves that have no room for κ_max (they would have shrunk to nothing, become more bent or grown
            without end), and the curvature that they were smoothed to instead, 1/mm: at most twice κ_max.
        left_alone: curves that have no room for twice κ_max either, and stay as they were.
        unfinished: curves that have points above what they were smoothed to, as steps ran out or nothing moved any
            more; points that are protected do not count.
    """

    steps: int
    largest_curvature_before: float
    largest_curvature: float
    largest_turning_before: float
    largest_turning: float
    largest_displacement: float
    area_change: float
    held: int
    remaining: int
    eased: tuple[tuple[int, float], ...]
    left_alone: tuple[int, ...]
    unfinished: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A smoothed toolpath.

    Attributes:
        toolpath: layers and curves in which nothing moved are the same objects.
        layers: figures of each layer.
        window: length that turning is summed over, mm.
    """

    toolpath: Toolpath
    layers: tuple[SmoothedLayer, ...]
    window: float

    @property
    def held(self) -> int:
        """Points held in all layers."""
        return sum(layer.held for layer in self.layers)


@dataclass(frozen=True)
class _Settings:
    side: int
    max_curvature: float
    steps: int
    strengths: tuple[float, float]
    min_segment: float | None
    window: float
    rolled: bool


@checks_kinds
def smooth(
    toolpath: Toolpath,
    side: Literal[-1, 0, 1],
    max_curvature: float,
    *,
    steps: int = 10_000,
    strength: float = 1.0,
    adjustment: float = 0.05,
    min_segment: float | None = None,
    fillet: Literal["rolled", "flipped"] = "rolled",
    window: float | None = None,
    locked: Zones | None = None,
    progress: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> Smoothed:
    """Round what is bent more sharply than `max_curvature`.

    Args:
        toolpath: open or closed curves of equal or similar segments (`resample`), shorter than 1 / `max_curvature`.
            Ends of open curves stay. What the curves are here is what the side is locked against.
        side: 1 where curves may move to their left (the interior) only, -1 to their right only, 0 either way.
        max_curvature: κ_max, 1/mm, measured by equation (3). A curve that is nowhere above it stays as it is. At
            segments l it makes a curve turn by about κ_max (d + l) or less within a length d. A curve that has no
            room for it gets up to twice of it, in steps (`SmoothedLayer.eased`), or stays as it is.
        steps: n_smooth, at most; a curve is done sooner, most within 300 to 1500 steps. "flipped" is for 10 to 50.
        strength: s_0 of equation (1), in (0, 1].
        adjustment: s_1, for "flipped" only.
        min_segment: ℓ_min: shorter segments collapse, mm; default a quarter of a layer's mean.
        fillet: how a point is rounded that the locked side holds: "flipped" as in Algorithm 1 of the paper, meant
            for few steps (it lets fingers grow in many), or "rolled" around a disc (see `smoothing_loop.py`).
        window: length that turning is summed over in the figures, mm; default 1 / `max_curvature`.
        locked: zones, layers and curves that stay to the bit; curves do not move into zones either.
        progress: called with the share done.
        executor: works on layers side by side.

    Raises:
        ToolpathError: an argument out of its range, or a lock on what does not exist.
        PlanesError: slicing planes cross inside a protected solid.
    """
    if side not in (-1, 0, 1):
        raise ToolpathError(f"the permitted side must be 1 (left), -1 (right) or 0 (both), not {side}")
    if fillet not in ("rolled", "flipped"):
        raise ToolpathError(f'fillets are "rolled" or "flipped", not "{fillet}"')
    window = 1.0 / max_curvature if window is None and max_curvature > 0 else window
    for what, value in (
        ("largest curvature", max_curvature),
        ("strength", strength),
        ("adjustment", adjustment),
        ("least length of segments", 1.0 if min_segment is None else min_segment),
        ("window of the turning", window),
        ("number of steps", steps),
    ):
        if value is None or not 0 < value < math.inf:
            raise ToolpathError(f"the {what} must be above 0, not {value}")
    if strength > 1 or adjustment > 1:
        raise ToolpathError(f"strengths must be at most 1, not {strength} and {adjustment}")
    settings = _Settings(
        side,
        max_curvature,
        int(steps),
        (strength, adjustment),
        min_segment,
        float(window or 0.0),
        fillet == "rolled",
    )
    count = len(toolpath.layers)
    flags = locked.protected(toolpath) if locked is not None else [None] * count
    regions = locked.regions(toolpath) if locked is not None else [None] * count
    each = (executor.map if executor is not None else map)(
        _smoothed_layer, toolpath.layers, flags, regions, [settings] * count
    )
    layers, figures = [], []
    for i, (old, (made, figure)) in enumerate(zip(toolpath.layers, each, strict=True)):
        curves = tuple(a if b is None else b for a, b in zip(old.curves, made, strict=True))
        layers.append(old if all(b is None for b in made) else replace(old, curves=curves))
        figures.append(figure)
        if progress is not None:
            progress((i + 1) / count)
    new = toolpath if all(a is b for a, b in zip(toolpath.layers, layers, strict=True)) else None
    return Smoothed(new or replace(toolpath, layers=tuple(layers)), tuple(figures), settings.window)


def _smoothed_layer(
    layer: Layer, flags: tuple[Flags, ...] | None, region: shapely.Geometry | None, settings: _Settings
) -> tuple[tuple[Curve | None, ...], SmoothedLayer]:
    """New curves, None for those that stay, and the figures."""
    curves = layer.curves
    fixed = [np.zeros(len(c.points), np.bool_) if flags is None else flags[j] for j, c in enumerate(curves)]
    limits = np.full(len(curves), settings.max_curvature)
    tries = np.zeros(len(curves), np.int64)
    before = [largest_turning(curve, settings.window) for curve in curves]
    kept = flags or (None,) * len(curves)
    # Protected points may be as sharp as they are; what matters is whether the others get any sharper.
    sharpest = [
        largest_turning(curve, settings.window, _unprotected(curve, curve, keep))
        for curve, keep in zip(curves, kept, strict=True)
    ]
    made: tuple[Curve | None, ...] = (None,) * len(curves)
    steps = held = 0
    while curves:
        made, steps, held = _relaxed(curves, fixed, region, limits, settings)
        worse = [
            j
            for j, new in enumerate(made)
            if new is not None
            and (
                largest_turning(new, settings.window, _unprotected(curves[j], new, kept[j]))
                > max(sharpest[j], _turning_at(limits[j], new, settings)) + 1e-9
                or (new.closed and len(new.points) <= FEWEST < len(curves[j].points))
            )
        ]
        grown = [0 if b is None else len(b.points) - len(a.points) for a, b in zip(curves, made, strict=True)]
        if sum(grown) >= (_ROOM - 1) * sum(len(curve.points) for curve in curves):
            worse = sorted({*worse, int(np.argmax(grown))})
        if not worse:
            break
        # Their neighbours may have taken the room that they left, so all begin again.
        for j in worse:
            tries[j] += 1
            if tries[j] <= len(_EASED):
                limits[j] = _EASED[tries[j] - 1] * settings.max_curvature
            else:
                fixed[j] = np.ones(len(curves[j].points), np.bool_)
    after = [old if new is None else new for old, new in zip(curves, made, strict=True)]
    alone = tries > len(_EASED)
    sharp = [_remaining(*each) for each in zip(curves, after, kept, limits, strict=True)]
    wanted = [settings.max_curvature] * len(curves)
    return made, SmoothedLayer(
        steps=steps,
        largest_curvature_before=_sharpest(curves),
        largest_curvature=_sharpest(after),
        largest_turning_before=max(before, default=0.0),
        largest_turning=max((largest_turning(curve, settings.window) for curve in after), default=0.0),
        largest_displacement=max(
            (_distance(a, b) for a, b in zip(curves, made, strict=True) if b is not None), default=0.0
        ),
        area_change=sum(curve.signed_area for curve in after) - sum(curve.signed_area for curve in curves),
        held=held,
        remaining=sum(_remaining(*each) for each in zip(curves, after, kept, wanted, strict=True)),
        eased=tuple((j, float(limits[j])) for j in np.flatnonzero((tries > 0) & ~alone).tolist()),
        left_alone=tuple(np.flatnonzero(alone).tolist()),
        unfinished=tuple(j for j, count in enumerate(sharp) if count and not alone[j]),
    )


def _turning_at(limit: float, curve: Curve, settings: _Settings) -> float:
    """What a curve at κ_max turns by at most within the window: one segment more than it holds may count."""
    return limit * (settings.window + curve.length / len(curve.points))


def _sharpest(curves: Sequence[Curve]) -> float:
    return max((float(curvature(curve.points, curve.closed).max()) for curve in curves), default=0.0)


def _remaining(old: Curve, new: Curve, protected: Flags | None, limit: float) -> int:
    """Points above a curvature, without the protected ones."""
    return int(
        (_unprotected(old, new, protected) & (curvature(new.points, new.closed) > limit * (1.0 + 1e-9))).sum()
    )


def _unprotected(old: Curve, new: Curve, protected: Flags | None) -> Flags:
    """Points of the new curve that are no protected point of the old one."""
    if protected is None or not protected.any():
        return np.ones(len(new.points), np.bool_)
    kept = {tuple(point) for point in old.points[protected]}
    return np.array([tuple(point) not in kept for point in new.points], dtype=np.bool_)


def _distance(old: Curve, new: Curve) -> float:
    """Largest distance of a point of either curve from the other curve."""
    lines = [
        shapely.LineString(np.vstack([c.points, c.points[:1]]) if c.closed else c.points) for c in (old, new)
    ]
    ways = (
        shapely.distance(shapely.points(new.points), lines[0]),
        shapely.distance(shapely.points(old.points), lines[1]),
    )
    return float(max(way.max() for way in ways))


def _relaxed(
    curves: tuple[Curve, ...],
    fixed: list[Flags],
    region: shapely.Geometry | None,
    limits: Array,
    settings: _Settings,
) -> tuple[tuple[Curve | None, ...], int, int]:
    """One run of the loop over a layer: new curves (None: nothing moved), steps made, points held."""
    sizes = [len(curve.points) for curve in curves]
    rims = _rims(region)
    ends = np.cumsum([0, *sizes])
    given, count = ends[-1], int(ends[-1]) + sum(len(rim) for rim in rims)
    room = count + (_ROOM - 1) * int(given)
    points, value, limit = np.zeros((room, 2)), np.zeros(room), np.ones(room)
    before, after = np.full(room, -2), np.full(room, -2)
    owner, still = np.zeros(room, np.int64), np.zeros(room, np.bool_)
    parts = [(c.points, c.closed, c.width, f) for c, f in zip(curves, fixed, strict=True)]
    parts += [(rim, True, None, np.ones(len(rim), np.bool_)) for rim in rims]
    first = 0
    for j, (places, closed, width, flags) in enumerate(parts):
        here = np.arange(first, first + len(places))
        points[here], owner[here], still[here] = places, j, flags
        before[here], after[here] = np.roll(here, 1), np.roll(here, -1)
        value[here] = 0.0 if width is None else width
        limit[here] = limits[j] if j < len(curves) else settings.max_curvature
        if not closed:
            before[here[0]] = after[here[-1]] = -1
            still[here[[0, -1]]] = True
        first += len(places)
    mean = sum(curve.length for curve in curves) / sum(sizes)
    shortest = 0.25 * mean if settings.min_segment is None else settings.min_segment
    count, steps, held = relax(
        points, before, after, owner, still, value, limit, count, settings.side, settings.strengths,
        mean, shortest, settings.steps, settings.rolled,
    )  # fmt: skip
    made = []
    for j, curve in enumerate(curves):
        order = _in_order(after, owner, count, j)
        width = None if curve.width is None else value[order]
        same = len(order) == sizes[j] and np.array_equal(points[order], curve.points)
        made.append(None if same else Curve(points[order], curve.closed, width))
    return tuple(made), steps, int(held.sum())


def _rims(region: shapely.Geometry | None) -> list[Array]:
    if region is None or shapely.is_empty(region):
        return []
    polygons = [g for g in shapely.get_parts(region) if isinstance(g, shapely.Polygon)]
    return [shapely.get_coordinates(ring)[:-1] for p in polygons for ring in (p.exterior, *p.interiors)]


def _in_order(after: Indices, owner: Indices, count: int, j: int) -> Indices:
    """Points of curve j as they follow one another, from the first that is left (of an open curve, its end)."""
    order = [int(np.flatnonzero((owner[:count] == j) & (after[:count] != -2))[0])]
    while after[order[-1]] >= 0 and after[order[-1]] != order[0]:
        order.append(int(after[order[-1]]))
    return np.array(order, dtype=np.int64)
