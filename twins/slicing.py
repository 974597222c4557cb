"""Slicing: a surface becomes a toolpath (seed paper, Section 2.1).

The surface is cut (`cutter.py`) and the polygons are sampled (`sampling.py`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import trimesh

from .cutter import SurfaceCutter
from .entrances import checks_kinds
from .errors import PlanesError, ToolpathError
from .planes import PlaneStack
from .sampling import sample_layer_reporting
from .surface import check_surface
from .toolpath import FAR, Curve, Layer, Plane, Toolpath
from .triangulation import Lattice, triangulate

Array = npt.NDArray[np.float64]


BEYOND = 1e-3
"""How far a part may reach beyond its planes unsaid, as a share of the thickness: rounding of file formats."""

LOWERED = (1e-6, 1e-5, 1e-4, 1e-3)
"""How far below its plane a layer is cut whose curves touch themselves there, as shares of the thickness."""


@checks_kinds
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
        PlanesError: the axis of a rotary stack does not clear the part, slicing planes cross inside it, or none meets
            it.
    """
    return slice_reporting(surface, planes, resolution)[0]


@checks_kinds
def slice_reporting(
    surface: trimesh.Trimesh,
    planes: PlaneStack,
    resolution: float | None = None,
    numbers: Sequence[int] | None = None,
) -> tuple[Toolpath, list[str]]:
    """`slice_surface`, and a sentence for each loop that is too small to be a curve and for each plane that was moved.

    Where a slicing plane passes through a saddle of the surface, the curves touch there. A vertex in the plane counts
    as above it, so the layer is cut a trifle lower, where they are apart. `numbers` names the layers where the planes
    are some of a longer stack.
    """
    cutter = SurfaceCutter(surface.vertices, surface.faces)
    if not cutter.bounds_a_solid():
        check_surface(surface)
    check_resolution(resolution)
    _check_axis(surface, planes)
    step = planes.thickness if resolution is None else float(resolution)
    said: list[str] = []
    layers = []
    if numbers is None:
        said += _beyond(surface, planes)
        numbers = range(len(planes))
    grazed = set(cutter.grazed(planes.slicing, LOWERED[-1] * planes.thickness))
    stack = cutter.cut(planes.slicing)
    for i, (polygons, slicing, nozzle) in enumerate(zip(stack, planes.slicing, planes.nozzle, strict=True)):
        curves, dropped = sample_layer_reporting(polygons, step)
        if i in grazed and not _bound_a_region(curves, step):
            for share in LOWERED:
                lower = Plane(
                    slicing.origin - share * planes.thickness * slicing.normal, slicing.x_axis, slicing.y_axis
                )
                apart, fewer = sample_layer_reporting(cutter.cut([lower])[0], step)
                if _bound_a_region(apart, step):
                    curves, dropped = apart, fewer
                    by = share * planes.thickness
                    said.append(
                        f"layer {numbers[i]} is cut {by:.2g} mm below its plane, where its curves touch"
                    )
                    break
        said += [f"layer {numbers[i]}: {loop}" for loop in dropped]
        layers.append(Layer(slicing, nozzle, tuple(Curve(points) for points in curves)))
    return Toolpath(planes.base, tuple(layers), planes.thickness), said


def check_resolution(resolution: object) -> None:
    """Refuse a distance L_R of sample points that is none.

    Raises:
        PlanesError: it is neither None nor a number above 0.
    """
    if resolution is not None and not (
        isinstance(resolution, int | float | np.number) and 0 < float(resolution) <= FAR
    ):
        raise PlanesError(f"the resolution must be a number of mm above 0, not {resolution!r}")


def _beyond(surface: trimesh.Trimesh, planes: PlaneStack) -> list[str]:
    """What of a part lies below the bed or above the last plane, and so in no layer.

    Raises:
        PlanesError: all of it.
    """
    vertices = np.asarray(surface.vertices)
    under, over = planes.base.height_of(vertices), planes.nozzle[-1].height_of(vertices)
    if not len(vertices) or under.max() <= 0.0 or over.min() >= 0.0:
        low, high = (vertices.min(axis=0), vertices.max(axis=0)) if len(vertices) else (0.0, 0.0)
        raise PlanesError(
            f"no layer meets the part, which reaches from {np.round(low, 3)} to {np.round(high, 3)} mm; "
            "set it down between bed and top plane"
        )
    if planes.slicing[0].height_of(vertices).max() < 0.0:
        raise PlanesError(
            f"the part reaches only {under.max():.4g} mm above the bed, below the middle of the first layer of "
            f"{planes.thickness:.4g} mm; use thinner layers, and check its unit: lengths are in mm"
        )
    said = []
    for name, beyond in (("below the bed", -float(under.min())), ("above the top plane", float(over.max()))):
        if beyond > BEYOND * planes.thickness:
            said.append(f"the part reaches {beyond:.4g} mm {name}; what is there is in no layer")
    return said


def _bound_a_region(curves: Sequence[Array], resolution: float) -> bool:
    if not curves:
        return True
    points = np.concatenate(curves)
    try:
        triangulate(curves, Lattice.around(points.min(axis=0), points.max(axis=0)), resolution, "")
    except ToolpathError:
        return False
    return True


def cut(surface: trimesh.Trimesh, planes: PlaneStack) -> list[list[Array]]:
    """The polygons in which each slicing plane cuts a surface: closed, interior left, shape (n, 2) in plane frames.

    Raises:
        SurfaceError: the mesh is not closed or not consistently oriented.
        PlanesError: two planes cross inside the part.
    """
    return SurfaceCutter(surface.vertices, surface.faces).cut(planes.slicing)


def _check_axis(surface: trimesh.Trimesh, planes: PlaneStack) -> None:
    """A fan opens on one side of its axis: the part must lie there, where the bed's origin is."""
    axis = planes.axis
    if axis is None:
        return
    outward = planes.base.origin - axis.point
    outward = outward / np.linalg.norm(outward)
    vertices = np.asarray(surface.vertices)
    if float((vertices @ outward).min()) <= float(axis.point @ outward):
        offset = vertices - axis.point
        offset = offset - np.outer(offset @ axis.direction, axis.direction)
        distance = float(np.linalg.norm(offset, axis=1).min())
        raise PlanesError(
            f"the axis in which bed and top plane meet does not clear the part: it is "
            f"{axis.radius:.6g} mm from the bed's origin and {distance:.6g} mm from the part's nearest "
            "vertex, and some of the part lies beyond it; tilt the top plane less or the other way, or move it up"
        )
