"""The command line.

Exit codes: 0 done, 1 refused or failed with a reason on stderr, 2 usage.

A command loads what it needs when it runs: everything takes seconds, which `--help` and a misspelt word need not wait.
"""
# ruff: noqa: PLC0415 - see above

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from functools import wraps
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from .choices import (
    Against,
    Exported,
    Planes,
    Side,
    Subdivision,
    Units,
    Up,
)

if TYPE_CHECKING:
    from planning import Finding

app = typer.Typer(
    help="Controller for robot cells that print concrete.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
optimize = typer.Typer(
    help="Optimise a job's part or toolpath; what was there before is kept.", no_args_is_help=True
)
app.add_typer(optimize, name="optimize")
console = Console()
errors = Console(stderr=True)

INTERRUPTED = 130
"""Exit code that the command line library gives a Ctrl-C."""

SHOWN = 12
"""Items of a list that are shown to people."""

SIDES = {Side.IN: 1, Side.OUT: -1, Side.BOTH: 0}

JobFolder = Annotated[Path, typer.Argument(metavar="JOB", help="the job folder")]
Json = Annotated[bool, typer.Option("--json", help="print the result as JSON")]
TimeScale = Annotated[
    float, typer.Option(min=0.1, max=50.0, help="how much faster than real time a simulated cell runs")
]


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"twincell {metadata.version('twincell')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="say the version and exit")
    ] = False,
) -> None:
    pass


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="folder of the demo's job")] = Path("out/demo"),
    time_scale: TimeScale = 8.0,
) -> None:
    """Do the whole main job on a vault springer: slice, plan, check, print on a simulated cell, export for FEA."""
    from .demo import demo as run_demo

    run_demo(out, time_scale, console)


@app.command()
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
    from .new import new_job

    made = new_job(
        part, out, cell=cell, mix=mix, units=None if units is None else units.value, chord=chord,
        subdivide=None if subdivide is None else subdivide.value, levels=levels, longest=longest,
        up=None if up is None else up.value,
        thickness=thickness, width=width, speed=speed,
    )  # fmt: skip
    for sentence in made.repairs:
        console.print(f"repaired: {sentence}", highlight=False, markup=False, soft_wrap=True)
    for doubt in made.doubts:
        errors.print(f"{part}: {doubt}", style="yellow", highlight=False, markup=False, soft_wrap=True)
    console.print(
        f"made {out / 'job.toml'}: {made.size}; next: twincell plan {out}",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )


@app.command("slice")
def slice_(job: JobFolder, as_json: Json = False) -> None:
    """Slice the job's part into a toolpath, with its twin surface M and the printed volume M'."""
    from .job import load_job
    from .report import heights
    from .stages import slice_job

    made = slice_job(load_job(job))
    curves = sum(len(layer.curves) for layer in made.toolpath.layers)
    _result(
        {
            "layers": len(made.toolpath.layers),
            "curves": curves,
            **heights(made.toolpath),
            "path_length_m": round(made.toolpath.length / 1000.0, 4),
        },
        as_json,
    )


@app.command("reconstruct")
def reconstruct_(
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
        errors.print(f"{toolpath}: {remark}", highlight=False, markup=False, soft_wrap=True)
    write_surface(mesh.surface, out)
    console.print(
        f"wrote {out}: {len(mesh.surface.faces)} triangles", highlight=False, markup=False, soft_wrap=True
    )


@app.command()
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
    from .errors import JobError
    from .overhang_pictures import draw_overhangs
    from .overhangs import overhangs_of

    if not out.parent.is_dir():
        raise JobError(f"{out}: there is no folder {out.parent}; make it, or name another file with -o")
    schemes = overhangs_of(sources, reference.value, limit)
    draw_overhangs(schemes, out)
    _result({scheme.name: scheme.as_dict() for scheme in schemes}, as_json)
    if not as_json:
        console.print(f"wrote {out}", highlight=False, markup=False, soft_wrap=True)


@optimize.command("surface")
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
    from .job import load_job
    from .optimizing import optimize_surface

    with console.status("relaxing the overhang") as status:
        values = optimize_surface(
            load_job(job), limit_deg=limit, reference=None if by is None else by.value, strength=strength,
            lock_below=lock_below, lock_above=lock_above, lock_sides=lock_sides, both=both,
            progress=lambda share: status.update(f"relaxing the overhang: {100 * share:.0f} %"),
        )  # fmt: skip
    _result(values, as_json)


@optimize.command("toolpath")
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
    from .job import load_job
    from .optimizing import optimize_toolpath

    with console.status("slicing") as status:
        values = optimize_toolpath(
            load_job(job), min_distance=min_distance, min_radius=min_radius, side=SIDES[side], protect=protect or [],
            progress=lambda what, share: status.update(f"{what}: {100 * share:.0f} %"),
        )  # fmt: skip
    _result(values, as_json)


@app.command("plan")
def plan_(job: JobFolder, as_json: Json = False) -> None:
    """Plan the job into waypoints with pump flow; slices it first where that is missing or stale."""
    from twins import read_surface

    from .job import load_job
    from .program_pictures import draw
    from .report import summarise, write_summary
    from .stages import plan_job

    loaded = load_job(job)
    program, toolpath, findings = plan_job(loaded)
    summary = summarise(program, toolpath, read_surface(loaded.volume), findings)
    write_summary(loaded.report, summary, anew=True)
    draw(loaded.report, program, loaded.cell)
    keys = ("layers", "path_length_m", "bead_volume_l", "print_time_s", "starts", "waypoints")
    local = {"least": summary["local_height_min_mm"], "greatest": summary["local_height_max_mm"]}
    _result({**{key: summary[key] for key in keys}, "local_height_mm": local}, as_json, findings)


@app.command("check")
def check_(job: JobFolder, as_json: Json = False) -> None:
    """Say what would go wrong if the job's program were printed."""
    from .job import load_job
    from .stages import checked, planned

    loaded = load_job(job)
    program, toolpath = planned(loaded)
    _result({"waypoints": len(program)}, as_json, checked(loaded, program, toolpath))


@app.command("run")
def run_(
    job: JobFolder,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="print on a simulated cell started for it")
    ] = False,
    dry: Annotated[bool, typer.Option("--dry", help="move without pumping")] = False,
    time_scale: TimeScale = 1.0,
    as_json: Json = False,
) -> None:
    """Print the job on its cell."""
    from .job import load_job
    from .printing import print_job

    result = print_job(
        load_job(job), errors if as_json else console, simulate=simulate, dry=dry, time_scale=time_scale
    )
    _result(result, as_json)


@app.command("simulate")
def simulate_(
    cell: Annotated[
        str, typer.Option("--cell", help="a shipped cell or the path of a cell file")
    ] = "ur10e-demo",
    host: Annotated[str | None, typer.Option(help="loopback address; default: as the cell file says")] = None,
    time_scale: TimeScale = 1.0,
    version: Annotated[
        str, typer.Option(metavar="NUMBERS", help="PolyScope version that the robot says it is: 5.12, 3.15")
    ] = "5.12",
    start_delay: Annotated[
        float, typer.Option(min=0.0, max=0.5, metavar="SECONDS", help="until a program that was sent starts")
    ] = 0.02,
    power_delay: Annotated[
        float, typer.Option(min=0.0, max=3600.0, metavar="SECONDS", help="of each step of powering on")
    ] = 0.0,
    protective_stop_delay: Annotated[
        float,
        typer.Option(
            min=0.0, max=3600.0, metavar="SECONDS", help="until a protective stop can be unlocked; really 5"
        ),
    ] = 0.0,
    local_control: Annotated[
        bool, typer.Option("--local-control", help="the robot is in local, not in remote control")
    ] = False,
    programs: Annotated[
        Path | None,
        typer.Option(metavar="DIR", exists=True, file_okay=False, help="programs that the dashboard loads"),
    ] = None,
    trip: Annotated[
        float,
        typer.Option(
            min=0.0, max=3600.0, metavar="SECONDS", help="of silence until the pump's drive trips; 0: never"
        ),
    ] = 0.5,
    reply_delay: Annotated[
        float, typer.Option(min=0.0, max=3600.0, metavar="SECONDS", help="until the pump answers")
    ] = 0.0,
    reply_jitter: Annotated[
        float, typer.Option(min=0.0, max=3600.0, metavar="SECONDS", help="that its answer may take more")
    ] = 0.0,
    seed: Annotated[int, typer.Option(help="of the chance in --reply-jitter")] = 0,
    ramp: Annotated[
        float, typer.Option(min=0.0, max=3600.0, metavar="SECONDS", help="from rest to the largest flow")
    ] = 0.0,
    hopper: Annotated[
        float, typer.Option(min=0.0, metavar="MM3", help="what the pump's hopper holds; inf: never empty")
    ] = float("inf"),
    pressure_limit: Annotated[
        float, typer.Option(min=0.0, metavar="BAR", help="beyond which the drive trips; inf: never")
    ] = 40.0,
    current_limit: Annotated[
        float, typer.Option(min=0.0, metavar="A", help="beyond which the drive trips; inf: never")
    ] = 12.0,
    script: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", exists=True, dir_okay=False, help="TOML file of faults and when they come"
        ),
    ] = None,
    faults_seed: Annotated[
        int | None,
        typer.Option(help="let faults come by chance with this seed: the file's, or a choice of all"),
    ] = None,
    trace: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            file_okay=False,
            help="write what robot and pump do, and in the end what lies where",
        ),
    ] = None,
) -> None:
    """Start a simulated UR controller and a simulated pump; Ctrl-C ends them."""
    from .simulating import simulate_cell

    simulate_cell(
        cell,
        console,
        host=host,
        time_scale=time_scale,
        version=version,
        start_delay=start_delay,
        power_delay=power_delay,
        protective_stop_delay=protective_stop_delay,
        local_control=local_control,
        programs=programs,
        trip=trip,
        reply_delay=reply_delay,
        reply_jitter=reply_jitter,
        seed=seed,
        ramp=ramp,
        hopper=hopper,
        pressure_limit=pressure_limit,
        current_limit=current_limit,
        script=script,
        faults_seed=faults_seed,
        trace=trace,
    )


@app.command("fea")
def fea_(job: JobFolder, as_json: Json = False) -> None:
    """Mesh the printed volume, export it by layers, and solve it under its own weight."""
    from .job import load_job
    from .structural import fea_job

    _result(fea_job(load_job(job), errors if as_json else console), as_json)


@app.command("wrap")
def wrap_(
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
    from .exchanging import wrap_curves

    values = wrap_curves(
        files, out, at=at.value, units=None if units is None else units.value, thickness=thickness,
        close_within=close_within, tolerance=tolerance, chord=chord, up=up.value, bed=bed, z=z or (),
    )  # fmt: skip
    _result(values, as_json)
    for remark in values["remarks"]:
        errors.print(f"{out}: {remark}", style="yellow", highlight=False, markup=False, soft_wrap=True)


@app.command("export")
def export_(
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
    from .exchanging import export_job
    from .job import load_job

    _result(export_job(load_job(job), out, None if what is None else what.value, at.value), as_json)


@app.command("gcode")
def gcode_(
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
    from .job import load_job
    from .scaled_model import gcode_job

    _result(gcode_job(load_job(job), scale, printer, width, out), as_json)


def _saying_that_it_compiles(command: Callable[..., None]) -> Callable[..., None]:
    @wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        from .compiling import compiling_said

        def say(sentence: str) -> None:
            errors.print(sentence, highlight=False, markup=False, soft_wrap=True)

        with compiling_said(say):
            command(*args, **kwargs)

    return run


for _info in (*app.registered_commands, *optimize.registered_commands):
    # A simulated cell computes nothing, and should not load the compiler for this.
    if _info.callback is not None and _info.callback is not simulate_:
        _info.callback = _saying_that_it_compiles(_info.callback)


def _result(values: dict[str, Any], as_json: bool, findings: list[Finding] | None = None) -> None:
    """Show a result; exit 1 if a finding keeps the job from running."""
    refused = any(finding.severity == "error" for finding in findings or [])
    if as_json:
        extra = {} if findings is None else {"findings": [finding.as_dict() for finding in findings]}
        sys.stdout.write(json.dumps({**values, **extra}) + "\n")
    else:
        for key, value in _flat(values):
            console.print(f"{key:28} {value}", highlight=False, markup=False, soft_wrap=True)
        for finding in findings or []:
            style = "red" if finding.severity == "error" else "yellow"
            console.print(str(finding), style=style, highlight=False, markup=False, soft_wrap=True)
        if findings is not None and not findings:
            console.print("no findings", highlight=False, markup=False, soft_wrap=True)
    if refused:
        raise typer.Exit(1)


def _flat(values: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Values for people: nested ones one a line, numbers and lists short, what is empty and hashes left out."""
    for key, value in values.items():
        if key in {"inputs", "remarks"} or value == []:
            continue
        if isinstance(value, dict) and value.keys() == {"least", "greatest"}:
            least, greatest = (f"{value[end] + 0.0:.6g}" for end in ("least", "greatest"))
            yield key, least if least == greatest else f"{least} to {greatest}"
        elif isinstance(value, dict):
            yield from ((f"{key}: {inner}", text) for inner, text in _flat(value))
        elif isinstance(value, list):
            some = value if len(value) <= SHOWN else [*value[:SHOWN], f"… ({len(value)} in all)"]
            yield key, ", ".join(map(str, some))
        else:
            # 0.0 is added so that no zero is negative.
            yield key, f"{value + 0.0:.6g}" if isinstance(value, float) else str(value)


def _refusals() -> tuple[type[Exception], ...]:
    """What the packages refuse with. One that is not loaded has refused nothing, and is not loaded for this."""
    bases = {
        "twins.errors": "TwinsError",
        "planning.errors": "PlanningError",
        "robot.errors": "RobotError",
        "analysis.errors": "AnalysisError",
        "twincell.errors": "JobError",
    }
    return tuple(getattr(sys.modules[home], name) for home, name in bases.items() if home in sys.modules)


def _options_of(command: Any) -> set[str]:
    """All options of a command and those below it."""
    below = (_options_of(child) for child in getattr(command, "commands", {}).values())
    return {option for parameter in command.params for option in parameter.opts}.union(*below)


def main() -> None:
    """Run the command line; expected errors are one sentence on stderr and exit code 1."""
    try:
        app()
    except SystemExit as ended:
        if ended.code != INTERRUPTED:
            raise
        errors.print("stopped by Ctrl-C", highlight=False, markup=False, soft_wrap=True)
        raise SystemExit(1) from None
    except _refusals() as error:
        from .wording import as_options

        sentence = as_options(str(error), _options_of(typer.main.get_command(app)))
        errors.print(sentence, style="red", highlight=False, markup=False, soft_wrap=True)
        raise SystemExit(1) from None
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        errors.print(
            f"{where}cannot be read or written ({error.strerror or error}); check the path",
            style="red",
            highlight=False,
            markup=False,
            soft_wrap=True,
        )
        raise SystemExit(1) from None
