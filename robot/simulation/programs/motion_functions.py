"""The motion functions that programs call, with their parameters and what these are if not given."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from robot.simulation.urscript import Refusal, builtin

if TYPE_CHECKING:
    from robot.simulation.urscript import Builtin

    from .moves import ScriptMoves


def motion_functions(moves: ScriptMoves, step: float) -> Iterator[Builtin]:
    """All motion functions, of one program's moves."""
    moving = False

    def alone(move: Callable[..., Iterator[None]]) -> Callable[..., Iterator[None]]:
        """The same move, for one thread at a time; what stops the arm may come from any."""

        def made(*arguments: Any) -> Iterator[None]:
            nonlocal moving
            if moving:
                raise Refusal("another thread is already controlling the robot")
            moving = True
            try:
                yield from move(*arguments)
            finally:
                moving = False

        return made

    yield builtin("movej(q, a, v, t, r)", alone(moves.movej), {"a": 1.4, "v": 1.05, "t": 0.0, "r": 0.0})
    yield builtin("movel(pose, a, v, t, r)", alone(moves.movel), {"a": 1.2, "v": 0.25, "t": 0.0, "r": 0.0})
    yield builtin("movep(pose, a, v, r)", alone(moves.movep), {"a": 1.2, "v": 0.25, "r": 0.0})
    defaults = {"a": 1.2, "v": 0.25, "r": 0.0, "mode": 0}
    yield builtin("movec(pose_via, pose_to, a, v, r, mode)", alone(moves.movec), defaults)
    following = {"a": 0.0, "v": 0.0, "t": step, "lookahead_time": 0.1, "gain": 300.0}
    yield builtin("servoj(q, *a, *v, t, lookahead_time, gain)", alone(moves.servoj), following)
    yield builtin("servoc(pose, a, v, r)", alone(moves.servoc), {"a": 1.2, "v": 0.25, "r": 0.0})
    yield builtin("speedl(xd, a, t, aRot)", alone(moves.speedl), {"a": 1.2, "t": 0.0, "aRot": 0.0})
    yield builtin("speedj(qd, a, t)", alone(moves.speedj), {"a": 1.2, "t": 0.0})
    yield builtin("stopl(a, aRot)", moves.stopl, {"a": 20.0, "aRot": 0.0})
    yield builtin("stopj(a)", moves.stopj, {"a": 2.0})
    yield builtin("get_target_waypoint()", moves.waypoint)
