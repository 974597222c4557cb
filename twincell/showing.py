"""How the command line speaks: to people on the console, to programs as JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console

if TYPE_CHECKING:
    from planning import Finding

console = Console()
errors = Console(stderr=True)
"""For what is not the result."""

SHOWN = 12
"""Items of a list that are shown to people."""


def say(sentence: str, *, style: str | None = None, on: Console = console) -> None:
    """Print a sentence as it stands: nothing in it is markup, and it is not broken into lines."""
    on.print(sentence, style=style, highlight=False, markup=False, soft_wrap=True)


def show_result(values: dict[str, Any], as_json: bool, findings: list[Finding] | None = None) -> None:
    """Show a result; exit 1 if a finding keeps the job from running."""
    refused = any(finding.severity == "error" for finding in findings or [])
    if as_json:
        extra = {} if findings is None else {"findings": [finding.as_dict() for finding in findings]}
        sys.stdout.write(json.dumps({**values, **extra}) + "\n")
    else:
        for key, value in _flat(values):
            say(f"{key:28} {value}")
        for finding in findings or []:
            style = "red" if finding.severity == "error" else "yellow"
            say(str(finding), style=style)
        if findings is not None and not findings:
            say("no findings")
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
