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
                f"{tolerance:.3g} mm; flatten it, or allow more with `tolerance`"
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
    means = np.array([fits[i].centre for i in order])
    radii = np.array(
        [np.sqrt(((curves[i] - fits[i].centre) ** 2).sum(axis=1).max()) for i in order], dtype=np.float64
    )
    free = np.ones(len(order), dtype=bool)
    sections = []
    for seed in range(len(order)):
        if not free[seed]:
            continue
        free[seed] = False
        members, fit = [seed], fits[order[seed]]
        open_to = free.copy()
        while True:
            candidates = np.flatnonzero(open_to)
            apart = means[candidates] - fit.centre
            # Some point of a curve is as far off a plane as their mean, and none farther away than their sphere
            # reaches: few curves are looked at point by point.
            most = _allowed(np.linalg.norm(apart, axis=1) + radii[candidates], fit, tolerance)
            candidates = candidates[np.abs(apart @ fit.normal) <= most]
            height, reach = _farthest([curves[order[m]] for m in candidates], fit)
            near = height <= _allowed(reach, fit, tolerance)
            found, reach = candidates[near], reach[near]
            if not len(found):
                break
            together = _fit_of(curves, order, [*members, *found])
            # All at once, or if one of them spoils it the nearest, whose place is known best.
            if together.off > tolerance:
                found = found[[int(reach.argmin())]]
                together = _fit_of(curves, order, [*members, *found])
            open_to[found] = False
            if together.off <= tolerance:
                members += found.tolist()
                free[found] = False
                fit = together
        sections.append(_section(fit, sorted(order[m] for m in members)))
    return sections


def _allowed(reach: Array, fit: Fit, tolerance: float) -> Array:
    """How far off a plane points at these distances may be: by no more than the plane's own uncertainty there."""
    return np.asarray(2.0 * tolerance * (1.0 + reach / fit.width), dtype=np.float64)


def _farthest(curves: Sequence[Array], fit: Fit) -> tuple[Array, Array]:
    """Each curve's largest distance from a plane and from its centre, both shape (n,), mm."""
    if not curves:
        return np.empty(0), np.empty(0)
    starts = np.concatenate([[0], np.cumsum([len(curve) for curve in curves])[:-1]])
    apart = np.concatenate(curves) - fit.centre
    height = np.maximum.reduceat(np.abs(apart @ fit.normal), starts)
    return height, np.sqrt(np.maximum.reduceat((apart**2).sum(axis=1), starts))


def _fit_of(curves: Sequence[Array], order: Sequence[int], members: Sequence[int]) -> Fit:
    return fit_plane(np.concatenate([curves[order[m]] for m in members]))


def _section(fit: Fit, members: Sequence[int]) -> Section:
    return Section(fit.normal, float(fit.normal @ fit.centre), tuple(members))


def _joined_by_straight(
    curves: Sequence[Array], straight: Sequence[int], sections: Sequence[Section], tolerance: float
) -> list[Section]:
    joining: list[list[int]] = [list(section.members) for section in sections]
    normals = np.array([section.normal for section in sections]).T
    offsets = np.array([section.offset for section in sections])
    for i in straight:
        heights = np.abs(curves[i] @ normals - offsets).max(axis=0)
        holding = np.flatnonzero(heights <= 2.0 * tolerance).tolist()
        if len(holding) != 1:
            others = [str(sections[k].members[0]) for k in holding]
            said = (
                f"lies in the planes of curves {', '.join(others)}; move it, or draw it with a bend"
                if others
                else f"lies in no layer's plane, by {heights.min():.3g} mm; move it into one, or draw it with a bend"
            )
            raise ToolpathError(f"curve {i} is straight, so it has no plane of its own, and {said}")
        joining[holding[0]].append(i)
    return [
        Section(s.normal, s.offset, tuple(sorted(members)))
        for s, members in zip(sections, joining, strict=True)
    ]
