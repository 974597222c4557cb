"""Protected zones: where an optimisation leaves a toolpath as it is (seed paper, Section 4.2, Figure 13).

A zone is a polygon in the frame of the layers, or a solid: then each layer is protected where its slicing plane cuts
the solid. A segment that a zone touches keeps both its ends, so that what lies in the zone is the same to the bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from operator import index
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
import trimesh

from twins.cutter import SurfaceCutter
from twins.errors import SurfaceError, ToolpathError
from twins.toolpath import Curve, Layer, Toolpath, read_only

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


class Zones:
    """Polygons, solids, and whole layers or curves that stay as they are."""

    def __init__(
        self,
        polygons: shapely.Geometry | Iterable[shapely.Geometry | npt.ArrayLike] = (),
        solids: trimesh.Trimesh | Iterable[trimesh.Trimesh] = (),
        layers: Iterable[int] = (),
        curves: Iterable[tuple[int, int]] = (),
    ) -> None:
        """Name what is protected.

        Args:
            polygons: in the (u, v) of every layer, mm: shapely polygons, or lists of corners, each of shape (n, 2).
            solids: closed meshes, oriented outwards, in world coordinates, mm.
            layers: indices of layers that stay as they are.
            curves: layer and index of curves that stay as they are.

        Raises:
            ToolpathError: a polygon is no list of corners, encloses no area or crosses itself; layers or curves are
                not numbers.
            SurfaceError: a solid is not closed.
        """
        self._polygons = [
            _polygon(i, polygon) for i, polygon in enumerate(_listed(polygons, shapely.Geometry, "polygons"))
        ]
        self._solids = []
        for i, solid in enumerate(_listed(solids, trimesh.Trimesh, "solids")):
            if not isinstance(solid, trimesh.Trimesh):
                raise SurfaceError(
                    f"protected solid {i} must be a trimesh.Trimesh, not a {type(solid).__name__}"
                )
            cutter = SurfaceCutter(solid.vertices, solid.faces)
            if not cutter.bounds_a_solid():
                raise SurfaceError(
                    f"protected solid {i} does not bound a volume; give a closed mesh with its normals outwards"
                )
            self._solids.append((cutter, np.array(solid.bounds)))
        try:
            self._layers = frozenset(index(i) for i in layers)
            self._curves = frozenset((index(i), index(j)) for i, j in curves)
        except (TypeError, ValueError):
            raise ToolpathError(
                "locked layers must be a list of indices and locked curves a list of pairs (layer, curve), not "
                f"{layers!r} and {curves!r}"
            ) from None

    def regions(self, toolpath: Toolpath) -> list[shapely.Geometry]:
        """What the polygons and solids cover in each layer, in its frame; empty where nothing.

        Raises:
            PlanesError: two slicing planes cross inside a solid.
        """
        drawn = shapely.union_all(self._polygons)
        cuts = [_cut(solid, toolpath) for solid, _ in self._solids]
        return [shapely.union_all([drawn, *(cut[i] for cut in cuts)]) for i in range(len(toolpath.layers))]

    def protected(self, toolpath: Toolpath) -> list[tuple[Flags, ...]]:
        """For each layer and curve, which points stay: shape (n,) as the curve's points.

        Raises:
            ToolpathError: a locked layer or curve does not exist.
            PlanesError: two slicing planes cross inside a solid.
        """
        self._check_locks(toolpath)
        flags = []
        for i, (layer, region) in enumerate(zip(toolpath.layers, self.regions(toolpath), strict=True)):
            shapely.prepare(region)
            flags.append(tuple(self._of_curve(i, j, layer, region) for j in range(len(layer.curves))))
        return flags

    def idle(self, toolpath: Toolpath) -> list[str]:
        """Zones that hold nothing, in words: no curve comes into them, mostly as they are elsewhere or in other units.

        Raises:
            ToolpathError: a locked layer or curve does not exist.
            PlanesError: two slicing planes cross inside a solid.
        """
        self._check_locks(toolpath)
        layers = toolpath.layers
        flat = [curve.points for *_, curve in toolpath.curves()]
        solid = [layer.slicing.to_world(curve.points) for *_, layer, curve in toolpath.curves()]
        said = [
            f"protected polygon {k} touches no curve: in the layers' frames it spans "
            f"{_span(shapely.bounds(polygon).reshape(2, 2))} mm, the curves {_span(*flat)} mm"
            for k, polygon in enumerate(self._polygons)
            if not _meets([polygon] * len(layers), toolpath)
        ]
        said += [
            f"protected solid {k} touches no curve: it spans {_span(bounds)} mm, the curves {_span(*solid)} mm"
            for k, (cutter, bounds) in enumerate(self._solids)
            if not _meets(_cut(cutter, toolpath), toolpath)
        ]
        return [
            *said,
            *(f"locked layer {i} has no curves" for i in sorted(self._layers) if not layers[i].curves),
        ]

    def _of_curve(self, i: int, j: int, layer: Layer, region: shapely.Geometry) -> Flags:
        curve = layer.curves[j]
        if i in self._layers or (i, j) in self._curves:
            return np.ones(len(curve.points), np.bool_)
        return _touched(curve, region)

    def _check_locks(self, toolpath: Toolpath) -> None:
        count = len(toolpath.layers)
        for i in [*self._layers, *(i for i, _ in self._curves)]:
            if not 0 <= i < count:
                raise ToolpathError(
                    f"layer {i} cannot be locked: the toolpath has layers 0 to {count - 1}"
                    if count
                    else f"layer {i} cannot be locked: the toolpath has no layers"
                )
        for i, j in self._curves:
            if not 0 <= j < len(toolpath.layers[i].curves):
                raise ToolpathError(
                    f"curve {j} of layer {i} cannot be locked: the layer has {len(toolpath.layers[i].curves)} curves"
                )


def _listed(given: Any, single: type, what: str) -> list[Any]:
    """A list of zones, or of the one that was given without a list."""
    if isinstance(given, single):
        return [given]
    try:
        return list(given)
    except TypeError:
        raise ToolpathError(f"protected {what} must be a list, not a {type(given).__name__}") from None


def _polygon(number: int, given: shapely.Geometry | npt.ArrayLike) -> shapely.Geometry:
    name = f"protected polygon {number}"
    if isinstance(given, shapely.Geometry):
        polygon = given
        if not isinstance(polygon, shapely.Polygon | shapely.MultiPolygon):
            raise ToolpathError(f"{name} must be a Polygon or a MultiPolygon, not a {type(polygon).__name__}")
    else:
        try:
            corners = read_only(given, (None, 2), f"the corners of {name}")
        except ToolpathError as error:
            raise ToolpathError(
                f"{error}; give a list of polygons, each a list of corners [u, v] in mm"
            ) from None
        if len(corners) < 3:
            raise ToolpathError(f"{name} needs at least 3 corners, not {len(corners)}")
        polygon = shapely.Polygon(corners)
    if not polygon.is_valid:
        raise ToolpathError(
            f"{name} is no simple polygon: {shapely.is_valid_reason(polygon)}; give its corners in order"
        )
    if not polygon.area > 0:
        raise ToolpathError(f"{name} encloses no area")
    return polygon


def _cut(solid: SurfaceCutter, toolpath: Toolpath) -> list[shapely.Geometry]:
    """What a solid covers in each layer."""
    return [_enclosed(loops) for loops in solid.cut([layer.slicing for layer in toolpath.layers])]


def _span(*points: Array) -> str:
    """The box around points, in words."""
    if not points:
        return "nothing"
    ends = [extreme(np.concatenate(points), axis=0) for extreme in (np.min, np.max)]
    return " to ".join(f"({', '.join(f'{value:.6g}' for value in end)})" for end in ends)


def _meets(regions: Sequence[shapely.Geometry], toolpath: Toolpath) -> bool:
    """Whether a curve of any layer comes into the region there."""
    return any(
        _touched(curve, region).any()
        for layer, region in zip(toolpath.layers, regions, strict=True)
        for curve in layer.curves
    )


def _enclosed(loops: Sequence[Array]) -> shapely.Geometry:
    """The region on the left of closed polygons of one plane: where they wind around an odd number of times."""
    region: shapely.Geometry = shapely.Polygon()
    for loop in loops:
        if len(loop) >= 3:
            region = shapely.symmetric_difference(region, shapely.make_valid(shapely.Polygon(loop)))
    return region


def _touched(curve: Curve, region: shapely.Geometry) -> Flags:
    """Ends of the segments that a region touches."""
    flags = np.zeros(len(curve.points), np.bool_)
    if shapely.is_empty(region):
        return flags
    ends = np.roll(curve.points, -1, axis=0)
    count = len(flags) if curve.closed else len(flags) - 1
    meets = shapely.intersects(
        region, shapely.linestrings(np.stack([curve.points[:count], ends[:count]], axis=1))
    )
    touched = np.flatnonzero(meets)
    flags[touched] = True
    flags[(touched + 1) % len(flags)] = True
    return flags
