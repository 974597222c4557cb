"""Which reader takes which file."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from twins.errors import FormatError

from .content import check_content
from .meshes import SUFFIXES as MESH_SUFFIXES
from .meshes import read_mesh, unit_of_mesh
from .polygons import Polygons

STEP_SUFFIXES: Final = (".step", ".stp")

SUFFIXES: Final = (*MESH_SUFFIXES, *STEP_SUFFIXES, ".3dm")


def check_file(path: Path) -> None:
    """Make sure that there is a file, with an ending that is known and a content that does not contradict it.

    Raises:
        FormatError: there is none, or it has another ending, or is something else.
    """
    if path.suffix.lower() not in SUFFIXES and not path.is_dir():
        raise FormatError(
            f"{path}: unknown ending '{path.suffix}'; a part is read from {', '.join(SUFFIXES)}"
        )
    check_content(path)


def unit_of(path: Path | str) -> str | None:
    """The length unit that a file states: "mm", "m", "in", …; None where the format has none, or the file.

    Raises:
        FormatError: no such file, an unknown ending, or a file that cannot be read.
    """
    path = Path(path)
    check_file(path)
    suffix = path.suffix.lower()
    try:
        if suffix in STEP_SUFFIXES:
            from .step import unit_of_step  # noqa: PLC0415 - only where it is needed

            return unit_of_step(path)
        if suffix == ".3dm":
            from .rhino_objects import open_3dm, unit_of_3dm  # noqa: PLC0415 - only where it is needed

            return unit_of_3dm(open_3dm(path), path)
        return unit_of_mesh(path)
    except FormatError:
        raise
    except Exception as error:
        raise FormatError(
            f"{path}: cannot be read as {suffix[1:].upper()}: it is broken or cut off"
        ) from error


def read_polygons(path: Path, unit: str | None, chord: float, *, polygons: bool) -> Polygons:
    """The faces in a file, in the file's unit; smooth surfaces as triangles within `chord` mm of them.

    Args:
        path: of the file.
        unit: what the file is in if it does not say so itself; None for mm.
        chord: mm.
        polygons: keep faces of more than three corners, and the control nets of SubDs.

    Raises:
        FormatError: it cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix in STEP_SUFFIXES:
        from .step import read_step  # noqa: PLC0415 - only where it is needed

        return read_step(path, chord)
    if suffix == ".3dm":
        from .rhino import read_3dm  # noqa: PLC0415 - only where it is needed

        return read_3dm(path, unit, chord, polygons=polygons)
    return read_mesh(path, polygons=polygons)
