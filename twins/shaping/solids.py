"""Solids of manifold3d, made from surfaces and turned back into them."""

from __future__ import annotations

import manifold3d
import numpy as np
import numpy.typing as npt
import trimesh

from twins.errors import SurfaceError
from twins.surface import check_surface, make_surface
from twins.toolpath import Plane

Array = npt.NDArray[np.float64]

NOTHING = 1e-9
"""Share of a part's volume up to which a piece of it is rounding, not material."""

IN_PLANE = 1e-7
"""Distance from a plane, as a share of the part's size, up to which a vertex lies in it."""


def solid_of(surface: trimesh.Trimesh) -> manifold3d.Manifold:
    """The solid that a surface bounds.

    Raises:
        SurfaceError: the mesh does not bound a solid.
    """
    check_surface(surface)
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(
            np.ascontiguousarray(surface.vertices, dtype=np.float64),
            np.ascontiguousarray(surface.faces, dtype=np.uint64),
        )
    )
    if solid.status() != manifold3d.Error.NoError:
        raise SurfaceError(
            f"the surface cannot be cut: manifold3d calls it {solid.status().name}; repair it first (repair_surface)"
        )
    return solid


def surface_of(solid: manifold3d.Manifold) -> trimesh.Trimesh:
    mesh = solid.to_mesh64()
    return make_surface(np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts))


def halves(
    solid: manifold3d.Manifold, plane: Plane
) -> tuple[manifold3d.Manifold | None, manifold3d.Manifold | None]:
    """What is below and what is above a plane; None where that is nothing."""
    above, below = solid.split_by_plane(plane.normal.tolist(), float(plane.normal @ plane.origin))
    least = NOTHING * solid.volume()
    return (below if below.volume() > least else None), (above if above.volume() > least else None)


def bodies(solid: manifold3d.Manifold) -> list[manifold3d.Manifold]:
    """The pieces that do not touch one another, each with its cavities, the largest first."""
    shells = sorted(_no_crumbs(solid, solid.decompose()), key=lambda shell: -abs(shell.volume()))
    outer = [shell for shell in shells if shell.volume() > 0.0]
    cavities = [surface_of(shell) for shell in shells if shell.volume() < 0.0]
    if not cavities:
        return outer
    parts = [[surface_of(shell)] for shell in outer]
    for cavity in cavities:
        # The smallest body around a cavity is the one that it is in.
        around = [part for part in parts if bool(part[0].contains(cavity.vertices[:1])[0])]
        if not around:
            x, y, z = cavity.vertices[0]
            raise SurfaceError(
                f"the part has a cavity at ({x:.3f}, {y:.3f}, {z:.3f}) that is in no body: a body there is inside out; "
                "repair the surface first (repair_surface)"
            )
        around[-1].append(cavity)
    return [_one_of(part) for part in parts]


def _no_crumbs(solid: manifold3d.Manifold, shells: list[manifold3d.Manifold]) -> list[manifold3d.Manifold]:
    least = NOTHING * solid.volume()
    return [shell for shell in shells if abs(shell.volume()) > least]


def _one_of(shells: list[trimesh.Trimesh]) -> manifold3d.Manifold:
    offsets = np.cumsum([0, *(len(shell.vertices) for shell in shells)])
    faces = [np.asarray(shell.faces) + n for shell, n in zip(shells, offsets, strict=False)]
    return solid_of(make_surface(np.vstack([shell.vertices for shell in shells]), np.vstack(faces)))
