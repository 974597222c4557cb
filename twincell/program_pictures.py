"""The pictures of a program in a job's report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from planning import Cell, Program, SegmentKind

Array = npt.NDArray[np.float64]

_LINE = {"linewidth": 0.8}
_MARGINS = {"left": 0.08, "right": 0.93, "hspace": 0.12}


def draw(folder: Path, program: Program, cell: Cell) -> list[Path]:
    """The three pictures of a program: layers, local height and flow along the path, joint angles."""
    folder.mkdir(parents=True, exist_ok=True)
    mpl.rcParams["font.size"] = 9
    pictures = {
        "layers.png": _layers(program, cell),
        "height_and_flow.png": _height_and_flow(program),
        "joints.png": _joints(program, cell),
    }
    for name, figure in pictures.items():
        figure.savefig(folder / name, dpi=120)
    return [folder / name for name in pictures]


def _layers(program: Program, cell: Cell) -> Figure:
    """Beads in space, coloured by the local layer height, and the travels between them."""
    figure = Figure(figsize=(7.5, 7.0))
    # Margins are given throughout: to have them found draws everything twice.
    axes: Any = figure.add_axes((0.02, 0.03, 0.78, 0.91), projection="3d")
    points = cell.bed.plane.to_frame(np.asarray(program.positions))
    moves = np.flatnonzero(program.moves())
    beads = Line3DCollection(
        np.stack([points[moves - 1], points[moves]], axis=1), cmap="viridis", linewidth=1.6
    )
    beads.set_array(program.height[moves])
    beads.set_clim(*_span(program.height[moves]))
    axes.add_collection3d(beads)
    for segment in program.segments:
        if segment.kind is SegmentKind.TRAVEL:
            axes.plot(*points[segment.start : segment.stop].T, color="0.75", linewidth=0.6)
    low, high = points.min(axis=0), points.max(axis=0)
    for name, a, b in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{name}lim")(a, b)
        getattr(axes, f"set_{name}label")(f"{name} [mm]")
    axes.set_box_aspect(np.maximum(high - low, 1.0))
    axes.view_init(elev=18, azim=-62)
    layers = len(np.unique(program.layer[program.layer >= 0]))
    starts = sum(s.kind is SegmentKind.PRINT for s in program.segments)
    axes.set_title(f"{layers} layers, {starts} beads; travels in grey")
    figure.colorbar(beads, cax=figure.add_axes((0.875, 0.2, 0.026, 0.58)), label="local layer height [mm]")
    return figure


def _span(height: Array) -> tuple[float, float]:
    """Limits for a scale of heights: where they hardly differ, wide enough to say so."""
    low, high = float(height.min()), float(height.max())
    margin = max(0.03 * (high - low), 0.02 * high - 0.5 * (high - low), 0.0)
    return low - margin, high + margin


def _height_and_flow(program: Program) -> Figure:
    figure = Figure(figsize=(10.0, 5.5))
    above, below = figure.subplots(
        2, 1, sharex=True, gridspec_kw=_MARGINS | {"right": 0.98, "bottom": 0.09, "top": 0.94}
    )
    printing = program.of_kind(SegmentKind.PRINT)
    height = np.where(printing, program.height, np.nan)
    above.plot(program.time, height, color="tab:blue", **_LINE)
    above.set_ylabel("local layer height [mm]")
    above.set_ylim(*_span(program.height[printing]))
    above.ticklabel_format(useOffset=False)
    above.set_title("Local layer height and planned flow along the path")
    below.plot(program.time, np.where(printing, program.flow, 0.0), color="tab:red", **_LINE)
    below.set_ylabel("flow [mm³/s]")
    below.set_xlabel("process time [s]")
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.set_xlim(0.0, program.duration)
    return figure


def _joints(program: Program, cell: Cell) -> Figure:
    figure = Figure(figsize=(10.0, 8.0))
    rows = figure.subplots(6, 1, sharex=True, gridspec_kw=_MARGINS | {"bottom": 0.06, "top": 0.96})
    degrees = np.degrees(program.joints)
    for joint, axes in enumerate(rows):
        axes.plot(program.time, degrees[:, joint], **_LINE)
        limit = cell.robot.joint_limit_deg[joint]
        axes.set_ylabel(f"joint {joint + 1} [°]")
        axes.grid(alpha=0.3)
        if np.isfinite(degrees[:, joint]).any():
            low, high = np.nanmin(degrees[:, joint]), np.nanmax(degrees[:, joint])
            axes.set_ylim(low - 5.0, high + 5.0)
        axes.text(
            1.005, 0.5, f"limit ±{limit:.0f}°", transform=axes.transAxes, va="center", fontsize=7, color="0.4"
        )
    rows[0].set_title("Joint angles: one branch over the whole job")
    rows[-1].set_xlabel("process time [s]")
    rows[-1].set_xlim(0.0, program.duration)
    return figure
