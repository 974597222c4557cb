"""Printing: a program becomes a part."""

from __future__ import annotations

import asyncio
import contextlib
import gc
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from planning import Cell, Program

from .chunks import Chunk, split
from .errors import JournalError
from .evaluation import evaluate
from .journal import Journal, read_samples
from .supervisor import Progress, Supervisor


@dataclass(frozen=True)
class RunResult:
    """What a finished print became.

    Attributes:
        run: its id in the journal.
        duration: process time, s.
        deposited_volume: volume that left the nozzle, mm³.
        travel_volume: the part of it that left outside of beads, mm³.
        worst_deviation: largest distance of the tool from the planned path in beads, mm.
        passed: share of the beads' waypoints that the tool passed within 1 mm.
        chunks: number of chunks executed.
    """

    run: int
    duration: float
    deposited_volume: float
    travel_volume: float
    worst_deviation: float
    passed: float
    chunks: int


def run(
    program: Program, cell: Cell, journal: Path, *, progress: Callable[[Progress], None] | None = None
) -> RunResult:
    """Print a program on a cell.

    Args:
        program: what to print; the arm first moves its joints straight to its first waypoint.
        cell: where; its addresses may be those of a real cell or of a simulated one.
        journal: file to record it in; continued when it exists.
        progress: called about ten times per second.

    Raises:
        ArmError: the program cannot be executed, or the arm process failed.
        CellUnreachable: robot or pump do not answer.
        PumpError: the pump fails or stops answering.
        StoppedError: the guard or the operator stopped the print.
        JournalError: the journal cannot be written.
        planning.ConfigurationError: the pump's register map is missing or wrong.
    """
    chunks = split(program)
    with Journal(journal, {"cell": cell.name, "inputs": program.inputs, "waypoints": len(program)}) as record:
        record.event("start", f"print of {len(program)} waypoints in {len(chunks)} chunks on {cell.name}")
        try:
            with _steady_memory():
                asyncio.run(_supervise(program, chunks, cell, record, progress))
        except BaseException as error:
            with contextlib.suppress(JournalError):
                record.event("error", str(error), error=type(error).__name__)
            raise
        record.event("end", "the print is complete")
    figures = evaluate(program, read_samples(journal, record.run))
    return RunResult(
        run=record.run,
        duration=figures.duration,
        deposited_volume=figures.deposited_volume,
        travel_volume=figures.travel_volume,
        worst_deviation=figures.worst_deviation,
        passed=figures.passed,
        chunks=len(chunks),
    )


async def _supervise(
    program: Program,
    chunks: tuple[Chunk, ...],
    cell: Cell,
    journal: Journal,
    progress: Callable[[Progress], None] | None,
) -> None:
    await Supervisor(
        program, chunks, cell, journal, progress
    ).run()  # made inside the loop that it belongs to


@contextlib.contextmanager
def _steady_memory() -> Iterator[None]:
    """Keep what exists out of garbage collection: a full one takes 0.1 s, as long as the guard waits for a word."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
