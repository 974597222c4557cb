"""Booleans: union, difference and intersection of two toolpaths, layer by layer (seed paper, Section 5.2).

Layers belong together where their planes are the same; a layer that one toolpath lacks, or that has no curves there,
means nothing there. So anchor plates may be a toolpath of the few layers that they cover.

Open curves enclose nothing. A union keeps those of both; a difference cuts off what lies inside b of those of a; an
intersection keeps what lies inside the other. One that both have comes once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.toolpath import Curve, Layer, Toolpath

from .outlines import region_within, with_curves, with_layers
from .touching import settled
from .widths import ON_CURVE, check_width, nearest_widths, with_widths

Array = npt.NDArray[np.float64]
Kind = Literal["union", "difference", "intersection"]
Only = Callable[[int, Layer, Layer], bool]

OPERATIONS: dict[Kind, Callable[[BaseGeometry, BaseGeometry], BaseGeometry]] = {
    "union": shapely.union,
    "difference": shapely.difference,
    "intersection": shapely.intersection,
}

SAME_PLANE = 1e-4
"""Planes this near to one another, over the extent of the curves, are the same, mm."""


@dataclass(frozen=True)
class LayerAreas:
    """What a boolean did to a layer.

    Attributes:
        layer: index in the result.
        curves: how many a had there, b had, and the result has.
        areas: enclosed by a, by b and by the result, mm².
        mended: share of the result's area that comes from keeping curves apart, mm² (see `touching.py`).
    """

    layer: int
    curves: tuple[int, int, int]
    areas: tuple[float, float, float]
    mended: float


@dataclass(frozen=True, eq=False)
class BooleanResult:
    """A toolpath made of two.

    Attributes:
        toolpath: layers that did not change are the same objects.
        layers: figures of those in which both had curves and `only` let the boolean happen.
        remarks: a sentence for each layer in which curves were mended, or could not be, or widths were found in
            between.
    """

    toolpath: Toolpath
    layers: tuple[LayerAreas, ...]
    remarks: tuple[str, ...]


@checks_kinds
def union(
    a: Toolpath,
    b: Toolpath,
    only: Only | None = None,
    resolution: float | None = None,
    width: float | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> BooleanResult:
    """What either toolpath encloses: A ∪ B in each layer.

    Args:
        a, b: with the same planes in the layers that both have. The result has the layers of the longer one, `a`
            if they have as many; the other's layers must be among them.
        only: of layer index, layer of a and layer of b, whether the boolean happens there; otherwise a's layer
            stays as it is. E.g. `lambda i, p, q: len(p.curves) == 2`.
        resolution: L_R with which the result will be reconstructed, mm; default the layer thickness. Where curves
            come nearer than 0.001 L_R and cannot be reconstructed, they are joined (parted in a difference or an
            intersection), which is reported.
        width: of the bead where a curve has none of its own, mm. Without it those stretches of a new curve that run
            along such curves, where others of it have widths, take them from there, which is reported.
        progress: is told the share done, 0 to 1, after each layer.
        executor: works on layers side by side.

    Returns:
        new curves interior left. Curves that survive are the same objects. New ones keep the bead widths of the
        curves that they were made from (`widths.py`); if none of these has any, they have none.

    Raises:
        ToolpathError: a layer without a counterpart; closed curves that cross or enclose nothing on their left; a
            resolution or width that is not above 0.
    """
    return _boolean("union", a, b, only, resolution, width, progress, executor)


@checks_kinds
def difference(
    a: Toolpath,
    b: Toolpath,
    only: Only | None = None,
    resolution: float | None = None,
    width: float | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> BooleanResult:
    """What toolpath a encloses and b does not: A − B in each layer, in the layers of a. Else as `union`."""
    return _boolean("difference", a, b, only, resolution, width, progress, executor)


@checks_kinds
def intersection(
    a: Toolpath,
    b: Toolpath,
    only: Only | None = None,
    resolution: float | None = None,
    width: float | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> BooleanResult:
    """What both toolpaths enclose: A ∩ B in each layer, in the layers of a. Else as `union`."""
    return _boolean("intersection", a, b, only, resolution, width, progress, executor)


def _boolean(
    kind: Kind,
    a: Toolpath,
    b: Toolpath,
    only: Only | None,
    resolution: float | None,
    width: float | None,
    progress: Callable[[float], None] | None,
    executor: Executor | None,
) -> BooleanResult:
    step = a.thickness if resolution is None else float(resolution)
    if not step > 0 or not np.isfinite(step):
        raise ToolpathError(f"the resolution must be above 0 mm, not {resolution}")
    width = check_width(width)
    mine, theirs = counterparts(a, b)
    frame = a if kind != "union" or len(a.layers) >= len(b.layers) else b
    layers: list[Layer] = []
    calls = []
    for i, plain in enumerate(frame.layers):
        empty = plain if not plain.curves else replace(plain, curves=())
        here = plain if frame is a else mine.get(i, empty)
        there = theirs.get(i, empty) if frame is a else plain
        if only is not None and not only(i, here, there):
            layers.append(with_curves(plain, _carried(here, plain)))
            continue
        layers.append(plain)
        calls.append((kind, _carried(here, plain), _carried(there, plain), step, width, i))
    worker = map if executor is None else executor.map
    figures, remarks = [], []
    for done, (call, (made, areas, said)) in enumerate(zip(calls, worker(_of_layer, calls), strict=True)):
        _, here_curves, there_curves, *_, i = call
        sources = (*here_curves, *there_curves)
        # Workers name the curves that survive by number: what comes back from another process is a copy.
        layers[i] = with_curves(layers[i], [sources[c] if isinstance(c, int) else c for c in made])
        figures += [areas] if here_curves and there_curves else []
        remarks += said
        if progress is not None:
            progress((done + 1) / len(calls))
    return BooleanResult(with_layers(frame, layers), tuple(figures), tuple(remarks))


def counterparts(a: Toolpath, b: Toolpath) -> tuple[dict[int, Layer], dict[int, Layer]]:
    """For two toolpaths with the same planes: of each layer of the longer one, by index, the other's layer there.

    Returns:
        layers of a for the indices of b, and layers of b for those of a; where one toolpath is the shorter, only it
        must be found whole in the other.

    Raises:
        ToolpathError: a layer with curves has no counterpart; names the first one.
    """
    longer, shorter = (a, b) if len(a.layers) >= len(b.layers) else (b, a)
    found: list[tuple[int, int]] = []
    after = 0
    for j, layer in enumerate(shorter.layers):
        order = [*([j] if j >= after else []), *range(after, len(longer.layers))]
        k = next((k for k in order if _apart(layer, longer.layers[k]) <= SAME_PLANE), None)
        if k is not None:
            found.append((k, j))
            after = k + 1
        elif layer.curves:
            gaps = [_apart(layer, other) for other in longer.layers[after:]]
            nearest = after + int(np.argmin(gaps)) if gaps else len(longer.layers)
            names = ("second", "first") if shorter is b else ("first", "second")
            what = (
                f"layer {nearest} of the {names[1]} comes nearest, {gaps[nearest - after]:.6g} mm off"
                if gaps
                else f"the {names[1]} has no layers left there"
            )
            raise ToolpathError(
                f"layer {j} of the {names[0]} toolpath has no layer with the same planes in the {names[1]}: {what}; "
                "slice both with the same planes"
            )
    of_shorter = {k: shorter.layers[j] for k, j in found}
    of_longer = {j: longer.layers[k] for k, j in found}
    return (of_longer, of_shorter) if longer is a else (of_shorter, of_longer)


def _apart(a: Layer, b: Layer) -> float:
    """How far the planes of two layers are apart where the curves are, mm; frames may differ if both do alike."""
    points = np.concatenate([curve.points for curve in (*a.curves, *b.curves)] or [np.zeros((1, 2))])
    low, high = points.min(axis=0) - 1.0, points.max(axis=0) + 1.0
    corners = np.array([low, high, [low[0], high[1]]])
    seen = [x.to_frame(y.to_world(corners)) for x, y in ((a.slicing, b.slicing), (a.nozzle, b.nozzle))]
    upright = float(a.nozzle.normal @ b.nozzle.normal) > 0
    slip = float(np.abs(seen[0][:, :2] - seen[1][:, :2]).max())
    return max(slip, *(float(np.abs(there[:, 2]).max()) for there in seen)) if upright else np.inf


def _carried(layer: Layer, onto: Layer) -> tuple[Curve, ...]:
    """The curves of a layer in the frame of another one with the same planes; the same objects if that is the same."""

    def carried(points: Array) -> Array:
        return onto.nozzle.to_frame(layer.nozzle.to_world(points))[:, :2]

    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    if layer is onto or np.abs(carried(corners) - corners).max() <= 1e-9:
        return layer.curves
    return tuple(replace(curve, points=carried(curve.points)) for curve in layer.curves)


def _of_layer(
    call: tuple[Kind, Sequence[Curve], Sequence[Curve], float, float | None, int],
) -> tuple[list[int | Curve], LayerAreas, list[str]]:
    kind, a, b, step, width, i = call
    where = f"layer {i}"
    sources = (*a, *b)
    if not a or not b:
        kept = len(a) if kind == "difference" else len(sources) if kind == "union" else 0
        return list(range(kept)), LayerAreas(i, (len(a), len(b), kept), (0.0, 0.0, 0.0), 0.0), []
    A = region_within(a, f"{where} of the first toolpath")
    B = region_within(b, f"{where} of the second toolpath")
    with np.errstate(all="ignore"):  # GEOS leaves flags of its own
        made = settled(OPERATIONS[kind](A, B), step, "join" if kind == "union" else "part", where, sources)
        lines = _open_curves(kind, a, b, A, B)
    closed, said = with_widths(made.curves, [curve for curve in sources if curve.closed], width, where)
    index = {id(curve): k for k, curve in enumerate(sources)}
    curves = (*closed, *lines)
    areas = LayerAreas(
        i,
        (len(a), len(b), len(curves)),
        (A.area, B.area, sum(curve.signed_area for curve in made.curves)),
        made.mended,
    )
    old = sorted(index[id(curve)] for curve in curves if id(curve) in index)
    new = [curve for curve in curves if id(curve) not in index]
    return [*old, *new], areas, [*filter(None, (made.remark, said))]


def _open_curves(
    kind: Kind, a: Sequence[Curve], b: Sequence[Curve], A: BaseGeometry, B: BaseGeometry
) -> list[Curve]:
    mine, theirs = ([curve for curve in curves if not curve.closed] for curves in (a, b))
    if kind == "union":
        return _without_doubles(mine, theirs)
    if kind == "difference":
        return [part for curve in mine for part in _clipped(curve, shapely.difference, B)]
    return _without_doubles(
        *(
            [part for curve in curves for part in _clipped(curve, shapely.intersection, region)]
            for curves, region in ((mine, B), (theirs, A))
        )
    )


def _without_doubles(mine: Sequence[Curve], theirs: Sequence[Curve]) -> list[Curve]:
    """Open curves of both toolpaths; those of b that a has as well, whichever way they run, are left out."""
    lines = [shapely.LineString(curve.points) for curve in mine]
    new = [c for c in theirs if not any(line.equals(shapely.LineString(c.points)) for line in lines)]
    return [*mine, *new]


def _clipped(
    curve: Curve, operation: Callable[[BaseGeometry, BaseGeometry], BaseGeometry], region: BaseGeometry
) -> list[Curve]:
    """The parts of an open curve that are left, in its direction."""
    line = shapely.LineString(curve.points)
    left = operation(line, region)
    if left.equals(line):
        return [curve]
    merged = shapely.line_merge(left, directed=True) if left.geom_type == "MultiLineString" else left
    parts = []
    for part in shapely.get_parts(merged):
        points = shapely.get_coordinates(part)
        if part.geom_type == "LineString" and part.length > ON_CURVE:
            width = None if curve.width is None else nearest_widths(points, [curve])
            parts.append(Curve(points, closed=False, width=width))
    return sorted(parts, key=lambda part: float(line.project(shapely.Point(part.points[0]))))
