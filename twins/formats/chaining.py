"""Pieces of a drawing become curves: loose pieces whose ends meet are joined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from twins.errors import FormatError, ToolpathError
from twins.wrapping.space_curve import SpaceCurve

Array = npt.NDArray[np.float64]

MEETING = 1e-6
"""Ends nearer than this share of a drawing's size meet, where no distance is given."""


@dataclass(frozen=True, eq=False)
class Piece:
    """What one entity of a drawing gives.

    Attributes:
        points: shape (n, 3), mm.
        where: names the entity in errors.
        closed: as the file says; None where it does not, and the ends decide.
        widths: shape (n,), mm, or None.
        loose: may be joined to others: a line, an arc or a spline by itself.
        heights: of the bead, see `SpaceCurve`, shape (n,), mm, or None.
    """

    points: Array
    where: str
    closed: bool | None = None
    widths: Array | None = None
    loose: bool = False
    heights: Array | None = None


def curves_of(pieces: Sequence[Piece], join: float | None) -> tuple[SpaceCurve, ...]:
    """The curves that pieces make, in the order of their first pieces.

    Args:
        pieces: of one drawing.
        join: distance within which ends meet, mm; None: `MEETING` times the size of the drawing.

    Raises:
        FormatError: a piece is no curve or is drawn twice, or more than two loose ends meet.
    """
    for piece in pieces:
        if len(piece.points) < 2:
            raise FormatError(f"{piece.where}: has only {len(piece.points)} point; a curve needs at least 2")
        if not np.isfinite(piece.points).all():
            raise FormatError(f"{piece.where}: has a coordinate that is not a finite number")
        if (piece.points == piece.points[0]).all():
            raise FormatError(f"{piece.where}: has no length; delete it")
    everywhere = np.vstack([piece.points for piece in pieces])
    near = MEETING * float(np.linalg.norm(np.ptp(everywhere, axis=0))) if join is None else join
    curves = []
    for piece in _chained(pieces, near):
        points, widths, heights, closed = piece.points, piece.widths, piece.heights, piece.closed
        repeats = len(points) > 2 and float(np.linalg.norm(points[-1] - points[0])) <= near
        if repeats and closed is not False:
            points = points[:-1]
            widths, heights = (None if values is None else values[:-1] for values in (widths, heights))
        try:
            curves.append(SpaceCurve(points, repeats if closed is None else closed, widths, heights))
        except ToolpathError as error:
            raise FormatError(f"{piece.where}: {error}") from None
    return tuple(curves)


def _chained(pieces: Sequence[Piece], near: float) -> list[Piece]:
    """Pieces with chains of loose ones made one; each chain stands where its first piece stood."""
    loose = [
        i
        for i, piece in enumerate(pieces)
        if piece.loose and np.linalg.norm(piece.points[-1] - piece.points[0]) > near
    ]
    if len(loose) < 2:
        return list(pieces)
    other = _meeting_ends(pieces, loose, near)
    single = set(loose)
    chains: dict[int, Piece] = {}
    used: set[int] = set()
    for row, i in enumerate(loose):
        if row in used:
            continue
        # Back to an end that meets no other, or once around; the chain runs forward from there.
        entry = 2 * row
        while entry in other:
            entry = other[entry] ^ 1
            if entry == 2 * row:
                break
        run = [entry]
        while other.get(run[-1] ^ 1, entry) != entry:
            run.append(other[run[-1] ^ 1])
        used.update(end // 2 for end in run)
        if len(run) == 2 and entry in other:
            a, b = (pieces[loose[end // 2]] for end in sorted(run))
            _check_apart(a, b, near)
        parts = [pieces[loose[end // 2]].points[:: -1 if end % 2 else 1] for end in run]
        points = np.vstack([parts[0], *(part[1:] for part in parts[1:])])
        chains[i] = pieces[i] if len(run) == 1 else Piece(points, f"{pieces[i].where} and what it meets")
    return [chains.get(i, piece) for i, piece in enumerate(pieces) if i in chains or i not in single]


def _check_apart(a: Piece, b: Piece, near: float) -> None:
    """Two pieces that meet at both ends must have something between them."""
    if len(a.points) != len(b.points):
        return
    turned = np.linalg.norm(a.points[0] - b.points[0]) > near
    if np.linalg.norm(a.points - b.points[:: -1 if turned else 1], axis=1).max() <= near:
        other = b.where.removeprefix(a.where.partition(": ")[0] + ": ")
        raise FormatError(f"{a.where}: is drawn twice, the other time as {other}; delete doubled ones")


def _meeting_ends(pieces: Sequence[Piece], loose: Sequence[int], near: float) -> dict[int, int]:
    """For each end that meets another one, that other; ends 2 k and 2 k + 1 are first and last of loose piece k."""
    ends = np.array([pieces[i].points[at] for i in loose for at in (0, -1)])
    other: dict[int, int] = {}
    for a, b in sorted(KDTree(ends).query_pairs(near)):
        if a in other or b in other:
            place = ", ".join(f"{value:.6g}" for value in ends[a])
            raise FormatError(
                f"{pieces[loose[a // 2]].where}: more than two ends meet at ({place}) mm; trim the lines there, or "
                "delete doubled ones, so that each end meets one other"
            )
        other[a], other[b] = b, a
    return other
