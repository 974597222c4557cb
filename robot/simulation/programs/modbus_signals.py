"""The Modbus signals that programs add, read and set. They belong to the controller, and outlive the program."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from robot.simulation.modbus_client import Device, Kind, ModbusClient, Signal
from robot.simulation.urscript import Refusal, builtin
from robot.simulation.urscript.strings import raw, text
from robot.simulation.urscript.values import Value, integer, kind, number, truth

if TYPE_CHECKING:
    from robot.simulation.machine import Machine
    from robot.simulation.urscript import Builtin

MOST = 200
"""Signals of a controller."""

MOST_REGISTERS, MOST_BITS = 123, 1968
"""What one request writes."""

HIGHEST_FREQUENCY = 125
LONGEST_NAME = 20
LONGEST_PATIENCE = 300.0
DEVICE_ERROR, CONNECTION_ERROR = 1, 2
"""Sources of errors that programs ask for."""


def modbus_functions(machine: Machine) -> Iterator[Builtin]:
    """The functions of one machine's programs."""
    signals = _Signals(machine)
    last = {"sequential_mode": False, "register_count": 1}
    add = "IP, slave_number, signal_address, signal_type, signal_name, sequential_mode, register_count"
    yield builtin(f"modbus_add_signal({add})", signals.add, last)
    add = "IP, slave_number, read_address, read_register_count, write_address, write_register_count, signal_name"
    yield builtin(f"modbus_add_rw_signal({add}, sequential_mode)", signals.add_exchange, last)
    yield builtin("modbus_delete_signal(signal_name)", signals.delete)
    inside = {"is_secondary_program": False}
    yield builtin("modbus_get_signal_status(signal_name, *is_secondary_program)", signals.status, inside)
    yield builtin(
        "modbus_set_output_signal(signal_name, digital_value, *is_secondary_program)", signals.put, inside
    )
    yield builtin(
        "modbus_set_output_register(signal_name, register_value, *is_secondary_program)",
        signals.put_registers,
        inside,
    )
    yield builtin("modbus_set_signal_update_frequency(signal_name, update_frequency)", signals.frequency)
    yield builtin("modbus_set_signal_watchdog(signal_name, new_timeout_in_sec)", signals.watchdog)
    yield builtin("modbus_get_error(signal_name, error_source)", signals.error, {"error_source": 0})
    yield builtin("modbus_get_time_since_signal_invalid(signal_name)", signals.silence)
    yield builtin("modbus_reset_connection(connection_id, is_blocking)", signals.reset, {"is_blocking": True})
    yield builtin("modbus_send_custom_command(IP, slave_number, function_code, data)", signals.command)


class _Signals:
    def __init__(self, machine: Machine) -> None:
        self._machine = machine

    @property
    def _client(self) -> ModbusClient:
        """The machine's, which is polled in each cycle from its first use on."""
        machine = self._machine
        if machine.modbus is None:
            client = machine.modbus = ModbusClient()
            machine.fieldbus.append(lambda: client.poll(machine.time))
        return machine.modbus

    # -- adding

    def add(
        self, ip: Value, unit: Value, address: Value, of: Value, name: Value, sequential: Value, count: Value
    ) -> None:
        which = integer(of, "signal_type")
        if which not in list(Kind):
            raise Refusal(f"signal_type is 0 to 3, not {which}")
        most = MOST_BITS if which in (Kind.DIGITAL_INPUT, Kind.DIGITAL_OUTPUT) else MOST_REGISTERS
        self._add(ip, unit, address, Kind(which), name, sequential, _within(count, 1, most, "register_count"))

    def add_exchange(
        self,
        ip: Value,
        unit: Value,
        address: Value,
        count: Value,
        there: Value,
        many: Value,
        name: Value,
        sequential: Value,
    ) -> None:
        read = _within(count, 1, MOST_REGISTERS, "read_register_count")
        signal = self._add(ip, unit, address, Kind.REGISTER_OUTPUT, name, sequential, read)
        there_at = _within(there, 0, 0xFFFF, "write_address")
        signal.written = (there_at, _within(many, 1, MOST_REGISTERS, "write_register_count"))

    def _add(
        self, ip: Value, unit: Value, address: Value, of: Kind, name: Value, sequential: Value, count: int
    ) -> Signal:
        device = self._device(ip)
        key = text(raw(name, "signal_name"))
        if not 0 < len(key) <= LONGEST_NAME:
            raise Refusal(f"signal_name has 1 to {LONGEST_NAME} characters")
        if key not in self._client.signals and len(self._client.signals) >= MOST:
            raise Refusal(f"there are {MOST} signals already")
        device.one_by_one |= truth(sequential)
        signal = Signal(
            device,
            _within(unit, 0, 255, "slave_number"),
            of,
            _within(address, 0, 0xFFFF, "signal_address"),
            count,
            self._machine.time,
        )
        self._client.signals[key] = signal
        return signal

    def _device(self, ip: Value) -> Device:
        address = text(raw(ip, "IP"))
        device = self._client.device(address)
        if device is None:
            raise Refusal(
                f"'{address}' is no address on this machine; it is IP or IP:PORT, IP beginning with 127"
            )
        return device

    def delete(self, name: Value) -> None:
        self._client.signals.pop(text(raw(name, "signal_name")), None)

    # -- values

    def status(self, name: Value) -> Any:
        signal = self._known(name)
        values: list[Any] = (
            [bool(value) for value in signal.values] if signal.is_digital else list(signal.values)
        )
        return values[0] if signal.count == 1 and signal.written is None else values

    def put(self, name: Value, value: Value) -> None:
        signal = self._known(name)
        if signal.kind is not Kind.DIGITAL_OUTPUT:
            raise Refusal(f"signal '{name}' is no digital output")
        self._put(signal, value, signal.count, lambda one: int(truth(one)))

    def put_registers(self, name: Value, value: Value) -> None:
        signal = self._known(name)
        if signal.kind is not Kind.REGISTER_OUTPUT:
            raise Refusal(f"signal '{name}' is no register output")
        count = signal.written[1] if signal.written is not None else signal.count
        self._put(signal, value, count, lambda one: _within(one, 0, 0xFFFF, "register_value"))

    def _put(self, signal: Signal, value: Value, count: int, converted: Callable[[Value], int]) -> None:
        given = value if isinstance(value, list) else [value]
        if len(given) != count:
            raise Refusal(f"the signal has {count} values, not {len(given)}")
        signal.orders, signal.due = [converted(one) for one in given], self._machine.time
        if signal.written is None:
            signal.values = list(signal.orders)

    # -- how it is kept

    def frequency(self, name: Value, hertz: Value) -> None:
        found = number(hertz, "update_frequency")
        if not -1.0 <= found <= HIGHEST_FREQUENCY:
            raise Refusal(f"update_frequency is 0 to {HIGHEST_FREQUENCY}, or -1 for once, not {found:g}")
        self._signal(name).period = 1.0 / found if found > 0.0 else math.inf

    def watchdog(self, name: Value, seconds: Value) -> None:
        found = number(seconds, "new_timeout_in_sec")
        if not 0.0 <= found <= LONGEST_PATIENCE:
            raise Refusal(f"new_timeout_in_sec is 0 to {LONGEST_PATIENCE:g}, not {found:g}")
        self._signal(name).patience = found

    def error(self, name: Value, source: Value) -> int:
        signal, asked = self._signal(name), integer(source, "error_source")
        of_connection = signal.error == 255
        if (asked == DEVICE_ERROR and of_connection) or (asked == CONNECTION_ERROR and not of_connection):
            return 0
        return signal.error

    def silence(self, name: Value) -> float:
        signal = self._signal(name)
        return self._machine.time - signal.answered if signal.error else 0.0

    def reset(self, connection: Value, blocking: Value) -> Iterator[None]:
        device = self._device(connection)
        device.lose()
        if truth(blocking):
            yield
            while any(one.error for one in self._client.signals.values() if one.device is device):
                yield

    def command(self, ip: Value, unit: Value, function: Value, data: Value) -> None:
        code = _within(function, 1, 127, "function_code")
        if not isinstance(data, list) or len(data) > 252:
            raise Refusal(f"data must be a list of at most 252 bytes, not {kind(data)}")
        sent = bytes([code, *[_within(one, 0, 255, "a byte") for one in data]])
        self._device(ip).order(_within(unit, 0, 255, "slave_number"), sent)

    def _signal(self, name: Value) -> Signal:
        found = self._client.signals.get(text(raw(name, "signal_name")))
        if found is None:
            raise Refusal(f"there is no Modbus signal '{name}'")
        return found

    def _known(self, name: Value) -> Signal:
        """A signal that is not lost.

        Raises:
            Refusal: it had no good answer for longer than its watchdog lets it.
        """
        found = self._signal(name)
        if found.error and self._machine.time - found.answered > found.patience:
            raise Refusal(f"Modbus signal '{name}' has had no answer for {found.patience:g} s")
        return found


def _within(value: Value, least: int, most: int, what: str) -> int:
    found = integer(value, what)
    if not least <= found <= most:
        raise Refusal(f"{what} is {least} to {most}, not {found}")
    return found
