"""A branching node from section curves, printed as an assembly (seed paper, Figure 18).

    python examples/fig18_branching_node.py [--out FOLDER] [--quick]

Sections of a trunk and three arms are united layer by layer, wrapped in layers, and turned into one surface. Each arm
is trimmed square to its axis and cut off; every part is set down on a flat end and sliced by itself.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt
import shapely
import trimesh
from pictures import View, draw_surface, draw_toolpath, panels, save, to_scale

from twins import (
    Plane,
    SpaceCurve,
    Toolpath,
    check_surface,
    layer_planes,
    make_surface,
    orient_to_slice,
    reconstruct,
    set_down,
    signed_volume,
    slice_surface,
    split,
    trim,
    visual_mesh,
    wrap,
)

Array = npt.NDArray[np.float64]

RADIUS, BALL = 40.0, 55.0
TRUNK, RISE = -160.0, 230.0
CUT, END = 115.0, 190.0
LEAN = np.radians(35.0)
WIDTH = 16.0


def axes_of_arms() -> list[Array]:
    """Unit directions of the three arms."""
    turns = np.radians([20.0, 140.0, 265.0])
    return [np.array([np.sin(LEAN) * np.cos(t), np.sin(LEAN) * np.sin(t), np.cos(LEAN)]) for t in turns]


def section(height: float) -> shapely.Geometry:
    """Trunk, ball and arms cut by a level plane, united."""
    shapes = []
    if abs(height) < BALL:
        shapes.append(shapely.Point(0.0, 0.0).buffer(np.sqrt(BALL**2 - height**2), quad_segs=32))
    if height <= 0.0:
        shapes.append(shapely.Point(0.0, 0.0).buffer(RADIUS, quad_segs=32))
    else:
        for arm in axes_of_arms():
            ellipse = shapely.affinity.scale(
                shapely.Point(0.0, 0.0).buffer(RADIUS, quad_segs=32), 1.0 / arm[2], 1.0
            )
            ellipse = shapely.affinity.rotate(
                ellipse, np.arctan2(arm[1], arm[0]), (0.0, 0.0), use_radians=True
            )
            shapes.append(shapely.affinity.translate(ellipse, *(arm[:2] * height / arm[2])))
    return shapely.union_all(shapes)


def sections(spacing: float, segment: float) -> list[SpaceCurve]:
    """The outlines of all sections as curves in space, the highest first."""
    curves = []
    for height in np.arange(TRUNK, RISE + 0.5 * spacing, spacing)[::-1].tolist():
        for polygon in shapely.get_parts(section(height)):
            for ring in (polygon.exterior, *polygon.interiors):
                count = max(12, round(ring.length / segment))
                points = shapely.get_coordinates(
                    shapely.line_interpolate_point(ring, np.arange(count) * ring.length / count)
                )
                curves.append(SpaceCurve(np.column_stack([points, np.full(count, height)])))
    return curves


def square_to(arm: Array, distance: float) -> Plane:
    """The plane across an arm, so far from the middle of the node."""
    across = np.cross(arm, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    return Plane(distance * arm, across, np.cross(arm, across))


def main(out: Path, quick: bool = False) -> dict[str, float]:
    """From sections to an assembly; pictures land in `out`. Returns the figures of the table."""
    spacing, thickness, pixels = (15.0, 15.0, 240) if quick else (5.0, 8.0, 700)
    curves = sections(spacing, spacing)
    wrapped = wrap(curves, at="slicing")
    surface = reconstruct(wrapped.toolpath, spacing)
    arms = axes_of_arms()
    node = trim(surface, [square_to(arm, END) for arm in arms], at_origin=True)
    parts = split(node, [square_to(arm, CUT) for arm in arms], at_origin=True)
    printed = [
        laid(part, up, thickness) for part, up in zip(parts, [*arms, np.array([0.0, 0.0, 1.0])], strict=True)
    ]
    for _, toolpath in printed:
        check_surface(visual_mesh(toolpath, WIDTH))
    figures = {
        "section curves": float(len(curves)),
        "layers found": float(len(wrapped.toolpath.layers)),
        "Euler characteristic": float(surface.euler_number),
        "parts": float(len(parts)),
        "volume of the node, l": signed_volume(node) * 1e-6,
        "volume of its parts, l": sum(signed_volume(part) for part in parts) * 1e-6,
        "lowest point of a part, mm": min(float(part.vertices[:, 2].min()) for part, _ in printed),
        "layers of all parts": float(sum(len(toolpath.layers) for _, toolpath in printed)),
    }
    draw(out / "branching_node.png", wrapped.toolpath, node, parts, printed, pixels, 60 if quick else 110)
    for name, value in figures.items():
        print(f"{name:32} {value:.6g}")
    return figures


def laid(part: trimesh.Trimesh, up: Array, thickness: float) -> tuple[trimesh.Trimesh, Toolpath]:
    """A part set down on its flat end, and its layers: to its other end, or level where it has several."""
    bed, top = orient_to_slice(part, up)
    moved, end = set_down(part, bed, top)
    tilted = abs(float(end.normal[2])) < 1.0 - 1e-6
    height = float(np.asarray(moved.vertices)[:, 2].max())
    return moved, slice_surface(moved, layer_planes(Plane.horizontal(), height if tilted else end, thickness))


def draw(
    path: Path,
    drawn: Toolpath,
    node: trimesh.Trimesh,
    parts: tuple[trimesh.Trimesh, ...],
    printed: list[tuple[trimesh.Trimesh, Toolpath]],
    pixels: int,
    dpi: int,
) -> None:
    """Sections, the node, its parts drawn apart, and each part as printed."""
    view = View(-70.0, 18.0)
    figure, axes = panels(4, (15.0, 4.6))
    draw_toolpath(axes[0], drawn, view)
    draw_surface(axes[1], node, view, pixels=pixels)
    apart = [part.copy() for part in parts]
    for part, arm in zip(apart, axes_of_arms(), strict=False):
        part.apply_translation(60.0 * arm)
    draw_surface(axes[2], together(apart), view, pixels=pixels)
    beads, right = [], 0.0
    for _, toolpath in printed:
        bead = visual_mesh(toolpath, WIDTH)
        bead.apply_translation([right - bead.bounds[0, 0], 0.0, 0.0])
        right = float(bead.bounds[1, 0]) + 30.0
        beads.append(bead)
    draw_surface(axes[3], together(beads), View(-90.0, 18.0), pixels=pixels)
    titles = (f"{len(drawn.layers)} sections", "node, trimmed square to its arms", "split", "each as printed")
    for panel, title in zip(axes, titles, strict=True):
        panel.set_title(title)
        to_scale(panel, 100.0)
    save(figure, path, dpi)


def together(meshes: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Meshes as one, to be drawn."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [np.asarray(mesh.faces) + n for mesh, n in zip(meshes, first, strict=False)]
    return make_surface(np.concatenate([np.asarray(mesh.vertices) for mesh in meshes]), np.concatenate(faces))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/examples/fig18_branching_node"))
    parser.add_argument("--quick", action="store_true", help="a smaller version")
    arguments = parser.parse_args()
    main(arguments.out, arguments.quick)
