"""The slab between two layers: its slice of the toolpath mesh and the tetrahedra that fill it (seed paper, Figure 2).

    python examples/fig02_slab.py [--out FOLDER] [--quick]

One curve below, two above, turned. Between them lie the Delaunay tetrahedra that touch either region: with three
points below and one above (T31), two and two (T22), one and three (T13). Those with a merge threshold f(T) of 0 are
interior, and so is each that has f(T) interior neighbours; the sides of all these are the slice of M.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch
from pictures import INK, Drawn, View, draw_edges, draw_surface, panels, save, to_scale
from sampled_fields import field_in_box

from twins import Plane, layer_planes, make_surface, slice_surface, toolpath_mesh
from twins.overlay import Slab, merge, neighbours, overlay_tetrahedra

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

THICKNESS = 10.0
FOCUS, TURN = 45.0, 0.4
"""Half the distance between the foci of both layers' ovals, mm; how far those above are turned, rad."""

TYPES = {3: ("T31", "#3b6fb6"), 2: ("T22", "#e3a72f"), 1: ("T13", "#3d9970")}
"""Names and colours of types of tetrahedra, by how many points they have in the lower layer."""

THRESHOLDS = ("#d9d5cc", "#7fb7be", "#b8508c")
LOWER, UPPER = "#3b3a8f", "#c4572e"
PALE = "#e9e6df"
SHRUNK = 0.8
VIEW = View(-62.0, 38.0)


@dataclass(frozen=True, eq=False)
class Tetrahedra:
    """The tetrahedra of a slab.

    Attributes:
        points: of the lower layer, then of the upper one, shape (n, 3), mm.
        tets: positively oriented, shape (m, 4).
        below: how many points of each are in the lower layer, shape (m,).
        threshold: f(T), shape (m,).
        interior: shape (m,).
        following: of each point the next one along its curve, shape (n,).
    """

    points: Array
    tets: Indices
    below: Indices
    threshold: npt.NDArray[np.int8]
    interior: Flags
    following: Indices

    @property
    def volume(self) -> float:
        """Of those that are interior, mm³."""
        a, b, c, d = self.points[self.tets[self.interior]].transpose(1, 0, 2)
        return float(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a).sum() / 6.0)

    def surface(self, which: Indices, size: float = 1.0) -> trimesh.Trimesh:
        """The faces of some, four to each in their order, drawn towards their middles."""
        corners = self.points[self.tets[which]]
        middle = corners.mean(axis=1, keepdims=True)
        corners = middle + size * (corners - middle)
        faces = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
        return make_surface(
            corners.reshape(-1, 3), (4 * np.arange(len(which))[:, None, None] + faces).reshape(-1, 3)
        )


def two_layers(cell: float) -> trimesh.Trimesh:
    """A part of two layers whose sections are Cassini's ovals, r1 r2 = b²: one curve below, two turned ones above."""

    def field(x: Array, y: Array, z: Array) -> Array:
        up = (z - 0.5 * THICKNESS) / THICKNESS
        c, s = np.cos(TURN * up), np.sin(TURN * up)
        u, v = c * x + s * y, 1.15 * (c * y - s * x)
        product = np.hypot(u - FOCUS, v) * np.hypot(u + FOCUS, v)
        return np.asarray(FOCUS * (1.1 - 0.15 * up) - np.sqrt(product), dtype=np.float64)

    return field_in_box(field, [-95.0, -75.0, 0.0], [95.0, 75.0, 2.0 * THICKNESS], cell)


def main(out: Path, quick: bool = False) -> dict[str, float]:
    """The slab of two layers; a picture lands in `out`. Returns the figures of the table."""
    cell, pixels = (3.0, 260) if quick else (1.5, 800)
    toolpath = slice_surface(two_layers(cell), layer_planes(Plane.horizontal(), 2.0 * THICKNESS, THICKNESS))
    solid = toolpath_mesh(toolpath).solid
    (slab,), (low, high) = solid.slabs, (section.region for section in solid.sections)
    assert slab is not None
    points = np.vstack(
        [
            np.column_stack([section.region.points, np.full(len(section.region), section.w)])
            for section in solid.sections
        ]
    )
    found, threshold = overlay_tetrahedra(low, high)
    across = neighbours(found, len(points))
    following = np.concatenate([low.diagram.following, high.diagram.following + slab.lower])
    tets = Tetrahedra(
        points, found, (found < slab.lower).sum(axis=1), threshold, merge(threshold, across), following
    )
    figures = {
        "curves below": float(len(toolpath.layers[0].curves)),
        "curves above": float(len(toolpath.layers[1].curves)),
        "points below": float(slab.lower),
        "points above": float(len(points) - slab.lower),
        "tetrahedra": float(len(tets.tets)),
        "interior": float(tets.interior.sum()),
        "tetrahedra of the engine's slab": float(len(slab.tets)),
        **{
            f"interior {name}": float((tets.interior & (tets.below == k)).sum())
            for k, (name, _) in TYPES.items()
        },
        **{f"f(T) = {f}": float((threshold == f).sum()) for f in range(3)},
        **{f"interior with f(T) = {f}": float((tets.interior & (threshold == f)).sum()) for f in range(3)},
        "faces of the slice": float(len(slab.sides)),
        "volume of the interior, cm³": 1e-3 * tets.volume,
        "volume within the slice, cm³": 1e-3 * enclosed(points, slab, low.triangles, high.triangles),
    }
    figure, axes = panels(2, (11.5, 7.6), rows=2)
    draw_slice(axes[0, 0], tets, slab, pixels)
    draw_three(axes[0, 1], tets, slab, pixels)
    interior = np.flatnonzero(tets.interior)
    kinds = np.array([list(TYPES).index(k) for k in tets.below[interior].tolist()])
    draw_many(axes[1, 0], tets, interior, kinds, [colour for _, colour in TYPES.values()], pixels)
    legend(
        axes[1, 0],
        [(f"{name}: {figures[f'interior {name}']:.0f}", colour) for name, colour in TYPES.values()],
    )
    draw_many(axes[1, 1], tets, interior, threshold[interior].astype(np.int64), list(THRESHOLDS), pixels)
    outside = np.flatnonzero(~tets.interior)
    draw_outlines(axes[1, 1], tets, outside)
    named = [
        (f"f(T) = {f}: {figures[f'interior with f(T) = {f}']:.0f}", colour)
        for f, colour in enumerate(THRESHOLDS)
    ]
    legend(axes[1, 1], named, f"not interior: {len(outside)}")
    titles = ("a   slice of the toolpath mesh", "b   types of tetrahedra", "c   interior, by type")
    for axis, title in zip(axes.ravel(), (*titles, "d   interior, by merge threshold"), strict=True):
        axis.set_title(title, loc="left")
        to_scale(axis)
        axis.set_xlim(-64.0, 74.0)
        axis.set_ylim(-40.0, 48.0)
    axes[0, 0].plot([50.0, 70.0], [-33.0, -33.0], color=INK, linewidth=2.0, solid_capstyle="butt")
    axes[0, 0].text(60.0, -34.5, "20 mm", ha="center", va="top", fontsize=8)
    save(figure, out / "slab.png", 60 if quick else 130)
    for name, value in figures.items():
        print(f"{name:34} {value:.6g}")
    return figures


def enclosed(points: Array, slab: Slab, lower: Indices, upper: Indices) -> float:
    """Volume within a slab's sides and the triangles that it rests against, by the divergence theorem, mm³."""
    faces = np.concatenate([lower[slab.under][:, ::-1], upper[slab.over] + slab.lower, slab.sides])
    a, b, c = points[faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def side_edges(slab: Slab) -> Indices:
    """The edges of a slab's sides that lead from layer to layer, shape (k, 2)."""
    edges = np.unique(np.sort(slab.sides[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    return edges[(edges[:, 0] < slab.lower) & (edges[:, 1] >= slab.lower)]


def curve_edges(tets: Tetrahedra, lower: int) -> tuple[tuple[Indices, str], tuple[Indices, str]]:
    """The segments of both layers' curves, shape (k, 2), and their colours."""
    edges = np.column_stack([np.arange(len(tets.points)), tets.following])
    return (edges[:lower], LOWER), (edges[lower:], UPPER)


def draw_slice(axes: Any, tets: Tetrahedra, slab: Slab, pixels: int) -> None:
    """The sides of a slab from both sides, with their edges and the sample points."""
    both = np.concatenate([slab.sides, slab.sides[:, ::-1]])
    drawn = draw_surface(axes, make_surface(tets.points, both), VIEW, pixels=pixels, colour=PALE)
    draw_edges(axes, drawn, tets.points, side_edges(slab), linewidths=0.6)
    for edges, colour in curve_edges(tets, slab.lower):
        draw_edges(axes, drawn, tets.points, edges, colors=colour, linewidths=2.2, zorder=3)
    draw_points(axes, tets.points, slab.lower, drawn)
    axes.plot([], [], "o-", color=UPPER, markersize=4, label="layer above: two curves")
    axes.plot([], [], "o-", color=LOWER, markersize=4, label="layer below: one curve")
    axes.legend(loc="lower left", frameon=False)


def draw_points(axes: Any, points: Array, lower: int, drawn: Drawn | None = None) -> None:
    seen = VIEW.project(points)[:, :2]
    shown = np.ones(len(points), dtype=bool) if drawn is None else drawn.shows(points, 1.0)
    below = np.arange(len(points)) < lower
    for flags, colour in ((below, LOWER), (~below, UPPER)):
        axes.plot(*seen[flags & shown].T, "o", color=colour, markersize=4.0, zorder=4)


def draw_three(axes: Any, tets: Tetrahedra, slab: Slab, pixels: int) -> None:
    """One interior tetrahedron of each type, between the curves."""
    seen = VIEW.project(tets.points)[:, :2]
    axes.add_collection(
        LineCollection(list(seen[side_edges(slab)]), colors="#c5c0b6", linewidths=0.6, zorder=0.5)
    )
    for edges, colour in curve_edges(tets, slab.lower):
        axes.add_collection(LineCollection(list(seen[edges]), colors=colour, linewidths=1.6, zorder=0.6))
    draw_points(axes, tets.points, slab.lower)
    for (below, (name, colour)), near in zip(TYPES.items(), (-12.0, 28.0, -48.0), strict=True):
        chosen = clearest(tets, below, near)
        body = tets.surface(np.array([chosen]))
        draw_surface(
            axes,
            body,
            VIEW,
            pixels=pixels // 4,
            values=np.zeros(4),
            limits=(0, 1),
            cmap=ListedColormap([colour]),
        )
        corners = VIEW.project(np.asarray(body.vertices))[:, :2]
        pairs = np.array([[i, j] for i in range(4) for j in range(i + 1, 4)])
        axes.add_collection(LineCollection(list(corners[pairs]), colors=INK, linewidths=0.9, zorder=3))
        text = f"{name}, f(T) = {tets.threshold[chosen]}"
        at, lift = corners.mean(axis=0), -29.0 if below == 2 else 29.0
        axes.annotate(
            text,
            at,
            (at[0], at[1] + lift),
            ha="center",
            va="center",
            color=colour,
            fontweight="bold",
            arrowprops={"arrowstyle": "-", "color": colour, "shrinkB": 4.0},
            zorder=5,
        )


def clearest(tets: Tetrahedra, below: int, near: float) -> int:
    """The interior tetrahedron of a type that shows largest around a place to the right of the middle, mm."""
    seen = VIEW.project(tets.points)[:, :2][tets.tets]
    low, high = seen.min(axis=1), seen.max(axis=1)
    size = (high - low).min(axis=1) - 0.6 * np.abs(seen[:, :, 0].mean(axis=1) - near)
    return int(np.argmax(np.where(tets.interior & (tets.below == below), size, -np.inf)))


def draw_many(
    axes: Any, tets: Tetrahedra, which: Indices, kind: Indices, colours: list[str], pixels: int
) -> None:
    """Tetrahedra drawn a little smaller than they are, coloured by kind."""
    body = tets.surface(which, SHRUNK)
    values = np.repeat(np.asarray(kind, dtype=np.float64), 4)
    limits = (-0.5, len(colours) - 0.5)
    drawn = draw_surface(
        axes, body, VIEW, values=values, limits=limits, cmap=ListedColormap(colours), pixels=pixels
    )
    draw_edges(axes, drawn, np.asarray(body.vertices), body.edges_unique, linewidths=0.35)


def draw_outlines(axes: Any, tets: Tetrahedra, which: Indices) -> None:
    """The edges of some tetrahedra, in front of all."""
    pairs = np.array([[i, j] for i in range(4) for j in range(i + 1, 4)])
    lines = VIEW.project(tets.points)[:, :2][tets.tets[which][:, pairs].reshape(-1, 2)]
    axes.add_collection(LineCollection(list(lines), colors="#d1203a", linewidths=1.3, zorder=4))


def legend(axes: Any, named: list[tuple[str, str]], outlined: str | None = None) -> None:
    handles: list[Any] = [
        Patch(facecolor=colour, edgecolor=INK, linewidth=0.5, label=text) for text, colour in named
    ]
    if outlined is not None:
        handles.append(Patch(facecolor="none", edgecolor="#d1203a", linewidth=1.3, label=outlined))
    axes.legend(handles=handles, loc="lower left", frameon=False)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/examples/fig02_slab"))
    parser.add_argument("--quick", action="store_true", help="a smaller version")
    arguments = parser.parse_args()
    main(arguments.out, arguments.quick)
