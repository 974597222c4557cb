"""Linked layers: curves of a layer linked into fewer, and what that does to area and to the material laid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.extrusion import bead_region
from twins.toolpath import FAR, Curve, Toolpath, read_only

from .linking import Link, LinkKind, link
from .outlines import with_curves, with_layers

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Linking:
    """How curves are linked.

    Attributes:
        width: of the bead, mm: distance of the two links of a U-turn.
        kind: of the links.
        reach: links longer than this are not made, mm.
        near: (u, v); of equally short links the one nearest to it is taken.
    """

    width: float
    kind: LinkKind = "u-turn"
    reach: float = FAR
    near: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not self.width > 0 or not np.isfinite(self.width):
            raise ToolpathError(f"the bead width must be above 0 mm, not {self.width}")
        if self.kind not in ("u-turn", "crossing"):
            raise ToolpathError(f"curves are joined by a 'u-turn' or a 'crossing', not {self.kind!r}")
        if not self.reach > 0:
            raise ToolpathError(f"the reach of links must be above 0 mm, not {self.reach}")
        if self.near is not None:
            read_only(self.near, (2,), "the place that links should be near to, (u, v) in mm,")


@dataclass(frozen=True, eq=False)
class LinkedLayer:
    """What linking did to a layer.

    Attributes:
        layer: index.
        curves: how many there were, and are.
        links: middle lines of the links, shape (k, 2, 2), mm; (u, v) on the one curve and on the other.
        areas: enclosed before and after, mm²; after crossings the curves do not bound a region: NaN.
        covered: by beads before and after, mm².
        uncovered: of what was covered before, mm².
    """

    layer: int
    curves: tuple[int, int]
    links: Array
    areas: tuple[float, float]
    covered: tuple[float, float]
    uncovered: float


@dataclass(frozen=True, eq=False)
class LinkResult:
    """A toolpath of fewer curves.

    Attributes:
        toolpath: layers in which nothing was linked are the same objects.
        layers: figures of the others.
        remarks: a sentence for each region whose curves could not all be linked.
    """

    toolpath: Toolpath
    layers: tuple[LinkedLayer, ...]
    remarks: tuple[str, ...]


Group = tuple[int, ...]
Stages = Sequence[frozenset[int]]
"""Curves of one group that may be linked to one another: in the first stage these, then these and so on."""


@checks_kinds
def link_layers(
    toolpath: Toolpath,
    how: Linking,
    groups: Callable[[Sequence[Curve], str], list[Stages]],
    *,
    progress: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> LinkResult:
    """Link the curves of each layer into one a group.

    Args:
        toolpath: closed curves, interior left; open ones stay and are in no link's way.
        how: they are linked.
        groups: of the curves of a layer, by index; the string names the layer. A module's function, if the executor
            has other processes.
        progress: is told the share done, 0 to 1, after each layer.
        executor: works on layers side by side.
    """
    calls = [
        (layer.curves, how, groups(layer.curves, f"layer {i}"), i) for i, layer in enumerate(toolpath.layers)
    ]
    calls = [call for call in calls if any(len(stages[-1]) > 1 for stages in call[2])]
    layers = list(toolpath.layers)
    figures, remarks = [], []
    worker = map if executor is None else executor.map
    for done, (call, (made, figure, said)) in enumerate(zip(calls, worker(_of_layer, calls), strict=True)):
        curves, *_, i = call
        layers[i] = with_curves(layers[i], [curves[c] if isinstance(c, int) else c for c in made])
        figures += [figure] if len(figure.links) else []
        remarks += said
        if progress is not None:
            progress((done + 1) / len(calls))
    return LinkResult(with_layers(toolpath, layers), tuple(figures), tuple(remarks))


def _of_layer(
    call: tuple[Sequence[Curve], Linking, list[Stages], int],
) -> tuple[list[int | Curve], LinkedLayer, list[str]]:
    curves, how, groups, i = call
    made: dict[int, Curve] = dict(enumerate(curves))
    links: list[Link] = []
    remarks = []
    with np.errstate(all="ignore"):  # GEOS leaves flags of its own
        for stages in groups:
            left = set(stages[-1])
            failed: set[frozenset[int]] = set()
            for stage in stages:
                while (pair := _nearest(made, left & stage, failed, how.reach)) is not None:
                    one, two = pair
                    others = [curve for k, curve in made.items() if k not in pair and curve.closed]
                    near = None if how.near is None else np.array(how.near)
                    done = link(made[one], made[two], how.width, how.kind, others, near)
                    if done is None or done.length > how.reach:
                        failed.add(frozenset(pair))
                        continue
                    made[one] = done.curve
                    del made[two]
                    left.discard(two)
                    failed = {pair for pair in failed if one not in pair}
                    links.append(done)
            if len(left) > 1:
                remarks.append(
                    f"layer {i}: curves {', '.join(map(str, sorted(left)))} stay apart: no link of at most "
                    f"{how.reach:.6g} mm fits between them"
                    if how.reach < FAR
                    else f"layer {i}: curves {', '.join(map(str, sorted(left)))} stay apart: no link fits between them"
                )
        after = [made[k] for k in sorted(made)]
        figure = _figure(i, curves, after, links, how)
    old = {id(curve): k for k, curve in enumerate(curves)}
    return [old.get(id(curve), curve) for curve in after], figure, remarks


def _nearest(
    curves: dict[int, Curve], among: set[int], failed: set[frozenset[int]], reach: float
) -> tuple[int, int] | None:
    """The two nearest of some curves that have not been tried, the lower index first."""
    rims = {k: shapely.LinearRing(curves[k].points) for k in among}
    pairs = [
        (a, b) for a in sorted(among) for b in sorted(among) if a < b and frozenset((a, b)) not in failed
    ]
    gaps = [float(rims[a].distance(rims[b])) for a, b in pairs]
    if not gaps or min(gaps) > reach:
        return None
    return pairs[int(np.argmin(gaps))]


def _figure(
    i: int, before: Sequence[Curve], after: Sequence[Curve], links: Sequence[Link], how: Linking
) -> LinkedLayer:
    beads = [bead_region(curves, how.width, 0.0) for curves in (before, after)]
    areas = [sum(curve.signed_area for curve in curves) for curves in (before, after)]
    return LinkedLayer(
        i,
        (len(before), len(after)),
        np.array([made.ends for made in links]).reshape(-1, 2, 2),
        (areas[0], areas[1] if how.kind == "u-turn" or not links else float("nan")),
        (beads[0].area, beads[1].area),
        shapely.difference(beads[0], beads[1]).area,
    )
