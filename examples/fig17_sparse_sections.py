"""A shell from four sections: curves in no order become layers, a surface, and a print (seed paper, Figure 17).

    python examples/fig17_sparse_sections.py [--out FOLDER] [--quick]

Four closed curves are all that is drawn, in any order and direction. `wrap` finds the layers that they are; the
surface through them is reconstructed, remeshed, and sliced again in layers of a print.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pictures import View, draw_surface, draw_toolpath, panels, save, to_scale

from twins import (
    Plane,
    SpaceCurve,
    Toolpath,
    check_surface,
    layer_planes,
    make_surface,
    reconstruct,
    remesh,
    signed_volume,
    slice_surface,
    visual_mesh,
    wrap,
)

Array = npt.NDArray[np.float64]

HEIGHTS = (10.0, 130.0, 260.0, 390.0)
RADII = (150.0, 95.0, 105.0, 160.0)
LOBES = (0.0, 0.08, 0.14, 0.2)
WIDTH = 22.0
END = 2.0
"""How thick the first and the last layer of the sections are: the surface ends half of that beyond them, mm."""


def sections(points: int) -> list[SpaceCurve]:
    """Four lobed rings that turn as they rise, in no order, every other one drawn the other way round."""
    angle = 2.0 * np.pi * np.arange(points) / points
    curves = []
    for i, (height, radius, lobes) in enumerate(zip(HEIGHTS, RADII, LOBES, strict=True)):
        r = radius * (1.0 + lobes * np.cos(5.0 * (angle - 0.25 * i)))
        ring = np.column_stack([r * np.cos(angle), 0.8 * r * np.sin(angle), np.full(points, height)])
        curves.append(SpaceCurve(ring[::-1] if i % 2 else ring))
    return [curves[i] for i in (2, 0, 3, 1)]


def main(out: Path, quick: bool = False) -> dict[str, float]:
    """From sections to a print; pictures land in `out`. Returns the figures of the table."""
    thickness, edge, points, pixels = (20.0, 20.0, 60, 240) if quick else (10.0, 10.0, 180, 700)
    drawn = sections(points)
    wrapped = wrap(drawn, at="slicing", thickness=END)
    surface = reconstruct(wrapped.toolpath, edge)
    low = float(np.asarray(surface.vertices)[:, 2].min())
    standing = make_surface(np.asarray(surface.vertices) - [0.0, 0.0, low], surface.faces)
    even = remesh(standing, edge, keep_edges_deg=60.0)
    check_surface(even)
    height = float(np.asarray(even.vertices)[:, 2].max())
    toolpath = slice_surface(even, layer_planes(Plane.horizontal(), height, thickness))
    printed = visual_mesh(toolpath, WIDTH)
    check_surface(printed)
    figures = {
        "sections": float(len(drawn)),
        "layers found": float(len(wrapped.toolpath.layers)),
        "Euler characteristic": float(even.euler_number),
        "volume of M, l": signed_volume(standing) * 1e-6,
        "volume remeshed, l": signed_volume(even) * 1e-6,
        "layers sliced": float(len(toolpath.layers)),
        "length of the toolpath, m": toolpath.length * 1e-3,
    }
    view = View(-60.0, 18.0)
    figure, axes = panels(5, (15.0, 4.2))
    draw_toolpath(axes[0], _at_sections(wrapped.toolpath), view, linewidth=1.6)
    draw_surface(axes[1], standing, view, pixels=pixels)
    draw_surface(
        axes[2],
        even,
        view,
        pixels=pixels,
        values=np.arange(len(even.faces)) % 7,
        limits=(-8.0, 20.0),
        cmap="Greys",
    )
    draw_toolpath(axes[3], toolpath, view)
    draw_surface(axes[4], printed, view, pixels=pixels)
    titles = (
        "four sections",
        "surface through them",
        "remeshed",
        f"{len(toolpath.layers)} layers",
        "as printed",
    )
    for panel, title in zip(axes, titles, strict=True):
        panel.set_title(title)
        to_scale(panel, 100.0)
    save(figure, out / "sparse_sections.png", 60 if quick else 110)
    for name, value in figures.items():
        print(f"{name:32} {value:.6g}")
    return figures


def _at_sections(toolpath: Toolpath) -> Toolpath:
    """The toolpath as it was drawn: with its nozzle planes at the sections."""
    layers = tuple(type(layer)(layer.slicing, layer.slicing, layer.curves) for layer in toolpath.layers)
    return Toolpath(toolpath.base, layers, toolpath.thickness)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/examples/fig17_sparse_sections"))
    parser.add_argument("--quick", action="store_true", help="a smaller version")
    arguments = parser.parse_args()
    main(arguments.out, arguments.quick)
