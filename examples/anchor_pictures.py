"""Pictures for fig15_anchor_plates.py: the curves of one layer, toolpaths, the printed volume, tetrahedra cut open."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
import shapely.ops
import trimesh
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline
from pictures import (
    View,
    colour_bar,
    draw_curves,
    draw_surface,
    draw_toolpath,
    mark_stretches,
    panels,
    save,
    to_scale,
)

from analysis import TetMesh
from twins import Curve, Layer, Toolpath, largest_turning, regions_of

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

VIEW = View(azimuth=-38.0, elevation=24.0)
BELOW = View(azimuth=-38.0, elevation=-42.0)
SHARP = 60.0  # turning within a bead's width that is marked, degrees
PLATE, ADDED, RED, ZONE, INSIDE, HATCH = "#c8642b", "#7fb0d6", "#d1203a", "#1f7a4d", "#e9e6e0", "#c9c3b8"


def outer(layer: Layer) -> tuple[Curve, ...]:
    """The outer curves of a layer."""
    return tuple(curve for curve in layer.curves if curve.signed_area > 0)


def draw_layer(
    path: Path,
    springer: Layer,
    plates: Layer,
    joint: Layer,
    final: Layer,
    zones: Sequence[shapely.Polygon],
    width: float,
    dpi: int,
) -> None:
    """One layer: springer and plates, united with what is sharp, smoothed, and one corner of it, enlarged.

    Args:
        path: of the PNG.
        springer, plates, joint, final: the layer's curves as drawn, united and smoothed.
        zones: protected around the bolts, in the layer's frame.
        width: of the bead, mm.
        dpi: of the picture.
    """
    figure, (apart, sharp, smoothed, corner) = panels(4, (14.0, 5.4), width_ratios=[1.0, 1.0, 1.0, 1.15])
    locked = shapely.union_all(regions_of(joint))
    added = shapely.union_all(regions_of(final)).difference(locked)
    shade(apart, shapely.union_all(regions_of(plates)), facecolor=PLATE, alpha=0.35)
    draw_curves(apart, springer.curves, linewidth=1.6)
    draw_curves(apart, plates.curves, color=PLATE, linewidth=1.6)
    apart.set_title("springer and anchor plates, layer 0")
    sharp.set_title("united, with sills")
    smoothed.set_title("smoothed, outwards only")
    corner.set_title("one corner")
    for axes in (smoothed, corner):
        shade(axes, locked, facecolor=INSIDE, hatch="////", edgecolor=HATCH, linewidth=0.0)
        shade(axes, added, facecolor=ADDED, edgecolor="none")
    for axes, layer in ((sharp, joint), (smoothed, final)):
        draw_curves(axes, layer.curves, linewidth=1.4)
        moving = outer(layer)
        flags = [turning_around(curve, width) > np.radians(SHARP) for curve in moving]
        mark_stretches(axes, moving, flags, colors=RED)
        turn = np.degrees(max(largest_turning(curve, width) for curve in moving))
        axes.text(
            0.5,
            0.52,
            f"turns by up to\n{turn:.0f}° in {width:g} mm",
            ha="center",
            va="center",
            transform=axes.transAxes,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 3.0},
        )
    draw_curves(corner, outer(joint), color=RED, linewidth=1.2, linestyle=(0, (4, 2)))
    draw_curves(corner, final.curves, linewidth=1.8)
    for zone in zones:
        shade(corner, zone, facecolor="none", edgecolor=ZONE, linewidth=1.8, zorder=4)
    for axes in (apart, sharp, smoothed):
        to_scale(axes, bar=100.0)
    to_scale(corner)
    _frame_corner(corner, zones[0], shapely.union_all(regions_of(springer)))
    figure.legend(
        handles=[
            Line2D([], [], color=RED, lw=3.0, label=f"turns by more than {SHARP:g}° in {width:g} mm"),
            Line2D([], [], color=RED, lw=1.2, ls="--", label="before smoothing"),
            Patch(facecolor=INSIDE, edgecolor=HATCH, hatch="////", label="locked side"),
            Patch(facecolor=ADDED, label="added by smoothing"),
            Patch(facecolor="none", edgecolor=ZONE, label="protected zone of a bolt"),
        ],
        loc="outside lower center",
        ncols=5,
        frameon=False,
    )
    save(figure, path, dpi)


def _frame_corner(axes: Any, zone: shapely.Polygon, springer: shapely.Geometry) -> None:
    """Show what lies around a bolt and the mouth of its ear."""
    bolt = np.array(zone.centroid.coords[0])
    mouth = np.array(shapely.ops.nearest_points(springer, shapely.Point(bolt))[0].coords[0])
    middle, reach = 0.45 * bolt + 0.55 * mouth, 1.45 * float(np.hypot(*(bolt - mouth))) + 6.0
    axes.set_xlim(middle[0] - reach, middle[0] + reach)
    axes.set_ylim(middle[1] - 1.25 * reach, middle[1] + 1.25 * reach)


def turning_around(curve: Curve, width: float) -> Array:
    """By how much a closed curve turns within `width` around each point, rad, shape (n,)."""
    out = np.roll(curve.points, -1, axis=0) - curve.points
    into = np.roll(out, 1, axis=0)
    angle = np.abs(np.arctan2(into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0], (into * out).sum(axis=1)))
    n, lengths = len(angle), np.hypot(*out.T)
    place = np.concatenate([[0.0], np.cumsum(np.tile(lengths, 3))[:-1]])
    summed = np.concatenate([[0.0], np.cumsum(np.tile(angle, 3))])
    middle = place[n : 2 * n]
    first, last = (np.searchsorted(place, middle + side * 0.5 * width) for side in (-1.0, 1.0))
    return np.asarray(summed[last] - summed[first], dtype=np.float64)


def shade(axes: Any, region: shapely.Geometry, **style: Any) -> None:
    """Fill polygons; their holes are left out."""
    rings = [
        np.asarray(ring.coords)
        for part in shapely.get_parts(region)
        if isinstance(part, shapely.Polygon)
        for ring in (part.exterior, *part.interiors)
    ]
    if rings:
        outline = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings))
        axes.add_patch(PathPatch(outline, **{"zorder": 0, **style}))


def draw_toolpaths(path: Path, springer: Toolpath, plates: Toolpath, final: Toolpath, dpi: int) -> None:
    """Both toolpaths, and the joint one coloured by layer, in space."""
    figure, (left, right) = panels(2, (11.0, 6.0))
    draw_toolpath(left, springer, VIEW, colour="#8d8a85", linewidth=0.7)
    draw_toolpath(left, plates, VIEW, colour=PLATE, linewidth=1.3)
    drawn = draw_toolpath(right, final, VIEW, linewidth=1.0)
    left.set_title("the springer's toolpath and the plates'")
    right.set_title("joint toolpath")
    for axes in (left, right):
        to_scale(axes)
    colour_bar(figure, drawn, right, "layer")
    save(figure, path, dpi)


def draw_volume(path: Path, volume: trimesh.Trimesh, printed: Sequence[trimesh.Trimesh], dpi: int) -> None:
    """M' from above and below, and the printed look of its parts if given."""
    figure, row = panels(3 if printed else 2, (13.5 if printed else 9.0, 5.4))
    shown = [(volume, VIEW, "volume M'"), (volume, BELOW, "from below: bolt holes, sills, the void")]
    if printed:
        parts: Any = trimesh.util.concatenate(printed)
        shown.append((parts, VIEW, "as printed"))
    for axes, (surface, view, title) in zip(row, shown, strict=True):
        draw_surface(axes, surface, view, pixels=5 * dpi)
        axes.set_title(title)
        to_scale(axes)
    save(figure, path, dpi)


def draw_tetrahedra(path: Path, mesh: TetMesh, bores: Indices, bolts: Array, dpi: int) -> None:
    """Tetrahedra cut open through two bolts that are across from one another, coloured by layer.

    Args:
        path: of the PNG.
        mesh: stands on z = 0 around the origin.
        bores: nodes on the bolt holes.
        bolts: (x, y) of their axes, shape (n, 2), mm; the cut goes through the first and the one farthest from it.
        dpi: of the picture.
    """
    second = int(np.argmax(np.hypot(*(bolts - bolts[0]).T)))
    other = bolts[second]
    along = (other - bolts[0]) / np.hypot(*(other - bolts[0]))
    across = np.array([along[1], -along[0]])
    across *= np.sign(across @ VIEW.axes[:2, 2])
    stays = (mesh.centroids[:, :2] - bolts[0]) @ across < 0.0
    faces = mesh.tets[stays][:, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]].reshape(-1, 3)
    _, first, times = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    rim = first[times == 1]
    figure, axes = panels(1, (7.0, 6.4))
    shown = trimesh.Trimesh(mesh.points, faces[rim], process=False)
    drawn = draw_surface(axes, shown, VIEW, values=mesh.layer[stays][rim // 4], pixels=5 * dpi)
    nodes = mesh.points[np.intersect1d(bores, faces[rim])]
    nearest = np.argmin([np.hypot(*(nodes[:, :2] - bolt).T) for bolt in bolts], axis=0)
    places = VIEW.project(nodes[(nearest == 0) | (nearest == second)])
    axes.plot(*places[:, :2].T, ".", color=RED, markersize=3.5, label="nodes on bolt holes")
    axes.set_title("tetrahedra by layer, cut open through two bolts")
    to_scale(axes)
    axes.legend(loc="lower left", frameon=False)
    colour_bar(figure, drawn, axes, "layer")
    save(figure, path, dpi)
