"""Three layers from surface to print: G, TP, M, TP', M' and M_vis (seed paper, Figure 5).

    python examples/fig05_three_layers.py [--out FOLDER] [--quick]

A low hill with two summits is cut in three layers; in the last one its curve has parted in two. The toolpath mesh M
goes through the curves, M' bounds the beads' volume, and M_vis is what the print looks like.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from matplotlib.colors import to_rgb
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from pictures import INK, Drawn, View, draw_edges, draw_surface, panels, save, to_scale
from sampled_fields import field_in_box

from twins import (
    Layer,
    Plane,
    Toolpath,
    bead_outlines,
    check_surface,
    extrude,
    layer_planes,
    reconstruct,
    regions_of,
    signed_volume,
    slice_surface,
    visual_mesh,
)

Array = npt.NDArray[np.float64]

THICKNESS, WIDTH, HEIGHT = 10.0, 16.0, 30.0
FOCUS = 62.0
"""Half the distance of the two summits, mm."""

LAYERS = ("#3b3a8f", "#1f8a8a", "#e0a21b")
"""Colours of the layers, from the bottom up."""

PALE = "#e9e6df"
VIEW = View(-62.0, 34.0)


def two_summits(cell: float) -> trimesh.Trimesh:
    """A part of 30 mm whose sections are Cassini's ovals, r1 r2 = b², one curve below and two above."""

    def field(x: Array, y: Array, z: Array) -> Array:
        b = FOCUS * (1.17 - 0.0082 * z)
        product = np.hypot(x - FOCUS, 1.15 * y) * np.hypot(x + FOCUS, 1.15 * y)
        return np.asarray(b - np.sqrt(product), dtype=np.float64)

    return field_in_box(field, [-130.0, -80.0, 0.0], [130.0, 80.0, HEIGHT], cell)


def main(out: Path, quick: bool = False) -> dict[str, float]:
    """The twins of a small part; a picture lands in `out`. Returns the figures of the table."""
    cell, pixels = (4.0, 260) if quick else (1.5, 900)
    surface = two_summits(cell)
    planes = layer_planes(Plane.horizontal(), HEIGHT, THICKNESS)
    toolpath = slice_surface(surface, planes)
    mesh = reconstruct(toolpath)
    outlines = bead_outlines(toolpath, WIDTH, THICKNESS)
    volume = extrude(toolpath, WIDTH)
    visible = visual_mesh(toolpath, WIDTH, None if quick else 4.0)
    for part in (mesh, volume, visible):
        check_surface(part)
    figures = {
        "layers": float(len(toolpath.layers)),
        **{f"curves of layer {i}": float(len(layer.curves)) for i, layer in enumerate(toolpath.layers)},
        "points of TP": float(points_of(toolpath)),
        "points of TP'": float(points_of(outlines)),
        "vertices of M": float(len(mesh.vertices)),
        "vertices of M'": float(len(volume.vertices)),
        "vertices of M_vis": float(len(visible.vertices)),
        "M, M', M_vis watertight": float(all(part.is_watertight for part in (mesh, volume, visible))),
        "volume of G, l": signed_volume(surface) * 1e-6,
        "volume of M, l": signed_volume(mesh) * 1e-6,
        "area of TP' times thickness, l": area_of(outlines) * THICKNESS * 1e-6,
        "volume of M', l": signed_volume(volume) * 1e-6,
        "volume of M_vis, l": signed_volume(visible) * 1e-6,
        "length of TP times width and thickness, l": toolpath.length * WIDTH * THICKNESS * 1e-6,
    }
    figure, axes = panels(3, (15.0, 6.0), rows=2)
    axes = axes.ravel()
    draw_layers(axes[0], toolpath, draw_surface(axes[0], surface, VIEW, pixels=pixels), within=6.0)
    for axis, part, curves in ((axes[1], mesh, toolpath), (axes[3], volume, outlines)):
        drawn = draw_surface(axis, part, VIEW, pixels=pixels, colour=PALE)
        draw_edges(axis, drawn, np.asarray(part.vertices), part.edges_unique, linewidths=0.5)
        draw_layers(axis, curves, drawn)
    draw_regions(axes[2], toolpath, outlines)
    draw_surface(axes[4], visible, VIEW, pixels=pixels)
    draw_key(axes[5], toolpath, figures)
    titles = [
        "a   surface G and toolpath TP",
        "b   toolpath mesh M",
        "c   outlines TP' and their regions",
        "d   volume M'",
        "e   print M$_{vis}$",
    ]
    for axis, title in zip(axes, titles, strict=False):
        axis.set_title(title, loc="left")
        to_scale(axis, 50.0)
        axis.set_xlim(-115.0, 115.0)
    save(figure, out / "three_layers.png", 60 if quick else 120)
    for name, value in figures.items():
        print(f"{name:44} {value:.6g}")
    return figures


def points_of(toolpath: Toolpath) -> int:
    return sum(len(curve.points) for *_, curve in toolpath.curves())


def area_of(toolpath: Toolpath) -> float:
    """What the curves of all layers enclose, mm²."""
    return sum(curve.signed_area for *_, curve in toolpath.curves())


def draw_layers(axes: Any, toolpath: Toolpath, drawn: Drawn, within: float | None = None) -> None:
    """The curves in their slicing planes, each layer in its colour, pale where the surface hides them."""
    for layer, colour in zip(toolpath.layers, LAYERS, strict=True):
        for curve in layer.curves:
            points = layer.slicing.to_world(curve.points)
            start = np.arange(len(points))
            edges = np.column_stack([start, np.roll(start, -1)])
            around = np.vstack([points, points[:1]])
            axes.plot(*VIEW.project(around)[:, :2].T, color=colour, linewidth=0.8, alpha=0.3, zorder=2)
            draw_edges(axes, drawn, points, edges, within=within, colors=colour, linewidths=2.2, zorder=3)


def draw_regions(axes: Any, toolpath: Toolpath, outlines: Toolpath) -> None:
    """What the beads of each layer cover, bounded by TP', around the curves of TP; low layers first."""
    both = zip(toolpath.layers, outlines.layers, LAYERS, strict=True)
    for i, (layer, drawn, colour) in enumerate(both):
        for region in regions_of(drawn):
            rings = [np.asarray(ring.coords) for ring in (region.exterior, *region.interiors)]
            seen = [Outline(flat(layer, ring), closed=True) for ring in rings]
            patch = Outline.make_compound_path(*seen)
            axes.add_patch(
                PathPatch(patch, facecolor=tint(colour), edgecolor=colour, linewidth=1.6, zorder=2 + i)
            )
        for curve in layer.curves:
            around = flat(layer, np.vstack([curve.points, curve.points[:1]]))
            axes.plot(*around.T, color=colour, linewidth=1.0, linestyle="--", zorder=2 + i)


def flat(layer: Layer, points: Array) -> Array:
    """Points of a layer's slicing plane, shape (n, 2), as they are seen, shape (n, 2)."""
    return VIEW.project(layer.slicing.to_world(points))[:, :2]


def tint(colour: str) -> tuple[float, float, float]:
    red, green, blue = (0.25 * part + 0.75 for part in to_rgb(colour))
    return red, green, blue


def draw_key(axes: Any, toolpath: Toolpath, figures: dict[str, float]) -> None:
    """The colours of the layers, and how many points each thing has."""
    axes.set_axis_off()
    for i, (layer, colour) in reversed(list(enumerate(zip(toolpath.layers, LAYERS, strict=True)))):
        curves = f"{len(layer.curves)} curve{'s' if len(layer.curves) > 1 else ''}"
        axes.plot([], [], color=colour, linewidth=2.2, label=f"layer {i}, {curves}")
    axes.plot([], [], color=INK, linewidth=1.0, linestyle="--", label="curves of TP in their beads (c)")
    axes.legend(loc="upper left", frameon=False, fontsize=10, bbox_to_anchor=(0.0, 0.95))
    lines = [f"layers of {THICKNESS:g} mm, sampled every {THICKNESS:g} mm, beads of {WIDTH:g} mm", ""]
    lines += [
        f"{name}: {figures[f'vertices of {key}']:.0f} vertices, {figures[f'volume of {key}, l']:.3f} l"
        for name, key in (("M", "M"), ("M'", "M'"), ("M$_{vis}$", "M_vis"))
    ]
    axes.text(0.03, 0.54, "\n".join(lines), transform=axes.transAxes, va="top", fontsize=10, linespacing=1.6)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/examples/fig05_three_layers"))
    parser.add_argument("--quick", action="store_true", help="a smaller version")
    arguments = parser.parse_args()
    main(arguments.out, arguments.quick)
