"""Fewest layers: of all stacks within bounds, one that comes nearest to the wanted steps and has the fewest layers.

Thicknesses are whole numbers of a small unit of height, and dynamic programming runs over height and last thickness.
A greedy choice from below can not do that: it runs into places from which no thickness within the ratio leads on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba as nb
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

_STATES = 12_000_000  # heights x thicknesses that are looked at
_COUNTED = (
    1 << 18
)  # more than the layers of any stack: what an excess of the smallest price weighs, in layers
_FINENESS = 4096  # of prices
_NEVER = 1 << 62


@dataclass(frozen=True, eq=False)
class Bounds:
    """Of each unit of height: thickness that a layer there must have at least and at most, and that its steps want.

    `wanted` is above 0; the step that a layer leaves is its thickness over the wanted one, in wanted steps.
    """

    least: Array
    most: Array
    wanted: Array


def fewest_layers(bounds: Bounds, unit: float, ratio: float) -> Counts | None:
    """Thicknesses of the layers in units, from the bed up, or None where nothing sums to the height.

    A layer lies between `least` and `most` everywhere in it. It is in excess by as much as it is thicker than both
    the least and the wanted thickness; first the squares of the steps in excess are as small as they can be, all
    together, and then the layers as few. So where the wanted thickness is below the least, layers are as near to the
    least as they can be while they sum to the height, and equal.
    """
    least = np.ceil(bounds.least / unit - 1e-9).astype(np.int64)
    most = np.floor(bounds.most / unit + 1e-9).astype(np.int64)
    wanted = np.minimum(bounds.wanted / unit, float(1 << 40))
    units, thinnest, thickest = len(least), max(1, int(least.min())), int(most.max())
    if thickest < thinnest:
        return None
    sizes = _sizes(units, thinnest, thickest, ratio)
    fineness = _FINENESS * float(wanted.min()) / thickest
    costs = _costs(least, most, wanted, sizes, ratio, fineness)
    cost = int(costs[-1].min())
    if cost >= _NEVER:
        return None
    steps: list[int] = []
    at, like = units, units / (cost % _COUNTED)
    while at:
        # Of all layers that lead on, the one most like the last.
        fits = costs[at] == cost
        if steps:
            fits &= (sizes <= steps[-1] * ratio + 1e-9) & (sizes * ratio + 1e-9 >= steps[-1])
        step = int(sizes[np.where(fits, np.abs(sizes - like), np.inf).argmin()])
        here = slice(at - step, at)
        cost -= 1 + _COUNTED * price(step, int(least[here].max()), float(wanted[here].min()), fineness)
        steps.append(step)
        at, like = at - step, step
    return np.array(steps[::-1], dtype=np.int64)


@nb.njit(cache=True, nogil=True)
def price(thickness: int, least: int, wanted: float, fineness: float) -> int:
    """Square of the step in excess of a layer, in wanted steps / `fineness`; never 0 where there is an excess."""
    excess = thickness - max(least, math.floor(min(wanted, 1e12) + 1e-9))
    return 0 if excess <= 0 else math.ceil(fineness * excess / wanted) ** 2


def _sizes(units: int, thinnest: int, thickest: int, ratio: float) -> Counts:
    """Thicknesses that are tried: all, or where those are too many, the ends and some between in even proportions.

    Those of equal layers are among them.
    """
    span = thickest / thinnest
    room = _STATES // units
    # Neighbours within the ratio are to differ in several steps.
    asked = math.ceil(8.0 * math.log(span) / max(math.log(ratio), 1e-3))
    some = max(64, room, min(asked, 2 * room))
    if thickest - thinnest < some:
        return np.arange(thinnest, thickest + 1)
    proportions = np.rint(thinnest * span ** np.linspace(0.0, 1.0, some)).astype(np.int64)
    equal = [units // n for n in (math.ceil(units / thickest), max(1, units // thinnest))]
    sizes = np.unique(np.concatenate([proportions, equal, np.add(equal, 1)]))
    return np.asarray(sizes[(sizes >= thinnest) & (sizes <= thickest)], dtype=np.int64)


@nb.njit(cache=True, nogil=True)
def _costs(
    least: Counts, most: Counts, wanted: Array, sizes: Counts, ratio: float, fineness: float
) -> Counts:
    """Cost of the best layers up to a height of which the last has a size, shape (units + 1, sizes).

    It is the number of layers, and `_COUNTED` for each unit of their prices.
    """
    units, width = len(least), len(sizes)
    costs = np.full((units + 1, width), _NEVER, dtype=np.int64)
    before = np.zeros(width, dtype=np.int64)
    queue = np.empty(width, dtype=np.int64)
    for at in range(units):
        if at > 0:
            # Least cost over the sizes within the ratio: both ends of that window only grow.
            row = costs[at]
            if row.min() >= _NEVER:
                continue
            head, tail, reached = 0, 0, 0
            for j in range(width):
                t = sizes[j]
                while reached < width and sizes[reached] <= t * ratio + 1e-9:
                    while tail > head and row[queue[tail - 1]] >= row[reached]:
                        tail -= 1
                    queue[tail] = reached
                    tail += 1
                    reached += 1
                while sizes[queue[head]] * ratio + 1e-9 < t:
                    head += 1
                before[j] = row[queue[head]]
        low, high, wish, j = 0, units, np.inf, 0
        for t in range(1, min(sizes[-1], units - at) + 1):
            above = at + t - 1
            low, high, wish = max(low, least[above]), min(high, most[above]), min(wish, wanted[above])
            if t > high:
                break
            if t == sizes[j]:
                if t >= low and before[j] < _NEVER:
                    costs[at + t, j] = before[j] + 1 + _COUNTED * price(t, low, wish, fineness)
                j += 1
    return costs
