"""The stages of a job: each reads what the one before wrote, and says when that is stale."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
import trimesh

from planning import Finding, PlanningError, Program, Severity, check, plan, urscript
from twins import (
    PlanesError,
    SurfaceError,
    Toolpath,
    TwinsError,
    extrude,
    fingerprint,
    inputs_of,
    load_toolpath,
    save_surface,
    save_toolpath,
    slice_reporting,
    toolpath_mesh,
)

from .edited import follow_edited, has_only_toolpath, is_edited, is_outdated, keep_edited
from .errors import JobError
from .job import Job
from .part import FIT, read_part

LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Sliced:
    """A toolpath with its twin M and its volume M'."""

    toolpath: Toolpath
    surface: trimesh.Trimesh
    volume: trimesh.Trimesh


def slice_job(job: Job) -> Sliced:
    """Slice the part; write the toolpath, M and M'.

    Raises:
        JobError: the job was made from a toolpath, and has no part.
        TwinsError: the part or the planes cannot be used; names the file.
    """
    if has_only_toolpath(job):
        raise JobError(
            f"{job.part}: no such file: this job was made from a toolpath and has no part to slice; "
            f"go on with: twincell plan {job.folder}"
        )
    surface = read_part(job)
    slicing = job.settings.slicing
    try:
        planes, uneven = slicing.planes_reporting(surface)
        toolpath, remarks = slice_reporting(surface, planes, slicing.resolution)
        over = planes.nozzle[-1].height_of(np.asarray(surface.vertices))
        if float(over.max()) > FIT * planes.thickness:
            raise SurfaceError(
                f"the part reaches {float(over.max()):.6g} mm above the top plane; raise that plane or cut the part"
            )
        for remark in (*uneven, *remarks):
            LOG.warning("%s: %s", job.part, remark)
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
    keep_edited(job)
    comments = [f"{name} sha256 {value}" for name, value in inputs.items()]
    save_surface(made.surface, job.surface, comments)
    save_surface(made.volume, job.volume, comments)
    # Last: it says that all three are fresh, and by its fingerprint that nobody has edited it.
    save_toolpath(toolpath, job.toolpath, {**inputs, "toolpath": fingerprint(toolpath)})
    return made


def sliced(job: Job) -> Toolpath:
    """The toolpath of a job, sliced again if it is missing or stale; one that was edited is used as it is."""
    if job.toolpath.is_file():
        try:
            toolpath = load_toolpath(job.toolpath)
        except TwinsError as error:
            raise type(error)(
                f"{error}; correct it, or slice the part anew: twincell slice {job.folder}"
            ) from None
        inputs = inputs_of(job.toolpath)
        if inputs.pop("toolpath", "") != fingerprint(toolpath):
            follow_edited(job, toolpath)
            return toolpath
        if inputs == job.slicing_inputs() and job.surface.is_file() and job.volume.is_file():
            return toolpath
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
    return program, toolpath, checked(job, program, toolpath)


def checked(job: Job, program: Program, toolpath: Toolpath) -> list[Finding]:
    """What speaks against printing a job's program."""
    findings = check(program, job.cell, job.mix, toolpath)
    if has_only_toolpath(job):
        findings = [_without_part(finding, job) for finding in findings]
    if is_outdated(job):
        findings.append(
            Finding(
                "toolpath",
                Severity.WARNING,
                -1,
                0.0,
                0.0,
                "",
                f"{job.toolpath} was edited or optimised before the part or [slicing] last changed, and is what would "
                "be printed",
                f"if the part is meant: twincell slice {job.folder}",
            )
        )
    return findings


def _without_part(finding: Finding, job: Job) -> Finding:
    """A finding whose remedy is one for a job that has no part to deform."""
    if not finding.kind.startswith("overhang"):
        return finding
    relax = (
        f"relax the curves' surface as a part (twincell new {job.surface} -o ANOTHER, then: twincell optimize surface "
        "ANOTHER --both)"
    )
    draw = "draw the layers there nearer to those below"
    remedy = (
        f"{relax if job.surface.is_file() else draw}, print in another direction, or choose a stiffer mix"
    )
    return replace(finding, remedy=remedy)


def planned(job: Job) -> tuple[Program, Toolpath]:
    """The program of a job.

    Raises:
        JobError: it is older than what it was made from.
    """
    program = Program.load(job.program)
    made_from = inputs_of(job.toolpath)
    made_from.pop("toolpath", None)
    stale = not is_edited(job) and made_from != job.slicing_inputs()
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
