"""Translates programs in a process beside the controller, so that a long one does not hold up its cycles."""

from __future__ import annotations

import asyncio
import contextlib
import marshal
import multiprocessing
import os
from collections import OrderedDict
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from robot.simulation.urscript import Compiled, Library, Pieces, ScriptSyntaxError

from .library import library
from .moves import ScriptMoves

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from robot.simulation.machine import Machine

LESS = 5
"""Priority that the process has less than the controller, as `nice` counts: the cycle comes first."""

KEPT = 16
"""Programs that are not translated again when they are sent again."""

LONGEST_KEPT = 1 << 18
"""Characters of the longest of them."""


class Translator:
    """Translates one program after another; its process ends with the controller's.

    Args:
        machine: what programs run on. To be made before the controller has threads: the process is forked.
    """

    def __init__(self, machine: Machine) -> None:
        self._functions = library(machine, ScriptMoves(machine, lambda: lambda: None), lambda _: None)
        self._start()
        self._waiting = ThreadPoolExecutor(1, "translation")
        self._kept: OrderedDict[str, Compiled] = OrderedDict()

    def _start(self) -> None:
        forking = multiprocessing.get_context("fork")
        self._link, link = forking.Pipe()
        self._process = forking.Process(
            target=_translate, args=(link, self._link, self._functions), daemon=True
        )
        self._process.start()
        link.close()

    async def translate(self, text: str) -> Compiled:
        """A program's text, ready to run.

        Raises:
            ScriptSyntaxError: it is no program, or names what there is not.
        """
        if text in self._kept:
            self._kept.move_to_end(text)
            return self._kept[text]
        found = await asyncio.get_running_loop().run_in_executor(self._waiting, self._ask, text)
        if len(text) <= LONGEST_KEPT:
            self._kept[text] = found
        if len(self._kept) > KEPT:
            self._kept.popitem(last=False)
        return found

    def close(self) -> None:
        """End the process, whatever it is doing."""
        self._process.kill()
        self._process.join(1.0)
        self._link.close()

    def _ask(self, text: str) -> Compiled:
        try:
            self._link.send(text)
            answer = self._link.recv()
        except (EOFError, OSError):
            self._link.close()
            self._start()
            raise ScriptSyntaxError(
                "the process that translates programs ended over this one", 1, 1
            ) from None
        if len(answer) == 3:  # what is wrong, and where
            raise ScriptSyntaxError(*answer)
        name, codes, secondary, calls, around = answer
        return Compiled(name, marshal.loads(codes), secondary, calls, around)  # noqa: S302 - our own process wrote it


def _translate(link: Connection, others: Connection, functions: Library) -> None:
    """The process: a text in, a program or an error out, until the controller is gone."""
    others.close()
    os.nice(LESS)
    pieces = Pieces(functions)
    with contextlib.suppress(EOFError, OSError, KeyboardInterrupt):
        while True:
            text = link.recv()
            try:
                found = pieces.compiled(text)
                answer = (found.name, marshal.dumps(found.codes), found.secondary, found.calls, found.around)
            except ScriptSyntaxError as error:
                link.send((error.message, error.line, error.column))
            except Exception as error:
                link.send((f"not translated: {error!r}", 1, 1))
            else:
                link.send(answer)
