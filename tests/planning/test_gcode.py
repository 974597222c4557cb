"""Scaled models: their G-code read back by another library, on a machine that knows nothing of how it was written."""

import re

import numpy as np
import pytest
import trimesh
from gcodeparser import parse_gcode_lines
from models import SCALE, SHIPPED, WIDTH, sliced, variant

from planning import plan
from planning.configuration import shipped_configurations
from planning.desktop_printer import load_printer
from planning.gcode import gcode
from planning.order import print_order
from planning.scaled import scaled_model
from twins import Plane, extrude, layer_planes, make_surface, signed_volume, slice_surface


class Machine:
    """What a printer does with a file: position and filament after each line, from the parser's tokens alone.

    `beads` are runs of moves that extrude, each (layer, points, volumes of the moves, feeds); `travels` the moves
    that do not, each (start, end).
    """

    def __init__(self, text, diameter=1.75):
        area = np.pi * diameter**2 / 4
        place, e, feed = np.full(3, np.nan), 0.0, 0.0
        absolute = absolute_e = True
        per_e, layer, running = area, None, False
        self.beads, self.travels, self.retracted, self.fan, self.codes = [], [], 0.0, {}, []
        for line in parse_gcode_lines(text, include_comments=True):
            if line.command_str == ";":
                if found := re.match(r"LAYER:(\d+)", line.comment):
                    layer, running = int(found[1]), False
                continue
            code, words = line.command_str, line.params
            self.codes.append(code)
            if code in ("G0", "G1"):
                start = place.copy()
                for k, axis in enumerate("XYZ"):
                    if axis in words:
                        place[k] = words[axis] if absolute else place[k] + words[axis]
                feed = words.get("F", feed)
                amount = 0.0
                if "E" in words:
                    amount = words["E"] - e if absolute_e else words["E"]
                    e = words["E"] if absolute_e else e + words["E"]
                if layer is None:
                    continue
                moved = np.linalg.norm(place - start)
                if amount and not moved:
                    self.retracted -= amount * per_e
                    running = False
                elif "E" in words:
                    assert self.retracted == pytest.approx(0.0, abs=1e-3)
                    if not running:
                        self.beads.append((layer, [start], [], []))
                        running = True
                    self.beads[-1][1].append(place.copy())
                    self.beads[-1][2].append(amount * per_e)
                    self.beads[-1][3].append(feed)
                else:
                    self.travels.append((start, place.copy(), self.retracted))
                    running = False
            elif code in ("G10", "G11"):
                self.retracted = 1.0 if code == "G10" else 0.0
            elif code == "G90":
                absolute = absolute_e = True
            elif code == "G91":
                absolute = absolute_e = False
            elif code in ("M82", "M83"):
                absolute_e = code == "M82"
            elif code == "G92":
                e = words.get("E", e)
                assert not {"X", "Y", "Z"} & words.keys()
            elif code == "M200":
                per_e = 1.0 if words["D"] > 0 else area
            elif code in ("M106", "M107"):
                self.fan.setdefault(layer, words.get("S", 0.0) if code == "M106" else 0.0)
            elif code == "G21":
                assert absolute

        self.volumetric = per_e != area

    @property
    def volume(self):
        return sum(sum(volumes) for _, _, volumes, _ in self.beads)


def expected(toolpath, scale, width, centre):
    """(layer, points, volumes of the moves) of each curve in printing order, at scale, in the middle of the bed.

    The base is z = 0. A move's volume is ∫ width · local height over its length, by Simpson's rule.
    """
    curves = []
    for stop in print_order(toolpath):
        layer = toolpath.layers[stop.layer]
        curve = layer.curves[stop.curve]
        points = layer.nozzle.to_world(curve.points)
        widths = np.full(len(points), width) if curve.width is None else curve.width
        if curve.closed:
            points, widths = (np.roll(values, -stop.start, axis=0) for values in (points, widths))
            points, widths = np.vstack([points, points[:1]]), np.r_[widths, widths[:1]]
        elif stop.start:
            points, widths = points[::-1], widths[::-1]
        heights = toolpath.floor_of(stop.layer).height_of(points)
        ends, middle = widths * heights, (widths[1:] + widths[:-1]) * (heights[1:] + heights[:-1])
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        curves.append((stop.layer, points * scale, (ends[1:] + ends[:-1] + middle) / 6 * lengths * scale**3))
    both = np.vstack([points for _, points, _ in curves])
    shift = np.r_[np.array(centre) - 0.5 * (both.min(axis=0) + both.max(axis=0))[:2], 0.0]
    return [(layer, points + shift, volumes) for layer, points, volumes in curves]


def bead_volume(toolpath, scale, width):
    return sum(volumes.sum() for _, _, volumes in expected(toolpath, scale, width, (0.0, 0.0)))


@pytest.fixture(scope="module")
def toolpaths():
    return {name: sliced(name) for name in ("springer", "vase", "stepped box", "several curves")}


@pytest.mark.parametrize("printer", SHIPPED)
@pytest.mark.parametrize("shape", ["springer", "vase", "stepped box", "several curves"])
def test_another_parser_reads_the_toolpath_and_its_volume(toolpaths, shape, printer):
    toolpath, printer = toolpaths[shape], load_printer(printer)
    machine = Machine(gcode(toolpath, printer, SCALE, WIDTH), printer.filament.diameter)
    wanted = expected(toolpath, SCALE, WIDTH, printer.bed.centre)
    assert [layer for layer, *_ in machine.beads] == [layer for layer, *_ in wanted]
    for (_, points, volumes, _), (_, curve, exact) in zip(machine.beads, wanted, strict=True):
        assert len(points) == len(curve)
        assert np.abs(np.array(points) - curve).max() <= 1e-3
        # Each move by itself: mean heights would do for the sum.
        assert np.array(volumes) == pytest.approx(exact, rel=1e-3, abs=1e-4)
    assert machine.volume == pytest.approx(bead_volume(toolpath, SCALE, WIDTH), rel=1e-4)
    assert not machine.volumetric


def test_volume_is_the_programs_and_nearly_that_of_m_prime(toolpaths, cell, mix, settings):
    printer = load_printer("cr10")
    toolpath = toolpaths["springer"]
    machine = Machine(gcode(toolpath, printer, SCALE, WIDTH))
    program = plan(toolpath, cell, mix, settings.model_copy(update={"width": WIDTH}))
    assert machine.volume == pytest.approx(program.bead_volume * SCALE**3, rel=0.005)
    # Beads of a tube neither overlap nor turn corners: there M' is Σ width · height · length (Pappus).
    tube = trimesh.creation.cylinder(100.0, 50.0, sections=200).apply_translation([0, 0, 25.0])
    tube = make_surface(tube.vertices, tube.faces)
    toolpath = slice_surface(tube, layer_planes(Plane.horizontal(), 50.0, 10.0), 10.0)
    volume = signed_volume(extrude(toolpath, WIDTH, resolution=3.0))
    assert Machine(gcode(toolpath, printer, SCALE, WIDTH)).volume == pytest.approx(
        volume * SCALE**3, rel=0.005
    )


@pytest.mark.parametrize("extrusion", ["absolute", "relative"])
@pytest.mark.parametrize("unit", ["filament", "volume"])
@pytest.mark.parametrize("by", ["moves", "firmware"])
def test_every_dialect_prints_the_same(tmp_path, toolpaths, extrusion, unit, by):
    printer = variant(tmp_path, extrusion=f'"{extrusion}"', e_unit=f'"{unit}"', by=f'"{by}"')
    toolpath = toolpaths["several curves"]
    text = gcode(toolpath, printer, SCALE, WIDTH)
    machine = Machine(text)
    assert machine.volume == pytest.approx(bead_volume(toolpath, SCALE, WIDTH), rel=1e-4)
    assert ("M82" in machine.codes) == (extrusion == "absolute")
    assert ("M200" in machine.codes) == (unit == "volume")
    assert ("G10" in machine.codes) == (by == "firmware")
    long = [t for t in machine.travels[1:-1] if np.linalg.norm((t[1] - t[0])[:2]) > printer.motion.direct]
    assert long
    drawn = 1.0 if by == "firmware" else printer.retraction.length * printer.filament_area
    assert [t[2] for t in long] == pytest.approx([drawn] * len(long), abs=1e-3)


@pytest.mark.parametrize("shape", ["springer", "several curves", "stepped box"])
def test_travels_cross_above_what_is_printed(toolpaths, shape):
    printer = load_printer("cr10")
    text = gcode(toolpaths[shape], printer, SCALE, WIDTH)
    top, place, travelled = 0.0, np.full(3, np.nan), 0
    for line in parse_gcode_lines(text.split(";LAYER:0", 1)[1].split("M104 S0")[0]):
        if line.command_str in ("G0", "G1"):
            start = place.copy()
            for k, axis in enumerate("XYZ"):
                place[k] = line.params.get(axis, place[k])
            if "E" in line.params:
                top = max(top, place[2])
            elif np.linalg.norm((place - start)[:2]) > printer.motion.direct:
                travelled += 1
                assert min(place[2], start[2]) >= top + printer.motion.hop - 1e-3
    assert travelled or shape == "springer"


@pytest.mark.parametrize("lift_speed", ["2.0", "20.0"])
def test_flow_and_speed_stay_within_limits_and_small_layers_get_time(tmp_path, toolpaths, lift_speed):
    printer = variant(tmp_path, lift_speed=lift_speed)
    toolpath = toolpaths["springer"]
    machine = Machine(gcode(toolpath, printer, SCALE, WIDTH))
    time, slowest = {}, {}
    for layer, points, volumes, feeds in machine.beads:
        lengths = np.linalg.norm(np.diff(np.array(points), axis=0), axis=1)
        speed = np.array(feeds) / 60.0
        rising = np.abs(np.diff(np.array(points)[:, 2])) / lengths * speed
        assert speed.max() <= (printer.motion.speed_first if layer == 0 else printer.motion.speed)
        assert rising.max() <= printer.motion.lift_speed * (1 + 1e-2)
        assert (np.array(volumes) / lengths * speed).max() <= printer.filament.flow_max * (1 + 1e-2)
        time[layer] = time.get(layer, 0.0) + (lengths / speed).sum()
        slowest[layer] = min(slowest.get(layer, np.inf), speed.min())
    assert min(slowest.values()) >= printer.motion.speed_min - 1 / 60
    quick = [i for i in time if time[i] < printer.filament.layer_time_min * (1 - 1e-6)]
    assert all(slowest[i] <= printer.motion.speed_min + 1 / 60 for i in quick)
    assert (machine.fan[None], machine.fan[1]) == (0.0, 255.0)
    assert 0 not in machine.fan


def test_a_centred_bed_and_no_comments(tmp_path, toolpaths):
    printer = variant(tmp_path, origin='"centre"', e_unit='"filament"\ncomments = false')
    text = gcode(toolpaths["several curves"], printer, SCALE, WIDTH)
    assert ";LAYER" not in text
    assert not text.startswith(";")
    points = np.vstack(
        [bead.points for bead in scaled_model(toolpaths["several curves"], printer, SCALE, WIDTH).beads]
    )
    assert np.abs(points[:, :2]).max() < 20.0


@pytest.mark.parametrize("printer", SHIPPED)
def test_every_start_primes_within_the_margin_or_says_which_macro_does(printer):
    text = (shipped_configurations() / "printers" / f"{printer}.toml").read_text()
    printer = load_printer(printer)
    place, margin, primed = np.full(3, np.nan), printer.bed.margin, 0.0
    start = printer.gcode.start.format(nozzle_c=210, bed_c=60, bed_x=300, bed_y=300, park_z=100)
    for line in parse_gcode_lines(start):
        if line.command_str in ("G0", "G1"):
            for k, axis in enumerate("XYZ"):
                place[k] = line.params.get(axis, place[k])
            if line.params.get("E", 0.0) > 0.0:
                assert place[0] + 1.5 * printer.nozzle.diameter < margin
                primed += line.params["E"]
    if not primed:
        macro = start.split()[0]
        assert macro not in ("G28", "M109")
        assert re.search(rf"{macro} must [^.]*\bprime\b", text.replace("\n# ", " "))
    else:
        assert primed >= 20.0
        assert place[2] <= printer.bed.safe_z


@pytest.mark.parametrize("printer", SHIPPED)
def test_the_first_travel_crosses_high_and_the_last_lift_is_drawn_back(toolpaths, printer):
    text = gcode(toolpaths["several curves"], load_printer(printer), SCALE, WIDTH)
    machine = Machine(text, 1.75)
    (start, up, drawn), (before, across, _), (_, down, _) = machine.travels[:3]
    assert up[2] == before[2] == across[2] >= load_printer(printer).bed.safe_z
    assert np.array_equal(up[:2], start[:2], equal_nan=True)
    assert across[2] == up[2]
    assert down[2] < 2.0
    assert drawn > 0.0
    lift = next(t for t in reversed(machine.travels) if (t[0][:2] == machine.beads[-1][1][-1][:2]).all())
    assert lift[2] > 0.0
    assert machine.retracted > 0.0
