"""Curves in Rhino's 3DM: every curve object, and polyline curves with user text out."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rhino3dm

from twins.errors import FormatError

from .chaining import Piece
from .flattening import flatten, homogeneous, spline_pieces
from .guarded_3dm import open_guarded
from .labelled import Labelled
from .lengths import mm_in_unit

Array = npt.NDArray[np.float64]

UNITS = {
    "Microns": "um",
    "Millimeters": "mm",
    "Centimeters": "cm",
    "Decimeters": "dm",
    "Meters": "m",
    "Kilometers": "km",
    "Mils": "mil",
    "Inches": "in",
    "Feet": "ft",
    "Yards": "yd",
}
SILENT = {"None", "Unset", "CustomUnits"}
"""Unit systems that say nothing."""

DEEPEST = 32
"""Blocks inside blocks, beyond which they are taken to contain themselves."""

VERSION = 7
"""Of the files that are written; Rhino 7 and later read it."""


def read_3dm(path: Path, chord: float, units: str | None) -> list[Piece]:
    """The visible curves of a 3DM file, with blocks exploded."""
    model = open_guarded(path)
    system = model.Settings.ModelUnitSystem.name
    scale = mm_in_unit(path, None if system in SILENT else UNITS.get(system, system), units)
    placed = np.diag([scale, scale, scale, 1.0])
    shown = [entry for entry in model.Objects if not entry.Attributes.IsInstanceDefinitionObject]
    pieces = list(_read(model, shown, path, chord, placed, _hidden(model), 0))
    if not pieces and len(model.Objects):
        kinds = sorted({entry.Geometry.ObjectType.name for entry in shown})
        raise FormatError(
            f"{path}: holds no visible curves, only {', '.join(kinds) or 'block definitions'}; extract or show curves"
        )
    return pieces


def _hidden(model: Any) -> set[int]:
    """Indices of the layers that are off, or under one that is."""
    layers = list(model.Layers)
    off = {str(layer.Id) for layer in layers if not layer.Visible}
    for _ in layers:
        below = {str(layer.Id) for layer in layers if str(layer.ParentLayerId) in off} - off
        if not below:
            break
        off |= below
    return {layer.Index for layer in layers if str(layer.Id) in off}


def _read(
    model: Any, entries: Sequence[Any], path: Path, chord: float, placed: Array, hidden: set[int], depth: int
) -> Iterator[Piece]:
    if depth > DEEPEST:
        raise FormatError(f"{path}: a block contains itself; explode it or delete it")
    for entry in entries:
        # rhino3dm's stubs leave out much of what its objects have.
        geometry: Any = entry.Geometry
        attributes: Any = entry.Attributes
        if not attributes.Visible or attributes.LayerIndex in hidden:
            continue
        where = f"{path}: {type(geometry).__name__} {attributes.Name or attributes.Id}"
        if isinstance(geometry, rhino3dm.InstanceReference):
            reference: Any = geometry
            block = model.InstanceDefinitions.FindId(reference.ParentIdefId)
            if block is None:
                raise FormatError(f"{where}: its block is not in the file; embed it")
            inside = [model.Objects.FindId(str(key)) for key in block.GetObjectIds()]
            move = placed @ _matrix(reference.Xform)
            parts = [part for part in inside if part is not None]
            yield from _read(model, parts, path, chord, move, hidden, depth + 1)
        elif isinstance(geometry, rhino3dm.Curve):
            try:
                points = _points(geometry, chord, placed)
            except ValueError as error:
                raise FormatError(f"{where}: {error}") from None
            loose = not isinstance(geometry, rhino3dm.PolylineCurve | rhino3dm.PolyCurve)
            yield Piece(points, where, None, _widths(attributes, len(points), where, placed), loose)


def _matrix(xform: Any) -> Array:
    return np.array([[getattr(xform, f"M{i}{j}") for j in range(4)] for i in range(4)], dtype=np.float64)


def _points(curve: Any, chord: float, placed: Array) -> Array:
    if isinstance(curve, rhino3dm.PolylineCurve):
        corners = [curve.Point(k) for k in range(curve.PointCount)]
        return _moved(homogeneous([(p.X, p.Y, p.Z) for p in corners]), placed)
    if isinstance(curve, rhino3dm.PolyCurve):
        parts = [_points(curve.SegmentCurve(k), chord, placed) for k in range(curve.SegmentCount)]
        if not parts:
            raise ValueError("it has no segments")
        return np.vstack([parts[0], *(part[1:] for part in parts[1:])])
    if isinstance(curve, rhino3dm.LineCurve):
        return _moved(homogeneous([(p.X, p.Y, p.Z) for p in (curve.Line.From, curve.Line.To)]), placed)
    spline = curve.ToNurbsCurve()
    if spline is None:
        raise ValueError("it has no NURBS form; rebuild it in Rhino")
    # Control points come as (w x, w y, w z, w); the file leaves out the first and the last knot, which do not count.
    control = np.array([(p.X, p.Y, p.Z, p.W) for p in spline.Points])
    if not (control[:, 3] > 0).all():
        raise ValueError("its weights are not all above 0")
    knots = list(spline.Knots)
    pieces = spline_pieces(control, [knots[0], *knots, knots[-1]], spline.Degree)
    return flatten(pieces @ placed.T, chord)


def _moved(corners: Array, placed: Array) -> Array:
    moved = corners @ placed.T
    return np.asarray(moved[:, :3] / moved[:, 3:], dtype=np.float64)


def _widths(attributes: Any, count: int, where: str, placed: Array) -> Array | None:
    text = attributes.GetUserString("width")
    if not text:
        return None
    try:
        widths = np.array(json.loads(text), dtype=np.float64) * np.cbrt(abs(np.linalg.det(placed[:3, :3])))
    except (ValueError, TypeError):
        raise FormatError(
            f"{where}: its user text width must be a list of numbers, not '{text[:40]}'"
        ) from None
    if widths.shape == (count - 1,):  # the point that closes a polyline repeats the first
        widths = np.append(widths, widths[0])
    if widths.ndim == 0:
        widths = np.full(count, float(widths))
    if widths.shape != (count,):
        raise FormatError(f"{where}: its user text width must list one number for each of its {count} points")
    return np.asarray(widths, dtype=np.float64)


def write_3dm(path: Path, lines: Sequence[Labelled]) -> None:
    """Write polyline curves in mm, with widths and what is said of them as user text (JSON)."""
    model: Any = rhino3dm.File3dm()
    model.Settings.ModelUnitSystem = rhino3dm.UnitSystem.Millimeters
    layers: dict[str, int] = {}
    for line in lines:
        if line.layer not in layers:
            layer = rhino3dm.Layer()
            layer.Name = line.layer
            layers[line.layer] = model.Layers.Add(layer)
        attributes: Any = rhino3dm.ObjectAttributes()
        attributes.LayerIndex = layers[line.layer]
        attributes.Name = " ".join(f"{name} {index}" for name, index in line.indices.items())
        for name, index in line.indices.items():
            attributes.SetUserString(name, str(index))
        if line.plane is not None:
            axes = {name: getattr(line.plane, name).tolist() for name in ("origin", "x_axis", "y_axis")}
            attributes.SetUserString("plane", json.dumps(axes))
        columns = dict(line.columns)
        if line.curve.widths is not None:
            columns["width"] = line.curve.widths
        for name, values in columns.items():
            attributes.SetUserString(name, json.dumps(values.tolist()))
        points = line.curve.points.tolist()
        corners = [rhino3dm.Point3d(*p) for p in (points + points[:1] if line.curve.closed else points)]
        polyline: Any = rhino3dm.PolylineCurve
        model.Objects.AddCurve(polyline(corners), attributes)
    if not model.Write(str(path), VERSION):
        raise FormatError("cannot be written as 3DM; check the folder")
