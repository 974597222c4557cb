"""The demo: the whole main job on a vault springer at a scale of 1:3."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

from rich.console import Console

from twins import read_surface, save_surface

from .errors import JobError
from .job import load_job
from .printing import print_job
from .program_pictures import draw
from .report import summarise, write_summary
from .springer import springer, springer_top
from .stages import plan_job, refuse
from .structural import NOT_SOLVED, fea_job

SCALE = 1.0 / 3.0
MARK = "# made by twincell demo"


def demo(out: Path, time_scale: float, console: Console) -> None:
    """Slice, plan, check, print on a simulated cell, and export for FEA; everything lands in the job folder `out`.

    Raises:
        JobError: `out` holds something that is not a demo job.
    """
    began = time.monotonic()

    def say(what: str) -> None:
        console.print(
            f"[{time.monotonic() - began:5.1f} s] {what}", highlight=False, markup=False, soft_wrap=True
        )

    _prepare(out)
    job = load_job(out)
    say("slicing and planning")
    program, toolpath, findings = plan_job(job)
    summary = summarise(program, toolpath, read_surface(job.volume), findings)
    write_summary(job.report, summary)
    draw(job.report, program, job.cell)
    say(
        f"{summary['layers']} layers, {summary['path_length_m']:.2f} m, {summary['bead_volume_l']:.3f} L, "
        f"{len(program)} waypoints, {len(findings)} findings"
    )
    for finding in findings:
        say(str(finding))
    refuse(findings)
    say(f"printing on a simulated cell, {time_scale:g} times faster than real")
    printed = print_job(job, console, simulate=True, time_scale=time_scale)
    say(
        f"deposited {printed['deposited_volume_l']:.4f} L, {printed['travel_volume_l']:.5f} L of it on travels; "
        f"{100 * printed['share_of_waypoints_passed']:.1f} % of print waypoints passed within 1 mm"
    )
    fea = fea_job(job, console)
    say(f"FEA model: {fea['elements']} elements in {fea['layers']} layers")
    solved = fea["self_weight"]
    if solved == NOT_SOLVED:
        say(NOT_SOLVED)
    else:
        say(
            f"self-weight solved: {solved['weight_n']:.2f} N, reactions balance to {100 * solved['imbalance']:.2g} %, "
            f"largest displacement {solved['max_displacement_mm']:.3f} mm"
        )
    say(f"the job folder is {out}; pictures in {out / 'report'}")


def _prepare(out: Path) -> None:
    settings = out / "job.toml"
    if settings.exists() and MARK not in settings.read_text(encoding="utf-8", errors="replace"):
        raise JobError(f"{out}: holds another job; choose another folder with --out")
    if out.exists() and not settings.exists() and any(out.iterdir()):
        raise JobError(f"{out}: is not empty and holds no demo; choose another folder with --out")
    if out.exists():
        shutil.rmtree(out)
    out.mkdir(parents=True)
    save_surface(springer(SCALE), out / "part.ply", ["a vault springer, 1:3"])
    top = springer_top(SCALE)
    origin, normal = ([float(f"{v:.12g}") for v in values] for values in (top.origin, top.normal))
    settings.write_text(
        f"""{MARK}: a vault springer at a scale of 1:3, rotary layers
cell = "ur10e-demo"
mix = "fresh-mortar"

[part]
file = "part.ply"

[slicing]
thickness = {10.0 * SCALE:.12g}
top = {{ origin = {origin}, normal = {normal} }}

[print]
width = 8.0
speed = 50.0
approach_speed = 40.0
clearance = 10.0
blend = 1.0

[fea]
edge = 7.0
""",
        encoding="utf-8",
    )
