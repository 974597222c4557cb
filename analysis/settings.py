"""Settings of the finite element export: the `[fea]` table of a job."""

from __future__ import annotations

import os
from typing import Annotated

from pydantic import Field

from planning.configuration import Table

Positive = Annotated[float, Field(gt=0)]


class FeaSettings(Table):
    """How the printed volume is meshed and solved.

    Attributes:
        edge: target edge length of the tetrahedra, mm; where it is not given it follows from the wall and the
            layer thickness (`analysis.export_fea`).
        tolerance_mm: how far the tetrahedra's surface may lie from the volume's, mm; where it is not given, a
            twelfth of the edge.
        time_limit_s: for the mesher and for the solver, each, s.
        threads: of either; 0 for all cores that this process may use.
    """

    edge: Positive | None = None
    tolerance_mm: Positive | None = None
    time_limit_s: Positive = 600.0
    threads: Annotated[int, Field(ge=0)] = 0


def thread_count(threads: int) -> int:
    """`threads`, or the cores that this process may use where it is 0."""
    if threads > 0:
        return threads
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
