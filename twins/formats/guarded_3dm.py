"""3DM files opened behind a guard: a broken one can stop rhino3dm for ever, or the process with it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import rhino3dm

from twins.errors import FormatError

PATIENCE = 20.0
"""Seconds that a child process has to read a file, and one more for each megabyte."""

_TRY = "import sys, rhino3dm; sys.exit(0 if rhino3dm.File3dm.Read(sys.argv[1]) else 3)"


def open_guarded(path: Path, patience: float = PATIENCE) -> Any:
    """The model in a 3DM file, as rhino3dm has it, after a child process has read it without harm.

    Args:
        path: of the file.
        patience: seconds, and one more for each megabyte.

    Raises:
        FormatError: the file is broken.
    """
    try:
        tried = subprocess.run(
            [sys.executable, "-c", _TRY, str(path)],
            capture_output=True,
            check=False,
            timeout=patience + 1e-6 * path.stat().st_size,
        ).returncode
    except subprocess.TimeoutExpired:
        tried = None
    model: Any = rhino3dm.File3dm.Read(str(path)) if tried == 0 else None
    if model is None:
        why = "reading it does not end" if tried is None else "it is broken or cut off"
        raise FormatError(f"{path}: cannot be read as 3DM: {why}; save it again from Rhino")
    return model
