from itertools import pairwise

import numpy as np
import pytest

from planning import PlanningError, Program, ProgramError, SegmentKind, arm, plan, urscript
from twins import Curve, Layer, Plane, Toolpath


def test_the_joints_reach_the_poses_in_one_branch(program):
    flange = arm(program.robot).forward(program.joints)
    np.testing.assert_allclose(flange @ program.tool, program.poses, atol=1e-6)
    assert np.abs(np.diff(program.joints, axis=0)).max() < 0.2


def test_waypoints_lie_on_the_nozzle_planes_with_the_local_height(program, rotary, cell):
    part = cell.bed.plane.to_frame(program.positions)
    for segment in program.segments:
        if segment.kind is not SegmentKind.PRINT:
            continue
        points = part[segment.start : segment.stop]
        nozzle = rotary.layers[segment.layer].nozzle
        floor = rotary.base if segment.layer == 0 else rotary.layers[segment.layer - 1].nozzle
        assert np.abs((points - nozzle.origin) @ nozzle.normal).max() < 1e-9
        np.testing.assert_allclose(
            program.height[segment.start : segment.stop], (points - floor.origin) @ floor.normal, rtol=1e-9
        )
        axis = program.poses[segment.start : segment.stop, :3, 2]
        np.testing.assert_allclose(axis, np.broadcast_to(-nozzle.normal, axis.shape), atol=1e-12)


def test_flow_is_speed_times_section(program):
    printing = program.of_kind(SegmentKind.PRINT)
    np.testing.assert_allclose(
        program.flow, np.where(printing, program.speed * program.width * program.height, 0.0)
    )
    assert (program.height[~printing] == 0).all()


def test_every_curve_is_printed_once_and_closed(program, rotary):
    printed = [(s.layer, s.curve) for s in program.segments if s.kind is SegmentKind.PRINT]
    assert sorted(printed) == [(i, j) for i, j, *_ in rotary.curves()]
    assert [layer for layer, _ in printed] == sorted(layer for layer, _ in printed)
    for segment in program.segments:
        if segment.kind is SegmentKind.PRINT:
            np.testing.assert_allclose(
                program.positions[segment.start], program.positions[segment.stop - 1], atol=1e-9
            )
            length = np.linalg.norm(
                np.diff(program.positions[segment.start : segment.stop], axis=0), axis=1
            ).sum()
            assert length == pytest.approx(
                rotary.layers[segment.layer].curves[segment.curve].length, rel=1e-9
            )


def test_the_tool_never_jumps_and_time_never_runs_back(program):
    for one, two in pairwise(program.segments):
        np.testing.assert_allclose(
            program.poses[one.stop - 1, :3, 3], program.poses[two.start, :3, 3], atol=1e-9
        )
    assert (np.diff(program.time) >= 0).all()


def test_travels_clear_the_printed_layer(program, rotary, cell, settings):
    part = cell.bed.plane.to_frame(program.positions)
    layer = None
    for segment in program.segments:
        if segment.kind is SegmentKind.PRINT:
            layer = segment.layer
        elif segment.kind is SegmentKind.TRAVEL:
            nozzle = rotary.layers[layer].nozzle
            assert nozzle.height_of(part[segment.start : segment.stop]).min() > 0.9 * settings.clearance


def test_a_first_order_pump_can_follow_every_bead(program, cell):
    """Inverting the lag, Q + T dQ/dt stays between 0 and twice the flow: the pump neither saturates nor reverses."""
    lag = cell.pump.lag_s
    for segment in program.segments:
        if segment.kind is SegmentKind.PRINT:
            flow, time = (a[segment.start : segment.stop] for a in (program.flow, program.time))
            slope = np.diff(flow) / np.diff(time)
            command = 0.5 * (flow[1:] + flow[:-1]) + lag * slope
            assert command.min() > -0.02 * flow.max()
            assert command.max() < 1.6 * flow.max()
            assert flow[-1] < 0.04 * flow.max()


def test_blends_never_overlap(program):
    length = np.linalg.norm(np.diff(program.positions, axis=0), axis=1)
    together = program.blend[1:] + program.blend[:-1]
    assert (together[together > 0] < length[together > 0]).all()


def test_a_program_comes_back_from_its_file(program, tmp_path):
    program.save(tmp_path / "program.npz")
    back = Program.load(tmp_path / "program.npz")
    assert back.segments == program.segments
    for name in ("poses", "joints", "speed", "flow", "time", "layer", "blend"):
        np.testing.assert_array_equal(getattr(back, name), getattr(program, name))
    assert back.external_axes.shape == (len(program), 0)
    (tmp_path / "broken.npz").write_bytes(b"PK\x03\x04 nothing")
    for name, says in (("broken.npz", "damaged"), ("none.npz", "no such program")):
        with pytest.raises(ProgramError, match=says):
            Program.load(tmp_path / name)


def test_urscript_has_one_motion_a_move(program, cell):
    text = urscript(program, cell)
    moves = sum(segment.stop - segment.start - 1 for segment in program.segments)
    assert text.count("\n  movep(") + text.count("\n  movel(") == moves
    assert text.startswith("def twincell_job():\n")
    assert text.endswith("\nend\n")


def test_nearest_curve_first_with_the_seam_lined_up(cell, mix, settings):
    ring = 20 * np.column_stack(
        [np.cos(np.arange(30) / 30 * 2 * np.pi), np.sin(np.arange(30) / 30 * 2 * np.pi)]
    )
    curves = tuple(Curve(ring + [x, 0.0]) for x in (0.0, 200.0, 100.0))
    layers = tuple(Layer(Plane.horizontal(z - 5), Plane.horizontal(z), curves) for z in (10.0, 20.0))
    program = plan(Toolpath(Plane.horizontal(), layers, 10.0), cell, mix, settings)
    order = [(s.layer, s.curve) for s in program.segments if s.kind is SegmentKind.PRINT]
    assert order == [(0, 0), (0, 2), (0, 1), (1, 1), (1, 2), (1, 0)]


def test_open_curves_and_own_widths_are_kept(cell, mix, settings):
    line = Curve(
        np.array([[0.0, 0.0], [50.0, 0.0], [100.0, 0.0]]), closed=False, width=np.array([8.0, 12.0, 16.0])
    )
    layer = Layer(Plane.horizontal(5), Plane.horizontal(10), (line,))
    program = plan(Toolpath(Plane.horizontal(), (layer,), 10.0), cell, mix, settings)
    printed = program.of_kind(SegmentKind.PRINT)
    assert program.width[printed][0] == 8.0
    assert program.width[printed][-1] == 16.0
    assert program.bead_volume == pytest.approx(100.0 * 12.0 * 10.0)


def test_short_layers_are_slowed_down_for_the_mix(rotary, cell, mix, settings):
    patient = mix.model_copy(update={"layer_interval_min_s": 20.0})
    slow = plan(rotary, cell, patient, settings)
    fast = plan(rotary, cell, mix, settings)
    assert slow.duration > fast.duration
    assert slow.bead_volume == pytest.approx(fast.bead_volume, rel=1e-6)


def test_an_empty_toolpath_is_refused(cell, mix, settings):
    empty = Toolpath(Plane.horizontal(), (Layer(Plane.horizontal(5), Plane.horizontal(10)),), 10.0)
    with pytest.raises(PlanningError, match="nothing to print"):
        plan(empty, cell, mix, settings)
