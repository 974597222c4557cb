"""Scaled models: their G-code read back by another library, on a machine that knows nothing of how it was written."""

import re

import numpy as np
import pytest
import trimesh
from gcodeparser import parse_gcode_lines
from scipy.spatial.transform import Rotation
from shapes import stepped_box, vase

from planning import PlanningError, plan
from planning.configuration import shipped_configurations
from planning.desktop_printer import load_printer
from planning.gcode import gcode
from planning.order import print_order
from planning.scaled import scaled_model
from twincell.springer import springer, springer_top
from twins import (
    Curve,
    Layer,
    Plane,
    Toolpath,
    extrude,
    layer_planes,
    make_surface,
    rotate,
    signed_volume,
    slice_surface,
)

SHIPPED = sorted(path.stem for path in (shipped_configurations() / "printers").glob("*.toml"))
CR10 = (shipped_configurations() / "printers" / "cr10.toml").read_text()
SCALE = 1 / 12.5
WIDTH = 20.0


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


def several_curves():
    """Two layers with open and closed curves, widths of their own, drawn by hand."""
    square = np.array([[0.0, 0.0], [120.0, 0.0], [120.0, 120.0], [0.0, 120.0]])
    curves = (
        Curve(square),
        Curve(square[::-1] * 0.5 + 30.0, width=np.array([16.0, 20.0, 24.0, 20.0])),
        Curve(np.array([[160.0, 0.0], [190.0, 60.0], [160.0, 120.0]]), closed=False),
    )
    layers = [
        Layer(Plane.horizontal(z - 5.0), Plane.horizontal(z), curves) for z in (10.0, 20.0, 30.0, 40.0, 50.0)
    ]
    return Toolpath(Plane.horizontal(), tuple(layers), 10.0)


@pytest.fixture(scope="module")
def toolpaths():
    return {
        "springer": slice_surface(
            springer(), layer_planes(Plane.horizontal(), springer_top(), 10.0), resolution=10.0
        ),
        "vase": slice_surface(vase(hollow=False), layer_planes(Plane.horizontal(), 400.0, 10.0), 10.0),
        "stepped box": slice_surface(stepped_box(), layer_planes(Plane.horizontal(), 200.0, 10.0), 10.0),
        "several curves": several_curves(),
    }


def variant(tmp_path, **changes):
    """The CR-10 with other lines of its file."""
    text = CR10
    for key, value in changes.items():
        text, count = re.subn(rf"(?m)^{key} = [^#\n]*", f"{key} = {value}  ", text, count=1)
        assert count == 1, key
    path = tmp_path / "printer.toml"
    path.write_text(text)
    return load_printer(str(path))


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


def test_the_bed_is_the_base_plane_however_it_lies(toolpaths):
    printer, toolpath = load_printer("cr10"), toolpaths["springer"]
    turned = rotate(toolpath, Rotation.from_rotvec([0.3, -1.1, 0.4]).as_matrix(), about=(100.0, 20.0, -30.0))
    here, there = (scaled_model(path, printer, SCALE, WIDTH) for path in (toolpath, turned))
    for a, b in zip(here.beads, there.beads, strict=True):
        assert np.abs(a.points - b.points).max() < 1e-9
        assert a.height == pytest.approx(b.height)
    assert here.volume == pytest.approx(there.volume)


def test_a_centred_bed_and_no_comments(tmp_path, toolpaths):
    printer = variant(tmp_path, origin='"centre"', e_unit='"filament"\ncomments = false')
    text = gcode(toolpaths["several curves"], printer, SCALE, WIDTH)
    assert ";LAYER" not in text
    assert not text.startswith(";")
    points = np.vstack(
        [bead.points for bead in scaled_model(toolpaths["several curves"], printer, SCALE, WIDTH).beads]
    )
    assert np.abs(points[:, :2]).max() < 20.0


@pytest.mark.parametrize(
    ("scale", "width", "says"),
    [
        (
            1 / 25,
            20.0,
            r"width at 1:25 .* 0.8 mm \(layer 0, curve 0\), less than the 1.2 mm.*at least 1:16.6 ",
        ),
        (1 / 5, 20.0, r"width at 1:5 .* 4 mm \(layer 0, curve 0\), more than the 3 mm.*at most 1:6.67"),
        (1 / 6, 12.0, r"height at 1:6 .* 1.67 mm \(layer 0.*more than the 1.5 mm.*at most 1:6.67"),
        (
            1.0,
            2.0,
            "no scale suits: .* at least 1:1.66.*, and the nozzle's thickest layer for at most 1:6.66",
        ),
        (0.0, 20.0, "scale .* above 0"),
        (float("nan"), 20.0, "scale .* above 0"),
        (SCALE, -3.0, "bead width .* above 0"),
    ],
)
def test_what_a_printer_cannot_print_is_one_sentence_with_the_scales_it_can(toolpaths, scale, width, says):
    toolpath = Toolpath(
        Plane.horizontal(),
        (
            Layer(
                Plane.horizontal(5.0),
                Plane.horizontal(10.0),
                (Curve(np.array([[0.0, 0], [90, 0], [0, 90]])),),
            ),
        ),
        10.0,
    )
    with pytest.raises(PlanningError, match=says) as error:
        gcode(toolpath, load_printer("cr10"), scale, width)
    assert "\n" not in str(error.value)


def test_the_scales_that_it_names_can_be_printed(toolpaths):
    printer, toolpath = load_printer("cr10"), toolpaths["several curves"]
    with pytest.raises(PlanningError) as error:
        gcode(toolpath, printer, 1 / 100, WIDTH)
    named = [float(n) for n in re.findall(r"(?:at least|at most) 1:([\d.]+)", str(error.value))]
    assert len(named) == 2
    for n in named:
        assert Machine(gcode(toolpath, printer, 1 / n, WIDTH)).beads


@pytest.mark.parametrize(("axis", "points"), [("x", [[0, 0], [4000, 0]]), ("y", [[0, 0], [0, 4000]])])
def test_a_model_larger_than_the_bed_is_refused(axis, points):
    curve = Curve(np.array(points, dtype=float), closed=False)
    toolpath = Toolpath(
        Plane.horizontal(), (Layer(Plane.horizontal(5.0), Plane.horizontal(10.0), (curve,)),), 10.0
    )
    with pytest.raises(PlanningError, match=rf"long in {axis}, more than the 280 mm.*at most 1:14.4"):
        gcode(toolpath, load_printer("cr10"), SCALE, WIDTH)


def test_a_model_higher_than_the_printer_is_refused(tmp_path, toolpaths):
    with pytest.raises(PlanningError, match=r"32 mm high in z .layer 39.*more than the 29 mm"):
        gcode(toolpaths["vase"], variant(tmp_path, height="30.0"), SCALE, WIDTH)


def test_layers_too_steep_for_the_upright_nozzle_are_named(tmp_path, toolpaths):
    toolpath = toolpaths["springer"]
    tilt = [np.degrees(np.arccos(layer.nozzle.normal[2])) for layer in toolpath.layers]
    first = int(np.argmax(np.array(tilt) > 20.0))
    with pytest.raises(PlanningError, match=rf"layer {first} is tilted by {tilt[first]:.1f}°.*max_tilt_deg"):
        gcode(toolpath, variant(tmp_path, max_tilt_deg="20.0"), SCALE, WIDTH)


def test_a_hot_end_that_would_hit_the_uphill_side_is_refused(tmp_path, toolpaths):
    # The springer's last layer rises by 180 · sin 28° / 12.5 = 6.8 mm from one side to the other.
    toolpath = toolpaths["springer"]
    with pytest.raises(PlanningError, match=r"layer \d+: the model at 1:12.5 .* into the hot end") as error:
        gcode(toolpath, variant(tmp_path, length="6.0"), SCALE, WIDTH)
    named = float(re.search(r"choose a scale of 1:([\d.]+) or less", str(error.value))[1])
    assert gcode(toolpath, variant(tmp_path, length="6.0"), 1 / named, WIDTH)
    assert gcode(toolpath, variant(tmp_path, length="7.0"), SCALE, WIDTH)
    assert gcode(toolpath, variant(tmp_path, length="6.0", hot_end="8.0"), SCALE, WIDTH)
    # Without a tilt there is nothing uphill, whatever the hot end.
    assert gcode(toolpaths["vase"], variant(tmp_path, length="0.1"), SCALE, WIDTH)


def test_a_toolpath_without_curves_is_refused():
    empty = Toolpath(Plane.horizontal(), (Layer(Plane.horizontal(5.0), Plane.horizontal(10.0)),), 10.0)
    with pytest.raises(PlanningError, match="no curves"):
        gcode(empty, load_printer("cr10"), SCALE, WIDTH)
