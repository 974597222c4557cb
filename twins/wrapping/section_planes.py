"""Section planes: which curves lie in one plane, found from the curves alone.

Every curve that is not straight has one plane of its own. The smaller the curve, the less surely its points tell how
that plane is tilted; so planes are not compared with one another, it is asked whether one plane fits the points of
all curves together. Straight curves lie in many planes: they join a plane that others have made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from twins.errors import ToolpathError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

STRAIGHT = 10.0
"""A curve narrower than this many tolerances has no plane of its own."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A plane through points by total least squares.

    Attributes:
        centre: mean of the points, shape (3,), mm.
        normal: unit vector of either sign, shape (3,).
        off: largest distance of a point from the plane, mm.
        width: spread of the points across their longest direction in the plane, mm; the tilt is known to about
            off / width.
    """

    centre: Array
    normal: Array
    off: float
    width: float


@dataclass(frozen=True, eq=False)
class Section:
    """Curves in one plane, normal · x = offset.

    Attributes:
        normal: unit vector, shape (3,).
        offset: mm.
        members: indices of the curves.
    """

    normal: Array
    offset: float
    members: tuple[int, ...]


def fit_plane(points: Array) -> Fit:
    """The plane nearest to points, shape (n, 3), in the sum of squares."""
    centre = points.mean(axis=0)
    apart = points - centre
    # A row of zeros gives two points three axes.
    axes = np.linalg.svd(np.vstack([apart, np.zeros((1, 3))]), full_matrices=False)[2].T
    in_axes = apart @ axes
    low, high = in_axes.min(axis=0), in_axes.max(axis=0)
    return Fit(
        centre,
        np.asarray(axes[:, 2], dtype=np.float64),
        float(np.abs(in_axes[:, 2]).max()),
        float(high[1] - low[1]),
    )


def find_sections(curves: Sequence[Array], tolerance: float) -> list[Section]:
    """The planes of unordered curves, each with the curves in it.

    Args:
        curves: points, each shape (n, 3), mm.
        tolerance: how far a point may lie off its plane, mm.

    Raises:
        ToolpathError: a curve that is not planar, or is straight and lies in no plane or in several.
    """
    fits = [fit_plane(points) for points in curves]
    for i, fit in enumerate(fits):
        if fit.off > tolerance:
            raise ToolpathError(
                f"curve {i} is not planar: its points lie up to {fit.off:.3g} mm off their plane, and the tolerance is "
                f"{tolerance:.3g} mm; flatten it, or allow a larger tolerance"
            )
    straight = [i for i, fit in enumerate(fits) if fit.width <= STRAIGHT * tolerance]
    bent = [i for i, fit in enumerate(fits) if fit.width > STRAIGHT * tolerance]
    if not bent:
        raise ToolpathError(
            "all curves are straight, and lie in many planes each; add a curve with a bend to every layer"
        )
    sections = _gather(curves, fits, bent, tolerance)
    return _joined_by_straight(curves, straight, sections, tolerance)


def _gather(
    curves: Sequence[Array], fits: Sequence[Fit], bent: Sequence[int], tolerance: float
) -> list[Section]:
    order = sorted(bent, key=lambda i: -fits[i].width)
    points = np.concatenate([curves[i] for i in order])
    starts = np.concatenate([[0], np.cumsum([len(curves[i]) for i in order])[:-1]])
    free = np.ones(len(order), dtype=bool)
    sections = []
    for seed in range(len(order)):
        if not free[seed]:
            continue
        free[seed] = False
        members, fit = [seed], fits[order[seed]]
        refused = np.zeros(len(order), dtype=bool)
        while True:
            apart = points - fit.centre
            height = np.maximum.reduceat(np.abs(apart @ fit.normal), starts)
            reach = np.sqrt(np.maximum.reduceat((apart**2).sum(axis=1), starts))
            # Off its plane by no more than that plane's own uncertainty at that distance.
            near = free & ~refused & (height <= 2.0 * tolerance * (1.0 + reach / fit.width))
            found = np.flatnonzero(near)
            if not len(found):
                break
            together = _fit_of(curves, order, [*members, *found])
            # All at once, or if one of them spoils it the nearest, whose place is known best.
            if together.off > tolerance:
                found = found[[int(reach[found].argmin())]]
                together = _fit_of(curves, order, [*members, *found])
            if together.off <= tolerance:
                members += found.tolist()
                free[found] = False
                fit = together
            else:
                refused[found] = True
        sections.append(_section(fit, sorted(order[m] for m in members)))
    return sections


def _fit_of(curves: Sequence[Array], order: Sequence[int], members: Sequence[int]) -> Fit:
    return fit_plane(np.concatenate([curves[order[m]] for m in members]))


def _section(fit: Fit, members: Sequence[int]) -> Section:
    return Section(fit.normal, float(fit.normal @ fit.centre), tuple(members))


def _joined_by_straight(
    curves: Sequence[Array], straight: Sequence[int], sections: Sequence[Section], tolerance: float
) -> list[Section]:
    joining: list[list[int]] = [list(section.members) for section in sections]
    for i in straight:
        heights = [float(np.abs(curves[i] @ s.normal - s.offset).max()) for s in sections]
        holding = [k for k, height in enumerate(heights) if height <= 2.0 * tolerance]
        if len(holding) != 1:
            others = [str(sections[k].members[0]) for k in holding]
            said = (
                f"lies in the planes of curves {', '.join(others)}; move it, or draw it with a bend"
                if others
                else f"lies in no layer's plane, by {min(heights):.3g} mm; move it into one, or draw it with a bend"
            )
            raise ToolpathError(f"curve {i} is straight, so it has no plane of its own, and {said}")
        joining[holding[0]].append(i)
    return [
        Section(s.normal, s.offset, tuple(sorted(members)))
        for s, members in zip(sections, joining, strict=True)
    ]
