"""Overhang of jobs, toolpaths and meshes, measured side by side and drawn as one picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from twins import (
    LocalOverhang,
    Reference,
    SurfaceOverhang,
    check_surface,
    load_toolpath,
    local_overhang,
    overhang_distribution,
    read_surface,
    surface_overhang,
)

from .errors import JobError
from .job import load_job
from .stages import sliced

WORST = 5
"""Places that are named."""


@dataclass(frozen=True, eq=False)
class Scheme:
    """One of what is compared.

    Attributes:
        name: of the source.
        overhang: measured, d / t.
        limit: of its material, or None.
    """

    name: str
    overhang: LocalOverhang | SurfaceOverhang
    limit: float | None

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
    schemes = []
    for source in sources:
        own = limit
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
            measured = surface_overhang(surface, side="below")
        else:
            raise JobError(f"{source}: no such file; name a job folder, a toolpath.json or a mesh")
        schemes.append(Scheme(str(source), measured, own))
    return schemes


def draw_overhangs(schemes: Sequence[Scheme], path: Path) -> None:
    """Draw the cumulative distributions of all schemes: what share of the length or area has at most which d / t."""
    table = overhang_distribution({f"{i}": scheme.overhang for i, scheme in enumerate(schemes)})
    mpl.rcParams["font.size"] = 9
    figure = Figure(figsize=(7.5, 4.5), layout="constrained")
    axes = figure.subplots()
    for scheme, shares in zip(schemes, table.shares, strict=True):
        (line,) = axes.plot(table.overhang, 100.0 * shares, label=scheme.name)
        if scheme.limit is not None:
            axes.axvline(scheme.limit, color=line.get_color(), linestyle=":", linewidth=1.0)
    limits = [scheme.limit for scheme in schemes if scheme.limit is not None]
    axes.set_xlim(0.0, max([float(table.overhang[-1]), *(1.05 * limit for limit in limits)]))
    axes.set_ylim(0.0, 101.0)
    axes.set_xlabel("local overhang d / t; dotted: limit")
    axes.set_ylabel("share of length or area with at most that [%]")
    axes.set_title("Local overhang")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=120)
