"""Remesh: triangles of one edge length (Botsch and Kobbelt 2004: A Remeshing Approach to Multiresolution Modeling).

gpytoolbox does the work; what it needs (no slivers, edges not much longer than wanted) is prepared by manifold3d, and
what it returns is checked: a surface that is not what it was is refused, never returned.
"""

from __future__ import annotations

import warnings

import manifold3d
import numpy as np
import numpy.typing as npt
import trimesh

from twins.crossings import check_self_intersection
from twins.errors import SurfaceError
from twins.surface import check_surface, make_surface, signed_volume

from .solids import solid_of, surface_of

Array = npt.NDArray[np.float64]

ROUNDS = 10
"""Rounds of splitting, collapsing, flipping and moving edges; more change little."""

SIMPLER = 1e-4
"""How far the surface may move so that slivers disappear first, as a share of the edge length: less than the gaps
between faces of a reconstructed surface that touch."""

WITHIN = 2.0
"""Largest distance between the surfaces before and after, as a share of the edge length."""

MOST_TRIANGLES = 5_000_000

_CHECKED = 2000  # vertices whose distance to the other surface is looked at


def remesh(
    surface: trimesh.Trimesh, edge_length: float, keep_edges_deg: float | None = 30.0
) -> trimesh.Trimesh:
    """The same surface, of triangles whose edges are about as long as wanted.

    Edges lie between about 0.6 and 1.4 of the length, except where sharp edges or a neck of the part are closer than
    that. Details smaller than an edge are lost.

    Args:
        surface: closed and oriented outwards, mm.
        edge_length: mm.
        keep_edges_deg: edges whose faces turn by more than this stay as they are, degrees; None: no edge is kept,
            as is best for surfaces of toolpaths, whose rims are jagged.

    Raises:
        SurfaceError: the mesh does not bound a solid, the edge length is none, or it does not suit the part:
            what came out was not closed, cut itself, had other holes or bodies, or left the surface.
    """
    # Heavy, and needed here only; on import it warns of names that it has from older NumPy and SciPy.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import gpytoolbox  # type: ignore[import-untyped]  # noqa: PLC0415

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
    before = surface_of(_prepared(solid, edge_length))
    vertices, faces = gpytoolbox.remesh_botsch(
        np.ascontiguousarray(before.vertices),
        np.ascontiguousarray(before.faces, dtype=np.int32),
        ROUNDS,
        float(edge_length),
        True,
        detect_feature_edges=keep_edges_deg is not None,
        feature_dihedral_threshold=keep_edges_deg or 0.0,
    )
    after = make_surface(vertices, faces)
    _check_same(surface, after, float(edge_length))
    return after


def _prepared(solid: manifold3d.Manifold, edge_length: float) -> manifold3d.Manifold:
    return solid.simplify(SIMPLER * edge_length).refine_to_length(2.0 * edge_length)


def _check_same(before: trimesh.Trimesh, after: trimesh.Trimesh, edge_length: float) -> None:
    advice = (
        f"the edge length of {edge_length:.6g} mm does not suit the part: make it shorter, "
        "or keep fewer edges (a larger keep_edges_deg, or None)"
    )
    try:
        check_surface(after)
        check_self_intersection(after)
    except SurfaceError as error:
        raise SurfaceError(f"remeshing breaks the surface: {error}; {advice}") from error
    # A vertex in which parts of the surface touch counts once for each.
    if (shared := solid_of(after).num_vert() - len(np.unique(after.faces))) > 0:
        raise SurfaceError(f"remeshing lets the surface touch itself in {shared} vertices; {advice}")
    if (was := _euler(before)) != (now := _euler(after)):
        raise SurfaceError(f"remeshing changes the Euler characteristic from {was} to {now}; {advice}")
    # Vertices of either beside the other: what sticks out or is lost is seen by the one or the other.
    for one, other in ((before, after), (after, before)):
        points = _sample(np.asarray(one.vertices))
        distance = trimesh.proximity.closest_point(other, points)[1]  # type: ignore[no-untyped-call]
        if not float(distance.max()) <= WITHIN * edge_length:
            x, y, z = points[int(distance.argmax())]
            raise SurfaceError(
                f"remeshing moves the surface by {distance.max():.6g} mm at ({x:.3f}, {y:.3f}, {z:.3f}); {advice}"
            )
    if not 0.5 < signed_volume(after) / signed_volume(before) < 2.0:
        raise SurfaceError(f"remeshing changes the volume beyond half or double; {advice}")


def _sample(points: Array) -> Array:
    """Evenly spread over the list of vertices, and so few that the check takes seconds at most."""
    return points[:: max(1, len(points) // _CHECKED)]


def _euler(surface: trimesh.Trimesh) -> int:
    """Vertices - edges + faces; a closed surface has three half-edges a face."""
    faces = np.asarray(surface.faces, dtype=np.int64)
    return len(np.unique(faces)) - len(faces) // 2
