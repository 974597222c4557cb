"""Overhang drawn: each part with its beads or faces coloured by local overhang, and all distributions in one plot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import trimesh
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from twins import LocalOverhang, SurfaceOverhang, overhang_distribution

from .overhangs import Scheme

Array = npt.NDArray[np.float64]

AZIMUTH, ELEVATION = np.radians(-60.0), np.radians(12.0)
"""Where the eye is."""

DRAWN = 4
"""Parts that are drawn; the distributions of all are."""

SHARE = 0.99
"""Share of the length or area whose overhang the plot shows; the little that hangs over more is named, not drawn."""


def draw_overhangs(schemes: Sequence[Scheme], path: Path) -> None:
    """Draw sources coloured by local overhang, and the cumulative distribution of each."""
    mpl.rcParams["font.size"] = 9
    drawn = schemes[:DRAWN]
    figure = Figure(figsize=(7.5, 8.0), layout="constrained")
    halves: Any = figure.subfigures(2, 1, height_ratios=[1.15, 1.0])
    parts, plot = halves
    limits = [scheme.limit for scheme in schemes if scheme.limit is not None]
    most = 2.0 * min(limits) if limits else max(scheme.overhang.quantile(0.95) for scheme in drawn) or 1.0
    norm = Normalize(0.0, most)
    for axes, scheme in zip(np.ravel(parts.subplots(1, len(drawn), squeeze=False)), drawn, strict=True):
        picture = _part(axes, scheme, norm)
    bar = parts.colorbar(
        picture, ax=parts.axes, orientation="horizontal", shrink=0.6, aspect=40, extend="max"
    )
    bar.set_label("local overhang d / t" + (f"; limit {min(limits):g}" if limits else ""))
    for limit in sorted(set(limits)):
        bar.ax.axvline(limit, color="black", linewidth=1.2)
    _distributions(plot.subplots(), schemes, limits)
    figure.savefig(path, dpi=120)


def _part(axes: Any, scheme: Scheme, norm: Normalize) -> Any:
    over = scheme.overhang
    picture = _faces(over, scheme.surface, norm) if isinstance(over, SurfaceOverhang) else _beads(over, norm)
    axes.add_collection(picture)
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(scheme.name if len(scheme.name) <= 40 else f"…{scheme.name[-39:]}", fontsize=8)
    return picture


def _beads(overhang: LocalOverhang, norm: Normalize) -> LineCollection:
    ends, values = [], []
    first = 0
    for *_, curve in overhang.toolpath.curves():
        here = np.arange(first, first + len(curve.points))
        first += len(here)
        last = here if curve.closed else here[:-1]
        following = np.roll(here, -1) if curve.closed else here[1:]
        ends.append(np.stack([overhang.places[last], overhang.places[following]], axis=1))
        values.append(0.5 * (overhang.values[last] + overhang.values[following]))
    segments = np.concatenate([np.empty((0, 2, 3)), *ends])
    flat, depth = _seen(segments)
    order = np.argsort(depth.mean(axis=1))
    lines = LineCollection(list(flat[order]), cmap="turbo", norm=norm, linewidths=1.3)
    lines.set_array(np.concatenate([np.empty(0), *values])[order])
    return lines


def _faces(overhang: SurfaceOverhang, surface: trimesh.Trimesh | None, norm: Normalize) -> PolyCollection:
    corners = np.empty((0, 3, 3)) if surface is None else np.asarray(surface.triangles, dtype=np.float64)
    flat, depth = _seen(corners)
    a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    front = np.flatnonzero(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0.0)
    order = front[np.argsort(depth[front].mean(axis=1))]
    faces = PolyCollection(list(flat[order]), cmap="turbo", norm=norm, edgecolors="face", linewidths=0.2)
    faces.set_array(overhang.values[order])
    return faces


def _seen(points: Array) -> tuple[Array, Array]:
    """Places in the picture, shape (…, 2), and nearness to the eye, shape (…,)."""
    towards = np.array(
        [np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)]
    )
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    return points @ np.column_stack([right, np.cross(towards, right)]), points @ towards


def _distributions(axes: Any, schemes: Sequence[Scheme], limits: Sequence[float]) -> None:
    shown = max([*(s.overhang.quantile(SHARE) for s in schemes), *(1.5 * limit for limit in limits), 0.1])
    shown = min(shown, max([4.0, *(2.0 * limit for limit in limits)]))
    table = overhang_distribution(
        {f"{i}": scheme.overhang for i, scheme in enumerate(schemes)}, np.linspace(0.0, shown, 401)
    )
    styles = ("-", "--", "-.", ":")
    for i, (scheme, shares) in enumerate(zip(schemes, table.shares, strict=True)):
        what = "length" if isinstance(scheme.overhang, LocalOverhang) else "area"
        beyond = 100.0 * scheme.overhang.share_above(shown)
        more = f"; {beyond:.1f} % hangs over more" if beyond >= 0.05 else ""
        label = f"{scheme.name} ({what}{more})"
        # Lines that run on top of one another are told apart by their dashes.
        axes.plot(
            table.overhang,
            100.0 * shares,
            styles[i % len(styles)],
            linewidth=2.2 - 0.4 * (i % 4),
            label=label,
        )
    for limit in sorted(set(limits)):
        axes.axvline(limit, color="0.4", linestyle=":", linewidth=1.2)
        axes.text(limit, 2.0, f" limit {limit:g}", color="0.3")
    axes.set_xlim(0.0, shown)
    axes.set_ylim(0.0, 101.0)
    axes.set_xlabel("local overhang d / t")
    axes.set_ylabel("hangs over no more than that [%]")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right", fontsize=8)
