"""The pump's register map (`configs/pumps/*.toml`): where a drive keeps what, in which form and in which units.

Flow in mm³/s becomes register words, and back, here and nowhere else. Whoever drives a pump reads this map, and so
does the simulated drive.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from planning import cell
from planning.configuration import Table, find_configuration, parse_table, read_toml

from .errors import PumpError
from .pump_words import Address, Register, StatusBit

Positive = Annotated[float, Field(gt=0)]
Word = Annotated[int, Field(ge=0, le=0xFFFF)]

LARGEST_READ = 125
"""Words in one request that Modbus allows; fewer in a write."""


class Registers(Table):
    """The values of a drive. All but the first two may be missing.

    Attributes:
        command: takes one of `Commands`.
        set_flow: set-point.
        measured_flow: what the drive measures; without it what it is told counts as what it does.
        heartbeat: written by the controller, counts up; the drive trips when it stands still.
        pressure: bar.
        current: of the motor, A.
        voltage: of the motor, V.
        torque: share of the rated torque, %.
        switches: inputs of the drive, bit by bit.
        volume: counts what was pumped, mm³.
    """

    command: Register
    set_flow: Register
    measured_flow: Register | None = None
    heartbeat: Register | None = None
    pressure: Register | None = None
    current: Register | None = None
    voltage: Register | None = None
    torque: Register | None = None
    switches: Register | None = None
    volume: Register | None = None

    @field_validator("command", "heartbeat", "switches")
    @classmethod
    def _is_one_word(cls, register: Register | None) -> Register | None:
        if register is not None and register.type != "uint16":
            raise ValueError("must be one word: type 'uint16'")
        return register

    @field_validator("command", "set_flow", "heartbeat")
    @classmethod
    def _is_written(cls, register: Register | None) -> Register | None:
        if register is not None and register.table != "holding":
            raise ValueError("is written, so it must be among the 'holding' registers")
        return register


class Commands(Table):
    """Words that `registers.command` takes.

    Attributes:
        stop: come to rest.
        forward: pump as `set_flow` says.
        reverse: pump backwards.
        emergency: stop without a ramp, and be off.
        reset: makes the drive ready after a trip or an emergency stop; without one, a stop does.
    """

    stop: Word = 0
    forward: Word = 1
    reverse: Word | None = None
    emergency: Word | None = None
    reset: Word | None = None

    @model_validator(mode="after")
    def _differ(self) -> Commands:
        words = [word for word in self.model_dump().values() if word is not None]
        if len(set(words)) != len(words):
            raise ValueError("two commands are the same word")
        return self


class States(Table):
    """Bits that tell the drive's state. All may be missing.

    Attributes:
        ready: it would run.
        running: it is told to run, and does.
        reversing: it runs backwards.
        tripped: it has stopped by itself.
        empty: its hopper is.
    """

    ready: StatusBit | None = None
    running: StatusBit | None = None
    reversing: StatusBit | None = None
    tripped: StatusBit | None = None
    empty: StatusBit | None = None


class PumpMap(Table):
    """A drive's register map.

    Attributes:
        name: for reports.
        device_id: Modbus device id, also called unit or slave.
        transport: "tcp" is Modbus TCP; "rtu over tcp" carries the frames of a serial line through a gateway.
        words_at_once: most registers that one request may read or write; where it is 1, they are written by function 6.
        keep_alive_s: longest time that the drive may hear nothing while it runs, s.
        flow_per_hz: calibrated flow at 1 Hz, mm³/s, for a drive that counts in Hz; `set_flow` and `measured_flow` are
            then in Hz, otherwise in mm³/s.
        registers, commands, states: what is where.
    """

    name: str
    device_id: Annotated[int, Field(ge=1, le=247)] = 1
    transport: Literal["tcp", "rtu over tcp"] = "tcp"
    words_at_once: Annotated[int, Field(ge=1, le=LARGEST_READ)] = LARGEST_READ
    keep_alive_s: Positive | None = None
    flow_per_hz: Positive | None = None
    registers: Registers
    commands: Commands = Commands()
    states: States = States()

    @model_validator(mode="after")
    def _apart(self) -> PumpMap:
        owners: dict[tuple[str, int], str] = {}
        for name, register in self.values.items():
            if register.count > self.words_at_once:
                raise ValueError(f"registers.{name} is longer than 'words_at_once' allows")
            for address in register.addresses:
                other = owners.setdefault((register.table, address), name)
                if other != name:
                    raise ValueError(f"{other} and {name} have the same address {address}")
        bits: dict[tuple[str, int, int], str] = {}
        for name, state in self.bits.items():
            owner = owners.get((state.table, state.address), "switches")
            if owner != "switches":
                raise ValueError(f"{owner} and {name} have the same address {state.address}")
            other = bits.setdefault((state.table, state.address, state.bit), name)
            if other != name:
                raise ValueError(f"{other} and {name} are the same bit {state.bit} of {state.address}")
        return self

    @property
    def values(self) -> dict[str, Register]:
        """The registers that there are, by name."""
        return {name: register for name, register in self.registers if register is not None}

    @property
    def bits(self) -> dict[str, StatusBit]:
        """The states that there are, by name."""
        return {name: state for name, state in self.states if state is not None}

    @property
    def addresses(self) -> frozenset[tuple[str, Address]]:
        """Every table and address of the map."""
        words = {(register.table, at) for register in self.values.values() for at in register.addresses}
        return frozenset(words | {(state.table, state.address) for state in self.bits.values()})

    @property
    def flow_max(self) -> float:
        """Largest flow that `set_flow` holds, mm³/s."""
        return self.registers.set_flow.largest * self.flow_factor

    @property
    def flow_factor(self) -> float:
        """mm³/s in one unit of `set_flow` and `measured_flow`."""
        return 1.0 if self.flow_per_hz is None else self.flow_per_hz

    def words(self, flow: float) -> list[int]:
        """A flow, mm³/s, as words of `set_flow`.

        Raises:
            PumpError: it does not fit into the register.
        """
        at = self.registers.set_flow
        if not math.isfinite(flow) or flow < 0.0 or not at.holds(flow / self.flow_factor):
            hz = "" if self.flow_per_hz is None else ", or 'flow_per_hz'"
            raise PumpError(
                f"pump '{self.name}': a flow of {flow:g} mm³/s does not fit into register {at.address}, "
                f"which holds 0 to {self.flow_max:g} mm³/s; lower the flow or raise its 'unit'{hz}"
            )
        return at.encode(flow / self.flow_factor)

    def told(self, flow: float) -> float:
        """What the drive is told when a flow is commanded, mm³/s: the flow in whole counts of `set_flow`.

        Raises:
            PumpError: it does not fit into the register.
        """
        return self.registers.set_flow.decode(self.words(flow)) * self.flow_factor

    def flow(self, value: float) -> float:
        """A value of `set_flow` or `measured_flow`, in its own unit, as a flow, mm³/s."""
        return value * self.flow_factor


def load_pump_map(name: str, beside: Path | None = None) -> PumpMap:
    """A register map by path or by the name of a shipped one.

    Raises:
        planning.ConfigurationError: no such file, or a mistake in it.
    """
    path = find_configuration("pumps", name, beside)
    return parse_table(PumpMap, read_toml(path), str(path))


def pump_map(settings: cell.Pump) -> PumpMap:
    """The register map of a cell's pump, with what the cell says otherwise.

    Raises:
        planning.ConfigurationError: no such map, or a mistake in it.
    """
    said = {"transport": settings.transport, "flow_per_hz": settings.flow_per_hz}
    registers = load_pump_map(settings.registers)
    return registers.model_copy(update={key: value for key, value in said.items() if value is not None})
