"""A simulated pump alone, as the process that it is."""

import contextlib
import subprocess
import sys
import time

from pymodbus.client import ModbusTcpClient
from pymodbus.framer import FramerType

from planning import load_cell
from planning.configuration import find_configuration
from robot.pump_map import pump_map
from robot.simulation import Fault
from robot.simulation.faults import inject


class PumpAlone:
    """One pump process.

    Attributes:
        host, port: where its drive listens.
        cell: whose pump it is.
        map: its register map.
        pid: of the process.
        epoch: wall time of process time 0, s.
    """

    def __init__(self, host, cell, process, epoch):
        self.host, self.cell, self.process, self.epoch = host, cell, process, epoch
        self.port, self.map, self.pid = cell.pump.port, pump_map(cell.pump), process.pid

    def inject(self, fault, **values):
        return inject(self.host, fault, **values)

    def report(self):
        return self.inject(Fault.PUMP_REPORT)


def cell_file(folder, registers="generic", **settings):
    """A cell file with a pump of its own kind, its keys of [pump] set."""
    text = find_configuration("cells", "ur10e-demo").read_text()
    before, pump = text.split("[pump]")
    settings["registers"] = registers
    kept = [row for row in pump.splitlines() if row.split("=")[0].strip() not in settings]
    rows = [
        f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value!r}"
        for key, value in settings.items()
    ]
    path = folder / "cell.toml"
    path.write_text("\n".join([before, "[pump]", *kept, *rows, ""]))
    return path


@contextlib.contextmanager
def pump_alone(host, path, *options):
    """Start the pump of a cell file and wait until it is ready."""
    epoch = time.monotonic()
    command = [sys.executable, "-m", "robot.simulation.pump", "--child", "--cell", str(path), "--host", host]
    command += ["--epoch", repr(epoch)]
    with subprocess.Popen(
        [*command, *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        try:
            assert process.stdout.readline() == b"ready\n", process.stderr.read().decode()
            yield PumpAlone(host, load_cell(str(path)), process, epoch)
            assert process.poll() is None, process.stderr.read().decode()
        finally:
            process.stdin.close()
            process.terminate()
            process.wait(5.0)


class Line:
    """A pymodbus client that knows the pump's map: values by name, in their own units."""

    def __init__(self, pump, timeout=1.0):
        self.map = pump.map
        framer = FramerType.SOCKET if pump.map.transport == "tcp" else FramerType.RTU
        self.client = ModbusTcpClient(pump.host, port=pump.port, timeout=timeout, retries=0, framer=framer)
        assert self.client.connect()

    def words(self, table, address, count):
        read = self.client.read_input_registers if table == "input" else self.client.read_holding_registers
        answer = read(address, count=count, device_id=self.map.device_id)
        assert not answer.isError(), answer
        return answer.registers

    def get(self, name):
        place = self.map.values[name]
        return place.decode(self.words(place.table, place.address, place.count))

    def flow(self):
        return self.map.flow(self.get("measured_flow"))

    def state(self, name):
        place = self.map.bits[name]
        return place.read(self.words(place.table, place.address, 1)[0])

    def put(self, name, words):
        at = self.map.values[name].address
        device = self.map.device_id
        if len(words) == 1:
            answer = self.client.write_register(at, words[0], device_id=device)
        else:
            answer = self.client.write_registers(at, words, device_id=device)
        assert not answer.isError(), answer

    def command(self, name):
        self.put("command", [getattr(self.map.commands, name)])

    def run(self, flow):
        """Pump; the wall times just before and just after it was told."""
        self.put("set_flow", self.map.words(flow))
        before = time.monotonic()
        self.command("forward")
        return before, time.monotonic()

    def close(self):
        self.client.close()
