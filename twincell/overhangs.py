"""Overhang of jobs, toolpaths and meshes, measured side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from twins import (
    LocalOverhang,
    Reference,
    SurfaceOverhang,
    check_surface,
    load_toolpath,
    local_overhang,
    read_surface,
    surface_overhang,
)

from .errors import JobError
from .job import load_job
from .stages import sliced

WORST = 5
"""Places that are named."""

LARGEST = 20.0
"""Limits of d / t beyond this are angles by mistake: it is a lean of 87 degrees."""


@dataclass(frozen=True, eq=False)
class Scheme:
    """One of what is compared.

    Attributes:
        name: of the source.
        overhang: measured, d / t.
        limit: of its material, or None.
        surface: what was measured, where it is a mesh.
    """

    name: str
    overhang: LocalOverhang | SurfaceOverhang
    limit: float | None
    surface: trimesh.Trimesh | None = None

    def as_dict(self) -> dict[str, object]:
        """Figures; lengths in m, areas in m²."""
        over, toolpath = self.overhang, isinstance(self.overhang, LocalOverhang)
        values: dict[str, object] = {
            "of": "toolpath" if toolpath else "surface",
            "largest": round(over.maximum, 4),
            "p95": round(over.quantile(0.95), 4),
            "median": round(over.quantile(0.5), 4),
            "length_m" if toolpath else "area_m2": round(over.total * (1e-3 if toolpath else 1e-6), 4),
        }
        if self.limit is not None:
            values["limit"] = self.limit
            values["share_above_limit"] = round(over.share_above(self.limit), 6)
        if isinstance(over, LocalOverhang):
            values["worst"] = [str(place) for place in over.worst(WORST)]
        elif self.surface is not None:
            size = np.ptp(np.asarray(self.surface.vertices), axis=0)
            values["size_mm"] = [round(float(length), 3) for length in size]
            at = int(np.argmax(over.values))
            x, y, z = np.asarray(self.surface.triangles_center)[at]
            values["worst"] = [f"{over.values[at]:.2f} at face {at} ({x:.1f}, {y:.1f}, {z:.1f})"]
        return values


def overhangs_of(sources: Sequence[Path], reference: Reference, limit: float | None) -> list[Scheme]:
    """Measure each source: a job folder, a toolpath.json, or a mesh in mm as it stands on z = 0.

    Args:
        sources: their paths.
        reference: "ground" or "layer".
        limit: of d / t; by default that of a job's mix.

    Raises:
        JobError: a source that is none of these.
        TwinsError: it cannot be read or measured.
    """
    if limit is not None and not 0.0 < limit < LARGEST:
        raise JobError(
            f"a limit of d / t is above 0 and below {LARGEST:g}, not {limit:g}; 1 is a lean of 45 degrees"
        )
    schemes = []
    for source in sources:
        own, surface = limit, None
        if source.is_dir():
            job = load_job(source)
            measured: LocalOverhang | SurfaceOverhang = local_overhang(sliced(job), reference)
            if own is None:
                mix = job.mix
                own = mix.max_overhang_by_ground if reference == "ground" else mix.max_overhang_by_layer
        elif source.suffix.lower() == ".json":
            measured = local_overhang(load_toolpath(source), reference)
        elif source.is_file():
            surface = read_surface(source)
            check_surface(surface)
            measured = surface_overhang(surface, side="both")
        else:
            raise JobError(f"{source}: no such file; name a job folder, a toolpath.json or a mesh")
        schemes.append(Scheme(str(source), measured, own, surface))
    return schemes
