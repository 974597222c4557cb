"""Commands that read and write the formats of designers and desktop printers."""
# ruff: noqa: PLC0415 - a command loads what it needs when it runs

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twincell.choices import Exported, Planes, Units, Up
from twincell.showing import errors, say, show_result

from .arguments import JobFolder, Json


def wrap(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE…", help="curves in DXF, SVG, 3DM, JSON or CSV")
    ],
    at: Annotated[
        Planes,
        typer.Option(help="where the curves are: in the nozzle's planes, or sections halfway up layers"),
    ] = Planes.NOZZLE,
    bed: Annotated[
        float | None, typer.Option(metavar="Z", help="height of the bed in the files; default as they tell")
    ] = None,
    z: Annotated[
        list[float] | None,
        typer.Option("--z", metavar="MM", help="height of each SVG without data-z, in order"),
    ] = None,
    units: Annotated[Units | None, typer.Option(help="of files that do not say theirs")] = None,
    thickness: Annotated[
        float | None, typer.Option(metavar="MM", help="of the first layer; default that of the second")
    ] = None,
    close_within: Annotated[
        float | None, typer.Option(metavar="MM", help="close open curves whose ends are as near as this")
    ] = None,
    tolerance: Annotated[
        float | None, typer.Option(metavar="MM", help="how far a point may be off its layer's plane")
    ] = None,
    chord: Annotated[
        float, typer.Option(metavar="MM", help="how far polylines may be from arcs and splines")
    ] = 0.05,
    up: Annotated[Up, typer.Option(help="the axis along which layers follow one another")] = Up.Z,
    out: Annotated[Path, typer.Option("-o", "--out", help="the toolpath to write")] = Path("toolpath.json"),
    as_json: Json = False,
) -> None:
    """Put curves in layers, parallel, fanned or freely tilted, and write them as a toolpath."""
    from twincell.exchanging import wrap_curves

    values = wrap_curves(
        files, out, at=at.value, units=None if units is None else units.value, thickness=thickness,
        close_within=close_within, tolerance=tolerance, chord=chord, up=up.value, bed=bed, z=z or (),
    )  # fmt: skip
    show_result(values, as_json)
    for remark in values["remarks"]:
        say(f"{out}: {remark}", style="yellow", on=errors)


def export(
    job: JobFolder,
    out: Annotated[
        Path, typer.Option("-o", "--out", help="DXF, 3DM, JSON, CSV; STL, PLY, OBJ, 3MF, 3DM, GLB, glTF")
    ],
    what: Annotated[
        Exported | None, typer.Option(help="default curves, or M where the format holds surfaces")
    ] = None,
    at: Annotated[Planes, typer.Option(help="the planes that curves are written in")] = Planes.NOZZLE,
    as_json: Json = False,
) -> None:
    """Write the job's curves, its surface M, the volume M' or its beads in a designer's format."""
    from twincell.exchanging import export_job
    from twincell.job import load_job

    show_result(export_job(load_job(job), out, None if what is None else what.value, at.value), as_json)


def gcode(
    job: JobFolder,
    scale: Annotated[float, typer.Option(metavar="N", help="of the model, 1:N")] = 12.5,
    printer: Annotated[str, typer.Option(help="a shipped desktop printer or the path of a file")] = "cr10",
    width: Annotated[
        float | None, typer.Option(metavar="MM", help="of the bead at full size; default the job's")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="the file to write; default model.gcode in the job")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write the job's toolpath as G-code of a scaled model for a desktop printer."""
    from twincell.job import load_job
    from twincell.scaled_model import gcode_job

    show_result(gcode_job(load_job(job), scale, printer, width, out), as_json)
