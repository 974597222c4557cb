"""The planner: a toolpath becomes a program for a robot cell."""

from .cell import Cell, load_cell
from .desktop_printer import DesktopPrinter, load_printer
from .errors import ConfigurationError, PlanningError, ProgramError, ReachError
from .finding import Finding, Severity
from .gcode import GcodeText, gcode, model_gcode
from .kinematics import ARMS, Arm, arm
from .mix import Mix, load_mix
from .plan import plan
from .preflight import check
from .program import Program, Segment, SegmentKind
from .sample import PrintedSample
from .scaled import ScaledModel, scaled_model
from .settings import PrintSettings
from .urscript import urscript

__all__ = [
    "ARMS",
    "Arm",
    "Cell",
    "ConfigurationError",
    "DesktopPrinter",
    "Finding",
    "GcodeText",
    "Mix",
    "PlanningError",
    "PrintSettings",
    "PrintedSample",
    "Program",
    "ProgramError",
    "ReachError",
    "ScaledModel",
    "Segment",
    "SegmentKind",
    "Severity",
    "arm",
    "check",
    "gcode",
    "load_cell",
    "load_mix",
    "load_printer",
    "model_gcode",
    "plan",
    "scaled_model",
    "urscript",
]
