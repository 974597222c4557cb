"""The simulated controller's interpreter port: statements for a program that is in interpreter mode, a line each.

Each line has one answer: `ack: NUMBER: STATEMENT` of a statement that is taken, `discard: REASON: STATEMENT` of one
that is not, `state: NUMBER: QUESTION` of what is asked about them.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from robot.simulation.urscript import Refusal, ScriptError

if TYPE_CHECKING:
    from robot.simulation.machine import Machine, Statements

PORT = 30020
LONGEST_LINE = 1 << 14
FIRST_VERSION = (5, 10)

_STATES = {
    "statelastexecuted": lambda interpreter: interpreter.last_executed,
    "statelastinterpreted": lambda interpreter: interpreter.last_interpreted,
    "statelastcleared": lambda interpreter: interpreter.last_cleared,
    "stateunexecuted": lambda interpreter: interpreter.unexecuted,
}


class InterpreterPort:
    """Takes statements from any number of clients."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._turn = asyncio.Lock()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer one client's lines until it leaves."""
        try:
            while line := await reader.readline():
                text = line.decode("utf-8", "replace").strip()
                if text:
                    writer.write(f"{await self.answer(text)}\n".encode())
                    await writer.drain()
        except (ConnectionError, asyncio.LimitOverrunError, ValueError):
            pass  # the client is gone, or sends a line without end
        finally:
            writer.close()

    async def answer(self, text: str) -> str:
        """The answer to one line."""
        interpreter = self._machine.interpreter
        if text in _STATES:
            return f"state: {_STATES[text](interpreter) if interpreter is not None else 0}: {text}"
        if text in ("skipbuffer", "abort"):
            if interpreter is None:
                return f"discard: no program is in interpreter mode: {text}"
            (interpreter.skip if text == "skipbuffer" else interpreter.abort)()
            return f"ack: {interpreter.last_executed}: {text}"
        async with self._turn:
            return await self._take(text, interpreter)

    @staticmethod
    async def _take(text: str, interpreter: Statements | None) -> str:
        while interpreter is not None and interpreter.clearing and not interpreter.ended:  # noqa: ASYNC110 - the machine's cycles end it
            await asyncio.sleep(0.001)
        if interpreter is None:
            return f"discard: no program is running that takes statements: {text}"
        try:
            number = interpreter.take(*await asyncio.to_thread(interpreter.read, text))
        except (Refusal, ScriptError) as error:
            return f"discard: {error}: {text}"
        return f"ack: {number}: {text}"
