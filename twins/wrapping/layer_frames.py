"""Layer frames: ordered sections become the plane pairs of layers, with frames that follow one another.

From plane to plane a frame turns about the line in which the two meet, or slides along their normal where they are
parallel. For equally spaced parallel or rotary sections these are the planes that `layer_planes` makes; a point
(u, v) is the same place of the part in the frames of a layer.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from twins.errors import PlanesError
from twins.planes import PlaneStack
from twins.toolpath import Plane

Array = npt.NDArray[np.float64]
At = Literal["nozzle", "slicing"]
Sheet = tuple[Array, float]
"""A plane normal · x = offset: unit normal, shape (3,), and offset, mm."""

LEVEL: Final = 1e-9
"""Sine of the angle below which a plane counts as level."""


def layer_frames(
    sheets: Sequence[Sheet],
    at: At,
    centre: Array,
    bed: Plane | None = None,
    top: Plane | None = None,
    thickness: float | None = None,
    floors: Sequence[Sheet | None] | None = None,
) -> PlaneStack:
    """The stack whose nozzle or slicing planes are the given ones.

    Args:
        sheets: from the bottom up, normals upwards.
        at: which planes they are. The others lie midway between them.
        centre: of the first section, shape (3,), mm; there the thickness is nominal where layers are not parallel.
        bed: the base, with its frame; without it the first floor, or, where that is not known, as far below the first
            layer as the second is above it.
        top: the last nozzle plane, where the sheets are slicing planes.
        thickness: of the first and last layer, mm, where bed and top do not say it; half of it lies on either side of
            a slicing plane.
        floors: the planes that the layers are printed on, as far as they are known, without bed or thickness. Slicing
            planes whose floors are all known lie midway between them and the nozzle planes.

    Raises:
        PlanesError: one sheet alone without bed or thickness, or a bed or top that faces the other way.
    """
    first, last = sheets[0], sheets[-1]
    known = [None] * len(sheets) if floors is None else list(floors)
    floor = known[0]
    untold = bed is None and thickness is None and floor is None
    if len(sheets) == 1 and untold and (at == "nozzle" or top is None):
        raise PlanesError(
            "all curves lie in one plane, which does not tell how thick the layer is; give a `bed` or a `thickness`"
        )
    if at == "nozzle":
        nozzle = list(sheets)
        under = floor or _below(first, sheets[1] if len(sheets) > 1 else None, thickness)
    else:
        over = [None if f is None else mirrored(f, sheet) for f, sheet in zip(known, sheets, strict=True)]
        whole = [sheet for sheet in over if sheet is not None]
        nozzle = whole[:-1] if len(whole) == len(sheets) else [midway(a, b) for a, b in pairwise(sheets)]
        ceiling = None if top is None else sheet_of(top)
        share = None if thickness is None else 0.5 * thickness
        under = floor or _below(first, nozzle[0] if nozzle else ceiling, share)
        if ceiling is None:
            below = under if bed is None else sheet_of(bed)
            ceiling = over[-1] or _above(last, nozzle[-1] if nozzle else below, share)
        nozzle.append(ceiling)
    base = under if bed is None else sheet_of(bed)
    for name, sheet, other in (("bed", base, first), ("top", nozzle[-1], last)):
        if float(sheet[0] @ other[0]) <= 0.0:
            raise PlanesError(
                f"the {name}'s normal points away from the layers' upper side; turn the {name} over"
            )
    planes = [base, *nozzle]
    start = frame = _frame(base, centre) if bed is None else bed
    slicing, tops, steps = [], [], []
    for k, (below, above) in enumerate(pairwise(planes)):
        middle = turned_onto(frame, sheets[k] if at == "slicing" else midway(below, above))
        end = turned_onto(middle, above)
        steps.append(_arc(frame, middle) + _arc(middle, end))
        slicing.append(middle)
        tops.append(end)
        frame = end
    return PlaneStack(start, tuple(slicing), tuple(tops), float(np.mean(steps)))


def sheet_of(plane: Plane) -> Sheet:
    return plane.normal, float(plane.normal @ plane.origin)


def midway(a: Sheet, b: Sheet) -> Sheet:
    """The plane as far above a as below b."""
    normal = a[0] + b[0]
    length = float(np.linalg.norm(normal))
    return normal / length, (a[1] + b[1]) / length


def mirrored(sheet: Sheet, mirror: Sheet) -> Sheet:
    """The plane on the other side of `mirror`, its normal on the same side as before."""
    along = 2.0 * float(sheet[0] @ mirror[0])
    normal = along * mirror[0] - sheet[0]
    length = float(np.linalg.norm(normal))
    return normal / length, (along * mirror[1] - sheet[1]) / length


def turned_onto(plane: Plane, sheet: Sheet) -> Plane:
    """The plane's frame moved onto a sheet: turned about the line where they meet, or slid along its normal."""
    before, after = plane.normal, sheet[0]
    cosine = float(before @ after)
    sine = np.cross(before, after)
    # Rodrigues' rotation that takes one normal to the other.
    K = np.array([[0.0, -sine[2], sine[1]], [sine[2], 0.0, -sine[0]], [-sine[1], sine[0], 0.0]])
    R = np.eye(3) + K + K @ K / (1.0 + cosine)
    # The origin runs on an arc about that line; its chord is at half the angle.
    chord = before + after
    chord = chord / np.linalg.norm(chord)
    length = (sheet[1] - float(after @ plane.origin)) / float(after @ chord)
    return Plane(plane.origin + length * chord, R @ plane.x_axis, R @ plane.y_axis)


def _below(sheet: Sheet, next_one: Sheet | None, thickness: float | None) -> Sheet:
    if thickness is not None or next_one is None:
        return sheet[0], sheet[1] - (thickness or 0.0)
    return mirrored(next_one, sheet)


def _above(sheet: Sheet, one_before: Sheet, thickness: float | None) -> Sheet:
    if thickness is not None:
        return sheet[0], sheet[1] + thickness
    return mirrored(one_before, sheet)


def _frame(base: Sheet, centre: Array) -> Plane:
    """A frame in the base plane: along the world's x axis, at its origin where the base is level."""
    normal, offset = base
    # The world's origin may be far from a part, and its foot on a tilted plane farther still.
    near = np.zeros(3) if float(np.hypot(normal[0], normal[1])) <= LEVEL else centre
    origin = near + (offset - float(normal @ near)) * normal
    x = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = x - float(x @ normal) * normal
    return Plane(origin, x, np.cross(normal, x))


def _arc(a: Plane, b: Plane) -> float:
    """Length of the arc on which an origin runs from one frame to the next, mm."""
    chord = float(np.linalg.norm(b.origin - a.origin))
    half = 0.5 * float(np.arcsin(min(1.0, float(np.linalg.norm(np.cross(a.normal, b.normal))))))
    return chord if half < 1e-6 else chord * half / float(np.sin(half))
