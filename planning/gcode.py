"""G-code: a scaled model as text for a desktop printer.

Three axes and the extruder, in millimetres and absolute positions; the extruder's dialect is the printer's. Beads
follow one another as the planner orders them. Before a travel the filament is drawn back, and the nozzle crosses above
everything printed so far, because the points of a tilted layer differ in height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np
import numpy.typing as npt

from twins import Toolpath

from .desktop_printer import DesktopPrinter
from .model_bead import ModelBead
from .model_scales import ratio
from .scaled import ScaledModel, scaled_model

Array = npt.NDArray[np.float64]

_DIGITS = 4
"""Of coordinates; a printer's steps are coarser."""
_E_DIGITS = 5
_SHORTEST = 1e-9
_PARK = 20.0
"""How far above the model the nozzle parks, mm."""


@dataclass(frozen=True)
class GcodeText:
    """A print as text.

    Attributes:
        text: of the file, lines ended by a line feed.
        duration: of the moves at their speeds, without heating and acceleration, s.
    """

    text: str
    duration: float


def gcode(toolpath: Toolpath, printer: DesktopPrinter, scale: float, width: float) -> str:
    """A toolpath's scaled model as G-code.

    Each move extrudes width · local height · length, all scaled: together the part's bead volume times scale³.

    Args:
        toolpath: of the part, mm.
        printer: what it is printed with.
        scale: length of the model over length of the part, such as 1 / 12.5.
        width: bead width of the part where a curve has none of its own, mm.

    Raises:
        PlanningError: as `scaled_model`.
    """
    return model_gcode(scaled_model(toolpath, printer, scale, width), printer).text


def model_gcode(model: ScaledModel, printer: DesktopPrinter) -> GcodeText:
    """A scaled model, placed on the printer's bed, as G-code."""
    writer = _Writer(printer)
    top = 0.0
    beads = zip(model.beads, _speeds(model, printer), strict=True)
    for k, (layer, of_layer) in enumerate(groupby(beads, lambda pair: pair[0].layer)):
        writer.comment(f"LAYER:{layer}")
        if k == 1 and printer.filament.fan > 0:
            writer.lines.append(f"M106 S{round(255 * printer.filament.fan)}")
        writer.zero_extruder()
        for bead, speed in of_layer:
            writer.comment(f" curve {bead.curve}")
            writer.go_to(bead.points[0], top)
            writer.lay(bead, speed)
            top = max(top, float(bead.points[:, 2].max()))
    writer.retract(back=False)
    writer.move(None, top + printer.motion.hop, printer.motion.lift_speed)
    text = [*_head(model, printer, writer.duration), *writer.lines, *_tail(printer, top)]
    return GcodeText("\n".join(text) + "\n", writer.duration)


def _speeds(model: ScaledModel, printer: DesktopPrinter) -> list[Array]:
    """Speed of each move of each bead, mm/s: limited by flow and z axis, slower in layers that need time to cool."""
    motion, filament = printer.motion, printer.filament
    first = model.beads[0].layer
    speeds, time = [], dict.fromkeys((bead.layer for bead in model.beads), 0.0)
    for bead in model.beads:
        rise = np.maximum(np.abs(np.diff(bead.points[:, 2])), 1e-12)
        speed = np.minimum(filament.flow_max / bead.sections, motion.lift_speed * bead.lengths / rise)
        speed = np.minimum(speed, motion.speed_first if bead.layer == first else motion.speed)
        speed = np.maximum(speed, 1e-3)
        speeds.append(speed)
        time[bead.layer] += float((bead.lengths / speed).sum())
    return [
        np.minimum(
            speed,
            np.maximum(speed * (time[bead.layer] / max(filament.layer_time_min, 1e-9)), motion.speed_min),
        )
        for bead, speed in zip(model.beads, speeds, strict=True)
    ]


@dataclass
class _Writer:
    """Lines as they are written, with the state that the printer has after them."""

    printer: DesktopPrinter
    lines: list[str] = field(default_factory=list)
    place: Array = field(default_factory=lambda: np.full(3, np.nan))
    feed: int = 0
    duration: float = 0.0
    # E since the start: exact, as written, and where it was last set to 0. Rounding so never adds up.
    e: float = 0.0
    e_written: float = 0.0
    e_zero: float = 0.0

    def comment(self, text: str) -> None:
        if self.printer.gcode.comments:
            self.lines.append(f";{text}")

    def zero_extruder(self) -> None:
        """Absolute E is counted anew in each layer: firmware keeps it in single precision."""
        if self.printer.gcode.extrusion == "absolute":
            self.e_zero = self.e_written
            self.lines.append("G92 E0")

    def extruded(self, amount: float) -> str:
        """The E word of a move that extrudes `amount`, in the printer's unit."""
        self.e += amount
        before, self.e_written = self.e_written, round(self.e, _E_DIGITS)
        absolute = self.printer.gcode.extrusion == "absolute"
        return f"E{self.e_written - (self.e_zero if absolute else before):.{_E_DIGITS}f}"

    def feed_word(self, speed: float) -> str:
        """The F word where it changes; rounded down, so that no limit is passed."""
        feed = max(1, math.floor(60.0 * speed + 1e-6))
        if feed == self.feed:
            return ""
        self.feed = feed
        return f" F{feed}"

    def move(self, xy: Array | None, z: float | None, speed: float) -> None:
        """Move without extruding, in x and y, in z, or in all three."""
        target = self.place.copy()
        words = ""
        if xy is not None:
            target[:2] = xy
            words += f" X{xy[0]:.{_DIGITS}f} Y{xy[1]:.{_DIGITS}f}"
        if z is not None:
            target[2] = z
            words += f" Z{z:.{_DIGITS}f}"
        length = float(np.linalg.norm(target - self.place))
        if length < _SHORTEST:
            return
        self.lines.append(f"G0{words}{self.feed_word(speed)}")
        self.duration += 0.0 if math.isnan(length) else length / speed
        self.place = target

    def go_to(self, point: Array, top: float) -> None:
        """Travel to where a bead starts, above everything up to the height `top`."""
        motion = self.printer.motion
        distance = float(np.linalg.norm(point - self.place))
        if distance <= motion.direct:
            rise = max(abs(float(point[2] - self.place[2])), 1e-12)
            self.move(
                point[:2], float(point[2]), min(motion.travel_speed, motion.lift_speed * distance / rise)
            )
            return
        self.retract(back=False)
        above = max(top, float(point[2])) + motion.hop
        if math.isnan(distance):
            # Where the start code has left the nozzle is not known, nor how high what it has primed stands.
            above = max(above, self.printer.bed.safe_z)
        self.move(None, above, motion.lift_speed)
        self.move(point[:2], None, motion.travel_speed)
        self.move(None, float(point[2]), motion.lift_speed)
        self.retract(back=True)

    def retract(self, *, back: bool) -> None:
        """Draw the filament back before a travel, or push it forth again."""
        retraction = self.printer.retraction
        if retraction.by == "firmware":
            self.lines.append("G11" if back else "G10")
        elif retraction.length > 0:
            # Volumetric E counts volumes here as well.
            amount = retraction.length * self.printer.filament_area * self.printer.e_per_mm3
            words = self.extruded(amount if back else -amount)
            self.lines.append(f"G1 {words}{self.feed_word(retraction.speed)}")
            self.duration += retraction.length / retraction.speed

    def lay(self, bead: ModelBead, speed: Array) -> None:
        """Print a bead from its first point, where the nozzle is."""
        amounts = bead.sections * bead.lengths * self.printer.e_per_mm3
        moves = zip(bead.points[1:], bead.lengths, amounts, speed, strict=True)
        for (x, y, z), length, amount, v in moves:
            if length < _SHORTEST:
                continue
            word = "" if z == self.place[2] else f" Z{z:.{_DIGITS}f}"
            self.lines.append(
                f"G1 X{x:.{_DIGITS}f} Y{y:.{_DIGITS}f}{word} {self.extruded(amount)}{self.feed_word(v)}"
            )
            self.duration += length / v
            self.place = np.array([x, y, z])


def _head(model: ScaledModel, printer: DesktopPrinter, duration: float) -> list[str]:
    flavour = printer.gcode
    lines = []
    if flavour.comments:
        layers = len({bead.layer for bead in model.beads})
        size = " x ".join(f"{value:.1f}" for value in model.size)
        name = " ".join(printer.name.encode("ascii", "replace").decode().split())
        lines = [
            f"; scaled model {ratio(model.scale)}, {layers} layers, {size} mm, about {duration / 60:.0f} min",
            f"; {model.volume / printer.filament_area * 1e-3:.2f} m of filament, {model.volume:.0f} mm3",
            f"; for {name}, bed {printer.bed.size[0]:g} x {printer.bed.size[1]:g} mm",
            f"; needs {needs(model, printer)}",
        ]
    lines += _filled(flavour.start, printer, 0.0)
    # After the start code, which may have set its own; G90 first, because in Marlin it makes E absolute too.
    lines += ["G21", "G90", "M82" if flavour.extrusion == "absolute" else "M83"]
    if flavour.e_unit == "volume":
        lines.append(f"M200 D{printer.filament.diameter:g}")
    return [*lines, "G92 E0", "M107"]


def needs(model: ScaledModel, printer: DesktopPrinter) -> str:
    """The nozzle that a model is written for, which is seldom the one that a printer comes with, and its beads."""
    width, height = _from_to(model.bead_width), _from_to(model.bead_height)
    return f"a {printer.nozzle.diameter:g} mm nozzle: beads {width} wide, {height} high"


def _from_to(lengths: tuple[float, float]) -> str:
    least, most = (f"{length:.3g}" for length in lengths)
    return f"{least} mm" if least == most else f"{least} to {most} mm"


def _tail(printer: DesktopPrinter, top: float) -> list[str]:
    volumetric = ["M200 D0"] if printer.gcode.e_unit == "volume" else []
    return [*volumetric, *_filled(printer.gcode.end, printer, top)]


def _filled(template: str, printer: DesktopPrinter, top: float) -> list[str]:
    """The lines of a start or end code."""
    text = template.format(
        nozzle_c=printer.filament.nozzle_c,
        bed_c=printer.filament.bed_c,
        bed_x=printer.bed.size[0],
        bed_y=printer.bed.size[1],
        park_z=min(top + _PARK, printer.bed.height),
    )
    return text.strip().splitlines()
