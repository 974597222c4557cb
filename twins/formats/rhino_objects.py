"""What a 3DM file shows: its objects, those of blocks where the blocks are inserted, and the unit of the file.

What is hidden, or on a hidden layer, is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from twins.errors import FormatError

Array = npt.NDArray[np.float64]

UNITS: Final = {
    "Microns": "um",
    "Millimeters": "mm",
    "Centimeters": "cm",
    "Decimeters": "dm",
    "Meters": "m",
    "Kilometers": "km",
    "Mils": "mil",
    "Inches": "in",
    "Feet": "ft",
    "Yards": "yd",
}

SILENT: Final = {"None", "Unset"}
"""Unit systems that say nothing."""

DEEPEST: Final = 32
"""Blocks inside blocks, beyond which they are taken to contain themselves."""


@dataclass(frozen=True)
class Shown:
    """An object that is visible.

    Attributes:
        geometry: as rhino3dm has it.
        attributes: as rhino3dm has them.
        placed: shape (4, 4), from the geometry's coordinates to the file's.
        where: the file, the kind of object, and its name or else its id.
    """

    geometry: Any
    attributes: Any
    placed: Array
    where: str


def open_3dm(path: Path) -> Any:
    """The file as rhino3dm has it.

    Raises:
        FormatError: it cannot be read, or rhino3dm is not installed.
    """
    try:
        from .guarded_3dm import open_guarded  # noqa: PLC0415 - only where it is needed
    except ImportError as error:
        raise FormatError(
            f"{path}: reading 3DM needs the package rhino3dm; install it with 'pip install rhino3dm'"
        ) from error
    return open_guarded(path)


def unit_of_3dm(model: Any, path: Path) -> str | None:
    """The unit of the model; None if it has none.

    Raises:
        FormatError: the unit is none that a part is drawn in.
    """
    name = str(model.Settings.ModelUnitSystem.name)
    if name in SILENT:
        return None
    if name not in UNITS:
        raise FormatError(
            f"{path}: its unit is '{name}'; change it to millimetres with the command Units in Rhino, and save"
        )
    return UNITS[name]


def objects_shown(model: Any, path: Path) -> Iterator[Shown]:
    """The visible objects of a model, blocks exploded.

    Raises:
        FormatError: a block is not in the file, or contains itself.
    """
    entries = [entry for entry in model.Objects if not entry.Attributes.IsInstanceDefinitionObject]
    yield from _shown(model, entries, path, np.eye(4), _hidden(model), 0)


def _shown(
    model: Any, entries: Sequence[Any], path: Path, placed: Array, hidden: set[int], depth: int
) -> Iterator[Shown]:
    import rhino3dm  # noqa: PLC0415 - only where it is needed

    if depth > DEEPEST:
        raise FormatError(
            f"{path}: a block contains itself; explode it in Rhino (command ExplodeBlock), or delete it"
        )
    for entry in entries:
        geometry, attributes = entry.Geometry, entry.Attributes
        if not attributes.Visible or attributes.LayerIndex in hidden:
            continue
        where = f"{path}: {type(geometry).__name__} {attributes.Name or attributes.Id}"
        if isinstance(geometry, rhino3dm.InstanceReference):
            reference: Any = geometry
            block = model.InstanceDefinitions.FindId(reference.ParentIdefId)
            if block is None:
                raise FormatError(f"{where}: its block is not in the file; embed it")
            inside = [model.Objects.FindId(str(key)) for key in block.GetObjectIds()]
            parts = [part for part in inside if part is not None]
            yield from _shown(model, parts, path, placed @ _matrix(reference.Xform), hidden, depth + 1)
        else:
            yield Shown(geometry, attributes, placed, where)


def _hidden(model: Any) -> set[int]:
    """Indices of the layers that are off, or under one that is."""
    layers = list(model.Layers)
    off = {str(layer.Id) for layer in layers if not layer.Visible}
    for _ in layers:
        below = {str(layer.Id) for layer in layers if str(layer.ParentLayerId) in off} - off
        if not below:
            break
        off |= below
    return {layer.Index for layer in layers if str(layer.Id) in off}


def _matrix(xform: Any) -> Array:
    return np.array([[getattr(xform, f"M{i}{j}") for j in range(4)] for i in range(4)], dtype=np.float64)
