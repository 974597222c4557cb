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
from .lengths import factor_to_mm

Array = npt.NDArray[np.float64]

logging.getLogger("ezdxf").addHandler(logging.NullHandler())

UNITS = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 7: "km", 9: "mil", 10: "yd", 13: "um", 14: "dm"}
"""Of $INSUNITS; 0 says nothing."""

DEEPEST = 32
"""Blocks inside blocks, beyond which they are taken to contain themselves."""

FRAME = 16
"""Flag of a vertex that controls a fitted polyline and does not lie on it."""

APPLICATION = "TWINCELL"

DISTANCE = 1041
"""Group code of extended data that is scaled with its entity."""

TURN = 2.0 * np.pi

FULL = 1e-7
"""An angle from a full turn, rad, within which one is drawn: files print their angles with as few as 9 digits."""


def read_dxf(path: Path, chord: float, units: str | None) -> list[Piece]:
    """The curves of the model space, with blocks exploded."""
    try:
        document = ezdxf.readfile(path)  # type: ignore[attr-defined]
        code = int(document.header.get("$INSUNITS", 0))
        scale = factor_to_mm(path, UNITS.get(code, f"$INSUNITS {code}") if code else None, units, None)
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
            # A block's scale is that of its inserts, which heights do not follow.
            heights = None if piece.heights is None or depth else piece.heights * scale
            yield Piece(piece.points * scale, where, piece.closed, widths, piece.loose, heights)


def _piece(entity: Any, kind: str, where: str, chord: float) -> Piece | None:
    """What an entity draws, in the file's unit."""
    dxf = entity.dxf
    if kind == "LINE":
        return Piece(np.array([dxf.start.xyz, dxf.end.xyz]), where, loose=True)
    if kind in {"ARC", "CIRCLE"}:
        start, sweep = 0.0, TURN
        if kind == "ARC":
            start = np.radians(dxf.start_angle)
            sweep = _sweep(start, np.radians(dxf.end_angle))
        pieces = arc_pieces(
            np.array(dxf.center.xyz), np.array([dxf.radius, 0, 0]), np.array([0, dxf.radius, 0]), start, sweep
        )
        pieces[..., :3] = pieces[..., :3] @ _axes(entity)
        return _smooth(pieces, where, chord)
    if kind == "ELLIPSE":
        major = np.array(dxf.major_axis.xyz)
        minor = np.array(entity.minor_axis.xyz)
        sweep = _sweep(dxf.start_param, dxf.end_param)
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
        widths = rows[:, 2:4] if rows[:, 2:4].any() else np.full((len(rows), 2), dxf.get("const_width", 0.0))
        return _polyline(points, rows[:, 4], widths, entity, where, chord)
    if kind == "POLYLINE" and (entity.is_2d_polyline or entity.is_3d_polyline):
        vertices = [vertex.dxf for vertex in entity.vertices if not vertex.dxf.get("flags", 0) & FRAME]
        points = np.array([vertex.location.xyz for vertex in vertices]).reshape(-1, 3)
        bulges = np.array([0.0 if entity.is_3d_polyline else vertex.get("bulge", 0.0) for vertex in vertices])
        if entity.is_2d_polyline:
            points[:, 2] = dxf.elevation.z if dxf.hasattr("elevation") else points[:, 2]
        names = ("start_width", "end_width")
        usual = [dxf.get(f"default_{name}", 0.0) for name in names]
        both = [[v.get(name, w) for name, w in zip(names, usual, strict=True)] for v in vertices]
        widths = np.array(both, dtype=np.float64).reshape(-1, 2)
        return _polyline(points, bulges, widths, entity, where, chord)
    return None


def _sweep(start: float, end: float) -> float:
    """From one angle on to the other, rad; a full turn where they are the same, but for rounding."""
    sweep = float((end - start) % TURN)
    return TURN if min(sweep, TURN - sweep) <= FULL else sweep


def _axes(entity: Any) -> Array:
    """Rows: the axes of an entity's coordinates in the world."""
    ocs = entity.ocs()
    return np.array([ocs.ux.xyz, ocs.uy.xyz, ocs.uz.xyz]) if ocs.transform else np.eye(3)


def _smooth(pieces: Array, where: str, chord: float) -> Piece:
    return Piece(flatten(pieces, chord), where, loose=True)


def _polyline(points: Array, bulges: Array, widths: Array, entity: Any, where: str, chord: float) -> Piece:
    """A polyline with its bulges (tangents of a quarter of an arc's angle) drawn out.

    Args:
        points: shape (n, 3).
        bulges: shape (n,).
        widths: at the start and the end of the segments that begin at the points, shape (n, 2); 0 where there is none.
        entity: LWPOLYLINE or POLYLINE.
        where: names it in errors.
        chord: see `flatten`.
    """
    closed = bool(entity.is_closed)
    axes = np.eye(3) if entity.dxftype() == "POLYLINE" and entity.is_3d_polyline else _axes(entity)
    kept = _widths(widths, closed)
    if not bulges.any():
        return Piece(points @ axes, where, closed or None, kept, heights=_heights(entity))
    parts, spread = [], []
    for k in range(len(points) if closed else len(points) - 1):
        after = (k + 1) % len(points)
        p, q, b = points[k], points[after], bulges[k]
        part, share = p[None], np.zeros(1)
        if b != 0.0 and not (p == q).all():
            along = q - p
            left = np.array([-along[1], along[0], 0.0])
            centre = 0.5 * (p + q) + left * (1.0 - b * b) / (4.0 * b)
            u = p - centre
            v = np.array([-u[1], u[0], 0.0])
            sweep = 4.0 * np.arctan(b)
            part = np.vstack([p, flatten(arc_pieces(centre, u, v, 0.0, sweep), chord)[1:-1]])
            angles = np.arctan2((part - centre) @ v, (part - centre) @ u)
            share = np.append(0.0, np.mod(np.sign(b) * angles[1:], TURN) / abs(sweep))
        parts.append(part)
        if kept is not None:
            spread.append(kept[k] + share * (kept[after] - kept[k]))
    if not closed:
        parts.append(points[-1:])
        spread += [] if kept is None else [kept[-1:]]
    return Piece(np.vstack(parts) @ axes, where, closed or None, np.concatenate(spread) if spread else None)


def _widths(widths: Array, closed: bool) -> Array | None:
    """Widths at the vertices from those of the segments that begin there, shape (n, 2)."""
    at = widths[:, 0].copy()
    if not closed and len(at) > 1 and at[-1] == 0.0:
        at[-1] = widths[-2, 1]  # no segment begins at the end of an open one
    if (at == 0.0).all():
        return None
    if not (at > 0.0).all():
        none, some = int(np.argmin(at > 0.0)), int(np.argmax(at > 0.0))
        raise ValueError(
            f"it has a width at vertex {some}, {at[some]:.6g}, but not at vertex {none}; give one at all of them, or "
            "at none"
        )
    return at


def _heights(entity: Any) -> Array | None:
    """Of the bead at the vertices, as `write_dxf` writes them."""
    if entity.dxftype() != "POLYLINE":
        return None
    heights = [
        tag.value
        for vertex in entity.vertices
        if vertex.has_xdata(APPLICATION)
        for tag in vertex.get_xdata(APPLICATION)
        if tag.code == DISTANCE
    ]
    return np.array(heights, dtype=np.float64) if len(heights) == len(entity.vertices) > 0 else None


def write_dxf(path: Path, lines: Sequence[Labelled]) -> None:
    """Write 3D polylines in mm, with widths at their vertices and what is said of them as extended data.

    Heights of beads are extended data of the vertices.
    """
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
        if line.curve.heights is not None:
            for vertex, height in zip(polyline.vertices, line.curve.heights.tolist(), strict=True):
                vertex.set_xdata(APPLICATION, [(1000, "height"), (DISTANCE, height)])
        said: list[tuple[int, Any]] = []
        for name, index in line.indices.items():
            said += [(1000, name), (1071, index)]
        if line.plane is not None:
            for name in ("origin", "x_axis", "y_axis"):
                said += [(1000, name), (1010, tuple(getattr(line.plane, name).tolist()))]
        if said:
            polyline.set_xdata(APPLICATION, said)
    document.saveas(path)
