"""Curves as JSON and CSV, to the last digit.

JSON: an object with `unit` ("mm", "m", "in" …) and `curves`, a list of objects with `points` ([[x, y, z], …]) and,
where known, `closed` (true or false), `width` and `height` of the bead (each a number, or one for each point). A curve
may be its list of points alone, and the list of curves stand by itself where the caller gives the unit. A
toolpath.json is read too: its curves in the nozzle planes, and their heights.

CSV: a first line that names the columns, among them curve, x, y, z and perhaps width, height and closed; then a row
for each point. Rows of one name or number under `curve` are one curve, in their order. In mm, unless the caller says
otherwise.

In both, a curve that does not say `closed` is closed where its last point repeats its first. Other keys and columns
are left alone.
"""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from twins.errors import FormatError
from twins.exchange import FORMAT as TOOLPATH
from twins.exchange import toolpath_from_dict
from twins.toolpath import Plane, Toolpath
from twins.wrapping.unwrapping import unwrap

from .chaining import Piece
from .labelled import Labelled
from .lengths import factor_to_mm

Array = npt.NDArray[np.float64]

FORMAT = "twincell-curves"
TRUE, FALSE = ("true", "yes", "1"), ("false", "no", "0")


def read_json(path: Path, units: str | None) -> list[Piece]:
    """The curves of a JSON file of ours, or the nozzle's way along a toolpath."""
    try:
        values = json.loads(path.read_bytes().decode("utf-8-sig"), parse_constant=_no_number)
    except UnicodeDecodeError:
        raise FormatError(f"{path}: is not text; curves in JSON are UTF-8") from None
    except json.JSONDecodeError as error:
        raise FormatError(
            f"{path}: is not JSON: line {error.lineno}, column {error.colno} cannot be understood; correct it there"
        ) from None
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path}: is not JSON: {error}") from None
    if isinstance(values, dict) and values.get("format") == TOOLPATH:
        factor_to_mm(path, "mm", units)
        return list(_of_toolpath(toolpath_from_dict(values, str(path)), path))
    entries = values.get("curves") if isinstance(values, dict) else values
    if not isinstance(entries, list):
        raise FormatError(
            f'{path}: holds no list of curves; write {{"unit": "mm", "curves": [{{"points": [[x, y, z], …]}}, …]}}'
        )
    scale = factor_to_mm(path, values.get("unit") if isinstance(values, dict) else None, units, None)
    return [_from_json(entry, f"{path}: curve {i}", scale) for i, entry in enumerate(entries)]


def _no_number(word: str) -> float:
    raise ValueError(f"{word} is no number")


def _of_toolpath(toolpath: Toolpath, path: Path) -> Iterator[Piece]:
    for curve in unwrap(toolpath):
        where = f"{path}: layer {curve.layer}, curve {curve.curve}"
        yield Piece(curve.points, where, curve.closed, curve.widths, heights=curve.heights)


def _from_json(entry: object, where: str, scale: float) -> Piece:
    if isinstance(entry, list):
        entry = {"points": entry}
    if not isinstance(entry, dict) or "points" not in entry:
        raise FormatError(f'{where}: must be a list of points [x, y, z], or an object with such "points"')
    points = _numbers(entry["points"], where, "points")
    if points.ndim != 2 or points.shape[1] != 3:
        raise FormatError(f"{where}: its points must be a list of [x, y, z], three numbers each")
    closed = entry.get("closed")
    if closed is not None and not isinstance(closed, bool):
        raise FormatError(f"{where}: closed must be true or false, not {closed!r}")
    widths, heights = (_at_points(entry, key, where, len(points), scale) for key in ("width", "height"))
    return Piece(points * scale, where, closed, widths, heights=heights)


def _at_points(entry: dict[str, object], key: str, where: str, count: int, scale: float) -> Array | None:
    """Lengths at the points of a curve, or one for all, where it has them: shape (count,), mm."""
    if entry.get(key) is None:
        return None
    values = _numbers(entry[key], where, key) * scale
    if values.ndim == 0:
        return np.full(count, float(values))
    if values.shape != (count,):
        raise FormatError(f"{where}: {key} must be a number, or one number for each of its {count} points")
    return values


def _numbers(values: object, where: str, key: str) -> Array:
    try:
        array = np.array(values)
        if array.dtype.kind not in "if":
            raise ValueError(key)  # noqa: TRY301 - told below with the rest
        return array.astype(np.float64)
    except (ValueError, TypeError, OverflowError):
        raise FormatError(
            f"{where}: {key} holds something that is no number, or lists of unlike length"
        ) from None


def read_csv(path: Path, units: str | None) -> list[Piece]:
    """The curves of a CSV file with the columns curve, x, y, z and, if known, width, height and closed."""
    scale = factor_to_mm(path, None, units)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FormatError(f"{path}: is not text; save it as CSV in UTF-8") from None
    header = text.partition("\n")[0]
    delimiter = max(",;\t", key=header.count)
    # Cells that numbers with decimal commas would make too many.
    hint = "; write numbers with decimal points, or part the cells by semicolons" if delimiter == "," else ""
    rows = csv.reader(text.splitlines(), delimiter=delimiter)
    try:
        names = [name.strip().lower() for name in next(rows, [])]
        if missing := [name for name in ("curve", "x", "y", "z") if name not in names]:
            raise FormatError(
                f"{path}: line 1 must name the columns curve, x, y, z and perhaps width and closed; "
                f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
            )
        curves: dict[str, _Rows] = {}
        for row in rows:
            if not any(cell.strip() for cell in row):
                continue
            where = f"{path}: line {rows.line_num}"
            if len(row) != len(names):
                more = hint if len(row) > len(names) else ""
                raise FormatError(
                    f"{where}: has {len(row)} cells, but line 1 names {len(names)} columns{more}"
                )
            cells = dict(zip(names, (cell.strip() for cell in row), strict=True))
            curves.setdefault(cells["curve"], _Rows(f"{path}: curve {cells['curve']}")).add(cells, where)
    except csv.Error as error:
        raise FormatError(f"{path}: line {rows.line_num}: {error}") from None
    return [curve.piece(scale) for curve in curves.values()]


class _Rows:
    """The rows of one curve of a CSV file."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._points: list[list[float]] = []
        self._lengths: dict[str, list[float]] = {"width": [], "height": []}
        self._closed: list[bool] = []

    def add(self, cells: dict[str, str], where: str) -> None:
        self._points.append([_number(cells[axis], axis, where) for axis in "xyz"])
        for name, lengths in self._lengths.items():
            if cells.get(name):
                lengths.append(_number(cells[name], name, where))
            if len(lengths) not in {0, len(self._points)}:
                raise FormatError(f"{where}: give a {name} at every point of a curve, or at none")
        if said := cells.get("closed", "").lower():
            if said not in TRUE + FALSE:
                raise FormatError(f"{where}: closed must be true or false, not '{said}'")
            self._closed.append(said in TRUE)
            if self._closed[-1] != self._closed[0]:
                raise FormatError(f"{where}: closed must be the same at every point of a curve")

    def piece(self, scale: float) -> Piece:
        widths, heights = (
            np.array(lengths) * scale if lengths else None for lengths in self._lengths.values()
        )
        closed = self._closed[0] if self._closed else None
        return Piece(np.array(self._points) * scale, self._where, closed, widths, heights=heights)


def _number(cell: str, column: str, where: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        comma = "; write it with a decimal point" if re.fullmatch(r"[-+]?\d*,\d+", cell) else ""
        raise FormatError(f"{where}: {column} must be a number, not '{cell}'{comma}") from None
    if not math.isfinite(value):
        raise FormatError(f"{where}: {column} must be a finite number, not '{cell}'")
    return value


def write_json(path: Path, lines: Sequence[Labelled]) -> None:
    """Write curves as JSON in mm."""
    values = {"format": FORMAT, "version": 1, "unit": "mm", "curves": [_as_json(line) for line in lines]}
    path.write_text(json.dumps(values, separators=(",", ":")), encoding="utf-8")


def _as_json(line: Labelled) -> dict[str, Any]:
    entry: dict[str, Any] = {**line.indices, "closed": line.curve.closed}
    if line.plane is not None:
        entry["plane"] = {name: axis.tolist() for name, axis in _axes(line.plane).items()}
    entry["points"] = line.curve.points.tolist()
    if line.curve.widths is not None:
        entry["width"] = line.curve.widths.tolist()
    if line.curve.heights is not None:
        entry["height"] = line.curve.heights.tolist()
    return {**entry, **{name: values.tolist() for name, values in line.columns.items()}}


def _axes(plane: Plane) -> dict[str, Array]:
    return {"origin": plane.origin, "x_axis": plane.x_axis, "y_axis": plane.y_axis}


def write_csv(path: Path, lines: Sequence[Labelled]) -> None:
    """Write curves as CSV in mm, one row a point; a value that a curve does not have is an empty cell."""
    tables = [_as_table(number, line) for number, line in enumerate(lines)]
    names = list(dict.fromkeys(name for table in tables for name in table))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for table, line in zip(tables, lines, strict=True):
            blank = [""] * len(line.curve.points)
            writer.writerows(zip(*(table.get(name, blank) for name in names), strict=True))


def _as_table(number: int, line: Labelled) -> dict[str, list[Any]]:
    points, widths = line.curve.points, line.curve.widths
    n = len(points)
    table: dict[str, list[Any]] = {"curve": [number] * n}
    for k, axis in enumerate("xyz"):
        table[axis] = points[:, k].tolist()
    table["width"] = [""] * n if widths is None else widths.tolist()
    table["closed"] = [str(line.curve.closed).lower()] * n
    if line.curve.heights is not None:
        table["height"] = line.curve.heights.tolist()
    for name, index in line.indices.items():
        table[name if name != "curve" else "curve_of_layer"] = [index] * n
    for name, values in line.columns.items():
        for key, column in _split(name, values):
            table[key] = column.tolist()
    if line.plane is not None:
        for name, vector in _axes(line.plane).items():
            for k, axis in enumerate("xyz"):
                table[f"{name}_{axis}"] = [float(vector[k])] * n
    return table


def _split(name: str, values: Array) -> Iterator[tuple[str, Array]]:
    if values.ndim == 1:
        yield name, values
    else:
        for k, axis in enumerate("xyz"):
            yield f"{name}_{axis}", values[:, k]
