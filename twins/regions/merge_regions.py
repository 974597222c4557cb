"""Merging regions: the outer walls of separate regions become one curve (facts: Ovenbird's "merge regions")."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor

from twins.entrances import checks_kinds
from twins.toolpath import FAR, Curve, Toolpath

from .linked_layers import Linking, LinkResult, Stages, link_layers
from .linking import LinkKind
from .outlines import walls


@checks_kinds
def merge_regions(
    toolpath: Toolpath,
    width: float,
    kind: LinkKind = "u-turn",
    reach: float = FAR,
    near: tuple[float, float] | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> LinkResult:
    """Join the outer walls of separate regions of each layer, the nearest first, at closest points.

    The strip between the two links of a U-turn joins the region: a bridge a bead width wide. A region in a hole of
    another one stays by itself, since a wall is in between; simplify first to join walls with their holes.

    Args:
        toolpath: closed curves, interior left; open ones stay.
        width: of the bead, mm: distance of the two links of a U-turn.
        kind: see `simplify_regions`.
        reach: longer links are not made, mm.
        near: (u, v); of equally short links the one nearest to it is taken.
        progress: is told the share done, 0 to 1, after each layer.
        executor: works on layers side by side.

    Raises:
        ToolpathError: curves of a layer that cross or enclose nothing on their left; arguments out of range.
    """
    how = Linking(width, kind, reach, near)
    return link_layers(toolpath, how, _outer_walls, progress=progress, executor=executor)


def _outer_walls(curves: Sequence[Curve], where: str) -> list[Stages]:
    return [[frozenset(outer for outer, _ in walls(curves, where))]]
