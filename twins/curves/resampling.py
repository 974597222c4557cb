"""Resampling: curves of equal segments, for optimisations that work point by point (seed paper, Section 4.1)."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.toolpath import Curve, Layer, Toolpath

from .turning import turning_angles
from .zones import Flags, Zones

Array = npt.NDArray[np.float64]

_EVEN = 1e-9
"""Segments that differ by less than this share of their length are equal."""

_MOST_POINTS = 10_000_000  # of one curve


@checks_kinds
def resample(
    toolpath: Toolpath,
    length: float,
    corner_deg: float | None = None,
    locked: Zones | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> Toolpath:
    """Divide each curve into equal parts of at most `length`, measured along the curve.

    New points lie on the old curve, so where it bends between them they cut the bend off; with `corner_deg` they
    do not cut off corners. Widths are carried along, linear between the old points.

    Args:
        toolpath: open or closed curves. A closed curve keeps its first point (or begins at the first of those that
            stay), an open one its ends.
        length: of a part, mm. A curve gets the fewest parts that are not longer, but at least 6 (open: 1). Where
            curves of a layer would cross that did not, that layer gets parts of a half, a quarter, ... of it.
        corner_deg: points where the curve turns by more than this stay, and what is between them is divided into
            equal parts each; None: no corners.
        locked: zones whose points stay, with the segments between them.
        progress: is told the share of layers done.
        executor: works on layers side by side.

    Returns:
        the toolpath; curves that were divided like this before are the same objects.

    Raises:
        ToolpathError: a length or an angle that is not above 0, or so short that a curve gets over ten million points.
    """
    if not length > 0 or not math.isfinite(length):
        raise ToolpathError(f"the length of segments must be above 0 mm, not {length}")
    if corner_deg is not None and not 0 < corner_deg < 180:
        raise ToolpathError(f"the turn that makes a corner must be between 0° and 180°, not {corner_deg}°")
    for i, j, _, curve in toolpath.curves():
        if curve.length > _MOST_POINTS * length:
            raise ToolpathError(
                f"layer {i}, curve {j}: segments of {length:.6g} mm would put more than {_MOST_POINTS} points on "
                f"its {curve.length:.6g} mm; choose longer ones"
            )
    flags = locked.protected(toolpath) if locked is not None else [None] * len(toolpath.layers)
    turn = None if corner_deg is None else math.radians(corner_deg)
    calls = ([*toolpath.layers], [length] * len(flags), [turn] * len(flags), flags)
    layers = (executor.map if executor is not None else map)(_resampled_layer, *calls)
    new = []
    for old, made in zip(toolpath.layers, layers, strict=True):
        new.append(old if all(c is None for c in made) else replace(old, curves=_as_before(old.curves, made)))
        if progress is not None:
            progress(len(new) / len(toolpath.layers))
    return replace(toolpath, layers=tuple(new))


def _as_before(curves: tuple[Curve, ...], made: tuple[Curve | None, ...]) -> tuple[Curve, ...]:
    """None stands for a curve that stays: objects that come back from other processes are copies."""
    return tuple(old if new is None else new for old, new in zip(curves, made, strict=True))


def _resampled_layer(
    layer: Layer, length: float, turn: float | None, flags: tuple[Flags, ...] | None
) -> tuple[Curve | None, ...]:
    locked = flags or [np.zeros(len(curve.points), np.bool_) for curve in layer.curves]
    made: tuple[Curve | None, ...] = ()
    was_simple: bool | None = None
    for finer in (1, 2, 4, 8, 16, 32):
        made = tuple(
            _divided(curve, flag, turn, length / finer)
            for curve, flag in zip(layer.curves, locked, strict=True)
        )
        if all(curve is None for curve in made) or _are_simple(_as_before(layer.curves, made)):
            break
        was_simple = _are_simple(layer.curves) if was_simple is None else was_simple
        if not was_simple:
            break
    return made


def _are_simple(curves: tuple[Curve, ...]) -> bool:
    lines = [
        np.vstack([curve.points, curve.points[:1]]) if curve.closed else curve.points for curve in curves
    ]
    return bool(shapely.MultiLineString(lines).is_simple)


def _divided(curve: Curve, locked: Flags, turn: float | None, length: float) -> Curve | None:
    """A curve with equal parts between the points that stay; None where it has them already."""
    stays = locked.copy()
    if turn is not None:
        stays |= np.abs(turning_angles(curve.points, curve.closed)) > turn
    if not curve.closed:
        stays[[0, -1]] = True
    if not stays.any():
        stays[0] = True
    order = np.arange(len(stays))
    if curve.closed:  # once around, from the first point that stays
        order = np.append(np.roll(order, -int(np.flatnonzero(stays)[0])), np.flatnonzero(stays)[0])
    points, locked = curve.points[order], locked[order]
    place = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    step = min(length, place[-1] / 6.0) if curve.closed else length
    at, exact = [], []
    stops = np.flatnonzero(stays[order])
    for a, b in pairwise(stops):
        rigid = b == a + 1 and locked[a] and locked[b]
        count = 1 if rigid else max(1, math.ceil((place[b] - place[a]) / step - 1e-9))
        at.append(place[a] + (place[b] - place[a]) * np.arange(count) / count)
        exact.append(a)
    if not curve.closed:
        at.append(place[-1:])
        exact.append(stops[-1])
    first = np.cumsum([0, *map(len, at)])[:-1]
    places = np.concatenate(at)
    if len(places) == len(curve.points) and (
        np.abs(places - place[: len(places)]).max() <= _EVEN * place[-1] / len(places)
    ):
        return None
    new = np.column_stack([np.interp(places, place, points[:, k]) for k in range(2)])
    new[first] = points[exact]
    width = None if curve.width is None else np.interp(places, place, curve.width[order])
    return Curve(new, curve.closed, width)
