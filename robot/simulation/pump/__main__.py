"""The simulated pump, a process of its own: `python -m robot.simulation.pump --cell CELL`.

A Modbus TCP drive with the holding registers of the cell's register map, and behind it the hose. The drive trips when
its controller falls silent while it runs: no write changes any register, the heartbeat least of all. Pressure is
not simulated.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from planning import load_cell
from robot.pump_map import (
    LARGEST_COUNT,
    READY_BIT,
    RUNNING_BIT,
    STOP,
    TRIPPED_BIT,
    PumpMap,
    load_pump_map,
)
from robot.simulation.clock import ProcessClock
from robot.simulation.faults import PUMP_PORT, Fault, FaultPort
from robot.simulation.lifetime import arguments, run, told_of_taken_ports, until_ended

from .hose import Hose

if TYPE_CHECKING:
    import argparse
    from typing import TextIO

READ, WRITE_ONE, WRITE_MANY = 3, 6, 16
TRACE_PERIOD = 0.01  # s of wall time


class Drive:
    """The drive's registers and its watchdog.

    Attributes:
        tripped: whether it stopped by itself; a stop command makes it ready again.
        muted: neither answer nor do anything.
    """

    def __init__(self, registers: PumpMap, hose: Hose, clock: ProcessClock, trip: float) -> None:
        self.map = registers
        self.hose = hose
        self.clock = clock
        self.tripped = self.muted = False
        self._trip = trip
        self._values = [0] * registers.register_count
        self._target = 0.0
        self._changed = time.monotonic()

    @property
    def running(self) -> bool:
        """Whether it is told to run, and does."""
        return self._values[self.map.registers.command] != STOP and not self.tripped

    def write(self, address: int, values: list[int]) -> None:
        """Take register values from the controller, all at once."""
        at = self.map.registers
        wall = time.monotonic()
        if self._values[address : address + len(values)] != values:
            self._changed = wall
        self._values[address : address + len(values)] = values
        if address <= at.command < address + len(values) and self._values[at.command] == STOP:
            self.tripped = False
        self._act(wall)

    def read(self) -> list[int]:
        """All registers now."""
        at = self.map.registers
        self.hose.advance(self.clock.now())
        self._values[at.measured_flow] = min(round(self.hose.flow / self.map.flow_unit), LARGEST_COUNT)
        self._values[at.status] = (
            TRIPPED_BIT if self.tripped else READY_BIT | (RUNNING_BIT if self.running else 0)
        )
        return self._values

    def report(self) -> dict[str, float]:
        """What leaves the nozzle: process time in s, flow in mm³/s and volume in mm³."""
        self.hose.advance(self.clock.now())
        return {"time": self.hose.time, "flow": self.hose.flow, "volume": self.hose.volume}

    async def watch(self) -> None:
        """Trip when the controller is silent for too long, s of wall time."""
        while self._trip > 0.0:
            silent = time.monotonic() - self._changed
            if self.running and silent >= self._trip:
                self.tripped = True
                self._act(time.monotonic())
            await asyncio.sleep(max(self._trip - silent, 0.001) if self.running else 0.005)

    async def exchange(
        self,
        function: int,
        start: int,
        address: int,
        count: int,
        memory: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """What pymodbus asks before it reads or writes its own `memory`, which begins at `start`."""
        del count
        if self.muted:
            return ExcCodes.DEVICE_FAILURE  # nothing happens; the answer itself is swallowed by `silence`
        if function not in {READ, WRITE_ONE, WRITE_MANY}:
            return ExcCodes.ILLEGAL_FUNCTION
        if values is not None:
            self.write(address - start, [int(value) for value in values])
        memory[: len(self._values)] = self.read()
        return None

    def silence(self, sending: bool, data: bytes) -> bytes:
        """What pymodbus passes every frame through: nothing is sent while muted."""
        return b"" if sending and self.muted else data

    def _act(self, wall: float) -> None:
        """Pass the flow that the registers ask for on to the hose, if it is another than before."""
        at = self.map.registers
        target = self.map.flow(self._values[at.set_flow]) if self.running else 0.0
        if target != self._target:
            self._target = target
            self.hose.command(self.clock.at(wall), target)


async def _trace(drive: Drive, file: TextIO) -> None:
    file.write("time_s,flow_mm3_s,volume_mm3\n")
    while True:
        now = drive.report()
        file.write(f"{now['time']:.6f},{now['flow']:.6f},{now['volume']:.6f}\n")
        await asyncio.sleep(TRACE_PERIOD)


async def _listen(drive: Drive, host: str, port: int) -> ModbusTcpServer:
    with (
        told_of_taken_ports(host, port),
        socket.socket() as probe,
    ):  # the server itself does not say why it fails
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((host, port))
        probe.listen()
    memory = SimData(0, count=drive.map.register_count, values=0, datatype=DataType.REGISTERS)
    device = SimDevice(id=drive.map.device_id, simdata=[memory], action=drive.exchange)
    server = ModbusTcpServer(device, address=(host, port), trace_packet=drive.silence)
    await server.serve_forever(background=True)

    def mute(muted: bool) -> None:
        drive.muted = muted

    faults: dict[Fault, Any] = {
        Fault.PUMP_MUTE: lambda _: mute(True),
        Fault.PUMP_UNMUTE: lambda _: mute(False),
        Fault.PUMP_REPORT: lambda _: drive.report(),
    }
    with told_of_taken_ports(host, PUMP_PORT):
        await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: FaultPort(faults), local_addr=(host, PUMP_PORT)
        )
    return server


async def _main(options: argparse.Namespace) -> None:
    cell = load_cell(options.cell)
    clock = ProcessClock(options.epoch, options.time_scale)
    hose = Hose(cell.pump.dead_time_s, cell.pump.lag_s, clock.now())
    drive = Drive(load_pump_map(cell.pump.registers, Path(options.cell).parent), hose, clock, options.trip)
    server = await _listen(drive, options.host or cell.pump.host, options.port or cell.pump.port)
    with contextlib.ExitStack() as stack:
        tasks = [asyncio.create_task(drive.watch())]
        if options.trace:
            file = stack.enter_context(options.trace.open("w", encoding="utf-8", buffering=1))
            tasks.append(asyncio.create_task(_trace(drive, file)))
        await until_ended(with_parent=options.child)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    await server.shutdown()  # type: ignore[no-untyped-call]


def main() -> int:
    """Run the simulated pump; its exit code."""
    parser = arguments("A simulated concrete pump behind a Modbus TCP drive.")
    parser.add_argument("--port", type=int, help="TCP port instead of the cell's")
    parser.add_argument(
        "--trip", type=float, default=0.5, help="wall seconds of silence until it trips; 0: never"
    )
    parser.add_argument("--trace", type=Path, help="file for flow and volume over process time")
    return run(_main(parser.parse_args()), "pump")


if __name__ == "__main__":
    sys.exit(main())
