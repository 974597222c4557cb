"""The life of a simulator process: it says when it is ready, and ends when its parent does."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import errno
import gc
import os
import selectors
import signal
import sys
import time
from typing import TYPE_CHECKING, Any

from planning import PlanningError
from robot.errors import PortTakenError, RobotError

if TYPE_CHECKING:
    from collections.abc import Coroutine, Iterator

READY = "ready"

PRIORITY = -10
"""Of the simulators among the processes of the machine, as `nice` counts."""


def arguments(description: str) -> argparse.ArgumentParser:
    """The options that both simulators take."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--cell", required=True, help="a cell file, or the name of a shipped one")
    parser.add_argument("--host", help="address to listen at instead of the cell's")
    parser.add_argument("--time-scale", type=_positive, default=1.0, help="process seconds in a wall second")
    parser.add_argument(
        "--epoch", type=float, default=time.monotonic(), help="monotonic time of process time 0"
    )
    parser.add_argument("--child", action="store_true", help="end when the standard input does")
    return parser


def _positive(text: str) -> float:
    number = float(text)
    if not 0.0 < number < float("inf"):
        raise argparse.ArgumentTypeError(f"must be above 0, not {text}")
    return number


def run(main: Coroutine[Any, Any, None], name: str) -> int:
    """Run a simulator until it is ended; the process's exit code. Errors are told in one sentence on stderr."""
    # What the imports left behind is never garbage; a full collection over it would hold up the cycle for 0.1 s.
    gc.collect()
    gc.freeze()
    with contextlib.suppress(
        OSError
    ):  # a controller keeps its cycle whatever else the machine does, where it may
        os.setpriority(os.PRIO_PROCESS, 0, PRIORITY)
    # select() waits by the microsecond; epoll rounds up to the next millisecond, half of the controller's cycle.
    with asyncio.Runner(loop_factory=lambda: asyncio.SelectorEventLoop(selectors.SelectSelector())) as runner:
        try:
            runner.run(main)
        except (RobotError, PlanningError) as error:
            print(f"{name}: {error}", file=sys.stderr, flush=True)
            return 1
        except (KeyboardInterrupt, asyncio.CancelledError):
            pass
    return 0


async def until_ended(*, with_parent: bool) -> None:
    """Say that the simulator is ready, and wait for its end: a signal, or the end of its standard input."""
    loop = asyncio.get_running_loop()
    ended = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, ended.set)
    if with_parent:
        reader = asyncio.StreamReader()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)

        async def follow() -> None:
            while await reader.read(4096):
                pass
            ended.set()

        following = asyncio.create_task(follow())
    print(READY, flush=True)
    await ended.wait()
    if with_parent:
        following.cancel()


@contextlib.contextmanager
def told_of_taken_ports(host: str, port: int) -> Iterator[None]:
    """Turn a failure to listen into a sentence.

    Raises:
        PortTakenError: the port is in use, or the address is not this machine's.
    """
    try:
        yield
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise PortTakenError(
                f"port {port} on {host} is taken; stop what listens there, or give the cell another address"
            ) from error
        raise RobotError(f"cannot listen at port {port} on {host}: {error.strerror}") from error
