"""The programs that a controller keeps as files: `NAME.script`, which is also what `NAME.urp` means."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath

FOLDER = PurePosixPath("/programs")
UNNAMED = "<unnamed>"
LARGEST = 1 << 22  # bytes

_DEFINED = re.compile(r"(?:[ \t\r\f\v]*(?:#[^\n]*)?\n)*[ \t]*(?:def|sec)\s")


class ProgramFiles:
    """A folder of programs, one of which may be loaded.

    Attributes:
        path: of the program that is loaded, as the controller names it; empty without one.
        text: of that program; empty where nothing would run.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder.resolve() if folder is not None else None
        self.path = "" if folder is not None else str(FOLDER / "unnamed.urp")
        self.text = ""

    @property
    def name(self) -> str:
        """Of the program that is loaded, without its folder."""
        return PurePosixPath(self.path).name or UNNAMED

    def load(self, name: str) -> bool:
        """Load a program by its name, or its path in the folder; whether there is one."""
        text = as_program(PurePosixPath(name).stem, "") if self._folder is None else self._read(name)
        if text is None or not name:
            return False
        self.path, self.text = str(FOLDER / name), text
        return True

    def _read(self, name: str) -> str | None:
        assert self._folder is not None
        inside = name.removeprefix(f"{FOLDER}/").lstrip("/")
        try:
            file = (self._folder / inside).resolve()
            if file.suffix == ".urp":
                file = file.with_suffix(".script")
            if file.suffix != ".script" or not file.is_relative_to(self._folder):
                return None
            with file.open("rb") as opened:
                text = opened.read(LARGEST).decode("utf-8", "replace")
        except (OSError, ValueError):
            return None
        return as_program(file.stem, text)


def as_program(name: str, text: str) -> str:
    """A program's text: as it is where it defines one, else as the body of one."""
    if _DEFINED.match(text):
        return text
    body = "".join(f"  {line}\n" for line in text.splitlines())
    return f"def {re.sub(r'[^0-9A-Za-z_]', '_', name)}_():\n{body}end\n"
