"""Overhang relaxed between fixed boundaries: a porous column and a gyroid unit (seed paper, Figure 8).

Ends that bear on neighbours are locked; between them the surface B deforms to B′ until hardly anything leans out by
more than θ. Both shapes are made here as level sets.

    python examples/fig08_overhang.py [--out out/examples/fig08_overhang] [--quick]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from math import atan2, cos, hypot, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from level_sets import level_set, rounded
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LinearSegmentedColormap, ListedColormap, Normalize
from pictures import INK, View, colour_bar, draw_surface, panels, save, to_scale

from twins import (
    OverhangRelaxation,
    SurfaceOverhang,
    lock_bounds,
    overhang_distribution,
    relax_overhang,
    surface_overhang,
)

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

COLUMN, SIDE = 420.0, 200.0  # height of the column, side of the gyroid unit, mm
BAND = 14.0  # of the column's ends that is locked, mm
HOLES = (
    (84.0, 35.0),
    (162.0, 25.0),
    (250.0, 25.0),
    (334.0, 34.0),
)  # height and radius of each ring of holes, mm
RED, BLUE, GREY = "#d1203a", "#1f6fd6", "#9c9c9c"


@dataclass(frozen=True)
class Case:
    """A shape to relax.

    Attributes:
        name: of it.
        surface: B.
        locked: its vertices that stay, shape (n,).
        limit: θ, degrees.
        strength: λ.
        view: for its pictures.
        bar: of the scale, mm.
    """

    name: str
    surface: trimesh.Trimesh
    locked: Flags
    limit: float
    strength: float
    view: View
    bar: float


def main(out: Path, quick: bool = False) -> dict[str, float]:
    """Relax both shapes and draw each; pictures land in `out`. Returns the figures of the table."""
    edges, pixels, dpi, tolerance = ((26.0, 18.0), 160, 60, 0.2) if quick else ((6.0, 5.0), 900, 130, 0.05)
    figures: dict[str, float] = {}
    for case in (column(edges[0]), gyroid_unit(edges[1])):
        relaxed = relax_overhang(case.surface, case.limit, case.strength, case.locked, tolerance=tolerance)
        figures |= {f"{name}, {case.name}": value for name, value in measured(case, relaxed).items()}
        draw(out / f"{case.name.replace(' ', '_')}.png", case, relaxed, pixels, dpi)
    for name, value in figures.items():
        print(f"{name:50} {value:.6g}")
    return figures


def column(edge: float) -> Case:
    """A hollow column with a waist and four staggered rings of six holes; its ends are locked."""

    def field(x: float, y: float, z: float) -> float:
        radius, angle = hypot(x, y), atan2(y, x)
        outer = 112.0 + 26.0 * cos(2.0 * pi * z / COLUMN)
        depth = min(outer - radius, radius - outer + 44.0)
        for ring, (height, hole) in enumerate(HOLES):
            # The six holes of a ring folded onto one.
            turn = pi / 3.0
            folded = (angle - 0.5 * turn * (ring % 2) + 0.5 * turn) % turn - 0.5 * turn
            depth = rounded(depth, hypot(radius * sin(folded), z - height) - hole, 8.0)
        return depth

    surface = level_set(field, (-150.0, -150.0, 0.0), (150.0, 150.0, COLUMN), edge)
    z = np.asarray(surface.vertices)[:, 2]
    locked = (z < BAND) | (z > COLUMN - BAND)
    return Case("porous column", surface, locked, 40.0, 10.0, View(-60.0, 4.0), 100.0)


def gyroid_unit(edge: float) -> Case:
    """One period of a gyroid's sheet, of even thickness; what lies on the sides of its cube is locked."""

    def field(x: float, y: float, z: float) -> float:
        k = 2.0 * pi / SIDE
        X, Y, Z = k * x, k * y, k * z
        value = sin(X) * cos(Y) + sin(Y) * cos(Z) + sin(Z) * cos(X)
        return (0.55 - abs(value)) / (1.4 * k)

    surface = level_set(field, (0.0, 0.0, 0.0), (SIDE, SIDE, SIDE), edge)
    return Case(
        "gyroid unit", surface, lock_bounds(surface, within=0.01), 45.0, 20.0, View(-62.0, -14.0), 50.0
    )


def measured(case: Case, relaxed: OverhangRelaxation) -> dict[str, float]:
    """Figures of one shape."""
    old, new = np.asarray(case.surface.vertices), np.asarray(relaxed.surface.vertices)
    return {
        "vertices": float(len(old)),
        "area over θ, cm², before": relaxed.over_before * 1e-2,
        "area over θ, cm², after": relaxed.over_after * 1e-2,
        "locked vertices": float(case.locked.sum()),
        "locked vertices kept to the bit": float((old == new).all(axis=1)[case.locked].sum()),
        "largest displacement, mm": relaxed.max_displacement,
        "mean displacement, mm": relaxed.mean_displacement,
        "change of volume, %": 100.0 * relaxed.volume_change,
        "Euler characteristic, before": float(case.surface.euler_number),
        "Euler characteristic, after": float(relaxed.surface.euler_number),
        "faces turned over": float(relaxed.inverted),
        "iterations": float(relaxed.iterations),
    }


# --- pictures ---------------------------------------------------------------------------------------------------------


def lean_colours(limit: float) -> LinearSegmentedColormap:
    """Pale up to the limit, red beyond, for angles of overhang from 0° to 90°."""
    at = limit / 90.0
    return LinearSegmentedColormap.from_list(
        "lean", [(0.0, "#eeeae2"), (at, "#e3c98f"), (at + 0.001, "#e8743b"), (1.0, "#6d0019")]
    )


def draw(path: Path, case: Case, relaxed: OverhangRelaxation, pixels: int, dpi: int) -> None:
    """B, B′, what moved with locked parts in grey, and the distributions of overhang."""
    tall = np.ptp(case.surface.vertices[:, 2]) > 1.2 * np.ptp(case.surface.vertices[:, 0])
    figure, axes = panels(4, (13.0, 4.9 if tall else 4.7), width_ratios=(1.0, 1.0, 1.0, 1.15))
    pair = (case.surface, relaxed.surface)
    lean = [surface_overhang(surface, side="below") for surface in pair]
    for place, surface, found in zip(axes, pair, lean, strict=False):
        drawn = draw_surface(
            place,
            surface,
            case.view,
            values=np.degrees(np.arctan(found.values)),
            limits=(0.0, 90.0),
            cmap=lean_colours(case.limit),
            pixels=pixels,
        )
    colour_bar(
        figure, drawn, list(axes[:2]), "angle of overhang [°]", location="bottom", ticks=[0, case.limit, 90]
    )
    draw_displacement(figure, axes[2], case, relaxed.surface, pixels)
    titles = ("$B$", f"$B'$,  $θ$ = {case.limit:g}°, $λ$ = {case.strength:g}", "$D_{B-B'}$")
    for place, title in zip(axes, titles, strict=False):
        place.set_title(title)
        to_scale(place, case.bar)
    draw_distributions(axes[3], case, lean)
    save(figure, path, dpi)


def draw_displacement(figure: Any, axes: Any, case: Case, after: trimesh.Trimesh, pixels: int) -> None:
    """How far each place of B′ moved; faces between locked vertices are grey."""
    faces = np.asarray(after.faces)
    moved = np.linalg.norm(np.asarray(after.vertices) - np.asarray(case.surface.vertices), axis=1)
    most = float(moved.max())
    # Values below 0 stand for what is locked: the lowest 1 / 256 of the colours.
    values = np.where(case.locked[faces].all(axis=1), -most / 255.0, moved[faces].mean(axis=1))
    blues: Colormap = colormaps["YlGnBu"]
    mixed = ListedColormap([(0.61, 0.61, 0.61, 1.0), *blues(np.linspace(0.0, 1.0, 255))])
    draw_surface(
        axes,
        after,
        case.view,
        values=values,
        limits=(-most / 255.0, most),
        cmap=mixed,
        pixels=pixels,
    )
    shown = ScalarMappable(Normalize(0.0, most), blues)
    colour_bar(figure, shown, axes, "displacement [mm], locked grey", location="bottom", aspect=16)


def draw_distributions(axes: Any, case: Case, lean: list[SurfaceOverhang]) -> None:
    """H_B and H_B′: what share of what is not locked overhangs by more than an angle."""
    angles = np.linspace(0.0, 89.0, 179)
    loose = ~case.locked[np.asarray(case.surface.faces)].all(axis=1)
    before, after = (
        replace(found, values=found.values[loose], weights=found.weights[loose]) for found in lean
    )
    table = overhang_distribution({"$H_B$": before, "$H_{B'}$": after}, np.tan(np.radians(angles)))
    for name, shares, colour in zip(table.names, table.shares, (RED, BLUE), strict=True):
        axes.fill_between(angles, 100.0 * (1.0 - shares), color=colour, alpha=0.12, linewidth=0.0)
        axes.plot(angles, 100.0 * (1.0 - shares), color=colour, label=name)
    axes.axvline(case.limit, color=INK, linewidth=0.8)
    axes.annotate(
        f"$θ$ = {case.limit:g}°",
        (case.limit, 1.0),
        (3, -4),
        xycoords=("data", "axes fraction"),
        textcoords="offset points",
        va="top",
    )
    axes.set(xlim=(0.0, 90.0), ylim=(0.0, None), xlabel="angle of overhang [°]", xticks=range(0, 91, 15))
    axes.set_ylabel("share of the area beyond [%]")
    axes.set_title("$H_B$, $H_{B'}$")
    axes.grid(alpha=0.3)
    axes.legend(loc="upper right", bbox_to_anchor=(1.0, 0.9))
    axes.set_box_aspect(1.0)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/examples/fig08_overhang"))
    parser.add_argument("--quick", action="store_true", help="coarser surfaces and pictures")
    arguments = parser.parse_args()
    main(arguments.out, arguments.quick)
