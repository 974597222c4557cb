"""Scaled models: where they stand, what is refused, and the scales that are named instead."""

import numpy as np
import pytest
import trimesh
from models import SCALE, WIDTH, named_scales, sliced, stack, variant
from scipy.spatial.transform import Rotation

from planning import PlanningError
from planning.desktop_printer import load_printer
from planning.gcode import gcode
from planning.scaled import scaled_model
from twins import Curve, Layer, Plane, Toolpath, layer_planes, make_surface, rotate, slice_surface


@pytest.fixture(scope="module")
def toolpaths():
    return {name: sliced(name) for name in ("springer", "vase", "several curves")}


def test_the_bed_is_the_base_plane_however_it_lies(toolpaths):
    printer, toolpath = load_printer("cr10"), toolpaths["springer"]
    turned = rotate(toolpath, Rotation.from_rotvec([0.3, -1.1, 0.4]).as_matrix(), about=(100.0, 20.0, -30.0))
    here, there = (scaled_model(path, printer, SCALE, WIDTH) for path in (toolpath, turned))
    for a, b in zip(here.beads, there.beads, strict=True):
        assert np.abs(a.points - b.points).max() < 1e-9
        assert a.height == pytest.approx(b.height)
    assert here.volume == pytest.approx(there.volume)


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
            "layer 0, curve 0 has a bead 10 mm high and only 2 mm wide.*wider beads or thinner layers",
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


@pytest.mark.parametrize("scale", [1 / 100, 1 / 12.5, 1 / 2])
@pytest.mark.parametrize("length", ["3.0", "5.0", "6.5", "8.0"])
@pytest.mark.parametrize("shape", ["springer", "several curves"])
def test_the_scales_that_it_names_can_be_printed(tmp_path, toolpaths, shape, length, scale):
    printer, toolpath = variant(tmp_path, length=length), toolpaths[shape]
    try:
        gcode(toolpath, printer, scale, WIDTH)
    except PlanningError as error:
        text = str(error)
    else:
        return
    if "no scale suits" not in text:
        assert 1 <= len(named_scales(text)) <= 2
        for n in named_scales(text):
            assert gcode(toolpath, printer, 1 / n, WIDTH)
        return
    least, most = named_scales(text)
    assert least < most
    for n in np.geomspace(0.9 * least, 1.1 * most, 4):
        with pytest.raises(PlanningError):
            gcode(toolpath, printer, 1 / n, WIDTH)


def test_a_narrow_window_of_scales_is_named_with_the_digits_it_takes():
    printer, narrow = load_printer("cr10"), 17.3
    # The narrowest and the widest bead that the nozzle lays are 2.5 times apart; these a little less.
    for share in (1e-3, 1e-4, 1e-5, 0.0):
        width = np.array([narrow, 2.5 * narrow * (1 - share), narrow, narrow])
        toolpath = stack(
            [10.0, 20.0], (Curve(np.array([[0.0, 0], [200, 0], [200, 200], [0, 200]]), width=width),)
        )
        with pytest.raises(PlanningError) as error:
            gcode(toolpath, printer, 1 / 12, WIDTH)
        named = named_scales(str(error.value))
        assert "no scale suits" not in str(error.value)
        assert 1 <= len(named) <= 2
        for n in named:
            assert gcode(toolpath, printer, 1 / n, WIDTH)
    width = np.array([narrow, 2.6 * narrow, narrow, narrow])
    toolpath = stack([10.0], (Curve(np.array([[0.0, 0], [200, 0], [200, 200], [0, 200]]), width=width),))
    with pytest.raises(PlanningError, match=r"no scale suits: the nozzle's narrowest bead .* widest bead"):
        gcode(toolpath, printer, 1 / 12, WIDTH)


@pytest.mark.parametrize(
    ("tops", "width", "says"),
    [
        (
            [0.5, 1.0],
            20.0,
            r"height at 1:12.5 .* 0.04 mm .*less than the 0.15 mm.*no scale suits: the nozzle's",
        ),
        ([1.8, 11.8], 20.0, r"height at 1:12.5 .* 0.144 mm .layer 0.*at least 1:12 and at most 1:6.67"),
        ([15.0, 30.0], 12.0, "layer 0, curve 0 has a bead 15 mm high and only 12 mm wide"),
    ],
)
def test_beads_too_thin_or_higher_than_wide_are_refused(tops, width, says):
    with pytest.raises(PlanningError, match=says) as error:
        gcode(stack(tops), load_printer("cr10"), SCALE, width)
    for n in named_scales(str(error.value)) if "no scale" not in str(error.value) else ():
        assert gcode(stack(tops), load_printer("cr10"), 1 / n, width)


def test_a_model_in_the_air_is_refused():
    block = trimesh.creation.box((200.0, 200.0, 50.0)).apply_translation([0.0, 0.0, 55.0])
    block = make_surface(block.vertices, block.faces)
    toolpath = slice_surface(block, layer_planes(Plane.horizontal(), 80.0, 10.0))
    with pytest.raises(
        PlanningError, match=r"layer 3 has curves, but layer 2 below it has none: .*in the air"
    ):
        gcode(toolpath, load_printer("cr10"), SCALE, WIDTH)
    # The same on a bed at its own height.
    toolpath = slice_surface(block, layer_planes(Plane.horizontal(30.0), 50.0, 10.0))
    model = scaled_model(toolpath, load_printer("cr10"), SCALE, WIDTH)
    assert model.beads[0].points[:, 2] == pytest.approx(0.8)
    # Empty layers above the last are none of its business.
    full = stack([10.0, 20.0])
    emptied = Toolpath(full.base, (*full.layers, Layer(Plane.horizontal(25.0), Plane.horizontal(30.0))), 10.0)
    assert gcode(emptied, load_printer("cr10"), SCALE, WIDTH) == gcode(
        full, load_printer("cr10"), SCALE, WIDTH
    )


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
    for n in named_scales(str(error.value)):
        assert gcode(toolpath, variant(tmp_path, length="6.0"), 1 / n, WIDTH)
    assert gcode(toolpath, variant(tmp_path, length="7.0"), SCALE, WIDTH)
    assert gcode(toolpath, variant(tmp_path, length="6.0", hot_end="8.0"), SCALE, WIDTH)
    # Without a tilt there is nothing uphill, whatever the hot end.
    assert gcode(toolpaths["vase"], variant(tmp_path, length="0.1"), SCALE, WIDTH)


def test_a_toolpath_without_curves_is_refused():
    empty = Toolpath(Plane.horizontal(), (Layer(Plane.horizontal(5.0), Plane.horizontal(10.0)),), 10.0)
    with pytest.raises(PlanningError, match="no curves"):
        gcode(empty, load_printer("cr10"), SCALE, WIDTH)
