"""Curves in DXF: every curved entity of the model space, and 3D polylines out."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import numpy.typing as npt
from ezdxf.lldxf.const import DXFError

from twins.errors import FormatError

from .chaining import Piece
from .flattening import arc_pieces, flatten, homogeneous, spline_pieces
from .labelled import Labelled
from .lengths import mm_in_unit

Array = npt.NDArray[np.float64]

logging.getLogger("ezdxf").addHandler(logging.NullHandler())

UNITS = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 7: "km", 9: "mil", 10: "yd", 13: "um", 14: "dm"}
"""Of $INSUNITS; 0 says nothing."""

DEEPEST = 32
"""Blocks inside blocks, beyond which they are taken to contain themselves."""

FRAME = 16
"""Flag of a vertex that controls a fitted polyline and does not lie on it."""

APPLICATION = "TWINCELL"


def read_dxf(path: Path, chord: float, units: str | None) -> list[Piece]:
    """The curves of the model space, with blocks exploded."""
    try:
        document = ezdxf.readfile(path)  # type: ignore[attr-defined]
        code = int(document.header.get("$INSUNITS", 0))
        scale = mm_in_unit(path, UNITS.get(code, f"$INSUNITS {code}") if code else None, units)
        hidden = {layer.dxf.name.lower() for layer in document.layers if layer.is_off() or layer.is_frozen()}
        return list(_read(document.modelspace(), path, chord / scale, scale, hidden, 0))
    except FormatError:
        raise
    except Exception as error:
        # A broken file breaks anywhere in the library, which calls what is no DXF at all an OSError.
        said = "" if isinstance(error, OSError) else f" ({' '.join(str(error).split())[:120]})"
        raise FormatError(
            f"{path}: cannot be read as DXF: it is broken, or none{said}; save it again as DXF R2000 or later"
        ) from None


def _read(
    entities: Any, path: Path, chord: float, scale: float, hidden: set[str], depth: int
) -> Iterator[Piece]:
    if depth > DEEPEST:
        raise FormatError(f"{path}: a block contains itself; explode it or delete it")
    for entity in entities:
        kind, layer = entity.dxftype(), entity.dxf.get("layer", "0")
        if layer.lower() in hidden or entity.dxf.get("invisible", 0):
            continue
        if kind == "INSERT":
            for insert in entity.multi_insert() if entity.mcount > 1 else [entity]:
                yield from _read(insert.virtual_entities(), path, chord, scale, hidden, depth + 1)
            continue
        handle = f" #{entity.dxf.handle}" if entity.dxf.get("handle") else ""
        where = f"{path}: {kind}{handle} on layer {layer}"
        try:
            piece = _piece(entity, kind, where, chord)
        except (ValueError, ZeroDivisionError, DXFError) as error:
            raise FormatError(f"{where}: {error}") from None
        if piece is not None:
            widths = None if piece.widths is None else piece.widths * scale
            yield Piece(piece.points * scale, where, piece.closed, widths, piece.loose)


def _piece(entity: Any, kind: str, where: str, chord: float) -> Piece | None:
    """What an entity draws, in the file's unit."""
    dxf = entity.dxf
    if kind == "LINE":
        return Piece(np.array([dxf.start.xyz, dxf.end.xyz]), where, loose=True)
    if kind in {"ARC", "CIRCLE"}:
        start, sweep = 0.0, 2.0 * np.pi
        if kind == "ARC":
            start = np.radians(dxf.start_angle)
            sweep = np.radians((dxf.end_angle - dxf.start_angle) % 360.0 or 360.0)
        pieces = arc_pieces(
            np.array(dxf.center.xyz), np.array([dxf.radius, 0, 0]), np.array([0, dxf.radius, 0]), start, sweep
        )
        pieces[..., :3] = pieces[..., :3] @ _axes(entity)
        return _smooth(pieces, where, chord)
    if kind == "ELLIPSE":
        major = np.array(dxf.major_axis.xyz)
        minor = np.array(entity.minor_axis.xyz)
        sweep = (dxf.end_param - dxf.start_param) % (2.0 * np.pi) or 2.0 * np.pi
        return _smooth(
            arc_pieces(np.array(dxf.center.xyz), major, minor, dxf.start_param, sweep), where, chord
        )
    if kind in {"SPLINE", "HELIX"}:
        spline = entity.construction_tool()
        control = homogeneous([p.xyz for p in spline.control_points], spline.weights() or None)
        return _smooth(spline_pieces(control, spline.knots(), spline.order - 1), where, chord)
    if kind == "LWPOLYLINE":
        rows = np.array(entity.get_points("xyseb"), dtype=np.float64).reshape(-1, 5)
        points = np.column_stack([rows[:, :2], np.full(len(rows), dxf.elevation)])
        return _polyline(points, rows[:, 4], rows[:, 2], entity, where, chord)
    if kind == "POLYLINE" and (entity.is_2d_polyline or entity.is_3d_polyline):
        vertices = [vertex.dxf for vertex in entity.vertices if not vertex.dxf.get("flags", 0) & FRAME]
        points = np.array([vertex.location.xyz for vertex in vertices]).reshape(-1, 3)
        bulges = np.array([0.0 if entity.is_3d_polyline else vertex.get("bulge", 0.0) for vertex in vertices])
        if entity.is_2d_polyline:
            points[:, 2] = dxf.elevation.z if dxf.hasattr("elevation") else points[:, 2]
        return _polyline(
            points, bulges, np.array([v.get("start_width", 0.0) for v in vertices]), entity, where, chord
        )
    return None


def _axes(entity: Any) -> Array:
    """Rows: the axes of an entity's coordinates in the world."""
    ocs = entity.ocs()
    return np.array([ocs.ux.xyz, ocs.uy.xyz, ocs.uz.xyz]) if ocs.transform else np.eye(3)


def _smooth(pieces: Array, where: str, chord: float) -> Piece:
    return Piece(flatten(pieces, chord), where, loose=True)


def _polyline(points: Array, bulges: Array, widths: Array, entity: Any, where: str, chord: float) -> Piece:
    """A polyline with its bulges (tangents of a quarter of an arc's angle) drawn out.

    Widths at its vertices are kept where all are given and nothing bulges.
    """
    closed = bool(entity.is_closed)
    axes = np.eye(3) if entity.dxftype() == "POLYLINE" and entity.is_3d_polyline else _axes(entity)
    if not bulges.any():
        kept = widths if len(widths) and (widths > 0).all() else None
        return Piece(points @ axes, where, closed or None, kept)
    parts = []
    for k in range(len(points) if closed else len(points) - 1):
        p, q, b = points[k], points[(k + 1) % len(points)], bulges[k]
        if b == 0.0 or (p == q).all():
            parts.append(p[None])
            continue
        along = q - p
        left = np.array([-along[1], along[0], 0.0])
        centre = 0.5 * (p + q) + left * (1.0 - b * b) / (4.0 * b)
        u = p - centre
        v = np.array([-u[1], u[0], 0.0])
        parts.append(np.vstack([p, flatten(arc_pieces(centre, u, v, 0.0, 4.0 * np.arctan(b)), chord)[1:-1]]))
    if not closed:
        parts.append(points[-1:])
    return Piece(np.vstack(parts) @ axes, where, closed or None)


def write_dxf(path: Path, lines: Sequence[Labelled]) -> None:
    """Write 3D polylines in mm, with widths at their vertices and what is said of them as extended data."""
    document = ezdxf.new("R2010")  # type: ignore[attr-defined]
    document.units = ezdxf.units.MM
    document.appids.add(APPLICATION)
    for line in lines:
        if line.layer not in document.layers:
            document.layers.add(line.layer)
        polyline = document.modelspace().add_polyline3d(
            line.curve.points, close=line.curve.closed, dxfattribs={"layer": line.layer}
        )
        if line.curve.widths is not None:
            for vertex, width in zip(polyline.vertices, line.curve.widths.tolist(), strict=True):
                vertex.dxf.start_width = vertex.dxf.end_width = width
        said: list[tuple[int, Any]] = []
        for name, index in line.indices.items():
            said += [(1000, name), (1071, index)]
        if line.plane is not None:
            for name in ("origin", "x_axis", "y_axis"):
                said += [(1000, name), (1010, tuple(getattr(line.plane, name).tolist()))]
        if said:
            polyline.set_xdata(APPLICATION, said)
    document.saveas(path)
