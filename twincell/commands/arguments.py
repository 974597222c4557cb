"""What several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

JobFolder = Annotated[Path, typer.Argument(metavar="JOB", help="the job folder")]
Json = Annotated[bool, typer.Option("--json", help="print the result as JSON")]
TimeScale = Annotated[
    float, typer.Option(min=0.1, max=50.0, help="how much faster than real time a simulated cell runs")
]
