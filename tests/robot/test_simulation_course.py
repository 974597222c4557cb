"""A course: what was run is undone to the bit, and the way to slow down is counted over all of its pieces."""

from __future__ import annotations

import pytest

from robot.simulation.motions.course import Course, Piece

PIECES = [(10.0, 50.0, 400.0), (0.5, 20.0, 100.0), (30.0, 80.0, 300.0)]  # length, speed, acceleration


def course(pieces=PIECES) -> Course:
    made = Course()
    for i, (length, speed, acceleration) in enumerate(pieces):
        made.append(Piece(length, speed, acceleration, lambda on, i=i: (float(i), on)))
    made.plan()
    return made


def state(of: Course):
    return len(of.pieces), of.on, of.speed, of.ahead


@pytest.mark.parametrize("before", [0.01, 0.15, 0.3])
@pytest.mark.parametrize("tried", [0.002, 0.2, 5.0])
def test_going_back_leaves_nothing_of_what_was_tried(before, tried) -> None:
    one, other = course(), course()
    for it in (one, other):
        it.run(before)
    mark = one.mark()
    for _ in range(2):
        one.run(tried)
        assert state(one) != state(other)
        one.back(mark)
        assert state(one) == state(other)
    while other.pieces:
        assert one.run(0.01) == other.run(0.01)
        assert state(one) == state(other)


@pytest.mark.parametrize(("on", "speed", "takes"), [(9.0, 0.0, 14.0), (9.0, 50.0, 1.5), (4.0, 0.0, 0.0)])
def test_all_pieces_are_used_to_slow_down(on, speed, takes) -> None:
    moving = course([(10.0, 100.0, 400.0), (20.0, 100.0, 100.0)])
    moving.on, moving.speed = on, 60.0
    assert moving.braking(speed) == pytest.approx(takes)  # (60² - speed² - 2 · 400 · (10 - on)) / (2 · 100)
