"""Commands that measure a part's or toolpath's shape, rebuild it or change it."""
# ruff: noqa: PLC0415 - a command loads what it needs when it runs

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twincell.choices import Against, Side
from twincell.showing import console, errors, say, show_result

from .arguments import JobFolder, Json

SIDES = {Side.IN: 1, Side.OUT: -1, Side.BOTH: 0}


def reconstruct(
    toolpath: Annotated[Path, typer.Argument(help="a toolpath.json")],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="the file to write: STL, PLY, OBJ, 3MF, 3DM, GLB or glTF")
    ] = Path("surface.ply"),
) -> None:
    """Turn a toolpath back into its surface M."""
    from twins import TwinsError, load_toolpath, toolpath_mesh, write_surface

    try:
        mesh = toolpath_mesh(load_toolpath(toolpath))
    except TwinsError as error:
        text = str(error)
        raise type(error)(text if text.startswith(str(toolpath)) else f"{toolpath}: {text}") from None
    for remark in mesh.remarks:
        say(f"{toolpath}: {remark}", on=errors)
    write_surface(mesh.surface, out)
    say(f"wrote {out}: {len(mesh.surface.faces)} triangles")


def overhang(
    sources: Annotated[
        list[Path], typer.Argument(metavar="JOB|TOOLPATH|MESH…", help="what to measure, one or several")
    ],
    reference: Annotated[
        Against, typer.Option(help="down to the layer below, or square to it")
    ] = Against.GROUND,
    limit: Annotated[float | None, typer.Option(help="of d/t; by default that of the job's mix")] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="the PNG file to write")] = Path("overhang.png"),
    as_json: Json = False,
) -> None:
    """Measure local overhang d/t: distance from the layer below over layer height; draw how it is distributed."""
    from twincell.errors import JobError
    from twincell.overhang_pictures import draw_overhangs
    from twincell.overhangs import overhangs_of

    if not out.parent.is_dir():
        raise JobError(f"{out}: there is no folder {out.parent}; make it, or name another file with -o")
    schemes = overhangs_of(sources, reference.value, limit)
    draw_overhangs(schemes, out)
    show_result({scheme.name: scheme.as_dict() for scheme in schemes}, as_json)
    if not as_json:
        say(f"wrote {out}")


def optimize_surface_(
    job: JobFolder,
    limit: Annotated[
        float | None, typer.Option(metavar="DEG", help="greatest angle of overhang; by default the mix's")
    ] = None,
    by: Annotated[
        Against | None,
        typer.Option(help="against gravity, or against the layers; by default what the mix limits"),
    ] = None,
    strength: Annotated[float, typer.Option(help="weight of the limit against the shape")] = 10.0,
    lock_below: Annotated[float, typer.Option(metavar="MM", help="what is at most so high stays")] = 0.0,
    lock_above: Annotated[
        float | None, typer.Option(metavar="MM", help="what is at least so high stays")
    ] = None,
    lock_sides: Annotated[bool, typer.Option(help="what is on the bounding box's sides stays")] = False,
    both: Annotated[bool, typer.Option(help="count what leans inwards, too")] = False,
    as_json: Json = False,
) -> None:
    """Deform the job's part until no face leans beyond a limit."""
    from twincell.job import load_job
    from twincell.optimizing import optimize_surface

    with console.status("relaxing the overhang") as status:
        values = optimize_surface(
            load_job(job), limit_deg=limit, reference=None if by is None else by.value, strength=strength,
            lock_below=lock_below, lock_above=lock_above, lock_sides=lock_sides, both=both,
            progress=lambda share: status.update(f"relaxing the overhang: {100 * share:.0f} %"),
        )  # fmt: skip
    show_result(values, as_json)


def optimize_toolpath_(
    job: JobFolder,
    min_distance: Annotated[
        float | None,
        typer.Option(metavar="MM", help="between the middles of beads; default the width; 0: leave"),
    ] = None,
    min_radius: Annotated[
        float | None, typer.Option(metavar="MM", help="of turns; default half the width; 0: leave")
    ] = None,
    side: Annotated[Side, typer.Option(help="to which side rounding may move curves")] = Side.IN,
    protect: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="a closed mesh, or [[[u, v], …], …] in JSON, in which it stays"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Move apart runs of the toolpath that are too close, and round what is bent too sharply."""
    from twincell.job import load_job
    from twincell.optimizing import optimize_toolpath

    with console.status("slicing") as status:
        values = optimize_toolpath(
            load_job(job), min_distance=min_distance, min_radius=min_radius, side=SIDES[side], protect=protect or [],
            progress=lambda what, share: status.update(f"{what}: {100 * share:.0f} %"),
        )  # fmt: skip
    show_result(values, as_json)
