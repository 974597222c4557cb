"""Twin: a surface and its toolpath, kept in step (seed paper, Section 2).

One of the two was edited last; the other follows from it when it is asked for. What an edit does not touch is
not built again, and the result is the one that building everything again would give.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import Literal

import numpy as np
import numpy.typing as npt
import trimesh

from .cutter import SurfaceCutter
from .errors import ToolpathError
from .memo import Memo
from .planes import PlaneStack
from .reconstruction import ToolpathMesh, toolpath_mesh
from .slicing import check_resolution, slice_reporting
from .surface import check_surface
from .toolpath import Curve, Layer, Toolpath

Array = npt.NDArray[np.float64]


class Twin:
    """A surface and its toolpath."""

    def __init__(
        self,
        surface: trimesh.Trimesh,
        planes: PlaneStack,
        resolution: float | None = None,
        executor: Executor | None = None,
    ) -> None:
        """Begin with a surface.

        Args:
            surface: closed, oriented outwards, mm.
            planes: that slice it.
            resolution: L_R, mm; default the layer thickness.
            executor: works on layers side by side.

        Raises:
            SurfaceError: the mesh does not bound a solid.
            PlanesError: planes that cross inside the part.
        """
        toolpath, remarks = slice_reporting(surface, planes, resolution)
        # The twin keeps a copy, since meshes are edited in place.
        self._begin(toolpath, surface.copy(), planes, resolution, executor, remarks)

    @classmethod
    def from_toolpath(
        cls, toolpath: Toolpath, resolution: float | None = None, executor: Executor | None = None
    ) -> Twin:
        """Begin with a toolpath of closed curves.

        Args:
            toolpath: interior left.
            resolution: L_R, mm; default the layer thickness.
            executor: works on layers side by side.

        Raises:
            PlanesError: the resolution is not above 0.
        """
        check_resolution(resolution)
        twin = cls.__new__(cls)
        twin._begin(toolpath, None, None, resolution, executor)  # noqa: SLF001 - a second constructor
        return twin

    def _begin(
        self,
        toolpath: Toolpath,
        surface: trimesh.Trimesh | None,
        planes: PlaneStack | None,
        resolution: float | None,
        executor: Executor | None,
        remarks: Sequence[str] = (),
    ) -> None:
        self._remarks = remarks
        self._toolpath = toolpath
        self._source = surface
        self._planes = planes
        self._resolution = resolution
        self._executor = executor
        self._edited: frozenset[int] = frozenset()
        self._memo = Memo()
        self._mesh: ToolpathMesh | None = None

    @property
    def edited_last(self) -> Literal["surface", "toolpath"]:
        """Which side the other follows from."""
        return "surface" if self._source is not None and not self._edited else "toolpath"

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the last slicing had to say: loops too small to be curves, planes moved off a saddle."""
        return tuple(self._remarks)

    @property
    def toolpath(self) -> Toolpath:
        """The toolpath, in step with the surface."""
        return self._toolpath

    @property
    def surface(self) -> trimesh.Trimesh:
        """A copy of the surface given or, once the toolpath is edited, of M; `replace_surface` takes edits back."""
        if self._source is not None and not self._edited:
            return self._source.copy()
        return self.mesh.surface.copy()

    @property
    def mesh(self) -> ToolpathMesh:
        """The toolpath mesh M of the present toolpath, refined by the surface where no layer beside was edited."""
        if self._mesh is None:
            self._mesh = toolpath_mesh(
                self._toolpath,
                self._resolution,
                self._source,
                edited=self._edited,
                memo=self._memo,
                executor=self._executor,
            )
        return self._mesh

    def replace_layer(self, index: int, curves: Sequence[Curve]) -> None:
        """Give a layer other curves; see `replace_layers`."""
        self.replace_layers({index: curves})

    def replace_layers(self, curves: Mapping[int, Sequence[Curve]]) -> None:
        """Give layers other curves.

        Args:
            curves: the new ones, closed, interior left, for each layer's index.

        Raises:
            ToolpathError: there is no such layer, or no M through the curves: then nothing has changed.
        """
        layers = list(self._toolpath.layers)
        for index, new in curves.items():
            if (
                isinstance(index, bool)
                or not isinstance(index, int | np.integer)
                or not 0 <= index < len(layers)
            ):
                raise ToolpathError(
                    f"there is no layer {index}: the toolpath has layers 0 to {len(layers) - 1}"
                )
            if isinstance(new, Curve) or not all(isinstance(curve, Curve) for curve in new):
                raise ToolpathError(
                    f"layer {index}: give a list of Curve objects, each made of (n, 2) points"
                )
            layers[index] = Layer(layers[index].slicing, layers[index].nozzle, tuple(new))
        before = self._toolpath, self._edited, self._mesh
        self._toolpath = replace(self._toolpath, layers=tuple(layers))
        self._edited = self._edited | frozenset(int(index) for index in curves)
        self._mesh = None
        try:
            _ = self.mesh
        except BaseException:
            self._toolpath, self._edited, self._mesh = before
            raise

    def replace_surface(self, surface: trimesh.Trimesh, planes: PlaneStack | None = None) -> frozenset[int]:
        """Give the twin another surface; only layers that the change touches are sliced again.

        Args:
            surface: closed, oriented outwards, mm.
            planes: other planes; needed for a twin that began with a toolpath.

        Returns:
            the layers that were sliced again.

        Raises:
            SurfaceError, PlanesError: as on slicing; then nothing has changed.
            ToolpathError: planes are missing.
        """
        stack = self._planes if planes is None else planes
        if stack is None:
            raise ToolpathError("this twin began with a toolpath: give the planes that slice the new surface")
        if not SurfaceCutter(surface.vertices, surface.faces).bounds_a_solid():
            check_surface(surface)
        surface = surface.copy()  # the caller may go on editing theirs
        touched = frozenset(range(len(stack)))
        if planes is None and self._source is not None:
            touched = _touched_layers(self._source, surface, stack) | self._edited
        if touched:
            some = sorted(touched)
            part = replace(
                stack,
                slicing=tuple(stack.slicing[i] for i in some),
                nozzle=tuple(stack.nozzle[i] for i in some),
            )
            sliced, remarks = slice_reporting(surface, part, self._resolution, some)
            self._remarks = remarks
            if len(some) == len(stack):
                self._toolpath = sliced
            else:
                layers = list(self._toolpath.layers)
                for i, layer in zip(some, sliced.layers, strict=True):
                    layers[i] = layer
                self._toolpath = replace(self._toolpath, layers=tuple(layers))
        self._source, self._planes, self._edited, self._mesh = surface, stack, frozenset(), None
        return touched


def _touched_layers(old: trimesh.Trimesh, new: trimesh.Trimesh, planes: PlaneStack) -> frozenset[int]:
    """Layers whose slicing plane meets a face that differs between two surfaces."""
    changed = [_faces_apart(old, new), _faces_apart(new, old)]
    touched: set[int] = set()
    for corners in changed:
        if not len(corners):
            continue
        flat = corners.reshape(-1, 3)
        for i, plane in enumerate(planes.slicing):
            above = (plane.height_of(flat) >= 0.0).reshape(-1, 3)
            if (above.any(axis=1) & ~above.all(axis=1)).any():
                touched.add(i)
    return frozenset(touched)


def _faces_apart(these: trimesh.Trimesh, those: trimesh.Trimesh) -> Array:
    """Corners of the faces of one surface that the other has not, shape (k, 3, 3)."""
    mine, theirs = _rows(these), _rows(those)
    apart = ~np.isin(mine, theirs)
    return np.asarray(np.asarray(these.vertices)[np.asarray(these.faces)[apart]], dtype=np.float64)


def _rows(surface: trimesh.Trimesh) -> npt.NDArray[np.void]:
    """Each face as one value: its corners' coordinates, beginning with the least corner."""
    vertices, faces = np.asarray(surface.vertices, dtype=np.float64), np.asarray(surface.faces)
    order = np.lexsort(vertices.T[::-1])
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    least = np.argmin(rank[faces], axis=1)
    turned = np.take_along_axis(faces, (least[:, None] + np.arange(3)) % 3, axis=1)
    rows = np.ascontiguousarray(vertices[turned].reshape(len(faces), 9) + 0.0)
    return rows.view(np.dtype((np.void, rows.dtype.itemsize * 9))).ravel()
