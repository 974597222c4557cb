"""Curve files that are broken, or hold no curves: one sentence each, never a crash."""

import math
import random

import ezdxf
import pytest
import rhino3dm
from drawings import point, random_curves, rhino_model

from twins import FormatError
from twins.formats.curves import read_curves, save_curves
from twins.formats.guarded_3dm import open_guarded
from twins.wrapping.space_curve import SpaceCurve

GOOD = '{"unit": "mm", "curves": [{"points": [[0, 0, 0], [1, 0, 0], [1, 1, 0]], "closed": true}]}'

BAD_TEXT = {
    "unknown ending": ("a.iges", "x", "unknown ending '.iges'; curves are read from .dxf"),
    "DXF of noise": ("a.dxf", "no drawing at all", "DXF"),
    "DXF of random bytes": ("a.dxf", bytes(range(256)) * 20, "DXF"),
    "empty DXF": ("a.dxf", "", "is empty"),
    "SVG of noise": ("a.svg", "<svg", "cannot be read as SVG"),
    "other XML": ("a.svg", "<html><body/></html>", "is XML, but not SVG"),
    "SVG without curves": ("a.svg", '<svg xmlns="http://www.w3.org/2000/svg"/>', "holds no curves"),
    "SVG at no height": (
        "a.svg",
        '<svg xmlns="http://www.w3.org/2000/svg"><g data-z="high"><line x2="5"/></g></svg>',
        "line 0: data-z must be a height in mm, not 'high'",
    ),
    "SVG of no size": (
        "a.svg",
        '<svg xmlns="http://www.w3.org/2000/svg" width="20parsec" viewBox="0 0 1 1"><line x2="5"/></svg>',
        "unit 'parsec' is not known",
    ),
    "SVG of an empty box": (
        "a.svg",
        '<svg xmlns="http://www.w3.org/2000/svg" width="2mm" viewBox="0 0 0 0"><line x2="5"/></svg>',
        "its viewBox is empty",
    ),
    "SVG with a broken path": (
        "a.svg",
        '<svg xmlns="http://www.w3.org/2000/svg"><path d="M 0 0 L 5 x 3"/></svg>',
        "cannot be read as SVG: it is broken",
    ),
    "3DM of noise": ("a.3dm", "3D Geometry File Format " + "x" * 300, "cannot be read as 3DM"),
    "empty 3DM": ("a.3dm", "", "is empty"),
    "JSON of noise": ("a.json", "{", "is not JSON"),
    "JSON that is no text": ("a.json", b"\xff\xfe\x00", "is not text"),
    "JSON of another shape": ("a.json", '{"unit": "mm", "lines": []}', "holds no list of curves"),
    "JSON without curves": ("a.json", '{"unit": "mm", "curves": []}', "holds no curves"),
    "JSON without unit": ("a.json", GOOD.replace('"unit": "mm", ', ""), "does not say its unit"),
    "JSON in cubits": ("a.json", GOOD.replace('"mm"', '"cubit"'), "unit 'cubit' is not known"),
    "JSON of no unit": ("a.json", GOOD.replace('"mm"', "[1]"), r"unit \[1\] is not known"),
    "JSON of pairs": (
        "a.json",
        GOOD.replace(", 0]", "]"),
        r"curve 0: its points must be a list of \[x, y, z\]",
    ),
    "JSON ragged": ("a.json", GOOD.replace("[0, 0, 0]", "[0, 0]"), "curve 0: points holds something"),
    "JSON of words": ("a.json", GOOD.replace("[0, 0, 0]", '["a", 0, 0]'), "curve 0: points holds something"),
    "JSON of NaN": ("a.json", GOOD.replace("[0, 0, 0]", "[NaN, 0, 0]"), "NaN is no number"),
    "JSON of one point": (
        "a.json",
        '{"unit": "mm", "curves": [{"points": [[0, 0, 0]]}]}',
        "curve 0: has only 1",
    ),
    "JSON of no point": (
        "a.json",
        '{"unit": "mm", "curves": [{"points": []}]}',
        "curve 0: its points must be",
    ),
    "JSON closed line": (
        "a.json",
        GOOD.replace(", [1, 1, 0]", ""),
        "closed curve needs at least 3 points, not 2",
    ),
    "JSON closed maybe": (
        "a.json",
        GOOD.replace("true", '"maybe"'),
        "closed must be true or false, not 'maybe'",
    ),
    "JSON flat bead": ("a.json", GOOD.replace("true", 'true, "width": 0'), "widths must be above 0"),
    "JSON short widths": ("a.json", GOOD.replace("true", 'true, "width": [1]'), "for each of its 3 points"),
    "JSON far away": ("a.json", GOOD.replace("[0, 0, 0]", "[2e6, 0, 0]"), "within 1 km"),
    "JSON huge": (
        "a.json",
        GOOD.replace("[0, 0, 0]", "[1e999, 0, 0]"),
        "curve 0: has a coordinate that is not",
    ),
    "JSON curve of words": (
        "a.json",
        '{"unit": "mm", "curves": ["circle"]}',
        r"curve 0: must be a list of points \[x, y, z\]",
    ),
    "toolpath without layers": (
        "a.json",
        '{"format": "twincell-toolpath", "version": 1}',
        "key 'base' is missing",
    ),
    "CSV without header": (
        "a.csv",
        "0,1,2,3\n",
        "line 1 must name the columns .* curve, x, y, z are missing",
    ),
    "empty CSV": ("a.csv", "", "is empty"),
    "CSV without z": ("a.csv", "curve,x,y\n0,1,2\n", "z is missing"),
    "CSV of words": ("a.csv", "curve,x,y,z\n0,1,2,3\n0,1,two,3\n", "line 3: y must be a number, not 'two'"),
    "CSV of NaN": ("a.csv", "curve,x,y,z\n0,1,2,nan\n", "line 2: z must be a finite number, not 'nan'"),
    "CSV decimal commas": ("a.csv", "curve;x;y;z\n0;1,5;2;3\n", "line 2: x must be a number, not '1,5'"),
    "CSV short row": ("a.csv", "curve,x,y,z\n0,1,2\n", "line 2: has 3 cells, but line 1 names 4 columns"),
    "CSV of one point": ("a.csv", "curve,x,y,z\nrim,1,2,3\n", "curve rim: has only 1 point"),
    "CSV of no rows": ("a.csv", "curve,x,y,z\n", "holds no curves"),
    "CSV half closed": (
        "a.csv",
        "curve,x,y,z,closed\n0,1,2,3,yes\n0,1,2,4,no\n",
        "line 3: closed must be the same",
    ),
    "CSV half wide": (
        "a.csv",
        "curve,x,y,z,width\n0,1,2,3,5\n0,1,2,4,\n",
        "line 3: give a width at every point",
    ),
    "CSV that is no text": ("a.csv", b"\xff\xfe", "is not text"),
}


@pytest.mark.parametrize("case", BAD_TEXT)
def test_bad_files_are_told_in_one_sentence(tmp_path, case):
    name, text, said = BAD_TEXT[case]
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(FormatError, match=said) as told:
        read_curves(path)
    assert str(told.value).startswith(str(path))
    assert "\n" not in str(told.value)


def dxf(unit=4, draw=lambda space: space.add_circle((0, 0), 5)):
    def save(path):
        document = ezdxf.new()
        document.header["$INSUNITS"] = unit
        draw(document.modelspace())
        document.saveas(path)

    return save


def looped(space):
    block = space.doc.blocks.new("a")
    block.add_blockref("a", (1, 0))
    space.add_blockref("a", (0, 0))


def surface_model():
    model = rhino3dm.File3dm()
    model.Objects.AddSphere(rhino3dm.Sphere(point(0, 0, 0), 5.0))
    return model


def unlike_width():
    model = rhino3dm.File3dm()
    attributes = rhino3dm.ObjectAttributes()
    attributes.SetUserString("width", "wide")
    model.Objects.AddCurve(rhino3dm.PolylineCurve([point(0, 0, 0), point(1, 0, 0)]), attributes)
    return model


def rhino(model):
    return lambda path: model.Write(str(path), 7)


RING = rhino3dm.ArcCurve.CreateFromCircle(rhino3dm.Circle(5.0))

BAD_DRAWINGS = {
    "DXF without unit": ("a.dxf", dxf(0), {}, 'does not say its unit; give it, for example `units="mm"`'),
    "DXF in light years": ("a.dxf", dxf(19), {}, "unit '\\$INSUNITS 19' is not known"),
    "DXF contradicted": ("a.dxf", dxf(1), {"units": "mm"}, "is in in as the file itself says, not in mm"),
    "unknown unit": ("a.dxf", dxf(), {"units": "furlong"}, "unknown unit 'furlong'; choose one of um, mm"),
    "DXF of nothing": ("a.dxf", dxf(draw=lambda space: None), {}, "holds no curves"),
    "DXF of points": ("a.dxf", dxf(draw=lambda space: space.add_point((0, 0))), {}, "holds no curves"),
    "block in itself": ("a.dxf", dxf(draw=looped), {}, "block contains itself"),
    "circle of radius 0": (
        "a.dxf",
        dxf(draw=lambda space: space.add_circle((0, 0), 0)),
        {},
        "CIRCLE #.* on layer 0: has no length",
    ),
    "line doubled": (
        "a.dxf",
        dxf(draw=lambda space: [space.add_line((0, 0), (5, 0)), space.add_line((5, 0), (0, 0))]),
        {},
        "LINE .* is drawn twice, the other time as LINE",
    ),
    "one vertex": ("a.dxf", dxf(draw=lambda space: space.add_polyline3d([(1, 2, 3)])), {}, "only 1 point"),
    "chord 0": ("a.dxf", dxf(), {"chord": 0.0}, "chord tolerance must be above 0 mm"),
    "chord NaN": ("a.dxf", dxf(), {"chord": math.nan}, "chord tolerance must be above 0 mm"),
    "chord too fine": ("a.dxf", dxf(), {"chord": 1e-13}, "give a larger chord"),
    "join below 0": ("a.dxf", dxf(), {"join": -1.0}, "must not be below 0 mm"),
    "z NaN": ("a.dxf", dxf(), {"z": math.nan}, "height z of its curves must be a finite number"),
    "3DM of nothing": ("a.3dm", rhino(rhino3dm.File3dm()), {}, "holds no curves"),
    "3DM of surfaces": (
        "a.3dm",
        rhino(surface_model()),
        {},
        "holds no visible curves, only Brep|only Surface",
    ),
    "3DM without unit": (
        "a.3dm",
        rhino(rhino_model(RING, unit=getattr(rhino3dm.UnitSystem, "None"))),
        {},
        "does not say its unit",
    ),
    "3DM in parsecs": (
        "a.3dm",
        rhino(rhino_model(RING, unit=rhino3dm.UnitSystem.Parsecs)),
        {},
        "its unit is 'Parsecs'; change it to millimetres",
    ),
    "3DM contradicted": (
        "a.3dm",
        rhino(rhino_model(RING)),
        {"units": "m"},
        "is in mm as the file .* says, not in m",
    ),
    "3DM of words": (
        "a.3dm",
        rhino(unlike_width()),
        {},
        "user text width must be a list of numbers, not 'wide'",
    ),
}


@pytest.mark.parametrize("case", BAD_DRAWINGS)
def test_bad_drawings_are_told_in_one_sentence(tmp_path, case):
    name, save, options, said = BAD_DRAWINGS[case]
    save(tmp_path / name)
    with pytest.raises(FormatError, match=said) as told:
        read_curves(tmp_path / name, **options)
    assert str(told.value).startswith(str(tmp_path / name))
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("ending", ["dxf", "3dm", "json", "csv", "svg"])
def test_broken_files_are_refused_or_read_but_never_crash(tmp_path, ending):
    rng = random.Random(ending)
    path = tmp_path / f"a.{ending}"
    save_curves([SpaceCurve(c.points * [1, 1, 0], c.closed) for c in random_curves(5, 2)], path)
    whole = path.read_bytes()
    for _ in range(12):
        broken = bytearray(whole[: rng.randrange(len(whole))] if rng.random() < 0.5 else whole)
        for _ in range(rng.randrange(1, 9)):
            broken[rng.randrange(len(broken))] = rng.randrange(256)
        path.write_bytes(broken)
        try:
            assert read_curves(path)
        except FormatError as error:
            assert str(error).startswith(str(path))  # noqa: PT017 - either way is right


def test_a_3dm_file_that_takes_too_long_is_refused(tmp_path):
    path = tmp_path / "a.3dm"
    rhino_model(RING).Write(str(path), 7)
    assert len(open_guarded(path).Objects) == 1
    with pytest.raises(FormatError, match=r"a\.3dm: cannot be read as 3DM: reading it does not end"):
        open_guarded(path, patience=0.001)


def test_what_cannot_be_saved_is_told(tmp_path):
    curves = random_curves(6, 1)
    with pytest.raises(FormatError, match=r"no such file|No such file"):
        save_curves(curves, tmp_path / "nowhere" / "a.csv")
    with pytest.raises(FormatError, match=r"unknown ending '\.step'"):
        save_curves(curves, tmp_path / "a.step")
    with pytest.raises(FormatError, match="there are no curves to save"):
        save_curves([], tmp_path / "a.csv")
    with pytest.raises(
        FormatError, match=r"a\.svg: an SVG holds curves of one height each, but curve 0 rises by"
    ):
        save_curves(curves, tmp_path / "a.svg")
    assert not list(tmp_path.iterdir())
    with pytest.raises(FormatError, match="no such file"):
        read_curves(tmp_path / "a.csv")
