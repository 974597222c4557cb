"""Floors: the planes that layers are printed on, where curves say how far below them those are.

Heights along a plane curve rise evenly across its plane, as they are distances from another plane. In the plane of
the nozzle they tell it at once: their slope is the sine of the angle between the two. A slicing plane lies halfway,
at half that angle.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from twins.errors import PlanesError

from .layer_frames import At, Sheet
from .section_planes import Section
from .space_curve import SpaceCurve

Array = npt.NDArray[np.float64]

SAME = 1e-3
"""Heights that are off one plane by more than this share of themselves, and the tolerance, do not tell it."""


def floors_of(
    curves: Sequence[SpaceCurve],
    sections: Sequence[Section],
    sheets: Sequence[Sheet],
    at: At,
    tolerance: float,
) -> list[Sheet | None]:
    """The plane below each section that its layer is printed on; None where its curves have no heights.

    Args:
        curves: all of them.
        sections, sheets: of the layers, from the bottom up, and their planes.
        at: which of a layer's planes the curves lie in.
        tolerance: how far a point may lie off its plane, mm.

    Raises:
        PlanesError: the heights of a section do not tell one plane.
    """
    floors: list[Sheet | None] = []
    for k, (section, sheet) in enumerate(zip(sections, sheets, strict=True)):
        places, heights = [], []
        for i in section.members:
            said = curves[i].heights
            if said is not None:
                places.append(curves[i].points)
                heights.append(said)
        if not places:
            floors.append(None)
            continue
        floor, off = _floor(np.concatenate(places), np.concatenate(heights), sheet, at)
        if off > 10.0 * tolerance + SAME * float(np.abs(np.concatenate(heights)).max()):
            raise PlanesError(
                f"layer {k}: the heights that come with its curves are up to {off:.3g} mm off those above one plane, "
                "so they do not tell what it is printed on; leave them out, or give a `bed`"
            )
        floors.append(floor)
    return floors


def _floor(points: Array, heights: Array, sheet: Sheet, at: At) -> tuple[Sheet, float]:
    """The plane from which points in a sheet have these heights, and by how much they are off it at most, mm."""
    centre = points.mean(axis=0)
    normal = sheet[0]
    x = np.eye(3)[int(np.abs(normal).argmin())]
    x = x - float(x @ normal) * normal
    x = x / np.linalg.norm(x)
    across = np.column_stack([x, np.cross(normal, x)])
    apart = (points - centre) @ across
    size = max(1.0, float(np.abs(apart).max()))
    # Where all points lie on a line there is no slope across it.
    A = np.column_stack([apart / size, np.ones(len(apart))])
    solution = np.linalg.lstsq(A, heights, rcond=1e-9)[0]
    off = float(np.abs(A @ solution - heights).max())
    slope, height = solution[:2] / size, float(solution[2])
    sine = float(np.linalg.norm(slope))
    if sine >= 1.0:
        return sheet, float(np.abs(heights).max())
    share = 1.0 if at == "nozzle" else 0.5 / float(np.cos(0.5 * np.arcsin(sine)))
    slope, height = share * slope, share * height
    turned = across @ slope + float(np.sqrt(1.0 - float(slope @ slope))) * normal
    return (turned, float(turned @ centre) - height), off
