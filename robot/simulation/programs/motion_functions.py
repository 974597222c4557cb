"""The motion functions that programs call, with their parameters and what these are if not given."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from robot.simulation.urscript import builtin

if TYPE_CHECKING:
    from robot.simulation.urscript import Builtin

    from .moves import ScriptMoves

STEP = 0.002
"""A cycle as programs count it, s."""


def motion_functions(moves: ScriptMoves) -> Iterator[Builtin]:
    """All motion functions, of one program's moves."""
    yield builtin("movej(q, a, v, t, r)", moves.movej, {"a": 1.4, "v": 1.05, "t": 0.0, "r": 0.0})
    yield builtin("movel(pose, a, v, t, r)", moves.movel, {"a": 1.2, "v": 0.25, "t": 0.0, "r": 0.0})
    yield builtin("movep(pose, a, v, r)", moves.movep, {"a": 1.2, "v": 0.25, "r": 0.0})
    defaults = {"a": 1.2, "v": 0.25, "r": 0.0, "mode": 0}
    yield builtin("movec(pose_via, pose_to, a, v, r, mode)", moves.movec, defaults)
    following = {"a": 0.0, "v": 0.0, "t": STEP, "lookahead_time": 0.1, "gain": 300.0}
    yield builtin("servoj(q, *a, *v, t, lookahead_time, gain)", moves.servoj, following)
    yield builtin("speedl(xd, a, t, *aRot)", moves.speedl, {"a": 1.2, "t": 0.0, "aRot": 0.0})
    yield builtin("speedj(qd, a, t)", moves.speedj, {"a": 1.2, "t": 0.0})
    yield builtin("stopl(a, *aRot)", moves.stopl, {"a": 20.0, "aRot": 0.0})
    yield builtin("stopj(a)", moves.stopj, {"a": 2.0})
