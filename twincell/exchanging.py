"""The doorway for designers: curves in, as a toolpath; a job's curves and surfaces out, in their formats."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from twins import (
    TwinsError,
    move,
    read_curves,
    read_surface,
    save_toolpath,
    save_unwrapped,
    unwrap,
    visual_mesh,
    wrap,
    write_surface,
)

from .errors import JobError
from .job import Job
from .stages import sliced

At = Literal["nozzle", "slicing"]
What = Literal["curves", "surface", "volume", "beads"]

CURVES = (".dxf", ".csv", ".json")
"""Endings that only curves are written to."""

UP = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def wrap_curves(
    files: Sequence[Path],
    out: Path,
    *,
    at: At,
    units: str | None = None,
    thickness: float | None = None,
    close_within: float | None = None,
    tolerance: float | None = None,
    chord: float = 0.05,
    up: str = "z",
) -> dict[str, Any]:
    """Put curves from files in layers, and write them as a toolpath whose bed, if it is level, is z = 0.

    Args:
        files: DXF, SVG, 3DM, JSON or CSV.
        out: the toolpath file to write.
        at: whether the curves are where the nozzle runs, or sections through the middle of layers.
        units: of files that do not say theirs.
        thickness, close_within, tolerance: as in `twins.wrap`, mm.
        chord: how far polylines may be from the arcs and splines that they stand for, mm.
        up: the axis along which layers follow one another.

    Returns:
        what was found.

    Raises:
        TwinsError: a file cannot be read, or its curves are in no layers; names the file.
        JobError: the toolpath cannot be written.
    """
    curves = [curve for file in files for curve in read_curves(file, units=units, chord=chord)]
    try:
        wrapped = wrap(
            curves, at=at, up=UP[up], thickness=thickness, close_within=close_within, tolerance=tolerance
        )
    except TwinsError as error:
        raise type(error)(f"{', '.join(map(str, files))}: {error}") from None
    toolpath = wrapped.toolpath
    level = bool(np.allclose(toolpath.base.normal, [0.0, 0.0, 1.0], atol=1e-9))
    height = float(toolpath.base.origin[2])
    if level and height != 0.0:
        toolpath = move(toolpath, (0.0, 0.0, -height))
    if not out.parent.is_dir():
        raise JobError(f"{out}: there is no folder {out.parent}; make it first")
    save_toolpath(toolpath, out)
    counts = [len(layer.curves) for layer in toolpath.layers]
    return {
        "file": str(out),
        "kind": wrapped.kind,
        "layers": len(counts),
        "curves": sum(counts),
        "curves_of_a_layer": [min(counts), max(counts)],
        "thickness_mm": round(toolpath.thickness, 6),
        "moved_up_mm": round(-height, 6) if level else 0.0,
        "left_as_drawn": list(wrapped.as_drawn),
        "next": f"twincell new {out} -o JOB",
    }


def export_job(job: Job, out: Path, what: What | None, at: At) -> dict[str, Any]:
    """Write a job's curves, M, M' or its beads as they will look, in the format that the ending names.

    Args:
        job: sliced first where it is stale.
        out: DXF, 3DM, JSON or CSV for curves; STL, PLY, OBJ, 3MF, 3DM, GLB or glTF for surfaces.
        what: by default curves where the format holds nothing else, and M otherwise.
        at: the planes that curves are written in.

    Raises:
        TwinsError: an unknown ending, or a job without what is asked for.
        JobError: a job of open curves has no M.
    """
    toolpath = sliced(job)
    chosen = what or ("curves" if out.suffix.lower() in CURVES else "surface")
    if chosen == "curves":
        curves = unwrap(toolpath, at)
        save_unwrapped(curves, out)
        return {"file": str(out), "curves": len(curves), "points": sum(len(curve.points) for curve in curves)}
    if chosen == "surface" and not job.surface.is_file():
        raise JobError(
            f"{job.toolpath}: has open curves, so there is no surface; export curves or the volume"
        )
    if chosen == "beads":
        surface = visual_mesh(toolpath, job.settings.print.width)
    else:
        surface = read_surface(job.surface if chosen == "surface" else job.volume)
    write_surface(surface, out)
    return {
        "file": str(out),
        "of": chosen,
        "triangles": len(surface.faces),
        "vertices": len(surface.vertices),
    }
