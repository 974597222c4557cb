"""A child program that cannot outlive its time limit.

Meshers and solvers are native programs that may crash, hang or ignore an interrupt. Each runs in a process group
of its own, and the whole group is killed when the time is up or the caller is interrupted; nothing of it stays
behind, not even a zombie.
"""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType


@dataclass(frozen=True)
class Ended:
    """How a child program ended.

    Attributes:
        code: exit code, -n where signal n ended it, None where its time was up.
        output: what it wrote to its standard output and error stream.
        seconds: how long it ran, s.
    """

    code: int | None
    output: str
    seconds: float


def run_child(
    arguments: Sequence[str],
    *,
    folder: Path,
    time_limit_s: float,
    environment: Mapping[str, str] | None = None,
) -> Ended:
    """Run a program to its end, or kill it with all its children after `time_limit_s`.

    Args:
        arguments: the program and its arguments.
        folder: working folder of the child.
        time_limit_s: on the wall clock, s.
        environment: variables set in addition to those of this process.

    Raises:
        OSError: the program cannot be started.
    """
    start = time.monotonic()
    process: subprocess.Popen[bytes] | None = None
    try:
        with _interrupts_held():
            process = subprocess.Popen(
                list(arguments),
                cwd=folder,
                env={**os.environ, **(environment or {})},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # an interrupt at the terminal reaches this process alone, which cleans up
            )
        output, _ = process.communicate(timeout=time_limit_s)
    except BaseException as error:
        output = _kill_group(process) if process else b""
        if not isinstance(error, subprocess.TimeoutExpired):
            raise
        return Ended(None, _text(output), time.monotonic() - start)
    return Ended(process.returncode, _text(output), time.monotonic() - start)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Keeps an interrupt until the end of the block: one amid the start would leave a child that nobody knows."""
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    held: list[tuple[int, FrameType | None]] = []
    signal.signal(signal.SIGINT, lambda number, frame: held.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if held:
        before(*held[0])


def _kill_group(process: subprocess.Popen[bytes]) -> bytes:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    output, _ = process.communicate()
    return output


def _text(output: bytes) -> str:
    return output.decode("utf-8", errors="replace")
