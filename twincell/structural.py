"""The finite element model of a job."""

from __future__ import annotations

import json
import shutil
from typing import Any

import numpy as np
from rich.console import Console

from analysis import SolverMissing, export_fea, solve
from twins import inputs_of, read_surface

from .job import Job
from .stages import sliced

NOT_SOLVED = "not solved: ccx is not installed"


def fea_job(job: Job, console: Console) -> dict[str, Any]:
    """Mesh M', write `fea/`, and solve the self-weight case where CalculiX is installed.

    The folder appears whole: a failed export leaves the one before it.

    Raises:
        AnalysisError: meshing or solving failed.
    """
    toolpath = sliced(job)
    volume = read_surface(job.volume)
    partial = job.folder / "fea.partial"
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    try:
        with console.status("meshing the printed volume") as status:
            report = export_fea(
                volume,
                toolpath,
                job.mix,
                job.settings.fea,
                partial,
                progress=status.update,
            )
            values = report.as_dict()
            try:
                status.update("solving self-weight")
                result = solve(report.deck, time_limit_s=job.settings.fea.time_limit_s)
                values["self_weight"] = {
                    "max_displacement_mm": round(result.max_displacement, 4),
                    "max_von_mises_mpa": round(result.max_von_mises, 6),
                    "weight_n": round(float(np.linalg.norm(result.weight)), 4),
                    "imbalance": round(result.imbalance, 8),
                }
            except SolverMissing:
                values["self_weight"] = NOT_SOLVED
        values["inputs"] = inputs_of(job.volume)
        (partial / "fea.json").write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")
        if job.fea.exists():
            shutil.rmtree(job.fea)
        partial.replace(job.fea)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return values
