"""A job's toolpath that was edited, or that came from elsewhere: it is used as it is, and M and M' follow it."""

from __future__ import annotations

import logging
from itertools import count

import numpy as np

from twins import (
    Layer,
    Toolpath,
    ToolpathMesh,
    TwinsError,
    extrude,
    fingerprint,
    inputs_of,
    load_toolpath,
    save_surface,
    slice_reporting,
    toolpath_mesh,
)

from .job import Job
from .part import read_part

LOG = logging.getLogger(__name__)


def is_edited(job: Job) -> bool:
    """Whether the job's toolpath is not as slicing wrote it."""
    return job.toolpath.is_file() and inputs_of(job.toolpath).get("toolpath") != fingerprint(
        load_toolpath(job.toolpath)
    )


def has_only_toolpath(job: Job) -> bool:
    """Whether the job began with a toolpath: it has no part, and its toolpath was sliced from none of its own."""
    return not job.part.is_file() and job.toolpath.is_file() and "part" not in inputs_of(job.toolpath)


def keep_edited(job: Job) -> None:
    """Put an edited toolpath aside before it is replaced."""
    try:
        if not is_edited(job):
            return
    except TwinsError:
        pass  # what cannot be read may be somebody's work all the same
    aside = next(path for n in count(1) if not (path := job.folder / f"toolpath-edited-{n}.json").exists())
    job.toolpath.rename(aside)
    LOG.warning("%s was edited; it is kept as %s", job.toolpath, aside.name)


def is_outdated(job: Job) -> bool:
    """Whether the job's toolpath was edited or optimised, and the part or [slicing] has changed since it was sliced."""
    if not job.part.is_file() or not is_edited(job):
        return False
    made_from, now = inputs_of(job.toolpath), job.slicing_inputs()
    return any(made_from[name] != now[name] for name in ("part", "slicing") if name in made_from)


def follow_edited(job: Job, toolpath: Toolpath, *, quiet: bool = False) -> None:
    """Make M and M' follow a toolpath that was edited, or that came from elsewhere; unless quiet, say so, but
    not of a job that began with one.
    """
    inputs = job.edited_inputs(toolpath)
    if inputs_of(job.volume) == inputs:
        return
    if not (quiet or has_only_toolpath(job)):
        LOG.warning(
            "%s was edited, optimised or made by hand, and is used as it is%s",
            job.toolpath,
            "" if not job.part.is_file() else f"; to slice the part instead: twincell slice {job.folder}",
        )
    resolution = job.settings.slicing.resolution
    comments = [f"{name} sha256 {value}" for name, value in inputs.items()]
    try:
        is_open = next(((i, j) for i, j, _, curve in toolpath.curves() if not curve.closed), None)
        if is_open is None:
            mesh = _mesh_of_edited(job, toolpath)
            for remark in mesh.remarks:
                LOG.warning("%s: %s", job.toolpath, remark)
            save_surface(mesh.surface, job.surface, comments)
        else:
            LOG.warning("%s: layer %d, curve %d is open, so there is no surface", job.toolpath, *is_open)
            job.surface.unlink(missing_ok=True)
        save_surface(extrude(toolpath, job.settings.print.width, resolution), job.volume, comments)
    except TwinsError as error:
        raise type(error)(f"{job.toolpath}: {error}") from None


def _mesh_of_edited(job: Job, toolpath: Toolpath) -> ToolpathMesh:
    """M; where the part is there, its surface shows how layers hang together that were left as sliced."""
    slicing = job.settings.slicing
    if job.part.is_file():
        surface = read_part(job)
        planes = slicing.planes(surface)
        original, _ = slice_reporting(surface, planes, slicing.resolution)
        if _same_planes(original, toolpath):
            edited = {i for i, (a, b) in enumerate(zip(original.layers, toolpath.layers, strict=True))
                      if not _same_curves(a, b)}  # fmt: skip
            return toolpath_mesh(toolpath, slicing.resolution, surface, edited=edited)
    return toolpath_mesh(toolpath, slicing.resolution)


def _same_planes(one: Toolpath, two: Toolpath) -> bool:
    if len(one.layers) != len(two.layers):
        return False
    pairs = zip(one.layers, two.layers, strict=True)
    planes = [pair for a, b in pairs for pair in ((a.slicing, b.slicing), (a.nozzle, b.nozzle))]
    return all(
        np.allclose(p.origin, q.origin, atol=1e-6) and np.allclose(p.rotation, q.rotation, atol=1e-9)
        for p, q in [(one.base, two.base), *planes]
    )


def _same_curves(one: Layer, two: Layer) -> bool:
    return len(one.curves) == len(two.curves) and all(
        a.points.shape == b.points.shape and np.allclose(a.points, b.points, atol=1e-9)
        for a, b in zip(one.curves, two.curves, strict=True)
    )
