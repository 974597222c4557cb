"""The functions of URScript that compute: numbers, vectors, matrices, poses."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from planning.pose import pose_from_vector, rotation_from_vector, vector_from_pose, vector_from_rotation

from .errors import Refusal
from .functions import Builtin, builtin
from .lists import LISTS
from .strings import STRINGS, raw
from .values import Pose, Value, array, integer, is_matrix, kind, number, numbers, shape, written

Array: TypeAlias = npt.NDArray[np.float64]

RIGHT_ANGLE = 1e-7  # cosine of the pitch below which roll and yaw cannot be told apart


def _of_one(name: str, function: Callable[[float], float]) -> Builtin:
    def call(value: Value) -> float:
        try:
            return float(function(number(value, f"'{name}'s argument")))
        except (ValueError, OverflowError):
            raise Refusal(f"'{name}' has no value at {written(value)}") from None

    return builtin(f"{name}(f)", call)


def _whole(name: str, function: Callable[[float], int]) -> Builtin:
    def call(value: Value) -> int:
        found = number(value, f"'{name}'s argument")
        if not math.isfinite(found):
            raise Refusal(f"'{name}' has no value at {written(value)}")
        return integer(float(function(found)), f"the result of '{name}'")

    return builtin(f"{name}(f)", call)


def _pow(base: Value, exponent: Value) -> float:
    try:
        found = number(base, "base") ** number(exponent, "exponent")
    except (OverflowError, ZeroDivisionError):
        found = math.nan
    if isinstance(found, complex) or math.isnan(found):
        raise Refusal(f"pow has no value at {written(base)}, {written(exponent)}")
    return float(found)


def _log(base: Value, value: Value) -> float:
    try:
        return math.log(number(value, "f"), number(base, "base"))
    except (ValueError, ZeroDivisionError):
        raise Refusal(f"log has no value at {written(base)}, {written(value)}") from None


def _norm(value: Value) -> Any:
    if isinstance(value, list):
        return float(math.sqrt(sum(number(item, "an item") ** 2 for item in value)))
    if type(value) is int:
        return abs(value)
    return abs(number(value, "norm's argument"))


# -- poses


def matrix(value: Value, what: str = "a pose") -> Array:
    """A pose as a transform, shape (4, 4), m."""
    found: Array = pose_from_vector(np.array([numbers(value, 6, what)]))[0]
    return found


def as_pose(transform: Array) -> Pose:
    """A transform, shape (4, 4), m, as a pose."""
    return Pose(vector_from_pose(transform[None])[0].tolist())


def _pose_trans(start: Value, then: Value) -> Pose:
    return as_pose(matrix(start, "p_from") @ matrix(then, "p_from_to"))


def _pose_inv(value: Value) -> Pose:
    inverse: Array = np.linalg.inv(matrix(value)).astype(np.float64)
    return as_pose(inverse)


def _pose_add(first: Value, second: Value) -> Pose:
    """Positions are added, rotations follow one another."""
    a, b = matrix(first, "p_1"), matrix(second, "p_2")
    made = np.eye(4)
    made[:3, :3] = a[:3, :3] @ b[:3, :3]
    made[:3, 3] = a[:3, 3] + b[:3, 3]
    return as_pose(made)


def _pose_sub(first: Value, second: Value) -> Pose:
    a, b = matrix(first, "p_to"), matrix(second, "p_from")
    made = np.eye(4)
    made[:3, :3] = a[:3, :3] @ b[:3, :3].T
    made[:3, 3] = a[:3, 3] - b[:3, 3]
    return as_pose(made)


def _pose_dist(first: Value, second: Value) -> float:
    """Distance of the positions, m."""
    a, b = numbers(first, 6, "p_from"), numbers(second, 6, "p_to")
    return math.dist(a[:3], b[:3])


def _point_dist(first: Value, second: Value) -> float:
    return _pose_dist(first, second)


def _interpolate_pose(start: Value, end: Value, share: Value) -> Pose:
    a, b, part = matrix(start, "p_from"), matrix(end, "p_to"), number(share, "alpha")
    turn = vector_from_rotation(a[:3, :3].T @ b[:3, :3])
    made = np.eye(4)
    made[:3, :3] = a[:3, :3] @ rotation_from_vector(part * turn)[0]
    made[:3, 3] = a[:3, 3] + part * (b[:3, 3] - a[:3, 3])
    return as_pose(made)


def _rpy(value: Value) -> list[float]:
    """Roll, pitch and yaw to a rotation vector, about fixed x, then y, then z."""
    roll, pitch, yaw = rotation_from_vector(np.diag(numbers(value, 3, "rpy_vector")))
    found: list[float] = vector_from_rotation(yaw @ pitch @ roll)[0].tolist()
    return found


def _to_rpy(value: Value) -> list[float]:
    """The way back; with the pitch at a right angle, where roll and yaw turn about one axis, the yaw is 0."""
    r = rotation_from_vector(np.array(numbers(value, 3, "rotation_vector")))[0].tolist()
    level = math.hypot(r[2][1], r[2][2])
    pitch = math.atan2(-r[2][0], level)
    if level < RIGHT_ANGLE:
        return [math.atan2(-r[1][2], r[1][1]), pitch, 0.0]
    return [math.atan2(r[2][1], r[2][2]), pitch, math.atan2(r[1][0], r[0][0])]


# -- matrices


def _inv(value: Value) -> Any:
    if type(value) is Pose:
        return _pose_inv(value)
    found = array(value, "m")
    if found.ndim != 2 or found.shape[0] != found.shape[1]:
        raise Refusal(f"m must be a square matrix or a pose, not {shape(value)}")
    try:
        return np.linalg.inv(found).tolist()
    except np.linalg.LinAlgError:
        raise Refusal("the matrix has no inverse") from None


def _transpose(value: Value) -> list[Any]:
    if not is_matrix(value):
        return [[item] for item in array(value, "m").tolist()]
    array(value, "m")
    return [list(column) for column in zip(*value, strict=True)]


def _size(value: Value) -> Any:
    return [len(value), len(value[0])] if is_matrix(value) else _length(value)


def _length(value: Value) -> int:
    if type(value) is str:
        return len(raw(value, "v"))
    if type(value) not in (list, Pose):
        raise Refusal(f"v must be a list or a string, not {kind(value)}")
    return len(value)


def _normalize(value: Value) -> list[float]:
    found = array(value, "v")
    length = float(np.linalg.norm(found))
    if found.ndim != 1 or length == 0.0:
        raise Refusal("v must be a list of numbers that are not all 0")
    made: list[float] = (found / length).tolist()
    return made


# -- bits


def _binary_list_to_integer(value: Value) -> int:
    if not isinstance(value, list) or any(type(bit) is not bool for bit in value):
        raise Refusal("l must be a list of booleans")
    found = sum(int(bit) << i for i, bit in enumerate(value[:32]))
    return found - (1 << 32) if found >= 1 << 31 else found


def _integer_to_binary_list(value: Value) -> list[bool]:
    return [bool(integer(value, "x") >> i & 1) for i in range(32)]


def _wrench_trans(frame: Value, wrench: Value) -> list[float]:
    """A wrench about another frame's origin and along its axes: forces, then torques."""
    transform, given = matrix(frame, "T_from_to"), np.array(numbers(wrench, 6, "w_from"))
    turn, moved = transform[:3, :3].T, transform[:3, 3]
    force = turn @ given[:3]
    return [*force.tolist(), *(turn @ (given[3:] - np.cross(moved, given[:3]))).tolist()]


MATHEMATICS: tuple[Builtin, ...] = (
    *LISTS,
    *STRINGS,
    *(_of_one(name, getattr(math, name)) for name in ("sin", "cos", "tan", "asin", "acos", "atan", "sqrt")),
    _of_one("d2r", math.radians),
    _of_one("r2d", math.degrees),
    _whole("ceil", math.ceil),
    _whole("floor", math.floor),
    builtin("atan2(x, y)", lambda x, y: math.atan2(number(x, "x"), number(y, "y"))),
    builtin("pow(base, exponent)", _pow),
    builtin("log(b, f)", _log),
    builtin("norm(a)", _norm),
    builtin("random()", random.random),
    builtin("inv(m)", _inv),
    builtin("transpose(m)", _transpose),
    builtin("size(v)", _size),
    builtin("length(v)", _length),
    builtin("normalize(v)", _normalize),
    builtin("pose_trans(p_from, p_from_to)", _pose_trans),
    builtin("pose_inv(p_from)", _pose_inv),
    builtin("pose_add(p_1, p_2)", _pose_add),
    builtin("pose_sub(p_to, p_from)", _pose_sub),
    builtin("pose_dist(p_from, p_to)", _pose_dist),
    builtin("point_dist(p_from, p_to)", _point_dist),
    builtin("interpolate_pose(p_from, p_to, alpha)", _interpolate_pose),
    builtin("rpy2rotvec(rpy_vector)", _rpy),
    builtin("rotvec2rpy(rotation_vector)", _to_rpy),
    builtin("binary_list_to_integer(l)", _binary_list_to_integer),
    builtin("integer_to_binary_list(x)", _integer_to_binary_list),
    builtin("wrench_trans(T_from_to, w_from)", _wrench_trans),
)
