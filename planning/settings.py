"""Print settings: the `[print]` table of a job."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from .configuration import Table

Positive = Annotated[float, Field(gt=0)]


class PrintSettings(Table):
    """How the toolpath is printed.

    Attributes:
        width: bead width where the toolpath itself gives none, mm.
        speed: TCP speed while printing, mm/s.
        end_speed: share of `speed` at which a bead ends, so that the pump can follow down to the cut-off.
        travel_speed: TCP speed between beads, mm/s.
        approach_speed: TCP speed down to a bead and up from it, mm/s.
        clearance: height of travels above the nozzle plane, mm.
        blend: largest blend radius at waypoints, mm.
    """

    width: Positive
    speed: Positive
    end_speed: Annotated[float, Field(gt=0, le=1)] = 0.03
    travel_speed: Positive = 150.0
    approach_speed: Positive = 30.0
    clearance: Positive = 20.0
    blend: Annotated[float, Field(ge=0)] = 2.0
