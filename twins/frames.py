"""Frames: the map between layer coordinates (u, v, w) and the world.

(u, v) are coordinates in a plane's frame and w counts layers: at w = k t lie the base and the nozzle planes, at
w = (k + 1/2) t the slicing planes. In between, frames are blended, so that every w has an affine frame of its own, in a
plane of the same pencil where layers are rotary.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .toolpath import Plane

Array = npt.NDArray[np.float64]


class Frames:
    """The affine frames of a toolpath's layers, by w in mm at the nominal thickness."""

    def __init__(self, planes: Sequence[Plane], step: float) -> None:
        """From the base, then each layer's slicing and nozzle plane; `step` is half the nominal thickness, mm."""
        self._rows = np.array([[plane.origin, plane.x_axis, plane.y_axis] for plane in planes])
        self._step = step

    @property
    def thickness(self) -> float:
        """Nominal, mm."""
        return 2.0 * self._step

    @property
    def top(self) -> float:
        """w of the last nozzle plane."""
        return (len(self._rows) - 1) * self._step

    @property
    def slicing(self) -> Array:
        """w of the slicing planes, shape (layers,)."""
        return np.asarray(np.arange(1, len(self._rows), 2) * self._step, dtype=np.float64)

    def at(self, w: npt.ArrayLike) -> Array:
        """Origin, u axis and v axis at heights w, shape (n, 3, 3); a point is origin + u u_axis + v v_axis."""
        level = np.atleast_1d(np.asarray(w, dtype=np.float64)) / self._step
        low = np.clip(np.floor(level + 1e-9).astype(np.int64), 0, len(self._rows) - 2)
        share = level - low
        share = np.where(np.abs(share) < 1e-9, 0.0, share)[:, None, None]
        return np.asarray((1.0 - share) * self._rows[low] + share * self._rows[low + 1], dtype=np.float64)

    def to_world(self, points: Array) -> Array:
        """World places of points (u, v, w), shape (n, 3), mm."""
        if len(points) and (points[:, 2] == points[0, 2]).all():
            origin, u_axis, v_axis = self.at(points[0, 2])[0]
            return np.asarray(origin + points[:, :1] * u_axis + points[:, 1:2] * v_axis, dtype=np.float64)
        rows = self.at(points[:, 2])
        return np.asarray(
            rows[:, 0] + points[:, :1] * rows[:, 1] + points[:, 1:2] * rows[:, 2], dtype=np.float64
        )

    def height_of(self, places: Array) -> Array:
        """w of world places, shape (n, 3), that lie between the first and the last plane; beyond, extrapolated."""
        normals = np.cross(self._rows[:, 1], self._rows[:, 2])
        low = np.zeros(len(places), np.int64)
        high = np.full(len(places), len(self._rows) - 1)
        while (high - low > 1).any():
            middle = (low + high) // 2
            above = np.einsum("nk,nk->n", places - self._rows[middle, 0], normals[middle]) >= 0.0
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        share = np.full(len(places), 0.5)
        origin, step = self._rows[low, 0], self._rows[low + 1, 0] - self._rows[low, 0]
        for _ in range(4):  # the blended normal hardly depends on the share: a few rounds settle it
            axes = (1.0 - share)[:, None, None] * self._rows[low, 1:] + share[:, None, None] * self._rows[
                low + 1, 1:
            ]
            normal = np.cross(axes[:, 0], axes[:, 1])
            along = np.einsum("nk,nk->n", step, normal)
            share = np.einsum("nk,nk->n", places - origin, normal) / np.where(along == 0.0, 1.0, along)
        return np.asarray((low + share) * self._step, dtype=np.float64)
