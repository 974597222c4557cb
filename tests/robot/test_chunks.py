"""Chunks hold every move once, end only where the tool is clear, and refuse what a controller would get wrong."""

from dataclasses import replace

import numpy as np
import pytest

from planning import Segment, SegmentKind
from planning.program import MOVES_MAX
from robot.chunks import split
from robot.errors import ArmError


def changed(program, **rows):
    """The program with single values changed: name=(waypoint, value)."""
    arrays = {}
    for name, (waypoint, value) in rows.items():
        arrays[name] = getattr(program, name).copy()
        arrays[name][waypoint] = value
    return replace(program, **arrays)


def test_every_move_is_in_one_chunk(two_layers):
    chunks = split(two_layers)
    moves = np.concatenate([chunk.target for chunk in chunks])
    assert np.all(np.diff(moves) > 0)
    away = np.linalg.norm(np.diff(two_layers.positions, axis=0), axis=1) > 1e-6
    assert np.array_equal(moves, np.flatnonzero(away) + 1)
    assert np.array_equal(np.concatenate([c.printing for c in chunks]), two_layers.moves()[moves])


def test_chunks_begin_and_end_away_from_beads(two_layers):
    for chunk in split(two_layers):
        assert not chunk.printing[0]
        assert not chunk.printing[-1]
        assert two_layers.segments[chunk.segment[0]].kind is SegmentKind.TRAVEL
        assert two_layers.segments[chunk.segment[-1]].kind is SegmentKind.RETRACT


def test_the_tool_stands_at_both_ends_of_a_bead_and_rounds_within(two_layers):
    for chunk in split(two_layers):
        bead = np.flatnonzero(chunk.printing)
        assert chunk.blend[bead[0] - 1] == chunk.blend[bead[-1]] == chunk.blend[-1] == 0.0
        assert (chunk.blend[bead[:-1]] > 0).all()


def test_a_wait_is_time_before_a_chunk(beads):
    corner = np.array(beads.cell.bed.origin)
    bead = np.array([[0.0, 0.0, 10.0], [100.0, 0.0, 10.0]]) + corner
    beads.print_curve(bead, 80.0, (12.0, 10.0), 0, 0)
    here = np.array(beads.rows[-1][:3])
    beads.add(SegmentKind.WAIT, [here, here], [1.0, 1.0], pause=12.5)
    beads.print_curve(bead + [0.0, 0.0, 10.0], 80.0, (12.0, 10.0), 1, 0)
    chunks = split(beads.program())
    assert [chunk.wait for chunk in chunks] == pytest.approx([0.0, 12.5])


def test_overlapping_blends_are_named(two_layers):
    with pytest.raises(ArmError, match="waypoint 15: blend radii"):
        split(changed(two_layers, blend=(15, 500.0)))


@pytest.mark.parametrize("name", ["joints", "poses", "flow"])
def test_a_waypoint_that_is_not_known_is_named(two_layers, name):
    with pytest.raises(ArmError, match=f"waypoint 20 has no {name}"):
        split(changed(two_layers, **{name: (20, np.nan)}))


def test_a_standing_move_is_named(two_layers):
    slow = two_layers.speed.copy()
    slow[10:12] = 0.0
    with pytest.raises(ArmError, match="waypoint 11: the speed"):
        split(replace(two_layers, speed=slow))


def test_a_gap_between_segments_is_named(two_layers):
    start = two_layers.segments[1].start
    poses = two_layers.poses.copy()
    poses[start:, 0, 3] += 1.0
    with pytest.raises(ArmError, match=rf"waypoint {start} begins segment 1 \(approach\) 1 mm away"):
        split(replace(two_layers, poses=poses))


def test_kinds_that_are_not_run_are_refused(two_layers):
    for kind in (SegmentKind.PRIME, SegmentKind.PURGE):
        first = two_layers.segments[0]
        segments = (Segment(kind, first.start, first.stop), *two_layers.segments[1:])
        with pytest.raises(ArmError, match=f"segment 0 is '{kind}'"):
            split(replace(two_layers, segments=segments))


def test_a_curve_too_long_for_one_script_is_named(beads):
    angle = np.linspace(0.0, 2.0 * np.pi, MOVES_MAX + 2)
    ring = np.column_stack([200.0 * np.cos(angle), 200.0 * np.sin(angle), np.full(len(angle), 10.0)])
    beads.print_curve(ring + np.array(beads.cell.bed.origin), 80.0, (12.0, 10.0), 0, 3, blend=0.0)
    with pytest.raises(ArmError, match=rf"layer 0, curve 3: 1\d\d\d moves .* at most {MOVES_MAX}"):
        split(beads.program())
