"""The analysis of a printed volume: tetrahedra by layer, files for finite element programs, self-weight by CalculiX."""

from .calculix import SolverResult, find_solver, solve
from .errors import (
    AnalysisError,
    DeckError,
    MeshingError,
    MeshingTimeout,
    SolverError,
    SolverMissing,
    SolverTimeout,
)
from .export import write_mesh
from .fea import FeaReport, export_fea
from .layering import assign_layers, base_nodes
from .meshing import tetrahedralize
from .self_weight import Deck, write_self_weight
from .settings import FeaSettings
from .tetrahedra import TetMesh

__all__ = [
    "AnalysisError",
    "Deck",
    "DeckError",
    "FeaReport",
    "FeaSettings",
    "MeshingError",
    "MeshingTimeout",
    "SolverError",
    "SolverMissing",
    "SolverResult",
    "SolverTimeout",
    "TetMesh",
    "assign_layers",
    "base_nodes",
    "export_fea",
    "find_solver",
    "solve",
    "tetrahedralize",
    "write_mesh",
    "write_self_weight",
]
