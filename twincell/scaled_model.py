"""A job's scaled model: G-code for a desktop printer, of the very toolpath that the cell prints."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from planning import PlanningError
from planning.desktop_printer import load_printer
from planning.gcode import model_gcode, needs
from planning.model_scales import ratio
from planning.scaled import scaled_model
from twins import FormatError
from twins.formats.labelled import write_whole

from .errors import JobError
from .job import Job
from .stages import sliced


def gcode_job(
    job: Job, scale: float = 12.5, printer: str = "cr10", width: float | None = None, out: Path | None = None
) -> dict[str, Any]:
    """Write a job's toolpath as G-code; slices the part first where that is missing or stale.

    Args:
        job: its `[print] width` is the bead's where the toolpath has none of its own.
        scale: n of a scale of 1:n.
        printer: a shipped desktop printer, or the path of a TOML file, also relative to the job.
        width: instead of the job's, mm at full size.
        out: the file; default `model.gcode` in the job folder.

    Returns:
        What was written, for people and machines.

    Raises:
        JobError: the scale is not above 0, or the file cannot be written.
        PlanningError: the printer cannot print it so; names the scales that it can.
        TwinsError: the job has no toolpath, and none can be made.
    """
    if not (math.isfinite(scale) and scale > 0):
        raise JobError(f"--scale must be above 0, the n of a scale of 1:n, not {scale}")
    machine = load_printer(printer, job.folder)
    toolpath = sliced(job)
    try:
        model = scaled_model(
            toolpath, machine, 1.0 / scale, job.settings.print.width if width is None else width
        )
    except PlanningError as error:
        raise PlanningError(f"{job.toolpath}: {error}") from None
    written = model_gcode(model, machine)
    path = job.folder / "model.gcode" if out is None else out
    if not path.parent.is_dir():
        raise JobError(f"{path}: cannot be written: there is no folder {path.parent}; make it first")
    try:
        write_whole(path, lambda partial, _: _write(written.text, partial), ())
    except FormatError as error:
        raise JobError(str(error)) from None
    return {
        "file": str(path),
        "printer": machine.name,
        "needs": needs(model, machine),
        "scale": ratio(model.scale),
        "size_mm": [round(float(value), 1) for value in model.size],
        "layers": len({bead.layer for bead in model.beads}),
        "model_volume_mm3": round(model.volume, 1),
        "filament_m": round(model.volume / machine.filament_area * 1e-3, 3),
        "print_time_s": round(float(written.duration), 1),
    }


def _write(text: str, path: Path) -> None:
    path.write_text(text, encoding="ascii", newline="\n")
