"""What counts in overhang relaxation: the public measure, of the faces that are not locked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from twins.planes import PlaneStack

from .cotangent import face_edges
from .energy import normal_energy
from .surfaces import ON_TOP, build_directions, flat_tops, on_bed

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

UP = np.array([0.0, 0.0, 1.0])
"""Build direction where there are no planes."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """How a surface stands.

    Attributes:
        angle: of overhang of each face, rad, shape (m,), as `normal_energy` gives it.
        counted: faces that count, shape (m,).
        pulled: those of them that are no ledges, shape (m,).
        tops: faces of flat tops, with both sides counted, shape (m,).
        area: of the faces that count, mm².
        over, over_pulled: area over the limit of those that count, and of those that are pulled, mm².
        worst: greatest angle of those that count, rad, or 0.
    """

    angle: Array
    counted: Flags
    pulled: Flags
    tops: Flags
    area: float
    over: float
    over_pulled: float
    worst: float


class Judge:
    """What counts as overhang, and how much of it there is: `surface_overhang` of the faces that are not locked.

    Ledges, faces that look straight up below the highest layer plane, count but are not pulled: to be steep a floor
    would have to become a spire.
    """

    def __init__(
        self,
        vertices: Array,
        faces: Faces,
        fixed: Flags,
        planes: PlaneStack | None,
        limit: float,
        both: bool,
    ) -> None:
        """Judge faces (m, 3) of vertices (n, 3), of which some are fixed (n,), by a limit in rad."""
        self.faces, self.planes, self.limit, self.both = faces, planes, limit, both
        self._loose = ~fixed[faces].all(axis=1)
        edges = face_edges(vertices, faces)
        normals = np.cross(edges[:, 0], edges[:, 1])
        rise = np.einsum("ij,ij->i", normals, self.up(vertices))
        self._ledge = both & (rise > (1.0 - ON_TOP) * np.linalg.norm(normals, axis=1))

    def up(self, vertices: Array) -> Array:
        """Build direction at the middle of each face, shape (m, 3)."""
        if self.planes is None:
            return np.tile(UP, (len(self.faces), 1))
        return build_directions(vertices[self.faces].mean(axis=1), self.planes)

    def __call__(self, vertices: Array) -> Verdict:
        """The verdict on vertices (n, 3)."""
        angle, area = np.empty(len(self.faces)), np.empty(len(self.faces))
        up, unused = self.up(vertices), np.zeros(len(self.faces))
        normal_energy(
            vertices, self.faces, unused, up, unused, self.both, np.zeros_like(vertices), angle, area
        )
        tops = np.zeros(len(self.faces), dtype=bool)
        if self.both:
            tops = flat_tops(vertices, self.faces, np.sin(angle), self.planes, UP)
        counted = self._loose & ~tops & ~on_bed(vertices, self.faces, self.planes, UP)
        pulled = counted & ~self._ledge
        beyond = np.where(angle > self.limit + 1e-9, area, 0.0)
        return Verdict(
            angle,
            counted,
            pulled,
            tops,
            area=float(area[counted].sum()),
            over=float(beyond[counted].sum()),
            over_pulled=float(beyond[pulled].sum()),
            worst=float(angle[counted].max(initial=0.0)),
        )
