"""Curves in space, as designers draw them: polylines that know nothing of layers yet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from twins.errors import ToolpathError
from twins.toolpath import read_only

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SpaceCurve:
    """A polyline in space.

    Attributes:
        points: shape (n, 3), mm; a closed curve does not repeat its first point.
        closed: whether the last point is joined to the first.
        widths: bead width at each point, shape (n,), mm, or None where nothing says it.
        heights: of the bead at each point, down to the plane that its layer is printed on, shape (n,), mm, or None
            where nothing says it.
    """

    points: Array
    closed: bool = True
    widths: Array | None = None
    heights: Array | None = None

    def __post_init__(self) -> None:
        points = read_only(self.points, (None, 3), "a curve's points")
        least = 3 if self.closed else 2
        if len(points) < least:
            raise ToolpathError(
                f"{'a closed' if self.closed else 'an open'} curve needs at least {least} points, not {len(points)}"
            )
        object.__setattr__(self, "points", points)
        if self.widths is not None:
            widths = read_only(self.widths, (len(points),), "a curve's widths")
            if (widths <= 0).any():
                raise ToolpathError("a curve's widths must be above 0 at every point")
            object.__setattr__(self, "widths", widths)
        if self.heights is not None:
            heights = read_only(self.heights, (len(points),), "a curve's heights")
            object.__setattr__(self, "heights", heights)

    @property
    def length(self) -> float:
        """Length in mm."""
        ends = np.vstack([self.points, self.points[:1]]) if self.closed else self.points
        return float(np.linalg.norm(np.diff(ends, axis=0), axis=1).sum())
