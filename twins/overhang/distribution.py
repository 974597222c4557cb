"""Distribution of overhang: how much of a toolpath's length or a surface's area has how much of it.

Designs and orientations are compared by the whole distribution, not by the worst place alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from twins.errors import ToolpathError
from twins.toolpath import read_only

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Measured:
    """Values of which each stands for a length or an area.

    Attributes:
        values: shape (n,).
        weights: length in mm, or area in mm², that each stands for, shape (n,).
    """

    values: Array
    weights: Array

    @property
    def maximum(self) -> float:
        """The greatest value; 0 where there are none."""
        return float(self.values.max()) if len(self.values) else 0.0

    @property
    def total(self) -> float:
        """All length in mm, or area in mm²."""
        return float(self.weights.sum())

    @cached_property
    def _ascending(self) -> tuple[Array, Array]:
        order = np.argsort(self.values, kind="stable")
        return self.values[order], np.cumsum(self.weights[order])

    def quantile(self, share: float) -> float:
        """The least value that the given share of the length or area, 0 to 1, does not exceed.

        Raises:
            ToolpathError: the share is not between 0 and 1.
        """
        if not 0.0 <= share <= 1.0:
            raise ToolpathError(f"a quantile is asked for by a share between 0 and 1, not {share}")
        values, below = self._ascending
        if not len(values):
            return 0.0
        # A rounding error must not lead to the next value.
        at = np.searchsorted(below, share * below[-1] * (1.0 - 1e-12))
        return float(values[min(int(at), len(values) - 1)])

    def above(self, limit: float) -> float:
        """Length in mm, or area in mm², with a value above the limit.

        Raises:
            ToolpathError: the limit is not a number.
        """
        return float(self.weights[self.values > _number(limit)].sum())

    def share_above(self, limit: float) -> float:
        """Share of the length or area with a value above the limit, 0 to 1; 0 where there is none.

        Raises:
            ToolpathError: the limit is not a number.
        """
        return self.above(limit) / self.total if self.total > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class OverhangDistribution:
    """Cumulative distributions of several schemes, side by side.

    Attributes:
        names: of the schemes.
        overhang: d / t, ascending, shape (n,).
        shares: of a scheme's length or area with at most that overhang, shape (schemes, n), 0 to 1.
        totals: length in mm, or area in mm², of each scheme, shape (schemes,).
        schemes: what was measured, in the same order.
    """

    names: tuple[str, ...]
    overhang: Array
    shares: Array
    totals: Array
    schemes: tuple[Measured, ...]

    def share_above(self, limit: float) -> dict[str, float]:
        """Share of each scheme above any limit, whether or not the table has it.

        Raises:
            ToolpathError: the limit is not a number.
        """
        return {n: scheme.share_above(limit) for n, scheme in zip(self.names, self.schemes, strict=True)}


def overhang_distribution(
    schemes: Mapping[str, Measured], overhang: npt.ArrayLike | None = None, steps: int = 200
) -> OverhangDistribution:
    """The length- or area-weighted cumulative distributions of overhang of several schemes.

    Args:
        schemes: what is compared, by name: results of `local_overhang` or `surface_overhang`.
        overhang: the d / t at which shares are given, ascending, shape (n,); default even steps from 0 to 2 or, if
            less, to the greatest of all schemes.
        steps: number of those steps.

    Raises:
        ToolpathError: there are no schemes, or `overhang` does not ascend.
    """
    if not schemes:
        raise ToolpathError("there is nothing to compare: name at least one scheme")
    if overhang is None:
        if steps < 1:
            raise ToolpathError(f"a distribution needs at least one step, not {steps}")
        most = max((float(s.values.max()) for s in schemes.values() if len(s.values)), default=0.0)
        at = np.linspace(0.0, min(most, 2.0) if most > 0.0 else 1.0, steps + 1)
    else:
        at = read_only(overhang, (None,), "the overhangs of a distribution")
        if not len(at) or (np.diff(at) <= 0.0).any():
            raise ToolpathError("the overhangs of a distribution must ascend, and be at least one")
    shares = np.ones((len(schemes), len(at)))
    for row, scheme in zip(shares, schemes.values(), strict=True):
        order = np.argsort(scheme.values, kind="stable")
        below = np.concatenate([[0.0], np.cumsum(scheme.weights[order])])
        if below[-1] > 0.0:
            row[:] = below[np.searchsorted(scheme.values[order], at, side="right")] / below[-1]
    totals = np.array([float(s.weights.sum()) for s in schemes.values()])
    return OverhangDistribution(tuple(schemes), at, shares, totals, tuple(schemes.values()))


def _number(limit: float) -> float:
    if np.isnan(limit):
        raise ToolpathError("a limit of overhang must be a number, not nan")
    return limit
