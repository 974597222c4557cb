"""Curves divided finely enough for a method that works on sample points, and which of those points stay."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from twins.errors import ToolpathError
from twins.toolpath import Curve, Layer, Toolpath

from .zones import Zones

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

LayerLocks = Sequence[npt.ArrayLike | None] | None
"""For each curve of a layer which of its points stay, shape (n,), or None: none of them do."""

Locks = Zones | Callable[[int, Toolpath], LayerLocks] | Sequence[LayerLocks] | None
"""Zones; or the locks of each layer; or a function that gives those of layer i of the toolpath as it is divided."""


def divided(curve: Curve, longest: float) -> tuple[Curve, Indices]:
    """A curve whose segments are no longer than `longest`, each divided equally; and the segment of each point.

    Every vertex stays where it is, so the curve runs where it ran. Widths are linear in between. A curve that is fine
    enough is returned itself.
    """
    points = curve.points
    n = len(points) if curve.closed else len(points) - 1
    ahead = np.roll(points, -1, axis=0)[:n] - points[:n]
    parts = np.maximum(np.ceil(np.linalg.norm(ahead, axis=1) / longest * (1.0 - 1e-9)), 1.0).astype(np.int64)
    if (parts == 1).all():
        return curve, np.arange(len(points))
    segment = np.repeat(np.arange(n), parts)
    step = np.arange(len(segment)) - np.repeat(np.cumsum(parts) - parts, parts)
    t = step / parts[segment]
    finer = points[segment] + t[:, None] * ahead[segment]
    width = curve.width
    if width is not None:
        width = width[segment] + t * (np.roll(width, -1)[:n] - width[:n])[segment]
    if not curve.closed:
        finer, segment = np.vstack([finer, points[-1:]]), np.append(segment, n)
        width = None if width is None or curve.width is None else np.append(width, curve.width[-1])
    return Curve(finer, curve.closed, width), segment


def divided_layers(
    toolpath: Toolpath, longest: float, locked: Locks
) -> tuple[list[Layer], list[list[Flags]]]:
    """Layers of divided curves, and which of their points stay."""
    split = [[divided(curve, longest) for curve in layer.curves] for layer in toolpath.layers]
    layers = [
        replace(layer, curves=tuple(curve for curve, _ in curves))
        for layer, curves in zip(toolpath.layers, split, strict=True)
    ]
    stay: list[list[Flags]] = []
    finer = replace(toolpath, layers=tuple(layers))
    if isinstance(locked, Zones):
        return layers, [list(flags) for flags in locked.protected(finer)]
    if callable(locked):
        for i, layer in enumerate(layers):
            stay.append(_flags(locked(i, finer), layer.curves, i))
        return layers, stay
    if locked is not None and len(locked) != len(layers):
        raise ToolpathError(f"locks are given for {len(locked)} layers, but the toolpath has {len(layers)}")
    for i, (layer, curves) in enumerate(zip(toolpath.layers, split, strict=True)):
        flags = _flags(None if locked is None else locked[i], layer.curves, i)
        stay.append([_with_divisions(f, segment) for f, (_, segment) in zip(flags, curves, strict=True)])
    return layers, stay


def _flags(locks: LayerLocks, curves: Sequence[Curve], layer: int) -> list[Flags]:
    if locks is None:
        return [np.zeros(len(curve.points), dtype=bool) for curve in curves]
    if len(locks) != len(curves):
        raise ToolpathError(
            f"layer {layer}: locks are given for {len(locks)} curves, but it has {len(curves)}"
        )
    flags = []
    for j, (lock, curve) in enumerate(zip(locks, curves, strict=True)):
        flag = np.zeros(len(curve.points), dtype=bool) if lock is None else np.asarray(lock)
        if flag.dtype != np.bool_ or flag.shape != (len(curve.points),):
            raise ToolpathError(
                f"layer {layer}, curve {j}: its lock must be one boolean for each of its {len(curve.points)} points, "
                f"not {flag.dtype} of shape {flag.shape}"
            )
        flags.append(flag)
    return flags


def _with_divisions(flags: Flags, segment: Indices) -> Flags:
    """Locks of a divided curve: a segment with a locked end stays as it is."""
    is_vertex = np.append(True, segment[1:] != segment[:-1])
    either = flags | np.roll(flags, -1)
    return np.where(is_vertex, flags[segment], either[segment])
