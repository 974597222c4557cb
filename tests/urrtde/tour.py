"""Tours of ur-rtde's clients through simulated cells, two at a time, and what the tests read from them."""

from __future__ import annotations

import json
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from robot.simulation import SimulatedCell

SCALE = 4.0
CYCLE = 0.002 * SCALE
"""A cycle of the controller in process time, s."""

TIMEOUT = 90.0


class Variant(NamedTuple):
    """A controller's version and the registers that the clients use."""

    version: str
    registers: str

    @property
    def upper(self) -> bool:
        return self.registers == "upper"


VARIANTS = [Variant(version, registers) for version in ("5.12", "5.22") for registers in ("lower", "upper")]


class Rows:
    """Packages that the receiving client was sent, in SI units.

    Attributes:
        time: process time from the first of them on, shape (n,), s.
        q, qd: of the joints, shape (n, 6).
        pose, twist: of the tool, shape (n, 6).
    """

    def __init__(self, rows: list[list[float]]) -> None:
        table = np.array(rows)
        self.time = table[:, 0] - table[0, 0]
        self.q, self.pose, self.twist, self.qd = (table[:, 1 + 6 * k : 7 + 6 * k] for k in range(4))
        self.place = self.pose[:, :3]
        self.speed = np.linalg.norm(self.twist[:, :3], axis=1)


class Tour:
    """What one tour told."""

    def __init__(self, variant: Variant) -> None:
        self.variant = variant
        address = f"127.0.37.{11 + VARIANTS.index(variant)}"
        with SimulatedCell.start(
            "ur10e-demo", host=address, version=variant.version, time_scale=SCALE
        ) as simulated:
            self.cell = simulated.cell
            client = [sys.executable, str(Path(__file__).parent), address, *variant]
            try:
                done = subprocess.run(client, capture_output=True, text=True, timeout=TIMEOUT)
                self._said, told = f"it ended with code {done.returncode}: {done.stderr[-2000:]}", done.stdout
            except subprocess.TimeoutExpired as error:
                self._said, told = f"it had not ended after {TIMEOUT:g} s", (error.stdout or b"").decode()
            self.complaints = simulated.complaints()
        steps = [json.loads(line[1:]) for line in told.splitlines() if line.startswith("@")]
        self._steps = {one["step"]: one for one in steps}

    def __getitem__(self, step: str):
        """What a step told; the test fails if the tour did not come so far, or the step went wrong."""
        if step not in self._steps:
            pytest.fail(f"the tour did not come to {step!r}: {self._said}")
        if self._steps[step].get("error"):
            pytest.fail(f"{step!r}: {self._steps[step]['error']}\nthe simulators: {self.complaints[-2000:]}")
        return self._steps[step]["values"]

    def called(self, interface: str) -> set[str]:
        """Methods of an interface that were called."""
        told = [one["called"] for one in self._steps.values() if one["called"]]
        if not told:
            pytest.fail(f"the tour did not begin: {self._said}")
        return set(told[-1][interface])


class Tours:
    """Runs the tours that are needed."""

    def __init__(self, variants: set[Variant]) -> None:
        self._workers = ThreadPoolExecutor(2, "tour")  # as many as the smallest machine has processors
        self._tours: dict[Variant, Future[Tour]] = {
            variant: self._workers.submit(Tour, variant) for variant in VARIANTS if variant in variants
        }

    def __getitem__(self, variant: Variant) -> Tour:
        return self._tours[variant].result()

    def close(self) -> None:
        self._workers.shutdown(cancel_futures=True)


def trapezoid(length: float, speed: float, acceleration: float, time: np.ndarray) -> np.ndarray:
    """Way along a move from rest to rest, by time; the fastest profile that keeps both limits."""
    ramp = min(speed / acceleration, np.sqrt(length / acceleration))
    total = length / (acceleration * ramp) + ramp
    t = np.clip(time, 0.0, total)
    rising, falling = np.minimum(t, ramp), np.maximum(t - (total - ramp), 0.0)
    return acceleration * (0.5 * rising**2 + ramp * (t - rising) - 0.5 * falling**2)


def off_the_profile(time: np.ndarray, way: np.ndarray, speed: float, acceleration: float) -> float:
    """Largest distance between a way that was gone and the trapezoid that begins when it does."""
    first = int(np.argmax(way > 1e-9 * way[-1]))
    assert first > 0, "the move had begun before it was watched"
    assert way[first] <= 0.5 * speed**2 / acceleration, "its beginning was missed"
    begun = time[first] - np.sqrt(2.0 * way[first] / acceleration)
    return float(np.abs(way - trapezoid(way[-1], speed, acceleration, time - begun)).max())


def slope(time: np.ndarray, speed: np.ndarray) -> float:
    """Even acceleration in the middle of a change of speed."""
    middle = _middle(speed)
    return float(np.median(np.diff(speed[middle]) / np.diff(time[middle])))


def bend(time: np.ndarray, way: np.ndarray, speed: np.ndarray) -> float:
    """The same from the way: speeds of joints are told as the mean of a cycle, and no two cycles are alike."""
    middle = _middle(speed)
    return float(2.0 * np.polyfit(time[middle], way[middle], 2)[0])


def _middle(speed: np.ndarray) -> np.ndarray:
    low, high = sorted((speed[0], speed[-1]))
    return (speed > low + 0.1 * (high - low)) & (speed < high - 0.1 * (high - low))
