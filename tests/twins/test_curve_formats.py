"""Curve files against the shapes that other libraries were told to draw, and round trips."""

import csv
import json
import math
import random
from functools import cache

import ezdxf
import numpy as np
import pytest
import rhino3dm
from drawings import point, random_curves, rhino_model
from scipy.interpolate import BSpline
from scipy.spatial import KDTree
from shapes import SHAPES

from twins import (
    Curve,
    FormatError,
    Layer,
    Plane,
    Toolpath,
    ToolpathError,
    layer_planes,
    save_toolpath,
    slice_surface,
)
from twins.formats.curves import read_curves, save_curves
from twins.formats.unwrapped import save_unwrapped
from twins.wrapping.space_curve import SpaceCurve
from twins.wrapping.unwrapping import unwrap

CHORD = 0.02
EXACT = ("dxf", "3dm", "json", "csv")


def same(read, wanted):
    assert len(read) == len(wanted)
    for a, b in zip(read, wanted, strict=True):
        assert a.closed == b.closed
        assert a.points.shape == b.points.shape
        assert np.abs(a.points - b.points).max() < 1e-9
        assert (a.widths is None) == (b.widths is None)
        if a.widths is not None:
            assert np.abs(a.widths - b.widths).max() < 1e-9


def off(points, polyline):
    """Distance of each point, shape (n, 3), from a polyline, shape (m, 3)."""
    nearest = np.full(len(points), np.inf)
    for start, way in zip(polyline[:-1], np.diff(polyline, axis=0), strict=True):
        d = points - start
        share = np.clip(d @ way / max(way @ way, 1e-300), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(d - share[:, None] * way, axis=1))
    return nearest


def ring_of(curve):
    return np.vstack([curve.points, curve.points[:1]]) if curve.closed else curve.points


def follows(curve, drawn, chord=CHORD, *, smooth=True):
    """The drawn curve, shape (n, 3), is within the chord of the polyline, whose vertices lie on it."""
    drawn = np.asarray(drawn, dtype=float)
    polyline = ring_of(curve)
    assert off(drawn[:: max(1, len(drawn) // 3000)], polyline).max() <= chord + 1e-9
    spacing = np.linalg.norm(np.diff(drawn, axis=0), axis=1).max()
    index = KDTree(drawn).query(curve.points)[1]
    for place, k in zip(curve.points, index, strict=True):
        assert off(place[None], drawn[max(0, k - 2) : k + 3])[0] < (spacing**2 if smooth else spacing)
    # The polyline does not leave the curve between its vertices either.
    assert KDTree(drawn).query(0.5 * (polyline[:-1] + polyline[1:]))[0].max() <= np.hypot(chord, spacing)


def ellipse(centre, u, v, start=0.0, end=2 * math.pi, n=20001):
    a = np.linspace(start, end, n)[:, None]
    return np.asarray(centre) + np.cos(a) * np.asarray(u) + np.sin(a) * np.asarray(v)


@pytest.mark.parametrize("ending", EXACT)
def test_curves_come_back_vertex_for_vertex(ending, tmp_path):
    curves = [*random_curves(1), SpaceCurve([[1 / 3, 2e5, -7e-5], [1e-9, 0, 0]], closed=False)]
    save_curves(curves, tmp_path / f"curves.{ending}")
    same(read_curves(tmp_path / f"curves.{ending}"), curves)
    assert [file.name for file in tmp_path.iterdir()] == [f"curves.{ending}"]


def test_horizontal_curves_come_back_from_svg(tmp_path):
    curves = [
        SpaceCurve(np.column_stack([c.points[:, :2], np.full(len(c.points), z)]), c.closed)
        for c, z in zip(random_curves(2), np.repeat([0.0, 7.5, 1 / 3, 20.0], 5), strict=True)
    ]
    save_curves(curves, tmp_path / "curves.svg")
    same(read_curves(tmp_path / "curves.svg"), curves)


@cache
def toolpaths():
    return dict(made_toolpaths())


def made_toolpaths():
    rng = np.random.default_rng(3)
    for name, shape in SHAPES.items():
        yield name, slice_surface(shape(), layer_planes(Plane.horizontal(), 200.0, 25.0))
    tilted = layer_planes(
        Plane.horizontal(),
        Plane(np.array([0, 0, 150.0]), np.array([1.0, 0, 0.3]), np.array([0, 1.0, 0])),
        30.0,
    )
    arc = Curve(rng.normal(0, 50, (9, 2)), closed=False, width=rng.uniform(10, 30, 9))
    layers = tuple(Layer(s, n, (arc,)) for s, n in zip(tilted.slicing, tilted.nozzle, strict=True))
    yield "rotary", Toolpath(tilted.base, layers, tilted.thickness)


def test_toolpaths_come_back_from_files_as_space_curves(tmp_path):
    for name, toolpath in toolpaths().items():
        for at in ("nozzle", "slicing"):
            unwrapped = unwrap(toolpath, at)
            for ending in EXACT if name in {"box", "rotary"} else ("json",):
                save_unwrapped(unwrapped, tmp_path / f"unwrapped.{ending}")
                same(
                    read_curves(tmp_path / f"unwrapped.{ending}"), [curve.space_curve for curve in unwrapped]
                )
        save_toolpath(toolpath, tmp_path / "toolpath.json")
        same(read_curves(tmp_path / "toolpath.json"), [curve.space_curve for curve in unwrap(toolpath)])


def test_unwrapped_curves_lie_where_the_nozzle_runs_and_the_surface_is_cut():
    for toolpath in toolpaths().values():
        for curve, cut in zip(unwrap(toolpath), unwrap(toolpath, "slicing"), strict=True):
            layer = toolpath.layers[curve.layer]
            assert np.abs(layer.nozzle.height_of(curve.points)).max() < 1e-9
            assert np.abs(layer.slicing.height_of(cut.points)).max() < 1e-9
            assert np.abs(np.linalg.norm(curve.tangents, axis=1) - 1).max() < 1e-12
            assert np.abs(curve.tangents @ curve.plane.normal).max() < 1e-12
            floor = toolpath.floor_of(curve.layer)
            # Down the floor's normal by the local height lies a point of the floor.
            assert np.abs(floor.height_of(curve.points - curve.heights[:, None] * floor.normal)).max() < 1e-9
            assert np.array_equal(cut.heights, curve.heights)
            for plane, points in ((layer.nozzle, curve.points), (layer.slicing, cut.points)):
                assert np.abs(plane.to_frame(points)[:, :2] - layer.curves[curve.curve].points).max() < 1e-9


def test_tangents_follow_a_circle_and_the_ends_of_a_line():
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    circle = Curve(50 * np.column_stack([np.cos(angle), np.sin(angle)]))
    line = Curve([[0, 0], [0, 0], [3, 0], [3, 4], [3, 4]], closed=False)
    layer = Layer(Plane.horizontal(5), Plane.horizontal(10), (circle, line))
    ring, path = unwrap(Toolpath(Plane.horizontal(), (layer,), 10.0))
    assert np.allclose(ring.tangents, np.column_stack([-np.sin(angle), np.cos(angle), 0 * angle]), atol=1e-12)
    assert np.allclose(ring.heights, 10)
    half = math.sqrt(0.5)
    assert np.allclose(path.tangents[:, :2], [[1, 0], [1, 0], [half, half], [0, 1], [0, 1]])
    with pytest.raises(ToolpathError, match="at 'bed'"):
        unwrap(Toolpath(Plane.horizontal(), (layer,), 10.0), "bed")


def test_files_of_unwrapped_curves_say_everything(tmp_path):
    toolpath = toolpaths()["rotary"]
    unwrapped = unwrap(toolpath)
    for ending in EXACT:
        save_unwrapped(unwrapped, tmp_path / f"u.{ending}")
    entries = json.loads((tmp_path / "u.json").read_text())["curves"]
    with (tmp_path / "u.csv").open() as file:
        rows = list(csv.DictReader(file))
    model = rhino3dm.File3dm.Read(str(tmp_path / "u.3dm"))
    polylines = list(ezdxf.readfile(tmp_path / "u.dxf").modelspace())
    first = 0
    for curve, entry, item, polyline in zip(unwrapped, entries, model.Objects, polylines, strict=True):
        assert (entry["layer"], entry["curve"]) == (curve.layer, curve.curve)
        for key, values in (("height", curve.heights), ("tangent", curve.tangents), ("width", curve.widths)):
            assert np.array_equal(entry[key], values)
            assert np.array_equal(json.loads(item.Attributes.GetUserString(key)), values)
        said = json.loads(item.Attributes.GetUserString("plane"))
        extended = polyline.get_xdata("TWINCELL")
        vectors = [tag.value for tag in extended if tag.code == 1010]
        for k, key in enumerate(("origin", "x_axis", "y_axis")):
            assert np.array_equal(said[key], getattr(curve.plane, key))
            assert np.array_equal(entry["plane"][key], getattr(curve.plane, key))
            assert np.array_equal(tuple(vectors[k]), getattr(curve.plane, key))
        assert [tag.value for tag in extended if tag.code == 1071] == [curve.layer, curve.curve]
        assert (
            model.Layers[item.Attributes.LayerIndex].Name == polyline.dxf.layer == f"layer_{curve.layer:04d}"
        )
        mine = rows[first : first + len(curve.points)]
        first += len(curve.points)
        assert {row["layer"] for row in mine} == {str(curve.layer)}
        assert np.array_equal([float(row["height"]) for row in mine], curve.heights)
        assert np.array_equal([float(row["width"]) for row in mine], curve.widths)
        for k, axis in enumerate("xyz"):
            assert np.array_equal([float(row[f"tangent_{axis}"]) for row in mine], curve.tangents[:, k])
            assert {float(row[f"x_axis_{axis}"]) for row in mine} == {float(curve.plane.x_axis[k])}


def test_dxf_curves_stay_within_the_chord(tmp_path):
    document = ezdxf.new("R2010")
    document.units = ezdxf.units.MM
    space = document.modelspace()
    space.add_circle((10, 20, 5), 30)
    space.add_arc((200, 0, 0), 25, 350, 80)
    space.add_circle((10, 20, 5), 12, dxfattribs={"extrusion": (0, 0, -1)})
    space.add_ellipse((-300, 0, 3), (40, 10, 0), 0.35)
    space.add_ellipse((-300, 200, 3), (0, 0, 30), 0.5, 0.5, 4.0, dxfattribs={"extrusion": (1, 0, 0)})
    control = np.array(
        [[0, 300, 0], [30, 380, 10], [60, 250, -20], [90, 330, 5], [120, 300, 40], [150, 310, 0]]
    )
    space.add_spline().control_points = control
    spline = space[-1]
    spline.dxf.degree, spline.knots = 3, [0, 0, 0, 0, 1, 3, 4, 4, 4, 4]
    space.add_lwpolyline(
        [(0, -200, 1), (50, -200, 0), (50, -150, -0.3), (0, -150, 0.6)], format="xyb", close=True
    )
    document.saveas(tmp_path / "a.dxf")
    curves = read_curves(tmp_path / "a.dxf", chord=CHORD)
    assert [c.closed for c in curves] == [True, False, True, True, False, False, True]
    follows(curves[0], ellipse((10, 20, 5), (30, 0, 0), (0, 30, 0)))
    follows(curves[1], ellipse((200, 0, 0), (25, 0, 0), (0, 25, 0), math.radians(-10), math.radians(80)))
    follows(curves[2], ellipse((-10, 20, -5), (12, 0, 0), (0, 12, 0)))
    minor = 0.35 * np.array([-10.0, 40.0, 0.0])
    follows(curves[3], ellipse((-300, 0, 3), (40, 10, 0), minor))
    follows(curves[4], ellipse((-300, 200, 3), (0, 0, 30), (0, -15, 0), 0.5, 4.0))
    exact = BSpline(np.array([0, 0, 0, 0, 1, 3, 4, 4, 4, 4.0]), control.astype(float), 3)(
        np.linspace(0, 4, 20001)
    )
    follows(curves[5], exact)
    follows(curves[5], exact)
    assert curves[6].closed


@pytest.mark.parametrize("extrusion", [(0, 0, 1), (0, 0, -1), (0.6, 0, 0.8)])
@pytest.mark.parametrize("closed", [True, False])
def test_bulges_are_the_arcs_that_ezdxf_explodes_them_to(tmp_path, extrusion, closed):
    corners = [(0, 0, 1), (50, 0, 0), (50, 60, -0.3), (10, 70, 2.5), (-40, 40, -1e-3), (-30, 10, 0)]
    document = ezdxf.new()
    document.units = ezdxf.units.MM
    polyline = document.modelspace().add_lwpolyline(
        corners, format="xyb", close=closed, dxfattribs={"extrusion": extrusion, "elevation": 7}
    )
    old = document.modelspace().add_polyline2d(corners, format="xyb", close=closed)
    old.dxf.extrusion, old.dxf.elevation = extrusion, (0, 0, 7)
    document.saveas(tmp_path / "a.dxf")
    parts = []
    for part in polyline.virtual_entities():
        parts += part.flattening(1e-4) if part.dxftype() == "ARC" else (part.dxf.start, part.dxf.end)
    drawn = np.array([place.xyz for place in parts])
    for curve in read_curves(tmp_path / "a.dxf", chord=CHORD):
        assert curve.closed == closed
        assert off(drawn, ring_of(curve)).max() <= CHORD + 1e-9
        assert off(curve.points, drawn).max() <= 1.1e-4


def test_blocks_stand_where_they_are_inserted(tmp_path):
    document = ezdxf.new()
    document.units = ezdxf.units.CM
    block = document.blocks.new("ring")
    block.add_circle((0, 0), 1)
    outer = document.blocks.new("pair")
    outer.add_blockref("ring", (0, 0), dxfattribs={"xscale": 3, "yscale": 2})
    outer.add_blockref("ring", (10, 0))
    document.modelspace().add_blockref("pair", (100, 50, 4), dxfattribs={"rotation": 90})
    document.modelspace().add_blockref("ring", (0, 0), dxfattribs={"column_count": 3, "column_spacing": 5})
    document.saveas(tmp_path / "a.dxf")
    curves = read_curves(tmp_path / "a.dxf", chord=CHORD)
    assert len(curves) == 5
    follows(curves[0], ellipse((1000, 500, 40), (0, 30, 0), (-20, 0, 0)))
    follows(curves[1], ellipse((1000, 600, 40), (10, 0, 0), (0, 10, 0)))
    for k, curve in enumerate(curves[2:]):
        follows(curve, ellipse((50 * k, 0, 0), (10, 0, 0), (0, 10, 0)))


def test_loose_pieces_are_joined_where_they_meet(tmp_path):
    document = ezdxf.new()
    document.units = ezdxf.units.MM
    space = document.modelspace()
    # A slot of two lines and two half circles, and an open chain, shuffled and turned about.
    parts = [
        lambda: space.add_line((0, 0), (50, 0)),
        lambda: space.add_arc((50, 10), 10, -90, 90),
        lambda: space.add_line((0, 20), (50, 20)),
        lambda: space.add_arc((0, 10), 10, 90, 270),
        lambda: space.add_line((100, 0, 5), (120, 0, 5)),
        lambda: space.add_line((120, 30, 5), (120, 0, 5)),
        lambda: space.add_line((120, 30, 5), (130, 40, 7)),
    ]
    random.Random(4).shuffle(parts)
    for part in parts:
        part()
    space.add_polyline3d([(130, 40, 7), (200, 0, 0), (210, 5, 5)])  # meets the chain, but has been joined
    document.saveas(tmp_path / "a.dxf")
    curves = read_curves(tmp_path / "a.dxf", chord=CHORD)
    assert len(curves) == 3
    slot = next(curve for curve in curves if curve.closed)
    axis = np.clip(slot.points[:, 0], 0, 50)
    assert np.allclose(np.hypot(slot.points[:, 0] - axis, slot.points[:, 1] - 10), 10)
    assert math.isclose(slot.length, 100 + 20 * math.pi, rel_tol=1e-3)
    chain = next(curve for curve in curves if len(curve.points) == 4)
    wanted = [[100, 0, 5], [120, 0, 5], [120, 30, 5], [130, 40, 7]]
    assert np.allclose(chain.points, wanted) or np.allclose(chain.points, wanted[::-1])
    space.add_line((120, 30, 5), (0, 300, 5))
    document.saveas(tmp_path / "b.dxf")
    with pytest.raises(FormatError, match=r"more than two ends meet at \(120, 30, 5\) mm"):
        read_curves(tmp_path / "b.dxf")


def test_ends_meet_within_the_distance_given(tmp_path):
    document = ezdxf.new()
    document.units = ezdxf.units.MM
    document.modelspace().add_line((0, 0), (50, 0))
    document.modelspace().add_line((50, 0.01), (90, 30))
    document.saveas(tmp_path / "a.dxf")
    assert len(read_curves(tmp_path / "a.dxf")) == 2
    (curve,) = read_curves(tmp_path / "a.dxf", join=0.02)
    assert len(curve.points) == 3


def test_what_is_hidden_is_left_out(tmp_path):
    document = ezdxf.new()
    document.units = ezdxf.units.MM
    document.layers.add("off").off()
    document.layers.add("frozen").freeze()
    for layer in ("0", "off", "frozen"):
        document.modelspace().add_circle((0, 0), 5, dxfattribs={"layer": layer})
    document.saveas(tmp_path / "a.dxf")
    assert len(read_curves(tmp_path / "a.dxf")) == 1
    model = rhino3dm.File3dm()
    hidden = rhino3dm.Layer()
    hidden.Name, hidden.Visible = "hidden", False
    index = model.Layers.Add(hidden)
    shown = rhino3dm.Layer()
    shown.Name = "shown"
    for layer in (model.Layers.Add(shown), index):
        attributes = rhino3dm.ObjectAttributes()
        attributes.LayerIndex = layer
        line = rhino3dm.LineCurve(rhino3dm.Point3d(layer, 0, 0), rhino3dm.Point3d(9, 9, 9))
        model.Objects.AddCurve(line, attributes)
    model.Write(str(tmp_path / "a.3dm"), 7)
    assert len(read_curves(tmp_path / "a.3dm")) == 1


def test_rhino_curves_stay_within_the_chord(tmp_path):
    tilted = rhino3dm.Plane(point(5, 6, 7), rhino3dm.Vector3d(1, 1, 1))
    circle = rhino3dm.Circle(30.0)
    circle.Plane = tilted
    axes = [np.array([v.X, v.Y, v.Z]) for v in (tilted.XAxis, tilted.YAxis)]
    arc = rhino3dm.Arc(point(100, 0, 0), point(120, 30, 10), point(150, 0, 0))
    control = [(0, 300, 0), (30, 380, 10), (60, 250, -20), (90, 330, 5), (120, 300, 40), (150, 310, 0)]
    spline = rhino3dm.NurbsCurve.Create(False, 3, [point(*p) for p in control])
    periodic = rhino3dm.NurbsCurve.Create(True, 3, [point(*p) for p in control])
    mixed = rhino3dm.PolyCurve()
    mixed.Append(rhino3dm.Line(point(0, -100, 0), point(40, -100, 0)))
    mixed.Append(rhino3dm.Arc(point(40, -100, 0), point(50, -90, 0), point(40, -80, 0)))
    mixed.Append(rhino3dm.Line(point(40, -80, 0), point(0, -100, 0)))
    drawn = [
        rhino3dm.ArcCurve.CreateFromCircle(circle),
        rhino3dm.ArcCurve.CreateFromArc(arc),
        spline,
        periodic,
        mixed,
    ]
    rhino_model(*drawn).Write(str(tmp_path / "a.3dm"), 7)
    curves = read_curves(tmp_path / "a.3dm", chord=CHORD)
    assert [curve.closed for curve in curves] == [True, False, False, True, True]
    follows(curves[0], ellipse((5, 6, 7), 30 * axes[0], 30 * axes[1]))
    for read, curve in zip(curves, drawn, strict=True):
        domain = curve.Domain
        places = [curve.PointAt(t) for t in np.linspace(domain.T0, domain.T1, 8001)]
        follows(read, [(p.X, p.Y, p.Z) for p in places], smooth=curve is not mixed)
    corner = curves[4].points
    for place in ((0, -100, 0), (40, -100, 0), (40, -80, 0)):
        assert np.linalg.norm(corner - place, axis=1).min() < 1e-12
    # The straight sides have no vertices inside.
    assert (np.abs(corner[:, 1] + 100) < 1e-9).sum() == 2


@pytest.mark.parametrize(
    ("unit", "mm"), [("Inches", 25.4), ("Meters", 1000.0), ("Feet", 304.8), ("Millimeters", 1.0)]
)
def test_rhino_units_are_read(tmp_path, unit, mm):
    line = rhino3dm.PolylineCurve([point(0, 0, 0), point(1, 2, 3), point(4, 4, 4)])
    circle = rhino3dm.ArcCurve.CreateFromCircle(rhino3dm.Circle(2.0))
    rhino_model(line, circle, unit=getattr(rhino3dm.UnitSystem, unit)).Write(str(tmp_path / "a.3dm"), 7)
    polyline, ring = read_curves(tmp_path / "a.3dm", chord=CHORD)
    assert np.allclose(polyline.points, mm * np.array([[0, 0, 0], [1, 2, 3], [4, 4, 4]]), rtol=1e-15)
    assert np.allclose(np.linalg.norm(ring.points, axis=1), 2 * mm)
    sides = np.linalg.norm(ring.points - np.roll(ring.points, 1, axis=0), axis=1)
    sagitta = 2 * mm - np.sqrt((2 * mm) ** 2 - (sides.max() / 2) ** 2)
    assert CHORD / 8 < sagitta <= CHORD


def test_rhino_blocks_stand_where_they_are_inserted(tmp_path):
    model = rhino_model(unit=rhino3dm.UnitSystem.Centimeters)
    ring = rhino3dm.ArcCurve.CreateFromCircle(rhino3dm.Circle(1.0))
    index = model.InstanceDefinitions.Add(
        "ring", "", "", "", point(0, 0, 0), (ring,), (rhino3dm.ObjectAttributes(),)
    )
    block = model.InstanceDefinitions.FindIndex(index)
    stretched = rhino3dm.Transform.Scale(rhino3dm.Plane.WorldXY(), 3.0, 2.0, 1.0)
    moved = rhino3dm.Transform.Translation(rhino3dm.Vector3d(5, 6, 7))
    placed = rhino3dm.Transform.Multiply(moved, stretched)
    reference = rhino3dm.InstanceReference(block.Id, placed)
    model.Objects.AddInstanceObject(reference, rhino3dm.ObjectAttributes())
    model.Write(str(tmp_path / "a.3dm"), 7)
    (curve,) = read_curves(tmp_path / "a.3dm", chord=CHORD)
    follows(curve, ellipse((50, 60, 70), (30, 0, 0), (0, 20, 0)))


def svg(tmp_path, inside, head='width="200mm" height="100mm" viewBox="0 0 200 100"'):
    (tmp_path / "a.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {head}>{inside}</svg>')
    return tmp_path / "a.svg"


def test_svg_curves_stay_within_the_chord(tmp_path):
    path = svg(
        tmp_path,
        """<g transform="translate(20 30) rotate(30) scale(2 1)" data-z="12.5"><circle cx="1" cy="2" r="9"/></g>
        <g transform="skewX(20)"><path d="M 50 40 A 15 8 25 0 1 70 60"/></g>
        <path d="M0 0 C 30 -40 60 50 80 0 Q 90 40 60 50 Z"/>
        <polyline points="0,0 1,1 2,0 3,5"/><rect x="1" y="2" width="10" height="5"/>
        <path d="m 10 10 h 5 v 5 z m 20 0 h 5 v 5"/>
        <g display="none"><circle r="4"/></g><defs><circle r="3"/></defs>""",
    )
    curves = read_curves(path, chord=CHORD, z=3.0)
    c, s, t = math.cos(math.pi / 6), math.sin(math.pi / 6), math.tan(math.radians(20))
    up = np.diag([1.0, -1.0, 1.0])
    turned = np.array([[2 * c, -s, 0], [2 * s, c, 0], [0, 0, 1.0]])
    middle = turned @ [1, 2, 0] + [20, 30, 12.5]
    follows(curves[0], ellipse(middle, turned @ [9, 0, 0], turned @ [0, 9, 0]) @ up)
    # The arc runs from (50, 40) to (70, 60) on an ellipse of radii 15 and 8, turned by 25°, before it is skewed.
    arc = curves[1].points @ up
    plain = arc - np.column_stack([t * arc[:, 1], 0 * arc[:, 0], 0 * arc[:, 0]])
    assert np.allclose(plain[[0, -1]], [[50, 40, 3], [70, 60, 3]])
    a = math.radians(25)
    x = plain[:, 0] * math.cos(a) + plain[:, 1] * math.sin(a)
    y = -plain[:, 0] * math.sin(a) + plain[:, 1] * math.cos(a)
    # The conic with fixed radii through all points: (x - p)² / 15² + (y - q)² / 8² = m, linear in p, q and the rest.
    A = np.column_stack([2 * x / 225, 2 * y / 64, np.ones(len(x))])
    p, q, rest = np.linalg.lstsq(A, x * x / 225 + y * y / 64, rcond=None)[0]
    assert np.abs(A @ [p, q, rest] - x * x / 225 - y * y / 64).max() < 1e-9
    scale = rest + p * p / 225 + q * q / 64
    least = (plain[-1] - plain[0])[:2] @ np.array([math.cos(a), math.sin(a)])
    across = (plain[-1] - plain[0])[:2] @ np.array([-math.sin(a), math.cos(a)])
    assert math.isclose(scale, max(1.0, (least / 30) ** 2 + (across / 16) ** 2), rel_tol=1e-9)
    u = np.linspace(0, 1, 10001)[:, None]
    cubic = BSpline([0, 0, 0, 0, 1, 1, 1, 1.0], np.array([[0, 0], [30, -40], [60, 50], [80, 0.0]]), 3)(
        u[:, 0]
    )
    quadratic = BSpline([0, 0, 0, 1, 1, 1.0], np.array([[80, 0], [90, 40], [60, 50.0]]), 2)(u[1:, 0])
    drawn = np.vstack([cubic, quadratic, (1 - u[1:]) * [60, 50]])
    follows(curves[2], np.column_stack([drawn, np.full(len(drawn), 3.0)]) @ up)
    assert np.allclose(curves[3].points, [[0, 0, 3], [1, -1, 3], [2, 0, 3], [3, -5, 3]])
    assert not curves[3].closed
    assert np.allclose(curves[4].points, [[1, -2, 3], [11, -2, 3], [11, -7, 3], [1, -7, 3]])
    assert curves[4].closed
    assert np.allclose(curves[5].points, [[10, -10, 3], [15, -10, 3], [15, -15, 3]])
    assert np.allclose(curves[6].points, [[30, -10, 3], [35, -10, 3], [35, -15, 3]])
    assert [curve.closed for curve in curves[5:]] == [True, False]


@pytest.mark.parametrize(
    ("head", "units", "mm"),
    [
        ('width="200mm" height="100mm" viewBox="0 0 200 100"', None, 1.0),
        ('width="200mm" height="100mm" viewBox="-50 -20 400 200"', None, 0.5),
        ('width="8in" viewBox="0 0 100 50"', None, 2.032),
        ('width="8in" viewBox="0 0 100 50"', "in", 2.032),
        ('width="20cm" height="10cm"', None, 25.4 / 96),
        ("", None, 25.4 / 96),
        ('viewBox="0 0 100 50"', None, 25.4 / 96),
        ('width="960" height="960px" viewBox="0 0 254 254"', None, 1.0),
        ('width="960" height="960px" viewBox="0 0 254 254"', "cm", 10.0),
        ('width="100%" viewBox="0 0 254 254"', "m", 1000.0),
        ('width="200mm" height="200mm" viewBox="0 0 200 100"', None, 1.0),
    ],
)
def test_svg_lengths_are_read(tmp_path, head, units, mm):
    path = svg(tmp_path, '<polyline points="0,0 10,0 30,20"/>', head)
    (curve,) = read_curves(path, units=units)
    assert np.allclose(curve.points, mm * np.array([[0, 0, 0], [10, 0, 0], [30, -20, 0]]), rtol=1e-11)


def test_tables_that_people_write_are_read(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("\ufeffName;Curve;Z;Y;X\n;b;1;2;3\n;a;0;0;0\n;b;1;2;4\n;b;1;9;4\n\n;a;0;0;5\n;b;1;2;3\n")
    first, second = read_curves(path, units="cm")
    assert first.closed
    assert first.points.tolist() == [[30, 20, 10], [40, 20, 10], [40, 90, 10]]
    assert not second.closed
    path = tmp_path / "a.json"
    path.write_text('[{"points": [[0, 0, 0], [1, 0, 0.5]], "width": 0.02, "note": "x"}]')
    (line,) = read_curves(path, units="m")
    assert line.points.tolist() == [[0, 0, 0], [1000, 0, 500]]
    assert line.widths.tolist() == [20, 20]
