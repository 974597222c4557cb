"""Errors of the analysis.

AnalysisError
├── MeshingError          the volume cannot be filled with tetrahedra, or the tetrahedra are not usable
│   └── MeshingTimeout    the mesher did not end within its time limit
├── DeckError             the tetrahedra and the mix do not make a solvable input file
└── SolverError           the solver failed, warned of something it left out, or its result does not add up
    ├── SolverMissing     ccx is not installed
    └── SolverTimeout     the solver did not end within its time limit
"""

from __future__ import annotations


class AnalysisError(Exception):
    """Base of every error that the analysis raises on purpose."""


class MeshingError(AnalysisError):
    """The volume cannot be filled with tetrahedra, or the tetrahedra are not usable."""


class MeshingTimeout(MeshingError):  # noqa: N818 - reads as the state it reports
    """The mesher did not end within its time limit."""


class DeckError(AnalysisError):
    """The tetrahedra and the mix do not make a solvable input file."""


class SolverError(AnalysisError):
    """The solver failed, warned of something it left out, or its result does not add up."""


class SolverMissing(SolverError):  # noqa: N818 - reads as the state it reports
    """The solver is not installed."""


class SolverTimeout(SolverError):  # noqa: N818 - reads as the state it reports
    """The solver did not end within its time limit."""
