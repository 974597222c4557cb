"""Curves in and out of a job by the formats of designers, from the command line."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import rhino3dm
import trimesh
from shapes import torus

from twins import load_toolpath, read_surface, unwrap


@pytest.fixture
def job(tmp_path, twincell):
    mesh = torus(R=60.0, r=25.0)
    trimesh.Trimesh(np.asarray(mesh.vertices), np.asarray(mesh.faces)).export(tmp_path / "torus.stl")
    assert twincell("new", tmp_path / "torus.stl", "-o", tmp_path / "job")[0] == 0
    assert twincell("slice", tmp_path / "job")[0] == 0
    return tmp_path / "job"


def assert_same(after, before):
    """Planes, thickness and curves, each curve from whichever point it begins at."""
    assert after.thickness == pytest.approx(before.thickness, abs=1e-6)
    assert len(after.layers) == len(before.layers)
    corners = np.array([[-90.0, -90.0], [90.0, -90.0], [0.0, 90.0]])
    planes = [(before.base, after.base)]
    for i, (a, b) in enumerate(zip(before.layers, after.layers, strict=True)):
        planes += [(a.slicing, b.slicing), (a.nozzle, b.nozzle)]
        left = [(b.nozzle.to_world(c.points), after.floor_of(i), b, c) for c in b.curves]
        assert len(left) == len(a.curves)
        for curve in a.curves:
            points = a.nozzle.to_world(curve.points)
            found = next(k for k, (p, *_) in enumerate(left) if same_loop(p, points))
            there, floor, layer, other = left.pop(found)
            assert other.closed == curve.closed
            heights = before.floor_of(i).height_of(points)
            first = np.linalg.norm(there - points[0], axis=1).argmin()
            assert np.allclose(np.roll(floor.height_of(there), -first), heights, atol=1e-6)
            assert np.allclose(
                layer.slicing.to_world(other.points)[first], a.slicing.to_world(curve.points)[0]
            )
    for a, b in planes:
        assert np.abs(b.height_of(a.to_world(corners))).max() < 1e-6
        assert a.normal @ b.normal > 0.0


def same_loop(found, points):
    if len(found) != len(points):
        return False
    first = np.linalg.norm(found - points[0], axis=1).argmin()
    return np.allclose(np.roll(found, -first, axis=0), points, atol=1e-6)


@pytest.mark.parametrize("ending", ["dxf", "csv", "json", "toolpath"])
@pytest.mark.parametrize("cusp", [None, 5.0])
def test_curves_go_out_and_come_back_as_the_same_layers(tmp_path, job, twincell, ending, cusp):
    if cusp is not None:
        settings = (job / "job.toml").read_text()
        (job / "job.toml").write_text(re.sub(r"(?m)^# ?cusp = .*$", f"cusp = {cusp}", settings))
        assert twincell("slice", job)[0] == 0
    before = load_toolpath(job / "toolpath.json")
    heights = [curve.heights.mean() for curve in unwrap(before)]
    assert (np.ptp(heights) > 1.0) == (cusp is not None)
    drawing, back = tmp_path / f"curves.{ending}", tmp_path / "back.json"
    if ending == "toolpath":
        drawing = job / "toolpath.json"
    else:
        assert twincell("export", job, "--what", "curves", "-o", drawing)[0] == 0
    code, out, err = twincell("wrap", drawing, "-o", back, "--json")
    assert code == 0, err
    said = json.loads(out)
    assert said["kind"] == "parallel"
    assert said["moved_up_mm"] == 0.0
    assert said["curves_with_nothing_directly_below"] == []
    assert_same(load_toolpath(back), before)
    if ending == "dxf":
        assert twincell("new", back, "-o", tmp_path / "again")[0] == 0
        assert twincell("plan", tmp_path / "again")[0] == 0


def rings(path, *heights, radius=50.0):
    angle = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    rows = [
        f"{k},{radius * np.cos(a)},{radius * np.sin(a)},{z}" for k, z in enumerate(heights) for a in angle
    ]
    path.write_text("\n".join(["curve,x,y,z", *rows]))
    return path


@pytest.mark.parametrize(
    ("heights", "options", "first", "up"),
    [
        ((3, 12, 21), (), 3.0, 0.0),  # on z = 0, as all curves lie above it
        ((3, 12, 21), ("--bed", "-4"), 7.0, 4.0),
        ((3, 12, 21), ("--thickness", "9"), 9.0, 6.0),
        ((30, 40, 50), (), 10.0, -20.0),  # far above z = 0: as thick as the second
        ((30, 40, 50), ("--bed", "0"), 30.0, 0.0),
        ((0, 8, 16), (), 8.0, 8.0),  # on z = 0 itself there is nothing to lie on
        ((7,), ("--bed", "0"), 7.0, 0.0),
    ],
)
def test_the_bed_is_where_it_is_said_to_be(tmp_path, twincell, heights, options, first, up):
    code, out, err = twincell(
        "wrap", rings(tmp_path / "a.csv", *heights), *options, "-o", tmp_path / "t.json", "--json"
    )
    assert code == 0, err
    said = json.loads(out)
    assert said["first_layer_mm"] == {"least": first, "greatest": first}
    assert said["moved_up_mm"] == up
    toolpath = load_toolpath(tmp_path / "t.json")
    assert toolpath.base.origin[2] == 0.0
    assert [layer.nozzle.origin[2] for layer in toolpath.layers] == pytest.approx([z + up for z in heights])


def test_layers_along_another_axis_stand_on_a_bed_across_it(tmp_path, twincell):
    lines = rings(tmp_path / "a.csv", 3, 12, 21).read_text().splitlines()
    turned = [lines[0], *(f"{k},{z},{x},{y}" for k, x, y, z in (line.split(",") for line in lines[1:]))]
    (tmp_path / "a.csv").write_text("\n".join(turned))
    for options, first in (((), 3.0), (("--bed", "1"), 2.0)):
        code, out, _ = twincell(
            "wrap", tmp_path / "a.csv", "--up", "x", *options, "-o", tmp_path / "t.json", "--json"
        )
        assert code == 0
        assert json.loads(out)["first_layer_mm"] == {"least": first, "greatest": first}
        base = load_toolpath(tmp_path / "t.json").base
        assert np.allclose(base.normal, [1.0, 0.0, 0.0])
        assert np.cross(base.x_axis, base.y_axis) @ base.normal > 0.0


def test_several_svgs_need_their_heights(tmp_path, twincell, one_sentence):
    files = [tmp_path / f"{name}.svg" for name in "abc"]
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="100mm" viewBox="0 0 100 100">'
    for k, file in enumerate(files):
        file.write_text(f'{head}<circle cx="50" cy="50" r="{40 - k}"/></svg>')
    out = ("-o", tmp_path / "t.json", "--json")
    one_sentence(twincell("wrap", *files, *out), "a.svg", "--z", "data-z")
    one_sentence(twincell("wrap", *files, "--z", "10", *out), "1 heights", "3 SVG")
    code, said, err = twincell("wrap", *files, "--z", "10", "--z", "30", "--z", "20", *out)
    assert code == 0, err
    assert json.loads(said)["layers"] == 3
    assert [layer.nozzle.origin[2] for layer in load_toolpath(tmp_path / "t.json").layers] == [10, 20, 30]
    for k, file in enumerate(files):
        file.write_text(f'{head}<circle cx="50" cy="50" r="{40 - k}" data-z="{5 * k + 5}"/></svg>')
    code, said, err = twincell("wrap", *files, *out)
    assert code == 0, err
    assert json.loads(said)["layers"] == 3


@pytest.mark.parametrize("what", ["volume", "beads"])
def test_surfaces_go_out(tmp_path, job, twincell, what):
    code, out, err = twincell("export", job, "--what", what, "-o", tmp_path / "m.obj", "--json")
    assert code == 0, err
    surface = read_surface(tmp_path / "m.obj")
    assert len(surface.faces) == json.loads(out)["triangles"]
    assert surface.is_watertight


def test_what_cannot_be_exchanged_is_said(tmp_path, job, twincell, one_sentence):
    one_sentence(twincell("export", job, "-o", tmp_path / "m.xyz"), "m.xyz", "ending")
    one_sentence(
        twincell("wrap", tmp_path / "none.dxf", "-o", tmp_path / "t.json"), "none.dxf", "no such file"
    )
    (tmp_path / "one.csv").write_text("curve,x,y,z\n0,0,0,5\n0,10,0,5\n0,10,10,5\n")
    one_sentence(twincell("wrap", tmp_path / "one.csv", "-o", tmp_path / "t.json"), "one.csv", "thickness")
    assert not Path(tmp_path / "t.json").exists()


def test_a_part_from_rhino_keeps_the_unit_of_its_file(tmp_path, twincell, one_sentence):
    box = rhino3dm.Mesh()
    corners = [(x, y, z) for x in (0.0, 0.3) for y in (0.0, 0.2) for z in (0.0, 0.1)]
    for corner in corners:
        box.Vertices.Add(*corner)
    for face in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)):
        box.Faces.AddFace(*face)
    model = rhino3dm.File3dm()
    model.Settings.ModelUnitSystem = rhino3dm.UnitSystem.Meters
    model.Objects.AddMesh(box)
    model.Write(str(tmp_path / "box.3dm"), 7)
    assert twincell("new", tmp_path / "box.3dm", "-o", tmp_path / "job")[0] == 0
    part = trimesh.load(tmp_path / "job" / "part.ply", process=False)
    assert part.extents == pytest.approx([300.0, 200.0, 100.0], rel=1e-6)
    one_sentence(
        twincell("new", tmp_path / "box.3dm", "-o", tmp_path / "other", "--units", "in"), "box.3dm", "in"
    )
    assert twincell("plan", tmp_path / "job")[0] == 0


def closed_rings(path, *heights, gaps=()):
    """Rings of 12 points that end where they begin, but for those in which so many last points are missing."""
    rows = rings(path, *heights).read_text().splitlines()
    head, by_ring = rows[0], [rows[1 + 12 * k : 13 + 12 * k] for k in range(len(heights))]
    missing = dict(gaps)
    ended = [[*ring, ring[0]][: 13 - missing.get(k, 0)] for k, ring in enumerate(by_ring)]
    path.write_text("\n".join([head, *(row for ring in ended for row in ring)]))
    return path


def test_open_curves_are_said_and_can_be_closed(tmp_path, twincell):
    out = tmp_path / "t.json"
    whole = closed_rings(tmp_path / "a.csv", 10, 20, 30)
    code, said, err = twincell("wrap", whole, "-o", out, "--json")
    assert (code, err) == (0, "")
    assert json.loads(said)["open_curves"] == 0
    # One side of a polygon of 12 corners is missing in the second ring, two in the third.
    closed_rings(whole, 10, 20, 30, gaps=[(1, 1), (2, 2)])
    sides = [2.0 * 50.0 * np.sin(np.pi / 12.0), 2.0 * 50.0 * np.sin(np.pi / 6.0)]
    code, said, err = twincell("wrap", whole, "-o", out, "--json")
    assert code == 0
    assert json.loads(said)["open_curves"] == 2
    assert f"2 of 3 curves are open (largest gap {sides[1]:.4g} mm)" in err
    within = float(err.split("--close-within")[1])
    assert sides[1] < within < 1.05 * sides[1]
    code, said, err = twincell("wrap", whole, "-o", out, "--close-within", within, "--json")
    assert (code, err) == (0, "")
    assert json.loads(said)["open_curves"] == 0
    assert all(curve.closed for *_, curve in load_toolpath(out).curves())


def test_open_walls_are_not_advised_to_close(tmp_path, twincell):
    rows = [f"{z},{x},{x**2 / 90},{z}" for z in (10, 20, 30) for x in (0, 30, 60, 90)]
    (tmp_path / "a.csv").write_text("\n".join(["curve,x,y,z", *rows]))
    code, _, err = twincell("wrap", tmp_path / "a.csv", "-o", tmp_path / "t.json")
    assert code == 0
    assert "3 of 3 curves are open" in err
    assert "--close-within" not in err


def test_the_summary_of_a_wrap_is_for_people(tmp_path, twincell):
    _, out, _ = twincell("wrap", closed_rings(tmp_path / "a.csv", 10, 20, 32), "-o", tmp_path / "t.json")
    said = dict(line.split(maxsplit=1) for line in out.splitlines())  # no row without a value
    assert said["local_height_mm"] == "10 to 12"
    assert said["first_layer_mm"] == "10"
    assert said["curves_of_a_layer"] == "1"
    assert said["moved_up_mm"] == "0"
    assert "curves_with_nothing_directly_below" not in said


def test_remedies_are_options(tmp_path, twincell, one_sentence):
    one = closed_rings(tmp_path / "a.csv", 10)
    one_sentence(twincell("wrap", one, "-o", tmp_path / "t.json"), "--bed", "--thickness")
    bent = closed_rings(tmp_path / "b.csv", 10, 20)
    bent.write_text(bent.read_text().replace(",10\n", ",10.4\n", 2))
    one_sentence(twincell("wrap", bent, "-o", tmp_path / "t.json"), "--tolerance")
    (tmp_path / "c.json").write_text("[[[0, 0, 5], [50, 0, 5], [50, 50, 5], [0, 50, 5], [0, 0, 5]]]")
    one_sentence(twincell("wrap", tmp_path / "c.json", "-o", tmp_path / "t.json"), "--units mm")
    words = ("wrap", tmp_path / "c.json", "--units", "cm", "--thickness", 10, "-o", tmp_path / "t.json")
    assert twincell(*words)[0] == 0
    (curve,) = (curve for *_, curve in load_toolpath(tmp_path / "t.json").curves())
    assert curve.closed
    assert curve.length == pytest.approx(4 * 500.0)
    open_ring = rings(tmp_path / "d.csv", 10, 20)
    assert twincell("wrap", open_ring, "-o", tmp_path / "t.json")[0] == 0
    one_sentence(
        twincell("reconstruct", tmp_path / "t.json", "-o", tmp_path / "m.ply"), "--close-within of wrap"
    )


def test_a_toolpath_is_json_and_nothing_else(tmp_path, twincell, one_sentence):
    one = closed_rings(tmp_path / "a.csv", 10, 20)
    one_sentence(twincell("wrap", one, "-o", tmp_path / "t.3dm"), "t.3dm", "t.json", "twincell export JOB")
    assert not (tmp_path / "t.3dm").exists()


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("e.csv", b"", "is empty"),
        ("e.stl", b"", "is empty"),
        ("r.stl", b"3D Geometry File Format ", "is 3DM by its content"),
        ("r.dxf", b"3D Geometry File Format ", "is 3DM by its content"),
        ("g.3dm", b"glTF\2\0\0\0", "is GLB by its content"),
        ("c.csv", b"curve;x;y;z\na;1,5;2;3\n", "decimal point"),
        ("d.csv", b"curve,x,y,z\na,1,5,2,0,3,0\n", "decimal points"),
        ("j.json", b'{"curves": [,]}', "line 1, column 13"),
    ],
)
def test_files_that_are_something_else(tmp_path, twincell, one_sentence, name, content, says):
    (tmp_path / name).write_bytes(content)
    command = "new" if name.endswith((".stl", ".3dm")) else "wrap"
    one_sentence(twincell(command, tmp_path / name, "-o", tmp_path / "o.json"), name, says)
    assert not (tmp_path / "o.json").exists()


def test_folders_are_not_files(tmp_path, twincell, one_sentence):
    for command in ("wrap", "new"):
        one_sentence(twincell(command, tmp_path, "-o", tmp_path / "o.json"), "is a folder")


@pytest.mark.parametrize("ending", ["ply", "stl", "obj", "3mf", "3dm", "glb"])
def test_reconstruct_writes_what_designers_open(tmp_path, twincell, ending):
    assert twincell("wrap", closed_rings(tmp_path / "a.csv", 10, 20), "-o", tmp_path / "t.json")[0] == 0
    out = tmp_path / f"m.{ending}"
    assert twincell("reconstruct", tmp_path / "t.json", "-o", out)[0] == 0
    surface = read_surface(out, unit=None)
    assert surface.is_watertight
    assert np.ptp(surface.vertices, axis=0)[2] == pytest.approx(20.0, abs=1e-4)
