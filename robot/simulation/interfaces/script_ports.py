"""The simulated controller's script ports: programs come in as text; two of them tell the controller's state.

A program is `def NAME():` to its own `end`, blocks within it counted; `sec NAME():` the same, for a program that takes
no time and runs beside the one that runs; any other line is a program of its own.
"""

from __future__ import annotations

import asyncio
import sys
import time
from functools import partial
from typing import TYPE_CHECKING

from robot.simulation.programs.program import ScriptProgram
from robot.simulation.urscript import ScriptError
from robot.simulation.versions import e_series

from .port_commands import obeyed
from .script_client import Listener, ScriptClient
from .state_stream import Streams, exception_message, text_message

if TYPE_CHECKING:
    from robot.simulation.machine import Machine
    from robot.simulation.programs.translating import Translator

PORTS = (30001, 30002, 30003)
PACE = 0.004  # s of wall time between two programs: a flood of them leaves the cycle its time


LONGEST_NAME = 80
"""Of what was sent for a program, as a complaint tells it."""


class ScriptPorts:
    """Takes programs and starts those that are understood.

    Args:
        machine: what they run on.
        translator: what makes them ready to run.
        start_delay: wall seconds until one starts.
        remote: whether the robot takes orders from elsewhere than its pendant.
    """

    def __init__(self, machine: Machine, translator: Translator, start_delay: float, *, remote: bool) -> None:
        self.machine = machine
        self._remote = remote or not e_series(machine.version)  # a CB3 robot has no such switch
        self._translator = translator
        self._start_delay = start_delay
        self._order = asyncio.Lock()  # a program that comes later is the one that runs
        self.streams = Streams(machine)
        machine.on_fault = self._tell

    def client(self, port: int) -> ScriptClient:
        """A new client of a port."""
        return ScriptClient(self.start, partial(self.streams.listen, port), self._complain)

    def listener(self, port: int) -> Listener:
        """A new client of a port that takes no programs."""
        return Listener(partial(self.streams.listen, port))

    async def start(self, text: str) -> bool:
        """Start a program, in place of the one that runs, or obey a command; whether it does start."""
        name = text.strip().splitlines()[0][:LONGEST_NAME]
        if not self._remote:
            self._complain(f"'{name}' refused: the robot is in local control")
            return False
        if obeyed(self.machine, text):
            return True
        async with self._order:
            try:
                program = ScriptProgram(self.machine, await self._translator.translate(text), self._say)
                if not self.machine.may_move:
                    self._complain(f"'{name}' refused: {self.machine.why_not}")
                    return False
                if program.secondary:
                    program.run_at_once()
                else:
                    self.machine.load(program, time.monotonic() + self._start_delay)
            except ScriptError as error:
                self._complain(f"'{name}' refused: {error}")
                self._tell(error)
                return False
            finally:
                await asyncio.sleep(PACE)
        return True

    @staticmethod
    def _complain(text: str) -> None:
        print(f"controller: {text}", file=sys.stderr, flush=True)

    def _say(self, text: str) -> None:
        self.streams.say(lambda machine: text_message(machine, text))

    def _tell(self, error: ScriptError) -> None:
        self.streams.say(lambda machine: exception_message(machine, error.message, error.line, error.column))
