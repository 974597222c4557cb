"""The command that keeps a simulated cell running, and how that cell may be set."""
# ruff: noqa: PLC0415 - a command loads what it needs when it runs

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from twincell.showing import console

from .arguments import TimeScale


def _seconds(text: str) -> Any:
    """An option that is a duration."""
    return typer.Option(min=0.0, max=3600.0, metavar="SECONDS", help=text)


def simulate(
    cell: Annotated[
        str, typer.Option("--cell", help="a shipped cell or the path of a cell file")
    ] = "ur10e-demo",
    host: Annotated[str | None, typer.Option(help="loopback address; default: as the cell file says")] = None,
    time_scale: TimeScale = 1.0,
    version: Annotated[
        str,
        typer.Option(metavar="NUMBERS", help="PolyScope version that the robot says it is: 5.12, 5.22, 3.15"),
    ] = "5.12",
    start_delay: Annotated[
        float, typer.Option(min=0.0, max=0.5, metavar="SECONDS", help="until a program that was sent starts")
    ] = 0.02,
    power_delay: Annotated[float, _seconds("of each step of powering on")] = 0.0,
    protective_stop_delay: Annotated[
        float, _seconds("until a protective stop can be unlocked; really 5")
    ] = 0.0,
    local_control: Annotated[
        bool, typer.Option("--local-control", help="the robot is in local, not in remote control")
    ] = False,
    programs: Annotated[
        Path | None,
        typer.Option(metavar="DIR", exists=True, file_okay=False, help="programs that the dashboard loads"),
    ] = None,
    trip: Annotated[float, _seconds("of silence until the pump's drive trips; 0: never")] = 0.5,
    reply_delay: Annotated[float, _seconds("until the pump answers")] = 0.0,
    reply_jitter: Annotated[float, _seconds("that its answer may take more")] = 0.0,
    seed: Annotated[int, typer.Option(help="of the chance in --reply-jitter")] = 0,
    ramp: Annotated[float, _seconds("from rest to the largest flow")] = 0.0,
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
    from twincell.simulating import simulate_cell

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
