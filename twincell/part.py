"""The part of a job: read, in mm, and checked."""

from __future__ import annotations

import numpy as np
import trimesh

from twins import SurfaceError, check_surface, read_surface, unit_of

from .job import Job

MM = {"mm": 1.0, "m": 1000.0, "in": 25.4}

SMALLEST = 10.0
"""A part with a longest side below this is taken for one in another unit, mm."""

LARGEST = 30_000.0

FIT = 1e-3
"""How far a part may lie outside its planes, as a share of the layer thickness: rounding of file formats."""


def read_part(job: Job) -> trimesh.Trimesh:
    """The part of a job, in mm, checked.

    Raises:
        FormatError: it cannot be read.
        SurfaceError: it does not bound a solid, has an unlikely size, or lies below the bed.
    """
    surface = read_surface(job.part, unit=job.settings.part.units)
    try:
        check_surface(surface)
        check_size(surface, job.settings.part.units or unit_of(job.part) or "mm")
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
