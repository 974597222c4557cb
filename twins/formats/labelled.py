"""A curve with what a drawing says about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from twins.errors import FormatError
from twins.toolpath import Plane
from twins.wrapping.space_curve import SpaceCurve

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Labelled:
    """A curve with what a drawing says about it.

    Attributes:
        curve: the polyline.
        layer: name of the drawing's layer that it lies on.
        indices: whole numbers by name, such as its layer in a toolpath.
        plane: that it lies in, if it is known.
        columns: values at each point by name, shape (n,) or (n, 3).
    """

    curve: SpaceCurve
    layer: str = "curves"
    indices: Mapping[str, int] = field(default_factory=dict)
    plane: Plane | None = None
    columns: Mapping[str, Array] = field(default_factory=dict)


def write_whole(
    path: Path, write: Callable[[Path, Sequence[Labelled]], None], lines: Sequence[Labelled]
) -> None:
    """Let `write` make a file that appears whole or not at all."""
    # The libraries look at the ending, so the partial file keeps it.
    partial = path.with_name(f".partial-{path.name}")
    try:
        write(partial, lines)
        partial.replace(path)
    except OSError as error:
        raise FormatError(f"{path}: cannot be written: {error.strerror or error}") from None
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from None
    finally:
        partial.unlink(missing_ok=True)
