"""The report of a job: `summary.json` and pictures."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import trimesh
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from planning import Cell, Finding, Program, SegmentKind
from twins import Toolpath, signed_volume

Array = npt.NDArray[np.float64]

_LINE = {"linewidth": 0.8}


def write_summary(folder: Path, values: dict[str, Any], *, anew: bool = False) -> None:
    """Merge values into `summary.json`, or write it anew; keys carry their units."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "summary.json"
    known: dict[str, Any] = {}
    if path.is_file() and not anew:
        with contextlib.suppress(ValueError):
            read = json.loads(path.read_text(encoding="utf-8"))
            known = read if isinstance(read, dict) else {}
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps({**known, **values}, indent=2) + "\n", encoding="utf-8")
    partial.replace(path)


def summarise(
    program: Program, toolpath: Toolpath, volume: trimesh.Trimesh, findings: list[Finding]
) -> dict[str, Any]:
    """What is known of a job before it is printed."""
    printing = program.of_kind(SegmentKind.PRINT)
    travel = sum(
        float(np.linalg.norm(np.diff(program.positions[s.start : s.stop], axis=0), axis=1).sum())
        for s in program.segments
        if s.kind is not SegmentKind.PRINT
    )
    return {
        "layers": len(toolpath.layers),
        "path_length_m": round(toolpath.length / 1000.0, 4),
        "bead_volume_l": round(program.bead_volume * 1e-6, 6),
        "volume_of_m_prime_l": round(signed_volume(volume) * 1e-6, 6),
        "print_time_s": round(program.duration, 2),
        "starts": sum(s.kind is SegmentKind.PRINT for s in program.segments),
        "travel_length_m": round(travel / 1000.0, 4),
        "local_height_min_mm": round(float(program.height[printing].min()), 4),
        "local_height_max_mm": round(float(program.height[printing].max()), 4),
        "waypoints": len(program),
        "findings": [finding.as_dict() for finding in findings],
        "inputs": program.inputs,
    }


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
    figure = Figure(figsize=(7.5, 7.0), layout="constrained")
    axes: Any = figure.add_subplot(projection="3d")
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
    figure.colorbar(beads, ax=axes, shrink=0.6, label="local layer height [mm]")
    return figure


def _span(height: Array) -> tuple[float, float]:
    """Limits for a scale of heights: where they hardly differ, wide enough to say so."""
    low, high = float(height.min()), float(height.max())
    margin = max(0.03 * (high - low), 0.02 * high - 0.5 * (high - low), 0.0)
    return low - margin, high + margin


def _height_and_flow(program: Program) -> Figure:
    figure = Figure(figsize=(10.0, 5.5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
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
    figure = Figure(figsize=(10.0, 8.0), layout="constrained")
    rows = figure.subplots(6, 1, sharex=True)
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
