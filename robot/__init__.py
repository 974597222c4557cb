"""The cell at run time: arm, pump, printer, journal, simulators."""

from .errors import (
    ArmError,
    CellUnreachable,
    JournalError,
    PortTakenError,
    PumpError,
    RobotError,
    StoppedError,
)
from .evaluation import Evaluation, evaluate
from .journal import Journal, read_events, read_samples
from .printer import RunResult, run
from .supervisor import Progress

__all__ = [
    "ArmError",
    "CellUnreachable",
    "Evaluation",
    "Journal",
    "JournalError",
    "PortTakenError",
    "Progress",
    "PumpError",
    "RobotError",
    "RunResult",
    "StoppedError",
    "evaluate",
    "read_events",
    "read_samples",
    "run",
]
