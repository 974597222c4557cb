"""The functions of a controller that programs call."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from robot.simulation.motions.arm_frame import flange_frame
from robot.simulation.motions.frame import Numbers, compose, frame_at, metres, millimetres, pose_numbers
from robot.simulation.power import SafetyMode
from robot.simulation.urscript import MATHEMATICS, Library, Refusal, builtin
from robot.simulation.urscript.values import Pose, Value, finite, integer, number, numbers, truth, written
from robot.simulation.versions import cycle_time

from .contact import contact_functions
from .interpreter import Interpreter
from .modbus_signals import modbus_functions
from .motion_functions import motion_functions
from .moves import HALF_A_CYCLE
from .optimised_moves import optimised_moves
from .popups import message_functions
from .sockets import Sockets, socket_functions
from .system_functions import system_functions

if TYPE_CHECKING:
    from robot.simulation.machine import Machine
    from robot.simulation.urscript import Builtin

    from .moves import ScriptMoves

REGISTERS = 48
BITS = 128


def library(
    machine: Machine,
    moves: ScriptMoves,
    log: Callable[[str], None],
    sockets: Sockets | None = None,
    interpreter: Interpreter | None = None,
) -> Library:
    """What a program on a machine can call.

    Args:
        machine: whose state the functions read and change.
        moves: its motions.
        log: is told what a program says.
        sockets: its connections; new ones if None.
        interpreter: its interpreter mode; a new one if None.
    """
    found = (
        *MATHEMATICS,
        *_time(machine),
        *message_functions(machine, log),
        *_registers(machine),
        *_outputs(machine),
        *_state(machine),
        *_kinematics(machine, moves),
        *_settings(machine),
        *contact_functions(machine),
        *modbus_functions(machine),
        *system_functions(machine),
        *motion_functions(moves, cycle_time(machine.version)),
        *optimised_moves(machine, moves),
        *socket_functions(sockets if sockets is not None else Sockets(machine, log)),
        *(interpreter if interpreter is not None else Interpreter(machine)).functions(),
    )
    return {one.name: one for one in found}


def _time(machine: Machine) -> Iterator[Builtin]:
    def sync() -> Iterator[None]:
        yield

    def sleep(t: Value) -> Iterator[None]:
        until = machine.time + number(t, "t")
        yield
        while machine.time < until - HALF_A_CYCLE:
            yield

    yield builtin("sync()", sync)
    yield builtin("sleep(t)", sleep)
    yield builtin("get_steptime()", lambda: cycle_time(machine.version))


def _registers(machine: Machine) -> Iterator[Builtin]:
    def place(address: Value, count: int) -> int:
        found = integer(address, "address")
        if not 0 <= found < count:
            raise Refusal(f"there are registers 0 to {count - 1}, no {found}")
        return found

    banks: tuple[tuple[str, list[Any], list[Any], int, Callable[[Value], Any]], ...] = (
        ("integer", machine.input_ints, machine.output_ints, REGISTERS, integer),
        ("float", machine.input_doubles, machine.output_doubles, REGISTERS, number),
        ("boolean", machine.input_bits, machine.output_bits, BITS, truth),
    )
    for name, inputs, outputs, count, converted in banks:

        def read(address: Value, bank: list[Any] = inputs, count: int = count) -> Any:
            known = type(address) is int and 0 <= address < count  # nearly always; programs read a lot
            return bank[address if known else place(address, count)]

        def read_back(address: Value, bank: list[Any] = outputs, count: int = count) -> Any:
            return bank[place(address, count)]

        def write(
            address: Value,
            value: Value,
            bank: list[Any] = outputs,
            count: int = count,
            converted: Callable[[Value], Any] = converted,
        ) -> None:
            bank[place(address, count)] = converted(value)

        yield builtin(f"read_input_{name}_register(address)", read)
        yield builtin(f"read_output_{name}_register(address)", read_back)
        yield builtin(f"write_output_{name}_register(address, value)", write)


def _outputs(machine: Machine) -> Iterator[Builtin]:
    def bit(first: int, count: int) -> Callable[[Value], int]:
        def at(n: Value) -> int:
            found = integer(n, "n")
            if not 0 <= found < count:
                raise Refusal(f"there are outputs 0 to {count - 1}, no {found}")
            return first + found

        return at

    for name, place in (
        ("digital", bit(0, 18)),
        ("standard_digital", bit(0, 8)),
        ("configurable_digital", bit(8, 8)),
        ("tool_digital", bit(16, 2)),
    ):

        def write(n: Value, b: Value, place: Callable[[Value], int] = place) -> None:
            mask = 1 << place(n)
            machine.digital_outputs = machine.digital_outputs & ~mask | (mask if truth(b) else 0)

        def read(n: Value, place: Callable[[Value], int] = place) -> bool:
            return bool(machine.digital_outputs >> place(n) & 1)

        yield builtin(f"set_{name}_out(n, b)", write)
        yield builtin(f"get_{name}_out(n)", read)

    def analog(n: Value, f: Value) -> None:
        share = number(f, "f")
        if not 0.0 <= share <= 1.0:
            raise Refusal(f"f must be 0 to 1, not {share:g}")
        machine.analog_outputs[bit(0, 2)(n)] = share

    for name in ("analog", "standard_analog"):
        yield builtin(f"set_{name}_out(n, f)", analog)
        yield builtin(f"get_{name}_out(n)", lambda n: machine.analog_outputs[bit(0, 2)(n)])
        yield builtin(f"get_{name}_in(n)", lambda n: 0.0 * bit(0, 2)(n))


def _state(machine: Machine) -> Iterator[Builtin]:
    def pose() -> Pose:
        return Pose(metres(machine.state.pose))

    def joints() -> list[float]:
        return list(machine.state.joints)

    def flange() -> Pose:
        return Pose(metres(pose_numbers(flange_frame(machine.arm, machine.state.joints))))

    for name in ("get_actual_joint_positions", "get_target_joint_positions", "get_joint_positions"):
        yield builtin(f"{name}()", joints)
    for name in ("get_actual_joint_speeds", "get_target_joint_speeds", "get_joint_speeds"):
        yield builtin(f"{name}()", lambda: list(machine.state.joint_speeds))
    for name in ("get_actual_tcp_pose", "get_target_tcp_pose", "get_target_waypoint"):
        yield builtin(f"{name}()", pose)
    for name in ("get_actual_tcp_speed", "get_target_tcp_speed"):
        yield builtin(f"{name}()", lambda: list(metres(machine.state.tool_speed)))
    yield builtin("get_actual_tool_flange_pose()", flange)
    yield builtin("get_joint_torques()", lambda: [0.0] * 6)
    yield builtin(
        "is_steady()",
        lambda: not machine.freedrive and (machine.motion is None or machine.motion.resting),
    )
    yield builtin("get_tcp_offset()", lambda: Pose(metres(machine.tool_offset)))
    yield builtin("get_target_payload()", lambda: machine.payload)
    yield builtin("get_target_payload_cog()", lambda: list(machine.payload_cog))
    yield builtin("get_target_payload_inertia()", lambda: list(machine.payload_inertia))


def _kinematics(machine: Machine, moves: ScriptMoves) -> Iterator[Builtin]:
    def tool(tcp: Value) -> Numbers:
        return machine.tool_frame if tcp is None else frame_at(millimetres(numbers(tcp, 6, "tcp")))

    def forward(q: Value, tcp: Value) -> Pose:
        joints = machine.state.joints if q is None else numbers(q, 6, "q")
        return Pose(metres(pose_numbers(compose(flange_frame(machine.arm, joints), tool(tcp)))))

    def found(x: Value, qnear: Value, tcp: Value) -> tuple[float, ...] | None:
        near = machine.state.joints if qnear is None else tuple(numbers(qnear, 6, "qnear"))
        return moves.nearest(numbers(x, 6, "x"), near, tool(tcp))

    def inverse(x: Value, qnear: Value, tcp: Value) -> list[float]:
        joints = found(x, qnear, tcp)
        if joints is None:
            raise Refusal(f"no inverse kinematics at {written(x)}")
        return list(joints)

    def has_solution(x: Value, qnear: Value, tcp: Value) -> bool:
        return found(x, qnear, tcp) is not None

    def within(value: Value) -> bool:
        if type(value) is Pose:
            return found(value, None, None) is not None
        return bool((np.abs(numbers(value, 6, "joint angles")) <= machine.limit).all())

    parameters = "(x, qnear, *maxPositionError, *maxOrientationError, tcp)"
    defaults = {"qnear": None, "maxPositionError": 1e-10, "maxOrientationError": 1e-10, "tcp": None}
    yield builtin("get_forward_kin(q, tcp)", forward, {"q": None, "tcp": None})
    yield builtin(f"get_inverse_kin{parameters}", inverse, defaults)
    yield builtin(f"get_inverse_kin_has_solution{parameters}", has_solution, defaults)
    yield builtin("is_within_safety_limits(pose)", within)


def _settings(machine: Machine) -> Iterator[Builtin]:
    def set_tcp(pose: Value) -> None:
        if machine.motion is not None and not machine.motion.resting:
            raise Refusal("the tool cannot be changed while the arm moves")
        machine.set_tool(millimetres(tuple(numbers(pose, 6, "pose"))))

    def payload(m: Value, cog: Value, inertia: Value) -> None:
        mass = finite(m, "m")
        if mass < 0.0:
            raise Refusal(f"m must be 0 or above, not {mass:g}")
        machine.payload = mass
        if cog is not None:
            x, y, z = numbers(cog, 3, "cog")
            machine.payload_cog = (x, y, z)
        if inertia is not None:
            machine.payload_inertia = tuple(numbers(inertia, 6, "inertia"))

    def gravity(d: Value) -> None:
        x, y, z = numbers(d, 3, "d")
        machine.gravity = (x, y, z)

    def watchdog(variable: Value, frequency: Value, action: Value) -> None:
        start, _, register = str(variable).rpartition("_")
        if start != "input_int_register" or not register.isdigit() or int(register) >= REGISTERS:
            raise Refusal(f"only integer input registers are watched, not {written(variable)}")
        if action not in ("ignore", "pause", "stop"):
            raise Refusal(f"action must be 'ignore', 'pause' or 'stop', not {written(action)}")
        hertz = finite(frequency, "min_frequency")
        longest = 1.0 / hertz if hertz > 0.0 and action != "ignore" else 0.0
        machine.watch(int(register), longest, pauses=action == "pause")

    yield builtin("set_tcp(pose, *tcp_name)", set_tcp, {"tcp_name": ""})
    defaults = {"cog": None, "inertia": None, "transition_time": 0.0}
    for name in ("set_payload", "set_target_payload"):
        yield builtin(f"{name}(m, cog, inertia, *transition_time)", payload, defaults)
    yield builtin("set_gravity(d)", gravity)
    yield builtin("rtde_set_watchdog(variable_name, min_frequency, action)", watchdog, {"action": "pause"})
    yield builtin("protective_stop()", lambda: machine.protective_stop(SafetyMode.PROTECTIVE_STOP))
