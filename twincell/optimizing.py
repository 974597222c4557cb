"""Optimising a job's part or toolpath; the job stays a pair of twins, and what was there before is kept."""

from __future__ import annotations

import json
import logging
import math
import shutil
from collections.abc import Callable, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from twins import (
    FormatError,
    Plane,
    Reference,
    TwinsError,
    Zones,
    fingerprint,
    inputs_of,
    lock_bounds,
    lock_plane,
    make_surface,
    read_surface,
    reconstruct,
    relax_overhang,
    relieve_overfill,
    resample,
    save_surface,
    save_toolpath,
    smooth,
    unit_of,
)
from twins.formats.lengths import MM

from .edited import follow_edited, is_edited
from .errors import JobError
from .job import Job
from .part import read_part
from .stages import sliced

LOG = logging.getLogger(__name__)

SEGMENTS = 6.0
"""Points of a toolpath to be smoothed lie no farther apart than its least radius over this."""

NOT_REACHED = (
    "the limit is not reached everywhere; relax again, with more --strength, lock less, or give a finer mesh"
)

Told = Callable[[float], None]


def optimize_surface(
    job: Job,
    *,
    limit_deg: float | None,
    reference: Reference | None,
    strength: float,
    lock_below: float,
    lock_above: float | None,
    lock_sides: bool,
    both: bool,
    progress: Told,
) -> dict[str, Any]:
    """Deform the job's part until no face leans beyond a limit; the part before is kept as `part-before-N.ply`.

    Args:
        job: with a part.
        limit_deg: angle of overhang; by default from the mix's largest local overhang.
        reference: the angle is against gravity ("ground"), or against the build direction, which turns along rotary
            layers ("layer"); by default by ground, or by layer where that alone is what the mix limits.
        strength: λ.
        lock_below, lock_above: vertices at most so high, or at least so high, stay, mm.
        lock_sides: vertices on the sides of the part's bounding box stay.
        both: count what leans inwards as well.
        progress: is told the share done.

    Returns:
        figures before and after; "kept" and "next" are None where nothing moved, and then no file was touched.

    Raises:
        JobError: no limit is given and the mix has none.
        TwinsError: the part cannot be used, or an argument is out of its range.
    """
    if reference is None:
        known = job.mix.max_overhang_by_ground, job.mix.max_overhang_by_layer
        reference = "layer" if known[0] is None and known[1] is not None else "ground"
    if limit_deg is None:
        limits = {"ground": job.mix.max_overhang_by_ground, "layer": job.mix.max_overhang_by_layer}
        limit = limits[reference]
        if limit is None:
            raise JobError(f"{job.mix_file}: has no max_overhang_by_{reference}; give --limit in degrees")
        limit_deg = math.degrees(math.atan(limit))
    if not job.part.is_file() and job.toolpath.is_file():
        raise JobError(
            f"{job.folder}: was made from a toolpath and has no part; 'twincell optimize toolpath' betters the "
            f"toolpath, 'twincell new {job.surface}' makes a job of its surface"
        )
    for option, value in (("--lock-below", lock_below), ("--lock-above", lock_above)):
        if value is not None and not math.isfinite(value):
            raise JobError(f"{option} needs a height in mm, not {value}")
    if job.part.suffix.lower() != ".ply":
        raise JobError(f"{job.part}: only a PLY can be written back; 'twincell new' makes a job with one")
    surface = read_part(job)
    heights = np.asarray(surface.vertices)[:, 2]
    planes = job.settings.slicing.planes(surface)
    locked = lock_plane(surface, Plane.horizontal(lock_below))
    if lock_above is not None:
        locked |= heights >= lock_above
    if lock_sides:
        locked |= lock_bounds(surface)
    if locked.all():
        raise JobError(f"{job.part}: is locked altogether, up to {heights.max():.6g} mm; lock less of it")
    try:
        result = relax_overhang(
            surface,
            limit_deg,
            strength,
            locked,
            planes=planes if reference == "layer" and planes.axis is not None else None,
            side="both" if both else "below",
            progress=progress,
        )
    except TwinsError as error:
        raise type(error)(f"{job.part}: {error}") from None
    moved = result.max_displacement > 0.0
    before = _aside(job.part, "before")
    if moved:
        relaxed = make_surface(
            np.asarray(result.surface.vertices) / MM[job.settings.part.units or "mm"], result.surface.faces
        )
        # Copied, not renamed: a disk that is full leaves the part where it was.
        shutil.copy2(job.part, before)
        save_surface(relaxed, job.part, [f"overhang relaxed to {limit_deg:.6g} deg from {before.name}"])
    return {
        "limit_deg": round(limit_deg, 4),
        "by": reference,
        "area_over_limit_before_m2": round(result.over_before * 1e-6, 6),
        "area_over_limit_after_m2": round(result.over_after * 1e-6, 6),
        "worst_before_deg": round(result.worst_before_deg, 3),
        "worst_after_deg": round(result.worst_after_deg, 3),
        "volume_change_percent": round(100.0 * result.volume_change, 3),
        "mean_displacement_mm": round(result.mean_displacement, 3),
        "max_displacement_mm": round(result.max_displacement, 3),
        "iterations": result.iterations,
        "reached": result.reached,
        **({} if result.reached else {"remark": NOT_REACHED}),
        "kept": before.name if moved else None,
        "next": f"twincell {'slice' if is_edited(job) else 'plan'} {job.folder}" if moved else None,
    }


def optimize_toolpath(
    job: Job,
    *,
    min_distance: float | None,
    min_radius: float | None,
    side: int,
    protect: Sequence[Path],
    progress: Callable[[str, float], None],
) -> dict[str, Any]:
    """Move runs apart that are too close, then round what is bent too sharply; M and M' follow.

    Args:
        job: sliced again first where it is stale.
        min_distance: d_min between the middles of beads, mm; by default the bead width; 0 leaves overfill alone.
        min_radius: of the toolpath, mm; by default half the bead width; 0 leaves turns alone.
        side: 1 where rounding may move curves inwards only, -1 outwards only, 0 both.
        protect: closed meshes in the part's unit, or JSON files with polygons [[[u, v], …], …] in mm, in which the
            toolpath stays.
        progress: is told what is done and its share.

    Returns:
        figures before and after, and the name under which the toolpath before is kept; where "changed" is false no
        file was touched.

    Raises:
        FormatError: a zone's file cannot be read.
        TwinsError: an argument is out of its range, or there is no M through the result: then nothing has changed.
    """
    if min_distance == 0 and min_radius == 0:
        raise JobError("with --min-distance 0 and --min-radius 0 there is nothing to do")
    toolpath = given = sliced(job)
    width = job.settings.print.width
    d = width if min_distance is None else min_distance
    radius = 0.5 * width if min_radius is None else min_radius
    zones = _zones(protect, job.settings.part.units)
    for nothing in zones.idle(toolpath) if protect else ():
        LOG.warning("--protect: %s", nothing)
    values: dict[str, Any] = {}
    try:
        if d != 0:
            relief = relieve_overfill(
                toolpath,
                d,
                zones,
                progress=lambda share: progress("moving runs apart", share),
            )
            toolpath = relief.toolpath
            values |= {
                "min_distance_mm": d,
                "length_too_close_before_m": round(relief.before.close / 1000.0, 4),
                "length_too_close_after_m": round(relief.after.close / 1000.0, 4),
                "largest_displacement_mm": round(relief.displacement, 3),
                "area_change_percent": round(100.0 * relief.area_change, 3),
                "largest_area_change_of_a_layer_percent": round(100.0 * relief.largest_area_change, 3),
            }
        if radius != 0:
            if not radius > 0:
                raise JobError(
                    f"the least radius must be above 0 mm, or 0 to leave turns alone, not {radius:g}"
                )
            finer = resample(
                toolpath, min(radius / SEGMENTS, toolpath.thickness), corner_deg=1.0, locked=zones
            )
            smoothed = smooth(
                finer,
                side,  # type: ignore[arg-type]
                1.0 / radius,
                locked=zones,
                progress=lambda share: progress("smoothing", share),
            )
            toolpath = smoothed.toolpath
            values |= {
                "min_radius_mm": radius,
                "sharpest_radius_before_mm": _radius([x.largest_curvature_before for x in smoothed.layers]),
                "sharpest_radius_after_mm": _radius([x.largest_curvature for x in smoothed.layers]),
                "largest_turn_before_deg": _degrees([x.largest_turning_before for x in smoothed.layers]),
                "largest_turn_after_deg": _degrees([x.largest_turning for x in smoothed.layers]),
                "largest_smoothing_mm": round(max(x.largest_displacement for x in smoothed.layers), 3),
                "points_still_sharper": sum(x.remaining for x in smoothed.layers),
                "curves_given_a_smaller_radius": sum(len(x.eased) for x in smoothed.layers),
                "curves_unfinished": sum(len(x.unfinished) for x in smoothed.layers),
                "curves_left_alone": sum(len(x.left_alone) for x in smoothed.layers),
            }
        if all(curve.closed for *_, curve in toolpath.curves()):
            reconstruct(
                toolpath, job.settings.slicing.resolution
            )  # refuses what has no M before anything is replaced
    except TwinsError as error:
        raise type(error)(f"{job.toolpath}: {error}") from None
    values["changed"] = fingerprint(toolpath) != fingerprint(given)
    if not values["changed"]:
        return values
    inputs = inputs_of(job.toolpath)
    inputs.pop("toolpath", None)
    before = _aside(job.toolpath, "before")
    shutil.copy2(job.toolpath, before)
    save_toolpath(toolpath, job.toolpath, inputs)
    follow_edited(job, toolpath, quiet=True)
    return {**values, "kept": before.name, "next": f"twincell plan {job.folder}"}


def _aside(path: Path, word: str) -> Path:
    """A name that is free, beside a file's."""
    return next(
        aside
        for n in count(1)
        if not (aside := path.with_name(f"{path.stem}-{word}-{n}{path.suffix}")).exists()
    )


def _radius(curvatures: Sequence[float]) -> float | None:
    largest = max(curvatures, default=0.0)
    return round(1.0 / largest, 3) if largest > 0 else None


def _degrees(turns: Sequence[float]) -> float:
    return round(math.degrees(max(turns, default=0.0)), 2)


def _zones(files: Sequence[Path], unit: str | None) -> Zones:
    """Zones from files: meshes in their own unit or else the part's, and polygons in mm."""
    polygons: list[Any] = []
    solids = []
    for file in files:
        try:
            if file.suffix.lower() == ".json":
                polygons += _polygons(file)
            else:
                solids.append(read_surface(file, unit=None if unit_of(file) else unit))
                Zones(solids=solids[-1:])
        except TwinsError as error:
            raise error if str(file) in str(error) else type(error)(f"{file}: {error}") from None
    return Zones(polygons, solids)


def _polygons(file: Path) -> list[Any]:
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FormatError(f"{file}: cannot be read as JSON: {error}") from None
    if not isinstance(found, list) or not all(
        isinstance(polygon, list) and all(isinstance(corner, list) for corner in polygon) for polygon in found
    ):
        raise FormatError(f"{file}: must hold a list of polygons, each a list of corners [u, v] in mm")
    Zones(found)
    return found
