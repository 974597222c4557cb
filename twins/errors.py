"""Errors of the twin engine.

TwinsError
├── SurfaceError      a mesh that does not bound a solid, or does not stand where it must
├── PlanesError       planes from which no layers can be made
├── ToolpathError     curves that cannot be a toolpath
└── FormatError       a file that cannot be read as what its name says
"""

from __future__ import annotations


class TwinsError(Exception):
    """Base of every error that the twin engine raises on purpose."""


class SurfaceError(TwinsError):
    """The mesh does not bound a solid, or lies where it cannot be sliced."""


class PlanesError(TwinsError):
    """No layers can be made from the planes given."""


class ToolpathError(TwinsError):
    """The curves cannot form a toolpath."""


class FormatError(TwinsError):
    """A file cannot be read as what its name says."""
