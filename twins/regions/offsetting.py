"""Offsetting: curves at a distance from those of a toolpath.

Either the region of a layer grows or shrinks as a whole, or each curve is taken for itself: the outline of the band
on both its sides, or the parallel curve on one of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.extrusion import bead_region, rings
from twins.toolpath import FAR, Curve, Toolpath

from .outlines import region_within, turned_round, with_curves, with_layers
from .touching import settled, without_slivers
from .widths import check_width, with_widths

Array = npt.NDArray[np.float64]
Side = Literal["region", "both", "left", "right"]
Corners = Literal["round", "mitre"]

QUAD_SEGS = 12
"""Segments of a quarter circle; its chords stay within 0.22 % of the distance."""

MITRE = 4.0
"""How far a mitred corner may reach, in distances, before it is cut off."""


@dataclass(frozen=True)
class OffsetLayer:
    """What an offset did to a layer.

    Attributes:
        layer: index.
        curves: how many there were, and are.
        areas: enclosed by closed curves before and after, holes taken off, mm².
        lost: curves of which nothing is left, by index; with side "region" how they went is not known: ().
    """

    layer: int
    curves: tuple[int, int]
    areas: tuple[float, float]
    lost: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class OffsetResult:
    """A toolpath at a distance from another one.

    Attributes:
        toolpath: layers without curves, or without any that enclose a region, are the same objects.
        layers: figures of the others.
        remarks: a sentence for each layer in which curves were mended (see `touching.py`), are lost, or have widths
            that were found in between.
    """

    toolpath: Toolpath
    layers: tuple[OffsetLayer, ...]
    remarks: tuple[str, ...]


@checks_kinds
def offset(
    toolpath: Toolpath,
    distance: float,
    side: Side = "region",
    corners: Corners = "round",
    resolution: float | None = None,
    width: float | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> OffsetResult:
    """Curves at a distance from those of a toolpath, in the same planes.

    Args:
        toolpath: with "region" only its closed curves count and open ones stay as they are.
        distance: mm. With "region" positive to grow, negative to shrink; otherwise above 0.
        side: "region": what the layer encloses grows or shrinks; what meets is united, holes close.
            "both": the outlines of all that lies within the distance of a curve: a line becomes a wall, interior
            left.
            "left", "right": the parallel curve on that side of each curve (left: towards the interior), in its
            direction; open curves give open curves. Curves are taken one by one, so results of neighbours may cross.
        corners: of the far side: arcs, or mitres (cut off beyond 4 distances).
        resolution: L_R with which the result will be reconstructed, mm; default the layer thickness. See `union`.
        width: of the bead where a curve has none of its own, mm; see `union`.
        progress: is told the share done, 0 to 1, after each layer.
        executor: works on layers side by side.

    Returns:
        new curves, each point with the bead width of the nearest place of the curves that it was made from
        (`widths.py`). Arcs have 12 segments to a quarter; resample the result where equal segments are wanted. Open
        curves that stay keep their place in the order; the new curves of a region stand where its first one stood.

    Raises:
        ToolpathError: a distance that is not a number or has the wrong sign; a width that is not above 0; curves
            that cross themselves or, with "region", one another.
    """
    if not np.isfinite(distance) or abs(distance) > FAR or distance == 0.0:
        raise ToolpathError(
            f"the offset must be a number other than 0, in mm and within 1 km, not {distance}"
        )
    if side not in ("region", "both", "left", "right"):
        raise ToolpathError(f"a toolpath is offset on side 'region', 'both', 'left' or 'right', not {side!r}")
    if corners not in ("round", "mitre"):
        raise ToolpathError(f"corners of an offset are 'round' or 'mitre', not {corners!r}")
    if side != "region" and distance < 0:
        raise ToolpathError(f"on side {side!r} the offset must be above 0 mm, not {distance}")
    step = toolpath.thickness if resolution is None else float(resolution)
    if not step > 0 or not np.isfinite(step):
        raise ToolpathError(f"the resolution must be above 0 mm, not {resolution}")
    width = check_width(width)
    layers = list(toolpath.layers)
    calls = [
        (layer.curves, float(distance), side, corners, step, width, i)
        for i, layer in enumerate(layers)
        if any(curve.closed or side != "region" for curve in layer.curves)
    ]
    figures, remarks = [], []
    worker = map if executor is None else executor.map
    for done, (call, (made, figure, remark)) in enumerate(zip(calls, worker(_of_layer, calls), strict=True)):
        i = call[-1]
        before = layers[i].curves
        stays = [side == "region" and not curve.closed for curve in before]
        first = stays.index(False)
        after = [curve for curve, stay in zip(before[first:], stays[first:], strict=True) if stay]
        layers[i] = with_curves(layers[i], (*before[:first], *made, *after))
        figures.append(figure)
        remarks += remark
        if progress is not None:
            progress((done + 1) / len(calls))
    return OffsetResult(with_layers(toolpath, layers), tuple(figures), tuple(remarks))


def _of_layer(
    call: tuple[Sequence[Curve], float, Side, Corners, float, float | None, int],
) -> tuple[tuple[Curve, ...], OffsetLayer, list[str]]:
    curves, distance, side, corners, step, width, i = call
    where = f"layer {i}"
    lost: list[int] = []
    with np.errstate(all="ignore"):  # GEOS leaves flags of its own
        if side in ("left", "right"):
            made: tuple[Curve, ...] = ()
            for j, curve in enumerate(curves):
                parallel = _parallel(curve, distance, side, corners, f"{where}, curve {j}")
                lost += [] if parallel else [j]
                made += tuple(with_widths(parallel, [curve], width, where)[0])
            said = [f"{where}, curve {j}: nothing of it is left at {distance:.6g} mm" for j in lost]
        else:
            if side == "region":
                grown = _grown(region_within(curves, where), distance, corners)
                how: Literal["join", "part"] = "join" if distance > 0 else "part"
            elif corners == "round":
                grown, how = (
                    bead_region([Curve(curve.points, curve.closed) for curve in curves], 2.0 * distance, 0.0),
                    "join",
                )
            else:
                grown, how = _mitred(curves, distance), "join"
            done = settled(_sound(grown, distance), step, how, where)
            sources = [curve for curve in curves if curve.closed or side == "both"]
            new, guessed = with_widths(done.curves, sources, width, where)
            made, said = tuple(new), [*filter(None, (done.remark, guessed))]
            if not made:
                said.append(f"{where}: nothing of it is left at {distance:.6g} mm")
    areas = tuple(sum(curve.signed_area for curve in some) for some in (curves, made))
    unchanged = sum(not curve.closed for curve in curves) if side == "region" else 0
    figure = OffsetLayer(i, (len(curves), len(made) + unchanged), (areas[0], areas[1]), tuple(lost))
    return made, figure, said


def _grown(region: BaseGeometry, distance: float, corners: Corners) -> BaseGeometry:
    """A region and all within the distance of it or, for a negative one, less all within it of its boundary.

    Not by GEOS's buffer of the polygon: shrunk by a little more than its inradius, one turns inside out and is left.
    """
    boundary = [Curve(loop) for loop in rings(region)]
    if not boundary:
        return region
    margin = (
        bead_region(boundary, 2.0 * abs(distance), 0.0)
        if corners == "round"
        else _mitred(boundary, abs(distance))
    )
    return shapely.union(region, margin) if distance > 0 else shapely.difference(region, margin)


def _sound(drawn: BaseGeometry, distance: float) -> BaseGeometry:
    """Without pieces and holes thinner than a hundredth of the distance: chords and GEOS's tolerance made them."""
    thinnest = 0.01 * abs(distance)
    return without_slivers(without_slivers(drawn, thinnest, "part")[0], thinnest, "join")[0]


def _mitred(curves: Sequence[Curve], distance: float) -> BaseGeometry:
    """All within a distance of curves, with mitres at corners and flat ends."""
    lines: list[Array] = []
    for curve in curves:
        points = curve.points
        if curve.closed:
            # In two lines that overlap by a segment at either end, so that each corner is inside one of them.
            half = len(points) // 2
            lines += [points[: half + 1], np.vstack([points[half - 1 :], points[:2]])]
        else:
            lines.append(points)
    drawn = shapely.buffer(
        np.array([shapely.LineString(line) for line in lines], dtype=np.object_),
        distance,
        cap_style="flat",
        join_style="mitre",
        mitre_limit=MITRE,
    )
    return shapely.union_all(drawn)


def _parallel(curve: Curve, distance: float, side: Side, corners: Corners, where: str) -> tuple[Curve, ...]:
    """The parallel of one curve on one side, in its direction; none where nothing of it is left."""
    if not curve.closed:
        line = shapely.LineString(curve.points)
        if not line.is_simple:
            raise ToolpathError(f"{where} crosses itself and has no parallel; clean the toolpath first")
        signed = distance if side == "left" else -distance
        drawn = shapely.offset_curve(line, signed, quad_segs=QUAD_SEGS, join_style=corners, mitre_limit=MITRE)
        parts = [part for part in shapely.get_parts(drawn) if part.length > 1e-9 * distance]
        lines = [Curve(shapely.get_coordinates(part), closed=False) for part in parts]
        return tuple(sorted(lines, key=lambda part: float(line.project(shapely.Point(part.points[0])))))
    inside = shapely.Polygon(curve.points)
    if not inside.is_valid:
        raise ToolpathError(
            f"{where} crosses or touches itself and has no parallel; clean the toolpath first"
        )
    left_is_inside = curve.signed_area > 0
    inwards = (side == "left") == left_is_inside
    loops = rings(_sound(_grown(inside, -distance if inwards else distance, corners), distance))
    # `rings` has the inside of the curve on the left.
    return tuple(Curve(points) if left_is_inside else turned_round(Curve(points)) for points in loops)
