"""Curves in and out: DXF, SVG, 3DM, JSON and CSV."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from twins.errors import FormatError
from twins.wrapping.space_curve import SpaceCurve

from .chaining import Piece, curves_of
from .content import check_content
from .labelled import Labelled, write_whole
from .tables import read_csv, read_json, write_csv, write_json

SUFFIXES = (".dxf", ".svg", ".3dm", ".json", ".csv")


def read_curves(
    path: Path | str,
    *,
    chord: float = 0.05,
    units: str | None = None,
    join: float | None = None,
    z: float = 0.0,
) -> tuple[SpaceCurve, ...]:
    """The curves in a DXF, SVG, 3DM, JSON or CSV file, in mm.

    Polylines keep their vertices; arcs, ellipses and splines become polylines that stay within `chord` of them. Lines,
    arcs and splines that stand by themselves are joined where their ends meet; polylines and polycurves are not. A
    curve whose last point repeats its first is closed. What is hidden, or on a hidden layer, is left out.

    Args:
        path: of the file.
        chord: largest distance of a curved line from its polyline, mm.
        units: unit of a file that does not say its own: mm, cm, m, in, ft …; CSV is in mm without it, and the lengths
            of an SVG without a physical width are pixels, 96 to the inch.
        join: distance within which ends meet, mm; by default 1e-6 of the size of the drawing.
        z: height of an SVG's curves where no element around them has `data-z`, mm.

    Raises:
        FormatError: no such file, not what its ending says, no curves in it, a curve that is none, or a unit that is
            missing, unknown or contradicted; names the place.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in SUFFIXES and not path.is_dir():
        raise FormatError(
            f"{path}: unknown ending '{path.suffix}'; curves are read from {', '.join(SUFFIXES)}"
        )
    check_content(path)
    if not (chord > 0 and math.isfinite(chord)):
        raise FormatError(f"{path}: the chord tolerance must be above 0 mm, not {chord}")
    if join is not None and not (join >= 0 and math.isfinite(join)):
        raise FormatError(f"{path}: the distance within which ends meet must not be below 0 mm, as {join} is")
    if not math.isfinite(z):
        raise FormatError(f"{path}: the height z of its curves must be a finite number, not {z}")
    try:
        pieces = _pieces(path, ending, chord, units, z)
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror or error}") from None
    if not pieces:
        raise FormatError(f"{path}: holds no curves; draw polylines, lines, arcs or splines, and show them")
    return curves_of(pieces, join)


def _pieces(path: Path, ending: str, chord: float, units: str | None, z: float) -> list[Piece]:
    # The drawing libraries are loaded where they are needed, so that `import twins` stays quick.
    if ending == ".dxf":
        from .dxf_curves import read_dxf  # noqa: PLC0415

        return read_dxf(path, chord, units)
    if ending == ".svg":
        from .svg_curves import read_svg  # noqa: PLC0415

        return read_svg(path, chord, units, z)
    if ending == ".3dm":
        from .rhino_curves import read_3dm  # noqa: PLC0415

        return read_3dm(path, chord, units)
    return read_json(path, units) if ending == ".json" else read_csv(path, units)


def save_curves(curves: Sequence[SpaceCurve], path: Path | str) -> None:
    """Write curves in mm to DXF (3D polylines), 3DM (polyline curves), JSON, CSV or SVG (one group a height).

    All but SVG keep every coordinate to the last digit; SVG, which has no widths, keeps horizontal curves only. The
    file appears whole or not at all.

    Raises:
        FormatError: an unknown ending, no curves, no such folder, or a curve that SVG cannot hold.
    """
    save_labelled([Labelled(curve) for curve in curves], path, SUFFIXES)


def save_labelled(lines: Sequence[Labelled], path: Path | str, suffixes: Sequence[str]) -> None:
    """Write curves with what is said about them, to one of the endings of `suffixes`."""
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in suffixes:
        raise FormatError(
            f"{path}: unknown ending '{path.suffix}'; curves are saved as {', '.join(suffixes)}"
        )
    if not lines:
        raise FormatError(f"{path}: there are no curves to save")
    write_whole(path, _writer(ending), lines)


def _writer(ending: str) -> Callable[[Path, Sequence[Labelled]], None]:
    if ending == ".dxf":
        from .dxf_curves import write_dxf  # noqa: PLC0415

        return write_dxf
    if ending == ".svg":
        from .svg_curves import write_svg  # noqa: PLC0415

        return write_svg
    if ending == ".3dm":
        from .rhino_curves import write_3dm  # noqa: PLC0415

        return write_3dm
    return write_json if ending == ".json" else write_csv
