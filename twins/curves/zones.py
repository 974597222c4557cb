"""Protected zones: where an optimisation leaves a toolpath as it is (seed paper, Section 4.2, Figure 13).

A zone is a polygon in the frame of the layers, or a solid: then each layer is protected where its slicing plane cuts
the solid. A segment that a zone touches keeps both its ends, so that what lies in the zone is the same to the bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt
import shapely
import trimesh

from twins.cutter import SurfaceCutter
from twins.errors import SurfaceError, ToolpathError
from twins.toolpath import Curve, Layer, Toolpath

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


class Zones:
    """Polygons, solids, and whole layers or curves that stay as they are."""

    def __init__(
        self,
        polygons: Iterable[shapely.Polygon | shapely.MultiPolygon | npt.ArrayLike] = (),
        solids: Iterable[trimesh.Trimesh] = (),
        layers: Iterable[int] = (),
        curves: Iterable[tuple[int, int]] = (),
    ) -> None:
        """Name what is protected.

        Args:
            polygons: in the (u, v) of every layer, mm: shapely polygons, or corners of shape (n, 2).
            solids: closed meshes, oriented outwards, in world coordinates, mm.
            layers: indices of layers that stay as they are.
            curves: layer and index of curves that stay as they are.

        Raises:
            ToolpathError: a polygon encloses no area or crosses itself.
            SurfaceError: a solid is not closed.
        """
        self._polygons = shapely.union_all([_polygon(i, polygon) for i, polygon in enumerate(polygons)])
        self._solids = []
        for i, solid in enumerate(solids):
            cutter = SurfaceCutter(solid.vertices, solid.faces)
            if not cutter.bounds_a_solid():
                raise SurfaceError(
                    f"protected solid {i} does not bound a volume; give a closed mesh with its normals outwards"
                )
            self._solids.append(cutter)
        self._layers = frozenset(layers)
        self._curves = frozenset(curves)

    def regions(self, toolpath: Toolpath) -> list[shapely.Geometry]:
        """What the polygons and solids cover in each layer, in its frame; empty where nothing.

        Raises:
            PlanesError: two slicing planes cross inside a solid.
        """
        covered: list[list[shapely.Geometry]] = [[self._polygons] for _ in toolpath.layers]
        planes = [layer.slicing for layer in toolpath.layers]
        for solid in self._solids:
            for parts, loops in zip(covered, solid.cut(planes), strict=True):
                parts.append(_enclosed(loops))
        return [shapely.union_all(parts) for parts in covered]

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


def _polygon(index: int, given: shapely.Polygon | shapely.MultiPolygon | npt.ArrayLike) -> shapely.Geometry:
    if isinstance(given, shapely.Geometry):
        polygon = given
    else:
        corners = np.asarray(given, dtype=np.float64)
        if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3 or not np.isfinite(corners).all():
            raise ToolpathError(
                f"protected polygon {index} needs finite corners of shape (n, 2), n >= 3, not {corners.shape}"
            )
        polygon = shapely.Polygon(corners)
    if not isinstance(polygon, shapely.Polygon | shapely.MultiPolygon) or not polygon.is_valid:
        raise ToolpathError(
            f"protected polygon {index} is no simple polygon: {shapely.is_valid_reason(polygon)}; give its corners "
            "in order"
        )
    if not polygon.area > 0:
        raise ToolpathError(f"protected polygon {index} encloses no area")
    return polygon


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
