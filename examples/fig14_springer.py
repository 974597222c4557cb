"""A branching vault springer from surface to toolpath, after the seed paper's Section 5.1 and Figure 14.

The springer stands on a bed and branches into three arms that end in a tilted plane, where the next stones of the
vault bear on them. Its surface is relaxed until nothing leans out too far, sliced in rotary layers between bed and
top, and in the toolpath runs that are too close are moved apart and sharp turns rounded.

    python examples/fig14_springer.py [--out out/examples/fig14_springer] [--quick]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import trimesh
from branching import branching_springer
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.lines import Line2D
from pictures import (
    CONCRETE,
    INK,
    View,
    colour_bar,
    draw_beads,
    draw_curves,
    draw_surface,
    draw_toolpath,
    mark_stretches,
    panels,
    save,
    to_scale,
)

from twins import (
    Curve,
    OverfillRelief,
    OverhangRelaxation,
    Plane,
    PlaneStack,
    Reference,
    Smoothed,
    Spacing,
    Toolpath,
    Zones,
    check_surface,
    largest_turning,
    layer_planes,
    lock_base,
    lock_plane,
    overhang_distribution,
    relax_overhang,
    relieve_overfill,
    resample,
    signed_volume,
    slice_surface,
    smooth,
    spacing,
    surface_overhang,
    visual_mesh,
)
from twins.curves.close_points import CLOSE, Runs, nearest_runs
from twins.curves.turning import turning_angles

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Result = TypeVar("Result")

LIMIT = 45.0  # angle of overhang, degrees: d/t = 1, what concrete with an accelerator carries
WIDTH = 24.0  # of a bead, mm
APART = 22.0  # d_min, mm, a little less
LEAST_RADIUS = 10.0  # of bends, mm; below d_min / 2, so that a turn fits between runs that are d_min apart
SHARP = APART / LEAST_RADIUS  # turning of such a bend within d_min, rad
COARSE, FINE = APART / 4.0, LEAST_RADIUS / 6.0  # between points, to move runs apart and to round turns, mm

STAGES = ("before", "after relief", "after")
BELOW, ABOVE = View(150.0, 4.0), View(-28.0, 34.0)
RED, BLUE = "#d1203a", "#1f6fd6"
_LEAN = LinearSegmentedColormap.from_list(
    "lean", [(0.0, "#eeeae2"), (0.5, "#e3c98f"), (0.501, "#e8743b"), (1.0, "#6d0019")]
)


@dataclass(frozen=True)
class Size:
    """How fine all is.

    Attributes:
        subdivisions: of the cage.
        thickness: of layers, mm.
        pixels, dpi: of pictures.
    """

    subdivisions: int
    thickness: float
    pixels: int
    dpi: int


FULL, QUICK = Size(4, 10.0, 900, 130), Size(3, 20.0, 260, 60)


@dataclass
class Clock:
    """Seconds that steps took."""

    seconds: dict[str, float] = field(default_factory=dict)

    def time(self, name: str, step: Callable[[], Result]) -> Result:
        """What a step returns."""
        start = time.perf_counter()
        result = step()
        self.seconds[name] = time.perf_counter() - start
        return result


def main(out: Path, quick: bool = False) -> dict[str, float]:
    """Take the springer from surface to printed look; pictures land in `out`. Returns the figures of the table."""
    size, clock = QUICK if quick else FULL, Clock()
    surface, top = clock.time("surface", lambda: branching_springer(size.subdivisions))
    planes = layer_planes(Plane.horizontal(), top, size.thickness)
    relaxation = clock.time("relaxation", lambda: relaxed(surface, top))
    toolpath = clock.time("slicing", lambda: slice_surface(relaxation.surface, planes, COARSE))
    zones = Zones(
        layers=[0, len(toolpath.layers) - 1]
    )  # what bears on the neighbours stays as it was designed
    relief = clock.time("overfill", lambda: relieved(toolpath, zones))
    smoothed = clock.time("smoothing", lambda: rounded(relief.toolpath, zones))
    printed = clock.time("M_vis", lambda: visual_mesh(smoothed.toolpath, WIDTH))
    check_surface(printed)
    figures = {
        **surface_figures(surface, relaxation, planes),
        **toolpath_figures(toolpath, relief, smoothed),
        "printed volume, l": signed_volume(printed) * 1e-6,
    }

    def draw() -> None:
        draw_overhang(out / "overhang.png", surface, relaxation.surface, size)
        draw_distribution(out / "distribution.png", surface, relaxation.surface, planes, size)
        pair = tuple(resample(t, FINE, corner_deg=1.0) for t in (toolpath, smoothed.toolpath))
        marks = tuple(marked(t) for t in pair)
        draw_toolpaths(out / "toolpath.png", pair, marks, size)
        draw_layers(out / "layers.png", pair, marks, size)
        draw_printed(out / "printed.png", printed, size)

    clock.time("pictures", draw)
    figures |= {f"{name}, s": seconds for name, seconds in clock.seconds.items()}
    show(figures)
    return figures


def relaxed(surface: trimesh.Trimesh, top: Plane) -> OverhangRelaxation:
    """The surface with its overhang relaxed; bed and bearing faces stay.

    Overhang is taken against the horizontal, not against the rotary planes: fresh concrete falls along gravity
    however its layers are tilted, and the limit of the mix is one by ground. Against the planes the intrados, which
    leans out by the whole turn of the layers, would pass as upright.
    """
    bearing = lock_plane(surface, top, within=0.1)
    return relax_overhang(surface, LIMIT, locked=lock_base(surface) | bearing, tolerance=0.005)


def relieved(toolpath: Toolpath, zones: Zones) -> OverfillRelief:
    """Runs that are nearer than d_min moved apart, at d_min / 4 between points: finer, notches grow shoulders."""
    return relieve_overfill(toolpath, APART, zones)


def rounded(toolpath: Toolpath, zones: Zones) -> Smoothed:
    """Turns below the least radius rounded, into the material only.

    So the slots between the arms stay as long and as wide as they are; with both sides permitted their ends are filled.
    """
    fine = resample(toolpath, FINE, corner_deg=1.0, locked=zones)
    return smooth(fine, 1, 1.0 / LEAST_RADIUS, window=APART, locked=zones)


def surface_figures(
    surface: trimesh.Trimesh, relaxation: OverhangRelaxation, planes: PlaneStack
) -> dict[str, float]:
    """Figures of the relaxation, by its own measure and as local overhang of the rotary layers."""
    ground, layer = (
        [
            100.0 * surface_overhang(s, planes, reference, "below").share_above(1.0)
            for s in (surface, relaxation.surface)
        ]
        for reference in ("ground", "layer")
    )
    return {
        f"area over {LIMIT:g}°, cm², before": relaxation.over_before * 1e-2,
        f"area over {LIMIT:g}°, cm², after": relaxation.over_after * 1e-2,
        "largest angle of overhang, °, before": relaxation.worst_before_deg,
        "largest angle of overhang, °, after": relaxation.worst_after_deg,
        "area with d/t > 1 by ground, %, before": ground[0],
        "area with d/t > 1 by ground, %, after": ground[1],
        "area with d/t > 1 by layer, %, before": layer[0],
        "area with d/t > 1 by layer, %, after": layer[1],
        "largest displacement of the surface, mm": relaxation.max_displacement,
        "change of volume, %": 100.0 * relaxation.volume_change,
    }


def toolpath_figures(toolpath: Toolpath, relief: OverfillRelief, smoothed: Smoothed) -> dict[str, float]:
    """Figures of the toolpath as it was sliced, after relief, and at the end."""
    stages = (toolpath, relief.toolpath, smoothed.toolpath)
    close = [Spacing.total(spacing(stage, APART)).close for stage in stages]
    turning = [
        np.degrees(max(largest_turning(curve, APART) for *_, curve in stage.curves())) for stage in stages
    ]
    area = [sum(curve.signed_area for *_, curve in stage.curves()) for stage in stages]
    return {
        "layers": float(len(toolpath.layers)),
        "rotary": float(toolpath.is_rotary),
        "length of the toolpath, m": smoothed.toolpath.length * 1e-3,
        **{f"overfilled length, mm, {name}": value for name, value in zip(STAGES, close, strict=True)},
        **{
            f"largest turning in {APART:g} mm, °, {name}": float(value)
            for name, value in zip(STAGES, turning, strict=True)
        },
        "largest displacement by relief, mm": relief.displacement,
        "largest displacement by smoothing, mm": max(x.largest_displacement for x in smoothed.layers),
        "change of region area, %": 100.0 * (area[-1] / area[0] - 1.0),
        "largest change of a layer's area by relief, %": 100.0 * relief.largest_area_change,
        "end layers unchanged": float(
            all(stages[0].layers[i].curves == stages[-1].layers[i].curves for i in (0, -1))
        ),
        "curves left alone by smoothing": float(sum(len(x.left_alone) for x in smoothed.layers)),
    }


def show(figures: dict[str, float]) -> None:
    """Print figures; those of the same thing before and after stand in one row."""
    rows: dict[str, dict[str, float]] = {}
    for name, value in figures.items():
        what, _, stage = name.rpartition(", ")
        what, stage = (what, stage) if stage in STAGES else (name, STAGES[-1])
        rows.setdefault(what, {})[stage] = value
    width = max(len(what) for what in rows)
    print(f"{'':{width}s}" + "".join(f"{stage:>14s}" for stage in STAGES))
    for what, row in rows.items():
        print(f"{what:{width}s}" + "".join(f"{row[s]:14.4g}" if s in row else f"{'':14s}" for s in STAGES))


# --- pictures ---------------------------------------------------------------------------------------------------------


def draw_overhang(path: Path, before: trimesh.Trimesh, after: trimesh.Trimesh, size: Size) -> None:
    """The surface before and after, coloured by the angle of overhang, and what moved."""
    figure, axes = panels(3, (12.0, 5.2))
    titles = ("Surface B", "Relaxed surface B′", "Displacement B to B′")
    for place, surface in zip(axes, (before, after), strict=False):
        lean = np.degrees(np.arctan(surface_overhang(surface, side="below").values))
        drawn = draw_surface(
            place, surface, BELOW, values=lean, limits=(0.0, 2.0 * LIMIT), cmap=_LEAN, pixels=size.pixels
        )
    colour_bar(figure, drawn, list(axes[:2]), f"angle of overhang [°], limit {LIMIT:g}°", location="bottom")
    moved = np.linalg.norm(np.asarray(after.vertices) - np.asarray(before.vertices), axis=1)
    drawn = draw_surface(axes[2], after, BELOW, values=moved, cmap="PuBu", pixels=size.pixels)
    colour_bar(figure, drawn, axes[2], "displacement [mm]", location="bottom", aspect=20)
    for place, title in zip(axes, titles, strict=True):
        place.set_title(title)
        to_scale(place, 100.0)
    save(figure, path, size.dpi)


def draw_distribution(
    path: Path, before: trimesh.Trimesh, after: trimesh.Trimesh, planes: PlaneStack, size: Size
) -> None:
    """H_B and H_B′: what share of the surface overhangs by how much, by ground and by layer."""
    figure, axes = panels(1, (7.0, 4.2))
    lines: dict[Reference, str] = {"ground": "-", "layer": ":"}
    for reference, line in lines.items():
        table = overhang_distribution(
            {
                "$H_B$": surface_overhang(before, planes, reference, "below"),
                "$H_{B'}$": surface_overhang(after, planes, reference, "below"),
            },
            np.linspace(0.0, 2.0, 201),
        )
        for name, shares, colour in zip(table.names, table.shares, (RED, BLUE), strict=True):
            axes.plot(table.overhang, 100.0 * shares, line, color=colour, label=f"{name}, by {reference}")
    axes.axvline(1.0, color=INK, linewidth=0.8)
    axes.text(1.02, 62.0, "limit d/t = 1", rotation=90.0, va="bottom")
    axes.set(xlim=(0.0, 2.0), ylim=(60.0, 100.5), xlabel="local overhang d/t of the side below")
    axes.set(ylabel="share of the area with at most that [%]", title="Overhang distribution before and after")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    save(figure, path, size.dpi)


@dataclass(frozen=True, eq=False)
class Marks:
    """What is wrong with a toolpath, and where: for each layer and curve flags of its points, shape (n,).

    Attributes:
        close: nearer than 0.95 d_min to another run.
        sharp: in the middle of a piece of length d_min that turns by more than a bend of the least radius.
    """

    close: list[list[Flags]]
    sharp: list[list[Flags]]


def marked(toolpath: Toolpath) -> Marks:
    """What is wrong with a toolpath of fine segments, and where."""
    close, sharp = [], []
    for layer in toolpath.layers:
        runs = Runs.of(layer.curves)
        near = nearest_runs(runs, APART)[0] < CLOSE * APART if len(runs.points) else np.empty(0, bool)
        close.append(np.split(near, runs.starts[1:-1]))
        sharp.append([_turning_around(curve) > SHARP for curve in layer.curves])
    return Marks(close, sharp)


def _turning_around(curve: Curve) -> Array:
    """How much a closed curve turns within d_min / 2 of each point to either side, shape (n,), rad."""
    turns = np.tile(np.abs(turning_angles(curve.points)), 3)
    steps = np.linalg.norm(np.roll(curve.points, -1, axis=0) - curve.points, axis=1)
    place = np.concatenate([[0.0], np.cumsum(np.tile(steps, 3))[:-1]])
    summed = np.concatenate([[0.0], np.cumsum(turns)])
    middle = place[len(steps) : 2 * len(steps)]
    first, last = (np.searchsorted(place, middle + way * 0.5 * APART) for way in (-1.0, 1.0))
    return np.asarray(summed[last] - summed[first], dtype=np.float64)


def draw_toolpaths(path: Path, pair: tuple[Toolpath, ...], marks: tuple[Marks, ...], size: Size) -> None:
    """The toolpath in space before and after, with what is too close and what is too sharp."""
    figure, axes = panels(2, (10.0, 6.0))
    for place, toolpath, mark in zip(axes, pair, marks, strict=True):
        draw_toolpath(place, toolpath, ABOVE, colour="#a9a49b", linewidth=0.7)
        draw_toolpath(place, toolpath, ABOVE, colour=RED, linewidth=1.8, only=mark.close)
        draw_toolpath(place, toolpath, ABOVE, colour=BLUE, linewidth=3.0, only=mark.sharp)
        to_scale(place, 100.0)
    axes[0].set_title(f"Sliced: {len(pair[0].layers)} rotary layers")
    axes[1].set_title("Runs moved apart, turns rounded")
    figure.legend(handles=_legend(), loc="outside lower center", ncols=2, frameon=False)
    save(figure, path, size.dpi)


def draw_layers(path: Path, pair: tuple[Toolpath, ...], marks: tuple[Marks, ...], size: Size) -> None:
    """The layer with the sharpest bends and the one with most overfill in plan, with their beads."""
    close = np.array([sum(int(flag.sum()) for flag in layer) for layer in marks[0].close])
    turning = np.array([max(largest_turning(c, APART) for c in layer.curves) for layer in pair[0].layers])
    sharpest = int(np.argmax(turning))
    fullest = int(np.argmax(np.where(np.arange(len(close)) == sharpest, -1, close)))
    figure, axes = panels(2, (8.6, 9.0), rows=2)
    for row, layer in zip(axes, (sharpest, fullest), strict=True):
        for place, toolpath, mark, when in zip(row, pair, marks, ("sliced", "optimised"), strict=True):
            curves = toolpath.layers[layer].curves
            draw_beads(place, curves, WIDTH, facecolor="#8d877c", alpha=0.45)
            draw_curves(place, curves, linewidth=0.9)
            mark_stretches(place, curves, mark.close[layer], colors=RED)
            mark_stretches(place, curves, mark.sharp[layer], colors=BLUE)
            place.set_title(f"Layer {layer}, {when}")
            to_scale(place, 100.0)
    figure.legend(handles=_legend(), loc="outside lower center", ncols=2, frameon=False)
    save(figure, path, size.dpi)


def draw_printed(path: Path, printed: trimesh.Trimesh, size: Size) -> None:
    """M_vis, the printed look, from above and from below."""
    figure, axes = panels(2, (10.0, 6.0))
    for place, view in zip(axes, (ABOVE, BELOW), strict=True):
        draw_surface(place, printed, view, colour=CONCRETE, pixels=size.pixels)
        to_scale(place, 100.0)
    figure.suptitle(f"$M_{{vis}}$: beads of {WIDTH:g} mm in rotary layers of {size.thickness:g} mm")
    save(figure, path, size.dpi)


def _legend() -> list[Line2D]:
    return [
        Line2D(
            [], [], color=RED, linewidth=3.0, label=f"nearer than {CLOSE:g} × {APART:g} mm to another run"
        ),
        Line2D(
            [],
            [],
            color=BLUE,
            linewidth=3.0,
            label=f"turns more than {np.degrees(SHARP):.0f}° in {APART:g} mm",
        ),
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/examples/fig14_springer"))
    parser.add_argument("--quick", action="store_true", help="a reduced size")
    chosen = parser.parse_args()
    main(chosen.out, chosen.quick)
