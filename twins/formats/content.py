"""What is in a file, before it is read as what its ending says."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from twins.errors import FormatError

_BEGINNINGS: Final[tuple[tuple[bytes, str, tuple[str, ...]], ...]] = (
    (b"3D Geometry File Format", "3DM", (".3dm",)),
    (b"ISO-10303-21", "STEP", (".step", ".stp")),
    (b"glTF", "GLB", (".glb",)),
    (b"PK\x03\x04", "3MF or another archive", (".3mf",)),
    (b"ply\n", "PLY", (".ply",)),
    (b"ply\r", "PLY", (".ply",)),
    (b"AC10", "DWG", (".dwg",)),
    (b"%PDF", "PDF", (".pdf",)),
)
"""First bytes, the format that they tell, and its endings."""


def check_content(path: Path) -> None:
    """Make sure that there is a file, that it is not empty, and that it is no other format by its first bytes.

    Raises:
        FormatError: otherwise; says what it is instead.
    """
    if path.is_dir():
        raise FormatError(f"{path}: is a folder; name the files in it")
    if not path.is_file():
        raise FormatError(f"{path}: no such file")
    try:
        with path.open("rb") as file:
            begins = file.read(32)
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror or error}") from None
    if not begins:
        raise FormatError(f"{path}: is empty; save it again")
    for first, name, endings in _BEGINNINGS:
        if begins.startswith(first) and path.suffix.lower() not in endings:
            raise FormatError(
                f"{path}: is {name} by its content, not {path.suffix[1:].upper()}; end its name in {endings[0]}, or "
                "export it as what it is called"
            )
