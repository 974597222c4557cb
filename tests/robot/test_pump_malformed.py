"""Whatever bytes the simulated drive is sent, it goes on, in bounded memory, and serves its other clients."""

import contextlib
import random
import socket
import threading
import time
from pathlib import Path

import pytest
from pumps.alone import cell_file, pump_alone
from pymodbus.client import ModbusTcpClient
from pymodbus.framer import FramerType

from robot.simulation.pump.frames import check_sum

HOST = "127.0.34.11"
TRANSPORTS = [("generic", "tcp"), ("m-tec-p20", "rtu over tcp")]
PER_CONNECTION = 5  # the pump cuts off who sends what is no frame, and does not read on
MEGABYTE = 1 << 20


def resident(pid):
    """Memory of a process, bytes."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * 4096


def number(value):
    return (value & 0xFFFF).to_bytes(2, "big")


def malformed(chance, transport):
    """Bytes that are no good request, in one of many ways."""
    function = chance.choice([1, 2, 3, 4, 5, 6, 15, 16, 22, 23, 43, chance.randrange(256)])
    body = number(chance.randrange(1 << 16)) + number(chance.choice([0, 1, 125, 126, 2000, 0xFFFF]))
    pdu = bytes([function]) + body + chance.randbytes(chance.choice([0, 0, 1, 3, 20, 260]))
    device = chance.choice([1, 1, 0, 2, 17, 255])
    if transport == "tcp":
        length = chance.choice([len(pdu) + 1, len(pdu) + 1, 0, 1, 2, 255, 0xFFFF, chance.randrange(1 << 16)])
        protocol = chance.choice([0, 0, 0, 1, 0xFFFF])
        frame = number(chance.randrange(1 << 16)) + number(protocol) + number(length) + bytes([device]) + pdu
    else:
        frame = bytes([device]) + pdu
        frame += check_sum(frame) if chance.random() < 0.5 else chance.randbytes(2)
    kind = chance.randrange(6)
    if kind == 0:
        return chance.randbytes(chance.choice([1, 2, 7, 8, 100, 3000]))
    if kind == 1:
        return frame[: chance.randrange(len(frame))]
    if kind == 2:
        place = chance.randrange(len(frame))
        return frame[:place] + bytes([frame[place] ^ 1 << chance.randrange(8)]) + frame[place + 1 :]
    if kind == 3:
        return frame * chance.randrange(2, 30)
    return frame


class Polling(threading.Thread):
    """A client that behaves, and notes how long it waited for each answer."""

    def __init__(self, pump):
        super().__init__()
        self.pump, self.waits, self.failures, self.over = pump, [], [], threading.Event()

    def run(self):
        serial = self.pump.map.transport != "tcp"
        client = ModbusTcpClient(
            self.pump.host,
            port=self.pump.port,
            timeout=2.0,
            retries=0,
            framer=FramerType.RTU if serial else FramerType.SOCKET,
        )
        at = self.pump.map.registers.measured_flow.address
        with client:
            while not self.over.wait(0.005):
                began = time.monotonic()
                try:
                    answer = client.read_holding_registers(at, count=1, device_id=self.pump.map.device_id)
                    if answer.isError():
                        self.failures.append(answer)
                except Exception as error:
                    self.failures.append(error)
                self.waits.append(time.monotonic() - began)


def assault(pump, inputs, seed):
    """Send malformed inputs over many connections, one after the other; most are closed when all of it was taken."""
    chance = random.Random(seed)
    transport = pump.map.transport
    sent = 0
    while sent < inputs:
        with socket.create_connection((pump.host, pump.port), timeout=5.0) as connection:
            connection.setblocking(False)
            for _ in range(min(PER_CONNECTION, inputs - sent)):
                data = malformed(chance, transport)
                sent += 1
                try:
                    connection.sendall(data)
                    if chance.random() < 0.7:  # the others never read their answers
                        connection.recv(1 << 16)
                except BlockingIOError:
                    pass
                except OSError:
                    break  # it was cut off, as it may be
            with contextlib.suppress(OSError):
                if chance.random() < 0.8:
                    connection.settimeout(5.0)
                    connection.shutdown(socket.SHUT_WR)
                    while connection.recv(1 << 16):
                        pass


def survives(pump, inputs, seed):
    assault(pump, 500, seed - 1)  # what it takes once, it has taken now
    polling = Polling(pump)
    polling.start()
    before = resident(pump.pid)
    assault(pump, inputs, seed)
    polling.over.set()
    polling.join()
    assert not polling.failures
    assert len(polling.waits) > inputs // 500
    assert max(polling.waits) < 2.0
    assert resident(pump.pid) - before < 16 * MEGABYTE
    assert pump.report()["state"] in {"ready", "forward", "reverse", "off", "tripped"}


@pytest.fixture(scope="module", params=TRANSPORTS, ids=" ".join)
def pump(request, tmp_path_factory):
    name, transport = request.param
    path = cell_file(tmp_path_factory.mktemp("cell"), name, transport=transport)
    with pump_alone(HOST, path) as alone:
        yield alone


def test_two_thousand_malformed_inputs_harm_nobody(pump):
    survives(pump, 1000, seed=1)


@pytest.mark.soak
def test_a_hundred_thousand_malformed_inputs_harm_nobody(pump):
    survives(pump, 100_000, seed=7)


def test_connections_that_are_never_closed_keep_nobody_out_for_good(pump):
    with contextlib.ExitStack() as idle:
        for _ in range(60):
            idle.enter_context(socket.create_connection((pump.host, pump.port), timeout=1.0))
        assert pump.report()["state"] == "ready"
    polling = Polling(pump)
    time.sleep(0.2)
    polling.start()
    time.sleep(0.3)
    polling.over.set()
    polling.join()
    assert not polling.failures


def test_a_client_that_never_reads_stops_being_read(pump):
    at, device = pump.map.registers.command.address, pump.map.device_id
    pdu = b"\x03" + number(at) + number(1)
    if pump.map.transport == "tcp":
        request = b"\0\0\0\0" + number(len(pdu) + 1) + bytes([device]) + pdu
    else:
        request = bytes([device]) + pdu + check_sum(bytes([device]) + pdu)
    before = resident(pump.pid)
    with (
        socket.create_connection((pump.host, pump.port), timeout=0.5) as deaf,
        contextlib.suppress(TimeoutError),
    ):
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        for _ in range(300):
            deaf.sendall(request * 1000)
    assert resident(pump.pid) - before < 16 * MEGABYTE
    assert pump.report()["state"] == "ready"
