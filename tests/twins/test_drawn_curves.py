"""Drawings as other programs write them: rounded angles, widths, definitions, doubled lines, long splines."""

import math

import ezdxf
import numpy as np
import pytest
from scipy.interpolate import BSpline

from twins import FormatError
from twins.formats.curves import read_curves
from twins.formats.flattening import homogeneous, spline_pieces

CHORD = 0.02
SQUARE = ((0.0, 0.0), (100.0, 0.0), (100.0, 80.0), (0.0, 80.0))


def drawn(tmp_path, draw, chord=CHORD):
    document = ezdxf.new("R2010")
    document.units = ezdxf.units.MM
    draw(document.modelspace())
    document.saveas(tmp_path / "a.dxf")
    return read_curves(tmp_path / "a.dxf", chord=chord)


@pytest.mark.parametrize("digits", range(9, 16))
@pytest.mark.parametrize("start", [0.0, 0.5 * math.pi, 1.0, 4.0])
def test_a_full_turn_is_one_however_its_angles_are_printed(tmp_path, digits, start):
    first, last = (float(f"{angle:.{digits}g}") for angle in (start, start + 2.0 * math.pi))
    degrees = [float(f"{math.degrees(angle):.{digits}g}") for angle in (start, start + 2.0 * math.pi)]

    def draw(space):
        space.add_ellipse((5, 5), (100, 0), 0.5, first, last)
        space.add_arc((0, 0), 100, *degrees)
        space.add_arc((0, 0), 100, degrees[0], degrees[0] + 360.0000000001)
        space.add_arc((0, 0), 100, degrees[0], degrees[0] + 359.9999999999)

    ellipse, *rings = drawn(tmp_path, draw)
    assert ellipse.closed
    x, y = ((ellipse.points - [5, 5, 0])[:, :2] / [100, 50]).T
    assert np.allclose(np.hypot(x, y), 1.0)
    gaps = np.diff(np.append(np.unwrap(np.arctan2(y, x)), np.arctan2(y[0], x[0]) + 2.0 * math.pi))
    assert gaps.max() < 0.2
    for ring in rings:
        assert ring.closed
        assert math.isclose(ring.length, 200.0 * math.pi, rel_tol=1e-3)


def test_a_short_arc_is_no_full_turn(tmp_path):
    def draw(space):
        space.add_arc((0, 0), 100, 20, 20.001)
        space.add_ellipse((500, 0), (100, 0), 1.0, 0.0, 6.28)

    arc, almost = drawn(tmp_path, draw)
    assert math.isclose(arc.length, 100 * math.radians(0.001), rel_tol=1e-6)
    assert not almost.closed


@pytest.mark.parametrize("closed", [True, False])
def test_one_width_for_a_whole_polyline_is_kept(tmp_path, closed):
    def draw(space):
        space.add_lwpolyline(SQUARE, close=closed, dxfattribs={"const_width": 20})
        old = space.add_polyline2d(SQUARE, close=closed)
        old.dxf.default_start_width = old.dxf.default_end_width = 20
        space.add_lwpolyline(SQUARE, close=closed)

    new, old, bare = drawn(tmp_path, draw)
    assert np.array_equal(new.widths, [20.0] * 4)
    assert np.array_equal(old.widths, [20.0] * 4)
    assert bare.widths is None


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("bulge", [1.0, -0.4, 1e-3])
def test_widths_grow_evenly_along_bulges(tmp_path, closed, bulge):
    corners = [(0, 0, 10, 30, bulge), (100, 0, 30, 20, 0), (100, 90, 20, 10, 0)]

    def draw(space):
        space.add_lwpolyline(corners, format="xyseb", close=closed)

    (curve,) = drawn(tmp_path, draw, chord=0.001)
    corner = [int(np.linalg.norm(curve.points - [x, y, 0], axis=1).argmin()) for x, y, *_ in corners]
    assert np.array_equal(curve.widths[corner], [10, 30, 20])
    run = np.linalg.norm(np.diff(curve.points[: corner[1] + 1], axis=0), axis=1).cumsum()
    assert len(run) > 4 or abs(bulge) < 0.1
    # Chords are a trifle shorter than their arcs, each by its own angle.
    assert np.allclose(curve.widths[1 : corner[1] + 1], 10 + 20 * run / run[-1], atol=1e-3)


def test_the_end_of_an_open_polyline_is_as_wide_as_the_segment_that_ends_there(tmp_path):
    def draw(space):
        space.add_lwpolyline([(0, 0, 10, 20), (100, 0, 20, 30), (100, 50, 0, 0)], format="xyse")

    (curve,) = drawn(tmp_path, draw)
    assert np.array_equal(curve.widths, [10, 20, 30])


def test_widths_at_some_vertices_are_refused(tmp_path):
    def draw(space):
        space.add_lwpolyline([(0, 0, 20, 20), (100, 0, 0, 0), (100, 50, 20, 20)], format="xyse", close=True)

    with pytest.raises(
        FormatError, match=r"a\.dxf: LWPOLYLINE .* width at vertex 0, 20, but not at vertex 1"
    ):
        drawn(tmp_path, draw)


def test_doubled_lines_and_arcs_are_named(tmp_path):
    spline = [(0, 0, 0), (30, 40, 0), (60, -10, 0), (90, 5, 0)]
    for kind, *twice in (
        ("LINE", lambda s: s.add_line((0, 0), (50, 0)), lambda s: s.add_line((0, 0), (50, 0))),
        ("LINE", lambda s: s.add_line((0, 0), (50, 0)), lambda s: s.add_line((50, 0), (0, 0))),
        ("ARC", *2 * [lambda s: s.add_arc((0, 0), 20, 10, 90)]),
        ("SPLINE", lambda s: s.add_open_spline(spline), lambda s: s.add_open_spline(spline[::-1])),
    ):

        def draw(space, twice=twice):
            space.add_line((0, 500), (50, 560))
            for add in twice:
                add(space)

        with pytest.raises(FormatError, match=rf"{kind} .* is drawn twice, the other time as {kind}"):
            drawn(tmp_path, draw)
    # Two halves of a circle meet at both ends, too.
    (ring,) = drawn(tmp_path, lambda s: (s.add_arc((0, 0), 20, 0, 180), s.add_arc((0, 0), 20, 180, 360)))
    assert ring.closed


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_splines_of_many_spans_are_those_of_scipy(degree):
    rng = np.random.default_rng(degree)
    count = 20_000
    inner = np.cumsum(rng.uniform(0.5, 1.5, count - degree - 1))
    if degree > 1:
        inner[100:104:2] = inner[101:104:2]  # a knot of multiplicity two has no span
    knots = np.concatenate([np.zeros(degree + 1), inner, np.full(degree + 1, inner[-1] + 1.0)])
    places, weights = rng.uniform(-900.0, 900.0, (count, 3)), rng.uniform(0.5, 2.0, count)
    pieces = spline_pieces(homogeneous(places, weights), knots, degree)
    ends = np.unique(knots)
    assert len(pieces) == len(ends) - 1
    exact = BSpline(knots, np.column_stack([places * weights[:, None], weights]), degree)
    for share in (0.0, 0.3, 1.0):
        basis = [math.comb(degree, j) * share**j * (1 - share) ** (degree - j) for j in range(degree + 1)]
        there = np.einsum("j,mjk->mk", basis, pieces)
        wanted = exact(ends[:-1] + share * np.diff(ends))
        assert np.abs(there - wanted).max() < 1e-6


def svg(tmp_path, inside, attributes='xmlns="http://www.w3.org/2000/svg"'):
    path = tmp_path / "a.svg"
    path.write_text(
        f'<svg {attributes} xmlns:xlink="http://www.w3.org/1999/xlink" width="90mm" height="90mm" '
        f'viewBox="0 0 90 90">{inside}</svg>'
    )
    return read_curves(path)


SMALL, LARGE = '<rect id="small" width="5" height="5"/>', '<rect width="70" height="70"/>'


@pytest.mark.parametrize("kind", ["symbol", "mask", "marker", "pattern", "clipPath", "defs"])
@pytest.mark.parametrize("attributes", ['xmlns="http://www.w3.org/2000/svg"', ""])
def test_what_svg_only_defines_is_not_drawn(tmp_path, kind, attributes):
    for inside in (SMALL, f"<g>{SMALL}</g>", f"<symbol>{SMALL}</symbol>{SMALL}"):
        (curve,) = svg(tmp_path, f'<{kind} id="a">{inside}</{kind}><g data-z="4">{LARGE}</g>', attributes)
        assert np.allclose(np.ptp(curve.points, axis=0), [70, 70, 0])
        assert (curve.points[:, 2] == 4).all()


def test_what_svg_uses_is_drawn_where_it_is_used(tmp_path):
    for definition, reference in (
        (f'<symbol id="s">{SMALL}<mask>{LARGE}</mask></symbol>', "#s"),
        (f'<defs><symbol id="s">{SMALL}</symbol></defs>', "#s"),
        (f"<mask>{SMALL}</mask>", "#small"),
    ):
        for name in ("href", "xlink:href"):
            use = f'<use {name}="{reference}" x="30" y="20"/>'
            for inside in (definition + use, use + definition):
                (curve,) = svg(tmp_path, inside)
                assert np.allclose(curve.points.min(axis=0), [30, -25, 0])
                assert np.allclose(curve.points.max(axis=0), [35, -20, 0])
    with pytest.raises(FormatError, match=r"a\.svg: draws the symbol #s scaled by its viewBox"):
        svg(tmp_path, f'<symbol id="s" viewBox="0 0 9 9">{SMALL}</symbol><use href="#s"/>')
