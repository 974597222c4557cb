"""Trim: cut off what is above a plane, and close the cut by a flat face."""

from __future__ import annotations

from collections.abc import Sequence

import trimesh

from twins.entrances import checks_kinds
from twins.errors import SurfaceError
from twins.surface import check_surface
from twins.toolpath import Plane

from .local_cuts import cut_off
from .solids import halves, solid_of, surface_of


@checks_kinds
def trim(
    surface: trimesh.Trimesh, planes: Plane | Sequence[Plane], *, at_origin: bool = False
) -> trimesh.Trimesh:
    """What of a part is below all of the planes; where it was cut it has flat faces.

    Args:
        surface: closed and oriented outwards, mm.
        planes: a plane that does not meet the part cuts off nothing.
        at_origin: a plane cuts only where its origin lies: off comes the body that stands there, and a branch that
            the plane meets elsewhere stays whole.

    Raises:
        SurfaceError: the mesh does not bound a solid, or nothing of it is left; with `at_origin`, a plane's origin is
            not inside the part.
    """
    solid = solid_of(surface)
    for k, plane in enumerate([planes] if isinstance(planes, Plane) else planes):
        below, off = cut_off(solid, plane, k) if at_origin else halves(solid, plane)
        if off is None:
            continue
        if below is None:
            x, y, z = plane.origin
            raise SurfaceError(
                f"nothing of the part is below plane {k} at ({x:.6g}, {y:.6g}, {z:.6g}); move the plane up, "
                "or turn it over: trim keeps the side that the normal points away from"
            )
        solid = below
    trimmed = surface_of(solid)
    check_surface(trimmed)
    return trimmed
