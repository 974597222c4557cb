"""Free loopback addresses: the ports of a robot are fixed, so each simulated cell needs an address of its own."""

from __future__ import annotations

import contextlib
import fcntl
import os
import random
import socket
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from robot.errors import RobotError

from .faults import CONTROLLER_PORT, PUMP_PORT

if TYPE_CHECKING:
    from collections.abc import Iterator

ROBOT_PORTS = (29999, 30001, 30002, 30003, 30004, 30011, 30012, 30013, 30014, 30020)
FAULT_PORTS = (CONTROLLER_PORT, PUMP_PORT)
NETWORK = 96
"""127.NETWORK.x.y is where addresses are taken from; people and other programs rarely use it."""

TRIES = 200


@contextlib.contextmanager
def free_address(pump_port: int) -> Iterator[str]:
    """An address of this machine alone on which robot and pump can listen; nobody else is given it meanwhile.

    Processes of one machine agree by a locked file per address, which the system unlocks when they end, however that
    happens.

    Raises:
        RobotError: there is none, as on systems whose only loopback address is 127.0.0.1.
    """
    locks = Path(tempfile.gettempdir()) / f"twincell-addresses-{os.getuid()}"
    locks.mkdir(exist_ok=True)
    chance = random.Random()  # noqa: S311 - so that processes which begin together do not all try the same
    for _ in range(TRIES):
        address = f"127.{NETWORK}.{chance.randrange(256)}.{chance.randrange(1, 255)}"
        with (locks / address).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            if all_free(address, (*ROBOT_PORTS, pump_port)):
                yield address
                return
    raise RobotError(
        f"no free loopback address in 127.{NETWORK}.0.0/16; give the cell one by its `host`, and end what listens there"
    )


def all_free(address: str, ports: tuple[int, ...]) -> bool:
    """Whether nobody listens at the ports and the fault ports of an address, and the machine has the address."""
    wanted = [(socket.SOCK_STREAM, port) for port in ports] + [
        (socket.SOCK_DGRAM, port) for port in FAULT_PORTS
    ]
    with contextlib.ExitStack() as stack:
        for kind, port in wanted:
            probe = stack.enter_context(socket.socket(socket.AF_INET, kind))
            if kind is socket.SOCK_STREAM:  # connections that ended a moment ago are in nobody's way
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((address, port))
            except OSError:
                return False
    return True
