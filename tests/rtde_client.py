"""A client of a controller's RTDE that checks what it is told."""

import socket
import struct
import time

from robot import rtde


class Client:
    """Speaks RTDE through a socket and `robot.rtde` alone."""

    def __init__(self, host, protocol=2):
        self.connection = socket.create_connection((host, rtde.PORT), 2.0)
        self.connection.settimeout(2.0)
        self.stream, self.pending = rtde.PackageStream(), []
        if protocol is not None:
            asked = rtde.package(rtde.Package.PROTOCOL, struct.pack(">H", protocol))
            assert self.ask(asked) == b"\x01"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.connection.close()

    def next(self):
        """Kind and payload of the next package."""
        while not self.pending:
            received = self.connection.recv(65536)
            assert received, "the controller has closed the connection"
            self.pending = list(self.stream.feed(received))
        return self.pending.pop(0)

    def next_of(self, kind):
        while True:
            found, payload = self.next()
            if found == kind:
                return payload

    def ask(self, request):
        """The answer to a request; values that come before it are dropped."""
        self.connection.sendall(request)
        return self.next_of(request[2])

    def outputs(self, names, frequency=500.0):
        """Choose what is sent; whether it was accepted, and the types."""
        number, types = rtde.read_types(self.ask(rtde.ask_outputs(names, frequency)))
        if number:
            self.recipe = rtde.Recipe(names, types)
        return number, types

    def inputs(self, names):
        return rtde.read_types(self.ask(rtde.ask_inputs(names)))

    def start(self):
        return self.ask(rtde.ask_start())

    def values(self):
        payload = self.next_of(rtde.Package.VALUES)
        assert payload[0] == 1
        return self.recipe.unpack(payload[1:])

    def write(self, number, form, *values):
        self.connection.sendall(rtde.values_package(number, struct.pack(form, *values)))

    def until(self, condition, seconds=3.0):
        """The first values that meet a condition."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            values = self.values()
            if condition(values):
                return values
        raise AssertionError("did not happen in time")


def of_all(host, names):
    client = Client(host)
    assert client.outputs(names)[0] == 1
    assert client.start() == b"\x01"
    return client
