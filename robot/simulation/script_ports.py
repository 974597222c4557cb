"""The simulated controller's script ports: programs come in as text, nothing goes out.

A program is `def NAME():` to the first `end` at the start of a line; definitions inside it are indented.
"""

from __future__ import annotations

import asyncio
import sys
import time
from typing import TYPE_CHECKING

from .control_script import ControlScript
from .upload import recognise

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from .machine import Machine

PORTS = (30001, 30002, 30003)
LONGEST_LINE = 1 << 20


class ScriptPorts:
    """Takes programs and starts those that are understood."""

    def __init__(self, machine: Machine, workers: Executor, start_delay: float) -> None:
        self.machine = machine
        self._workers = workers
        self._start_delay = start_delay

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Read programs from one client until it leaves."""
        block: list[str] = []
        try:
            while received := await reader.readline():
                line = received.decode("utf-8", "replace")
                if not block and not line.strip():
                    continue
                block.append(line)
                opens = block[0].startswith(("def ", "sec "))
                if not opens or line.rstrip() == "end":
                    self._take("".join(block))
                    block = []
        except (ConnectionError, asyncio.LimitOverrunError, ValueError) as error:
            print(f"controller: script client dropped: {error}", file=sys.stderr, flush=True)
        finally:
            writer.close()

    def _take(self, text: str) -> None:
        name = text.splitlines()[0].strip()
        try:
            upload = recognise(text)
        except ValueError as error:
            print(f"controller: '{name}' refused: {error}", file=sys.stderr, flush=True)
            return
        if upload is None:
            print(
                f"controller: '{name}' refused: only ur-rtde's control script runs",
                file=sys.stderr,
                flush=True,
            )
        elif not self.machine.may_move:
            print(
                f"controller: '{name}' refused: the robot is not ready to move", file=sys.stderr, flush=True
            )
        else:
            script = ControlScript(self.machine, upload, self._workers)
            self.machine.load(script.run(), time.monotonic() + self._start_delay)
