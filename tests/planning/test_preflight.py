from dataclasses import replace

import numpy as np
import pytest

from planning import ProgramError, SegmentKind, Severity, check, load_cell, plan
from twins import Curve, Layer, Plane, Toolpath


def kinds(findings):
    return {finding.kind for finding in findings}


def test_a_sound_job_has_no_findings(program, cell, mix, rotary):
    assert check(program, cell, mix, rotary) == []


def test_a_bed_out_of_reach(rotary, cell, mix, settings):
    far = cell.model_copy(update={"bed": cell.bed.model_copy(update={"origin": (1280.0, 0.0, -150.0)})})
    program = plan(rotary, far, mix, settings)
    findings = [f for f in check(program, far, mix, rotary) if f.kind == "reach"]
    assert findings
    for finding in findings:
        assert finding.severity is Severity.ERROR
        assert np.isnan(program.joints[finding.waypoint]).all()
        assert finding.value > finding.limit
        assert "move the part" in finding.remedy


def test_joint_limits(rotary, cell, mix, settings):
    stiff = cell.model_copy(
        update={"robot": cell.robot.model_copy(update={"joint_limit_deg": (360.0, 30.0) + (360.0,) * 4})}
    )
    program = plan(rotary, stiff, mix, settings)
    found = [f for f in check(program, stiff, mix, rotary) if f.kind == "joint limit"]
    assert found
    assert all(
        abs(np.degrees(program.joints[f.waypoint, 1])) == pytest.approx(f.value, abs=0.01) for f in found
    )
    assert all(f.value > f.limit == 30.0 for f in found)


def test_joint_speed(program, cell, mix, rotary):
    hurried = replace(program, time=program.time / 200.0)
    found = [f for f in check(hurried, cell, mix, rotary) if f.kind == "joint speed"]
    assert found
    i = found[0].waypoint
    rate = np.degrees(
        np.abs(hurried.joints[i] - hurried.joints[i - 1]) / (hurried.time[i] - hurried.time[i - 1])
    )
    assert found[0].value == pytest.approx(rate.max(), abs=0.1)


def test_blend_overlap_names_the_waypoint(program, cell, mix, rotary):
    first = next(s for s in program.segments if s.kind is SegmentKind.PRINT)
    blend = program.blend.copy()
    blend[first.start + 20] = 100.0
    found = check(replace(program, blend=blend), cell, mix, rotary)
    assert kinds(found) == {"blend overlap"}
    assert found[0].waypoint in (first.start + 20, first.start + 21)


def test_pump_range_both_ways(program, cell, mix, rotary):
    top = float(program.flow.max())
    for update in ({"flow_max": 0.5 * top}, {"flow_min": 2.0 * top}):
        pump = cell.pump.model_copy(update=update)
        found = check(program, cell.model_copy(update={"pump": pump}), mix, rotary)
        assert kinds(found) == {"pump range"}


def test_bed_and_nozzle_and_interval(program, cell, mix, rotary):
    small = cell.model_copy(update={"bed": cell.bed.model_copy(update={"size": (60.0, 600.0)})})
    assert kinds(check(program, small, mix, rotary)) == {"work volume"}
    nozzle = cell.model_copy(update={"tool": cell.tool.model_copy(update={"width_min": 15.0})})
    assert kinds(check(program, nozzle, mix, rotary)) == {"bead width"}
    cold = check(program, cell, mix.model_copy(update={"layer_interval_max_s": 3.0}), rotary)
    assert kinds(cold) == {"layer interval"}
    assert {f.severity for f in cold} == {Severity.WARNING}


def test_a_program_for_another_robot_is_refused(program, mix, rotary, cell):
    other = cell.model_copy(update={"robot": cell.robot.model_copy(update={"model": "ur5e"})})
    with pytest.raises(ProgramError, match="for a ur10e"):
        check(program, other, mix, rotary)


def test_the_shipped_cell_is_what_it_says():
    assert load_cell("ur10e-demo").name == "ur10e-demo"


def ring(x, count=40, radius=40.0):
    angle = 2 * np.pi * np.arange(count) / count
    return Curve([x, 0.0] + radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def one_layer(*curves):
    return Toolpath(Plane.horizontal(), (Layer(Plane.horizontal(5), Plane.horizontal(10), curves),), 10.0)


def test_a_travel_through_the_robots_own_base(cell, mix, settings):
    bed = cell.bed.model_copy(update={"origin": (0.0, 0.0, -150.0), "size": (2000.0, 2000.0)})
    around = cell.model_copy(update={"bed": bed})
    toolpath = one_layer(ring(-600.0), ring(600.0))
    program = plan(toolpath, around, mix, settings)
    found = [f for f in check(program, around, mix, toolpath) if f.kind == "way between beads"]
    assert found
    travels = [s for s in program.segments if s.kind is SegmentKind.TRAVEL]
    assert any(s.start < f.waypoint < s.stop for f in found for s in travels)


def test_a_bead_longer_than_a_script(cell, mix, settings):
    toolpath = one_layer(ring(0.0, count=2000, radius=300.0))
    found = check(plan(toolpath, cell, mix, settings), cell, mix, toolpath)
    assert kinds(found) == {"bead length"}
    assert "coarser" in found[0].remedy


def cone(inset, count=8, radius=60.0):
    """Rings, each `inset` smaller in radius than the one below; layers of 10 mm."""
    layers = [
        Layer(
            Plane.horizontal(10.0 * i + 5.0),
            Plane.horizontal(10.0 * i + 10.0),
            (ring(0.0, 96, radius - inset * i),),
        )
        for i in range(count)
    ]
    return Toolpath(Plane.horizontal(), tuple(layers), 10.0)


@pytest.mark.parametrize("reference", ["ground", "layer"])
def test_overhang_beyond_what_the_mix_takes(cell, mix, settings, reference):
    limits = {
        "max_overhang_by_ground": None,
        "max_overhang_by_layer": None,
        f"max_overhang_by_{reference}": 0.3,
    }
    limited = mix.model_copy(update=limits)
    for inset, kind in ((2.9, set()), (3.1, {f"overhang by {reference}"})):
        toolpath = cone(inset)
        program = plan(toolpath, cell, limited, settings)
        found = check(program, cell, limited, toolpath)
        assert kinds(found) == kind
        for finding in found:
            assert finding.severity is Severity.WARNING
            assert "at worst 0.31" in finding.message
            # Seven of eight rings hang over, each 3.1 mm less in radius than the one below.
            radii = 60.0 - 3.1 * np.arange(8)
            assert finding.value == pytest.approx(100.0 * radii[1:].sum() / radii.sum(), abs=0.01)
            assert program.layer[finding.waypoint] >= 1
    unknown = mix.model_copy(update={"max_overhang_by_ground": None, "max_overhang_by_layer": None})
    assert check(program, cell, unknown, toolpath) == []


@pytest.mark.parametrize("empty", [0, 1])
def test_a_layer_with_nothing_below(cell, mix, settings, empty):
    layers = [
        replace(layer, curves=()) if i == empty else layer for i, layer in enumerate(cone(0.0, 3).layers)
    ]
    toolpath = Toolpath(Plane.horizontal(), tuple(layers), 10.0)
    (finding,) = check(plan(toolpath, cell, mix, settings), cell, mix, toolpath)
    assert finding.kind == "overhang by ground"
    assert "with nothing below" in finding.message
    assert finding.value == pytest.approx(50.0)


def test_beads_that_overlap(cell, mix, settings):
    # Two rings of radius 40 whose beads, 12 mm wide, keep apart, and then do not.
    for gap, kind in ((12.0, set()), (11.0, {"bead overlap"})):
        toolpath = one_layer(ring(-40.0 - 0.5 * gap), ring(40.0 + 0.5 * gap))
        program = plan(toolpath, cell, mix, settings)
        found = check(program, cell, mix, toolpath)
        assert kinds(found) == kind
        for finding in found:
            assert finding.severity is Severity.WARNING
            assert finding.value == pytest.approx(11.0 / 12.0, abs=0.001)
            at = cell.bed.plane.to_frame(program.positions[[finding.waypoint]])[0]
            assert at[:2] == pytest.approx([0.0, 0.0], abs=6.0)


def test_each_bead_counts_with_its_own_width(cell, mix, settings):
    def wide(curve, width):
        return Curve(curve.points, curve.closed, np.full(len(curve.points), width))

    narrow = wide(ring(200.0, radius=20.0), 10.0)
    for width, kind in ((14.0, {"bead overlap"}), (10.0, set())):
        # 11.5 mm from middle to middle: too near for beads of 14 and 12 mm, far enough for 10 and 12.
        toolpath = one_layer(wide(ring(-45.75), width), ring(45.75), narrow)
        assert kinds(check(plan(toolpath, cell, mix, settings), cell, mix, toolpath)) == kind


def test_open_time(program, cell, mix, rotary):
    found = check(program, cell, mix.model_copy(update={"open_time_s": 10.0}), rotary)
    assert kinds(found) == {"open time"}


def test_many_findings_of_a_kind_are_folded(rotary, cell, mix, settings):
    bed = cell.bed.model_copy(update={"size": (60.0, 600.0)})
    small = cell.model_copy(update={"bed": bed})
    found = check(plan(rotary, small, mix, settings), small, mix, rotary)
    assert 1 < len(found) <= 5
    assert "more places like this" in found[-1].message


def test_beads_start_slower_where_the_pump_has_little_head_room(rotary, cell, mix, settings):
    def start_ramp(flow_max):
        pump = cell.pump.model_copy(update={"flow_max": flow_max})
        program = plan(rotary, cell.model_copy(update={"pump": pump}), mix, settings)
        first = next(s for s in program.segments if s.kind is SegmentKind.PRINT)
        speed = program.speed[first.start : first.stop]
        return (
            program.time[first.start + int(np.argmax(speed > 0.99 * speed.max()))] - program.time[first.start]
        )

    top = settings.speed * settings.width * 7.0
    assert start_ramp(1.2 * top) > 1.5 * start_ramp(10.0 * top)
