"""Smoothing with a side and a curvature constraint, and one step of it (seed paper, Figures 9 and 10).

A polyline with sharp corners and with densely turning points is smoothed to its left and to its right, and with three
limits of curvature. A second picture shows a single step of Algorithm 1: what equation (1) asks for, and where that
goes if it points to the locked side.

    python examples/fig09_smoothing.py [--out out/examples/fig09_smoothing] [--quick]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import shapely
from matplotlib.collections import PatchCollection
from matplotlib.patches import Circle
from pictures import INK, draw_curves, panels, save, to_scale

from twins import Curve, Layer, Plane, Smoothed, Toolpath, resample, smooth
from twins.curves.smoothing_step import displacements
from twins.curves.turning import curvature, turning_angles

Array = npt.NDArray[np.float64]
Side = Literal[-1, 1]

SEGMENT = 2.0  # of the polyline, mm
RADII = (20.0, 10.0, 5.0)  # 1 / κ_max, mm
SHOWN = RADII[1]
FAR = 200.0  # beyond all curves, mm
GREY, RED, BLUE = "#bdb9b1", "#d1203a", "#0b4aa8"
SHADES = ("#0b3f8f", "#3f88dd", "#8fbdf0")
LEFT: Side = 1
RIGHT: Side = -1
SIDES: dict[Side, str] = {LEFT: "left", RIGHT: "right"}
# Corners of the polyline, mm, and at the end the scallops that it ends in: densely turning points.
CORNERS = ((0.0, 0.0), (38.0, 0.0), (56.0, 58.0), (80.0, -8.0), (80.0, 34.0), (118.0, 34.0), (118.0, 0.0))
SCALLOPS, SCALLOP, FROM = 4, 11.0, (137.0, 0.0)  # how many, their radius, where the first begins, mm
END = 270.0


def main(out: Path, quick: bool = False) -> dict[str, float]:
    """Smooth the polyline and draw both pictures into `out`. Returns figures; "deepest" is 0 where a side is kept."""
    dpi = 70 if quick else 150
    given = polyline()
    cases: list[tuple[Side, float]] = [(LEFT, SHOWN), *((RIGHT, radius) for radius in RADII)]
    results = {
        (side, radius): smooth(one_layer(given), side, 1.0 / radius, steps=3000) for side, radius in cases
    }
    figures: dict[str, float] = {}
    for (side, radius), result in results.items():
        layer, case = result.layers[0], f"{SIDES[side]} permitted, {radius:g} mm"
        figures |= {
            f"curvature over κ_max, before, {case}": layer.largest_curvature_before * radius,
            f"curvature over κ_max, after, {case}": layer.largest_curvature * radius,
            f"deepest on the locked side, mm, {case}": deepest(given, curve_of(result), side),
            f"largest displacement, mm, {case}": layer.largest_displacement,
            f"points that stay to the bit, %, {case}": 100.0 * unmoved(given, curve_of(result)),
            f"steps, {case}": float(layer.steps),
        }
    draw_smoothing(out / "smoothing.png", given, results, dpi)
    figures |= draw_step(out / "one_step.png", dpi)
    for name, value in figures.items():
        print(f"{name:65} {value:.6g}")
    return figures


def polyline() -> Curve:
    """Corners, then scallops, in segments of equal length, from left to right."""
    angle = np.pi * np.arange(24)[::-1] / 23.0
    arch = SCALLOP * np.column_stack([1.0 + np.cos(angle), 0.9 * np.sin(angle)])
    scallops = [arch + FROM + [2.0 * SCALLOP * k, 0.0] for k in range(SCALLOPS)]
    points = np.concatenate([np.array(CORNERS), *(s[:-1] for s in scallops), scallops[-1][-1:], [[END, 0.0]]])
    rough = one_layer(Curve(points, closed=False))
    return resample(rough, SEGMENT, corner_deg=30.0).layers[0].curves[0]


def one_layer(curve: Curve) -> Toolpath:
    """A toolpath of one curve."""
    return Toolpath(
        Plane.horizontal(), (Layer(Plane.horizontal(5.0), Plane.horizontal(10.0), (curve,)),), 10.0
    )


def curve_of(result: Smoothed) -> Curve:
    """The one curve of a result."""
    return result.toolpath.layers[0].curves[0]


def locked_region(curve: Curve, side: Side) -> shapely.Polygon:
    """What lies on the locked side of a curve that goes from left to right, as far as FAR."""
    beyond = [[curve.points[-1, 0], -side * FAR], [curve.points[0, 0], -side * FAR]]
    return shapely.Polygon(np.vstack([curve.points, beyond]))


def deepest(given: Curve, result: Curve, side: Side) -> float:
    """How far any place of the result lies on the locked side of the given curve, mm; 0 if none does."""
    inside = shapely.intersection(shapely.LineString(result.points), locked_region(given, side))
    places = shapely.points(shapely.get_coordinates(shapely.segmentize(inside, 0.2)))
    return float(shapely.distance(places, shapely.LineString(given.points)).max(initial=0.0))


def unmoved(given: Curve, result: Curve) -> float:
    """Share of the given points that the result still has, to the bit."""
    kept = {tuple(point) for point in result.points}
    return float(np.mean([tuple(point) in kept for point in given.points]))


# --- pictures ---------------------------------------------------------------------------------------------------------


def draw_smoothing(path: Path, given: Curve, results: dict[tuple[Side, float], Smoothed], dpi: int) -> None:
    """The polyline in grey, with what becomes of it to either side, and for each limit of curvature."""
    figure, axes = panels(1, (9.0, 6.3), rows=2, sharex=True)
    for place in axes:
        draw_curves(place, [given], color=GREY, linewidth=4.0, zorder=1, label="polyline")
    for side, colour in ((LEFT, RED), (RIGHT, BLUE)):
        draw_curves(
            axes[0],
            [curve_of(results[side, SHOWN])],
            color=colour,
            linewidth=1.5,
            zorder=2,
            label=f"{SIDES[side]} side permitted",
        )
    for radius, colour in zip(RADII, SHADES, strict=True):
        curve = curve_of(results[RIGHT, radius])
        draw_curves(
            axes[1], [curve], color=colour, linewidth=1.5, zorder=2, label=f"1/$κ_{{max}}$ = {radius:g} mm"
        )
        if radius == SHOWN:
            discs(axes[1], curve, radius, colour)
    titles = (
        f"(a) Side constraint, 1/$κ_{{max}}$ = {SHOWN:g} mm",
        "(b) Side and curvature constraint, right side permitted",
    )
    for place, title in zip(axes, titles, strict=True):
        place.set_title(title, loc="left")
        to_scale(place, 50.0 if place is axes[1] else None)
        place.legend(loc="upper right", frameon=False, fontsize=9)
    save(figure, path, dpi)


def discs(axes: Any, curve: Curve, radius: float, colour: str) -> None:
    """Circles of a radius, each inside the middle of a stretch that turns far and is bent about that much."""
    into, out = np.diff(curve.points, axis=0)[:-1], np.diff(curve.points, axis=0)[1:]
    turn = turning_angles(curve.points, closed=False)[1:-1]
    bent = np.where(curvature(curve.points, closed=False)[1:-1] > 0.6 / radius, np.sign(turn), 0.0)
    starts = np.flatnonzero(np.diff(np.concatenate([[0.0], bent])))
    circles = []
    for first, last in zip(starts.tolist(), [*starts[1:].tolist(), len(bent)], strict=True):
        if not bent[first] or abs(turn[first:last].sum()) < np.radians(75.0):
            continue
        middle = (first + last) // 2
        along = into[middle] + out[middle]
        normal = bent[first] * np.array([-along[1], along[0]]) / np.linalg.norm(along)
        circles.append(Circle(curve.points[middle + 1] + radius * normal, radius))
    axes.add_collection(
        PatchCollection(circles, facecolor="none", edgecolor=colour, linewidth=0.9, linestyle=":", zorder=2)
    )


# The polyline of which one step is drawn, mm: a corner that turns left, and one that turns right.
STEP_POINTS = (
    (0.0, 5.0),
    (32.0, 5.0),
    (64.0, 5.0),
    (88.0, -34.0),
    (112.0, 5.0),
    (146.0, 5.0),
    (172.0, 44.0),
    (198.0, 5.0),
    (230.0, 5.0),
    (262.0, 5.0),
)
LEFT_TURN, RIGHT_TURN = 3, 6


def draw_step(path: Path, dpi: int) -> dict[str, float]:
    """One step of Algorithm 1 with the right side permitted, and what was drawn as figures."""
    points, strengths = np.array(STEP_POINTS), (1.0, 0.05)
    n = len(points)
    before, after = np.arange(n) - 1, np.append(np.arange(1, n), -1)
    moved, _ = displacements(points, before, after, -1, strengths, np.zeros(n), stops=False)
    raw, normal = np.zeros_like(points), np.zeros_like(points)
    raw[1:-1] = 0.25 * (points[:-2] - 2.0 * points[1:-1] + points[2:])
    chord = points[2:] - points[:-2]
    normal[1:-1] = np.column_stack([chord[:, 1], -chord[:, 0]]) / np.linalg.norm(chord, axis=1)[:, None]
    held = np.einsum("ij,ij->i", raw, normal) < 0.0
    adjusted = np.zeros_like(points)
    for i in np.flatnonzero(held).tolist():
        adjusted[[i - 1, i + 1]] -= 0.5 * raw[i]
    figure, axes = panels(1, (9.0, 3.9))
    axes.plot(*points.T, color=GREY, linewidth=3.5, zorder=1, label="polyline")
    axes.plot(
        *(points + moved).T, "o-", color=BLUE, linewidth=1.4, markersize=4.0, zorder=3, label="after one step"
    )
    axes.plot(*points.T, "o", color="#85817a", markersize=6.5, zorder=2)
    for i in range(1, n - 1):
        if held[i]:
            arrow(axes, points[i], raw[i], RED, "--")
        if np.linalg.norm(moved[i]) > 1.0:
            arrow(axes, points[i], moved[i], BLUE)
    arrow(axes, points[LEFT_TURN], 12.0 * normal[LEFT_TURN], INK)
    label_step(axes, points, raw)
    axes.plot([], [], "--", color=RED, label="displacement $f$ to the locked side, not applied")
    axes.plot([], [], "-", color=BLUE, marker=">", markersize=4.0, label="adjusted displacement")
    axes.legend(loc="upper left", frameon=False)
    axes.plot([points[0, 0]], [points[LEFT_TURN, 1] - 10.0], alpha=0.0)
    to_scale(axes, 20.0)
    save(figure, path, dpi)
    return {
        "one step: points held for the side": float(held.sum()),
        "one step: held displacements plus adjusted ones, mm": float(
            np.abs(raw[held].sum(axis=0) + adjusted.sum(axis=0)).max()
        ),
        "one step: against equation (1), mm": float(
            np.abs(moved - adjusted - np.where(held[:, None], 0.0, strengths[1] * raw)).max()
        ),
    }


def label_step(axes: Any, points: Array, raw: Array) -> None:
    """Name the points and the arrows."""
    i, j = LEFT_TURN, RIGHT_TURN
    for at, text, offset, colour in (
        (points[i], "$P_i$", (-8.0, -1.0), INK),
        (points[i - 1], "$P_{i-1}$", (-2.0, 6.5), INK),
        (points[i + 1], "$P_{i+1}$", (2.0, 6.5), INK),
        (points[i] + raw[i], "$f_i$", (0.0, 4.0), RED),
        (points[i] - [0.0, 9.0], "$n_i$", (6.0, 0.0), INK),
        (points[i - 1] - 0.5 * raw[i], "$\\hat{f}_{i-1}$", (-5.0, -5.5), BLUE),
        (points[i + 1] - 0.5 * raw[i], "$\\hat{f}_{i+1}$", (9.0, -7.5), BLUE),
        (points[j], "$P_j$", (0.0, 5.0), INK),
        (points[j - 1] + raw[j - 1], "$f_{j-1}$", (0.0, 4.0), RED),
        (points[j + 1] + raw[j + 1], "$f_{j+1}$", (0.0, 4.0), RED),
        (points[j], "$\\hat{f}_j + s_1 f_j$", (-17.0, -3.5), BLUE),
    ):
        axes.text(*(at + np.array(offset)), text, color=colour, ha="center", va="center", fontsize=11)


def arrow(axes: Any, start: Array, along: Array, colour: str, line: str = "-") -> None:
    """A displacement as an arrow, to scale."""
    shape = {"arrowstyle": "-|>", "linewidth": 1.3, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 11}
    axes.annotate(
        "", start + along, start, arrowprops={**shape, "color": colour, "linestyle": line}, zorder=4
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/examples/fig09_smoothing"))
    parser.add_argument("--quick", action="store_true", help="coarser pictures")
    arguments = parser.parse_args()
    main(arguments.out, arguments.quick)
