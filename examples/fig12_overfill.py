"""Overfill at a point: what pushes it, and where its curve ends, in one step or in many (seed paper, Figure 12).

    python examples/fig12_overfill.py [--out FOLDER] [--quick]

Two curves come nearer to each other than the bead is wide. Each point P_j within d_min of P_i gives a vector g_ji of
equation 4 that leads straight away from it by what is missing; s_2 times their mean is the step of P_i. One long step
bends the curves more than many short ones do, and one of half the length leaves them too close.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from matplotlib.patches import Circle
from pictures import draw_beads, draw_curves, panels, save, to_scale

from twins import Curve, Layer, Plane, Toolpath, largest_turning, relieve_overfill, resample, spacing
from twins.curves.overfill import equation_4

Array = npt.NDArray[np.float64]

DISTANCE = 20.0
"""d_min, the width of the bead, mm."""

STEP = DISTANCE / 4.0
SINGLE = ((1.0, "#8c8c8c"), (0.5, "#d1203a"))
"""Strengths s_2 of single steps of equation 4, and their colours."""

STRENGTH, STEPS, MANY = 0.1, 100, "#1a6fd6"
NEAR, PUSH = "#d1203a", "#1a6fd6"


def toolpath_of(curves: Sequence[Curve]) -> Toolpath:
    """One horizontal layer of curves."""
    return Toolpath(
        Plane.horizontal(), (Layer(Plane.horizontal(5.0), Plane.horizontal(10.0), tuple(curves)),), 10.0
    )


def two_bends() -> tuple[Curve, ...]:
    """A wide bend above a tighter one, 5 mm apart where they are nearest, sampled at d_min / 4."""
    x = np.linspace(-60.0, 60.0, 601)
    above = np.column_stack([x[::-1], 5.0 + 40.0 * (1.0 - np.exp(-((x[::-1] / 46.0) ** 2)))])
    below = np.column_stack([x, -45.0 * (1.0 - np.exp(-(((x - 5.0) / 24.0) ** 2)))])
    return (
        resample(toolpath_of([Curve(above, closed=False), Curve(below, closed=False)]), STEP).layers[0].curves
    )


def vectors(curves: Sequence[Curve], at: Array) -> tuple[Array, Array]:
    """The points P_j within d_min of a point of another curve, shape (k, 2), and the g_ji there, shape (k, 2)."""
    points = np.vstack([curve.points for curve in curves])
    away = at - points
    distance = np.linalg.norm(away, axis=1)
    found = distance < DISTANCE
    return points[found], away[found] * ((DISTANCE - distance) / distance)[found][:, None]


def figures_of(name: str, curves: Sequence[Curve]) -> dict[str, float]:
    """How close and how bent the curves of a layer are."""
    found = spacing(toolpath_of(curves), DISTANCE)[0]
    turning = max(largest_turning(curve, DISTANCE) for curve in curves)
    return {
        f"overfilled length, {name}, mm": found.close,
        f"least spacing, {name}, mm": min(found.least, DISTANCE),
        f"largest turning in {DISTANCE:g} mm, {name}, °": float(np.degrees(turning)),
    }


def main(out: Path, quick: bool = False) -> dict[str, float]:
    """Equation 4 at a point, and curves after single steps and after many; a picture lands in `out`."""
    curves = two_bends()
    one, other = curves
    # A little beside the narrowest place, so that what pushes does not balance.
    at = int(np.argmin(np.linalg.norm(one.points - np.array([-2.0, 5.0]), axis=1)))
    place = one.points[at]
    near, single = vectors([other], place)
    mean = single.mean(axis=0)
    theirs = equation_4(curves, DISTANCE, 1.0)[0][at]
    stepped = [
        [
            Curve(curve.points + step, closed=False)
            for curve, step in zip(curves, equation_4(curves, DISTANCE, s), strict=True)
        ]
        for s, _ in SINGLE
    ]
    relief = relieve_overfill(toolpath_of(curves), DISTANCE, strength=STRENGTH, steps=STEPS)
    many = relief.toolpath.layers[0].curves
    figures = {
        "points within d_min of P_i": float(len(near)),
        "length of the mean of g_ji, mm": float(np.linalg.norm(mean)),
        "difference to the engine's g_i / s_2, mm": float(np.abs(mean - theirs).max()),
        **figures_of("before", curves),
        **figures_of("one step, s_2 = 1", stepped[0]),
        **figures_of("one step, s_2 = 0.5", stepped[1]),
        **figures_of("after", many),
        "steps taken": float(relief.layers[0].steps),
        "largest displacement, mm": relief.displacement,
    }
    figure, axes = panels(3, (15.0, 4.4), width_ratios=(1.0, 1.0, 1.5))
    draw_point(axes[0], curves, place, near, single, mean)
    draw_steps(axes[1], curves, stepped, many)
    draw_after(axes[2], curves, many)
    titles = ("a   equation 4 at P$_i$", "b   one step, and many", "c   beads of 20 mm")
    for panel, title in zip(axes, titles, strict=True):
        panel.set_title(title, loc="left")
    save(figure, out / "overfill.png", 60 if quick else 130)
    for name, value in figures.items():
        print(f"{name:52} {value:.6g}")
    return figures


def draw_point(
    axes: Any, curves: Sequence[Curve], place: Array, near: Array, single: Array, mean: Array
) -> None:
    """The circle of radius d_min around P_i, who is in it, and where each of them pushes P_i."""
    axes.add_patch(
        Circle(
            (place[0], place[1]),
            DISTANCE,
            facecolor="#f6f4ef",
            edgecolor="#9a958a",
            linestyle="--",
            linewidth=1.0,
        )
    )
    turn = np.radians(205.0)
    rim = place + DISTANCE * np.array([np.cos(turn), np.sin(turn)])
    axes.plot(*np.stack([place, rim]).T, color="#9a958a", linewidth=0.9, linestyle="--", zorder=1)
    draw_curves(axes, curves, marker="o", markersize=4.0, linewidth=1.3, zorder=2)
    axes.plot(*near.T, "o", color=NEAR, markersize=6.0, zorder=4)
    for point, vector in zip(near, single, strict=True):
        axes.plot(*np.stack([point, place]).T, color=NEAR, linewidth=0.8, linestyle=":", zorder=2)
        arrow(axes, place, vector, NEAR, 1.1)
    arrow(axes, place, mean, PUSH, 3.0)
    axes.plot(*place, "o", color=PUSH, markersize=7.5, zorder=6)
    longest = int(np.argmax(np.linalg.norm(single, axis=1)))
    note(axes, "d$_{min}$", 0.6 * rim + 0.4 * place, (2, -13), "#6b665c")
    note(axes, "P$_i$", place, (-20, -13), PUSH)
    note(axes, "P$_j$", near[longest], (9, -3), NEAR)
    note(axes, "g$_{j,i}$", place + single[longest], (-4, 6), NEAR)
    note(axes, "their mean", place + mean, (-31, 28), PUSH, ha="right")
    to_scale(axes)
    window(axes, place[0], place[1], 23.0, 21.0)


def draw_steps(
    axes: Any, curves: Sequence[Curve], stepped: Sequence[Sequence[Curve]], many: Sequence[Curve]
) -> None:
    """Where one step of each strength leads, and many short ones."""
    draw_curves(axes, curves, color="#b9b4a9", linewidth=1.2, linestyle="--", label="before")
    many_style = {"color": MANY, "linewidth": 2.4, "marker": "o", "markersize": 4.5}
    draw_curves(axes, many, label=f"{STEPS} steps, $s_2$ = {STRENGTH:g}", zorder=2.5, **many_style)
    for (s, colour), moved in zip(SINGLE, stepped, strict=True):
        style = {"color": colour, "linewidth": 1.2, "marker": "o", "markersize": 3.0}
        draw_curves(axes, moved, label=f"one step, $s_2$ = {s:g}", zorder=3.0, **style)
    lines = [shapely.LineString(curve.points) for curve in many]
    apart = np.asarray(shapely.shortest_line(*lines).coords)
    ends = {"arrowstyle": "<|-|>", "color": MANY, "linewidth": 0.9, "shrinkA": 1.0, "shrinkB": 1.0}
    axes.annotate("", apart[0], apart[1], arrowprops=ends, zorder=6)
    note(axes, "d$_{min}$", apart.mean(axis=0), (3, 4), MANY)
    to_scale(axes)
    window(axes, 0.0, 3.0, 46.0, 42.0)
    axes.legend(loc="upper center", frameon=False, fontsize=8.5, ncols=2, bbox_to_anchor=(0.5, 1.02))


def draw_after(axes: Any, curves: Sequence[Curve], many: Sequence[Curve]) -> None:
    """Beads before, on the left, and after."""
    for moved, aside, name in ((curves, -72.0, "before"), (many, 72.0, "after")):
        lifted = [Curve(curve.points + [aside, 0.0], closed=False) for curve in moved]
        draw_beads(axes, lifted, DISTANCE)
        draw_curves(axes, lifted, linewidth=1.0)
        axes.annotate(name, (aside, -68.0), ha="center")
    to_scale(axes, DISTANCE)


def note(axes: Any, text: str, at: Array, aside: tuple[float, float], colour: str, **style: Any) -> None:
    axes.annotate(text, at, aside, textcoords="offset points", color=colour, fontsize=11, zorder=7, **style)


def arrow(axes: Any, start: Array, way: Array, colour: str, linewidth: float) -> None:
    axes.annotate(
        "",
        start + way,
        start,
        arrowprops={
            "arrowstyle": "-|>",
            "color": colour,
            "linewidth": linewidth,
            "shrinkA": 0.0,
            "shrinkB": 0.0,
            "mutation_scale": 8.0 + 2.0 * linewidth,
        },
        zorder=5,
    )


def window(axes: Any, x: float, y: float, width: float, height: float) -> None:
    """Show only so much around a place."""
    axes.set_xlim(x - width, x + width)
    axes.set_ylim(y - height, y + height)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/examples/fig12_overfill"))
    parser.add_argument("--quick", action="store_true", help="a smaller version")
    arguments = parser.parse_args()
    main(arguments.out, arguments.quick)
