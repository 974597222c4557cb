"""Edits of whole toolpaths: layers joined and split, parts moved, rotated, scaled and mirrored, curves reordered.

Planes move along with the part, so a toolpath that was printable on its planes still is. Curves that an edit does
not touch stay the same objects.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.toolpath import FAR, Array, Curve, Layer, Plane, Toolpath, read_only

from .outlines import turned_round, with_curves, with_layers

SAME_PLANE = 1e-4
"""Planes this near to one another are the same, mm; over a metre."""


@checks_kinds
def join_layers(lower: Toolpath, *upper: Toolpath) -> Toolpath:
    """One toolpath of the layers of several, from the bottom up.

    Each stands on the one before it: its base is the plane of the last nozzle plane there. The frame of its planes
    is turned and shifted in the plane to follow on the frame below; in the world nothing moves. The nominal
    thickness is the mean over all layers.

    Raises:
        ToolpathError: a base that is another plane than the top below it; names the layer.
    """
    joined = lower
    for part in upper:
        if not joined.layers:
            joined = part
            continue
        top = joined.layers[-1].nozzle
        corners = top.to_world(np.array([[0.0, 0.0], [1e3, 0.0], [0.0, 1e3]]))
        off = float(np.abs(part.base.height_of(corners)).max())
        if off > SAME_PLANE or float(part.base.normal @ top.normal) < 0:
            raise ToolpathError(
                f"the base of the upper toolpath is not the nozzle plane of layer {len(joined.layers) - 1} below it: "
                f"they are up to {off:.6g} mm apart within a metre; move it there"
            )
        count = len(joined.layers) + len(part.layers)
        layers = (*joined.layers, *_following(part, top))
        total = joined.thickness * len(joined.layers) + part.thickness * len(part.layers)
        thickness = joined.thickness if part.thickness == joined.thickness else total / count
        joined = Toolpath(joined.base, layers, thickness)
    return joined


def _following(toolpath: Toolpath, below: Plane) -> tuple[Layer, ...]:
    """The layers, their frames turned in their planes as the base's must be to become the frame `below`."""
    origin = below.to_frame(toolpath.base.origin[None])[0, :2]
    turn = below.rotation.T @ toolpath.base.rotation
    R = turn[:2, :2]
    if np.abs(origin).max() <= 1e-9 and np.abs(R - np.eye(2)).max() <= 1e-12:
        return toolpath.layers

    def plane(old: Plane) -> Plane:
        x, y = (old.rotation[:, :2] @ R.T).T
        return Plane(old.origin - origin[0] * x - origin[1] * y, x, y)

    return tuple(
        Layer(
            plane(layer.slicing),
            plane(layer.nozzle),
            tuple(replace(curve, points=curve.points @ R.T + origin) for curve in layer.curves),
        )
        for layer in toolpath.layers
    )


@checks_kinds
def split_layers(toolpath: Toolpath, at: int | Sequence[int]) -> tuple[Toolpath, ...]:
    """Parts of a toolpath from the bottom up, each of which stands on the nozzle plane below it.

    Args:
        toolpath: to be split.
        at: the layers with which a new part begins.

    Raises:
        ToolpathError: a number that is not that of a layer above the first, or numbers that do not ascend.
    """
    numbers = np.atleast_1d(np.asarray(at))
    starts = numbers.tolist()
    count = len(toolpath.layers)
    if (
        (starts and numbers.dtype.kind not in "iu")
        or any(not 0 < i < count for i in starts)
        or any(a >= b for a, b in pairwise(starts))
    ):
        raise ToolpathError(
            f"a toolpath of {count} layers is split at ascending layers from 1 to {count - 1}, not {starts}"
        )
    return tuple(
        Toolpath(toolpath.floor_of(i), toolpath.layers[i:j], toolpath.thickness)
        for i, j in zip([0, *starts], [*starts, count], strict=True)
    )


@checks_kinds
def move(toolpath: Toolpath, by: npt.ArrayLike) -> Toolpath:
    """The toolpath moved by a vector, shape (3,), mm; curves are the same objects, only planes move."""
    vector = read_only(by, (3,), "the vector by which a toolpath is moved")
    return _placed(toolpath, lambda plane: Plane(plane.origin + vector, plane.x_axis, plane.y_axis))


@checks_kinds
def rotate(toolpath: Toolpath, rotation: npt.ArrayLike, about: npt.ArrayLike = (0.0, 0.0, 0.0)) -> Toolpath:
    """The toolpath rotated about a point; curves are the same objects, only planes turn.

    Args:
        toolpath: to be rotated.
        rotation: matrix, shape (3, 3), e.g. `scipy.spatial.transform.Rotation.as_matrix()`.
        about: shape (3,), mm.

    Raises:
        ToolpathError: the matrix is no rotation.
    """
    R = read_only(rotation, (3, 3), "a rotation")
    center = read_only(about, (3,), "the point that a toolpath is rotated about")
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0:
        raise ToolpathError(
            "a rotation needs a matrix with orthonormal rows and determinant 1; use `mirror`, `scale`"
        )
    return _placed(
        toolpath,
        lambda plane: Plane(center + R @ (plane.origin - center), R @ plane.x_axis, R @ plane.y_axis),
    )


@checks_kinds
def scale(toolpath: Toolpath, factor: float, about: npt.ArrayLike = (0.0, 0.0, 0.0)) -> Toolpath:
    """The toolpath enlarged about a point, shape (3,), mm: layers grow thicker, beads wider and curves longer alike."""
    if not 0 < factor <= FAR:
        raise ToolpathError(f"a toolpath is scaled by a factor above 0, not {factor}")
    center = read_only(about, (3,), "the point that a toolpath is scaled about")

    def plane(old: Plane) -> Plane:
        return Plane(center + factor * (old.origin - center), old.x_axis, old.y_axis)

    def curve(old: Curve) -> Curve:
        width = None if old.width is None else factor * old.width
        return Curve(factor * old.points, old.closed, width)

    scaled = _placed(toolpath, plane, curve)
    return replace(scaled, thickness=factor * toolpath.thickness)


@checks_kinds
def mirror(toolpath: Toolpath, plane: Plane) -> Toolpath:
    """The toolpath mirrored in a plane; its curves run the other way, so that the interior stays on the left.

    Closed curves still begin at their first points. Build directions are mirrored too: a plane that is not upright
    turns them down or sideways.
    """
    n = plane.normal

    def turned(vector: Array) -> Array:
        return np.asarray(vector - 2.0 * (vector @ n) * n, dtype=np.float64)

    def mirrored(old: Plane) -> Plane:
        # A mirrored frame is left-handed: its y axis is turned round.
        return Plane(
            plane.origin + turned(old.origin - plane.origin), turned(old.x_axis), -turned(old.y_axis)
        )

    def curve(old: Curve) -> Curve:
        return turned_round(replace(old, points=old.points * np.array([1.0, -1.0])))

    return _placed(toolpath, mirrored, curve)


@checks_kinds
def reverse(toolpath: Toolpath, only: Callable[[int, int, Curve], bool] | None = None) -> Toolpath:
    """Curves run the other way: all, or those for which `only` of layer, index and curve is true.

    A closed curve still begins at its first point. Its interior is then on the right: reconstruct before.
    """
    layers = [
        with_curves(
            layer,
            [
                turned_round(curve) if only is None or only(i, j, curve) else curve
                for j, curve in enumerate(layer.curves)
            ],
        )
        for i, layer in enumerate(toolpath.layers)
    ]
    return with_layers(toolpath, layers)


@checks_kinds
def reorder(toolpath: Toolpath, layer: int, order: Sequence[int]) -> Toolpath:
    """The toolpath with the curves of one layer in another order.

    Args:
        toolpath: to be changed.
        layer: index.
        order: each index of the layer's curves once.

    Raises:
        ToolpathError: no such layer, or an order that leaves out or repeats a curve.
    """
    if not 0 <= layer < len(toolpath.layers):
        raise ToolpathError(f"there is no layer {layer}: the toolpath has {len(toolpath.layers)}")
    old = toolpath.layers[layer]
    if sorted(order) != list(range(len(old.curves))):
        raise ToolpathError(
            f"layer {layer}: an order must name each of its {len(old.curves)} curves once, not {list(order)}"
        )
    layers = list(toolpath.layers)
    layers[layer] = with_curves(old, [old.curves[j] for j in order])
    return with_layers(toolpath, layers)


def _placed(
    toolpath: Toolpath, plane: Callable[[Plane], Plane], curve: Callable[[Curve], Curve] | None = None
) -> Toolpath:
    layers = tuple(
        Layer(
            plane(layer.slicing),
            plane(layer.nozzle),
            layer.curves if curve is None else tuple(map(curve, layer.curves)),
        )
        for layer in toolpath.layers
    )
    return Toolpath(plane(toolpath.base), layers, toolpath.thickness)
