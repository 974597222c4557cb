"""Commands that make a job, plan it, print it and solve it."""
# ruff: noqa: PLC0415 - a command loads what it needs when it runs

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twincell.choices import Subdivision, Units, Up
from twincell.showing import console, errors, say, show_result

from .arguments import DryRunScale, JobFolder, Json


def demo(
    out: Annotated[Path, typer.Option(help="folder of the demo's job")] = Path("out/demo"),
    time_scale: DryRunScale = 8.0,
) -> None:
    """Do the whole main job on a vault springer: slice, plan, check, print on a simulated cell, export for FEA."""
    from twincell.demo import demo as run_demo

    run_demo(out, time_scale, console)


def new(
    part: Annotated[
        Path, typer.Argument(help="STL, PLY, OBJ, 3MF, STEP, 3DM, GLB or glTF; or a toolpath.json")
    ],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="JOB", help="the job folder to make")],
    cell: Annotated[
        str, typer.Option("--cell", help="a shipped cell or the path of a cell file")
    ] = "ur10e-demo",
    mix: Annotated[
        str, typer.Option("--mix", help="a shipped mix or the path of a mix file")
    ] = "fresh-mortar",
    units: Annotated[
        Units | None, typer.Option(help="unit of a part file that does not say its own; default mm")
    ] = None,
    chord: Annotated[
        float, typer.Option(metavar="MM", help="how far the mesh may be from smooth surfaces")
    ] = 0.1,
    subdivide: Annotated[
        Subdivision | None, typer.Option(help="the file holds the control mesh of such a surface")
    ] = None,
    levels: Annotated[int, typer.Option(help="of subdivision")] = 2,
    longest: Annotated[
        float | None, typer.Option(metavar="MM", help="scale the longest side to this")
    ] = None,
    up: Annotated[
        Up | None, typer.Option(help="axis of the file that points up; default z, and y of GLB and glTF")
    ] = None,
    thickness: Annotated[float, typer.Option(min=0.1, help="layer thickness, mm")] = 10.0,
    width: Annotated[float, typer.Option(min=0.1, help="bead width, mm")] = 20.0,
    speed: Annotated[float, typer.Option(min=0.1, help="print speed, mm/s")] = 80.0,
) -> None:
    """Make a job folder with a commented job.toml from a part file or a toolpath."""
    from twincell.new import new_job

    made = new_job(
        part, out, cell=cell, mix=mix, units=None if units is None else units.value, chord=chord,
        subdivide=None if subdivide is None else subdivide.value, levels=levels, longest=longest,
        up=None if up is None else up.value,
        thickness=thickness, width=width, speed=speed,
    )  # fmt: skip
    for sentence in made.repairs:
        say(f"repaired: {sentence}")
    for doubt in made.doubts:
        say(f"{part}: {doubt}", style="yellow", on=errors)
    say(f"made {out / 'job.toml'}: {made.size}; next: twincell plan {out}")


def slice_(job: JobFolder, as_json: Json = False) -> None:
    """Slice the job's part into a toolpath, with its twin surface M and the printed volume M'."""
    from twincell.job import load_job
    from twincell.report import heights
    from twincell.stages import slice_job

    made = slice_job(load_job(job))
    curves = sum(len(layer.curves) for layer in made.toolpath.layers)
    show_result(
        {
            "layers": len(made.toolpath.layers),
            "curves": curves,
            **heights(made.toolpath),
            "path_length_m": round(made.toolpath.length / 1000.0, 4),
        },
        as_json,
    )


def plan(job: JobFolder, as_json: Json = False) -> None:
    """Plan the job into waypoints with pump flow; slices it first where that is missing or stale."""
    from twincell.job import load_job
    from twincell.program_pictures import draw
    from twincell.report import summarise, write_summary
    from twincell.stages import plan_job
    from twins import read_surface

    loaded = load_job(job)
    program, toolpath, findings = plan_job(loaded)
    summary = summarise(program, toolpath, read_surface(loaded.volume), findings)
    write_summary(loaded.report, summary, anew=True)
    draw(loaded.report, program, loaded.cell)
    keys = ("layers", "path_length_m", "bead_volume_l", "print_time_s", "starts", "waypoints")
    local = {"least": summary["local_height_min_mm"], "greatest": summary["local_height_max_mm"]}
    show_result({**{key: summary[key] for key in keys}, "local_height_mm": local}, as_json, findings)


def check(job: JobFolder, as_json: Json = False) -> None:
    """Say what would go wrong if the job's program were printed."""
    from twincell.job import load_job
    from twincell.stages import checked, planned

    loaded = load_job(job)
    program, toolpath = planned(loaded)
    show_result({"waypoints": len(program)}, as_json, checked(loaded, program, toolpath))


def run(
    job: JobFolder,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="print on a simulated cell started for it")
    ] = False,
    dry: Annotated[bool, typer.Option("--dry", help="move without pumping")] = False,
    time_scale: DryRunScale = 1.0,
    as_json: Json = False,
) -> None:
    """Print the job on its cell."""
    from twincell.job import load_job
    from twincell.printing import print_job

    result = print_job(
        load_job(job), errors if as_json else console, simulate=simulate, dry=dry, time_scale=time_scale
    )
    show_result(result, as_json)


def fea(job: JobFolder, as_json: Json = False) -> None:
    """Mesh the printed volume, export it by layers, and solve it under its own weight."""
    from twincell.job import load_job
    from twincell.structural import fea_job

    show_result(fea_job(load_job(job), errors if as_json else console), as_json)
