"""Power and safety as a controller knows them: the robot's modes, the safety system's, and the way up from no power."""

from __future__ import annotations

from enum import IntEnum


class RobotMode(IntEnum):
    """Power and brakes, as RTDE tells them."""

    NO_CONTROLLER = -1
    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7
    UPDATING_FIRMWARE = 8


class SafetyMode(IntEnum):
    """What the safety system says, as RTDE tells it."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9
    VALIDATE_JOINT_ID = 10
    UNDEFINED_SAFETY_MODE = 11
    AUTOMATIC_MODE_SAFEGUARD_STOP = 12
    SYSTEM_THREE_POSITION_ENABLING_STOP = 13


MOVING = frozenset({SafetyMode.NORMAL, SafetyMode.REDUCED})
"""The safety system lets the arm move."""

EMERGENCY = frozenset({SafetyMode.SYSTEM_EMERGENCY_STOP, SafetyMode.ROBOT_EMERGENCY_STOP})
"""Somebody holds a button down."""

BROKEN = frozenset({SafetyMode.VIOLATION, SafetyMode.FAULT})
"""Only a restart of the safety system helps."""

_CLEARED_BY = {
    SafetyMode.PROTECTIVE_STOP: "in a protective stop; unlock it",
    SafetyMode.SAFEGUARD_STOP: "in a safeguard stop; end what asks for it",
    SafetyMode.SYSTEM_EMERGENCY_STOP: "in an emergency stop; release it, then power the robot on",
    SafetyMode.ROBOT_EMERGENCY_STOP: "in an emergency stop; release it, then power the robot on",
}


def hindrance(safety: SafetyMode) -> str:
    """What keeps an arm that may not move from it, and what ends that."""
    if safety not in MOVING:
        return f"the robot is {_CLEARED_BY.get(safety, 'in a fault; restart its safety system')}"
    return "the robot has no power or holds its brakes; power it on and release them"


_UPWARDS = (
    RobotMode.POWER_OFF,
    RobotMode.BOOTING,
    RobotMode.POWER_ON,
    RobotMode.IDLE,
    RobotMode.RUNNING,
)


class Power:
    """The robot's power and brakes.

    Attributes:
        seconds: process time that each step from no power to released brakes takes; 0: none takes any.
    """

    def __init__(self, mode: RobotMode = RobotMode.RUNNING, seconds: float = 0.0) -> None:
        self.seconds = seconds
        self._mode = mode
        self._ahead: list[RobotMode] = []
        self._due = 0.0

    @property
    def mode(self) -> RobotMode:
        """Where it is now."""
        return self._mode

    @property
    def on(self) -> bool:
        """Whether the arm has power."""
        return self._mode >= RobotMode.POWER_ON

    def set(self, mode: RobotMode) -> None:
        """Be in a mode at once."""
        self._mode = mode
        self._ahead.clear()

    def rise(self, wanted: RobotMode, now: float) -> None:
        """Begin, at a process time, to go up to a mode; nothing comes of it where that is not further up."""
        at = _UPWARDS.index((self._ahead or [self._mode])[-1])
        steps = _UPWARDS[at + 1 : _UPWARDS.index(wanted) + 1]
        if self.seconds <= 0.0:
            self.set(steps[-1] if steps else self._mode)
        elif steps:
            if not self._ahead:
                self._mode, steps = steps[0], steps[1:]
                self._due = now + self.seconds
            self._ahead += steps

    def advance(self, now: float) -> None:
        """Take the steps that are due."""
        while self._ahead and now >= self._due:
            self._mode = self._ahead.pop(0)
            self._due += self.seconds
