"""Local cuts: a plane that cuts a part only where its origin lies, and no other branch that it meets."""

from __future__ import annotations

from collections.abc import Sequence

import manifold3d
import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from twins.errors import SurfaceError
from twins.toolpath import Plane

from .solids import bodies, halves, surface_of

Array = npt.NDArray[np.float64]

_IN_PLANE = 1e-7  # of the part's size: up to here a vertex lies in the plane
_APART = 1e-5  # of the part's size: the least gap through which a plane between two bodies is laid


def cut_off(
    solid: manifold3d.Manifold, plane: Plane, number: int
) -> tuple[manifold3d.Manifold, manifold3d.Manifold]:
    """The rest, and the body above a plane that stands on the plane's origin.

    The cut is made by half-spaces: the one above the plane, and others that part the body from what else is above the
    plane. They touch nothing, while taking the body away from the whole would compare faces that lie on each other.

    Raises:
        SurfaceError: the origin is not inside the part, or what else is above the plane is wound around the body.
    """
    below, above = halves(solid, plane)
    found = [] if below is None or above is None else bodies(above)
    points = [np.asarray(surface_of(body).vertices) for body in found]
    x, y, z = plane.origin
    at = next((i for i, body in enumerate(found) if _stands_on_origin(body, plane)), None)
    if at is None:
        raise SurfaceError(
            f"the origin of plane {number}, ({x:.6g}, {y:.6g}, {z:.6g}), is not inside the part; "
            "put it where the plane shall cut, or cut everywhere"
        )
    between = [_plane_between(points[at], other) for i, other in enumerate(points) if i != at]
    if any(found is None for found in between):
        raise SurfaceError(
            f"plane {number} at ({x:.6g}, {y:.6g}, {z:.6g}) meets the part elsewhere too, and no plane lies between "
            "what it cuts off here and there; cut the other branch first, or cut everywhere"
        )
    sides = [
        (plane.normal, float(plane.normal @ plane.origin)),
        *(side for side in between if side is not None),
    ]
    off, rest = solid.split(_convex(np.asarray(surface_of(solid).vertices), sides))
    return rest, off


def _stands_on_origin(body: manifold3d.Manifold, plane: Plane) -> bool:
    """Whether one of a body's faces in the plane holds the plane's origin."""
    surface = surface_of(body)
    local = plane.to_frame(np.asarray(surface.vertices))
    flat = np.abs(local[:, 2]) <= _IN_PLANE * float(np.ptp(local, axis=0).max())
    faces = np.asarray(surface.faces)
    a, b, c = local[faces[flat[faces].all(axis=1)], :2].transpose(1, 0, 2)
    sides = np.stack([p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((a, b), (b, c), (c, a))])
    return bool(((sides >= 0.0).all(axis=0) | (sides <= 0.0).all(axis=0)).any())


def _plane_between(inside: Array, outside: Array) -> tuple[Array, float] | None:
    """The half-space normal · x ≥ offset that holds one point set and not the other, with the widest gap."""
    inside, outside = (points[ConvexHull(points).vertices] for points in (inside, outside))
    middle = 0.5 * (inside.mean(axis=0) + outside.mean(axis=0))
    size = float(np.ptp(np.vstack([inside, outside]), axis=0).max())
    p, q = (inside - middle) / size, (outside - middle) / size
    # Unknowns: normal, offset, gap; p · normal - offset ≥ gap, and ≤ -gap for q.
    rows = np.vstack(
        [
            np.column_stack([-p, np.ones(len(p)), np.ones(len(p))]),
            np.column_stack([q, -np.ones(len(q)), np.ones(len(q))]),
        ]
    )
    best = linprog(
        [0.0, 0.0, 0.0, 0.0, -1.0],
        A_ub=rows,
        b_ub=np.zeros(len(rows)),
        bounds=[(-1.0, 1.0)] * 3 + [(None, None), (0.0, None)],
    )
    if best.x is None or best.x[4] < _APART:
        return None
    normal, offset = np.asarray(best.x[:3], dtype=np.float64), float(best.x[3])
    return normal, offset * size + float(normal @ middle)


def _convex(points: Array, sides: Sequence[tuple[Array, float]]) -> manifold3d.Manifold:
    """The half-spaces' intersection, as far as it may hold any of the points."""
    low, high = points.min(axis=0), points.max(axis=0)
    reach = float((high - low).max())
    solid = manifold3d.Manifold.cube(((high - low) + 2.0 * reach).tolist()).translate((low - reach).tolist())
    for normal, offset in sides:
        length = float(np.linalg.norm(normal))
        solid = solid.trim_by_plane((normal / length).tolist(), offset / length)
    return solid
