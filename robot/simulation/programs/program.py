"""A program that was sent to the simulated controller, as its machine steps it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot.simulation.urscript import Running, ScriptError, ScriptRuntimeError, compiled

from .library import library
from .moves import ScriptMoves

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from robot.simulation.machine import Machine


class ScriptProgram:
    """Runs a program, a step a cycle.

    Args:
        machine: whose arm and registers it has.
        text: of the program.
        say: is told what the program says.

    Raises:
        ScriptSyntaxError: the text is no program; nothing was changed.
    """

    def __init__(self, machine: Machine, text: str, say: Callable[[str], None]) -> None:
        self._machine = machine
        self._moves = ScriptMoves(machine, self._waker)
        functions = library(machine, self._moves, say)
        program = compiled(text, functions)
        self.name, self.secondary = program.name, program.secondary
        self._running = Running(program, functions)

    def __iter__(self) -> Iterator[None]:
        return self

    def __next__(self) -> None:
        """Let a cycle pass.

        Raises:
            StopIteration: the program has ended.
            ScriptRuntimeError: it did what ends it.
        """
        goes_on = self._running.step()
        self._moves.settle()
        if not goes_on:
            raise StopIteration

    def run_at_once(self) -> None:
        """Run a secondary program: it takes no time, beside whatever runs.

        Raises:
            ScriptRuntimeError: it did what ends it, or takes time.
        """
        if self._running.step():
            self._running.end()
            raise ScriptRuntimeError("a secondary program cannot take time", 1, 1)

    def _waker(self) -> Callable[[], None]:
        """What lets the thread that now runs go on within a cycle."""
        thread = self._running.current

        def wake() -> None:
            try:
                self._running.wake(thread)
            except ScriptError as error:
                self._machine.fault(error)

        return wake
