"""What overhang relaxation does to normals: A is to A′ as B is to B′ (seed paper, Figure 7).

A sphere A has every normal; the spindle A′ has those that are within θ of the horizontal. Sails after the shells of an
opera house are the input B: where their normals are beyond θ, they are drawn to the nearest ones of the spindle, while
the surface stays as rigid as it can and stands where it stood.

    python examples/fig07_spherical_analogy.py [--out out/examples/fig07_spherical_analogy] [--quick]
"""

from __future__ import annotations

import argparse
from math import cos, radians, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from fig08_overhang import Case, draw_displacement, draw_distributions, lean_colours, measured
from level_sets import level_set, rounded
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle
from pictures import INK, View, colour_bar, draw_surface, panels, save, to_scale

from twins import make_surface, relax_overhang, surface_overhang

Array = npt.NDArray[np.float64]

LIMIT, STRENGTH = 40.0, 10.0  # θ, degrees, and λ
RADIUS, SPREAD, THICK = (
    200.0,
    105.0,
    22.0,
)  # of the balls that bound a sail, from it to their middles, of a sail, mm
LEAN = 22.0  # of the mouth of a sail, degrees
SAILS = (
    (0.0, 1.0, 1.0),
    (112.0, 0.82, 1.0),
    (-150.0, 0.62, -1.0),
)  # where each is, mm; its scale; where it looks
BAND = 14.0  # above the bed that is locked, mm
SHOWN = 2500  # normals on a sphere, each for the same area of the surface
EYE = View(-35.0, 14.0)
RED, BLUE, PALE = "#d1203a", "#1f6fd6", "#d8d4cc"


def main(out: Path, quick: bool = False) -> dict[str, float]:
    """Relax the sails and draw the analogy; the picture lands in `out`. Returns the figures of the table."""
    edge, pixels, dpi, tolerance = (18.0, 160, 60, 0.2) if quick else (6.0, 900, 130, 0.05)
    case = sails(edge)
    relaxed = relax_overhang(case.surface, LIMIT, STRENGTH, case.locked, side="both", tolerance=tolerance)
    pair = (case.surface, relaxed.surface)
    loose = ~case.locked[np.asarray(case.surface.faces)].all(axis=1)
    rises = [np.degrees(np.arcsin(np.clip(normals_of(each)[loose, 2], -1.0, 1.0))) for each in pair]
    areas = [each.area_faces[loose] for each in pair]
    beyond = [float(area[np.abs(rise) > LIMIT].sum()) for rise, area in zip(rises, areas, strict=True)]
    figures = measured(case, relaxed) | {
        "normals beyond θ, % of the area, before": 100.0 * beyond[0] / float(areas[0].sum()),
        "normals beyond θ, % of the area, after": 100.0 * beyond[1] / float(areas[1].sum()),
    }
    draw(out / "spherical_analogy.png", case, pair, pixels, dpi)
    for name, value in figures.items():
        print(f"{name:45} {value:.6g}")
    return figures


def sails(edge: float) -> Case:
    """Shells, each between two balls, open in front; on the bed they are locked."""
    lean, slope = cos(radians(LEAN)), sin(radians(LEAN))

    def field(x: float, y: float, z: float) -> float:
        best = -100.0
        for at, scale, way in SAILS:
            u = way * (x - at)
            depth = RADIUS * scale - sqrt(u * u + (abs(y) + SPREAD * scale) ** 2 + z * z)
            mouth = (0.3 * RADIUS * scale - u) * lean + z * slope
            best = max(best, rounded(min(depth, THICK - depth), mouth, 6.0))
        return best

    surface = level_set(field, (-320.0, -100.0, 0.0), (320.0, 100.0, 175.0), edge)
    locked = np.asarray(surface.vertices)[:, 2] < BAND
    return Case("sails", surface, locked, LIMIT, STRENGTH, EYE, 100.0)


def spindle(subdivisions: int) -> trimesh.Trimesh:
    """A′ of radius 1: a sphere between the latitudes ±θ, with the cones beyond that touch it there."""
    sphere = trimesh.creation.icosphere(subdivisions)
    points = np.array(sphere.vertices)
    limit = radians(LIMIT)
    latitude = np.arcsin(np.clip(points[:, 2], -1.0, 1.0))
    share = np.clip((np.abs(latitude) - limit) / (0.5 * np.pi - limit), 0.0, 1.0)
    around = points[:, :2] / np.maximum(np.linalg.norm(points[:, :2], axis=1), 1e-12)[:, None]
    radius = np.where(share > 0.0, cos(limit) * (1.0 - share), np.cos(latitude))
    height = np.where(
        share > 0.0, sin(limit) + share * (1.0 / sin(limit) - sin(limit)), np.abs(np.sin(latitude))
    )
    return make_surface(np.column_stack([radius[:, None] * around, np.sign(latitude) * height]), sphere.faces)


def normals_of(surface: trimesh.Trimesh) -> Array:
    """Unit normals of faces, shape (m, 3)."""
    return np.asarray(surface.face_normals, dtype=np.float64)


def nearest_of_spindle(normals: Array) -> Array:
    """The normals of the spindle that are nearest to given ones, shape (n, 3): T."""
    limit = radians(LIMIT)
    latitude = np.clip(np.arcsin(np.clip(normals[:, 2], -1.0, 1.0)), -limit, limit)
    around = normals[:, :2] / np.maximum(np.linalg.norm(normals[:, :2], axis=1), 1e-12)[:, None]
    return np.column_stack([np.cos(latitude)[:, None] * around, np.sin(latitude)])


# --- pictures ---------------------------------------------------------------------------------------------------------


def draw(path: Path, case: Case, pair: tuple[trimesh.Trimesh, ...], pixels: int, dpi: int) -> None:
    """A, A′, B and B′ above; below them normals before and after, what moved, and the distributions of overhang."""
    figure, axes = panels(4, (14.0, 7.2), rows=2, width_ratios=(1.0, 1.0, 1.35, 1.35))
    sphere = trimesh.creation.icosphere(5)
    overhang = [surface_overhang(surface, side="both") for surface in pair]
    titles = (
        "sphere $A$",
        f"style $A'$,  $θ$ = {LIMIT:g}°",
        "input $B$",
        f"stylised $B'$,  $λ$ = {STRENGTH:g}",
    )
    for place, surface, title in zip(axes[0], (sphere, spindle(5), *pair), titles, strict=True):
        rise = np.degrees(np.arcsin(np.clip(np.abs(normals_of(surface)[:, 2]), 0.0, 1.0)))
        if title == titles[1]:
            # Its faces are chords of cones, and lean a little more than these.
            rise = np.minimum(rise, LIMIT - 0.1)
        colours = lean_colours(LIMIT)
        drawn = draw_surface(
            place, surface, EYE, values=rise, limits=(0.0, 90.0), cmap=colours, pixels=pixels
        )
        place.set_title(title)
        to_scale(place, case.bar if surface in pair else None)
    # B′ is the taller one; both are drawn to one scale.
    axes[0, 2].set(xlim=axes[0, 3].get_xlim(), ylim=axes[0, 3].get_ylim())
    for place in axes[0, :2]:
        place.set(xlim=(-1.1, 1.1), ylim=(-1.6, 1.6))
    colour_bar(figure, drawn, list(axes[0]), "angle of overhang [°]", ticks=[0, LIMIT, 90])
    draw_normals(axes[1, 0], pair[0], case, targets=True)
    draw_normals(axes[1, 1], pair[1], case, targets=False)
    axes[1, 0].set_title("normals of $B$, targets $T$")
    axes[1, 1].set_title("normals of $B'$")
    draw_displacement(figure, axes[1, 2], case, pair[1], pixels)
    axes[1, 2].set_title("$D_{B-B'}$")
    to_scale(axes[1, 2])
    draw_distributions(axes[1, 3], case, overhang)
    save(figure, path, dpi)


def draw_normals(axes: Any, surface: trimesh.Trimesh, case: Case, *, targets: bool) -> None:
    """Normals of what is not locked on the unit sphere, those beyond θ red, with the arcs to their targets."""
    loose = ~case.locked[np.asarray(surface.faces)].all(axis=1)
    areas = np.where(loose, surface.area_faces, 0.0)
    places = (np.arange(SHOWN) + 0.5) / SHOWN * areas.sum()
    normals = normals_of(surface)[np.searchsorted(np.cumsum(areas), places)]
    view = View(-72.0, 18.0)
    axes.add_patch(Circle((0.0, 0.0), 1.0, facecolor="#f6f4f0", edgecolor=INK, linewidth=0.9, zorder=0))
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    for latitude in (-LIMIT, 0.0, LIMIT):
        z = sin(radians(latitude))
        circle = view.project(
            np.column_stack(
                [np.cos(turn) * sqrt(1.0 - z * z), np.sin(turn) * sqrt(1.0 - z * z), np.full(181, z)]
            )
        )
        for near, line in ((True, "-"), (False, ":")):
            shown = np.where(((circle[:, 2] >= 0.0) == near)[:, None], circle[:, :2], np.nan)
            colour = "#9b968c" if latitude == 0.0 else INK
            axes.plot(*shown.T, line, color=colour, linewidth=0.8, zorder=1)
    seen = view.project(normals)
    front = seen[:, 2] > 0.0
    beyond = np.abs(normals[:, 2]) > sin(radians(LIMIT)) + 1e-6
    for flags, colour in ((front & ~beyond, "#8b7a52"), (front & beyond, RED)):
        axes.scatter(*seen[flags, :2].T, s=4.0, color=colour, linewidths=0.0, zorder=3)
    if targets:
        chosen = normals[front & beyond][::4]
        ends = nearest_of_spindle(chosen)
        share = np.linspace(0.0, 1.0, 12)[:, None, None]
        arcs = chosen * (1.0 - share) + ends * share
        arcs /= np.linalg.norm(arcs, axis=2, keepdims=True)
        lines = view.project(arcs.reshape(-1, 3)).reshape(12, -1, 3)[:, :, :2].transpose(1, 0, 2)
        axes.add_collection(LineCollection(list(lines), colors=RED, linewidths=0.7, alpha=0.8, zorder=2))
        axes.scatter(*view.project(ends)[:, :2].T, s=5.0, color=BLUE, linewidths=0.0, zorder=4, label="$T$")
    to_scale(axes)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/examples/fig07_spherical_analogy"))
    parser.add_argument("--quick", action="store_true", help="a coarser surface and picture")
    arguments = parser.parse_args()
    main(arguments.out, arguments.quick)
