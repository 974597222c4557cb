"""The doorway for designers: curves in, as a toolpath; a job's curves and surfaces out, in their formats."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from twins import (
    Plane,
    SpaceCurve,
    Toolpath,
    TwinsError,
    Wrapped,
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
from .report import heights, span
from .stages import sliced

Array = npt.NDArray[np.float64]
At = Literal["nozzle", "slicing"]
What = Literal["curves", "surface", "volume", "beads"]

CURVES = (".dxf", ".csv", ".json")
"""Endings that only curves are written to."""

NEAR = 0.25
"""Ends of an open curve nearer than this share of its length may be meant to meet."""

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
    bed: float | None = None,
    z: Sequence[float] = (),
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
        bed: where the bed is along that axis, mm. Without bed and thickness it is where the heights of the first
            layer's curves tell. If they have none, it is as far below the first layer as the second is above it; but
            where it would lie below 0 although all curves are above, it is at 0.
        z: height of the curves of each SVG where it has no `data-z`, in the order of the files, mm.

    Returns:
        what was found.

    Raises:
        TwinsError: a file cannot be read, or its curves are in no layers; names the file.
        JobError: the toolpath cannot be written, or heights of SVGs are missing.
    """
    if out.suffix.lower() != ".json":
        raise JobError(
            f"{out}: a toolpath is written as .json; name one with -o, and then for another format: twincell new "
            f"{out.with_suffix('.json')} -o JOB, twincell export JOB -o {out}"
        )
    curves = _curves(files, units, chord, z)

    def on(base: Plane | None) -> Wrapped:
        try:
            return wrap(
                curves, at=at, up=UP[up], bed=base, thickness=thickness, close_within=close_within,
                tolerance=tolerance,
            )  # fmt: skip
        except TwinsError as error:
            raise type(error)(f"{', '.join(map(str, files))}: {error}") from None

    wrapped, why = on(None if bed is None else _square_to(up, bed)), "given"
    if bed is None and thickness is not None:
        why = "under a first layer of the thickness given"
    elif bed is None and any(curves[i].heights is not None for i in wrapped.sources[0]):
        why = "told by the heights of the first layer's curves"
    elif bed is None and _sinks(wrapped, curves, np.array(UP[up])):
        wrapped, why = on(_square_to(up, 0.0)), f"{up} = 0, as all curves lie above it"
    elif bed is None:
        why = "assumed as far below the first layer as the second is above it"
    toolpath = wrapped.toolpath
    first = np.concatenate([c.heights for c in unwrap(toolpath) if c.layer == 0])
    level = bool(np.allclose(toolpath.base.normal, [0.0, 0.0, 1.0], atol=1e-9))
    height = float(toolpath.base.origin[2]) if level else 0.0
    if height != 0.0:
        toolpath = move(toolpath, (0.0, 0.0, -height))
    if not out.parent.is_dir():
        raise JobError(f"{out}: there is no folder {out.parent}; make it first")
    try:
        save_toolpath(toolpath, out)
    except OSError as error:
        raise JobError(f"{out}: cannot be written: {error.strerror}; name another file with -o") from None
    counts = [len(layer.curves) for layer in toolpath.layers]
    return {
        "file": str(out),
        "kind": wrapped.kind,
        "layers": len(counts),
        "curves": sum(counts),
        "curves_of_a_layer": span(np.array(counts), 0),
        "open_curves": int(sum(not curve.closed for *_, curve in toolpath.curves())),
        **heights(toolpath),
        "bed": why,
        "first_layer_mm": span(first),
        "moved_up_mm": round(-height, 6) + 0.0,
        "open_curves_left_as_drawn": list(wrapped.as_drawn),
        "curves_turned_as_in_an_open_one": list(wrapped.by_open),
        "curves_with_nothing_directly_below": list(wrapped.hanging),
        "remarks": _on_open(toolpath),
        "next": f"twincell new {out} -o JOB",
    }


def _on_open(toolpath: Toolpath) -> list[str]:
    """A sentence on open curves, which may be meant closed where their ends are near one another."""
    lengths = [curve.length for *_, curve in toolpath.curves() if not curve.closed]
    gaps = np.array(
        [np.linalg.norm(c.points[-1] - c.points[0]) for *_, c in toolpath.curves() if not c.closed]
    )
    if not len(gaps):
        return []
    near = gaps[gaps <= NEAR * np.array(lengths)]
    total = sum(len(layer.curves) for layer in toolpath.layers)
    said = f"{len(gaps)} of {total} curves {'is' if len(gaps) == 1 else 'are'} open"
    them = "it" if len(near) == 1 else "them"
    if not len(near):
        return [f"{said}, and would be printed so"]
    largest = float(near.max())
    digit = 10.0 ** (np.floor(np.log10(max(largest, 1e-6))) - 2)
    enough = float(np.ceil(largest / digit + 0.01) * digit)
    which = "" if len(near) == len(gaps) else f", {len(near)} of them with ends near one another"
    return [f"{said}{which} (largest gap {largest:.4g} mm); close {them} with --close-within {enough:.4g}"]


def _curves(files: Sequence[Path], units: str | None, chord: float, z: Sequence[float]) -> list[SpaceCurve]:
    """The curves of all files."""
    drawings = [file for file in files if file.suffix.lower() == ".svg"]
    if z and len(z) != len(drawings):
        raise JobError(
            f"--z gives {len(z)} heights, but there are {len(drawings)} SVG files; give one for each, in their order"
        )
    heights = iter(z)
    curves: list[SpaceCurve] = []
    for file in files:
        height = next(heights, 0.0) if file in drawings else 0.0
        found = read_curves(file, units=units, chord=chord, z=height)
        if not z and file in drawings and len(drawings) > 1:
            elsewhere = read_curves(file, units=units, chord=chord, z=1.0)
            if any(a.points[0, 2] != b.points[0, 2] for a, b in zip(found, elsewhere, strict=True)):
                raise JobError(
                    f"{file}: does not say how high its curves lie, so they would be in one layer with those of the "
                    "other SVGs; give --z for each SVG, or data-z in the files"
                )
        curves += found
    return curves


def _square_to(up: str, height: float) -> Plane:
    """The plane square to an axis, at a place along it, mm."""
    axes = {"x": ("y", "z"), "y": ("z", "x"), "z": ("x", "y")}[up]
    return Plane(height * np.array(UP[up]), *(np.array(UP[axis]) for axis in axes))


def _sinks(wrapped: Wrapped, curves: Sequence[SpaceCurve], up: Array) -> bool:
    """Whether the base lies below 0 under the first layer, although all curves lie above 0."""
    points = np.concatenate([curve.points for curve in curves])
    allowed = 1e-6 * float(np.linalg.norm(np.ptp(points, axis=0)))
    if float((points @ up).min()) <= allowed:
        return False
    first, base = np.concatenate([curves[i].points for i in wrapped.sources[0]]), wrapped.toolpath.base
    under = first - np.outer(base.height_of(first), base.normal)
    return float((under @ up).min()) < -allowed


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
