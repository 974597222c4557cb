"""RTDE, the real-time data exchange of UR controllers: packages, types and variables.

A package is a big-endian header, `uint16 size` (its own three bytes included) and `uint8 type`, and a payload. A
*recipe* is a list of variables that both sides agree on first; packages of type U then carry their values alone.
Both sides of the protocol are here: `robot.simulation` answers with it, the guard listens with it. Values are as
on the wire, in metres.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from enum import IntEnum
from types import MappingProxyType
from typing import TypeAlias

from .errors import RobotError

PORT = 30004
PROTOCOL = 2
NOT_FOUND = "NOT_FOUND"
IN_USE = "IN_USE"

Value: TypeAlias = float | int | bool | tuple[float, ...]

_HEADER = struct.Struct(">HB")


class Package(IntEnum):
    """What a package is: the letter that stands in its header."""

    PROTOCOL = ord("V")
    CONTROLLER_VERSION = ord("v")
    OUTPUTS = ord("O")
    INPUTS = ord("I")
    START = ord("S")
    PAUSE = ord("P")
    VALUES = ord("U")
    MESSAGE = ord("M")


_CODES: Mapping[str, str] = MappingProxyType(
    {
        "BOOL": "?",
        "UINT8": "B",
        "UINT32": "I",
        "UINT64": "Q",
        "INT32": "i",
        "DOUBLE": "d",
        "VECTOR3D": "3d",
        "VECTOR6D": "6d",
        "VECTOR6INT32": "6i",
        "VECTOR6UINT32": "6I",
    }
)


def package(kind: int, payload: bytes = b"") -> bytes:
    """A package with its header."""
    return _HEADER.pack(_HEADER.size + len(payload), kind) + payload


class PackageStream:
    """Cuts a stream of bytes into packages."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, received: bytes) -> list[tuple[int, bytes]]:
        """The packages, as (kind, payload), that `received` completes.

        Raises:
            RobotError: the stream is not RTDE.
        """
        pending = self._rest + received if self._rest else received
        found = []
        start = 0
        while len(pending) - start >= _HEADER.size:
            size, kind = _HEADER.unpack_from(pending, start)
            if size < _HEADER.size:
                raise RobotError(
                    f"RTDE: a package says that it is {size} bytes long; is this another protocol?"
                )
            if len(pending) - start < size:
                break
            found.append((kind, pending[start + _HEADER.size : start + size]))
            start += size
        self._rest = pending[start:]
        return found


class Recipe:
    """An agreed list of variables.

    Attributes:
        names, types: of the variables, in their order on the wire.
        size: bytes that their values take.
    """

    def __init__(self, names: Sequence[str], types: Sequence[str]) -> None:
        """Prepare to pack and unpack.

        Raises:
            RobotError: a type is unknown, or there is not one type for each name.
        """
        unknown = [f"{name}: {kind}" for name, kind in zip(names, types, strict=False) if kind not in _CODES]
        if unknown or len(names) != len(types):
            raise RobotError(f"RTDE: recipe refused: {', '.join(unknown) or 'wrong number of types'}")
        self.names = tuple(names)
        self.types = tuple(types)
        self._struct = struct.Struct(">" + "".join(_CODES[kind] for kind in types))
        self.size = self._struct.size
        self._fields: list[tuple[str, int, int]] = []  # name, first item, number of items, or 0 for a scalar
        at = 0
        for name, kind in zip(names, types, strict=True):
            count = int(_CODES[kind][0]) if len(_CODES[kind]) > 1 else 0
            self._fields.append((name, at, count))
            at += count or 1

    def pack(self, values: Sequence[Value]) -> bytes:
        """The values of all variables, in their order, as a payload without the recipe's number."""
        flat: list[float] = []
        for value, (_, _, count) in zip(values, self._fields, strict=True):
            if count:
                flat.extend(value)  # type: ignore[arg-type]
            else:
                flat.append(value)  # type: ignore[arg-type]
        return self._struct.pack(*flat)

    def unpack(self, payload: bytes) -> dict[str, Value]:
        """Values by name from a payload without the recipe's number.

        Raises:
            RobotError: the payload has another length.
        """
        if len(payload) != self.size:
            raise RobotError(f"RTDE: {len(payload)} bytes of values for a recipe of {self.size}")
        flat = self._struct.unpack(payload)
        return {name: flat[at : at + n] if n else flat[at] for name, at, n in self._fields}


def ask_protocol() -> bytes:
    """Request for protocol version 2; the answer's payload is one byte, 1 if accepted."""
    return package(Package.PROTOCOL, struct.pack(">H", PROTOCOL))


def ask_controller_version() -> bytes:
    """Request for the controller's version; the answer is read with `read_controller_version`."""
    return package(Package.CONTROLLER_VERSION)


def read_controller_version(payload: bytes) -> tuple[int, ...]:
    """Major, minor, bugfix and build of the controller's software."""
    return struct.unpack(">4I", payload)


def ask_outputs(names: Sequence[str], frequency: float) -> bytes:
    """Request to be sent variables at a frequency in Hz; the answer is read with `read_types`."""
    return package(Package.OUTPUTS, struct.pack(">d", frequency) + ",".join(names).encode("ascii"))


def ask_inputs(names: Sequence[str]) -> bytes:
    """Request to own and write variables; the answer is read with `read_types`."""
    return package(Package.INPUTS, ",".join(names).encode("ascii"))


def ask_start() -> bytes:
    """Request to begin sending; the answer's payload is one byte, 1 if accepted."""
    return package(Package.START)


def ask_pause() -> bytes:
    """Request to stop sending; the answer's payload is one byte, 1 if accepted."""
    return package(Package.PAUSE)


def read_types(payload: bytes) -> tuple[int, tuple[str, ...]]:
    """The recipe's number and its types, from the answer to `ask_outputs` or `ask_inputs`."""
    return payload[0], tuple(payload[1:].decode("ascii").split(","))


def values_package(recipe_number: int, payload: bytes) -> bytes:
    """A package of values."""
    return package(Package.VALUES, bytes((recipe_number,)) + payload)


def _table(**names_by_type: str) -> dict[str, str]:
    return {name: kind for kind, names in names_by_type.items() for name in names.split()}


_INPUTS = _table(
    UINT8="""standard_digital_output_mask standard_digital_output configurable_digital_output_mask
        configurable_digital_output tool_digital_output_mask tool_digital_output standard_analog_output_mask
        standard_analog_output_type""",
    UINT32="speed_slider_mask input_bit_registers0_to_31 input_bit_registers32_to_63",
    DOUBLE="speed_slider_fraction standard_analog_output_0 standard_analog_output_1",
    VECTOR6D="external_force_torque",
)
_INPUTS |= {f"input_int_register_{i}": "INT32" for i in range(48)}
_INPUTS |= {f"input_double_register_{i}": "DOUBLE" for i in range(48)}
_INPUTS |= {f"input_bit_register_{i}": "BOOL" for i in range(64, 128)}

_OUTPUTS = _table(
    UINT8="tool_output_mode tool_digital_output0_mode tool_digital_output1_mode",
    INT32="robot_mode safety_mode safety_status tool_output_voltage encoder0_raw encoder1_raw time_scale_source",
    UINT32="""runtime_state robot_status_bits safety_status_bits analog_io_types tool_mode tool_analog_input_types
        output_bit_registers0_to_31 output_bit_registers32_to_63 euromap67_input_bits euromap67_output_bits
        script_control_line""",
    UINT64="""actual_digital_input_bits actual_digital_output_bits actual_configurable_digital_input_bits
        actual_configurable_digital_output_bits control_step""",
    DOUBLE="""timestamp actual_execution_time target_execution_time speed_scaling target_speed_fraction actual_momentum
        actual_main_voltage actual_robot_voltage actual_robot_current standard_analog_input0 standard_analog_input1
        standard_analog_output0 standard_analog_output1 payload tcp_force_scalar tool_analog_input0
        tool_analog_input1 tool_output_current tool_temperature io_current euromap67_24V_voltage
        euromap67_24V_current actual_robot_energy_consumed actual_robot_braking_energy_dissipated
        joint_position_deviation_ratio collision_detection_ratio""",
    VECTOR3D="actual_tool_accelerometer elbow_position elbow_velocity payload_cog target_gravity",
    VECTOR6D="""target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_current
        actual_current_as_torque actual_current_window joint_control_output actual_TCP_pose actual_TCP_speed
        actual_TCP_acceleration actual_TCP_force target_TCP_pose target_TCP_speed target_TCP_acceleration
        joint_temperatures actual_joint_voltage ft_raw_wrench payload_inertia tcp_offset wrench_calc_from_currents
        target_base_acceleration target_base_wrench""",
    VECTOR6INT32="joint_mode",
)
_OUTPUTS |= {f"output_int_register_{i}": "INT32" for i in range(48)}
_OUTPUTS |= {f"output_double_register_{i}": "DOUBLE" for i in range(48)}
_OUTPUTS |= {f"output_bit_register_{i}": "BOOL" for i in range(64, 128)}

INPUTS: Mapping[str, str] = MappingProxyType(_INPUTS)
"""Type of each variable that a client may write, as of PolyScope 5.23."""

OUTPUTS: Mapping[str, str] = MappingProxyType(
    _OUTPUTS | {name: kind for name, kind in _INPUTS.items() if name.startswith("input_")}
)
"""Type of each variable that a client may be sent, as of PolyScope 5.23; input registers can be read back."""
