"""The machine: the state that a UR controller keeps, and what one of its cycles does to it.

The servers around it (RTDE, dashboard, script ports, faults) read and change this state; nothing else does.
Lengths are in mm; the servers convert what their protocols give in metres.
"""

from __future__ import annotations

import math
import sys
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from planning import Cell, PlanningError, arm
from planning.pose import pose_from_vector
from robot.simulation.motions.streaming import standing

from .urscript import ScriptError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from robot.simulation.motions.frame import Numbers
    from robot.simulation.motions.motion import Motion

FAST_STOP = 3000.0  # mm/s², deceleration of stops that no command gave
LATE = 0.05  # s of wall time; after such a gap the controller itself was held up, and blames no client


class RuntimeState(IntEnum):
    """What the program does, as RTDE tells it."""

    STOPPING = 0
    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4
    RESUMING = 5


class RobotMode(IntEnum):
    """Power and brakes, as RTDE tells them."""

    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    RUNNING = 7


class SafetyMode(IntEnum):
    """What the safety system says, as RTDE tells it."""

    NORMAL = 1
    PROTECTIVE_STOP = 3
    SAFEGUARD_STOP = 5
    ROBOT_EMERGENCY_STOP = 7


class Machine:
    """State of the controller.

    Attributes:
        arm, limit: kinematics, and the joints' limits, shape (6,), rad.
        time: process time, s.
        state: of the arm.
        tool: TCP in the flange frame, shape (4, 4), mm.
        slider: the speed slider, 0 to 1.
        throttle: what of it has taken effect.
        registers: of the RTDE, by the variables' names.
    """

    def __init__(self, cell: Cell, version: tuple[int, int, int, int]) -> None:
        self.cell = cell
        self.version = version
        self.arm = arm(cell.robot.model)
        self.limit = np.radians(cell.robot.joint_limit_deg)
        self.tool_offset: Numbers = cell.tool.tcp
        self.tool = pose_from_vector(np.array([cell.tool.tcp]))[0]
        self.state = standing(self.arm, self.tool, tuple(cell.robot.home.tolist()))
        self.motion: Motion | None = None
        self.time = 0.0
        self.cycles = 0

        self.runtime = RuntimeState.STOPPED
        self.mode = RobotMode.RUNNING
        self.safety = SafetyMode.NORMAL
        self.slider = self.throttle = 1.0

        self.input_ints, self.output_ints = [0] * 48, [0] * 48
        self.input_doubles, self.output_doubles = [0.0] * 48, [0.0] * 48
        self.input_bits, self.output_bits = [False] * 128, [False] * 128
        self.digital_outputs = 0
        self.analog_outputs = [0.0, 0.0]
        self.analog_output_types = 0
        self.payload = 0.0
        self.payload_cog: Numbers = (0.0, 0.0, 0.0)
        self.external_wrench: Numbers = (0.0,) * 6

        self.on_fault: Callable[[ScriptError], None] | None = None  # who else is told of a program's end
        self._program: Iterator[None] | None = None
        self._loaded: tuple[float, Iterator[None]] | None = None  # wall time at which it starts
        self._watchdog: tuple[int, float] | None = None  # register, longest silence in s of wall time
        self._written = [0.0] * 48  # wall time of the last write to each integer input register
        self._last_wall: float | None = None

    # -- the cycle

    def cycle(self, now: float, wall: float) -> None:
        """Advance to a process time; `wall` is the monotonic clock."""
        seconds = max(0.0, now - self.time)
        late = self._last_wall is not None and wall - self._last_wall > LATE
        self.time, self._last_wall = now, wall
        self.cycles += 1
        if self._loaded and wall >= self._loaded[0]:
            self._program, self._loaded = self._loaded[1], None
            self._written = [wall] * 48
            self.runtime = RuntimeState.PLAYING
        if self._watchdog and not late and self.runtime is RuntimeState.PLAYING:
            register, longest = self._watchdog
            if wall - self._written[register] > longest:
                self.stop_program(f"no write to input_int_register_{register} for {longest:.3f} s")
        if self._program is not None and self.runtime is RuntimeState.PLAYING:
            self._step_program()
        self._move(seconds)

    def _step_program(self) -> None:
        assert self._program is not None
        try:
            next(self._program)
        except StopIteration:
            self.stop_program()
        except ScriptError as error:
            self.fault(error)
        except (PlanningError, ValueError) as error:
            self.stop_program(str(error))

    def _move(self, seconds: float) -> None:
        if self.motion is None:
            return
        target, before = self.slider, self.throttle
        reach = abs(target - before) / self.motion.throttle_rate
        if reach <= seconds:
            self.throttle = target
            path_seconds = 0.5 * (before + target) * reach + target * (seconds - reach)
        else:
            self.throttle = before + math.copysign(self.motion.throttle_rate * seconds, target - before)
            path_seconds = 0.5 * (before + self.throttle) * seconds
        try:
            self.motion.advance(seconds, path_seconds, self.throttle)
        except PlanningError as error:
            self.stop_program(str(error))
            self.motion = None
        if self.motion is None or (self.motion.finished or (self._program is None and self.motion.resting)):
            joints = self.state.joints if self.motion is None else self.motion.state.joints
            self.motion = None
            self.state = standing(self.arm, self.tool, joints)
        else:
            self.state = self.motion.state
        if self.motion is None or self.motion.resting:
            self.throttle = self.slider  # a motion begins from rest at the speed that the slider asks for
            if self.runtime is RuntimeState.PAUSING:
                self.runtime = RuntimeState.PAUSED

    # -- programs

    def load(self, program: Iterator[None], start: float) -> None:
        """Replace the program by another, which starts at a wall time; each of its steps is one cycle."""
        self.stop_program()
        self._loaded = (start, program)

    def stop_program(self, reason: str = "") -> None:
        """End the program; the arm comes to rest. A reason is told on stderr."""
        if reason:
            print(f"controller: program stopped: {reason}", file=sys.stderr, flush=True)
        if self.motion is not None:
            self.motion.brake(tool=FAST_STOP)
        self._program = self._loaded = self._watchdog = None
        self.runtime = RuntimeState.STOPPED

    def fault(self, error: ScriptError) -> None:
        """End the program for what it did."""
        self.stop_program(str(error))
        if self.on_fault is not None:
            self.on_fault(error)

    def pause_program(self) -> None:
        """Hold the program where it is; the arm comes to rest."""
        if self.runtime is not RuntimeState.PLAYING:
            return
        self.runtime = RuntimeState.PAUSED
        if self.motion is not None:
            self.motion.brake(tool=FAST_STOP)
            self.runtime = RuntimeState.PAUSING

    def play_program(self) -> bool:
        """Go on with a program that is held; whether there is one and the robot may move."""
        if self.runtime is not RuntimeState.PAUSED or not self.may_move:
            return False
        if self.motion is not None:
            self.motion.resume()
        self._written = [self._last_wall or 0.0] * 48
        self.runtime = RuntimeState.PLAYING
        return True

    def watch(self, register: int, longest: float) -> None:
        """Stop the program when an integer input register is not written for a time, s of wall time."""
        self._watchdog = (register, longest) if longest > 0.0 else None
        self._written[register] = self._last_wall or 0.0

    def write_input_int(self, register: int, value: int, wall: float) -> None:
        """A client's write; what the watchdog watches."""
        self.input_ints[register] = value
        self._written[register] = wall

    # -- safety and power

    @property
    def may_move(self) -> bool:
        """Whether power, brakes and safety let the arm move."""
        return self.mode is RobotMode.RUNNING and self.safety is SafetyMode.NORMAL

    def protective_stop(self, mode: SafetyMode = SafetyMode.PROTECTIVE_STOP) -> None:
        """Stop the arm and hold the program until the stop is cleared and the program is played on."""
        if self.safety is SafetyMode.NORMAL:
            self.safety = mode
            self.pause_program()

    def emergency_stop(self) -> None:
        """Stop the arm, end the program and take its power away."""
        self.stop_program()
        self.safety = SafetyMode.ROBOT_EMERGENCY_STOP
        self.mode = RobotMode.POWER_OFF

    def clear_stop(self) -> None:
        """Back to normal; after an emergency stop the arm still has no power."""
        self.safety = SafetyMode.NORMAL

    # -- settings of the program

    def set_tool(self, offset: Numbers) -> None:
        """Use another TCP: mm and a rotation vector in rad, in the flange frame."""
        self.tool_offset = offset
        self.tool = pose_from_vector(np.array([offset]))[0]
        if self.motion is None:
            self.state = standing(self.arm, self.tool, self.state.joints)
