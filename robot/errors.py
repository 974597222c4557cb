"""Errors of the cell at run time.

RobotError
├── PortTakenError      an address that a simulator wants is in use
├── CellUnreachable     robot or pump does not answer
├── ArmError            the arm process, or what it drives, failed
├── PumpError           the pump refuses or does not do what it is told
├── StoppedError        the print was stopped: by the operator, the guard or the cell itself
└── JournalError        the journal cannot be written or read
"""

from __future__ import annotations


class RobotError(Exception):
    """Base of every error that the cell raises on purpose."""


class PortTakenError(RobotError):
    """An address that a simulator wants is in use."""


class CellUnreachable(RobotError):  # noqa: N818 - reads as the state it reports
    """Robot or pump does not answer."""


class ArmError(RobotError):
    """The arm process, or what it drives, failed."""


class PumpError(RobotError):
    """The pump refuses, or does not do what it is told."""


class StoppedError(RobotError):
    """The print was stopped before its end."""


class JournalError(RobotError):
    """The journal cannot be written or read."""
