"""The finite element export of a printed volume: mesh it, sort its elements into layers, write the files."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from planning import Mix
from twins import Toolpath, signed_volume

from .export import write_mesh
from .layering import assign_layers, base_nodes
from .meshing import mean_thickness, tetrahedralize
from .self_weight import Deck, write_self_weight
from .settings import FeaSettings
from .tetrahedra import TetMesh

Progress = Callable[[str], None]
"""Told what begins, in a few words."""

_EDGE_PER_WALL = 0.75
_EDGE_PER_LAYER = 2.0
_EDGES_PER_TOLERANCE = 12.0


@dataclass(frozen=True)
class FeaReport:
    """What a finite element export made.

    Attributes:
        elements: number of tetrahedra.
        nodes: number of their corners.
        base_nodes: number of the corners that stand on the base.
        layers: number of layers that have elements.
        elements_per_layer_min: of the layer that has the fewest.
        volume: of the elements, mm³.
        surface_volume: enclosed by the surface that was meshed, mm³.
        quality_median, quality_min: mean ratio of the elements, 1 for a regular tetrahedron.
        edge, tolerance: target edge length and surface tolerance that were used, mm.
        seconds: the export took, s.
        files: the mesh as VTK, Gmsh and Abaqus, and the input file of the self-weight case.
        deck: the self-weight case, for `analysis.solve`.
    """

    elements: int
    nodes: int
    base_nodes: int
    layers: int
    elements_per_layer_min: int
    volume: float
    surface_volume: float
    quality_median: float
    quality_min: float
    edge: float
    tolerance: float
    seconds: float
    files: tuple[Path, ...]
    deck: Deck

    def as_dict(self) -> dict[str, Any]:
        """Numbers and file names for reports; keys carry their units."""
        renamed = {
            "volume": "volume_mm3",
            "surface_volume": "surface_volume_mm3",
            "edge": "edge_mm",
            "tolerance": "tolerance_mm",
            "seconds": "seconds",
        }
        values = {
            renamed.get(key, key): value
            for key, value in asdict(self).items()
            if key not in {"deck", "files"}
        }
        return {
            **values,
            "weight_n": float(np.linalg.norm(self.deck.weight)),
            "files": [f.name for f in self.files],
        }


def export_fea(
    volume: trimesh.Trimesh,
    toolpath: Toolpath,
    mix: Mix,
    settings: FeaSettings,
    folder: Path,
    progress: Progress | None = None,
) -> FeaReport:
    """Write `mesh.vtu`, `mesh.msh`, `mesh.inp` and `self_weight.inp` for a printed volume.

    Where the settings give no edge length it is three quarters of the mean wall thickness, and at most twice the
    layer thickness, so that every layer gets elements of its own.

    Args:
        volume: the surface M' of the printed volume, watertight, standing on the toolpath's base plane, mm.
        toolpath: it was made from; its nozzle planes separate the layers.
        mix: material.
        folder: made if it does not exist.
        progress: told what begins.

    Raises:
        MeshingError: the volume cannot be meshed, a layer gets no element, or nothing stands on the base.
        DeckError: a part of the volume does not stand on the base.
    """
    start = time.monotonic()
    tell = progress or (lambda _: None)
    edge, tolerance = mesh_sizes(volume, toolpath, settings)
    tell(f"filling the volume with tetrahedra of {edge:.3g} mm")
    points, tets = tetrahedralize(volume, edge, tolerance, settings.time_limit_s, settings.threads)
    tell("sorting elements into layers")
    mesh = TetMesh(points, tets, assign_layers(points, tets, toolpath))
    base = base_nodes(points, toolpath.base, tolerance)
    tell("writing mesh and input files")
    folder.mkdir(parents=True, exist_ok=True)
    files = write_mesh(mesh, base, folder)
    deck = write_self_weight(folder, mesh, base, mix)
    quality = mesh.quality
    return FeaReport(
        elements=len(mesh.tets),
        nodes=len(mesh.points),
        base_nodes=len(base),
        layers=len(mesh.layers),
        elements_per_layer_min=int(np.unique(mesh.layer, return_counts=True)[1].min()),
        volume=mesh.volume,
        surface_volume=signed_volume(volume),
        quality_median=float(np.median(quality)),
        quality_min=float(quality.min()),
        edge=edge,
        tolerance=tolerance,
        seconds=time.monotonic() - start,
        files=(*files, deck.path),
        deck=deck,
    )


def mesh_sizes(volume: trimesh.Trimesh, toolpath: Toolpath, settings: FeaSettings) -> tuple[float, float]:
    """Edge length and tolerance, mm: those of the settings, or what follows from the part where they give none."""
    edge = settings.edge
    if edge is None:
        wall = mean_thickness(volume) if len(volume.faces) and volume.area > 0 else toolpath.thickness
        edge = min(_EDGE_PER_WALL * abs(wall), _EDGE_PER_LAYER * toolpath.thickness)
    tolerance = settings.tolerance_mm if settings.tolerance_mm is not None else edge / _EDGES_PER_TOLERANCE
    return edge, tolerance
