"""Interpreter mode: statements that come while a program runs, and are run as part of it.

A program that calls `interpreter_mode` may get statements for as long as it runs; they are run one after another while
it is in that call. They see the program's variables and functions, and those of the statements before them, until
these are cleared.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from robot.simulation.urscript import Added, Around, Library, Refusal, added, builtin
from robot.simulation.urscript.values import Value, truth

if TYPE_CHECKING:
    from robot.simulation.machine import Machine
    from robot.simulation.urscript import Builtin, Running

MOST = 1000
"""Statements that are kept until they are cleared."""

CLEAR, END = "clear_interpreter", "end_interpreter"


@dataclass(frozen=True)
class _Statement:
    number: int
    added: Added


class Interpreter:
    """Interpreter mode of one program.

    Args:
        machine: whose move `abort` ends.

    Attributes:
        last_interpreted, last_executed, last_cleared: numbers of statements, from 1; one that runs counts as executed.
    """

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._running: Running | None = None
        self._library: Library = {}
        self._base: Around | None = None
        self._known: Around | None = None  # to the statement that was executed last
        self._around: Around | None = None  # to that which was taken last
        self._waiting: deque[_Statement] = deque()
        self._ending = self._aborting = False
        self._current: _Statement | None = None
        self.last_interpreted = self.last_executed = self.last_cleared = 0

    def begin(self, running: Running, library: Library, around: Around) -> None:
        """Let statements be added to a program."""
        self._running, self._library = running, library
        self._base = self._known = self._around = around

    def end(self) -> None:
        """The program has ended: no more statements."""
        self._around = None
        self._waiting.clear()

    @property
    def ended(self) -> bool:
        return self._around is None

    @property
    def unexecuted(self) -> int:
        """Statements that wait."""
        return len(self._waiting)

    @property
    def clearing(self) -> bool:
        """Whether a statement that clears the others waits; what comes after it is not to be read before."""
        return any(CLEAR in statement.added.calls for statement in self._waiting)

    def read(self, text: str) -> tuple[Added, Around]:
        """A statement, and what it was read beside; this changes nothing and may be done in a thread.

        Raises:
            Refusal: no more are taken.
            ScriptSyntaxError: it is none, or names what there is not.
        """
        around = self._around
        if around is None:
            raise Refusal("no program is running that takes statements")
        return added(text, self._library, around), around

    def take(self, found: Added, around: Around) -> int:
        """Take a statement that was read; its number.

        Raises:
            Refusal: no more are taken, or what it was read beside is gone.
        """
        if self._around is not around:
            raise Refusal("the program has ended or its statements were cleared")
        if self.last_interpreted - self.last_cleared >= MOST and not found.calls & {CLEAR, END}:
            raise Refusal(f"{MOST} statements are kept already; clear them")
        self._around = found.around
        if found.globals and self._base is not None:
            self._base = replace(self._base, names=self._base.names | found.globals)
        self.last_interpreted += 1
        self._waiting.append(_Statement(self.last_interpreted, found))
        return self.last_interpreted

    def skip(self) -> None:
        """Let no statement be run that waits: what it defines there is not."""
        self._waiting.clear()
        if self._around is not None and self._known is not None:
            self._around = replace(self._known, statements=self._around.statements)

    def abort(self) -> None:
        """End the statement that moves the arm."""
        self._aborting = self._machine.motion is not None

    def functions(self) -> Iterator[Builtin]:
        """The functions of the program."""
        defaults = {"clearQueueOnEnter": True, "clearOnEnd": True}
        yield builtin("interpreter_mode(clearQueueOnEnter, clearOnEnd)", self._mode, defaults)
        yield builtin(f"{END}()", self._end)
        yield builtin(f"{CLEAR}()", self._clear)

    def _mode(self, clear_on_enter: Value, clear_on_end: Value) -> Iterator[None]:
        if self._running is None or not self._running.in_main or self._current is not None:
            raise Refusal(
                "interpreter mode is for the program itself, not for its threads or for a statement"
            )
        if truth(clear_on_enter):
            self.skip()
        self._ending = False
        while not self._ending:
            if self._waiting:
                yield from self._run(self._waiting.popleft())
            else:
                yield
        if truth(clear_on_end):
            self._clear()
            self.skip()

    def _run(self, statement: _Statement) -> Iterator[None]:
        assert self._running is not None
        self._current, self._aborting = statement, False
        self.last_executed, self._known = statement.number, statement.added.around
        steps = self._running.add(statement.added)
        try:
            for _ in steps:
                yield
                if self._aborting:
                    return
        finally:
            self._current = None
            close = getattr(steps, "close", None)
            if close is not None:
                close()

    def _end(self) -> None:
        self._ending = True

    def _clear(self) -> None:
        if self._running is None or self._base is None or self._around is None:
            return
        self._running.forget(self._around.names - self._base.names)
        self._base = self._known = self._around = replace(self._base, statements=self._around.statements)
        self.last_cleared = self._current.number if self._current is not None else self.last_executed
