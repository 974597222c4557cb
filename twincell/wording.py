"""The engine's sentences in the words of the command line."""

from __future__ import annotations

import re
from collections.abc import Collection

ARGUMENT = re.compile(r"`([a-z_]+)(?:=\"?([^`\"]+)\"?)?`")
"""How sentences name an argument: `close_within`, or `units="mm"` with a value; and functions."""

COMMANDS = {"repair_surface": "twincell new", "wrap": "twincell wrap"}
"""Functions that a command calls."""


def as_options(sentence: str, options: Collection[str]) -> str:
    """A sentence in which arguments that are options are named so, as in `--units mm`, and functions
    that are commands by their command.

    Args:
        sentence: of an error.
        options: as they are typed, with their dashes.
    """

    def typed(named: re.Match[str]) -> str:
        if named[1] in COMMANDS:
            return COMMANDS[named[1]]
        option = "--" + named[1].replace("_", "-")
        if option not in options:
            return named[0]
        return option if named[2] is None else f"{option} {named[2]}"

    return ARGUMENT.sub(typed, sentence)
