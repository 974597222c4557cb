"""What a program tells: messages, and popups on the pendant, which somebody may have to close."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from robot.simulation.urscript import builtin
from robot.simulation.urscript.strings import shown
from robot.simulation.urscript.values import Value, truth

if TYPE_CHECKING:
    from robot.simulation.machine import Machine
    from robot.simulation.urscript import Builtin


def message_functions(machine: Machine, say: Callable[[str], None]) -> Iterator[Builtin]:
    """The functions of one program.

    Args:
        machine: whose pendant shows a popup, until it is closed on the dashboard or another takes its place.
        say: is told what the program says.
    """

    def popup(s: Value, title: Value, warning: Value, error: Value, blocking: Value) -> Iterator[None]:
        level = "error" if truth(error) else "warning" if truth(warning) else "message"
        text = f"{shown(title)}: {shown(s)}"
        say(f"popup, {level}: {text}")
        machine.popup = text
        if not truth(blocking):
            return
        try:
            yield
            while machine.popup is text:
                yield
        finally:
            if machine.popup is text:
                machine.popup = None

    yield builtin("textmsg(s1, s2)", lambda s1, s2: say(shown(s1) + shown(s2)), {"s2": ""})
    yield builtin(
        "popup(s, title, warning, error, blocking)",
        popup,
        {"title": "Popup", "warning": False, "error": False, "blocking": False},
    )
