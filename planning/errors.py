"""Errors of the planner.

PlanningError
├── ConfigurationError   a cell, mix or settings file that is wrong, missing or misspelt
├── ReachError           a pose that the arm cannot take, or no branch that takes them all
└── ProgramError         a program file that cannot be read, or does not fit what it is used with
"""

from __future__ import annotations


class PlanningError(Exception):
    """Base of every error that the planner raises on purpose."""


class ConfigurationError(PlanningError):
    """A configuration file or table is wrong, missing or misspelt."""


class ReachError(PlanningError):
    """The arm cannot take a pose of the job."""


class ProgramError(PlanningError):
    """A program cannot be read, or does not fit what it is used with."""
