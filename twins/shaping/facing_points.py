"""Facing points: the nearest point of a surface on a face that looks the same way, by a tree of boxes.

Near a thin wall the nearest point may lie on the wall's other side; a face's direction tells the sides apart.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Point = tuple[float, float, float]

LEAF = 4
DEPTH = 64


class FaceTree(NamedTuple):
    """A surface's faces in a binary tree of boxes.

    Attributes:
        corners: of the faces, shape (m, 3, 3), mm.
        normals: of length 1, or 0 for faces without an area; shape (m, 3).
        order: faces in the order of the leaves.
        boxes: low and high corner of each node, shape (k, 6).
        spans: of each node, where its faces begin and end in `order`, and its second child (0: a leaf; the first
            child comes right after the node); shape (k, 3).
        stack: room for a search; one search at a time.
    """

    corners: Array
    normals: Array
    order: Indices
    boxes: Array
    spans: Indices
    stack: Indices


def face_tree(vertices: Array, faces: Indices) -> FaceTree:
    """The tree of a surface of at least one face."""
    corners = np.ascontiguousarray(vertices[faces])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, size, out=np.zeros_like(normals), where=size > 0.0)
    order, boxes, spans = _grow(corners.min(axis=1), corners.max(axis=1), corners.mean(axis=1))
    return FaceTree(corners, normals, order, boxes, spans, np.empty(2 * DEPTH, np.int64))


@nb.njit(cache=True, nogil=True)
def _grow(low: Array, high: Array, middle: Array) -> tuple[Indices, Array, Indices]:
    count = len(low)
    order = np.arange(count)
    most = 2 * count + 1
    boxes = np.empty((most, 6))
    spans = np.zeros((most, 3), np.int64)
    waiting = np.empty((DEPTH * 4, 3), np.int64)  # begin, end, whose second child this is
    waiting[0] = (0, count, -1)
    held, nodes = 1, 0
    while held:
        held -= 1
        begin, end, parent = waiting[held]
        node = nodes
        nodes += 1
        if parent >= 0:
            spans[parent, 2] = node
        box = boxes[node]
        box[:3], box[3:] = np.inf, -np.inf
        for i in order[begin:end]:
            for k in range(3):
                box[k] = min(box[k], low[i, k])
                box[3 + k] = max(box[3 + k], high[i, k])
        spans[node, 0], spans[node, 1] = begin, end
        if end - begin <= LEAF:
            continue
        axis = int(np.argmax(box[3:] - box[:3]))
        part = order[begin:end].copy()
        order[begin:end] = part[np.argsort(middle[part, axis])]
        half = (begin + end) // 2
        # The first child is taken off next, so that it comes right after its parent.
        waiting[held] = (half, end, node)
        waiting[held + 1] = (begin, half, -1)
        held += 2
    return order, boxes[:nodes].copy(), spans[:nodes].copy()


@nb.njit(cache=True, nogil=True, inline="always")
def _to_box(boxes: Array, node: int, p: Point) -> float:
    x = max(boxes[node, 0] - p[0], p[0] - boxes[node, 3], 0.0)
    y = max(boxes[node, 1] - p[1], p[1] - boxes[node, 4], 0.0)
    z = max(boxes[node, 2] - p[2], p[2] - boxes[node, 5], 0.0)
    return float(x * x + y * y + z * z)


@nb.njit(cache=True, nogil=True)
def on_triangle(a: Array, b: Array, c: Array, p: Point) -> Point:
    """The point of a triangle nearest to p (Ericson 2005, Real-Time Collision Detection, 5.1.5)."""
    abx, aby, abz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    acx, acy, acz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    apx, apy, apz = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    d1, d2 = abx * apx + aby * apy + abz * apz, acx * apx + acy * apy + acz * apz
    if d1 <= 0.0 and d2 <= 0.0:
        return a[0], a[1], a[2]
    bpx, bpy, bpz = p[0] - b[0], p[1] - b[1], p[2] - b[2]
    d3, d4 = abx * bpx + aby * bpy + abz * bpz, acx * bpx + acy * bpy + acz * bpz
    if d3 >= 0.0 and d4 <= d3:
        return b[0], b[1], b[2]
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and d1 > d3:
        s = d1 / (d1 - d3)
        return a[0] + s * abx, a[1] + s * aby, a[2] + s * abz
    cpx, cpy, cpz = p[0] - c[0], p[1] - c[1], p[2] - c[2]
    d5, d6 = abx * cpx + aby * cpy + abz * cpz, acx * cpx + acy * cpy + acz * cpz
    if d6 >= 0.0 and d5 <= d6:
        return c[0], c[1], c[2]
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0 and d2 > d6:
        s = d2 / (d2 - d6)
        return a[0] + s * acx, a[1] + s * acy, a[2] + s * acz
    va = d3 * d6 - d5 * d4
    along = (d4 - d3) + (d5 - d6)
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0 and along > 0.0:
        s = (d4 - d3) / along
        return b[0] + s * (c[0] - b[0]), b[1] + s * (c[1] - b[1]), b[2] + s * (c[2] - b[2])
    total = va + vb + vc
    if total == 0.0:
        return a[0], a[1], a[2]
    s, t = vb / total, vc / total
    return a[0] + abx * s + acx * t, a[1] + aby * s + acy * t, a[2] + abz * s + acz * t


@nb.njit(cache=True, nogil=True)
def facing_point(
    tree: FaceTree, p: Point, n: Point, reach: float, enough: float
) -> tuple[float, float, float, float]:
    """Distance and place of the nearest point within reach of a face that does not look against n.

    Faces without an area look no way and count for every n. The search ends at the first point within `enough`.
    Without any the distance is infinite.
    """
    best, x, y, z = reach * reach, 0.0, 0.0, 0.0
    found = False
    boxes, spans, order, normals, corners, stack = (
        tree.boxes,
        tree.spans,
        tree.order,
        tree.normals,
        tree.corners,
        tree.stack,
    )
    stack[0] = 0
    held = 1
    while held:
        held -= 1
        node = stack[held]
        if _to_box(boxes, node, p) > best:
            continue
        second = spans[node, 2]
        if second:
            near, far = node + 1, second
            if _to_box(boxes, far, p) < _to_box(boxes, near, p):
                near, far = far, near
            stack[held], stack[held + 1] = far, near
            held += 2
            continue
        for i in range(spans[node, 0], spans[node, 1]):
            f = order[i]
            if normals[f, 0] * n[0] + normals[f, 1] * n[1] + normals[f, 2] * n[2] < 0.0:
                continue
            qx, qy, qz = on_triangle(corners[f, 0], corners[f, 1], corners[f, 2], p)
            away = (p[0] - qx) ** 2 + (p[1] - qy) ** 2 + (p[2] - qz) ** 2
            if away <= best:
                best, x, y, z, found = away, qx, qy, qz, True
                if best <= enough * enough:
                    return np.sqrt(best), x, y, z
    return (np.sqrt(best) if found else np.inf), x, y, z
