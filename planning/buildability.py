"""Buildability: what the fresh material may not carry, and where beads press into one another."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from twins import Toolpath

from .cell import Cell
from .finding import Finding, Severity
from .mix import Mix
from .program import Program, SegmentKind

if TYPE_CHECKING:
    from twins import Reference

Array = npt.NDArray[np.float64]

CLOSE = 0.95
"""Share of their width below which the distance of two beads counts as overlap, as in `twins.bead_overlap`."""

LEAST = 1e-3
"""Share of the length that may be beyond a limit: a point or two where a curve begins or two branches meet."""


def buildability(program: Program, cell: Cell, mix: Mix, toolpath: Toolpath) -> Iterator[Finding]:
    """Warnings about overhang and about beads that overlap; at most one of a kind, at its worst waypoint.

    Overhang is measured against the limits that the mix states, by ground, by layer, or both; a mix that states none
    is not checked. Beads overlap where runs of a layer are nearer than 0.95 times half of both their widths.

    Args:
        program: planned from the toolpath.
        cell: it was planned for.
        mix: with its limits of local overhang d / t.
        toolpath: in part coordinates, on the bed.

    Raises:
        ToolpathError: its planes are not above one another.
    """
    references: tuple[tuple[Reference, float | None], ...] = (
        ("ground", mix.max_overhang_by_ground),
        ("layer", mix.max_overhang_by_layer),
    )
    for reference, limit in references:
        if limit is not None:
            yield from _overhang(program, cell, mix, toolpath, reference, limit)
    yield from _overlap(program, cell, toolpath)


def _overhang(
    program: Program, cell: Cell, mix: Mix, toolpath: Toolpath, reference: Reference, limit: float
) -> Iterator[Finding]:
    from twins import local_overhang  # noqa: PLC0415 - it loads compiled kernels

    measured = local_overhang(toolpath, reference)
    share = measured.share_above(limit)
    if share <= LEAST:
        return
    worst = measured.worst(1)[0]
    angle = np.degrees(np.arctan(limit))
    way = "gravity" if reference == "ground" else "the layers' own direction"
    ratio = f"{worst.ratio:.2f}" if np.isfinite(worst.ratio) else "with nothing below"
    yield Finding(
        f"overhang by {reference}",
        Severity.WARNING,
        _waypoint_at(program, cell, worst.layer, worst.place),
        round(100.0 * share, 2),
        100.0 * LEAST,
        "% of the beads' length",
        f"{1e-3 * share * measured.total:.2f} m of the beads ({100.0 * share:.1f} %) hang over by more than {limit:g} "
        f"layer heights ({angle:.1f}°) along {way}, more than {mix.name} takes; at worst "
        f"{ratio}, in layer {worst.layer}",
        "relax the surface (twincell optimize surface --both), print in another direction, or choose a stiffer mix",
    )


def _overlap(program: Program, cell: Cell, toolpath: Toolpath) -> Iterator[Finding]:
    from twins import bead_overlap  # noqa: PLC0415 - it loads compiled kernels

    # Curves without widths of their own were planned with one width.
    plain = program.of_kind(SegmentKind.PRINT) & _without_widths(program, toolpath)
    layers = bead_overlap(toolpath, float(program.width[plain].max(initial=0.0)) or 1.0)
    close, length = sum(layer.overlapping for layer in layers), sum(layer.length for layer in layers)
    if close <= LEAST * length:
        return
    worst = min(range(len(layers)), key=lambda i: layers[i].least)
    place = layers[worst].place
    yield Finding(
        "bead overlap",
        Severity.WARNING,
        -1 if place is None else _waypoint_at(program, cell, worst, place),
        round(layers[worst].least, 3),
        CLOSE,
        "distance / width",
        f"{1e-3 * close:.2f} m of the beads ({100.0 * close / length:.1f} %) are nearer to their neighbours than "
        f"{CLOSE} bead widths and would be overfilled; worst in layer {worst}, {layers[worst].least:.2f} widths",
        "print a narrower bead, or move the curves apart (twincell optimize toolpath)",
    )


def _without_widths(program: Program, toolpath: Toolpath) -> npt.NDArray[np.bool_]:
    """Waypoints of curves that have no widths of their own."""
    return np.array(
        [
            layer >= 0 and curve >= 0 and toolpath.layers[layer].curves[curve].width is None
            for layer, curve in zip(program.layer.tolist(), program.curve.tolist(), strict=True)
        ],
        dtype=np.bool_,
    )


def _waypoint_at(program: Program, cell: Cell, layer: int, place: tuple[float, float, float]) -> int:
    """The printing waypoint of a layer nearest to a place in part coordinates; -1 where the layer is not printed."""
    indices = np.flatnonzero(program.of_kind(SegmentKind.PRINT) & (program.layer == layer))
    if not len(indices):
        return -1
    away = program.positions[indices] - cell.bed.plane.to_world(np.array([place]))
    return int(indices[np.argmin(np.linalg.norm(away, axis=1))])
