"""What a print became, from its samples: how much was laid down, where, and how far off the plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from planning import Program, SegmentKind

Array = npt.NDArray[np.float64]
Samples = npt.NDArray[np.void]

PASSED = 1.0
"""A waypoint counts as passed when the tool came this near, mm."""

_NEIGHBOURS = 3


@dataclass(frozen=True)
class Evaluation:
    """Figures of a print.

    Attributes:
        duration: process time from the first waypoint to the last sample, s.
        deposited_volume: volume that left the nozzle, mm³.
        travel_volume: the part of it that left outside of beads, mm³.
        worst_deviation: largest distance between a measured position in a bead and the planned path, mm.
        passed: share of the beads' waypoints that the tool passed within `PASSED`.
    """

    duration: float
    deposited_volume: float
    travel_volume: float
    worst_deviation: float
    passed: float


def evaluate(program: Program, samples: Samples) -> Evaluation:
    """Compare what was measured with what was planned.

    Args:
        program: what was to be printed.
        samples: structured array with the columns of `planning.PrintedSample`, in the order of time.
    """
    beads = np.flatnonzero([segment.kind is SegmentKind.PRINT for segment in program.segments])
    inside = np.isin(samples["segment"], beads)
    volume = volumes(samples)
    off = deviations(program, samples[inside])
    return Evaluation(
        duration=float(np.ptp(samples["time"][samples["segment"] >= 0]))
        if (samples["segment"] >= 0).any()
        else 0.0,
        deposited_volume=float(volume.sum()),
        travel_volume=float(volume[~inside].sum()),
        worst_deviation=float(off.max(initial=0.0)),
        passed=float((misses(program, samples) <= PASSED).mean()) if len(beads) else 1.0,
    )


def volumes(samples: Samples) -> Array:
    """Volume that each sample stands for, shape (n,), mm³: its flow over half the time to either neighbour."""
    half = 0.5 * np.maximum(np.diff(samples["time"]), 0.0)
    return np.asarray(samples["flow"] * (np.append(half, 0.0) + np.append(0.0, half)), dtype=np.float64)


def deviations(program: Program, samples: Samples) -> Array:
    """Distance of samples in beads from the planned path, shape (n,), mm.

    Measured against the moves next to the one that the arm was executing: a neighbouring bead does not count.
    """
    position = np.column_stack([samples["x"], samples["y"], samples["z"]])
    starts = np.array([segment.start for segment in program.segments])[samples["segment"]]
    stops = np.array([segment.stop for segment in program.segments])[samples["segment"]]
    nearest = np.full(len(samples), np.inf)
    for step in range(-_NEIGHBOURS, _NEIGHBOURS + 1):
        target = np.clip(samples["waypoint"] + step, starts + 1, stops - 1)
        away = _distance(position, program.positions[target - 1], program.positions[target])
        nearest = np.minimum(nearest, away)
    return nearest


def misses(program: Program, samples: Samples) -> Array:
    """How near the tool came to each waypoint of each bead while printing it, mm; infinite if it never did.

    Shape (number of waypoints in print segments,), in the program's order.
    """
    found: list[Array] = []
    for k, segment in enumerate(program.segments):
        if segment.kind is not SegmentKind.PRINT:
            continue
        waypoints = program.positions[segment.start : segment.stop]
        # One sample either side, so that the ends of the bead lie between two samples.
        own = np.flatnonzero(samples["segment"] == k)
        if not len(own):
            found.append(np.full(len(waypoints), np.inf))
            continue
        row = samples[max(own[0] - 1, 0) : own[-1] + 2]
        track = np.column_stack([row["x"], row["y"], row["z"]])
        near = np.asarray(cKDTree(track).query(waypoints)[1], dtype=np.int64)
        before, after = np.maximum(near - 1, 0), np.minimum(near + 1, len(track) - 1)
        found.append(
            np.minimum(
                _distance(waypoints, track[before], track[near]),
                _distance(waypoints, track[near], track[after]),
            )
        )
    return np.concatenate(found) if found else np.empty(0)


def _distance(points: Array, starts: Array, ends: Array) -> Array:
    """Distance of points from line pieces, row by row; all of shape (n, 3)."""
    way = ends - starts
    square = np.maximum((way**2).sum(axis=1), 1e-18)
    share = np.clip(((points - starts) * way).sum(axis=1) / square, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - starts - share[:, None] * way, axis=1), dtype=np.float64)
