"""Smoothing of a layer's curves, step by step, each move checked as it is made (seed paper, Section 4.1).

Two ways to make a fillet where the side constraint holds a point P that is too sharply bent:

- *flipped* (Algorithm 1): its displacement is turned round and shared by its neighbours. With few steps that rounds
  corners. With many, what is pushed pushes on, and fingers grow until they meet something.
- *rolled*: a disc of radius 1 / κ_max that touches P from the locked side. It grows there from nothing, moves the
  points of the curve near P out of its way, and equation (1) draws the curve around it like a string. The curve ends
  with the bend of the disc; where it has room, points go either way, and nothing pushes on.
"""

from __future__ import annotations

from typing import Final

import numba as nb
import numpy as np
import numpy.typing as npt

from .guarded_moves import file_segments, try_move, try_removal
from .smoothing_step import displacements, shortest_of

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

FEWEST: Final = 6
"""Points that a curve keeps when short segments collapse."""

STILL: Final = 1e-6
"""A step in which no point moves further than this share of the mean segment is the last."""

GROWTH: Final = 0.05
"""How much larger the radius of a disc gets in a step, as a share of the mean segment."""

STRIDE: Final = 0.25
"""How far a disc moves a point in a step at most, as a share of the mean segment."""

PATIENCE: Final = 2000
"""Steps without progress after which smoothing ends: what is too sharp in all, 0.1 % less than it ever was."""

ROUNDER: Final = 1.15
"""Radius of a full-grown disc times κ_max: chords of uneven length bend more than their circle."""


@nb.njit(cache=True, nogil=True)
def relax(
    points: Array,
    before: Indices,
    after: Indices,
    owner: Indices,
    fixed: Flags,
    value: Array,
    limit: Array,
    count: int,
    side: int,
    strengths: tuple[float, float],
    mean: float,
    min_segment: float,
    steps: int,
    rolled: bool,
) -> tuple[int, int, Flags]:
    """Smooth curves; arrays change in place, and have room for points that are put into stretched segments.

    Args:
        points, before, after: see `smoothing_step.py`; the first `count` are curves, the rest is room.
        owner: the curve of each point.
        fixed: points that stay: protected ones, and ends of open curves.
        value: any figure of the points; a new point gets the mean of its neighbours' values.
        limit: κ_max at each point, 1/mm; a new point gets that of its curve.
        side, strengths: see `displacements`.
        mean: length of a segment, mm.
        min_segment: ℓ_min, mm: shorter segments collapse.
        steps: n_smooth; fewer are made once no point is above κ_max or none moves, once there is no progress, or once
            there is no room left: then fingers grow, and more steps only make more of them.
        rolled: fillets are rolled, not flipped.

    Returns:
        points, steps made, and the points that the last step would have moved and did not.
    """
    rest = (points[:count].copy(), before[:count].copy(), after[:count].copy())
    given = count
    spare = np.empty(len(points), np.int64)
    spares = 0
    left = np.zeros(owner[:count].max() + 1, np.int64)
    longest = 0.0
    for i in range(count):
        left[owner[i]] += 1
        if after[i] >= 0:
            length = np.hypot(points[after[i], 0] - points[i, 0], points[after[i], 1] - points[i, 1])
            longest = max(longest, length)
    cell = max(1.5 * mean, longest / 32.0)
    skin = 0.5 * cell
    rested = file_segments(rest[0], rest[2], cell, 0.0)
    present = file_segments(points[:count], after[:count], cell, skin)
    travelled = 0.0
    held = np.zeros(len(points), np.bool_)
    touched = np.zeros(len(points), np.bool_)
    # Of each point's disc: where it touches, the direction into the locked side, its radius (0: none), next tangent.
    discs = np.zeros((len(points), 6))
    done = since = 0
    least = np.inf
    for _ in range(steps):
        way = 0 if rolled else side
        step, kappa = displacements(
            points[:count], before[:count], after[:count], way, strengths, limit[:count], True
        )
        growing = rolled and side != 0 and _roll(points, before, after, discs[:count], step, limit, mean)
        furthest = sharp = 0.0
        for i in range(count):
            if fixed[i]:
                step[i] = 0.0
            elif kappa[i] > limit[i]:
                sharp += kappa[i] / limit[i] - 1.0
            furthest = max(furthest, np.hypot(step[i, 0], step[i, 1]))
        held[:count] = False
        since += 1
        if sharp < 0.999 * least:
            least, since = sharp, 0
        if (furthest <= STILL * mean and not growing) or since > PATIENCE:
            break
        done += 1
        # A place put back to its side may go twice as far as its step.
        travelled += 2.0 * furthest
        if travelled > skin:
            skin = max(0.5 * cell, 2.0 * furthest)
            present = file_segments(points[:count], after[:count], cell, skin)
            travelled = 2.0 * furthest
        for i in range(count):
            if np.hypot(step[i, 0], step[i, 1]) <= 1e-3 * STILL * mean:
                continue
            x, y = points[i, 0] + step[i, 0], points[i, 1] + step[i, 1]
            reached = try_move(points, before, after, i, x, y, side, rest, owner, rested, present)
            held[i] = reached == 0
            touched[i] |= reached > 0
            if reached < 2 and rolled and side != 0 and kappa[i] > limit[i]:
                _place_disc(points, before, after, i, side, discs, limit[i], 0.5 * mean)
        for i in range(count):
            j = after[i]
            if j < 0:
                continue
            length = np.hypot(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1])
            if length < min_segment and left[owner[i]] > FEWEST:
                k = shortest_of(points, before, after, fixed, i)
                if travelled == np.inf:  # there are segments that are not filed
                    present = file_segments(points[:count], after[:count], cell, skin)
                    travelled = 0.0
                if k >= 0 and try_removal(points, before, after, k, side, rest, owner, rested, present):
                    left[owner[k]] -= 1
                    discs[k, 4] = 0.0
                    held[k] = False
                    travelled = np.inf
                    if k >= given:
                        spare[spares] = k
                        spares += 1
            elif rolled and length > 2.0 * mean and (touched[i] or touched[j]):
                k = count
                if spares > 0:
                    spares -= 1
                    k = spare[spares]
                elif count < len(points):
                    count += 1
                else:
                    return count, done, held[:count]
                points[k] = 0.5 * (points[i] + points[j])
                before[k], after[k] = i, j
                after[i], before[j] = k, k
                owner[k], value[k] = owner[i], 0.5 * (value[i] + value[j])
                limit[k] = limit[i]
                fixed[k], discs[k, 4] = False, 0.0
                left[owner[i]] += 1
                travelled = np.inf
    return count, done, held[:count]


@nb.njit(cache=True, nogil=True)
def _apart(points: Array, i: int, j: int) -> float:
    return float(np.hypot(points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]))


@nb.njit(cache=True, nogil=True)
def _place_disc(
    points: Array,
    before: Indices,
    after: Indices,
    i: int,
    side: int,
    discs: Array,
    max_curvature: float,
    near: float,
) -> None:
    """Let a disc grow at point i if it is bent around the locked side there and has no growing disc yet.

    Its tangent leads from neighbour to neighbour, and every other time from the first point that is not `near` on
    one side to the first on the other: at a blunt tip two points closer than that then get discs that lead both off
    it, where by their neighbours each is led towards the other.
    """
    if 0.0 < discs[i, 4] < ROUNDER / max_curvature:
        return
    h, j = before[i], after[i]
    wide = discs[i, 5] > 0.0
    while wide and before[h] >= 0 and h != j and _apart(points, h, i) < near:
        h = before[h]
    while wide and after[j] >= 0 and j != h and _apart(points, j, i) < near:
        j = after[j]
    tx, ty = points[j, 0] - points[h, 0], points[j, 1] - points[h, 1]
    length = np.hypot(tx, ty)
    bend = (points[i, 0] - points[h, 0]) * (points[j, 1] - points[i, 1])
    bend -= (points[i, 1] - points[h, 1]) * (points[j, 0] - points[i, 0])
    if length == 0.0 or side * bend >= 0.0:
        return
    discs[i, 0], discs[i, 1] = points[i, 0], points[i, 1]
    discs[i, 2], discs[i, 3] = side * ty / length, -side * tx / length
    discs[i, 4], discs[i, 5] = 1e-9, 1.0 - discs[i, 5]


@nb.njit(cache=True, nogil=True)
def _roll(
    points: Array,
    before: Indices,
    after: Indices,
    discs: Array,
    step: Array,
    limit: Array,
    mean: float,
) -> bool:
    """Let discs grow, and change steps so that they lead points near a disc's point out of it; whether any grows."""
    growing = False
    for i in range(len(discs)):
        r = discs[i, 4]
        if r == 0.0 or after[i] == -2:
            continue
        r, full = r + GROWTH * mean, ROUNDER / limit[i]
        if r >= full:
            discs[i, 4] = 0.0
            r = full
        else:
            discs[i, 4] = r
            growing = True
        cx, cy = discs[i, 0] + r * discs[i, 2], discs[i, 1] + r * discs[i, 3]
        for direction in range(2):
            k, way = i, 0.0
            while way <= np.pi * r:
                x, y = points[k, 0] + step[k, 0] - cx, points[k, 1] + step[k, 1] - cy
                far = np.hypot(x, y)
                if 0.0 < far < r:
                    dx, dy = x * r / far + cx - points[k, 0], y * r / far + cy - points[k, 1]
                    size = np.hypot(dx, dy)
                    share = min(1.0, STRIDE * mean / size) if size > 0.0 else 0.0
                    step[k, 0], step[k, 1] = share * dx, share * dy
                following = before[k] if direction == 0 else after[k]
                if following < 0 or following == i:
                    break
                way += np.hypot(points[following, 0] - points[k, 0], points[following, 1] - points[k, 1])
                k = following
    return growing
