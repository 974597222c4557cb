"""Connections that the simulated controller opens itself; none of them is ever waited for.

Only servers on this machine are reached, by a loopback address or as `localhost`: nothing leaves it, and no name is
looked up.
"""

from __future__ import annotations

import errno
import ipaddress
import socket

LONGEST = 1 << 16
"""Bytes that are kept of what has come and was not read yet."""


def loopback(host: str) -> str | None:
    """The address of this machine that is meant, or None."""
    if host.lower() == "localhost":
        return "127.0.0.1"
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return None
    return str(address) if address.is_loopback and "%" not in host else None


class ClientSocket:
    """A connection: what has come and was not read yet, and whether the other side has closed."""

    def __init__(self, address: str, port: int) -> None:
        family = socket.AF_INET6 if ":" in address else socket.AF_INET
        self._target = (address, port)
        self._socket = socket.socket(family, socket.SOCK_STREAM)
        self._socket.setblocking(False)
        self.received = bytearray()
        self.ended = False

    def connect(self) -> bool | None:
        """Try to connect; None while that goes on."""
        try:
            found = self._socket.connect_ex(self._target)
        except OSError:
            return False
        if found in (0, errno.EISCONN):
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return True
        return None if found in (errno.EINPROGRESS, errno.EALREADY, errno.EWOULDBLOCK) else False

    def receive(self) -> None:
        """Take what has come."""
        while not self.ended and len(self.received) < LONGEST:
            try:
                part = self._socket.recv(LONGEST - len(self.received))
            except (BlockingIOError, InterruptedError):
                return
            except OSError:
                part = b""
            self.received += part
            self.ended = not part

    def send(self, data: bytes) -> int:
        """Send as much as goes now; the number of bytes.

        Raises:
            OSError: the connection is gone.
        """
        try:
            return self._socket.send(data)
        except (BlockingIOError, InterruptedError):
            return 0

    def close(self) -> None:
        self._socket.close()
