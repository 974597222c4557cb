"""Motions: what moves the arm from one cycle of the controller to the next.

Every motion keeps the arm's state (`ArmState`), advances it by a time and can be braked. Path time differs from
process time by the speed slider: `advance` is given both, and the slider's share.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from .frame import Numbers

STILL: Numbers = (0.0,) * 6


class ArmState(NamedTuple):
    """The arm at one moment.

    Attributes:
        joints: rad.
        joint_speeds: rad/s.
        pose: of the tool in the base frame: mm and a rotation vector in rad.
        tool_speed: mm/s and rad/s.
    """

    joints: Numbers
    joint_speeds: Numbers
    pose: Numbers
    tool_speed: Numbers


class Motion(Protocol):
    """A motion of the arm.

    Attributes:
        state: of the arm now.
        finished: whether it has reached its end.
        resting: whether it stands, at its end or because it was braked.
        throttle_rate: how fast the speed slider may act on it, 1/s.
    """

    state: ArmState
    finished: bool
    resting: bool
    throttle_rate: float

    def advance(self, seconds: float, path_seconds: float, share: float) -> None:
        """Move on by a time of the process and of the path; the slider ends at `share`."""

    def brake(self, tool: float = math.inf, joint: float = math.inf) -> None:
        """From now on slow down until at rest, by mm/s² of the tool or rad/s² of the fastest joint."""

    def resume(self) -> None:
        """Go on after a brake, from rest."""
