"""The report of a job: `summary.json`; its pictures are drawn in `program_pictures`."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from planning import Finding, Program, SegmentKind
from twins import Toolpath, signed_volume, unwrap


def write_summary(folder: Path, values: dict[str, Any], *, anew: bool = False) -> None:
    """Merge values into `summary.json`, or write it anew; keys carry their units."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "summary.json"
    known: dict[str, Any] = {}
    if path.is_file() and not anew:
        with contextlib.suppress(ValueError):
            read = json.loads(path.read_text(encoding="utf-8"))
            known = read if isinstance(read, dict) else {}
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps({**known, **values}, indent=2) + "\n", encoding="utf-8")
    partial.replace(path)


def heights(toolpath: Toolpath) -> dict[str, Any]:
    """The layers' nominal thickness, and the least and the greatest height at a point of a curve, mm."""
    local = np.concatenate([curve.heights for curve in unwrap(toolpath)] or [np.array([toolpath.thickness])])
    return {"thickness_nominal_mm": round(toolpath.thickness, 6), "local_height_mm": span(local)}


def span(values: npt.NDArray[Any], digits: int = 4) -> dict[str, float]:
    """The least and the greatest of values."""
    return {"least": round(float(values.min()), digits), "greatest": round(float(values.max()), digits)}


def summarise(
    program: Program, toolpath: Toolpath, volume: trimesh.Trimesh, findings: list[Finding]
) -> dict[str, Any]:
    """What is known of a job before it is printed."""
    printing = program.of_kind(SegmentKind.PRINT)
    travel = sum(
        float(np.linalg.norm(np.diff(program.positions[s.start : s.stop], axis=0), axis=1).sum())
        for s in program.segments
        if s.kind is not SegmentKind.PRINT
    )
    return {
        "layers": len(toolpath.layers),
        "path_length_m": round(toolpath.length / 1000.0, 4),
        "bead_volume_l": round(program.bead_volume * 1e-6, 6),
        "volume_of_m_prime_l": round(signed_volume(volume) * 1e-6, 6),
        "print_time_s": round(program.duration, 2),
        "starts": sum(s.kind is SegmentKind.PRINT for s in program.segments),
        "travel_length_m": round(travel / 1000.0, 4),
        "local_height_min_mm": round(float(program.height[printing].min()), 4),
        "local_height_max_mm": round(float(program.height[printing].max()), 4),
        "waypoints": len(program),
        "findings": [finding.as_dict() for finding in findings],
        "inputs": program.inputs,
    }
