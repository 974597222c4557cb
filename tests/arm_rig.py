"""An arm that is stepped cycle by cycle, without its servers and its clock, to see what programs make of it."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np

from planning import load_cell
from robot.simulation.machine import Machine, RuntimeState
from robot.simulation.programs.library import library
from robot.simulation.programs.moves import ScriptMoves
from robot.simulation.programs.program import ScriptProgram
from robot.simulation.urscript import compiled

CYCLE = 0.002
HOME = [0.0, -math.pi / 2, -math.pi / 2, -math.pi / 2, math.pi / 2, 0.0]
LIMITS = np.radians([120.0, 120.0, 180.0, 180.0, 180.0, 180.0])


class Rig:
    """A machine whose cycles are counted out."""

    def __init__(self) -> None:
        self.machine = Machine(load_cell("ur10e-demo"), (5, 12, 0, 0))
        self.said: list[str] = []
        self.seen: list[list[float]] = []
        self.tool = np.array(self.machine.state.pose[:3])

    def load(self, *lines: str) -> None:
        text = "\n".join(["def program():", *(f"  {line}" for line in lines), "end"])
        functions = library(self.machine, ScriptMoves(self.machine, lambda: lambda: None), self.said.append)
        self.machine.load(ScriptProgram(self.machine, compiled(text, functions), self.said.append), 0.0)

    def step(self, seconds: float = CYCLE) -> None:
        machine = self.machine
        machine.cycle(machine.time + seconds, machine.time + seconds)
        state = machine.state
        speed = math.hypot(*state.tool_speed[:3])
        self.seen.append([machine.time, *state.pose[:3], speed, *state.joints, *state.joint_speeds])

    def steps(self, seconds: float) -> None:
        for _ in range(round(seconds / CYCLE)):
            self.step()

    def run(self, *lines: str, longest: float = 30.0) -> SimpleNamespace:
        """Run a program until the arm rests: time, place and speed of the tool, joints and their speeds."""
        self.load(*lines)
        self.seen.clear()
        begun = self.machine.time
        while not self.seen or self.machine.runtime is not RuntimeState.STOPPED or self.machine.motion:
            self.step()
            assert self.machine.time - begun < longest
        return self.rows(begun)

    def rows(self, begun: float = 0.0) -> SimpleNamespace:
        table = np.array(self.seen)
        return SimpleNamespace(
            time=table[:, 0] - begun,
            lasted=table[-1, 0] - begun,
            places=table[:, 1:4] - self.tool,
            speed=table[:, 4],
            joints=table[:, 5:11],
            joint_speeds=table[:, 11:17],
        )


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> str:
    """A place near the tool's first one, offsets in mm."""
    return f"pose_add(start, p[{x / 1000}, {y / 1000}, {z / 1000}, 0, 0, 0])"


START = "start = get_actual_tcp_pose()"


def trapezoid(way: float, speed: float, acceleration: float) -> float:
    full = speed * speed / acceleration
    return way / speed + speed / acceleration if way > full else 2.0 * math.sqrt(way / acceleration)
