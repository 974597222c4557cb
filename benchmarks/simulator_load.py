"""The simulated controller under load: one robot at 500 Hz, then four at 125 Hz, each with a client that receives
values and one that streams positions by servoL. The clients are processes of their own: receiving is bare RTDE, so that
what is measured is the controller, and streaming is ur-rtde. Beside them runs a bare timer of the same period, which
tells how evenly the machine itself lets a process wake up: no arrivals are more even than that. What the machine's host
kept for others is told as well.

`--seconds 600` is the figure that counts, on a machine that does nothing else.
"""

import argparse
import contextlib
import json
import math
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

from robot import rtde
from robot.simulation import SimulatedCell
from robot.simulation.addresses import free_address

LOADS = ((1, 500.0), (4, 125.0))  # robots, and the frequency of their clients, Hz
RADIUS, SPEED = 0.05, 0.1  # m and m/s, of the circle that is streamed
NAMES = ("timestamp", "actual_q", "actual_qd", "actual_TCP_pose", "actual_TCP_speed", "robot_status_bits")


def wait_for_all():
    """Say that this client is connected, and wait until all are."""
    print("connected", flush=True)
    sys.stdin.readline()


def receive(host, frequency, seconds):
    """Times of the controller's cycles and of their arrival, s."""
    arrived, stamps = [], []
    with socket.create_connection((host, rtde.PORT)) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        stream = rtde.PackageStream()
        packages = []

        def ask(question):
            connection.sendall(question)
            while not packages:
                packages.extend(stream.feed(connection.recv(65536)))
            return packages.pop(0)[1]

        ask(rtde.ask_protocol())
        _, types = rtde.read_types(ask(rtde.ask_outputs(NAMES, frequency)))
        recipe = rtde.Recipe(NAMES, types)
        wait_for_all()
        ask(rtde.ask_start())
        end = time.monotonic() + seconds
        while (now := time.monotonic()) < end:
            for kind, payload in stream.feed(connection.recv(65536)):
                if kind == rtde.Package.VALUES:
                    arrived.append(now)
                    stamps.append(recipe.unpack(payload[1:])["timestamp"])
    return {"arrived": np.diff(arrived).tolist(), "stamps": np.diff(stamps).tolist()}


def stream(host, frequency, seconds):
    """Refused calls of servoL along a circle, and how many there were."""
    control = RTDEControlInterface(host, frequency)
    receiving = RTDEReceiveInterface(host, frequency, ["actual_TCP_pose"])
    start = receiving.getActualTCPPose()
    receiving.disconnect()
    failed = calls = 0
    wait_for_all()
    began = time.monotonic()
    while (elapsed := time.monotonic() - began) < seconds:
        period = control.initPeriod()
        angle = SPEED / RADIUS * elapsed
        target = [
            start[0],
            start[1] + RADIUS * math.sin(angle),
            start[2] + RADIUS * (1.0 - math.cos(angle)),
            *start[3:],
        ]
        failed += not control.servoL(target, 0.0, 0.0, 1.0 / frequency, 0.05, 300.0)
        calls += 1
        control.waitPeriod(period)
    control.servoStop()
    control.disconnect()
    return {"failed": failed, "calls": calls}


def tick(_, frequency, seconds):
    """Periods of a timer that wakes a process which does nothing, s."""
    wait_for_all()
    woke, due = [], time.monotonic()
    end = due + seconds
    while due < end:
        due += 1.0 / frequency
        time.sleep(max(due - time.monotonic(), 0.0))
        woke.append(time.monotonic())
    return {"woke": np.diff(woke).tolist()}


ROLES = {"receive": receive, "stream": stream, "tick": tick}


def stolen():
    """Time that the machine's host has kept for others so far, s over all processors; 0 where it does not say."""
    fields = Path("/proc/stat").read_text(encoding="ascii").splitlines()[0].split()
    return int(fields[8]) / os.sysconf("SC_CLK_TCK")


def used(process):
    """CPU time of a process so far, s."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def load(robots, frequency, seconds):
    """Print what so many robots at a frequency come to."""
    with contextlib.ExitStack() as stack:
        cells = [
            stack.enter_context(
                SimulatedCell.start("ur10e-demo", host=stack.enter_context(free_address(5020)))
            )
            for _ in range(robots)
        ]
        roles = [(role, cell.host) for cell in cells for role in ("receive", "stream")] + [("tick", "")]
        clients = [
            subprocess.Popen(
                [sys.executable, __file__, "--role", role, host, str(frequency), str(seconds)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            )
            for role, host in roles
        ]
        for client in clients:
            client.stdout.readline()  # it is connected
        before, began = [used(cell.process_ids["controller"]) for cell in cells], time.monotonic()
        stolen_before = stolen()
        for client in clients:
            client.stdin.write(b"go\n")
            client.stdin.flush()
        time.sleep(seconds)
        after, elapsed = [used(cell.process_ids["controller"]) for cell in cells], time.monotonic() - began
        kept = (stolen() - stolen_before) / (elapsed * (os.cpu_count() or 1))
        said = [json.loads(client.communicate()[0]) for client in clients]
    period = 1.0 / frequency
    print(f"{robots} robot{'s' * (robots > 1)} at {frequency:g} Hz for {seconds:g} s:")
    for name, key in (("cycles", "stamps"), ("arrivals", "arrived"), ("timer", "woke")):
        periods = np.concatenate([found[key] for found in said if key in found])
        inside = np.mean(np.abs(periods - period) <= 1e-3)
        p50, p99 = 1e3 * np.percentile(periods, [50, 99])
        print(
            f"  {name:9} p50 {p50:.3f} ms, p99 {p99:.3f} ms, longest {1e3 * periods.max():.1f} ms, "
            f"{inside:.2%} within {1e3 * period:g} ± 1 ms"
        )
    failed, calls = (sum(found.get(key, 0) for found in said) for key in ("failed", "calls"))
    print(f"  servoL    {calls} calls, {failed} refused")
    shares = [(b - a) / elapsed for a, b in zip(before, after, strict=True)]
    print("  CPU       " + ", ".join(f"{share:.1%}" for share in shares) + " of one core per controller")
    print(f"  host      kept {kept:.1%} of the machine for others")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--robots", type=int, choices=[robots for robots, _ in LOADS], help="one load alone")
    parser.add_argument("--role", nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.role:
        role, host, frequency, seconds = options.role
        print(json.dumps(ROLES[role](host, float(frequency), float(seconds))))
        return
    for robots, frequency in LOADS:
        if options.robots in (None, robots):
            load(robots, frequency, options.seconds)


if __name__ == "__main__":
    main()
