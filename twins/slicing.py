"""Slicing: a surface becomes a toolpath (seed paper, Section 2.1).

A plane cuts a closed triangle mesh in closed polygons. Each cut triangle joins the edge where the surface goes
down through the plane to the edge where it comes up again, so the polygons are chained by the mesh's own
adjacency, with the interior on the left and without any tolerance. A vertex that lies in the plane counts as
above it, which puts every vertex, edge and face in the plane right by one rule.
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt
import trimesh

from .errors import PlanesError
from .planes import PlaneStack
from .sampling import sample_layer
from .surface import check_surface
from .toolpath import Curve, Layer, Toolpath

Array = npt.NDArray[np.float64]


def slice_surface(surface: trimesh.Trimesh, planes: PlaneStack, resolution: float | None = None) -> Toolpath:
    """Cut a surface into a toolpath.

    Args:
        surface: closed and oriented outwards, mm.
        planes: from `layer_planes` or `custom_planes`.
        resolution: distance L_R of sample points along the curves, mm; default the layer thickness t'.

    Returns:
        closed curves, outer ones counter-clockwise. Layers above or below the part have none.

    Raises:
        SurfaceError: the mesh does not bound a solid.
        PlanesError: the axis of a rotary stack does not clear the part.
    """
    check_surface(surface)
    if resolution is not None and not resolution > 0:
        raise PlanesError(f"the resolution must be above 0 mm, not {resolution}")
    _check_axis(surface, planes)
    step = planes.thickness if resolution is None else float(resolution)
    layers = []
    for polygons, slicing, nozzle in zip(cut(surface, planes), planes.slicing, planes.nozzle, strict=True):
        layers.append(Layer(slicing, nozzle, tuple(Curve(points) for points in sample_layer(polygons, step))))
    return Toolpath(planes.base, tuple(layers), planes.thickness)


def cut(surface: trimesh.Trimesh, planes: PlaneStack) -> list[list[Array]]:
    """The polygons in which each slicing plane cuts a surface: closed, interior left, shape (n, 2) in plane frames."""
    vertices = np.ascontiguousarray(surface.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(surface.faces, dtype=np.int64)
    across = opposite_half_edges(faces, len(vertices))
    stack: list[list[Array]] = []
    for plane in planes.slicing:
        points, starts = _cut_one(vertices, faces, across, plane.height_of(vertices))
        flat = plane.to_frame(points)[:, :2]
        stack.append(
            [np.ascontiguousarray(part) for part in np.split(flat, starts[1:-1])] if len(starts) > 1 else []
        )
    return stack


@nb.njit(cache=True)
def opposite_half_edges(faces: npt.NDArray[np.int64], vertex_count: int) -> npt.NDArray[np.int64]:
    """For half-edge 3 f + e (corner e to the next of face f) the one that runs against it, or -1; shape (3 m,)."""
    count = np.zeros(vertex_count + 1, np.int64)
    for f in range(len(faces)):
        for e in range(3):
            count[min(faces[f, e], faces[f, (e + 1) % 3]) + 1] += 1
    for v in range(vertex_count):
        count[v + 1] += count[v]
    fill = count[:-1].copy()
    waiting = np.empty(3 * len(faces), np.int64)
    opposite = np.full(3 * len(faces), -1, np.int64)
    for f in range(len(faces)):
        for e in range(3):
            a, b = faces[f, e], faces[f, (e + 1) % 3]
            low = min(a, b)
            found = -1
            for slot in range(count[low], fill[low]):
                h = waiting[slot]
                if opposite[h] < 0 and faces[h // 3, h % 3] == b and faces[h // 3, (h % 3 + 1) % 3] == a:
                    found = h
                    break
            if found >= 0:
                opposite[3 * f + e] = found
                opposite[found] = 3 * f + e
            else:
                waiting[fill[low]] = 3 * f + e
                fill[low] += 1
    return opposite


@nb.njit(cache=True)
def _cut_one(
    vertices: Array, faces: npt.NDArray[np.int64], across: npt.NDArray[np.int64], height: Array
) -> tuple[Array, npt.NDArray[np.int64]]:
    """Points of all loops, shape (n, 3), and where each loop starts; height[v] >= 0 counts as above."""
    local = np.full(len(faces), -1, np.int64)
    cut_faces = np.empty(len(faces), np.int64)
    n = 0
    for f in range(len(faces)):
        a = height[faces[f, 0]] >= 0.0
        b = height[faces[f, 1]] >= 0.0
        c = height[faces[f, 2]] >= 0.0
        if a != b or b != c:
            local[f] = n
            cut_faces[n] = f
            n += 1
    points = np.empty((n, 3))
    starts = np.empty(n + 1, np.int64)
    starts[0] = 0
    loops = 0
    written = 0
    for seed in range(n):
        f = cut_faces[seed]
        if local[f] < 0:
            continue
        while local[f] >= 0:
            local[f] = -1
            down, up = 0, 0
            for e in range(3):
                above = height[faces[f, e]] >= 0.0
                next_above = height[faces[f, (e + 1) % 3]] >= 0.0
                if above and not next_above:
                    down = e
                elif next_above and not above:
                    up = e
            a = faces[f, down]
            b = faces[f, (down + 1) % 3]
            share = height[a] / (height[a] - height[b])
            for k in range(3):
                points[written, k] = vertices[a, k] + share * (vertices[b, k] - vertices[a, k])
            written += 1
            f = across[3 * f + up] // 3
        loops += 1
        starts[loops] = written
    return points, starts[: loops + 1]


def _check_axis(surface: trimesh.Trimesh, planes: PlaneStack) -> None:
    """A fan opens on one side of its axis: the part must lie there, where the bed's origin is."""
    axis = planes.axis
    if axis is None:
        return
    outward = planes.base.origin - axis.point
    outward = outward / np.linalg.norm(outward)
    offset = np.asarray(surface.vertices) - axis.point
    offset = offset - np.outer(offset @ axis.direction, axis.direction)
    distance = np.linalg.norm(offset, axis=1)
    angle = np.arctan2(np.cross(outward, offset) @ axis.direction, offset @ outward)
    if float(np.abs(angle).max()) >= 0.5 * np.pi:
        raise PlanesError(
            f"the axis in which bed and top plane meet does not clear the part: it is "
            f"{axis.radius:.6g} mm from the bed's origin and {float(distance.min()):.6g} mm from the part's nearest "
            "vertex, and some of the part lies beyond it; tilt the top plane less or the other way, or move it up"
        )
