"""A gateway: a serial line whose bytes a TCP connection carries. Run it with `python -m pumps.gateway HOST PORT`.

It prints the name of the line's other end, and ends when its input or the connection does.
"""

import os
import select
import socket
import sys
import tty


def main(host, port):
    ours, theirs = os.openpty()  # theirs is held open, so that the line outlives each of its users
    tty.setraw(ours)
    tty.setraw(theirs)
    with socket.create_connection((host, int(port))) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        print(os.ttyname(theirs), flush=True)
        while True:
            ready, _, _ = select.select([ours, connection, sys.stdin], [], [])
            if sys.stdin in ready:
                return
            if ours in ready:
                connection.sendall(os.read(ours, 4096))
            if connection in ready:
                data = connection.recv(4096)
                if not data:
                    return
                os.write(ours, data)


if __name__ == "__main__":
    main(*sys.argv[1:])
