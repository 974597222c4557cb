"""Programs on the simulated controller that talk with others: sockets, Modbus signals, popups on the pendant."""

from __future__ import annotations

import contextlib
import socket
import struct
import subprocess
import sys
import threading
import time

import pytest

from robot.simulation import SimulatedCell

HOST = "127.0.33.3"
PEER = "127.0.33.4"
SCALE = 2.0

DEVICE = """
import asyncio, sys
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice
bits = lambda: [SimData(0, values=[False] * 64, datatype=DataType.BITS)]
words = lambda: [SimData(0, count=64, values=0, datatype=DataType.REGISTERS)]
async def main():
    device = SimDevice(0, simdata=(bits(), [SimData(0, values=[True, False] * 32, datatype=DataType.BITS)], words(),
        [SimData(0, values=list(range(100, 164)), datatype=DataType.REGISTERS)]))
    server = ModbusTcpServer(device, address=(sys.argv[1], int(sys.argv[2])))
    await server.serve_forever(background=True)
    print("ready", flush=True)
    await asyncio.sleep(60)
asyncio.run(main())
"""


@pytest.fixture(scope="module")
def cell():
    with SimulatedCell.start("ur10e-demo", host=HOST, time_scale=SCALE) as simulated:
        yield simulated


class Peer:
    """A server for one connection of a program."""

    def __init__(self, act=None):
        self._listening = socket.create_server((PEER, 0))
        self.port = self._listening.getsockname()[1]
        self.lines = []
        self._act = act or self._listen
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self):
        with self._listening, contextlib.suppress(OSError):
            self._listening.settimeout(10.0)
            connection, _ = self._listening.accept()
            with connection:
                connection.settimeout(10.0)
                self._act(connection)

    def _listen(self, connection):
        with connection.makefile("rb") as lines:
            for line in lines:
                self.lines.append(line.decode().rstrip("\n"))

    def end(self):
        self._thread.join(15.0)
        assert not self._thread.is_alive()
        return self.lines


def send(text):
    with socket.create_connection((HOST, 30002), 2.0) as connection:
        connection.sendall(text.encode())
        connection.shutdown(socket.SHUT_WR)
        while connection.recv(4096):  # who leaves without reading may take back what was sent
            pass


def told(cell, *lines):
    """Run a program to its end: what it tells with `tell`, as text."""
    out = Peer()
    body = "\n".join(f"  {line}" for line in lines)
    send(
        f'def program():\n  socket_open("{PEER}", {out.port}, "out")\n'
        f'  def tell(value):\n    socket_send_line(to_str(value), "out")\n  end\n{body}\nend\n'
    )
    return out.end()


def test_a_program_and_a_server_talk(cell):
    heard = []

    def act(connection):
        with connection.makefile("rwb") as lines:
            heard.append(lines.readline())
            lines.write(b"one\r\ntwo\n(1.5, -2 ,3e2)" + struct.pack(">2i", 7, -2) + bytes([1, 200]))
            lines.flush()
            heard.append(lines.read(4))
            heard.append(lines.read(2))
            heard.append(lines.readline())
            lines.write(b"level 42\n")
            lines.flush()
            heard.append(lines.readline())

    peer = Peer(act)
    assert told(
        cell,
        f'tell(socket_open("{PEER}", {peer.port}))',
        'tell(socket_send_line("hi"))',
        "tell(socket_read_line())",
        "tell(socket_read_line())",
        "tell(socket_read_ascii_float(3))",
        "tell(socket_read_binary_integer(2))",
        "tell(socket_read_byte_list(2))",
        "tell(socket_send_int(-3))",
        "tell(socket_send_byte(65))",
        'tell(socket_send_string("B"))',
        'tell(socket_get_var("level"))',
        'socket_set_var("level", 43)',
        "socket_close()",
        "tell(socket_read_line())",
        "tell(socket_send_byte(1))",
    ) == [
        *("True", "True", "one", "two", "[3, 1.5, -2, 300]", "[2, 7, -2]", "[2, 1, 200]"),
        *("True", "True", "True", "42", "", "False"),
    ]
    peer.end()
    assert heard == [b"hi\n", struct.pack(">i", -3), b"AB", b"GET level\n", b"SET level 43\n"]


def test_parts_of_a_string_and_bytes_that_are_no_text(cell):
    peer = Peer(
        lambda connection: (connection.sendall(b"x>hello<>world<\xff\xfe|\tend\n"), connection.recv(9))
    )
    assert told(
        cell,
        f'socket_open("{PEER}", {peer.port}, "a")',
        'tell(socket_read_string("a", prefix=">", suffix="<"))',
        'tell(socket_read_string("a", ">", "<"))',
        's = socket_read_string("a", suffix="|")',
        "tell(str_len(s))",
        'tell(socket_read_string("a", prefix="\\t", suffix="\\n", interpret_escape=True))',
    ) == ["hello", "world", "2", "end"]


def test_a_read_waits_as_long_as_it_is_told_while_threads_go_on(cell):
    peer = Peer(lambda connection: connection.recv(9))
    lines = told(
        cell,
        f'socket_open("{PEER}", {peer.port}, "a")',
        "global turns = 0",
        "thread t():",
        "  while True:",
        "    turns = turns + 1",
        "    sync()",
        "  end",
        "end",
        "run t()",
        "begin = time(0)",
        'tell(socket_read_binary_integer(2, "a", 0.5))',
        'tell(socket_read_ascii_float(2, "a", 0.1))',
        'tell(str_empty(socket_read_string("a", timeout=0.1)))',
        "finish = time(0)",
        "tell(finish.sec - begin.sec + (finish.nanosec - begin.nanosec) / 1000000000)",
        "tell(turns > 20)",
    )
    assert lines[:3] == ["[0, -1, -1]", "[0, nan, nan]", "True"]
    assert float(lines[3]) == pytest.approx(0.7, abs=0.15)
    assert lines[4] == "True"


def test_what_is_no_server_is_no_connection(cell):
    with socket.create_server((PEER, 0)) as closed:
        port = closed.getsockname()[1]
    assert told(
        cell,
        f'tell(socket_open("{PEER}", {port}, "a"))',
        'tell(socket_open("192.0.2.1", 80, "b"))',
        'tell(socket_open("example.com", 80, "c"))',
        'tell(socket_read_line("never"))',
        f'tell(socket_open("localhost", {port}, "d"))',
    ) == ["False", "False", "False", "", "False"]


def test_a_program_that_is_stopped_closes_its_sockets(cell):
    def act(connection):
        closed.append(connection.recv(1))

    closed = []
    peer = Peer(act)
    send(f'def program():\n  socket_open("{PEER}", {peer.port})\n  socket_read_line(timeout=0)\nend\n')
    time.sleep(0.3)
    assert closed == []
    send("def program():\n  sync()\nend\n")
    peer.end()
    assert closed == [b""]


def test_a_popup_that_blocks_waits_until_it_is_closed(cell):
    out = Peer()
    send(
        f'def program():\n  socket_open("{PEER}", {out.port})\n  popup("go on?", blocking=True)\n'
        '  socket_send_line("on")\nend\n'
    )
    time.sleep(0.3)
    assert out.lines == []
    with socket.create_connection((HOST, 29999), 2.0) as connection, connection.makefile("rw") as lines:
        lines.readline()
        lines.write("close popup\n")
        lines.flush()
        assert lines.readline().strip() == "closing popup"
    assert out.end() == ["on"]


# -- Modbus


@pytest.fixture(scope="module")
def device():
    with socket.create_server((PEER, 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-c", DEVICE, PEER, str(port)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"ready\n"
        yield f"{PEER}:{port}"
        process.terminate()


CONNECTED = (
    "def connected(name):",
    "  local i = 0",
    "  while modbus_get_error(name) != 0 and i < 100:",
    "    sleep(0.02)",
    "    i = i + 1",
    "  end",
    "  return modbus_get_error(name) == 0",
    "end",
)


def test_signals_of_every_kind_are_read_and_set(cell, device):
    assert told(
        cell,
        *CONNECTED,
        f'modbus_add_signal("{device}", 255, 1, 0, "in")',
        f'modbus_add_signal("{device}", 255, 0, 0, "ins", True, 5)',
        f'modbus_add_signal("{device}", 255, 3, 1, "coil")',
        f'modbus_add_signal("{device}", 255, 8, 1, "coils", False, 10)',
        f'modbus_add_signal("{device}", 255, 7, 2, "word")',
        f'modbus_add_signal("{device}", 255, 5, 3, "out")',
        f'modbus_add_signal("{device}", 255, 20, 3, "outs", False, 3)',
        'tell([connected("in"), connected("ins"), connected("coil"), connected("outs"), connected("out")])',
        'tell(modbus_get_signal_status("in", False))',
        'tell(modbus_get_signal_status("ins"))',
        'tell(modbus_get_signal_status("word"))',
        'modbus_set_output_signal("coil", True, False)',
        "bits = make_list(10, False)",
        "bits[1] = True",
        "bits[9] = True",
        'modbus_set_output_signal("coils", bits)',
        'modbus_set_output_register("out", 65535, False)',
        'modbus_set_output_register("outs", [1, 2, 3])',
        "sleep(0.5)",
        'tell(modbus_get_error("outs") + modbus_get_error("coils") + modbus_get_error("out"))',
        'tell(modbus_get_time_since_signal_invalid("out"))',
        *(f'modbus_delete_signal("{name}")' for name in ("coil", "coils", "out", "outs")),
        f'modbus_add_signal("{device}", 255, 0, 1, "coils", False, 20)',
        f'modbus_add_signal("{device}", 255, 5, 3, "outs", False, 18)',
        'connected("coils")',
        'connected("outs")',
        'tell(binary_list_to_integer(modbus_get_signal_status("coils")))',
        'tell(modbus_get_signal_status("outs"))',
        *(f'modbus_delete_signal("{name}")' for name in ("in", "ins", "word", "coils", "outs")),
    ) == [
        "[True, True, True, True, True]",
        "False",
        "[True, False, True, False, True]",
        "107",
        "0",
        "0",
        str(1 << 3 | 1 << 9 | 1 << 17),
        str([65535, *[0] * 14, 1, 2, 3]),
    ]


def test_a_signal_to_read_and_to_write(cell, device):
    assert told(
        cell,
        *CONNECTED,
        f'modbus_add_rw_signal("{device}", 255, 40, 2, 50, 3, "both", True)',
        'connected("both")',
        'tell(modbus_get_signal_status("both"))',
        'modbus_set_output_register("both", [7, 8, 9])',
        f'modbus_add_rw_signal("{device}", 255, 50, 3, 40, 2, "back", True)',
        'modbus_set_output_register("back", [5, 6])',
        'modbus_set_signal_update_frequency("back", 50)',
        'modbus_set_signal_update_frequency("both", 50)',
        "sleep(1)",
        'tell(modbus_get_signal_status("both"))',
        'tell(modbus_get_signal_status("back"))',
        'modbus_delete_signal("both")',
        'modbus_delete_signal("back")',
    ) == ["[0, 0]", "[5, 6]", "[7, 8, 9]"]


def test_what_a_device_refuses_is_its_error_and_a_lost_one_ends_the_program(cell, device):
    assert told(
        cell,
        *CONNECTED,
        f'modbus_add_signal("{device}", 255, 9999, 3, "far")',
        "sleep(0.5)",
        'tell(modbus_get_error("far"))',
        'tell(modbus_get_error("far", 2))',
        f'modbus_add_signal("{PEER}:9", 255, 0, 3, "gone")',
        'modbus_set_signal_watchdog("gone", 1)',
        'tell(modbus_get_signal_status("gone"))',
        "sleep(1.2)",
        'tell(modbus_get_time_since_signal_invalid("gone") > 1.1)',
        'tell(modbus_get_error("gone", 2) > 0)',
        'tell(modbus_get_signal_status("gone"))',
        'tell("never")',
    ) == ["2", "0", "0", "True", "True"]
    told(cell, 'modbus_delete_signal("far")', 'modbus_delete_signal("gone")')


def test_a_program_reads_the_pump(cell):
    """The registers of the generic pump: set points are holding registers, what it does are input registers."""
    assert told(
        cell,
        *CONNECTED,
        f'modbus_add_signal("{HOST}:{cell.pump_port}", 1, 0, 3, "pump", True, 2)',
        'tell(connected("pump"))',
        'tell(get_list_length(modbus_get_signal_status("pump")))',
        'modbus_delete_signal("pump")',
    ) == ["True", "2"]
