"""Remesh: triangles of one edge length (Botsch and Kobbelt 2004: A Remeshing Approach to Multiresolution Modeling).

Slivers go first (manifold3d); then rounds of small moves bring the edges to the length. A move that would break the
surface is not made (`moves.py`), and a round in which parts of it came to cut one another is made again without those
places (`even_net.py`). So where the length does not suit a detail, edges there are shorter, and the detail stays.
"""

from __future__ import annotations

import manifold3d
import numpy as np
import numpy.typing as npt
import trimesh

from twins.crossings import find_cuts
from twins.entrances import checks_kinds
from twins.errors import SurfaceError
from twins.surface import make_surface

from .even_net import even_net
from .solids import solid_of, surface_of

Array = npt.NDArray[np.float64]

SIMPLER = 1e-4
"""How far the surface may move so that slivers disappear first, as a share of the edge length: less than the gaps
between faces of a reconstructed surface that touch."""

MOST_TRIANGLES = 5_000_000


@checks_kinds
def remesh(
    surface: trimesh.Trimesh, edge_length: float, keep_edges_deg: float | None = 30.0
) -> trimesh.Trimesh:
    """The same surface, of triangles whose edges are about as long as wanted.

    Most edges lie between 0.7 and 1.3 of the length and their mean is near it; beside kept edges, and where the part
    is finer than that, they are shorter. Holes and bodies stay as many. Middles of the result's faces lie within 0.3
    of the length from the surface, and points of the surface within half of the length from the result. Parts of the
    surface that do not cut one another do not do so afterwards.

    Args:
        surface: closed and oriented outwards, mm.
        edge_length: mm.
        keep_edges_deg: edges whose faces turn by more than this are kept, degrees, in lines of at least two edge
            lengths (shorter ones are jags); such a line is drawn straight where its points are within 0.1 of the
            length of it. None: no edge is kept, as is best for surfaces of toolpaths, whose rims are jagged.

    Raises:
        SurfaceError: the mesh does not bound a solid; the edge length is not above 0, is more than half of the part,
            or gives more than 5 million triangles; `keep_edges_deg` is not between 0° and 180°.
    """
    if not 0.0 < edge_length <= 0.5 * float(np.ptp(surface.vertices, axis=0).max(initial=0.0)):
        raise SurfaceError(
            f"the edge length must be above 0 mm and at most half of the part's size, not {edge_length} mm"
        )
    if keep_edges_deg is not None and not 0.0 < keep_edges_deg < 180.0:
        raise SurfaceError(f"keep_edges_deg must be between 0° and 180°, not {keep_edges_deg}")
    solid = solid_of(surface)
    triangles = 2.31 * solid.surface_area() / edge_length**2
    if triangles > MOST_TRIANGLES:
        raise SurfaceError(
            f"an edge length of {edge_length:.6g} mm gives about {triangles:.2g} triangles, more than "
            f"{MOST_TRIANGLES:,}; make it longer"
        )
    before = _without_slivers(solid, float(edge_length))
    return make_surface(
        *even_net(
            np.asarray(before.vertices),
            np.asarray(before.faces, dtype=np.int64),
            float(edge_length),
            keep_edges_deg,
        )
    )


def _without_slivers(solid: manifold3d.Manifold, edge_length: float) -> trimesh.Trimesh:
    """The surface of a solid without slivers, unless it is another one without them."""
    plain, simple = surface_of(solid), surface_of(solid.simplify(SIMPLER * edge_length))
    if (
        _euler(plain) != _euler(simple)
        or plain.body_count != simple.body_count
        or _cuts(simple) > _cuts(plain)
    ):
        return plain
    return simple


def _cuts(surface: trimesh.Trimesh) -> int:
    faces = np.asarray(surface.faces, dtype=np.int64)
    return find_cuts(np.asarray(surface.vertices), faces, np.zeros(len(faces), dtype=np.int64), 1).number


def _euler(surface: trimesh.Trimesh) -> int:
    """Vertices - edges + faces; a closed surface has three half-edges a face."""
    return len(surface.vertices) - len(surface.faces) // 2
