"""The planner: a toolpath becomes a program for a robot cell."""

from .cell import Cell, load_cell
from .errors import ConfigurationError, PlanningError, ProgramError, ReachError
from .finding import Finding, Severity
from .kinematics import ARMS, Arm, arm
from .mix import Mix, load_mix
from .plan import plan
from .preflight import check
from .program import Program, Segment, SegmentKind
from .sample import PrintedSample
from .settings import PrintSettings
from .urscript import urscript

__all__ = [
    "ARMS",
    "Arm",
    "Cell",
    "ConfigurationError",
    "Finding",
    "Mix",
    "PlanningError",
    "PrintSettings",
    "PrintedSample",
    "Program",
    "ProgramError",
    "ReachError",
    "Segment",
    "SegmentKind",
    "Severity",
    "arm",
    "check",
    "load_cell",
    "load_mix",
    "plan",
    "urscript",
]
