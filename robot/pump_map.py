"""The pump's register map (`configs/pumps/*.toml`): where a drive keeps what, and in which units.

Flow in mm³/s becomes register counts, and back, here and nowhere else.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from planning.configuration import Table, find_configuration, parse_table, read_toml

from .errors import PumpError

Positive = Annotated[float, Field(gt=0)]
Address = Annotated[int, Field(ge=0, le=65535)]

STOP, RUN = 0, 1
READY_BIT, RUNNING_BIT, TRIPPED_BIT = 1 << 0, 1 << 1, 1 << 2
LARGEST_COUNT = 65535


class Registers(Table):
    """Addresses of the holding registers.

    Attributes:
        command: 0 stop, 1 run.
        set_flow, measured_flow: in flow units.
        heartbeat: written by the controller, counts up; the drive trips when it stands still.
        status: bits: 0 ready, 1 running, 2 tripped.
        pressure: in pressure units.
    """

    command: Address
    set_flow: Address
    measured_flow: Address
    heartbeat: Address
    status: Address
    pressure: Address

    @model_validator(mode="after")
    def _apart(self) -> Registers:
        addresses = list(self.model_dump().values())
        if len(set(addresses)) != len(addresses):
            raise ValueError("two registers have the same address")
        return self


class PumpMap(Table):
    """A drive's register map.

    Attributes:
        name: for reports.
        device_id: Modbus device id, also called unit or slave.
        flow_unit: mm³/s in one count.
        pressure_unit: bar in one count.
        registers: their addresses.
    """

    name: str
    device_id: Annotated[int, Field(ge=0, le=255)] = 1
    flow_unit: Positive
    pressure_unit: Positive
    registers: Registers

    def counts(self, flow: float) -> int:
        """A flow, mm³/s, in counts of `set_flow`.

        Raises:
            PumpError: it does not fit into the register.
        """
        if not math.isfinite(flow) or flow < 0.0 or round(flow / self.flow_unit) > LARGEST_COUNT:
            raise PumpError(
                f"pump '{self.name}': a flow of {flow:g} mm³/s does not fit into register {self.registers.set_flow}, "
                f"which holds 0 to {LARGEST_COUNT * self.flow_unit:g} mm³/s; lower the flow or raise 'flow_unit'"
            )
        return round(flow / self.flow_unit)

    def flow(self, counts: int) -> float:
        """Counts of `set_flow` or `measured_flow` as a flow, mm³/s."""
        return counts * self.flow_unit

    def pressure(self, counts: int) -> float:
        """Counts of `pressure` as a pressure, bar."""
        return counts * self.pressure_unit

    @property
    def register_count(self) -> int:
        """How many registers, from address 0, hold the whole map."""
        return 1 + int(max(self.registers.model_dump().values()))


def load_pump_map(name: str, beside: Path | None = None) -> PumpMap:
    """A register map by path or by the name of a shipped one.

    Raises:
        planning.ConfigurationError: no such file, or a mistake in it.
    """
    path = find_configuration("pumps", name, beside)
    return parse_table(PumpMap, read_toml(path), str(path))
