"""The stages of a job: each reads what the one before wrote, and says when that is stale."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import trimesh

from planning import Finding, PlanningError, Program, Severity, check, plan, urscript
from twins import (
    PlanesError,
    SurfaceError,
    Toolpath,
    TwinsError,
    check_surface,
    extrude,
    inputs_of,
    load_toolpath,
    make_surface,
    read_surface,
    save_surface,
    save_toolpath,
    slice_reporting,
    toolpath_mesh,
)

from .errors import JobError
from .job import Job

LOG = logging.getLogger(__name__)

MM = {"mm": 1.0, "m": 1000.0, "in": 25.4}

SMALLEST = 10.0
"""A part with a longest side below this is taken for one in another unit, mm."""

LARGEST = 30_000.0

FIT = 1e-3
"""How far a part may lie outside its planes, as a share of the layer thickness: rounding of file formats."""


@dataclass(frozen=True)
class Sliced:
    """A toolpath with its twin M and its volume M'."""

    toolpath: Toolpath
    surface: trimesh.Trimesh
    volume: trimesh.Trimesh


def read_part(job: Job) -> trimesh.Trimesh:
    """The part of a job, in mm, checked.

    Raises:
        FormatError: it cannot be read.
        SurfaceError: it does not bound a solid, has an unlikely size, or lies below the bed.
    """
    surface = read_surface(job.part)
    factor = MM[job.settings.part.units]
    surface = make_surface(np.asarray(surface.vertices) * factor, surface.faces)
    try:
        check_surface(surface)
        check_size(surface, job.settings.part.units)
    except SurfaceError as error:
        raise SurfaceError(f"{job.part}: {error}") from None
    bottom = float(np.asarray(surface.vertices)[:, 2].min())
    if bottom < -FIT * job.settings.slicing.thickness:
        raise SurfaceError(
            f"{job.part}: the part reaches {-bottom:.6g} mm below the bed (z = 0); "
            "set it down with 'twincell new', which moves it up"
        )
    return surface


def check_size(surface: trimesh.Trimesh, units: str) -> None:
    """Refuse a part whose size tells of another unit.

    Raises:
        SurfaceError: below 10 mm or above 30 m.
    """
    size = float(np.ptp(np.asarray(surface.vertices), axis=0).max())
    if size < SMALLEST:
        raise SurfaceError(
            f"the part's longest side is {size:.4g} mm, read in {units}; if the file is in metres give --units m "
            '(units = "m" in job.toml), or its size with --longest'
        )
    if size > LARGEST:
        raise SurfaceError(
            f"the part's longest side is {size / 1000:.4g} m, read in {units}; check the file's unit"
        )


def slice_job(job: Job) -> Sliced:
    """Slice the part; write the toolpath, M and M'.

    Raises:
        TwinsError: the part or the planes cannot be used; names the file.
    """
    surface = read_part(job)
    slicing = job.settings.slicing
    try:
        planes = slicing.planes(float(np.asarray(surface.vertices)[:, 2].max()))
        toolpath, remarks = slice_reporting(surface, planes, slicing.resolution)
        for remark in remarks:
            LOG.warning("%s: %s", job.part, remark)
        over = planes.nozzle[-1].height_of(np.asarray(surface.vertices))
        if float(over.max()) > FIT * planes.thickness:
            raise SurfaceError(
                f"the part reaches {float(over.max()):.6g} mm above the top plane; raise that plane or cut the part"
            )
        mesh = toolpath_mesh(toolpath, slicing.resolution, surface)
        for remark in mesh.remarks:
            LOG.warning("%s: %s", job.part, remark)
        made = Sliced(
            toolpath,
            mesh.surface,
            extrude(toolpath, job.settings.print.width, slicing.resolution),
        )
    except PlanesError as error:
        raise PlanesError(f"{job.folder / 'job.toml'}: [slicing]: {error}") from None
    except TwinsError as error:
        raise type(error)(f"{job.part}: {error}") from None
    inputs = job.slicing_inputs()
    comments = [f"{name} sha256 {value}" for name, value in inputs.items()]
    save_surface(made.surface, job.surface, comments)
    save_surface(made.volume, job.volume, comments)
    save_toolpath(toolpath, job.toolpath, inputs)  # last: it says that all three are fresh
    return made


def sliced(job: Job) -> Toolpath:
    """The toolpath of a job, sliced again if it is missing or stale."""
    if inputs_of(job.toolpath) == job.slicing_inputs() and job.surface.is_file() and job.volume.is_file():
        return load_toolpath(job.toolpath)
    return slice_job(job).toolpath


def plan_job(job: Job) -> tuple[Program, Toolpath, list[Finding]]:
    """Plan the job's toolpath; write program.npz and program.script."""
    toolpath = sliced(job)
    try:
        program = plan(toolpath, job.cell, job.mix, job.settings.print, job.printing_inputs())
    except PlanningError as error:
        raise type(error)(f"{job.toolpath}: {error}") from None
    program.save(job.program)
    partial = job.script.with_suffix(".partial")
    partial.write_text(urscript(program, job.cell), encoding="utf-8")
    partial.replace(job.script)
    return program, toolpath, check(program, job.cell, job.mix, toolpath)


def planned(job: Job) -> tuple[Program, Toolpath]:
    """The program of a job.

    Raises:
        JobError: it is older than what it was made from.
    """
    program = Program.load(job.program)
    stale = inputs_of(job.toolpath) != job.slicing_inputs()
    changed = [name for name, value in job.printing_inputs().items() if program.inputs.get(name) != value]
    if stale or changed:
        what = ", ".join((["part or [slicing]"] if stale else []) + changed)
        raise JobError(
            f"{job.program}: made before the last change of {what}; plan again: twincell plan {job.folder}"
        )
    return program, load_toolpath(job.toolpath)


def refuse(findings: list[Finding]) -> None:
    """Stop before a program with errors.

    Raises:
        JobError: the first error, and how many there are.
    """
    errors = [finding for finding in findings if finding.severity is Severity.ERROR]
    if errors:
        more = f" (and {len(errors) - 1} more: twincell check)" if len(errors) > 1 else ""
        raise JobError(f"not printable: {errors[0]}{more}")
