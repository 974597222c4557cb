"""The simulated controller's script ports: programs come in as text; two of them tell the controller's state.

A program is `def NAME():` to its own `end`, blocks within it counted; `sec NAME():` the same, for a program that takes
no time and runs beside the one that runs; any other line is a program of its own. ur-rtde's control script is run by
`control_script`, every other program by what it says.
"""

from __future__ import annotations

import asyncio
import re
import sys
import time
from typing import TYPE_CHECKING

from robot.simulation.programs.control_script import ControlScript
from robot.simulation.programs.program import ScriptProgram
from robot.simulation.programs.upload import recognise
from robot.simulation.urscript import ScriptError

from .state_stream import StateStream, exception_message, text_message

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from robot.simulation.machine import Machine

PORTS = (30001, 30002, 30003)
STATE_PORTS = (30001, 30002)
LONGEST_LINE = 1 << 20
LONGEST_PROGRAM = 1 << 22

_WORD = re.compile(r'#.*|"[^"\n]*"|\b(def|sec|thread|if|while|for|switch|case|default|end)\b')


class ScriptPorts:
    """Takes programs and starts those that are understood."""

    def __init__(self, machine: Machine, workers: Executor, start_delay: float) -> None:
        self.machine = machine
        self._workers = workers
        self._start_delay = start_delay
        self._stream = StateStream(machine)
        machine.on_fault = self._tell

    async def serve(self, port: int, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Read programs from one client of a port until it leaves."""
        collected = _Collected()
        feeding = asyncio.create_task(self._stream.feed(writer)) if port in STATE_PORTS else None
        try:
            while received := await reader.readline():
                text = collected.add(received.decode("utf-8", "replace"))
                if text is not None:
                    await self._take(text)
        except (ConnectionError, asyncio.LimitOverrunError, ValueError) as error:
            print(f"controller: script client dropped: {error}", file=sys.stderr, flush=True)
        finally:
            if feeding is not None:
                feeding.cancel()
            writer.close()

    async def _take(self, text: str) -> None:
        name = text.splitlines()[0].strip()
        try:
            upload = recognise(text)
            if upload is None:
                program = await asyncio.get_running_loop().run_in_executor(
                    self._workers, ScriptProgram, self.machine, text, self._say
                )
        except (ValueError, ScriptError) as error:
            print(f"controller: '{name}' refused: {error}", file=sys.stderr, flush=True)
            if isinstance(error, ScriptError):
                self._tell(error)
            return
        if not self.machine.may_move:
            print(
                f"controller: '{name}' refused: the robot is not ready to move", file=sys.stderr, flush=True
            )
        elif upload is not None:
            script = ControlScript(self.machine, upload, self._workers)
            self.machine.load(script.run(), time.monotonic() + self._start_delay)
        elif program.secondary:
            try:
                program.run_at_once()
            except ScriptError as error:
                print(f"controller: '{name}' ended: {error}", file=sys.stderr, flush=True)
                self._tell(error)
        else:
            self.machine.load(program, time.monotonic() + self._start_delay)

    def _say(self, text: str) -> None:
        print(f"program: {text}", file=sys.stderr, flush=True)
        self._stream.say(lambda machine: text_message(machine, text))

    def _tell(self, error: ScriptError) -> None:
        self._stream.say(lambda machine: exception_message(machine, error.message, error.line, error.column))


class _Collected:
    """Lines of a program that has not ended yet."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._open = 0
        self._length = 0

    def add(self, line: str) -> str | None:
        """Take a line; the program that it ends, or None.

        Raises:
            ValueError: the program is too long.
        """
        if not self._lines and not line.strip():
            return None
        self._lines.append(line)
        self._length += len(line)
        if self._length > LONGEST_PROGRAM:
            raise ValueError(f"a program of more than {LONGEST_PROGRAM} characters")
        for word in _WORD.finditer(line):
            if word[1] == "end":
                self._open -= 1
            elif word[1] is not None:
                self._open += 1
        if self._open > 0:
            return None
        text = "".join(self._lines)
        self._lines, self._open, self._length = [], 0, 0
        return text
