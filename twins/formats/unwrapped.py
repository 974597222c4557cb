"""Unwrapped curves as files: polylines with their layer, plane, tangents, heights and widths."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from twins.wrapping.unwrapping import UnwrappedCurve

from .curves import save_labelled
from .labelled import Labelled

SUFFIXES = (".dxf", ".3dm", ".json", ".csv")


def save_unwrapped(curves: Sequence[UnwrappedCurve], path: Path | str) -> None:
    """Write unwrapped curves in mm to DXF, 3DM, JSON or CSV; `read_curves` reads them all.

    JSON, CSV and the user text of 3DM carry everything; DXF carries widths at the vertices, and heights, indices
    and plane as extended data. In DXF and 3DM each layer of the toolpath is a layer of the drawing, `layer_0000` up.

    Raises:
        FormatError: an unknown ending, no curves, or no such folder.
    """
    lines = [
        Labelled(
            curve.space_curve,
            layer=f"layer_{curve.layer:04d}",
            indices={"layer": curve.layer, "curve": curve.curve},
            plane=curve.plane,
            columns={"tangent": curve.tangents, "height": curve.heights},
        )
        for curve in curves
    ]
    save_labelled(lines, path, SUFFIXES)
