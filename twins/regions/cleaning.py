"""Cleaning: curves that are not as they should be are repaired where there is one way to do it, else reported.

Short curves, doubles of others and curves of nothing but short or empty loops are removed, repeated points dropped. An
open curve that ends where it begins, as CAD programs draw closed ones, is closed. A curve that crosses or touches
itself falls into loops there: if all but one are short, that one stays; otherwise nobody knows what was meant, and the
curve stays as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import shapely

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.toolpath import FAR, Curve, Toolpath

from .outlines import with_curves, with_layers

Array = npt.NDArray[np.float64]
Fault = Literal["repeated points", "not closed", "short", "double", "crosses itself", "crosses another"]
Done = Literal["repaired", "removed", "kept"]


@dataclass(frozen=True)
class Cleaned:
    """What was found about a curve.

    Attributes:
        layer, curve: indices before cleaning.
        fault: what was found.
        done: "repaired", "removed" or, where it is not clear what was meant, "kept".
        place: (u, v) of it, mm.
        detail: in words.
    """

    layer: int
    curve: int
    fault: Fault
    done: Done
    place: tuple[float, float]
    detail: str

    def __str__(self) -> str:
        x, y = self.place
        return f"layer {self.layer}, curve {self.curve} near ({x:.3f}, {y:.3f}): {self.detail}; {self.done}"


@dataclass(frozen=True, eq=False)
class CleanResult:
    """A clean toolpath.

    Attributes:
        toolpath: layers in which nothing was found are the same objects.
        found: layer by layer.
        lengths: of all curves before and after, mm.
    """

    toolpath: Toolpath
    found: tuple[Cleaned, ...]
    lengths: tuple[float, float]


@checks_kinds
def clean(
    toolpath: Toolpath,
    shortest: float | None = None,
    apart: float | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> CleanResult:
    """Remove curves that are short or doubles of others, and repair those that cross themselves or lack a segment.

    Args:
        toolpath: open or closed curves.
        shortest: curves, and loops of curves, shorter than this go, mm; default three layer thicknesses.
        apart: points nearer to one another are one, and curves that keep within it of one another over their whole
            length, whichever way they run; an open curve whose ends are nearer is closed (it runs as it was drawn:
            see `oriented`), mm; default a thousandth of the layer thickness.
        progress: is told the share done, 0 to 1, after each layer.
        executor: works on layers side by side.

    Returns:
        the result, with every curve that was changed or removed. Curves that cross one another (unite them), and
        those that cross themselves and have several long parts, are reported and kept.

    Raises:
        ToolpathError: lengths that are not above 0.
    """
    least = 3.0 * toolpath.thickness if shortest is None else float(shortest)
    gap = 1e-3 * toolpath.thickness if apart is None else float(apart)
    for value, what in ((least, "shortest curve"), (gap, "distance of points")):
        if not 0 < value <= FAR:
            raise ToolpathError(f"the {what} must be above 0 mm and within 1 km, not {value}")
    layers = list(toolpath.layers)
    calls = [(layer.curves, least, gap, i) for i, layer in enumerate(layers) if layer.curves]
    worker = map if executor is None else executor.map
    found: list[Cleaned] = []
    for done, (call, (left, said)) in enumerate(zip(calls, worker(_of_layer, calls), strict=True)):
        curves, *_, i = call
        layers[i] = with_curves(layers[i], [curves[c] if isinstance(c, int) else c for c in left])
        found += said
        if progress is not None:
            progress((done + 1) / len(calls))
    result = with_layers(toolpath, layers)
    return CleanResult(result, tuple(found), (toolpath.length, result.length))


def _of_layer(call: tuple[Sequence[Curve], float, float, int]) -> tuple[list[int | Curve], list[Cleaned]]:
    curves, shortest, gap, i = call
    found: list[Cleaned] = []
    left: dict[int, Curve] = {}

    def report(j: int, fault: Fault, done: Done, at: Array, detail: str) -> None:
        found.append(Cleaned(i, j, fault, done, (float(at[0]), float(at[1])), detail))

    for j, curve in enumerate(curves):
        rows = _without_repeats(_rows(curve), gap, closed=curve.closed)
        if len(rows) < len(curve.points):
            enough = len(rows) >= (3 if curve.closed else 2)
            count = len(curve.points) - len(rows)
            detail = f"{count} of its points {'lie' if count > 1 else 'lies'} within {gap:.3g} mm of another"
            report(j, "repeated points", "repaired" if enough else "removed", curve.points[0], detail)
            if not enough:
                continue
            curve = _curve(rows, curve)  # noqa: PLW2901 - the repaired curve stands for it from here on
        if not curve.closed and len(rows) >= 4 and np.hypot(*(rows[-1] - rows[0])[:2]) <= gap:
            report(
                j, "not closed", "repaired", rows[0], f"its ends lie within {gap:.3g} mm; it is closed there"
            )
            rows = rows[:-1]
            curve = _curve(rows, curve, closed=True)  # noqa: PLW2901
        if curve.length < shortest:
            detail = f"it is {curve.length:.3g} mm long, below {shortest:.6g} mm"
            report(j, "short", "removed", curve.points[0], detail)
            continue
        repaired, done, at, detail = _uncrossed(rows, shortest, gap, closed=curve.closed)
        if at is not None:
            report(j, "crosses itself", done, at, detail)
        if done == "removed":
            continue
        if done == "repaired" and at is not None:
            curve = _curve(repaired, curve)  # noqa: PLW2901
        twin = next((k for k, other in left.items() if _same(curve, other, gap)), None)
        if twin is not None:
            report(j, "double", "removed", curve.points[0], f"it is the same as curve {twin}")
            continue
        left[j] = curve
    for j, k, at in _crossing(left):
        report(k, "crosses another", "kept", at, f"it crosses or touches curve {j}; unite them")
    return [j if curve is curves[j] else curve for j, curve in left.items()], found


def _uncrossed(
    rows: Array, shortest: float, gap: float, *, closed: bool
) -> tuple[Array, Done, Array | None, str]:
    """A curve without short loops, what was done, where it first crosses itself (None: nowhere), and in words."""
    loops, through, crossings = loops_of(rows, closed=closed)
    if not len(crossings):
        return rows, "kept", None, ""
    # What runs out and back on itself encloses nothing, however long it is.
    long = [
        loop
        for loop in loops
        if (curve := Curve(loop[:, :2])).length >= shortest and abs(curve.signed_area) > gap * curve.length
    ]
    at = crossings[0]
    if closed and not long:
        return rows, "removed", at, "it crosses itself, and all its loops are short or empty"
    parts = long if through is None else [through]
    if len(parts) == 1 and len(parts[0]) >= 2 and (closed or not long):
        cut = len(loops) - closed
        what = "what runs out and back is"
        if cut:
            what = f"{cut} short or empty loops are" if cut > 1 else "a short or empty loop is"
        return parts[0], "repaired", at, f"it crosses or touches itself; {what} cut off"
    has = (
        f"{len(long)} long loops" if len(long) > 1 else "a long loop" if long else "no part that is run once"
    )
    return rows, "kept", at, f"it crosses or touches itself and has {has}: which part is meant is not clear"


def loops_of(rows: Array, *, closed: bool) -> tuple[list[Array], Array | None, Array]:
    """The simple loops into which a path falls where it crosses, touches or runs back along itself.

    Args:
        rows: (u, v, ...) of its points, shape (n, m); what is beyond the place is interpolated at crossings.
        closed: whether the path returns to its first point.

    Returns:
        the loops, each of at least three points; of an open path what leads from its beginning to its end; and the
        crossings, shape (k, 2), mm.
    """
    n = len(rows)
    count = n if closed else n - 1
    ends = np.stack([rows[:count, :2], np.roll(rows, -1, axis=0)[:count, :2]], axis=1)
    segments = np.asarray(shapely.linestrings(ends), dtype=np.object_)
    i, j = shapely.STRtree(segments).query(segments, predicate="intersects")
    i, j = i[i < j], j[i < j]
    beside = (j == i + 1) | ((i == 0) & (j == n - 1) & closed)
    shared = shapely.intersection(segments[i], segments[j])
    real = ~beside | (shapely.get_dimensions(shared) == 1)
    i, j, shared = i[real], j[real], shared[real]
    places, which = shapely.get_coordinates(shared, return_index=True)
    if not len(places):
        return [rows] if closed else [], None if closed else rows, places
    # Crossings within rounding are one node.
    node_of: dict[tuple[float, ...], int] = {}
    unit = max(1e-9 * float(np.ptp(rows[:, :2], axis=0).max()), 1e-12)
    nodes: dict[int, int] = {}  # of points
    within: list[list[tuple[float, int]]] = [[] for _ in range(count)]
    for place, pair in zip(places, which, strict=True):
        node = node_of.setdefault(tuple(np.round(place / unit)), len(node_of))
        for k in (int(i[pair]), int(j[pair])):
            along = ends[k, 1] - ends[k, 0]
            share = float((place - ends[k, 0]) @ along) / float(along @ along)
            slack = 2.0 * unit / float(np.hypot(*along))
            if share <= slack:
                nodes[k] = node
            elif share >= 1.0 - slack:
                nodes[(k + 1) % n] = node
            else:
                within[k].append((share, node))
    path: list[tuple[Array, int | None]] = []
    for k in range(n):
        path.append((rows[k], nodes.get(k)))
        for share, node in sorted(within[k]) if k < count else []:
            path.append((rows[k] + share * (rows[(k + 1) % n] - rows[k]), node))
    return *_unwound(path, closed=closed), places


def _unwound(path: Sequence[tuple[Array, int | None]], *, closed: bool) -> tuple[list[Array], Array | None]:
    """Loops between two visits of a node, taken off the path as they close."""
    loops: list[Array] = []
    trail: list[tuple[Array, int | None]] = []
    seen: dict[int, int] = {}
    for row, node in path:
        if node is not None and node in seen:
            start = seen[node]
            if len(trail) - start >= 3:
                loops.append(np.array([point for point, _ in trail[start:]]))
            for _, passed in trail[start + 1 :]:
                if passed is not None:
                    del seen[passed]
            del trail[start + 1 :]
            continue
        if node is not None:
            seen[node] = len(trail)
        trail.append((row, node))
    rest = np.array([point for point, _ in trail])
    if not closed:
        return loops, rest
    return [*loops, *([rest] if len(rest) >= 3 else [])], None


def _rows(curve: Curve) -> Array:
    return curve.points if curve.width is None else np.column_stack([curve.points, curve.width])


def _curve(rows: Array, like: Curve, *, closed: bool | None = None) -> Curve:
    width = None if like.width is None else rows[:, 2]
    return Curve(rows[:, :2], like.closed if closed is None else closed, width)


def _without_repeats(rows: Array, gap: float, *, closed: bool) -> Array:
    kept = [0]
    for k in range(1, len(rows)):
        if np.hypot(*(rows[k] - rows[kept[-1]])[:2]) > gap:
            kept.append(k)
    while closed and len(kept) > 1 and np.hypot(*(rows[kept[-1]] - rows[0])[:2]) <= gap:
        kept.pop()
    return rows[kept]


def _line(curve: Curve) -> shapely.LineString:
    return shapely.LinearRing(curve.points) if curve.closed else shapely.LineString(curve.points)


def _same(a: Curve, b: Curve, gap: float) -> bool:
    if a.closed != b.closed or abs(a.length - b.length) > 1e-3 * a.length + gap:
        return False
    boxes = np.abs(np.subtract(_line(a).bounds, _line(b).bounds))
    return bool(boxes.max() <= gap and shapely.hausdorff_distance(_line(a), _line(b)) <= gap)


def _crossing(curves: dict[int, Curve]) -> list[tuple[int, int, Array]]:
    """Pairs of curves that cross or touch, and where."""
    number = list(curves)
    lines = np.array([_line(curve) for curve in curves.values()], dtype=np.object_)
    i, j = shapely.STRtree(lines).query(lines, predicate="intersects")
    return [
        (number[a], number[b], shapely.get_coordinates(shapely.intersection(lines[a], lines[b]))[0])
        for a, b in zip(i, j, strict=True)
        if a < b
    ]
