"""The machine: the state that a UR controller keeps, and what one of its cycles does to it.

The servers around it (RTDE, dashboard, script ports, faults) read and change this state; nothing else does.
Lengths are in mm; the servers convert what their protocols give in metres.
"""

from __future__ import annotations

import math
import sys
from collections import deque
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from planning import Cell, PlanningError, ReachError, arm
from planning.pose import pose_from_vector
from robot.simulation.motions.frame import frame_of
from robot.simulation.motions.streaming import standing

from .modbus_client import ModbusClient
from .power import BROKEN, EMERGENCY, MOVING, Power, RobotMode, SafetyMode, hindrance
from .urscript import Added, Around, ScriptError

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot.simulation.motions.frame import Numbers
    from robot.simulation.motions.motion import Motion

FAST_STOP = 3000.0  # mm/s², deceleration of stops that no command gave
LATE = 0.05  # s of wall time; after such a gap the controller itself was held up, and blames no client


JUMP = 3.0  # largest speed of a joint that braking can do something about, by the largest that it can turn at


MEMORY = 2500  # cycles for which the joints are remembered


class RuntimeState(IntEnum):
    """What the program does, as RTDE tells it."""

    STOPPING = 0
    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4
    RESUMING = 5


class Program(Protocol):
    """What runs on a machine: each of its steps is one cycle, and closing it ends it."""

    def __next__(self) -> None: ...

    def close(self) -> None: ...


class Statements(Protocol):
    """What adds statements to a program while it runs."""

    last_interpreted: int
    last_executed: int
    last_cleared: int

    @property
    def unexecuted(self) -> int: ...

    @property
    def clearing(self) -> bool: ...

    @property
    def ended(self) -> bool: ...

    def read(self, text: str) -> tuple[Added, Around]: ...

    def take(self, found: Added, around: Around) -> int: ...

    def skip(self) -> None: ...

    def abort(self) -> None: ...


class Machine:
    """State of the controller.

    Attributes:
        arm, limit, fastest: kinematics, and the joints' limits, shape (6,), rad and rad/s.
        time: process time, s.
        state: of the arm.
        before, elapsed: its state one cycle ago, and the process time since then, s.
        motion, failure: what moves the arm, and why it could not go on; the program is yet to find that.
        limits: those of the joints, as plain numbers.
        tool, tool_frame: TCP in the flange frame, shape (4, 4), mm, and as plain numbers.
        slider: the speed slider, 0 to 1.
        throttle: what of it has taken effect.
        input_ints, input_doubles, input_bits, output_ints, output_doubles, output_bits: registers of the RTDE.
    """

    def __init__(self, cell: Cell, version: tuple[int, int, int, int]) -> None:
        self.cell = cell
        self.version = version
        self.arm = arm(cell.robot.model)
        self.limit = np.radians(cell.robot.joint_limit_deg)
        self.limits: list[float] = self.limit.tolist()
        self.fastest = np.radians(cell.robot.joint_speed_deg)
        self._fastest = (1.0001 * self.fastest).tolist()
        self.tool_offset: Numbers = cell.tool.tcp
        self.tool = pose_from_vector(np.array([cell.tool.tcp]))[0]
        self.tool_frame = frame_of(self.tool)
        self.state = standing(self.arm, self.tool, tuple(cell.robot.home.tolist()))
        self.motion: Motion | None = None
        self.failure: PlanningError | None = None
        self.time = 0.0
        self.cycles = 0
        self.before, self.elapsed = self.state, 0.0
        self.execution_time = 0.0  # of the last cycle, ms of wall time

        self.runtime = RuntimeState.STOPPED
        self.power = Power()
        self.safety = SafetyMode.NORMAL
        self.stopped_at = -math.inf  # process time of the last stop that the safety system made
        self.slider = self.throttle = 1.0

        self.input_ints, self.output_ints = [0] * 48, [0] * 48
        self.input_doubles, self.output_doubles = [0.0] * 48, [0.0] * 48
        self.input_bits, self.output_bits = [False] * 128, [False] * 128
        self.digital_outputs = 0
        self.digital_inputs = 0  # bits as RTDE numbers them: 8 standard, 8 configurable, 2 of the tool
        self.analog_outputs = [0.0, 0.0]  # shares of their range
        self.analog_output_types = 0
        self.tool_voltage = 0
        self.flags = [False] * 32
        self.encoders: list[tuple[int, int] | None] = [None, None]  # kind and count
        self.payload = 0.0
        self.payload_cog: Numbers = (0.0, 0.0, 0.0)
        self.payload_inertia: Numbers = (0.0,) * 6
        self.gravity: Numbers = (0.0, 0.0, 9.82)
        self.external_wrench: Numbers = (0.0,) * 6
        self._wrench_zero: Numbers = (0.0,) * 6
        self.freedrive = False
        self.past_joints: deque[Numbers] = deque([self.state.joints], MEMORY)

        self.popup: str | None = None  # what the pendant shows until somebody closes it
        self.interpreter: Statements | None = None  # of the program that runs, if it lets any be added
        self.modbus: ModbusClient | None = None  # once a program has signals
        self.rtde_value: Callable[[str], Any] = lambda _: (
            None
        )  # of an output of the RTDE, None if there is none
        self.fieldbus: list[
            Callable[[], None]
        ] = []  # what else happens in each cycle, whatever the program does

        self.on_fault: Callable[[ScriptError], None] | None = None  # who else is told of a program's end
        self.on_program: Callable[[str, bool], None] | None = (
            None  # who is told that one has begun, or has ended
        )
        self._program: Program | None = None
        self._loaded: tuple[float, Program] | None = None  # wall time at which it starts
        # Register, longest silence in s of wall time, whether the program is paused then and not stopped.
        self._watchdog: tuple[int, float, bool] | None = None
        self._written = [0.0] * 48  # wall time of the last write to each integer input register
        self._last_wall: float | None = None

    # -- the cycle

    def cycle(self, now: float, wall: float) -> None:
        """Advance to a process time; `wall` is the monotonic clock."""
        seconds = max(0.0, now - self.time)
        self.before, self.elapsed = self.state, seconds
        if self._last_wall is not None and wall - self._last_wall > LATE:
            self._written = [wall] * 48
        self.time, self._last_wall = now, wall
        self.cycles += 1
        self.power.advance(now)
        if self._loaded and not self.may_move:
            self.stop_program(self.why_not)
        if self._loaded and wall >= self._loaded[0]:
            self._program, self._loaded = self._loaded[1], None
            self._tell_program(began=True)
            self._written = [wall] * 48
            self.runtime = RuntimeState.PLAYING
        if self._watchdog and self.runtime is RuntimeState.PLAYING:
            register, longest, pauses = self._watchdog
            if wall - self._written[register] > longest:
                end = self.pause_program if pauses else self.stop_program
                end(f"no write to input_int_register_{register} for {longest:.3f} s")
        for poll in self.fieldbus:
            poll()
        if self._program is not None and self.runtime is RuntimeState.PLAYING:
            self._step_program()
        self._move(seconds)
        self.past_joints.append(self.state.joints)

    def _step_program(self) -> None:
        assert self._program is not None
        failure = self.failure
        try:
            next(self._program)  # the thread that moves the arm finds what failed, which tells the place
            if failure is not None:
                self.stop_program(str(failure))
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
            self._mind_speeds(self.motion.state.joint_speeds)
        except PlanningError as error:
            if self._program is not None:  # one that is loaded meanwhile has no part in it
                self.failure = error
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

    def _mind_speeds(self, speeds: Numbers) -> None:
        """Stop the arm if a joint is led faster than it can turn.

        Raises:
            ReachError: a joint is led so fast that it would have to jump.
        """
        if all(map(float.__le__, map(abs, speeds), self._fastest)):
            return
        if not all(map(math.isfinite, speeds)):
            raise ReachError("the arm is led to no place at all")
        share = [abs(speed) / most for speed, most in zip(speeds, self._fastest, strict=True)]
        joint = share.index(max(share))
        found = f"joint {joint + 1} is led at {math.degrees(abs(speeds[joint])):.0f} degrees/s"
        if share[joint] > JUMP:
            raise ReachError(f"{found}: a singularity, or a target out of the blue, makes it jump")
        if self.safety in MOVING:
            print(f"controller: protective stop: {found}, faster than it turns", file=sys.stderr, flush=True)
            self.protective_stop()

    # -- programs

    def load(self, program: Program, start: float) -> None:
        """Replace the program by another, which starts at a wall time; each of its steps is one cycle."""
        self.stop_program()
        self._loaded = (start, program)

    @property
    def starting(self) -> bool:
        """Whether a program waits for its start."""
        return self._loaded is not None

    def stop_program(self, reason: str = "") -> None:
        """End the program; the arm comes to rest. A reason is told on stderr."""
        if reason:
            print(f"controller: program stopped: {reason}", file=sys.stderr, flush=True)
        if self.motion is not None:
            self.motion.brake(tool=FAST_STOP)
        ended = [self._program, self._loaded[1] if self._loaded is not None else None]
        if self._program is not None:
            self._tell_program(began=False)
        self._program = self._loaded = self._watchdog = self.failure = None
        for program in ended:
            if program is not None:
                program.close()
        self.runtime = RuntimeState.STOPPED

    def _tell_program(self, *, began: bool) -> None:
        if self.on_program is not None:
            self.on_program(getattr(self._program, "name", ""), began)

    def fault(self, error: ScriptError) -> None:
        """End the program for what it did."""
        self.stop_program(str(error))
        if self.on_fault is not None:
            self.on_fault(error)

    def pause_program(self, reason: str = "") -> None:
        """Hold the program where it is; the arm comes to rest. A reason is told on stderr."""
        if self.runtime is not RuntimeState.PLAYING:
            return
        if reason:
            print(f"controller: program paused: {reason}", file=sys.stderr, flush=True)
        self.runtime = RuntimeState.PAUSED
        if self.motion is not None:
            self.motion.brake(tool=FAST_STOP)
            self.runtime = RuntimeState.PAUSING

    def play_program(self) -> bool:
        """Go on with a program that is held; whether there is one and the robot may move."""
        if self.runtime not in {RuntimeState.PAUSED, RuntimeState.PAUSING} or not self.may_move:
            return False
        if self.motion is not None:
            self.motion.resume()
        self._written = [self._last_wall or 0.0] * 48
        self.runtime = RuntimeState.PLAYING
        return True

    def watch(self, register: int, longest: float, *, pauses: bool) -> None:
        """Pause or stop the program when an integer input register is not written for a time, s of wall time."""
        self._watchdog = (register, longest, pauses) if longest > 0.0 else None
        self._written[register] = self._last_wall or 0.0

    def write_input_int(self, register: int, value: int, wall: float) -> None:
        """A client's write; what the watchdog watches."""
        self.input_ints[register] = value
        self._written[register] = wall

    # -- safety and power

    @property
    def mode(self) -> RobotMode:
        """Power and brakes."""
        return self.power.mode

    @mode.setter
    def mode(self, mode: RobotMode) -> None:
        self.power.set(mode)

    @property
    def may_move(self) -> bool:
        """Whether power, brakes and safety let the arm move."""
        return self.mode is RobotMode.RUNNING and self.safety in MOVING

    @property
    def why_not(self) -> str:
        """Why it may not move, where it may not."""
        return hindrance(self.safety)

    def power_up(self, mode: RobotMode) -> bool:
        """Go up to a mode, `IDLE` or `RUNNING`; whether the safety system allows it."""
        if self.safety in EMERGENCY | BROKEN:
            return False
        self.power.rise(mode, self.time)
        return True

    def power_off(self) -> None:
        """End the program and take the arm's power away."""
        self.stop_program()
        self.mode = RobotMode.POWER_OFF

    def protective_stop(self, mode: SafetyMode = SafetyMode.PROTECTIVE_STOP) -> None:
        """Stop the arm and hold the program until the stop is cleared and the program is played on."""
        if self.safety in MOVING:
            self.safety, self.stopped_at = mode, self.time
            self.pause_program()

    def emergency_stop(self, mode: SafetyMode = SafetyMode.ROBOT_EMERGENCY_STOP) -> None:
        """Stop the arm, end the program and take its power away; so do violations and faults."""
        self.power_off()
        self.safety, self.stopped_at = mode, self.time

    def clear_stop(self) -> None:
        """Back to normal; after an emergency stop the arm still has no power."""
        self.safety = SafetyMode.NORMAL

    def restart_safety(self) -> None:
        """Restart the safety system, which takes the power away and forgets violations and faults."""
        self.power_off()
        if self.safety not in EMERGENCY:
            self.clear_stop()

    # -- settings of the program

    @property
    def wrench(self) -> Numbers:
        """At the tool, N and Nm."""
        return tuple([w - zero for w, zero in zip(self.external_wrench, self._wrench_zero, strict=True)])

    def zero_force_sensor(self) -> None:
        """Take what the sensor shows now for nothing."""
        self._wrench_zero = self.external_wrench

    def set_tool(self, offset: Numbers) -> None:
        """Use another TCP: mm and a rotation vector in rad, in the flange frame."""
        self.tool_offset = offset
        self.tool = pose_from_vector(np.array([offset]))[0]
        self.tool_frame = frame_of(self.tool)
        if self.motion is None:
            self.state = standing(self.arm, self.tool, self.state.joints)
