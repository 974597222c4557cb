"""The part of a job: read, in mm, and checked."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

from planning import Cell
from twins import SurfaceError, check_surface, read_surface, unit_of
from twins.formats.lengths import MM

from .job import Job

Array = npt.NDArray[np.float64]

SMALLEST = 10.0
"""A part with a longest side below this is taken for one in another unit, mm."""

LARGEST = 30_000.0

USUAL = ("mm", "cm", "m", "in", "ft")
"""Units that a file may be in that was read in another."""

FEW = 3.0
"""Beads, or layers, below which a part is hardly one."""

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
    if SMALLEST <= size <= LARGEST:
        return
    others = {u: size / MM[units] * MM[u] for u in USUAL if u != units}
    likely = [f"--units {u} ({mm:.4g} mm)" for u, mm in others.items() if SMALLEST <= mm <= LARGEST]
    said = f"{size:.4g} mm" if size < SMALLEST else f"{size / 1000:.4g} m"
    raise SurfaceError(
        f"the part's longest side is {said}, read in {spelt(units)}; give the unit that was meant, "
        f'{", ".join(likely) or "with --units"} (in job.toml units = "…"), or the size with --longest'
    )


def spelt(unit: str) -> str:
    """A unit where "in" would be read as another word."""
    return {"in": "inches", "ft": "feet", "mil": "mils", "yd": "yards"}.get(unit, unit)


def in_words(size: Array) -> str:
    """A size, shape (3,), mm."""
    return " × ".join(f"{length:.5g}" for length in size) + " mm"


def doubts_of_size(low: Array, high: Array, cell: Cell, width: float, thickness: float) -> tuple[str, ...]:
    """One sentence each on what may not be meant: larger than a cell's bed, smaller than a few beads or layers.

    Args:
        low, high: bounds of what stands on the bed, shape (3,), mm.
        cell: to print it.
        width, thickness: of beads and layers, mm.
    """
    bed, said = cell.bed, []
    half = 0.5 * np.array(bed.size)
    if (low[:2] < -half).any() or (high[:2] > half).any() or high[2] > bed.height:
        said.append(
            f"reaches beyond the bed of {cell.name}, {bed.size[0]:g} × {bed.size[1]:g} mm and {bed.height:g} mm high; "
            "check the unit, or name a larger cell"
        )
    side, height = float((high - low)[:2].min()), float(high[2] - min(low[2], 0.0))
    if side < FEW * width:
        said.append(
            f"is {side:.4g} mm across, with beads of {width:g} mm; check the unit, or print narrower beads"
        )
    if height < FEW * thickness:
        said.append(
            f"is {height:.4g} mm high, with layers of {thickness:g} mm; check the unit, or print thinner layers"
        )
    return tuple(said)
