"""Runs a program, cycle by cycle.

Each thread runs until it does something that takes time; what it then waits for is asked again in the next cycle. A
thread that runs long without is interrupted, and if it goes on like this, the program ends: so no program holds the
controller up, nor does one that fills the memory. A thread that is interrupted in a critical section goes on before any
other runs; while one waits for something there, the others run, as programs in use rely on.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from planning import PlanningError

from . import lists, values
from .compiling import FILE
from .errors import Refusal, ScriptError, ScriptRuntimeError
from .scopes import MAIN
from .values import Thread, Value, integer

if TYPE_CHECKING:
    from .compiling import Added, Compiled
    from .functions import Library

SLICE = 1000
"""Rounds of loops, and calls of functions that loop, that a thread may do in a cycle."""

BUSY = 0.005
"""Wall time that it may take for that, s."""

PATIENCE = 500
"""Cycles in a row that a thread may fill like this."""

CALLS = 20_000
"""Calls of functions that take no time, of all threads in a cycle."""

CALLS_AT_ONCE = 8
"""Of them for one look at the clock."""

STUCK = 1.0
"""Wall time that a function that takes no time may take, s."""

MEMORY = 512 << 20
"""Bytes by which the process may grow while a program runs."""

_VARIABLE = re.compile(r"'v_(\w+)'")

_STATUS = Path("/proc/self/statm")
_PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096

THREADS = 100
"""Most threads at once."""

STEPS: tuple[Callable[..., Any], ...] = (
    values.add,
    values.subtract,
    values.multiply,
    values.divide,
    values.remainder,
    values.negative,
    values.less,
    values.at_most,
    values.more,
    values.at_least,
    values.equal,
    values.differ,
    values.either,
    values.pose,
    values.item,
    values.put,
    values.member,
    values.put_member,
    values.copied,
    values.truth,
    values.listed,
    lists.items,
    lists.struct,
    lists.method,
)


class _End(BaseException):
    """`halt`, or a thread that kills itself: neither is an error."""

    def __init__(self, *, of_program: bool) -> None:
        super().__init__()
        self.of_program = of_program


@dataclass(eq=False)
class _Thread:
    handle: Thread
    steps: Iterator[None]
    filled: int = 0  # cycles in a row
    critical: bool = False  # in a critical section


class Running:
    """A program that runs.

    Args:
        program: what runs.
        library: the functions of the controller, as those that it was compiled with.

    Attributes:
        threads: number of threads, that of the program itself included; 0 when it has ended.
    """

    def __init__(self, program: Compiled, library: Library) -> None:
        self.name = program.name
        self._handles = 0
        self._threads: list[_Thread] = []
        self._current: _Thread | None = None
        self._critical: _Thread | None = None  # before which no other runs
        self._interrupted = False
        self._left = self._calls = self._cycles = 0
        self._began = self._due = 0.0
        self._memory = _memory()
        self._library = library
        names: dict[str, Any] = {
            "__builtins__": {},
            **{step.__name__: step for step in STEPS},
            "less": values.less,
            "at_most": values.at_most,
            "more": values.more,
            "at_least": values.at_least,
            "positive": lambda value: values.add(0, value) if not isinstance(value, list) else value,
            **{f"b_{name}": library[name].call for name in program.calls},
            **{
                step.__name__.lstrip("_"): step
                for step in (self._tick, self._enter, self._run, self._kill, self._join, self._halt)
            },
            "enter_critical": self._enter_critical,
            "exit_critical": self._exit_critical,
        }
        self._names = names
        for code in program.codes:
            exec(code, names)  # noqa: S102 - our own translation of the program; it reaches what `names` has
        self._run(names[MAIN])

    def add(self, statements: Added) -> Iterator[None]:
        """Run statements as part of the program, in the thread that goes through what is returned."""
        self._names.update({f"b_{name}": self._library[name].call for name in statements.calls})
        exec(statements.code, self._names)  # noqa: S102 - as above
        steps: Iterator[None] = self._names[statements.main]()
        return steps

    def forget(self, names: Iterable[str]) -> None:
        """Take variables away."""
        for name in names:
            self._names.pop(f"v_{name}", None)

    @property
    def threads(self) -> int:
        return len(self._threads)

    def step(self) -> bool:
        """Let a cycle pass; whether the program goes on.

        Raises:
            ScriptRuntimeError: it did what ends it.
        """
        self._calls = CALLS
        self._cycles += 1
        if self._cycles % 64 == 0:
            try:
                self._check_memory()
            except Refusal as refusal:
                self.end()
                raise ScriptRuntimeError(str(refusal), 1, 1) from None
        place = 0
        while place < len(self._threads):
            thread = self._threads[place]
            if self._critical is None or self._critical is thread:
                if not self._advance(thread):
                    self.end()
                    return False
                if thread not in self._threads:
                    continue
            place += 1
        return bool(self._threads)

    @property
    def current(self) -> Thread:
        """Handle of the thread that now runs; 0 between cycles."""
        return self._current.handle if self._current is not None else Thread(0)

    @property
    def in_main(self) -> bool:
        """Whether the thread that now runs is the program's own."""
        return self._current is not None and self._threads[:1] == [self._current]

    def wake(self, handle: Thread) -> None:
        """Let one thread go on within a cycle, because what it waits for has happened.

        Raises:
            ScriptRuntimeError: it did what ends the program.
        """
        thread = self._found(handle)
        if thread is not None and self._critical in (None, thread) and not self._advance(thread):
            self.end()

    def end(self) -> None:
        """End all threads; that which asks for it, when it next waits."""
        ended, self._threads = self._threads, []
        self._critical = None
        for thread in ended:
            if thread is not self._current:
                _close(thread.steps)

    def _advance(self, thread: _Thread) -> bool:
        """Let one thread run; whether the program goes on."""
        self._current, self._left, self._interrupted = thread, SLICE, False
        self._began = perf_counter()
        self._due = self._began + BUSY
        goes_on = True
        try:
            next(thread.steps)
        except StopIteration:
            goes_on = self._finish(thread)
        except _End as end:
            goes_on = self._finish(thread) and not end.of_program
        except ScriptError:
            self.end()
            raise
        except Exception as error:
            self.end()
            raise _placed(error) from error
        finally:
            self._current = None
        if goes_on and not self._threads:
            _close(thread.steps)
            return False
        if not self._interrupted:
            thread.filled = 0
        alive = thread in self._threads
        self._critical = thread if alive and thread.critical and self._interrupted else None
        return goes_on

    def _finish(self, thread: _Thread) -> bool:
        """Take a thread away; whether the program goes on without it."""
        if self._critical is thread:
            self._critical = None
        was_main = self._threads[:1] == [thread]
        if thread in self._threads:
            self._threads.remove(thread)
        return not was_main

    # -- what the translated program calls

    def _tick(self) -> bool:
        self._left -= 1
        if self._left > 0 and (self._left % 8 or perf_counter() < self._due):
            return False
        assert self._current is not None
        self._check_memory()
        self._interrupted = True
        self._current.filled += 1
        if self._current.filled > PATIENCE:
            raise Refusal("an infinite loop: nothing in it takes time; put a sync() into it")
        return True

    def _enter(self) -> None:
        self._calls -= 1
        if self._calls % CALLS_AT_ONCE:
            return
        now = perf_counter()
        if self._calls < 0 or now > self._began + STUCK:
            raise Refusal("too many calls without anything that takes time")
        if now > self._due:
            self._due = now + BUSY
            self._check_memory()

    def _check_memory(self) -> None:
        if _memory() > self._memory + MEMORY:
            raise Refusal("the program fills the controller's memory")

    def _run(self, function: Callable[[], Iterator[None]]) -> Thread:
        if len(self._threads) >= THREADS:
            raise Refusal(f"more than {THREADS} threads")
        self._handles += 1
        self._threads.append(_Thread(Thread(self._handles), function()))
        return self._threads[-1].handle

    def _found(self, handle: Value) -> _Thread | None:
        wanted = integer(handle, "a thread")
        return next((thread for thread in self._threads if thread.handle == wanted), None)

    def _kill(self, handle: Value) -> None:
        thread = self._found(handle)
        if thread is None:
            return  # it has ended, or never began
        if thread is self._current or thread is self._threads[0]:
            raise _End(of_program=thread is self._threads[0])
        self._finish(thread)
        _close(thread.steps)

    def _join(self, handle: Value) -> Iterator[None]:
        while (thread := self._found(handle)) is not None:
            if thread is self._current:
                raise Refusal("a thread cannot wait for its own end")
            yield

    def _halt(self) -> None:
        raise _End(of_program=True)

    def _enter_critical(self) -> None:
        if self._current is not None:
            self._current.critical = True

    def _exit_critical(self) -> None:
        if self._current is not None:
            self._current.critical = False


def _memory() -> int:
    """Bytes of memory that the process has; 0 where the system does not tell."""
    try:
        return int(_STATUS.read_text().split()[1]) * _PAGE
    except (OSError, ValueError, IndexError):
        return 0


def _close(steps: Iterator[None]) -> None:
    close = getattr(steps, "close", None)
    if close is not None:
        close()


def _placed(error: Exception) -> ScriptRuntimeError:
    """The error at the place in the program's text where it happened."""
    line, column = 1, 1
    trace = error.__traceback__
    while trace is not None:
        code = trace.tb_frame.f_code
        if code.co_filename == FILE:
            positions = list(code.co_positions())
            at = (
                positions[trace.tb_lasti // 2] if trace.tb_lasti >= 0 else (trace.tb_lineno, None, None, None)
            )
            line, column = at[0] or trace.tb_lineno, (at[2] or 0) + 1
        trace = trace.tb_next
    return ScriptRuntimeError(_said(error), line, column)


def _said(error: Exception) -> str:
    if isinstance(error, NameError) and (name := _VARIABLE.search(str(error))):
        return f"variable '{name[1]}' has no value yet"
    if isinstance(error, RecursionError):
        return "functions call one another too deeply"
    if isinstance(error, Refusal | PlanningError | ArithmeticError | ValueError):
        return str(error)
    return f"the simulated controller failed here: {error!r}"
