"""Simplifying regions: the walls of a region become one continuous curve (facts: Ovenbird's "simplify region")."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import Literal

from twins.entrances import checks_kinds
from twins.errors import ToolpathError
from twins.toolpath import FAR, Curve, Toolpath

from .linked_layers import Linking, LinkResult, Stages, link_layers
from .linking import LinkKind
from .outlines import walls

Order = Literal["inner first", "nearest"]


@checks_kinds
def simplify_regions(
    toolpath: Toolpath,
    width: float,
    kind: LinkKind = "u-turn",
    order: Order = "inner first",
    reach: float = FAR,
    near: tuple[float, float] | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> LinkResult:
    """Join the curves of each region into one, at closest points.

    Args:
        toolpath: closed curves, interior left; open ones stay.
        width: of the bead, mm: distance of the two links of a U-turn.
        kind: "u-turn": the joined curve bounds the region without the strips between links and does not cross
            itself. "crossing": the links cross, the curve joined last runs backwards; for printing only.
        order: "inner first": inner walls are joined to one another, the nearest first, then to the outer wall.
            "nearest": always the two nearest curves, which gives the shortest links.
        reach: longer links are not made, mm.
        near: (u, v); of equally short links the one nearest to it is taken, which aligns the links of tubes.
        progress: is told the share done, 0 to 1, after each layer.
        executor: works on layers side by side.

    Raises:
        ToolpathError: curves of a layer that cross or enclose nothing on their left; arguments out of range.
    """
    if order not in ("inner first", "nearest"):
        raise ToolpathError(f"regions are simplified in order 'inner first' or 'nearest', not {order!r}")
    how = Linking(width, kind, reach, near)
    groups = partial(_walls_of_regions, order)
    return link_layers(toolpath, how, groups, progress=progress, executor=executor)


def _walls_of_regions(order: Order, curves: Sequence[Curve], where: str) -> list[Stages]:
    return [
        [frozenset(inner), frozenset((outer, *inner))]
        if order == "inner first"
        else [frozenset((outer, *inner))]
        for outer, inner in walls(curves, where)
        if inner
    ]
