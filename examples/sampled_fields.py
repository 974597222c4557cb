"""Solids where a function of place is above 0, sampled on a grid by marching cubes and cut flat at a box's sides.

For shapes with many holes, such as labyrinths of minimal surfaces, whose functions numpy evaluates all at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import trimesh
from skimage.measure import marching_cubes

from twins import check_surface, make_surface

Array = npt.NDArray[np.float64]


def field_in_box(
    field: Callable[[Array, Array, Array], Array], low: Sequence[float], high: Sequence[float], cell: float
) -> trimesh.Trimesh:
    """The largest body of where a field is above 0, as far as it lies in a box; a closed surface, mm.

    Args:
        field: of arrays x, y, z that broadcast, mm; also a little outside the box.
        low, high: corners of the box, shape (3,), mm.
        cell: of the grid that the field is sampled on, mm.
    """
    # The outermost cells are emptied: closed beyond the box, and cut at its sides alone.
    axes = [
        np.asarray(a - 2.3 * cell + cell * np.arange(int((b - a) / cell) + 6), dtype=np.float64)
        for a, b in zip(low, high, strict=True)
    ]
    x, y, z = axes[0][:, None, None], axes[1][:, None], axes[2]
    values = np.array(np.broadcast_to(field(x, y, z), tuple(len(axis) for axis in axes)))
    largest = np.abs(values).max()
    # A node on the surface would give triangles without area.
    values = np.where(np.abs(values) < 1e-3 * largest, np.copysign(1e-3 * largest, values), values)
    for k in range(3):
        np.moveaxis(values, k, 0)[[0, -1]] = -largest
    points, faces, _, _ = marching_cubes(values, 0.0, gradient_direction="ascent")  # type: ignore[no-untyped-call]
    solid = trimesh.Trimesh(points * cell + [axis[0] for axis in axes], faces)
    box = trimesh.creation.box(bounds=[list(low), list(high)])
    cut = trimesh.boolean.intersection([solid, box], engine="manifold")
    body = max(cut.split(only_watertight=True), key=lambda part: part.volume)
    surface = make_surface(body.vertices, body.faces)
    check_surface(surface)
    return surface
