"""Modbus clients written elsewhere against the simulated drive: every register of every map, and every refusal."""

import asyncio
import contextlib
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from pumps.alone import cell_file, pump_alone
from pymodbus.client import AsyncModbusTcpClient, ModbusTcpClient
from pymodbus.framer import FramerType

from robot.pump_map import load_pump_map
from robot.simulation.pump.frames import check_sum

HOST = "127.0.34.10"
SILENCE = 0.1  # s; what comes later would come before the next answer
SERVED = [
    ("generic", "tcp"),
    ("generic", "rtu over tcp"),
    ("m-tec-p20", "rtu over tcp"),
    ("m-tec-p20", "tcp"),
    ("m-tec-p50", "rtu over tcp"),
    ("accelerator-doser", "tcp"),
    ("accelerator-doser", "rtu over tcp"),
]


@pytest.fixture(scope="module", params=SERVED, ids=" ".join)
def pump(request, tmp_path_factory):
    name, transport = request.param
    path = cell_file(tmp_path_factory.mktemp("cell"), name, transport=transport)
    with pump_alone(HOST, path, "--trip", "0") as alone:
        yield alone


def framer(pump):
    return FramerType.RTU if pump.map.transport == "rtu over tcp" else FramerType.SOCKET


class Pymodbus:
    def __init__(self, pump):
        self.client = ModbusTcpClient(pump.host, port=pump.port, timeout=1.0, retries=0, framer=framer(pump))
        assert self.client.connect()
        self.device = pump.map.device_id

    def read(self, table, address, count):
        read = self.client.read_input_registers if table == "input" else self.client.read_holding_registers
        answer = read(address, count=count, device_id=self.device)
        assert not answer.isError(), answer
        return answer.registers

    def write(self, address, words):
        if len(words) == 1:
            answer = self.client.write_register(address, words[0], device_id=self.device)
        else:
            answer = self.client.write_registers(address, words, device_id=self.device)
        assert not answer.isError(), answer

    def close(self):
        self.client.close()


class PymodbusAsync:
    def __init__(self, pump):
        self.runner = asyncio.Runner()
        self.device = pump.map.device_id

        async def connect():
            client = AsyncModbusTcpClient(
                pump.host, port=pump.port, timeout=1.0, retries=0, framer=framer(pump)
            )
            assert await client.connect()
            return client

        self.client = self.runner.run(connect())

    def read(self, table, address, count):
        read = self.client.read_input_registers if table == "input" else self.client.read_holding_registers
        answer = self.runner.run(self._ask(read, address, count=count))
        return answer.registers

    def write(self, address, words):
        if len(words) == 1:
            self.runner.run(self._ask(self.client.write_register, address, words[0]))
        else:
            self.runner.run(self._ask(self.client.write_registers, address, words))

    async def _ask(self, function, *values, **named):
        answer = await function(*values, device_id=self.device, **named)
        assert not answer.isError(), answer
        return answer

    def close(self):
        self.client.close()
        self.runner.close()


class PyModbusTcp:
    def __init__(self, pump):
        if pump.map.transport != "tcp":
            pytest.skip("pyModbusTCP speaks Modbus TCP alone")
        module = pytest.importorskip("pyModbusTCP.client")
        self.client = module.ModbusClient(pump.host, pump.port, unit_id=pump.map.device_id, timeout=1.0)
        assert self.client.open()

    def read(self, table, address, count):
        read = self.client.read_input_registers if table == "input" else self.client.read_holding_registers
        words = read(address, count)
        assert words is not None, self.client.last_except_as_full_txt
        return words

    def write(self, address, words):
        if len(words) == 1:
            assert self.client.write_single_register(address, words[0]), self.client.last_except_as_full_txt
        else:
            assert self.client.write_multiple_registers(address, words), self.client.last_except_as_full_txt

    def close(self):
        self.client.close()


class Mbpoll:
    """Debian's mbpoll, a process for each request; over a line of its own where the pump is behind a gateway."""

    def __init__(self, pump):
        if shutil.which("mbpoll") is None:
            pytest.skip("mbpoll is not installed (apt-get install mbpoll)")
        self.end = contextlib.ExitStack()
        self.options = ["mbpoll", "-0", "-1", "-q", "-o", "1", "-a", str(pump.map.device_id)]
        if pump.map.transport == "tcp":
            self.target = ["-m", "tcp", "-p", str(pump.port), pump.host]
        else:
            line = self.end.enter_context(gateway(pump.host, pump.port))
            self.target = ["-m", "rtu", "-b", "19200", "-d", "8", "-s", "2", "-P", "none", line]

    def read(self, table, address, count):
        asked = ["-t", "3:hex" if table == "input" else "4:hex", "-r", str(address), "-c", str(count)]
        ran = subprocess.run(
            [*self.options, *asked, *self.target], capture_output=True, text=True, timeout=10
        )
        assert ran.returncode == 0, ran.stdout + ran.stderr
        lines = [line.split(":") for line in ran.stdout.splitlines() if line.startswith("[")]
        assert [int(at.strip("[] \t")) for at, _ in lines] == list(range(address, address + count))
        return [int(word, 16) for _, word in lines]

    def write(self, address, words):
        asked = ["-t", "4:hex", "-r", str(address)]
        ran = subprocess.run(
            [*self.options, *asked, *self.target, *(f"0x{word:04X}" for word in words)],
            capture_output=True,
            text=True,
            timeout=10,
        )
        assert ran.returncode == 0, ran.stdout + ran.stderr

    def close(self):
        self.end.close()


@contextlib.contextmanager
def gateway(host, port):
    """A serial line to a pump, as a process of its own; the name of its other end."""
    with subprocess.Popen(
        [sys.executable, "-m", "pumps.gateway", host, str(port)],
        cwd=Path(__file__).parents[1],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            line = process.stdout.readline().strip()
            assert line
            yield line
            assert process.poll() is None
        finally:
            process.stdin.close()
            process.wait(5.0)


@pytest.fixture(params=[Pymodbus, PymodbusAsync, PyModbusTcp, Mbpoll])
def client(request, pump):
    made = request.param(pump)
    yield made
    made.close()


def test_every_register_of_every_map_is_read_and_written(pump, client):
    registers = pump.map.registers
    for table, address in sorted(pump.map.addresses):
        assert 0 <= client.read(table, address, 1)[0] <= 0xFFFF
    for place in pump.map.values.values():
        assert len(client.read(place.table, place.address, place.count)) == place.count
    flow = pump.map.words(4321.0)
    client.write(registers.set_flow.address, flow)
    assert client.read("holding", registers.set_flow.address, len(flow)) == flow
    if registers.heartbeat is not None:
        client.write(registers.heartbeat.address, [0xBEEF])
        assert client.read("holding", registers.heartbeat.address, 1) == [0xBEEF]
    commands = pump.map.commands
    for word, state in (
        (commands.forward, "forward"),
        (commands.reverse, "reverse"),
        (commands.emergency, "off"),
        (commands.reset, "ready"),
        (commands.stop, "ready"),
    ):
        if word is not None:
            client.write(registers.command.address, [word])
            assert client.read("holding", registers.command.address, 1) == [word]
            assert pump.report()["state"] == state


def frame(pump, pdu, device=None):
    """A request as bytes."""
    device = pump.map.device_id if device is None else device
    if pump.map.transport == "tcp":
        return b"\x12\x34\0\0" + (len(pdu) + 1).to_bytes(2, "big") + bytes([device]) + pdu
    asked = bytes([device]) + pdu
    return asked + check_sum(asked)


def opened(pump, answer, device=None):
    """Function and what follows it in an answer."""
    device = pump.map.device_id if device is None else device
    if pump.map.transport == "tcp":
        assert answer[:4] == b"\x12\x34\0\0"
        assert int.from_bytes(answer[4:6], "big") == len(answer) - 6
        assert answer[6] == device
        return answer[7:]
    assert answer[0] == device
    assert check_sum(answer[:-2]) == answer[-2:]
    return answer[1:-2]


def ask(pump, pdu, device=None):
    """Send a request; function and what follows it in the answer."""
    with socket.create_connection((pump.host, pump.port), timeout=1.0) as connection:
        connection.sendall(frame(pump, pdu, device))
        return opened(pump, connection.recv(300), device)


def ask_after(pump, silent, device, pdu):
    """Send a request that is not answered, and once it was read another; what answers the other alone."""
    with socket.create_connection((pump.host, pump.port), timeout=1.0) as connection:
        connection.sendall(frame(pump, silent, device))
        connection.settimeout(SILENCE)
        with pytest.raises(TimeoutError):
            connection.recv(300)
        connection.settimeout(1.0)
        connection.sendall(frame(pump, pdu))
        return opened(pump, connection.recv(300))


def number(*numbers):
    return b"".join(n.to_bytes(2, "big") for n in numbers)


def test_refusals_have_the_codes_of_the_protocol(pump):
    at, once = pump.map.registers, pump.map.words_at_once
    command, flow = at.command.address, at.set_flow.address
    ends = {15: b"\x01\0", 23: number(0, 1) + b"\x02\0\0"}  # what an RTU frame's length is told from
    for function in [1, 2, 5, 7, 8, 11, 15, 17, 20, 21, 22, 23, 24, 43, 99, 127]:
        asked = bytes([function]) + number(0, 1) + ends.get(function, b"")
        assert ask(pump, asked) == bytes([function | 0x80, 1])
    inputs = any(place.table == "input" for place in pump.map.values.values())
    assert ask(pump, b"\x04" + number(50000, 1)) == bytes([0x84, 2 if inputs else 1])
    free = next(a for a in range(0x10000) if all(a != used for _, used in pump.map.addresses))
    assert ask(pump, b"\x03" + number(free, 1)) == b"\x83\x02"
    assert ask(pump, b"\x06" + number(free, 1)) == b"\x86\x02"
    assert ask(pump, b"\x03" + number(0xFFFF, min(once, 2))) == b"\x83\x02"
    for count in (0, 126, 0xFFFF):
        assert ask(pump, b"\x03" + number(command, count)) == b"\x83\x03"
    assert ask(pump, b"\x06" + number(command, 0x7777)) == b"\x86\x03"  # no such command
    if at.measured_flow.table == "holding":
        assert ask(pump, b"\x06" + number(at.measured_flow.address, 1)) == b"\x86\x02"  # only measured
    if once == 1:
        assert ask(pump, b"\x03" + number(command, 2)) == b"\x83\x03"
        assert ask(pump, b"\x10" + number(command, 1) + b"\x02" + number(0)) == b"\x90\x01"
    else:
        assert ask(pump, b"\x10" + number(flow, 1) + b"\x04" + number(0, 0))[:1] == b"\x90"
        assert ask(pump, b"\x10" + number(flow, 124) + bytes([246]) + bytes(246)) == b"\x90\x03"
        assert ask(pump, b"\x10" + number(free, 1) + b"\x02" + number(0)) == b"\x90\x02"
    if at.set_flow.count == 2:
        assert ask(pump, b"\x06" + number(flow, 1)) == b"\x86\x02"  # half of a value


def test_another_device_is_not_this_one(pump):
    request = b"\x03" + number(pump.map.registers.command.address, 1)
    other = pump.map.device_id + 1
    if pump.map.transport == "tcp":
        assert ask(pump, request, other) == b"\x83\x0b"
    else:
        assert ask_after(pump, request, other, request)[:2] == b"\x03\x02"


def test_what_is_for_everybody_is_done_and_not_answered_on_a_line(pump):
    at = pump.map.registers.command.address
    for word in (pump.map.commands.forward, pump.map.commands.stop):
        asked = b"\x06" + number(at, word)
        if pump.map.transport == "tcp":
            assert [ask(pump, asked, device) for device in (0, 0xFF)] == [asked, asked]
            told = ask(pump, b"\x03" + number(at, 1))
        else:
            told = ask_after(pump, asked, 0, b"\x03" + number(at, 1))
        assert told == b"\x03\x02" + number(word)


def test_requests_that_come_together_or_in_pieces_are_answered_in_order(pump):
    addresses = [pump.map.registers.command.address, pump.map.registers.set_flow.address] * 10
    device = bytes([pump.map.device_id])
    with Pymodbus(pump).client as client:
        client.write_register(addresses[0], pump.map.commands.stop, device_id=pump.map.device_id)
    sent, size = b"", 11
    for i, address in enumerate(addresses):
        pdu = device + b"\x03" + number(address, 1)
        sent += number(i, 0, 6) + pdu if pump.map.transport == "tcp" else pdu + check_sum(pdu)
    if pump.map.transport != "tcp":
        size = 7
    for cut in (len(sent), 5, 13):
        with socket.create_connection((pump.host, pump.port), timeout=1.0) as connection:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            got = b""
            for start in range(0, len(sent), cut):
                connection.sendall(sent[start : start + cut])
            while len(got) < size * len(addresses):
                got += connection.recv(4096)
        answers = [got[i : i + size] for i in range(0, len(got), size)]
        if pump.map.transport == "tcp":
            assert [int.from_bytes(answer[:2], "big") for answer in answers] == list(range(len(addresses)))
        else:
            assert all(check_sum(answer[:-2]) == answer[-2:] for answer in answers)


def test_both_sizes_of_the_same_pump_have_the_same_registers():
    small, large = load_pump_map("m-tec-p20"), load_pump_map("m-tec-p50")
    changes = {"name": large.name, "flow_per_hz": large.flow_per_hz}
    assert small.model_copy(update=changes) == large
