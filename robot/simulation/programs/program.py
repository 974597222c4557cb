"""A program that was sent to the simulated controller, as its machine steps it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot.simulation.urscript import Running, ScriptError, ScriptRuntimeError

from .interpreter import Interpreter
from .library import library
from .moves import ScriptMoves
from .sockets import Sockets

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from robot.simulation.machine import Machine
    from robot.simulation.urscript import Compiled


class ScriptProgram:
    """Runs a program, a step a cycle.

    Args:
        machine: whose arm and registers it has.
        program: compiled with the functions of `library`.
        say: is told what the program says.
    """

    def __init__(self, machine: Machine, program: Compiled, say: Callable[[str], None]) -> None:
        self._machine = machine
        self._moves = ScriptMoves(machine, self._waker)
        self.name, self.secondary = program.name, program.secondary
        self._sockets = Sockets(machine, say)
        self._interpreter = Interpreter(machine)
        functions = library(machine, self._moves, say, self._sockets, self._interpreter)
        self._running = Running(program, functions)
        if program.around is not None:
            self._interpreter.begin(self._running, functions, program.around)

    def __iter__(self) -> Iterator[None]:
        return self

    def __next__(self) -> None:
        """Let a cycle pass.

        Raises:
            StopIteration: the program has ended.
            ScriptRuntimeError: it did what ends it.
        """
        if not self._interpreter.ended:
            self._machine.interpreter = self._interpreter
        goes_on = self._running.step()
        self._moves.settle()
        if not goes_on and not self._moves.running_out:
            raise StopIteration

    def close(self) -> None:
        """End the program, and what it has open."""
        self._running.end()
        self._sockets.close_all()
        self._interpreter.end()

    def run_at_once(self) -> None:
        """Run a secondary program: it takes no time, beside whatever runs.

        Raises:
            ScriptRuntimeError: it did what ends it, or takes time.
        """
        try:
            if self._running.step():
                raise ScriptRuntimeError("a secondary program cannot take time", 1, 1)
        finally:
            self.close()

    def _waker(self) -> Callable[[], None]:
        """What lets the thread that now runs go on within a cycle."""
        thread = self._running.current

        def wake() -> None:
            try:
                self._running.wake(thread)
            except ScriptError as error:
                self._machine.fault(error)

        return wake
