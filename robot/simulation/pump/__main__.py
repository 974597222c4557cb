"""The simulated pump, a process of its own: `python -m robot.simulation.pump --cell CELL`.

A drive with the registers of the cell's register map, over Modbus TCP or RTU over TCP, and behind it hopper, pump and
hose.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import math
import signal
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

from planning import load_cell
from robot.pump_map import pump_map
from robot.simulation.clock import ProcessClock
from robot.simulation.faults import PUMP_PORT, Fault, FaultPort
from robot.simulation.lifetime import arguments, run, told_of_taken_ports, until_ended

from .drive import Drive, State
from .plant import Plant, PlantSettings
from .server import ModbusServer

if TYPE_CHECKING:
    from typing import TextIO

    from robot.simulation.faults import Effect

TRACE_PERIOD = 0.01  # s of wall time
TRACED = {
    "time_s": "time",
    "flow_mm3_s": "flow",
    "volume_mm3": "volume",
    "age_s": "age",
    "speed_mm3_s": "speed",
    "pressure_bar": "pressure",
    "current_a": "current",
    "hopper_mm3": "hopper",
}


async def _trace(drive: Drive, file: TextIO) -> None:
    file.write(",".join(TRACED) + "\n")
    while True:
        now = drive.report()
        values = (math.inf if now[name] is None else now[name] for name in TRACED.values())
        file.write(",".join(f"{value:.6f}" for value in values) + "\n")
        await asyncio.sleep(TRACE_PERIOD)


def _effects(drive: Drive, server: ModbusServer) -> dict[Fault, Effect]:
    """What the pump's faults do."""

    def put(target: object, **values: Any) -> None:
        for name, value in values.items():
            setattr(target, name, value)

    now = drive.clock.now
    return {
        Fault.PUMP_REPORT: lambda _: drive.report(),
        Fault.PUMP_MUTE: lambda _: put(server, muted=True),
        Fault.PUMP_UNMUTE: lambda _: put(server, muted=False),
        Fault.PUMP_RESET: lambda _: server.reset(),
        Fault.PUMP_EXCEPTION: lambda asked: put(server, exception=asked["code"]),
        Fault.PUMP_CLEAR_EXCEPTION: lambda _: put(server, exception=None),
        Fault.PUMP_FROZEN: lambda _: put(drive, frozen=True),
        Fault.PUMP_UNFROZEN: lambda _: put(drive, frozen=False),
        Fault.PUMP_TRIP: lambda _: drive.trip("asked for", State.FAULT),
        Fault.PUMP_RESET_TRIP: lambda _: drive.reset(),
        Fault.PUMP_HOPPER: lambda asked: drive.plant.fill(now(), asked["level"]),
        Fault.PUMP_BLOCK: lambda asked: drive.plant.block(now(), asked["share"]),
        Fault.PUMP_REGISTER_WIDTH: lambda asked: put(drive, width=asked["bits"]),
        Fault.PUMP_SLOW: lambda asked: put(server, slow=asked["seconds"]),
    }


async def _main(options: argparse.Namespace) -> None:
    settings = load_cell(options.cell).pump
    clock = ProcessClock(options.epoch, options.time_scale)
    plant = PlantSettings(
        flow_max=settings.flow_max,
        dead_time=settings.dead_time_s,
        lag=settings.lag_s,
        hose_volume=settings.hose_volume,
        ramp=options.ramp,
        pressure_lag=options.pressure_lag,
        hopper=options.hopper,
    )
    drive = Drive(
        pump_map(settings),
        Plant(plant, clock.now()),
        clock,
        trip=options.trip,
        pressure_limit=options.pressure_limit,
        current_limit=options.current_limit,
    )
    server = ModbusServer(
        drive,
        serial=drive.map.transport == "rtu over tcp",
        reply_delay=options.reply_delay,
        jitter=options.reply_jitter,
        seed=options.seed,
    )
    host, port = options.host or settings.host, options.port or settings.port
    with told_of_taken_ports(host, port):
        listening = await server.listen(host, port)
    with told_of_taken_ports(host, PUMP_PORT):
        await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: FaultPort(_effects(drive, server), "pump"), local_addr=(host, PUMP_PORT)
        )
    with contextlib.ExitStack() as stack:
        tasks = [asyncio.create_task(drive.watch())]
        tasks[0].add_done_callback(_end_with_it)
        if options.trace:
            file = stack.enter_context(options.trace.open("w", encoding="utf-8", buffering=1))
            tasks.append(asyncio.create_task(_trace(drive, file)))
        await until_ended(with_parent=options.child)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    listening.close()
    server.reset()


def _end_with_it(watching: asyncio.Task[None]) -> None:
    """A drive that does not watch its line is none."""
    if not watching.cancelled() and (error := watching.exception()) is not None:
        traceback.print_exception(error)
        signal.raise_signal(signal.SIGTERM)


def _seconds(text: str) -> float:
    number = float(text)
    if not 0.0 <= number < math.inf:
        raise argparse.ArgumentTypeError(f"must not be negative, not {text}")
    return number


def _amount(text: str) -> float:
    number = float(text)
    if not number >= 0.0:
        raise argparse.ArgumentTypeError(f"must not be negative, not {text}")
    return number


def main() -> int:
    """Run the simulated pump; its exit code."""
    parser = arguments("A simulated concrete pump behind a Modbus drive.")
    add = parser.add_argument
    add("--port", type=int, help="TCP port instead of the cell's")
    add("--trip", type=_seconds, default=0.5, help="wall seconds of silence until it trips; 0: never")
    add("--reply-delay", type=_seconds, default=0.0, help="wall seconds that a request takes")
    add("--reply-jitter", type=_seconds, default=0.0, help="wall seconds that it may take more")
    add("--seed", type=int, default=0, help="of the jitter")
    add("--ramp", type=_seconds, default=0.0, help="process seconds from rest to the largest flow")
    add("--hopper", type=_amount, default=math.inf, help="what the hopper holds, mm³; inf: it is never empty")
    add("--pressure-lag", type=_seconds, default=0.3, help="time constant of the pressure, process seconds")
    add("--pressure-limit", type=_amount, default=40.0, help="bar, beyond which the drive trips; inf: never")
    add("--current-limit", type=_amount, default=12.0, help="A, beyond which the drive trips; inf: never")
    add("--trace", type=Path, help="file for flow, volume, age and more over process time")
    return run(_main(parser.parse_args()), "pump")


if __name__ == "__main__":
    sys.exit(main())
