"""Which layer an element was printed in, and which nodes stand on the base."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from twins import Plane, Toolpath

from .errors import MeshingError
from .tetrahedra import Array, Indices


def assign_layers(points: Array, tets: Indices, toolpath: Toolpath) -> Indices:
    """Layer of each element: the interval between consecutive nozzle planes that holds its centroid.

    The distance by which a centroid lies outside a layer is the larger of its depth below the layer's floor and its
    height above the layer's nozzle plane; an element belongs to the layer that it lies least outside of. Between
    planes that do not cross within the part that is the one layer that holds the centroid, whether the planes are
    parallel or not; below the base it is the first layer, above the last nozzle plane the last.

    Args:
        points: shape (n, 3), mm.
        tets: corner indices, shape (m, 4).

    Returns:
        Layer indices from 0, shape (m,).

    Raises:
        MeshingError: the toolpath has no layers, or a layer with curves gets no element.
    """
    if not toolpath.layers:
        raise MeshingError("the toolpath has no layers to sort the elements into")
    centroids = np.asarray(points[tets].mean(axis=1), dtype=np.float64)
    layer = np.zeros(len(tets), dtype=np.int64)
    least = np.full(len(tets), np.inf)
    above_floor = toolpath.base.height_of(centroids)
    for k, printed in enumerate(toolpath.layers):
        above_nozzle = printed.nozzle.height_of(centroids)
        outside = np.maximum(-above_floor, above_nozzle)
        nearer = outside < least
        layer[nearer], least[nearer] = k, outside[nearer]
        above_floor = above_nozzle
    _check_layers(layer, toolpath)
    return layer


def base_nodes(points: Array, base: Plane, tolerance: float) -> Indices:
    """Nodes that stand on the base plane.

    A printed volume has a flat base, cut by the base plane; a mesher moves it by no more than its tolerance. So every
    node within the tolerance of the plane counts as standing on it. Nodes are not moved.

    Args:
        points: shape (n, 3), mm.
        tolerance: largest distance from the plane, mm.

    Returns:
        Indices, ascending.

    Raises:
        MeshingError: fewer than three nodes, or all in one line: nothing to stand on.
    """
    nodes = np.flatnonzero(np.abs(base.height_of(points)) <= tolerance)
    if len(nodes) < 3 or not _spread(base.to_frame(points[nodes])[:, :2]):
        lowest = float(base.height_of(points).min())
        raise MeshingError(
            f"the volume does not stand on the toolpath's base plane: {len(nodes)} nodes lie within {tolerance:.3g} mm "
            f"of it, the lowest node is {lowest:.6g} mm above it; put the part on the bed, or use the toolpath "
            "that the volume came from"
        )
    return nodes


def _check_layers(layer: Indices, toolpath: Toolpath) -> None:
    count = np.bincount(layer, minlength=len(toolpath.layers))
    printed = np.array([len(each.curves) > 0 for each in toolpath.layers])
    empty = np.flatnonzero(printed & (count == 0))
    if len(empty):
        raise MeshingError(
            f"{len(empty)} of {int(printed.sum())} printed layers get no element (layers {_listed(empty)}); reduce the "
            "edge length, or use the toolpath that the volume came from"
        )


def _spread(points: Array) -> bool:
    """Whether points in the plane, shape (n, 2), span an area."""
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(extents[-1] > 1e-6 * max(extents[0], 1e-12))


def _listed(numbers: npt.NDArray[np.int64], most: int = 8) -> str:
    shown = ", ".join(str(n) for n in numbers[:most])
    return f"{shown}, …" if len(numbers) > most else shown
