"""`optimovej` and `optimovel`, whose speed and acceleration are shares of what the arm can do.

A real controller limits the jerk and fits the speed to the posture. Here they are the trapezoids of `movej` and
`movel`: of the slowest joint's speed, and of round figures where nothing is published.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from robot.simulation.urscript import Refusal, builtin
from robot.simulation.urscript.values import Value, number

if TYPE_CHECKING:
    from robot.simulation.machine import Machine
    from robot.simulation.urscript import Builtin

    from .moves import ScriptMoves

FIRST_VERSION = (5, 21)

JOINT_ACCELERATION = 10.0
"""Of the joints, rad/s²."""

TOOL_SPEED, TOOL_ACCELERATION = 1.0, 5.0
"""Of the tool, m/s and m/s²."""


def optimised_moves(machine: Machine, moves: ScriptMoves) -> Iterator[Builtin]:
    """The functions of one program, if the controller's version has them."""
    if machine.version < FIRST_VERSION:
        return

    def joints(goal: Value, a: Value, v: Value, r: Value) -> Iterator[None]:
        fastest = float(machine.fastest.min())
        yield from moves.movej(goal, _share(a, "a") * JOINT_ACCELERATION, _share(v, "v") * fastest, 0.0, r)

    def line(goal: Value, a: Value, v: Value, r: Value) -> Iterator[None]:
        yield from moves.movel(goal, _share(a, "a") * TOOL_ACCELERATION, _share(v, "v") * TOOL_SPEED, 0.0, r)

    defaults = {"a": 0.3, "v": 0.3, "r": 0.0}
    yield builtin("optimovej(goal, a, v, r)", joints, defaults)
    yield builtin("optimovel(goal, a, v, r)", line, defaults)


def _share(value: Value, what: str) -> float:
    found = number(value, what)
    if not 0.0 < found <= 1.0:
        raise Refusal(f"{what} is a share above 0 and up to 1, not {found:g}")
    return found
