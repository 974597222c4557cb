"""The command line: its commands by name, and how it ends.

Exit codes: 0 done, 1 refused or failed with a reason on stderr, 2 usage.

A command loads what it needs when it runs: everything takes seconds, which `--help` and a misspelt word need not wait.
"""
# ruff: noqa: PLC0415 - see above

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial, wraps
from importlib import metadata
from typing import Annotated, Any

import typer

from .commands import exchange, jobs, shapes, simulated_cell
from .showing import errors, say

INTERRUPTED = 130
"""Exit code that the command line library gives a Ctrl-C."""

_COMMANDS: dict[str, Callable[..., None]] = {
    "demo": jobs.demo,
    "new": jobs.new,
    "slice": jobs.slice_,
    "reconstruct": shapes.reconstruct,
    "overhang": shapes.overhang,
    "plan": jobs.plan,
    "check": jobs.check,
    "run": jobs.run,
    "simulate": simulated_cell.simulate,
    "fea": jobs.fea,
    "wrap": exchange.wrap,
    "export": exchange.export,
    "gcode": exchange.gcode,
}
"""In the order of `--help`."""

_OPTIMIZERS: dict[str, Callable[..., None]] = {
    "surface": shapes.optimize_surface_,
    "toolpath": shapes.optimize_toolpath_,
}

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


def _saying_that_it_compiles(command: Callable[..., None]) -> Callable[..., None]:
    @wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        from .compiling import compiling_said

        with compiling_said(partial(say, on=errors)):
            command(*args, **kwargs)

    return run


for _name, _command in _COMMANDS.items():
    # A simulated cell computes nothing, and should not load the compiler for this.
    app.command(_name)(_command if _name == "simulate" else _saying_that_it_compiles(_command))
for _name, _command in _OPTIMIZERS.items():
    optimize.command(_name)(_saying_that_it_compiles(_command))


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
        say("stopped by Ctrl-C", on=errors)
        raise SystemExit(1) from None
    except _refusals() as error:
        from .wording import as_options

        sentence = as_options(str(error), _options_of(typer.main.get_command(app)))
        say(sentence, style="red", on=errors)
        raise SystemExit(1) from None
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        say(
            f"{where}cannot be read or written ({error.strerror or error}); check the path",
            style="red",
            on=errors,
        )
        raise SystemExit(1) from None
