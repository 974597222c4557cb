"""Curves in SVG: paths and shapes with their transforms, turned so that y points up, and horizontal curves out."""

from __future__ import annotations

import io
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import svgelements  # type: ignore[import-untyped]

from twins.errors import FormatError

from .chaining import Piece
from .flattening import arc_pieces, flatten, homogeneous
from .labelled import Labelled
from .lengths import MM, factor_to_mm

Array = npt.NDArray[np.float64]

PIXEL = 25.4 / 96.0
"""Of CSS, mm."""

UNITS = {**MM, "px": PIXEL, "": PIXEL, "pt": 25.4 / 72.0, "pc": 25.4 / 6.0, "q": 0.25}
PHYSICAL = ("mm", "cm", "in")
DEFINING = ("symbol", "mask", "marker", "pattern", "clipPath", "filter", "linearGradient", "radialGradient")
"""What is inside these is drawn only where something refers to it."""
REFERENCES = ("href", "{http://www.w3.org/1999/xlink}href")

LENGTH = re.compile(r"\s*([-+0-9.eE]*[0-9.])\s*([a-zA-Z]*)\s*")


def read_svg(path: Path, chord: float, units: str | None, z: float) -> list[Piece]:
    """The curves of an SVG, in the root's coordinates with y turned up: (x, y) in the file is (x, -y) here."""
    try:
        root = svgelements.SVG.parse(_defined(path), reify=False, on_error="raise")
    except FormatError:
        raise
    except Exception as error:
        # A broken path or transform breaks anywhere in the library.
        said = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise FormatError(f"{path}: cannot be read as SVG: it is broken ({said}); save it again") from None
    if not isinstance(root, svgelements.SVG):
        raise FormatError(f"{path}: is XML, but not SVG")
    to_root: Array = np.eye(3)
    scale = _scale(path, root, units)
    if root.viewbox is not None:
        to_root = np.asarray(
            np.linalg.inv(_matrix(svgelements.Matrix(root.viewbox_transform))), dtype=np.float64
        )
    turned = np.diag([scale[0], -scale[1], 1.0]) @ to_root
    pieces: list[Piece] = []
    for number, shape in enumerate(e for e in root.elements() if isinstance(e, svgelements.Shape)):
        where = f"{path}: {type(shape).__name__.lower()} {shape.id or number}"
        if shape.values.get("visibility") in {"hidden", "collapse"}:
            continue
        try:
            height = float(shape.values.get("data-z", z))
        except ValueError:
            raise FormatError(
                f"{where}: data-z must be a height in mm, not '{shape.values['data-z']}'"
            ) from None
        try:
            pieces += _pieces(shape, where, chord, turned @ _matrix(shape.transform), height)
        except (ValueError, ZeroDivisionError) as error:
            raise FormatError(f"{where}: {error}") from None
    return pieces


def _defined(path: Path) -> io.BytesIO:
    """The file with all that only defines something put into `defs`, where the library knows not to draw it.

    Raises:
        FormatError: a symbol is drawn that its viewBox scales, which the library does not know.
    """
    tree = ET.parse(path)  # noqa: S314 - the library parses the file in the same way
    scaled = set()
    for parent in list(tree.iter()):
        for k, child in enumerate(list(parent)):
            space, _, name = child.tag.rpartition("}")
            if name == "symbol" and child.get("viewBox") is not None:
                scaled.add(f"#{child.get('id')}")
            if name in DEFINING and parent.tag.rpartition("}")[2] != "defs":
                around = ET.Element(f"{space}}}defs" if space else "defs")
                around.append(child)
                parent[k] = around
    for use in (element for element in tree.iter() if element.tag.rpartition("}")[2] == "use"):
        for reference in REFERENCES:
            if use.get(reference) in scaled:
                raise FormatError(
                    f"{path}: draws the symbol {use.get(reference)} scaled by its viewBox, which is not read; "
                    "expand its uses into paths, or leave its viewBox out"
                )
    content = io.BytesIO()
    tree.write(content, encoding="utf-8")
    content.seek(0)
    return content


def _matrix(m: Any) -> Array:
    return np.array([[m.a, m.c, m.e], [m.b, m.d, m.f], [0.0, 0.0, 1.0]], dtype=np.float64)


def _scale(path: Path, root: Any, units: str | None) -> tuple[float, float]:
    """Millimetres in a unit of the root's coordinates along x and y."""
    if units is not None:
        factor_to_mm(path, None, units)
    box = root.viewbox
    if box is not None and not (box.width and box.height):
        raise FormatError(f"{path}: its viewBox is empty; give it a size")
    sizes = [
        LENGTH.fullmatch(str(root.values["attributes"].get(key) or "100%")) for key in ("width", "height")
    ]
    names = [size[2].lower() if size else "" for size in sizes]
    for name in names:
        if name not in UNITS:
            raise FormatError(f"{path}: its unit '{name}' is not known; give its width and height in mm")
    physical = names[0] if sizes[0] else names[1]
    if physical in PHYSICAL:
        factor_to_mm(path, physical, units)
    elif units is not None:
        return MM[units], MM[units]
    if box is None:
        return PIXEL, PIXEL
    ratios = [
        float(size[1]) * UNITS[name] / extent
        for size, name, extent in zip(sizes, names, (box.width, box.height), strict=True)
        if size
    ]
    if not ratios:
        return PIXEL, PIXEL
    if not all(ratio > 0 and math.isfinite(ratio) for ratio in ratios):
        raise FormatError(f"{path}: its width, height or viewBox is 0 or below; give it a size")
    if "none" in str(root.values["attributes"].get("preserveAspectRatio")):
        return ratios[0], ratios[-1]
    least = min(ratios)
    return least, least


def _pieces(shape: Any, where: str, chord: float, placed: Array, height: float) -> Iterator[Piece]:
    """The subpaths of a shape."""

    def moved(points: Array) -> Array:
        return points @ placed.T

    run: list[Array] = []
    lines, closed = 0, False

    def finished() -> Iterator[Piece]:
        if run and lines:
            points = np.vstack(run)
            single = (
                lines == 1 and not closed and isinstance(shape, svgelements.Path | svgelements.SimpleLine)
            )
            yield Piece(points, where, closed or None, loose=single)

    def flat(x: float, y: float) -> Array:
        return np.array([x, y, 1.0])

    for segment in shape.segments(transformed=False):
        if isinstance(segment, svgelements.Move):
            yield from finished()
            run, lines, closed = [_raised(moved(flat(*segment.end)[None]), height)], 0, False
            continue
        if isinstance(segment, svgelements.Close):
            closed = True
            yield from finished()
            # What follows without a move starts where the closed subpath started.
            run, lines, closed = run[:1], 0, False
            continue
        lines += 1
        if isinstance(segment, svgelements.Line):
            run.append(_raised(moved(flat(*segment.end)[None]), height))
            continue
        if isinstance(segment, svgelements.Arc):
            centre = flat(*segment.center)
            u, v = flat(*segment.prx) - centre, flat(*segment.pry) - centre
            c, u, v = (_raised(moved(a[None]), 0.0)[0] for a in (centre, u, v))
            pieces = arc_pieces(c, u, v, segment.get_start_t(), segment.sweep)
            points = flatten(pieces, chord)[1:]
            points[-1] = _raised(moved(flat(*segment.end)[None]), 0.0)[0]
        else:
            inner = (
                [segment.control]
                if isinstance(segment, svgelements.QuadraticBezier)
                else [segment.control1, segment.control2]
            )
            control = np.array([flat(*p) for p in (segment.start, *inner, segment.end)])
            points = flatten(homogeneous(_raised(moved(control), 0.0))[None], chord)[1:]
        points[:, 2] = height
        run.append(points)
    yield from finished()


def _raised(points: Array, height: float) -> Array:
    """Plane points (x, y, 1 or 0) at a height."""
    raised = points.copy()
    raised[:, 2] = height
    return raised


def write_svg(path: Path, lines: Sequence[Labelled]) -> None:
    """Write horizontal curves, one group with `data-z` for each height; user units are mm."""
    groups: dict[float, list[str]] = {}
    for number, line in enumerate(lines):
        points = line.curve.points
        if np.ptp(points[:, 2]) > 0:
            raise FormatError(
                f"an SVG holds curves of one height each, but curve {number} rises by {np.ptp(points[:, 2]):.3g} mm; "
                "save it as DXF, 3DM, JSON or CSV"
            )
        kind = "polygon" if line.curve.closed else "polyline"
        places = " ".join(f"{x!r},{-y + 0.0!r}" for x, y, _ in points.tolist())
        groups.setdefault(float(points[0, 2]), []).append(f'<{kind} points="{places}"/>')
    everywhere = np.vstack([line.curve.points[:, :2] for line in lines]) * [1.0, -1.0]
    (x, y), (width, height) = everywhere.min(axis=0), np.maximum(np.ptp(everywhere, axis=0), 1.0)
    drawn = [
        f'<g data-z="{z!r}" fill="none" stroke="black" stroke-width="0.5">\n' + "\n".join(group) + "\n</g>\n"
        for z, group in groups.items()
    ]
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{float(width)!r}mm" height="{float(height)!r}mm" '
        f'viewBox="{float(x)!r} {float(y)!r} {float(width)!r} {float(height)!r}">\n{"".join(drawn)}</svg>\n',
        encoding="utf-8",
    )
