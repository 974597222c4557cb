"""What several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from robot.simulation.clock import FASTEST, SLOWEST

JobFolder = Annotated[Path, typer.Argument(metavar="JOB", help="the job folder")]
Json = Annotated[bool, typer.Option("--json", help="print the result as JSON")]
TimeScale = Annotated[
    float, typer.Option(min=SLOWEST, max=FASTEST, help="how much faster than real time a simulated cell runs")
]
# What a pump may take to answer is wall time: for one that is slower than real it would be too little.
DryRunScale = Annotated[
    float, typer.Option(min=1.0, max=FASTEST, help="how much faster than real time a simulated cell runs")
]
