"""Curves in and out of a job by the formats of designers, from the command line."""

import json
from pathlib import Path

import numpy as np
import pytest
import rhino3dm
import trimesh
from shapes import torus

from twins import load_toolpath, read_surface


@pytest.fixture
def job(tmp_path, twincell):
    mesh = torus(R=60.0, r=25.0)
    trimesh.Trimesh(np.asarray(mesh.vertices), np.asarray(mesh.faces)).export(tmp_path / "torus.stl")
    assert twincell("new", tmp_path / "torus.stl", "-o", tmp_path / "job")[0] == 0
    assert twincell("slice", tmp_path / "job")[0] == 0
    return tmp_path / "job"


@pytest.mark.parametrize("ending", ["dxf", "csv"])
def test_curves_go_out_and_come_back_as_the_same_layers(tmp_path, job, twincell, ending):
    drawing, back = tmp_path / f"curves.{ending}", tmp_path / "back.json"
    assert twincell("export", job, "--what", "curves", "-o", drawing)[0] == 0
    code, out, err = twincell("wrap", drawing, "-o", back, "--json")
    assert code == 0, err
    assert json.loads(out)["kind"] == "parallel"
    before, after = load_toolpath(job / "toolpath.json"), load_toolpath(back)
    assert len(after.layers) == len(before.layers)
    for a, b in zip(before.layers, after.layers, strict=True):
        assert np.allclose(a.nozzle.origin[2], b.nozzle.origin[2], atol=1e-6)
        places = [
            np.sort(np.concatenate([layer.nozzle.to_world(c.points) for c in layer.curves]), axis=0)
            for layer in (a, b)
        ]
        assert np.allclose(*places, atol=1e-6)
    assert twincell("new", back, "-o", tmp_path / "again")[0] == 0
    assert twincell("plan", tmp_path / "again")[0] == 0


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
