"""Wrapping: curves in space, in no order, become a toolpath (seed paper, Section 5.3, Figures 17 and 18).

The planes that curves share are found (`section_planes.py`) and put in order (`stacking.py`); they get the frames of
layers (`layer_frames.py`), and in each the curves are turned so that the interior is on their left
(`interior_left.py`). Layers may have different numbers of curves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from twins.errors import PlanesError, ToolpathError
from twins.planes import PlaneStack
from twins.toolpath import FAR, Curve, Layer, Plane, Toolpath

from .floors import floors_of
from .interior_left import interior_left
from .layer_frames import At, layer_frames
from .resting import hanging
from .section_planes import find_sections
from .space_curve import SpaceCurve
from .stacking import Kind, Stack, stack

Array = npt.NDArray[np.float64]

TOLERANCE = 1e-6
"""How far a point may lie off its layer's plane, as a share of the extent of all curves."""

SAME = 1e-9
"""Points nearer than this share of the extent are one."""


@dataclass(frozen=True, eq=False)
class Wrapped:
    """A toolpath and where its curves come from.

    Attributes:
        toolpath: closed curves have their interior on the left.
        kind: "parallel"; "rotary" where all planes meet in one axis; "custom" where they are tilted freely.
        sources: for each layer and each of its curves, the number of the curve it is.
        as_drawn: numbers of open curves that enclose nothing, and so run as they were drawn: straight ones, and those
            whose ends cannot be joined without crossing something.
        by_open: numbers of closed curves that are holes, or outer ones in holes, only because an open curve around them
            counts as if its ends were joined: a column in the courtyard of an open wall is such a one.
        hanging: numbers of curves with nothing of the layer directly below under them, but something of an earlier
            one: they hang from what is printed later, or have layers of their own.
    """

    toolpath: Toolpath
    kind: Kind
    sources: tuple[tuple[int, ...], ...]
    as_drawn: tuple[int, ...] = ()
    by_open: tuple[int, ...] = ()
    hanging: tuple[int, ...] = ()


def wrap(
    curves: Sequence[SpaceCurve],
    *,
    at: At = "nozzle",
    up: npt.ArrayLike = (0.0, 0.0, 1.0),
    bed: Plane | None = None,
    top: Plane | None = None,
    thickness: float | None = None,
    close_within: float | None = None,
    tolerance: float | None = None,
) -> Wrapped:
    """Put curves in layers.

    Args:
        curves: planar, closed or open, in any order and direction.
        at: whether they lie in the nozzle planes, the tops of the layers, or in the slicing planes, their middles.
            The other planes lie midway between them.
        up: the way the layers follow one another, on average where they are fanned; need not be exact. Shape (3,).
        bed: the base plane, with its frame. Without it the heights of the first layer's curves tell it; where they
            have none, the first layer is as thick as the second.
        top: the last nozzle plane, for curves in the slicing planes. Without it the last layer is as thick as the one
            before, or as the heights of its curves tell.
        thickness: of the first and, for slicing planes, the last layer, where `bed` and `top` do not say it, mm. A
            single layer needs it. With sparse sections, how far the part goes on beyond them is half of it.
        close_within: open curves whose ends are no farther apart are closed, mm; default those whose ends are the
            same point.
        tolerance: how far a point may lie off its layer's plane, mm; default 1e-6 of the extent of all curves.

    Returns:
        layers from the bottom up, each with at least one curve. Frames on a level base have their origin on the world's
        z axis and u along its x axis; otherwise the origin is below the middle of the first layer.
        Open curves stay open, and run as if their ends were joined and the interior were on their left.

    Raises:
        ToolpathError: no curves, a curve that is not planar, a straight curve that lies in no layer's plane or in
            several, and closed curves that cross.
        PlanesError: layers that cross in the part or that are too near to be told apart, are parallel to `up`, reach
            below the bed or above the top, or lie nowhere on the layer directly below but on an earlier one; heights
            that tell no bed; one layer alone without bed, heights and thickness.
    """
    _check(curves, at, top, thickness, close_within, tolerance)
    direction = _unit(up)
    everything = np.concatenate([curve.points for curve in curves])
    low, high = everything.min(axis=0), everything.max(axis=0)
    middle, extent = 0.5 * (low + high), float(np.linalg.norm(high - low))
    if extent == 0.0:
        raise ToolpathError("all points of all curves are the same place; check the unit of the curves")
    allowed = TOLERANCE * extent if tolerance is None else float(tolerance)
    closing = SAME * extent if close_within is None else float(close_within)
    drawn = [_ended(curve, SAME * extent, closing, i) for i, curve in enumerate(curves)]
    # About the middle, so that rounding is that of the part and not that of its place.
    places = [curve.points - middle for curve in drawn]
    found = stack(find_sections(places, allowed), places, direction, allowed, middle)
    sheets = [(s.normal, s.offset + float(s.normal @ middle)) for s in found.sections]
    first, last = (np.concatenate([drawn[i].points for i in found.sections[k].members]) for k in (0, -1))
    centre = 0.5 * (first.min(axis=0) + first.max(axis=0))
    told = bed is not None or thickness is not None
    floors = None if told else floors_of(drawn, found.sections, sheets, at, allowed)
    planes = layer_frames(sheets, at, centre, bed, top, thickness, floors)
    layers, as_drawn, by_open = _layers(drawn, found, planes, at, allowed)
    toolpath = Toolpath(planes.base, layers, planes.thickness)
    _check_ends(toolpath, first, last, at)
    sources = tuple(section.members for section in found.sections)
    return Wrapped(
        toolpath,
        found.kind,
        sources,
        as_drawn,
        by_open,
        hanging(toolpath.layers, sources, toolpath.thickness),
    )


def _check(
    curves: Sequence[SpaceCurve],
    at: At,
    top: Plane | None,
    thickness: float | None,
    close_within: float | None,
    tolerance: float | None,
) -> None:
    if at not in ("nozzle", "slicing"):
        raise ToolpathError(f"curves lie at 'nozzle' or 'slicing' planes, not at {at!r}")
    if not len(curves):
        raise ToolpathError("there are no curves to wrap")
    for i, curve in enumerate(curves):
        if not isinstance(curve, SpaceCurve):
            raise ToolpathError(f"curve {i} must be a SpaceCurve, not a {type(curve).__name__}")
    if top is not None and at == "nozzle":
        raise PlanesError("a top is for curves at 'slicing' planes; at 'nozzle' the last curves are the top")
    for name, value, least in (
        ("thickness", thickness, 1e-3),
        ("tolerance", tolerance, 1e-12),
        ("close_within", close_within, 0.0),
    ):
        if value is not None and not least <= value <= FAR:
            raise ToolpathError(f"`{name}` must be a length between {least:g} mm and 1 km, not {value}")


def _unit(up: npt.ArrayLike) -> Array:
    direction = np.array(up, dtype=np.float64)
    length = float(np.linalg.norm(direction))
    if direction.shape != (3,) or not np.isfinite(length) or length == 0.0:
        raise PlanesError(f"up must be a direction of three numbers that are not all 0, not {up!r}")
    return direction / length


def _ended(curve: SpaceCurve, same: float, closing: float, number: int) -> SpaceCurve:
    """The curve closed if its ends are near, and without a last point that repeats the first."""
    points, widths, heights = curve.points, curve.widths, curve.heights
    gap = float(np.linalg.norm(points[-1] - points[0]))
    closed = curve.closed or (gap <= closing and len(points) > 3)
    if closed and gap <= same:
        points = points[:-1]
        widths, heights = (None if values is None else values[:-1] for values in (widths, heights))
    if len(points) < (3 if closed else 2) or float(np.ptp(points, axis=0).max()) <= same:
        raise ToolpathError(f"curve {number} has too few different points for a curve; leave it out")
    return SpaceCurve(points, closed, widths, heights)


def _layers(
    curves: Sequence[SpaceCurve], found: Stack, planes: PlaneStack, at: At, tolerance: float
) -> tuple[tuple[Layer, ...], tuple[int, ...], tuple[int, ...]]:
    layers: list[Layer] = []
    as_drawn: list[int] = []
    by_open: list[int] = []
    for k, section in enumerate(found.sections):
        slicing, nozzle = planes.slicing[k], planes.nozzle[k]
        plane = nozzle if at == "nozzle" else slicing
        flat = [
            Curve(plane.to_frame(curves[i].points)[:, :2], curves[i].closed, curves[i].widths)
            for i in section.members
        ]
        turned = interior_left(flat, section.members, f"layer {k}", tolerance)
        layers.append(Layer(slicing, nozzle, turned.curves))
        as_drawn += turned.as_drawn
        by_open += turned.by_open
    return tuple(layers), tuple(sorted(as_drawn)), tuple(sorted(by_open))


def _check_ends(toolpath: Toolpath, first: Array, last: Array, at: At) -> None:
    """Curves must lie above the bed and, at slicing planes, below the top; in between the planes are in order."""
    under = float(toolpath.base.height_of(first).min())
    if under <= 0.0:
        raise PlanesError(f"layer 0 reaches {-under:.4g} mm below the bed; move the `bed` down or give none")
    over = float(toolpath.layers[-1].nozzle.height_of(last).max())
    if at == "slicing" and over >= 0.0:
        k = len(toolpath.layers) - 1
        raise PlanesError(f"layer {k} reaches {over:.4g} mm above its top; move the top up or give none")
