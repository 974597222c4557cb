"""Curves in Rhino's 3DM: every curve object, and polyline curves with user text out."""

from __future__ import annotations

import json
from collections.abc import Sequence
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
from .lengths import factor_to_mm
from .rhino_objects import objects_shown, unit_of_3dm

Array = npt.NDArray[np.float64]

VERSION = 7
"""Of the files that are written; Rhino 7 and later read it."""


def read_3dm(path: Path, chord: float, units: str | None) -> list[Piece]:
    """The visible curves of a 3DM file, with blocks exploded."""
    model = open_guarded(path)
    scale = factor_to_mm(path, unit_of_3dm(model, path), units, None)
    pieces, others = [], set()
    for shown in objects_shown(model, path):
        if not isinstance(shown.geometry, rhino3dm.Curve):
            others.add(shown.geometry.ObjectType.name)
            continue
        placed = np.diag([scale, scale, scale, 1.0]) @ shown.placed
        try:
            points = _points(shown.geometry, chord, placed)
        except ValueError as error:
            raise FormatError(f"{shown.where}: {error}") from None
        loose = not isinstance(shown.geometry, rhino3dm.PolylineCurve | rhino3dm.PolyCurve)
        widths, heights = (
            _lengths(shown.attributes, key, len(points), shown.where, placed) for key in ("width", "height")
        )
        pieces.append(Piece(points, shown.where, None, widths, loose, heights))
    if not pieces and len(model.Objects):
        found = ", ".join(sorted(others)) or "what is hidden"
        raise FormatError(f"{path}: holds no visible curves, only {found}; extract or show curves")
    return pieces


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


def _lengths(attributes: Any, key: str, count: int, where: str, placed: Array) -> Array | None:
    text = attributes.GetUserString(key)
    if not text:
        return None
    try:
        lengths = np.array(json.loads(text), dtype=np.float64) * np.cbrt(abs(np.linalg.det(placed[:3, :3])))
    except (ValueError, TypeError):
        raise FormatError(
            f"{where}: its user text {key} must be a list of numbers, not '{text[:40]}'"
        ) from None
    if lengths.shape == (count - 1,):  # the point that closes a polyline repeats the first
        lengths = np.append(lengths, lengths[0])
    if lengths.ndim == 0:
        lengths = np.full(count, float(lengths))
    if lengths.shape != (count,):
        raise FormatError(f"{where}: its user text {key} must list one number for each of its {count} points")
    return np.asarray(lengths, dtype=np.float64)


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
        if line.curve.heights is not None:
            columns["height"] = line.curve.heights
        for name, values in columns.items():
            attributes.SetUserString(name, json.dumps(values.tolist()))
        points = line.curve.points.tolist()
        corners = [rhino3dm.Point3d(*p) for p in (points + points[:1] if line.curve.closed else points)]
        polyline: Any = rhino3dm.PolylineCurve
        model.Objects.AddCurve(polyline(corners), attributes)
    if not model.Write(str(path), VERSION):
        raise FormatError("cannot be written as 3DM; check the folder")
