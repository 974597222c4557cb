"""Faults that a file asks for: at a time, place or waypoint, at a value of a register, or by chance with a seed."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import BeforeValidator, Field, model_validator

from planning import ConfigurationError
from planning.configuration import Table, parse_table, read_toml

from .faults import VALUES, Fault, checked, lifting, named

REGISTERS = {"int": 48, "double": 48, "bit": 128}
"""How many there are of each kind."""
Known = Annotated[Fault, BeforeValidator(named)]
Checked = TypeVar("Checked", "ScriptedFault", "RandomFaults")
Positive = Annotated[float, Field(gt=0.0)]
Interval = Annotated[float, Field(ge=0.002)]  # s; no faults come more often than cycles


class Near(Table):
    """The tool comes near a place.

    Attributes:
        position: in the robot's base frame, mm.
        radius: how near, mm.
    """

    position: tuple[float, float, float]
    radius: Positive


class RegisterValue(Table):
    """A register of the RTDE takes a value.

    Attributes:
        name: `output_int_register_2`, `input_double_register_24`, `output_bit_register_64` and so on.
        value: exactly; 0 or 1 of a bit.
    """

    name: str
    value: float

    @model_validator(mode="after")
    def _exists(self) -> Self:
        found = re.fullmatch(r"(?:input|output)_(int|double|bit)_register_(\d{1,3})", self.name)
        if found is None or int(found[2]) >= REGISTERS[found[1]]:
            raise ValueError(f"there is no register '{self.name}'")
        return self


class FaultValues(Table):
    """The numbers that faults take; see `faults.VALUES`."""

    fraction: float | None = None
    number: int | None = None
    seconds: float | None = None
    code: int | None = None
    level: float | None = None
    share: float | None = None
    bits: int | None = None

    def of(self, fault: Fault) -> dict[str, Any]:
        """The values for a fault.

        Raises:
            ValueError: one is missing or wrong.
        """
        taken = VALUES.get(fault)
        if taken is None:
            return {}
        given = getattr(self, taken.name)
        return _taken(fault, {} if given is None else {taken.name: given})


def _taken(fault: Fault, given: dict[str, Any]) -> dict[str, Any]:
    try:
        return checked(fault, given)
    except ValueError as error:
        raise ValueError(f"'{fault}' {error}") from None


class ScriptedFault(FaultValues):
    """One fault, and when it comes. Times are process time, s.

    Attributes:
        fault: which.
        at: the time.
        waypoint: when the tool has passed so many waypoints of asynchronous moves since the controller's start.
        when_near: when the tool comes near a place.
        when_register: when a register takes a value.
        every: it comes again after so long; with `at`.
        times: it comes so often; without, once, and without end with `every`.
        lasts: it is taken back after so long.
    """

    fault: Known
    at: Annotated[float, Field(ge=0.0)] | None = None
    waypoint: Annotated[int, Field(ge=1)] | None = None
    when_near: Near | None = None
    when_register: RegisterValue | None = None
    every: Interval | None = None
    times: Annotated[int, Field(ge=1)] | None = None
    lasts: Positive | None = None

    def check(self) -> None:
        """Make sure that it makes sense as a whole.

        Raises:
            ValueError: it does not.
        """
        triggers = ("at", "waypoint", "when_near", "when_register")
        given = [name for name in triggers if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"needs one of {', '.join(triggers)}; has {' and '.join(given) or 'none'}")
        if self.every is not None and self.at is None:
            raise ValueError("`every` goes with `at`")
        if self.times is not None and self.every is None and given[0] in {"at", "waypoint"}:
            raise ValueError("`times` goes with `every`, `when_near` or `when_register`")
        values = _taken(self.fault, self.model_dump(include=set(FaultValues.model_fields), exclude_none=True))
        if self.lasts is not None and lifting(self.fault, values) is None:
            raise ValueError(f"nothing takes '{self.fault}' back; leave `lasts` out")

    @property
    def values(self) -> dict[str, Any]:
        """What the fault takes."""
        return self.of(self.fault)


class RandomFaults(FaultValues):
    """Faults that come by chance, the same for the same seed. Times are process time, s.

    Attributes:
        seed: of the chance.
        mean_interval_s: from one to the next.
        faults: one of them, all alike.
        lasts: how long one lasts that can be taken back.
    """

    seed: int = 0
    mean_interval_s: Interval
    faults: Annotated[tuple[Known, ...], Field(min_length=1)]
    lasts: Positive = 1.0

    def check(self) -> None:
        """Make sure that each fault is given what it takes.

        Raises:
            ValueError: one is not.
        """
        for fault in self.faults:
            self.of(fault)


class FaultScript(Table):
    """All faults of a file."""

    faults: tuple[ScriptedFault, ...] = ()
    random: RandomFaults | None = None


CHANCES = RandomFaults(
    mean_interval_s=60.0,
    faults=(
        Fault.PROTECTIVE_STOP,
        Fault.SAFEGUARD_STOP,
        Fault.PROGRAM_STOP,
        Fault.SPEED_SLIDER,
        Fault.RTDE_MUTE,
        Fault.RTDE_LATE,
        Fault.RTDE_DROP,
        Fault.RTDE_HALF,
        Fault.DASHBOARD_REFUSE,
        Fault.PUMP_MUTE,
        Fault.PUMP_RESET,
        Fault.PUMP_EXCEPTION,
        Fault.PUMP_FROZEN,
        Fault.PUMP_TRIP,
        Fault.PUMP_SLOW,
    ),
    fraction=0.0,
    seconds=0.5,
    code=4,
)
"""What comes by chance when only a seed is given."""


class _File(Table):
    fault: tuple[dict[str, Any], ...] = ()
    random: dict[str, Any] | None = None


def load_fault_script(path: str | Path) -> FaultScript:
    """Read a file of faults: a list `[[fault]]` and a table `[random]`, either of which may be left out.

    Raises:
        ConfigurationError: it cannot be read or is wrong; the sentence names file, entry and key.
    """
    path = Path(path)
    file = parse_table(_File, read_toml(path), str(path))
    if not file.fault and file.random is None:
        raise ConfigurationError(f"{path}: no faults; give a list [[fault]], a table [random] or both")
    faults = tuple(
        _checked(ScriptedFault, entry, f"{path}: fault {i + 1}") for i, entry in enumerate(file.fault)
    )
    chances = None if file.random is None else _checked(RandomFaults, file.random, f"{path}: random")
    return FaultScript(faults=faults, random=chances)


def _checked(model: type[Checked], values: dict[str, Any], where: str) -> Checked:
    found = parse_table(model, values, where)
    try:
        found.check()
    except ValueError as error:
        raise ConfigurationError(f"{where}: {error}") from None
    return found


def with_seed(script: FaultScript | None, seed: int) -> FaultScript:
    """The script with another seed; without a script, `CHANCES` with it."""
    script = script or FaultScript()
    return script.model_copy(update={"random": (script.random or CHANCES).model_copy(update={"seed": seed})})
