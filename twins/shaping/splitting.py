"""Split: cut a part into parts that together are the whole."""

from __future__ import annotations

from collections.abc import Sequence

import manifold3d
import trimesh

from twins.entrances import checks_kinds
from twins.errors import SurfaceError
from twins.surface import check_surface
from twins.toolpath import Plane

from .local_cuts import cut_off
from .sheets import prism_on
from .solids import NOTHING, bodies, halves, solid_of, surface_of

_SUM = 1e-6
"""Largest difference between the parts' volumes and the whole's, as a share of it."""


@checks_kinds
def split(
    surface: trimesh.Trimesh, by: Plane | Sequence[Plane] | trimesh.Trimesh, *, at_origin: bool = False
) -> tuple[trimesh.Trimesh, ...]:
    """The parts into which planes or a cutting surface divide a part.

    Parts of planes come from below the first plane upwards; with `at_origin` each plane's part, in the planes' order,
    and last the rest. Of a cutting surface first come the parts on the side that its normals point away from, so of a
    closed one those inside it. Pieces that do not touch are parts of their own.

    Args:
        surface: closed and oriented outwards, mm.
        by: planes, or a surface: closed, or open and reaching across the whole part.
        at_origin: a plane cuts only where its origin lies: off comes the body above it that stands there.

    Raises:
        SurfaceError: the mesh does not bound a solid, something of `by` does not cut the part, or the parts' volumes
            do not sum to the whole.
    """
    whole = solid_of(surface)
    if isinstance(by, trimesh.Trimesh):
        pieces = _by_surface(whole, surface, by)
    else:
        planes = [by] if isinstance(by, Plane) else list(by)
        pieces = _at_origins(whole, planes) if at_origin else _by_planes(whole, planes)
    parts = tuple(surface_of(body) for piece in pieces for body in bodies(piece))
    for part in parts:
        check_surface(part)
    total = sum(piece.volume() for piece in pieces)
    if abs(total - whole.volume()) > _SUM * whole.volume():
        raise SurfaceError(
            f"the parts' volumes sum to {total:.6g} mm³, not to the whole's {whole.volume():.6g} mm³; "
            "the surface may cut itself: repair it first (repair_surface), or move the cut a little"
        )
    return parts


def _by_planes(whole: manifold3d.Manifold, planes: Sequence[Plane]) -> list[manifold3d.Manifold]:
    pieces = [whole]
    for k, plane in enumerate(planes):
        cut = [halves(piece, plane) for piece in pieces]
        if all(below is None or above is None for below, above in cut):
            x, y, z = plane.origin
            raise SurfaceError(
                f"plane {k} at ({x:.6g}, {y:.6g}, {z:.6g}) does not cut the part; move it or leave it out"
            )
        pieces = [piece for pair in cut for piece in pair if piece is not None]
    return pieces


def _at_origins(whole: manifold3d.Manifold, planes: Sequence[Plane]) -> list[manifold3d.Manifold]:
    rest, parts = whole, []
    for k, plane in enumerate(planes):
        rest, off = cut_off(rest, plane, k)
        parts.append(off)
    return [*parts, rest]


def _by_surface(
    whole: manifold3d.Manifold, surface: trimesh.Trimesh, by: trimesh.Trimesh
) -> list[manifold3d.Manifold]:
    inside, outside = whole.split(solid_of(by if by.is_watertight else prism_on(by, surface)))
    least = NOTHING * whole.volume()
    if inside.volume() <= least or outside.volume() <= least:
        raise SurfaceError("the cutting surface does not cut the part; check where it lies, and its unit")
    return [inside, outside]
