"""Pictures of surfaces and toolpaths for the examples, seen in parallel projection: all is to scale, in mm.

    figure, (left, right) = panels(2, (10.0, 5.0))
    view = View(azimuth=-60.0, elevation=20.0)
    drawn = draw_surface(left, surface, view, values=degrees, limits=(0.0, 90.0), cmap="inferno")
    colour_bar(figure, drawn, left, "angle of overhang [°]")
    draw_toolpath(right, toolpath, view)
    for axes in (left, right):
        to_scale(axes)
    save(figure, out / "picture.png")

Surfaces are drawn with a depth buffer, because matplotlib sorts whole faces and shows wrong ones in front.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numba as nb
import numpy as np
import numpy.typing as npt
import shapely
import trimesh
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from twins import Curve, Toolpath

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
Span = tuple[float, float]

CONCRETE = "#cdc7bd"
INK = "#2b2b2b"
_FINER = 2  # pixels drawn for one that is shown, either way
_LIGHT = np.array([-0.45, 0.55, 0.70]) / np.linalg.norm([-0.45, 0.55, 0.70])  # right, up, towards the eye
_SMOOTH = math.cos(math.radians(35.0))  # faces that meet at more than this keep their edge


@dataclass(frozen=True)
class View:
    """Where the eye is, degrees: azimuth 0 looks from +x, 90 from +y, elevation 90 from above."""

    azimuth: float = -60.0
    elevation: float = 20.0

    @property
    def axes(self) -> Array:
        """Columns right, up, towards the eye, shape (3, 3)."""
        a, e = math.radians(self.azimuth), math.radians(self.elevation)
        towards = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
        right = np.array([-math.sin(a), math.cos(a), 0.0])
        return np.column_stack([right, np.cross(towards, right), towards])

    def project(self, points: Array) -> Array:
        """World points, shape (n, 3), to right, up and towards the eye, shape (n, 3), mm."""
        return np.asarray(points @ self.axes, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Drawn:
    """A surface as it was drawn.

    Attributes:
        colours: for `colour_bar`; None where it has one colour.
        view: from where.
        depth: of what is seen, towards the eye, mm; -inf where nothing is, shape (rows, columns), row 0 lowest.
        corner: right and up of the depth's first pixel, mm.
        pixel: mm.
    """

    colours: ScalarMappable | None
    view: View
    depth: Array
    corner: Array
    pixel: float

    def shows(self, points: Array, within: float = 1.0) -> Flags:
        """Which world points, shape (n, 3), are not behind the surface by more than `within` mm; shape (n,)."""
        seen = self.view.project(points)
        column, row = np.floor((seen[:, :2] - self.corner) / self.pixel).astype(int).T
        inside = (row >= 0) & (row < self.depth.shape[0]) & (column >= 0) & (column < self.depth.shape[1])
        flags = np.ones(len(points), dtype=bool)
        flags[inside] = seen[inside, 2] >= self.depth[row[inside], column[inside]] - within
        return flags


def panels(columns: int, size: tuple[float, float], rows: int = 1, **options: Any) -> tuple[Figure, Any]:
    """A figure of `size` inches and its axes, as `Figure.subplots` gives them."""
    mpl.rcParams["font.size"] = 9
    figure = Figure(figsize=size, layout="constrained", facecolor="white")
    return figure, figure.subplots(rows, columns, **options)


def save(figure: Figure, path: Path, dpi: int = 130) -> Path:
    """Write a figure as a PNG and name it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=dpi)
    return path


def draw_surface(
    axes: Any,
    surface: trimesh.Trimesh,
    view: View,
    *,
    values: npt.ArrayLike | None = None,
    limits: Span | None = None,
    cmap: str | Colormap = "viridis",
    colour: str = CONCRETE,
    pixels: int = 700,
) -> Drawn:
    """Draw a surface shaded, in one colour or coloured by values of its faces, shape (m,), or vertices, shape (n,).

    Args:
        axes: to draw in; call `to_scale` afterwards.
        surface: oriented outwards, mm.
        view: from where.
        values: finite.
        limits: of the colours' scale; default those of the values.
        cmap: of values.
        colour: without values.
        pixels: along the longer side of the picture; the more, the slower.
    """
    vertices, faces = np.asarray(surface.vertices, dtype=np.float64), np.asarray(surface.faces, np.int64)
    colours, strong = None, 1.0
    if values is None:
        paint = np.broadcast_to(to_rgb(colour), (len(faces), 3, 3))
    else:
        given = np.asarray(values, dtype=np.float64)
        low, high = (float(given.min()), float(given.max())) if limits is None else limits
        strong = 0.5  # a colour that means something must stay what it is
        colours = ScalarMappable(Normalize(low, high, clip=True), cmap)
        rgb = np.asarray(colours.to_rgba(given))[:, :3]
        paint = rgb[faces] if len(given) == len(vertices) else np.repeat(rgb[:, None], 3, axis=1)
    seen = view.project(vertices)
    low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
    pixel = float((high - low).max()) / (pixels * _FINER)
    margin = 4 * _FINER
    columns, rows = (int(n) for n in _FINER * np.ceil(((high - low) / pixel + 2 * margin) / _FINER))
    corner = low - margin * pixel
    placed = np.column_stack([(seen[:, :2] - corner) / pixel, seen[:, 2]])
    image, depth = _raster(
        placed,
        faces,
        _corner_normals(seen, faces),
        np.ascontiguousarray(paint),
        _LIGHT,
        strong,
        columns,
        rows,
    )
    image *= _relief(depth, 0.012 * pixels * _FINER, pixel)[..., None]
    filled = np.isfinite(depth)
    image = np.dstack([np.where(filled[..., None], image, 0.0), filled])
    image = image.reshape(rows // _FINER, _FINER, columns // _FINER, _FINER, 4).mean(axis=(1, 3))
    image[..., :3] /= np.maximum(image[..., 3:], 1e-9)  # pixels at the rim are half covered, not half black
    extent = (corner[0], corner[0] + columns * pixel, corner[1], corner[1] + rows * pixel)
    axes.imshow(np.clip(image, 0.0, 1.0), extent=extent, origin="lower", interpolation="bilinear", zorder=1)
    return Drawn(colours, view, depth, corner, pixel)


def draw_toolpath(
    axes: Any,
    toolpath: Toolpath,
    view: View,
    *,
    values: Sequence[Sequence[npt.ArrayLike]] | None = None,
    limits: Span | None = None,
    cmap: str | Colormap = "viridis",
    colour: str | None = None,
    linewidth: float = 0.8,
    only: Sequence[Sequence[Flags]] | None = None,
) -> LineCollection:
    """Draw the curves of a toolpath in space, far ones first; coloured by layer unless said otherwise.

    Args:
        axes: to draw in; call `to_scale` afterwards.
        toolpath: open or closed curves; they are drawn in the nozzle planes.
        view: from where.
        values: for each layer and curve one a point, shape (n,).
        limits, cmap: of the colours' scale.
        colour: of all curves, instead.
        linewidth: points.
        only: for each layer and curve flags, shape (n,): segments are drawn that have both ends flagged.
    """
    lines, tones = [], []
    for i, j, layer, curve in toolpath.curves():
        points = layer.nozzle.to_world(curve.points)
        tone = np.full(len(points), float(i)) if values is None else np.asarray(values[i][j], np.float64)
        keep = np.ones(len(points), bool) if only is None else np.asarray(only[i][j])
        last = len(points) if curve.closed else len(points) - 1
        keep, ends = (keep & np.roll(keep, -1))[:last], np.roll(points, -1, axis=0)[:last]
        lines.append(np.stack([points[:last], ends], axis=1)[keep])
        tones.append(tone[:last][keep])
    segments, tone = np.concatenate(lines), np.concatenate(tones)
    seen = view.project(segments.reshape(-1, 3)).reshape(-1, 2, 3)
    order = np.argsort(seen[:, :, 2].mean(axis=1))
    drawn = LineCollection(
        list(seen[order][:, :, :2]),
        cmap=cmap,
        linewidths=linewidth,
        capstyle="round",
        zorder=2,
        colors=colour,
    )
    if colour is None:
        drawn.set_array(tone[order])
        if limits is not None:
            drawn.set_clim(*limits)
    axes.add_collection(drawn)
    axes.autoscale_view()
    return drawn


def draw_curves(axes: Any, curves: Sequence[Curve], **style: Any) -> None:
    """Draw curves of one layer in its plane; style as of `Axes.plot`."""
    label = style.pop("label", None)
    for k, curve in enumerate(curves):
        points = np.vstack([curve.points, curve.points[:1]]) if curve.closed else curve.points
        axes.plot(*points.T, label=label if k == 0 else None, **{"color": INK, "linewidth": 1.0, **style})


def draw_beads(axes: Any, curves: Sequence[Curve], width: float, **style: Any) -> None:
    """Draw the beads of a layer's curves in plan, `width` mm wide; they darken where they overlap."""
    for curve in curves:
        points = np.vstack([curve.points, curve.points[:1]]) if curve.closed else curve.points
        bead = shapely.LineString(points).buffer(0.5 * width)
        for part in shapely.get_parts(bead):
            rings = [np.asarray(ring.coords) for ring in (part.exterior, *part.interiors)]
            outline = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings))
            axes.add_patch(PathPatch(outline, **{"facecolor": INK, "alpha": 0.2, "linewidth": 0.0, **style}))
    axes.autoscale_view()


def mark_stretches(axes: Any, curves: Sequence[Curve], flags: Sequence[Flags], **style: Any) -> None:
    """Draw over the stretches of a layer's curves whose points are flagged, one array a curve, shape (n,)."""
    label = style.pop("label", None)
    lines = []
    for curve, flag in zip(curves, flags, strict=True):
        last = len(flag) if curve.closed else len(flag) - 1
        # Half a segment to either side, so that one point shows as well.
        before, after = (0.5 * (curve.points + np.roll(curve.points, k, axis=0)) for k in (1, -1))
        halves = [np.stack([curve.points, after], axis=1)[:last][flag[:last]]]
        first = 0 if curve.closed else 1
        halves.append(np.stack([before, curve.points], axis=1)[first:][flag[first:]])
        lines.append(np.concatenate(halves))
    options = {"colors": "#d1203a", "linewidths": 3.0, "capstyle": "round", "zorder": 3, **style}
    axes.add_collection(LineCollection(list(np.concatenate(lines)), label=label, **options))


def to_scale(axes: Any, bar: float | None = None, margin: float = 0.03) -> None:
    """Equal aspect, no frame and, with `bar`, a scale bar of so many mm below."""
    axes.set_aspect("equal", adjustable="box")
    axes.margins(margin)
    axes.autoscale_view()
    axes.set_axis_off()
    if bar is not None:
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        below = low - 0.05 * (high - low)
        start = 0.5 * (left + right) - 0.5 * bar
        axes.plot([start, start + bar], [below, below], color=INK, linewidth=2.0, solid_capstyle="butt")
        axes.text(
            start + 0.5 * bar, below - 0.015 * (high - low), f"{bar:g} mm", ha="center", va="top", fontsize=8
        )
        axes.set_xlim(left, right)
        axes.set_ylim(below - 0.07 * (high - low), high)


def colour_bar(figure: Figure, of: Drawn | ScalarMappable, axes: Any, label: str, **options: Any) -> Any:
    """A colour bar beside one or more axes; the label says what and in which unit."""
    colours = of.colours if isinstance(of, Drawn) else of
    if colours is None:
        raise ValueError("a surface in one colour has no colour bar; give values to draw_surface")
    return figure.colorbar(colours, ax=axes, label=label, **{"shrink": 0.7, "aspect": 28, **options})


def _corner_normals(vertices: Array, faces: Faces) -> Array:
    """Unit normals at the corners of faces, shape (m, 3, 3): smooth but across edges."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    around = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(around, faces[:, k], normals)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    around /= np.maximum(np.linalg.norm(around, axis=1, keepdims=True), 1e-300)
    corners = around[faces]
    sharp = np.einsum("ikj,ij->ik", corners, normals) < _SMOOTH
    return np.where(sharp[..., None], normals[:, None], corners)


def _relief(depth: Array, radius: float, pixel: float) -> Array:
    """How bright pixels are for what is around them: darker behind what is near, with a line where depth jumps."""
    filled = np.isfinite(depth)
    flat = np.where(filled, depth, 0.0)
    weight = np.maximum(gaussian_filter(filled.astype(float), radius), 1e-6)
    behind = (gaussian_filter(flat, radius) / weight - flat) / (radius * pixel)
    shade = 1.0 - 0.18 * np.clip(0.5 * behind, 0.0, 1.0)
    far = np.where(filled, depth, flat[filled].min() if filled.any() else 0.0)
    jump = maximum_filter(far, 3) - minimum_filter(far, 3) > 12.0 * pixel
    return np.where(jump, 0.62 * shade, shade)


@nb.njit(cache=True, nogil=True)
def _raster(
    P: Array, F: Faces, N: Array, C: Array, light: Array, strong: float, columns: int, rows: int
) -> tuple[Array, Array]:
    """Colour, shape (rows, columns, 3), and depth of triangles; P in pixels, its third column towards the eye."""
    image = np.ones((rows, columns, 3))
    depth = np.full((rows, columns), -np.inf)
    for f in range(len(F)):
        ax, ay, az = P[F[f, 0], 0], P[F[f, 0], 1], P[F[f, 0], 2]
        bx, by, bz = P[F[f, 1], 0], P[F[f, 1], 1], P[F[f, 1], 2]
        cx, cy, cz = P[F[f, 2], 0], P[F[f, 2], 1], P[F[f, 2], 2]
        doubled = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if doubled <= 1e-12:  # seen from behind
            continue
        for row in range(max(int(min(ay, by, cy)), 0), min(int(max(ay, by, cy)) + 1, rows)):
            for column in range(max(int(min(ax, bx, cx)), 0), min(int(max(ax, bx, cx)) + 1, columns)):
                x, y = column + 0.5, row + 0.5
                u = ((cx - bx) * (y - by) - (cy - by) * (x - bx)) / doubled
                v = ((ax - cx) * (y - cy) - (ay - cy) * (x - cx)) / doubled
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                z = u * az + v * bz + w * cz
                if z <= depth[row, column]:
                    continue
                depth[row, column] = z
                nx, ny, nz = 0.0, 0.0, 0.0
                for k, share in enumerate((u, v, w)):
                    nx += share * N[f, k, 0]
                    ny += share * N[f, k, 1]
                    nz += share * N[f, k, 2]
                size = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
                lit = max((nx * light[0] + ny * light[1] + nz * light[2]) / size, 0.0)
                bright = 1.0 + strong * (0.50 * lit + 0.20 * max(nz / size, 0.0) - 0.60)
                for channel in range(3):
                    image[row, column, channel] = bright * (
                        u * C[f, 0, channel] + v * C[f, 1, channel] + w * C[f, 2, channel]
                    )
    return image, depth


def draw_edges(
    axes: Any, drawn: Drawn, points: Array, edges: Faces, *, within: float | None = None, **style: Any
) -> LineCollection:
    """Draw edges, shape (k, 2), between world points, shape (n, 3), where the surface as drawn does not hide them.

    Edges are looked at in pieces about ten pixels long, and hidden where they lie more than `within` mm behind the
    surface, default six pixels; style as of `LineCollection`.
    """
    ends = points[edges]
    length = np.linalg.norm(
        np.diff(drawn.view.project(ends.reshape(-1, 3)).reshape(-1, 2, 3)[..., :2], axis=1), axis=2
    )
    pieces = np.maximum(np.ceil(length[:, 0] / (10.0 * drawn.pixel)), 1.0).astype(np.int64)
    owner = np.repeat(np.arange(len(edges)), pieces)
    first = np.arange(len(owner)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    shares = np.stack([first, first + 0.5, first + 1.0], axis=1) / pieces[owner][:, None]
    start, way = ends[owner, 0], ends[owner, 1] - ends[owner, 0]
    placed = start[:, None] + shares[..., None] * way[:, None]
    seen = drawn.shows(placed[:, 1], within=6.0 * drawn.pixel if within is None else within)
    lines = drawn.view.project(placed[seen][:, [0, 2]].reshape(-1, 3)).reshape(-1, 2, 3)[..., :2]
    options = {"colors": INK, "linewidths": 0.4, "capstyle": "round", "zorder": 2, **style}
    collection = LineCollection(list(lines), **options)
    axes.add_collection(collection)
    return collection
