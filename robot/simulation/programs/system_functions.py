"""Functions about the controller itself: its clocks, temperatures, power, payload, inputs, flags and encoders."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from robot.simulation.urscript import Refusal, builtin
from robot.simulation.urscript.strings import raw, text
from robot.simulation.urscript.values import Struct, Value, integer, number, numbers, truth

if TYPE_CHECKING:
    from robot.simulation.machine import Machine
    from robot.simulation.urscript import Builtin

TEMPERATURE = 30.0
"""Of the control box, °C."""

FLAGS = 32
ENCODERS = 2
ENCODER_RANGES = ((-(1 << 31), 32), (0, 8), (0, 16), (0, 24), (0, 32))
"""Least tick count and bits of each kind of encoder."""

TOOL_VOLTAGES = (0, 12, 24)
SINCE_START, OF_THE_DAY = 0, 2
"""Clocks that a program asks for."""


def system_functions(machine: Machine) -> Iterator[Builtin]:
    """The functions of one machine."""
    yield builtin("time(mode)", lambda mode: _time(machine, mode), {"mode": SINCE_START})
    yield builtin("powerdown()", machine.power_off)
    yield builtin("get_controller_temp()", lambda: TEMPERATURE)
    yield builtin(
        "get_joint_temp(j)", lambda j: _rtde_value(machine, "joint_temperatures")[_place(j, 6, "j")]
    )
    yield builtin("get_tool_temp()", lambda: _rtde_value(machine, "tool_temperature"))
    yield builtin("get_tool_current()", lambda: 0.0)
    yield builtin(
        "get_tool_accelerometer_reading()", lambda: _rtde_value(machine, "actual_tool_accelerometer")
    )
    for name in ("actual", "target"):
        yield builtin(f"get_{name}_joint_accelerations()", lambda: _rtde_value(machine, "target_qdd"))
    yield builtin("get_gravity()", lambda: list(machine.gravity))
    yield builtin("get_rtde_value(key)", lambda key: _rtde_value(machine, key))
    yield from _payload(machine)
    yield from _inputs(machine)
    yield from _flags(machine)
    yield from _encoders(machine)


def _place(value: Value, count: int, what: str) -> int:
    found = integer(value, what)
    if not 0 <= found < count:
        raise Refusal(f"{what} is 0 to {count - 1}, not {found}")
    return found


def _time(machine: Machine, mode: Value) -> Struct:
    clock = integer(mode, "mode")
    if clock not in (SINCE_START, OF_THE_DAY):
        raise Refusal(f"mode is 0 or 2, not {clock}")
    nanoseconds = round(machine.time * 1e9) if clock == SINCE_START else time.time_ns()
    return Struct({"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9})


def _rtde_value(machine: Machine, key: Value) -> Any:
    name = text(raw(key, "key"))
    value = machine.rtde_value(name)
    if value is None:
        raise Refusal(f"RTDE has no output '{name}'")
    if isinstance(value, tuple):
        return [float(item) if isinstance(item, float) else int(item) for item in value]
    return value if isinstance(value, bool | float) else integer(float(value), name)


def _payload(machine: Machine) -> Iterator[Builtin]:
    def mass(m: Value) -> None:
        found = number(m, "m")
        if found < 0.0:
            raise Refusal(f"m must be 0 or above, not {found:g}")
        machine.payload = found
        machine.payload_inertia = (0.0,) * 6

    def centre(cog: Value) -> None:
        x, y, z = numbers(cog, 3, "cog")
        machine.payload_cog = (x, y, z)

    yield builtin("set_payload_mass(m)", mass)
    yield builtin("set_payload_cog(cog)", centre)


def _inputs(machine: Machine) -> Iterator[Builtin]:
    for name, first, count in (
        ("digital", 0, 18),
        ("standard_digital", 0, 8),
        ("configurable_digital", 8, 8),
        ("tool_digital", 16, 2),
    ):

        def read(n: Value, first: int = first, count: int = count) -> bool:
            return bool(machine.digital_inputs >> first + _place(n, count, "n") & 1)

        yield builtin(f"get_{name}_in(n)", read)
        if name != "digital":
            yield builtin(f"set_{name}_input_action(port, action)", _action(count))
    yield builtin("set_gp_boolean_input_action(port, action)", _action(128))
    yield builtin("set_input_actions_to_default()", lambda: None)
    yield builtin("get_tool_analog_in(n)", lambda n: 0.0 * _place(n, 2, "n"))
    for name, count in (
        ("set_analog_inputrange(port, range)", 4),
        ("set_standard_analog_input_domain(port, domain)", 2),
        ("set_tool_analog_input_domain(port, domain)", 2),
    ):

        def domain(port: Value, of: Value, count: int = count) -> None:
            _place(port, count, "port")  # nothing is wired to them
            _place(of, 5, "the range")

        yield builtin(name, domain)

    def output_domain(port: Value, of: Value) -> None:
        mask, is_voltage = 1 << _place(port, 2, "port"), _place(of, 2, "domain")
        types = machine.analog_output_types
        machine.analog_output_types = types | mask if is_voltage else types & ~mask

    yield builtin("set_analog_outputdomain(port, domain)", output_domain)

    def voltage(volts: Value) -> None:
        if number(volts, "voltage") not in TOOL_VOLTAGES:
            raise Refusal(f"voltage is 0, 12 or 24, not {number(volts, 'voltage'):g}")
        machine.tool_voltage = integer(volts, "voltage")

    yield builtin("set_tool_voltage(voltage)", voltage)


def _action(count: int) -> Callable[[Value, Value], None]:
    def act(port: Value, action: Value) -> None:
        _place(port, count, "port")
        if text(raw(action, "action")) != "default":
            raise Refusal('no hand leads the simulated arm: the action of an input can only be "default"')

    return act


def _flags(machine: Machine) -> Iterator[Builtin]:
    def write(n: Value, b: Value) -> None:
        machine.flags[_place(n, FLAGS, "n")] = truth(b)

    yield builtin("set_flag(n, b)", write)
    yield builtin("get_flag(n)", lambda n: machine.flags[_place(n, FLAGS, "n")])


def _encoders(machine: Machine) -> Iterator[Builtin]:
    """Encoders that programs tell their counts; none is wired."""

    def begin(encoder: Value, of: Value) -> None:
        place = _place(encoder, ENCODERS, "encoder_index")
        machine.encoders[place] = (_place(of, len(ENCODER_RANGES), "range_id"), 0)

    def known(encoder: Value) -> tuple[int, int, int]:
        place = _place(encoder, ENCODERS, "encoder_index")
        found = machine.encoders[place]
        if found is None:
            raise Refusal(f"encoder {place} is not set up")
        return (place, *found)

    def put(encoder: Value, count: Value) -> None:
        place, of, _ = known(encoder)
        least, bits = ENCODER_RANGES[of]
        found = number(count, "count")
        if not least <= found < least + (1 << bits):
            raise Refusal(f"count is {least} to {least + (1 << bits) - 1}, not {found:g}")
        machine.encoders[place] = (of, int(found))

    def unwound(encoder: Value, delta: Value) -> float:
        """A difference of counts, the shorter way round."""
        span = 1 << ENCODER_RANGES[known(encoder)[1]][1]
        return (number(delta, "delta_tick_count") + span / 2) % span - span / 2

    yield builtin("encoder_enable_set_tick_count(encoder_index, range_id)", begin)
    yield builtin("encoder_set_tick_count(encoder_index, count)", put)
    yield builtin("encoder_get_tick_count(encoder_index)", lambda encoder: float(known(encoder)[2]))
    yield builtin("encoder_unwind_delta_tick_count(encoder_index, delta_tick_count)", unwound)
