"""Five parts: their toolpaths, M and M', how many layers and points, and how long it takes (seed paper, Figure 6).

    python examples/fig06_table.py [--out FOLDER] [--quick]

Layers of 10 mm, all parts to one scale, each made here from nothing. M goes through the curves alone, without
knowledge of the surface. Times are of one thread, in seconds of processor time, the quickest of five calls; smaller
parts were taken through all three stages before, so that compilation is not counted.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import trimesh
from branching import branching_springer
from pictures import INK, View, draw_surface, draw_toolpath, panels, save, to_scale
from sampled_fields import field_in_box

from twins import (
    Plane,
    Toolpath,
    check_surface,
    extrude,
    layer_planes,
    make_surface,
    reconstruct,
    signed_volume,
    slice_surface,
)

Array = npt.NDArray[np.float64]
Result = TypeVar("Result")

THICKNESS, WIDTH = 10.0, 16.0
PERIOD = 2.0 * np.pi
VIEW = View(-58.0, 22.0)


@dataclass(frozen=True, eq=False)
class Part:
    """A surface on z = 0, and the plane or the height that its layers end at."""

    name: str
    surface: trimesh.Trimesh
    top: Plane | float


@dataclass(frozen=True, eq=False)
class Row:
    """A part with its twins, and how long they took, s."""

    part: Part
    toolpath: Toolpath
    mesh: trimesh.Trimesh
    volume: trimesh.Trimesh
    slicing: float
    meshing: float
    extruding: float

    @property
    def points(self) -> int:
        """V, the vertices of TP."""
        return sum(len(curve.points) for *_, curve in self.toolpath.curves())


def main(out: Path, quick: bool = False) -> dict[str, float]:
    """The twins of five parts; a picture and a table land in `out`. Returns the figures of the table."""
    size, cell, runs, pixels = (0.36, 9.0, 1, 90) if quick else (1.0, 4.0, 5, 520)
    if not quick:
        twins_of(Part("to warm up", porous_column(0.25), 410.0 * 0.25), 1)
        twins_of(Part("to warm up, rotary", *branching_springer(2)), 1)
    rows = [twins_of(part, runs) for part in parts(size, cell)]
    for row in rows:
        check_surface(row.mesh)
        check_surface(row.volume)
    table = [line_of(row) for row in rows]
    out.mkdir(parents=True, exist_ok=True)
    with (out / "table.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(table[0]))
        writer.writeheader()
        writer.writerows(table)
    print(markdown(table))
    figure, axes = panels(5, (16.0, 11.2), rows=3, width_ratios=[np.ptp(span_of(row)) for row in rows])
    for column, row in zip(axes.T, rows, strict=True):
        draw_row(column, row, pixels)
    share_scale(axes, rows)
    for axis, title in zip(axes[:, 0], ("TP", "M", "M'"), strict=True):
        axis.text(0.0, 0.98, title, transform=axis.transAxes, va="top", fontsize=12, fontweight="bold")
    save(figure, out / "table.png", 60 if quick else 110)
    return figures_of(rows, size)


def figures_of(rows: list[Row], size: float) -> dict[str, float]:
    """What the table says of each part, and what its twins must agree in."""
    figures: dict[str, float] = {"parts": float(len(rows)), "scale": size}
    for row in rows:
        steps = [
            layer.nozzle.origin - row.toolpath.floor_of(i).origin
            for i, layer in enumerate(row.toolpath.layers)
        ]
        figures |= {
            f"layers, {row.part.name}": float(len(row.toolpath.layers)),
            f"largest layer height, {row.part.name}, mm": float(np.linalg.norm(steps, axis=1).max()),
            f"vertices of TP, {row.part.name}": float(row.points),
            f"vertices of M, {row.part.name}": float(len(row.mesh.vertices)),
            f"volume of G, {row.part.name}, l": signed_volume(row.part.surface) * 1e-6,
            f"volume of M, {row.part.name}, l": signed_volume(row.mesh) * 1e-6,
            f"volume of M', {row.part.name}, l": signed_volume(row.volume) * 1e-6,
            f"length times width and thickness, {row.part.name}, l": bead_volume(row.toolpath) * 1e-6,
            f"Euler characteristic of G, {row.part.name}": float(row.part.surface.euler_number),
            f"Euler characteristic of M, {row.part.name}": float(row.mesh.euler_number),
            f"seconds, {row.part.name}": row.slicing + row.meshing + row.extruding,
        }
    return figures


def bead_volume(toolpath: Toolpath) -> float:
    """Length of the curves times width and nominal thickness, mm³."""
    return toolpath.length * WIDTH * toolpath.thickness


def twins_of(part: Part, runs: int) -> Row:
    """Slice a part, reconstruct M and extrude M', each so many times."""
    planes = layer_planes(Plane.horizontal(), part.top, THICKNESS)
    toolpath, slicing = timed(lambda: slice_surface(part.surface, planes), runs)
    mesh, meshing = timed(lambda: reconstruct(toolpath), runs)
    volume, extruding = timed(lambda: extrude(toolpath, WIDTH), runs)
    return Row(part, toolpath, mesh, volume, slicing, meshing, extruding)


def timed(call: Callable[[], Result], runs: int) -> tuple[Result, float]:
    """What a call returns, and the processor time of the quickest, s."""
    times = []
    for _ in range(runs):
        begin = time.process_time()
        result = call()
        times.append(time.process_time() - begin)
    return result, min(times)


def line_of(row: Row) -> dict[str, str]:
    """A row of the table as it is written."""
    return {
        "part": row.part.name,
        "layers": f"{len(row.toolpath.layers)}",
        "V": f"{row.points}",
        "slicing, s": f"{row.slicing:.2f}",
        "M, s": f"{row.meshing:.2f}",
        "M', s": f"{row.extruding:.2f}",
    }


def markdown(table: list[dict[str, str]]) -> str:
    """The table as Markdown."""
    lines = [
        list(table[0]),
        ["---", *["---:"] * (len(table[0]) - 1)],
        *(list(line.values()) for line in table),
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def span_of(row: Row) -> Array:
    """From where to where a part reaches to the right, with room beside it, mm."""
    right = VIEW.project(np.asarray(row.volume.vertices))[:, 0]
    middle, half = 0.5 * (right.min() + right.max()), 0.5 * np.ptp(right)
    return np.asarray(middle + np.array([-1.08, 1.08]) * half, dtype=np.float64)


def draw_row(column: Any, row: Row, pixels: int) -> None:
    """TP, M and M', one above the other, and the figures below."""
    draw_toolpath(column[0], row.toolpath, VIEW, linewidth=0.5)
    draw_surface(column[1], row.mesh, VIEW, pixels=pixels)
    draw_surface(column[2], row.volume, VIEW, pixels=pixels)
    column[0].set_title(row.part.name)
    line = line_of(row)
    text = (
        f"{line['layers']} layers, V = {line['V']}\n"
        f"slicing {line['slicing, s']} s\nM {line['M, s']} s,  M' {row.extruding:.2f} s"
    )
    column[2].text(0.5, -0.02, text, transform=column[2].transAxes, ha="center", va="top", linespacing=1.5)


def share_scale(axes: Any, rows: list[Row]) -> None:
    """One scale for all panels: columns as wide as their parts, all as high as the tallest; and a scale bar."""
    heights = [VIEW.project(np.asarray(row.volume.vertices))[:, 1] for row in rows]
    tallest = max(float(np.ptp(height)) for height in heights)
    for column, row, height in zip(axes.T, rows, heights, strict=True):
        for axis in column:
            to_scale(axis)
            axis.set_xlim(*span_of(row))
            axis.set_ylim(height.min() - 0.02 * tallest, height.min() + 1.02 * tallest)
    last, bar = axes[0, -1], 100.0 if tallest < 400.0 else 200.0
    right, top = last.get_xlim()[1] - 0.02 * tallest, last.get_ylim()[1] - 0.05 * tallest
    last.plot([right - bar, right], [top, top], color=INK, linewidth=2.0, solid_capstyle="butt")
    last.text(right - 0.5 * bar, top - 0.015 * tallest, f"{bar:g} mm", ha="center", va="top", fontsize=9)


def parts(size: float, cell: float) -> list[Part]:
    """The five parts, scaled by `size`; fields sampled in cells of so many mm."""
    springer, top = branching_springer(3)
    smaller = make_surface(np.asarray(springer.vertices) * size, springer.faces)
    side, period = 400.0 * size, 200.0 * size
    return [
        Part("porous column", porous_column(size), 410.0 * size),
        Part("branching springer", smaller, Plane(top.origin * size, top.x_axis, top.y_axis)),
        Part("gyroid brick", gyroid_brick(side, period, cell), side),
        Part("porous panel", porous_panel(side, period, size, cell), side),
        Part("diamond vault", diamond_vault(size, cell), 300.0 * size),
    ]


def porous_column(size: float) -> trimesh.Trimesh:
    """A hollow cylinder, 300 mm wide and 410 mm high, with 24 radial holes in four staggered rings."""
    outer, inner = (trimesh.creation.cylinder(radius, 410.0, sections=128) for radius in (150.0, 90.0))
    inner.apply_scale([1.0, 1.0, 1.2])
    tool = trimesh.creation.cylinder(32.0, 120.0, sections=48)
    # Its axis along x, in the wall.
    around, along, across = np.asarray(tool.vertices).T
    lying = np.column_stack([120.0 + across, along, -around])
    holes = []
    for ring, height in enumerate((-135.0, -45.0, 45.0, 135.0)):
        for k in range(6):
            c, s = (f(np.pi / 3.0 * (k + 0.5 * (ring % 2))) for f in (np.cos, np.sin))
            turned = lying @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
            holes.append(make_surface(turned + [0.0, 0.0, height], tool.faces))
    part = trimesh.boolean.difference([outer, inner, *holes], engine="manifold")
    return make_surface((np.asarray(part.vertices) + [0.0, 0.0, 205.0]) * size, part.faces)


def gyroid_brick(side: float, period: float, cell: float) -> trimesh.Trimesh:
    """A cube of one of the two labyrinths of a gyroid."""
    k = PERIOD / period

    def field(x: Array, y: Array, z: Array) -> Array:
        x, y, z = k * x, k * y, k * z
        value = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
        return np.asarray(value, dtype=np.float64)

    half = 0.5 * side
    return field_in_box(field, [-half, -half, 0.0], [half, half, side], cell)


def porous_panel(side: float, period: float, size: float, cell: float) -> trimesh.Trimesh:
    """A wavy panel, 70 mm thick, with round-edged openings in every other field."""
    k = PERIOD / period

    def field(x: Array, y: Array, z: Array) -> Array:
        wave = np.cos(k * x) * np.cos(k * z)
        body = 35.0 * size - np.abs(y - 25.0 * size * wave)
        opening = 55.0 * size * (0.55 - np.sin(k * x) * np.sin(k * z))
        # The lesser of the two, rounded where they are alike.
        blend = 30.0 * size
        share = np.clip(0.5 + 0.5 * (opening - body) / blend, 0.0, 1.0)
        return opening * (1.0 - share) + body * share - blend * share * (1.0 - share)

    half = 0.5 * side
    return field_in_box(field, [-half, -0.5 * half, 0.0], [half, 0.5 * half, side], cell)


def diamond_vault(size: float, cell: float) -> trimesh.Trimesh:
    """One labyrinth of Schwarz's diamond surface in a round block of 300 mm that flares."""
    k, base = PERIOD / (190.0 * size), 130.0 * size

    def field(x: Array, y: Array, z: Array) -> Array:
        wider = 1.0 + 0.4 * (z / (300.0 * size)) ** 2
        u, v = x / wider, y / wider
        x, y, z = k * u, k * v, k * z
        surface = np.cos(x) * np.cos(y) * np.cos(z) - np.sin(x) * np.sin(y) * np.sin(z) - 0.05
        return np.asarray(np.minimum(surface / k, base - np.hypot(u, v)), dtype=np.float64)

    reach = 1.5 * base
    return field_in_box(field, [-reach, -reach, 0.0], [reach, reach, 300.0 * size], cell)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/examples/fig06_table"))
    parser.add_argument("--quick", action="store_true", help="a smaller version")
    arguments = parser.parse_args()
    main(arguments.out, arguments.quick)
