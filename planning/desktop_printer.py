"""The desktop printer of scaled models: bed, nozzle, filament and dialect of G-code (`configs/printers/*.toml`)."""

from __future__ import annotations

import math
import string
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator, model_validator

from .configuration import Table, find_configuration, parse_table, read_toml

Array = npt.NDArray[np.float64]
Vector2 = tuple[float, float]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]

PLACEHOLDERS = ("nozzle_c", "bed_c", "bed_x", "bed_y", "park_z")
"""What `start` and `end` may name in braces."""


class PrinterBed(Table):
    """The bed and the room above it.

    Attributes:
        size: x, y, mm.
        height: of the room, mm.
        origin: where x = y = 0 is.
        margin: kept free along the edges, for clips and for what `start` primes there, mm.
        safe_z: above clips and what `start` has primed: the first travel crosses there, mm.
    """

    size: tuple[Positive, Positive]
    height: Positive
    origin: Literal["corner", "centre"] = "corner"
    margin: NotNegative = 10.0
    safe_z: Positive = 5.0

    @property
    def centre(self) -> Array:
        """Middle of the bed, shape (2,), mm."""
        return np.array(self.size) / 2.0 if self.origin == "corner" else np.zeros(2)

    @property
    def room(self) -> Array:
        """What the margins leave, x, y and z, shape (3,), mm."""
        return np.array([self.size[0] - 2.0 * self.margin, self.size[1] - 2.0 * self.margin, self.height])

    @model_validator(mode="after")
    def _leaves_room(self) -> PrinterBed:
        if 2.0 * self.margin >= min(self.size):
            raise ValueError(f"a margin of {self.margin:g} mm leaves nothing of the bed")
        if self.safe_z > self.height:
            raise ValueError(f"safe_z = {self.safe_z:g} is above height = {self.height:g}")
        return self


class PrinterNozzle(Table):
    """The nozzle, which always stands upright.

    Attributes:
        diameter: of its bore, mm.
        width_min, width_max: bead widths that it lays, in bores.
        height_min, height_max: thinnest bead that still comes out, and thickest that it presses down, in bores; no
            bead may be higher than wide.
        max_tilt_deg: steepest layer that it prints without touching it with its cone, degrees from the bed.
        length: from the tip up to the hot end, mm.
        hot_end: side of a square around the nozzle that the hot end and its fan duct keep within, mm.
    """

    diameter: Positive
    width_min: Positive = 0.8
    width_max: Positive = 2.0
    height_min: Positive = 0.1
    height_max: Positive = 1.0
    max_tilt_deg: Annotated[float, Field(ge=0, lt=90)]
    length: Positive
    hot_end: Positive

    @property
    def widths(self) -> Vector2:
        """Narrowest and widest bead, mm."""
        return self.width_min * self.diameter, self.width_max * self.diameter

    @property
    def heights(self) -> Vector2:
        """Thinnest and thickest bead, mm."""
        return self.height_min * self.diameter, self.height_max * self.diameter

    @model_validator(mode="after")
    def _ordered(self) -> PrinterNozzle:
        if self.width_min > self.width_max:
            raise ValueError(f"width_min = {self.width_min:g} is above width_max = {self.width_max:g}")
        if self.height_min > self.height_max:
            raise ValueError(f"height_min = {self.height_min:g} is above height_max = {self.height_max:g}")
        return self


class Filament(Table):
    """What is printed.

    Attributes:
        diameter: mm.
        nozzle_c, bed_c: temperatures, °C.
        flow_max: that the hot end melts, mm³/s; beads are slowed down to it.
        fan: after the first layer, 0 to 1.
        layer_time_min: a layer takes at least so long to cool, s, unless that were slower than `speed_min`.
    """

    diameter: Positive = 1.75
    nozzle_c: Positive
    bed_c: NotNegative
    flow_max: Positive
    fan: Share = 1.0
    layer_time_min: NotNegative = 0.0


class PrinterMotion(Table):
    """Speeds, mm/s, and travels.

    Attributes:
        speed: while printing.
        speed_first: the same in the first layer.
        speed_min: no bead is slowed down further to let its layer cool.
        travel_speed: between beads.
        lift_speed: of the z axis.
        hop: height of travels above everything printed so far, mm.
        direct: a bead that starts nearer than this to where the last one ended is begun without lifting off, mm.
    """

    speed: Positive
    speed_first: Positive
    speed_min: Positive = 3.0
    travel_speed: Positive = 120.0
    lift_speed: Positive = 5.0
    hop: NotNegative = 1.0
    direct: NotNegative = 0.0


class Retraction(Table):
    """How oozing is stopped before a travel.

    Attributes:
        by: "moves" of the extruder, or "firmware": G10 and G11, with the lengths set there.
        length: of filament, mm.
        speed: of filament, mm/s.
    """

    by: Literal["moves", "firmware"] = "moves"
    length: NotNegative = 2.0
    speed: Positive = 30.0


class Flavour(Table):
    """The printer's dialect of G-code.

    Attributes:
        firmware: decides what the other keys may be.
        extrusion: E "absolute" (M82) or "relative" (M83).
        e_unit: E in mm of "filament" or in mm³ of "volume" (M200).
        comments: whether layers and curves are named in the file.
        start, end: lines before and after the model, which may name `PLACEHOLDERS` in braces and, doubled, braces of
            their own. After `start` the nozzle is hot and primed, by lines or by a macro of the firmware; before `end`
            the filament is drawn back and the nozzle lifted off.
    """

    firmware: Literal["marlin", "klipper", "reprapfirmware"]
    extrusion: Literal["absolute", "relative"]
    e_unit: Literal["filament", "volume"] = "filament"
    comments: bool = True
    start: str
    end: str

    @field_validator("start", "end")
    @classmethod
    def _fills(cls, text: str) -> str:
        try:
            names = [name for _, name, _, _ in string.Formatter().parse(text) if name is not None]
        except ValueError as error:
            raise ValueError(f"{error}; write a brace of your own twice") from None
        if unknown := [name for name in names if name not in PLACEHOLDERS]:
            raise ValueError(
                f"{{{unknown[0]}}} is no placeholder ({', '.join(PLACEHOLDERS)}); write a brace of your own twice"
            )
        try:
            text.format(**dict.fromkeys(PLACEHOLDERS, 1.0))
        except (ValueError, KeyError, IndexError, AttributeError) as error:
            raise ValueError(f"cannot be filled in: {error}") from None
        if not text.isascii():
            raise ValueError("must be plain ASCII; firmware reads nothing else")
        return text

    @model_validator(mode="after")
    def _is_known_to_the_firmware(self) -> Flavour:
        if self.firmware == "klipper" and self.e_unit == "volume":
            raise ValueError('Klipper has no M200; set e_unit = "filament"')
        return self


class DesktopPrinter(Table):
    """A printer with three axes.

    Attributes:
        name: for reports.
    """

    name: str
    bed: PrinterBed
    nozzle: PrinterNozzle
    filament: Filament
    motion: PrinterMotion
    retraction: Retraction = Retraction()
    gcode: Flavour

    @property
    def e_per_mm3(self) -> float:
        """E for a volume of 1 mm³."""
        return 1.0 if self.gcode.e_unit == "volume" else 1.0 / self.filament_area

    @property
    def filament_area(self) -> float:
        """Section of the filament, mm²."""
        return 0.25 * math.pi * self.filament.diameter**2


def load_printer(name: str, beside: Path | None = None) -> DesktopPrinter:
    """A desktop printer by path or by the name of a shipped one.

    Raises:
        ConfigurationError: no such file, or a mistake in it.
    """
    path = find_configuration("printers", name, beside)
    return parse_table(DesktopPrinter, read_toml(path), str(path))
