"""A layer that embeds two rectangular reinforcements, optimised around them (seed paper, Figure 13).

The layer is cut through a porous wall: sheets that branch and merge inside an outline, with a frame around each of
two rectangular reinforcements. Runs that are too close are moved apart and sharp turns rounded, while what lies in the
zones around the reinforcements, and the outer face, stay to the bit.

    python examples/fig13_protected_zones.py [--out out/examples/fig13_protected_zones] [--quick]
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import contourpy
import numpy as np
import numpy.typing as npt
import shapely
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from pictures import INK, draw_beads, draw_curves, mark_stretches, panels, save, to_scale

from twins import (
    Curve,
    Layer,
    Plane,
    Spacing,
    Toolpath,
    Zones,
    relieve_overfill,
    resample,
    smooth,
    spacing,
)
from twins.curves.close_points import CLOSE, Runs, nearest_runs
from twins.curves.turning import curvature

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

WIDTH, APART = 20.0, 19.0  # of a bead, and d_min, mm
RADIUS = 9.0  # 1 / κ_max, mm: below d_min / 2, so that a turn fits between runs that are d_min apart
LENGTH, HEIGHT, ROUND = 620.0, 250.0, 90.0  # of the outline, and radius of its corners, mm
PERIOD, SHEET = (
    190.0,
    0.38,
)  # of the gyroid that the layer is cut from, mm, and the value that its sheets end at
WALL = 21.0  # of outline and frames, from run to run, mm
BARS = (
    (-150.0, 12.0, 74.0, 30.0),
    (150.0, -12.0, 74.0, 30.0),
)  # reinforcements: middle, length and width, mm
COVER = 10.0  # from a reinforcement to the run around it, mm
FRAME = COVER + WALL
ZONE = 15.0  # from a reinforcement to the rim of its zone, mm
RED, BLUE, STEEL, GREEN = "#d1203a", "#1f6fd6", "#5c6773", "#1a8f5a"


def main(out: Path, quick: bool = False) -> dict[str, float]:
    """Optimise the layer around its zones; the picture lands in `out`. Returns the figures of the table."""
    segment, dpi = (RADIUS / 4.0, 60) if quick else (RADIUS / 6.0, 140)
    toolpath = toolpath_of(layer_region(4.0 if quick else 2.0), segment)
    drawn = [shapely.box(*rectangle(bar, ZONE)) for bar in BARS]
    # The outer face of the wall stays too: curve 0.
    zones = Zones(polygons=drawn, curves=[(0, 0)])
    relief = relieve_overfill(toolpath, APART, zones)
    fine = resample(relief.toolpath, segment, locked=zones)
    smoothed = smooth(fine, 0, 1.0 / RADIUS, window=APART, locked=zones)
    after, zone = smoothed.toolpath, shapely.union_all(drawn)
    stages = {
        "before": toolpath,
        "after relief": fine,
        "after": after,
    }
    figures: dict[str, float] = {"curves": float(len(toolpath.layers[0].curves))}
    for stage, path in stages.items():
        curves = path.layers[0].curves
        found = Spacing.total(spacing(path, APART))
        figures |= {
            f"overfilled length, mm, {stage}": found.close,
            f"least distance of runs, mm, {stage}": found.least,
            f"points bent too sharply, {stage}": float(sum(int(flag.sum()) for flag in too_sharp(curves))),
            f"region area, cm², {stage}": 1e-2 * sum(curve.signed_area for curve in curves),
        }
    protected = segments_in(toolpath, zone)
    figures |= {
        "points bent too sharply that are protected": float(protected_corners(toolpath, zones)),
        "segments in the zones": float(len(protected)),
        "segments in the zones, kept to the bit": float(len(protected & segments_in(after, zone))),
        "segments in the zones, after": float(len(segments_in(after, zone))),
        "outer curve kept": float(
            np.array_equal(after.layers[0].curves[0].points, toolpath.layers[0].curves[0].points)
        ),
        "largest displacement by relief, mm": relief.displacement,
        "largest displacement by smoothing, mm": smoothed.layers[0].largest_displacement,
        "smoothing finished": float(not smoothed.layers[0].remaining and not smoothed.layers[0].left_alone),
    }
    draw(out / "protected_zones.png", toolpath, after, dpi)
    for name, value in figures.items():
        print(f"{name:50} {value:.6g}")
    return figures


def protected_corners(toolpath: Toolpath, zones: Zones) -> int:
    """Points bent too sharply that may not move."""
    flags = zones.protected(toolpath)[0]
    sharp = too_sharp(toolpath.layers[0].curves)
    return sum(int((a & b).sum()) for a, b in zip(flags, sharp, strict=True))


def layer_region(step: float) -> shapely.Polygon:
    """What the layer's curves enclose: sheets and an outer wall, with frames around the reinforcements."""
    half = 0.5 * LENGTH - ROUND, 0.5 * HEIGHT - ROUND
    outline = shapely.box(-half[0], -half[1], *half).buffer(ROUND, quad_segs=60)
    x = np.arange(-LENGTH / 2 - 20.0, LENGTH / 2 + 20.0, step)
    y = np.arange(-HEIGHT / 2 - 20.0, HEIGHT / 2 + 20.0, step)
    X, Y = np.meshgrid(2.0 * np.pi / PERIOD * x, 2.0 * np.pi / PERIOD * y)
    Z = 0.9
    gyroid = np.sin(X) * np.cos(Y) + np.sin(Y) * np.cos(Z) + np.sin(Z) * np.cos(X)
    sheets = enclosed(x, y, SHEET - np.abs(gyroid))
    wall = outline.difference(outline.buffer(-WALL))
    frames = [shapely.box(*rectangle(bar, FRAME)) for bar in BARS]
    pockets = [shapely.box(*rectangle(bar, COVER)) for bar in BARS]
    region = shapely.union_all([shapely.intersection(sheets, outline), wall, *frames])
    if not isinstance(region, shapely.Polygon):
        raise TypeError("the layer must be one region")
    # Voids that no disc of the least radius fits in are filled.
    filled = shapely.Polygon(region.exterior, [h for h in region.interiors if opens(shapely.Polygon(h))])
    return shapely.Polygon(filled.exterior, [*filled.interiors, *(pocket.exterior for pocket in pockets)])


def opens(void: shapely.Polygon) -> bool:
    """Whether a run of the least radius fits into a void."""
    return not void.buffer(-RADIUS).is_empty


def rectangle(bar: tuple[float, ...], around: float) -> tuple[float, float, float, float]:
    """Bounds of a reinforcement, grown on all sides."""
    u, v, length, width = bar
    return (
        u - 0.5 * length - around,
        v - 0.5 * width - around,
        u + 0.5 * length + around,
        v + 0.5 * width + around,
    )


def enclosed(x: Array, y: Array, values: Array) -> shapely.Geometry:
    """Where values on a grid are above 0."""
    made = contourpy.contour_generator(x, y, values, fill_type="OuterOffset").filled(0.0, np.inf)
    polygons = []
    for points, ends in zip(made[0], made[1], strict=True):
        rings = [np.asarray(points)[a:b] for a, b in pairwise(np.asarray(ends).tolist())]
        polygons.append(shapely.make_valid(shapely.Polygon(rings[0], rings[1:])))
    return shapely.union_all(polygons)


def toolpath_of(region: shapely.Polygon, segment: float) -> Toolpath:
    """One layer with the region's boundaries as curves, in equal segments but for their corners."""
    region = shapely.geometry.polygon.orient(region)
    rings = [np.asarray(ring.coords) for ring in (region.exterior, *region.interiors)]
    # Where boundaries meet, overlays may leave two points for one.
    rings = [ring[:-1][np.linalg.norm(np.diff(ring, axis=0), axis=1) > 1e-6] for ring in rings]
    layer = Layer(Plane.horizontal(5.0), Plane.horizontal(10.0), tuple(Curve(ring) for ring in rings))
    return resample(Toolpath(Plane.horizontal(), (layer,), 10.0), segment, corner_deg=20.0)


def segments_in(toolpath: Toolpath, zone: shapely.Geometry) -> set[tuple[float, ...]]:
    """The segments that touch a zone, each as its four coordinates."""
    found: set[tuple[float, ...]] = set()
    for *_, curve in toolpath.curves():
        ends = np.hstack([curve.points, np.roll(curve.points, -1, axis=0)])
        touched = shapely.intersects(zone, shapely.linestrings(ends.reshape(-1, 2, 2)))
        found |= {tuple(row) for row in ends[touched].tolist()}
    return found


def too_close(curves: tuple[Curve, ...]) -> list[Flags]:
    """Points nearer than 0.95 d_min to another run, for each curve."""
    runs = Runs.of(curves)
    return np.split(nearest_runs(runs, APART)[0] < CLOSE * APART, runs.starts[1:-1])


def too_sharp(curves: tuple[Curve, ...]) -> list[Flags]:
    """Points where curves are bent more than κ_max, by equation (3)."""
    return [curvature(curve.points) > (1.0 + 1e-6) / RADIUS for curve in curves]


# --- pictures ---------------------------------------------------------------------------------------------------------


def draw(path: Path, before: Toolpath, after: Toolpath, dpi: int) -> None:
    """The layer before and after, with its beads, its zones, and what is wrong with it."""
    figure, axes = panels(1, (9.0, 8.6), rows=2)
    for place, toolpath, title in zip(axes, (before, after), ("As designed", "Optimised"), strict=True):
        curves = toolpath.layers[0].curves
        draw_beads(place, curves, WIDTH, facecolor="#8d877c", alpha=0.42, zorder=1)
        if toolpath is after:
            draw_curves(
                place, before.layers[0].curves, color=RED, linewidth=0.7, linestyle=(0, (4, 3)), zorder=2
            )
        draw_curves(place, curves, color=INK, linewidth=1.0, zorder=2.5)
        mark_stretches(place, curves, too_close(curves), colors=RED, linewidths=2.6)
        mark_stretches(place, curves, too_sharp(curves), colors=BLUE, linewidths=3.4, zorder=3.5)
        for bar in BARS:
            u, v, length, width = bar
            place.add_patch(Rectangle((u - length / 2, v - width / 2), length, width, facecolor=STEEL))
            low_u, low_v, high_u, high_v = rectangle(bar, ZONE)
            place.add_patch(
                Rectangle(
                    (low_u, low_v),
                    high_u - low_u,
                    high_v - low_v,
                    fill=False,
                    edgecolor=GREEN,
                    linewidth=1.3,
                    zorder=4,
                )
            )
        place.set_title(title, loc="left")
        to_scale(place, 100.0, margin=0.01)
    figure.legend(handles=key(), loc="outside lower center", ncols=3, frameon=False)
    save(figure, path, dpi)


def key() -> list[Line2D | Patch]:
    """What colours mean."""
    return [
        Patch(color=STEEL, label="reinforcement"),
        Patch(facecolor="none", edgecolor=GREEN, linewidth=1.3, label="protected zone"),
        Line2D([], [], color=RED, linewidth=0.7, linestyle=(0, (4, 3)), label="curves before"),
        Line2D([], [], color=RED, linewidth=2.6, label=f"nearer than {CLOSE:g} × {APART:g} mm to a run"),
        Line2D([], [], color=BLUE, linewidth=3.4, label=f"bent more sharply than 1/{RADIUS:g} mm"),
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/examples/fig13_protected_zones"))
    parser.add_argument("--quick", action="store_true", help="coarser curves and pictures")
    arguments = parser.parse_args()
    main(arguments.out, arguments.quick)
