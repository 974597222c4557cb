"""A finding: one thing that a check has to say about a job."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any


class Severity(StrEnum):
    """Whether a finding keeps the job from running."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True)
class Finding:
    """A preflight or buildability result.

    Attributes:
        kind: what was checked, e.g. `joint limit`.
        severity: an error keeps the job from running.
        waypoint: index of the (worst) waypoint, or -1 where it concerns the whole job.
        value, limit: in `unit`.
        unit: of both.
        message: one sentence: where, and what is wrong.
        remedy: what to do.
    """

    kind: str
    severity: Severity
    waypoint: int
    value: float
    limit: float
    unit: str
    message: str
    remedy: str

    def __str__(self) -> str:
        where = f"waypoint {self.waypoint}: " if self.waypoint >= 0 else ""
        return f"{self.severity}: {self.kind}: {where}{self.message}; {self.remedy}"

    def as_dict(self) -> dict[str, Any]:
        """For reports."""
        return asdict(self)
