"""Where on its path the tool is: a measured position becomes a place on the chunk being run.

A place only moves forward, and only as far as the tool can have come since it was last seen. That keeps a path
that crosses or returns to itself apart, which the nearest point alone would not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planning import Program

from .chunks import Chunk

Array = npt.NDArray[np.float64]

STRIDE = 3.0
"""How far a place may move along the path for each mm that the tool has moved; above 1 because blends cut corners."""

SLACK = 1.0
"""Added to it, mm; measured positions are not exact."""


@dataclass(frozen=True)
class Place:
    """A place on a chunk's path.

    Attributes:
        move: index of the move in the chunk.
        fraction: how much of the move is done, 0 to 1.
        travelled: length along the path from the start of the chunk, mm.
        offset: distance of the measured position from it, mm.
    """

    move: int
    fraction: float
    travelled: float
    offset: float


class Tracker:
    """Follows the tool along one chunk.

    Args:
        program: the program.
        chunk: one of its chunks, with at least one move.
    """

    def __init__(self, program: Program, chunk: Chunk) -> None:
        self._start = program.positions[chunk.target - 1]
        self._way = program.positions[chunk.target] - self._start
        self._square = np.maximum((self._way**2).sum(axis=1), 1e-18)
        self._along = np.concatenate([[0.0], np.cumsum(np.sqrt((self._way**2).sum(axis=1)))])
        self._slack = SLACK + 2.0 * float(chunk.blend.max(initial=0.0))
        self._last: Array | None = None
        self.place = Place(0, 0.0, 0.0, 0.0)

    @property
    def length(self) -> float:
        """Length of the chunk's path, mm."""
        return float(self._along[-1])

    def update(self, position: Array) -> Place:
        """The place of a measured position, shape (3,), mm."""
        moved = 0.0 if self._last is None else float(np.linalg.norm(position - self._last))
        self._last = position
        here = self.place
        reach = here.travelled + STRIDE * moved + self._slack
        stop = max(int(np.searchsorted(self._along, reach)), here.move + 1)
        window = slice(here.move, min(stop, len(self._way)))
        offset = position - self._start[window]
        fraction = np.clip((offset * self._way[window]).sum(axis=1) / self._square[window], 0.0, 1.0)
        fraction[0] = max(fraction[0], here.fraction)
        away = np.linalg.norm(offset - fraction[:, None] * self._way[window], axis=1)
        nearest = int(np.argmin(away))
        move, part = here.move + nearest, float(fraction[nearest])
        travelled = float(self._along[move] + part * (self._along[move + 1] - self._along[move]))
        self.place = Place(move, part, max(travelled, here.travelled), float(away[nearest]))
        return self.place
