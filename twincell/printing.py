"""Printing a job: on its cell, or on a simulated one."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

import robot
from robot.simulation import SimulatedCell

from .job import Job
from .report import write_summary
from .stages import checked, planned, refuse

MEASURED = (
    "run_duration_s",
    "deposited_volume_l",
    "travel_volume_l",
    "worst_deviation_mm",
    "share_of_waypoints_passed",
)
"""What `summary.json` says of a run; nothing until it is complete."""


def print_job(
    job: Job, console: Console, *, simulate: bool = False, dry: bool = False, time_scale: float = 1.0
) -> dict[str, Any]:
    """Print a planned job and journal it.

    Args:
        job: with an up-to-date program.
        console: for the progress bar.
        simulate: start a simulated cell at the addresses of the cell file, and end it afterwards.
        dry: move without pumping.
        time_scale: of the simulated cell.

    Returns:
        what was measured; also merged into `summary.json`.

    Raises:
        JobError: the program is stale or has findings that keep it from running.
        RobotError: the cell does not answer, or the print was stopped.
    """
    program, toolpath = planned(job)
    refuse(checked(job, program, toolpath))
    if dry:
        program = replace(program, flow=np.zeros(len(program)))
    with contextlib.ExitStack() as stack:
        if simulate:
            stack.enter_context(SimulatedCell.start(job.cell_file, time_scale=time_scale))
        show = stack.enter_context(_progress(console))

        def progress(state: robot.Progress) -> None:
            if not began:  # a run that never begins leaves the last one's figures
                began.append(True)
                write_summary(
                    job.report,
                    {**dict.fromkeys(MEASURED), "run": "stopped", "simulated": simulate, "dry": dry},
                )
            show(state)

        began: list[bool] = []
        result = robot.run(program, job.cell, job.journal, progress=progress)
    values: dict[str, Any] = {
        "run": "complete",
        "simulated": simulate,
        "dry": dry,
        "run_duration_s": round(result.duration, 2),
        "deposited_volume_l": round(result.deposited_volume * 1e-6, 6),
        "travel_volume_l": round(result.travel_volume * 1e-6, 6),
        "worst_deviation_mm": round(result.worst_deviation, 4),
        "share_of_waypoints_passed": round(result.passed, 4),
    }
    write_summary(job.report, values)
    return values


@contextlib.contextmanager
def _progress(console: Console) -> Iterator[Any]:
    """A progress bar with layer, time left and flow."""
    columns = (
        TextColumn("printing"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[layer]}"),
        TextColumn("{task.fields[left]}"),
        TextColumn("{task.fields[flow]}"),
    )
    with Progress(*columns, console=console, transient=False) as bar:
        task = bar.add_task("printing", total=1.0, layer="", left="", flow="")

        def show(state: robot.Progress) -> None:
            bar.update(
                task,
                completed=state.fraction,
                layer=f"layer {state.layer}/{state.layers}",
                left=f"{state.time_left_s:.0f} s left",
                flow=f"{state.flow:.0f} mm³/s",
            )

        yield show
