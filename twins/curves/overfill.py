"""Overfill optimisation: runs that lie too close are pushed apart (seed paper, Section 4.2, equation 4).

Where two parts of a layer's curves are nearer than the bead is wide, more is printed than there is room for. In each
step every point moves away from what is too close to it, by a share of what is missing, averaged over all of that; a
small share and many steps give smooth curves. The paper's step is kept (`equation_4`). Around it:

- Points nearer than (pi / 2) d_min along their own curve are not too close.
- Distances are to the segments of other runs, not only to their points. With points alone two parallel runs end
  0.8 % short of d_min where points of one face the middles of segments of d_min / 4 of the other, and further from
  it the coarser they are sampled; with segments they end at d_min.
- Points that nothing pushes follow their neighbours: how far they have gone is brought nearer to how far those have.
  Gaps between pushed stretches close without kinks, and what was pushed too far comes back (`fairing.py`). Points
  that move also slide along their curve towards equal segments, so that they do not bunch. What lies further away
  stays as it is.
- Segments are about d_min / 4 long: pushed point by point, curves of shorter ones fold where a pushed stretch ends, as
  in the tip of a notch. Finer curves move as ones of that sampling do, and the points in between are carried along
  (`thinning.py`); where that leaves runs too close, a quarter as many steps follow that move all points.
- A step is held back where it could make curves cross or come all too near, to one another or to themselves: as seen
  from a segment no point goes further than half its distance. Curves that are simple stay so, whatever the step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import shapely

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.toolpath import Curve, Layer, Toolpath

from .close_points import ALONG, SAMPLES, Runs, Spacing, check_distance, near_segments, places, spacing_of
from .dividing import Locks, divided_layers
from .pushing import pushed_apart, pushes
from .thinning import carried_over, thinned

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Result = TypeVar("Result")


@dataclass(frozen=True)
class LayerRelief:
    """What overfill optimisation did to one layer.

    Attributes:
        before, after: how close its curves come to one another.
        displacement: the largest way of any point, mm.
        area_before, area_after: Σ of the closed curves' signed areas, that of its regions, mm².
        steps: taken.
        held: points that were held back in the last step so as not to cross something.
    """

    before: Spacing
    after: Spacing
    displacement: float
    area_before: float
    area_after: float
    steps: int
    held: int

    @property
    def area_change(self) -> float:
        """Change of the region area as a share of it; 0 if there is none."""
        return self.area_after / self.area_before - 1.0 if self.area_before else 0.0


@dataclass(frozen=True)
class OverfillRelief:
    """A toolpath whose curves keep apart, and what it took.

    Attributes:
        toolpath: curves and layers that did not change are the same objects as before.
        layers: figures of each layer.
    """

    toolpath: Toolpath
    layers: tuple[LayerRelief, ...]

    @property
    def before(self) -> Spacing:
        """How close the curves came to one another."""
        return Spacing.total([layer.before for layer in self.layers])

    @property
    def after(self) -> Spacing:
        """How close the curves come to one another."""
        return Spacing.total([layer.after for layer in self.layers])

    @property
    def displacement(self) -> float:
        """The largest way of any point, mm."""
        return max((layer.displacement for layer in self.layers), default=0.0)

    @property
    def area_change(self) -> float:
        """Change of all region area as a share of it."""
        before = sum(layer.area_before for layer in self.layers)
        return sum(layer.area_after for layer in self.layers) / before - 1.0 if before else 0.0

    @property
    def largest_area_change(self) -> float:
        """The area change of the layer where it is largest, up or down."""
        return max((layer.area_change for layer in self.layers), key=abs, default=0.0)


@checks_kinds
def relieve_overfill(
    toolpath: Toolpath,
    min_distance: float,
    locked: Locks = None,
    *,
    strength: float = 0.3,
    steps: int = 100,
    fairing: float = 0.1,
    max_displacement: float | None = None,
    progress: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> OverfillRelief:
    """Move curves apart until runs are d_min from one another, in every layer by itself.

    Curves that have to move are first divided into segments of at most d_min / 4; their vertices are kept, so for
    equal segments resample first. They end where nothing is too close, or after `steps`, or where what pushes them is
    in balance: in a bundle that is held between locks, say.

    Args:
        toolpath: open or closed curves that do not cross.
        min_distance: d_min, mm, between the middles of neighbouring beads: the bead width, or a little less.
        locked: zones, or points that do not move; with them the segments that they end stay as they are, bit for
            bit.
        strength: s_2 of equation 4, above 0 and at most 1.
        steps: n_overfill, at most; and a quarter more where finer curves are still too close after those (see above).
        fairing: share of the difference to their neighbours' displacement by which points that nothing pushes follow
            these in the first step at segments of d_min / 4, from 0 to 1; it fades out.
        max_displacement: how far a point may go from where it was, mm; default d_min. Near a point that stays it is
            no farther than it is from that along the curve.
        progress: is told the share of layers done.
        executor: works on layers side by side; threads do, as the kernels release the interpreter's lock.

    Raises:
        ToolpathError: an argument is out of its range, or locks do not fit the layers, curves or points.
    """
    d = check_distance(min_distance)
    if not 0.0 < strength <= 1.0:
        raise ToolpathError(f"the strength of a step must be above 0 and at most 1, not {strength}")
    if steps < 0:
        raise ToolpathError(f"the number of steps must not be negative, not {steps}")
    if not 0.0 <= fairing <= 1.0:
        raise ToolpathError(f"the fairing must be from 0 to 1, not {fairing}")
    leash = d if max_displacement is None else float(max_displacement)
    if not leash >= 0.0:
        raise ToolpathError(f"the largest displacement must not be negative, not {max_displacement}")
    finer, stay = divided_layers(toolpath, d / SAMPLES, locked)
    jobs = [
        (layer.curves, flags, d, strength, steps, fairing, leash)
        for layer, flags in zip(finer, stay, strict=True)
    ]
    results = each_layer(_relieve_layer, jobs, progress, executor)
    layers = tuple(
        _with_curves(layer, divisions.curves, points)
        for layer, divisions, (points, _) in zip(toolpath.layers, finer, results, strict=True)
    )
    if any(new is not old for new, old in zip(layers, toolpath.layers, strict=True)):
        toolpath = replace(toolpath, layers=layers)
    return OverfillRelief(toolpath, tuple(figures for _, figures in results))


def equation_4(
    curves: Sequence[Curve], min_distance: float, strength: float, *, to_points: bool = True
) -> list[Array]:
    """The displacements g_i of one step of equation 4 for the curves of a layer, each of shape (n, 2), mm.

    N_i are the points within d_min of P_i, but for those nearer than (pi / 2) d_min along the same curve, as for all
    i at once. Where two of them coincide they have no direction to go and are left out.

    Args:
        curves: of a layer, sampled at d_min / 4 or finer.
        min_distance: d_min, mm.
        strength: s_2.
        to_points: False for what `relieve_overfill` does: instead of the points, the nearest place on each segment
            within d_min.
    """
    d = check_distance(min_distance)
    runs = Runs.of(curves)
    if not len(runs.points):
        return [np.empty((0, 2)) for _ in curves]
    place, total = places(runs.points, runs.following, runs.starts)
    start, found = near_segments(runs.points, runs.following, d)
    push = pushes(
        runs.points,
        runs.following,
        runs.curve,
        runs.closed,
        place,
        total,
        start,
        found,
        d,
        ALONG * d,
        strength,
        to_points,
    )[0]
    return [push[a:b] for a, b in zip(runs.starts[:-1], runs.starts[1:], strict=True)]


def each_layer(
    function: Callable[..., Result],
    jobs: Sequence[tuple[object, ...]],
    progress: Callable[[float], None] | None,
    executor: Executor | None,
) -> list[Result]:
    """What a function makes of the arguments of each layer, in order."""
    say = progress or (lambda _: None)
    results: list[Result] = []
    if executor is None:
        for job in jobs:
            results.append(function(*job))
            say(len(results) / len(jobs))
        return results
    futures = [executor.submit(function, *job) for job in jobs]
    for done, _ in enumerate(as_completed(futures), start=1):
        say(done / len(jobs))
    return [future.result() for future in futures]


def _with_curves(layer: Layer, finer: Sequence[Curve], points: Sequence[Array | None]) -> Layer:
    """A layer with the curves that moved put in their places."""
    if all(moved is None for moved in points):
        return layer
    curves = zip(layer.curves, finer, points, strict=True)
    return replace(
        layer,
        curves=tuple(old if moved is None else replace(new, points=moved) for old, new, moved in curves),
    )


def _relieve_layer(
    curves: Sequence[Curve],
    stay: Sequence[Flags],
    d: float,
    strength: float,
    steps: int,
    fairing: float,
    leash: float,
) -> tuple[list[Array | None], LayerRelief]:
    """New points of the curves that moved, None for the others; and the layer's figures."""
    runs = Runs.of(curves)
    before = spacing_of(runs, d)
    area = sum(curve.signed_area for curve in curves)
    if not before.least < d:
        return [None] * len(curves), LayerRelief(before, before, 0.0, area, area, 0, 0)
    free = ~np.concatenate(stay)

    def pushed(some: Runs, begun: Array, free: Flags, steps: int) -> tuple[Array, int, int]:
        return pushed_apart(
            begun, some.points, some.previous, some.following, some.curve, some.starts, some.closed, free,
            d, ALONG * d, strength, steps, fairing, _leashes(some, free, leash), False,
        )  # fmt: skip

    picked = [thinned(curve, d / SAMPLES, flags) for curve, flags in zip(curves, stay, strict=True)]
    every = np.concatenate([first + found for first, found in zip(runs.starts[:-1], picked, strict=True)])
    moved, after, taken, held = runs.points, before, 0, 0
    if len(every) < len(runs.points):
        few = Runs.of([Curve(c.points[found], c.closed) for c, found in zip(curves, picked, strict=True)])
        there, taken, held = pushed(few, few.points, free[every], steps)
        gone = np.split(there - few.points, few.starts[1:-1])
        ways = [carried_over(*each) for each in zip(curves, picked, gone, strict=True)]
        moved = runs.points + np.concatenate(ways)
        if not _is_simple(runs, moved) and _is_simple(runs, runs.points):
            moved, taken = runs.points, 0
        after = spacing_of(replace(runs, points=moved), d)
    if not taken or after.close:
        left = steps // 4 if taken else steps
        moved, more, held = pushed(runs, moved, free, left)
        after = spacing_of(replace(runs, points=moved), d)
        taken += more
    displacement = float(np.linalg.norm(moved - runs.points, axis=1).max())
    pieces = [moved[a:b] for a, b in zip(runs.starts[:-1], runs.starts[1:], strict=True)]
    points = [
        None if np.array_equal(new, old.points) else new for new, old in zip(pieces, curves, strict=True)
    ]
    final = sum(
        old.signed_area if new is None else Curve(new, old.closed).signed_area
        for new, old in zip(points, curves, strict=True)
    )
    return points, LayerRelief(before, after, displacement, area, final, taken, held)


def _leashes(runs: Runs, free: Flags, longest: float) -> Array:
    """How far each point may go, shape (n,), mm: no farther than it is, along its curve, from a point that stays.

    A curve that steps aside at once beside a lock would turn there by a right angle and more.
    """
    leashes = np.full(len(free), longest)
    place, total = places(runs.points, runs.following, runs.starts)
    for j, (a, b) in enumerate(pairwise(runs.starts.tolist())):
        locks = place[a:b][~free[a:b]]
        if len(locks):
            if runs.closed[j]:
                locks = np.concatenate([[locks[-1] - total[j]], locks, [locks[0] + total[j]]])
            after = np.searchsorted(locks, place[a:b])
            ahead = np.append(locks, np.inf)[after] - place[a:b]
            behind = place[a:b] - np.append(-np.inf, locks)[after]
            leashes[a:b] = np.minimum(longest, np.minimum(ahead, behind))
    return leashes


def _is_simple(runs: Runs, points: Array) -> bool:
    """Whether curves cross neither themselves nor one another with their points there."""
    pieces = zip(np.split(points, runs.starts[1:-1]), runs.closed, strict=True)
    lines = [np.vstack([piece, piece[:1]]) if closed else piece for piece, closed in pieces]
    return bool(shapely.MultiLineString(lines).is_simple)
