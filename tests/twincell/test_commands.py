import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from shapes import manifold_faults, torus

from planning import Program
from twincell.cli import main
from twins import Curve, Twin, load_toolpath, save_toolpath, signed_volume


@pytest.fixture(scope="module")
def folder_of_all(tmp_path_factory):
    """A part and its job, made and planned once; tests work on copies."""
    folder = tmp_path_factory.mktemp("all")
    mesh = torus(R=60.0, r=25.0)
    trimesh.Trimesh(np.asarray(mesh.vertices), np.asarray(mesh.faces)).export(folder / "torus.stl")
    with pytest.MonkeyPatch.context() as patch:
        for words in (["new", folder / "torus.stl", "-o", folder / "job"], ["plan", folder / "job"]):
            patch.setattr(sys, "argv", ["twincell", *map(str, words)])
            with pytest.raises(SystemExit) as ended:
                main()
            assert not ended.value.code
    return folder


@pytest.fixture
def part(folder_of_all):
    return folder_of_all / "torus.stl"


@pytest.fixture
def job(tmp_path, folder_of_all):
    """A planned job of a test's own."""
    return Path(shutil.copytree(folder_of_all / "job", tmp_path / "job"))


def test_new_plan_check(tmp_path, part, twincell):
    job = tmp_path / "job"
    assert twincell("new", part, "-o", job)[0] == 0
    code, out, err = twincell("plan", job, "--json")
    assert (code, err) == (0, "")
    planned = json.loads(out)
    # The lower half of a lying torus hangs over more than fresh mortar takes, which keeps nobody from printing it.
    assert [(f["kind"], f["severity"]) for f in planned["findings"]] == [("overhang by ground", "warning")]
    assert twincell("check", job)[0] == 0
    summary = json.loads((job / "report" / "summary.json").read_text())
    program = Program.load(job / "program.npz")
    assert summary["layers"] == len(load_toolpath(job / "toolpath.json").layers) == 5
    assert summary["bead_volume_l"] == pytest.approx(program.bead_volume * 1e-6, abs=1e-6)
    assert summary["volume_of_m_prime_l"] == pytest.approx(summary["bead_volume_l"], rel=0.05)
    for name in ("surface.ply", "volume.ply"):
        assert manifold_faults(trimesh.load(job / name, process=False)) == (0, 0)
    for picture in ("layers", "height_and_flow", "joints"):
        assert (job / "report" / f"{picture}.png").stat().st_size > 10_000


def test_units_size_and_up_axis(tmp_path, part, twincell):
    assert twincell("new", part, "-o", tmp_path / "a", "--units", "in", "--longest", 120, "--up", "x")[0] == 0
    mesh = trimesh.load(tmp_path / "a" / "part.ply", process=False)
    size = np.ptp(np.asarray(mesh.vertices), axis=0)
    # The torus lies in the file, 170 × 170 × 50; with x up its flat axis z lies along the bed's y.
    assert size == pytest.approx([120.0, 120.0 * 50 / 170, 120.0], rel=1e-3)
    assert np.asarray(mesh.vertices)[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    assert mesh.volume > 0


def test_reconstruct_writes_the_surface(tmp_path, part, twincell):
    twincell("new", part, "-o", tmp_path / "job")
    assert twincell("slice", tmp_path / "job")[0] == 0
    out = tmp_path / "m.ply"
    assert twincell("reconstruct", tmp_path / "job" / "toolpath.json", "-o", out)[0] == 0
    assert out.read_bytes()[:3] == b"ply"
    assert manifold_faults(trimesh.load(out, process=False)) == (0, 0)


def test_a_stale_program_is_noticed(job, twincell, one_sentence):
    settings = job / "job.toml"
    settings.write_text(settings.read_text().replace("speed = 80.0", "speed = 60.0"))
    one_sentence(twincell("check", job), "print", "plan again")
    assert twincell("plan", job)[0] == 0
    assert twincell("check", job)[0] == 0


def test_a_failed_stage_leaves_the_job_as_it_was(job, twincell, one_sentence):
    before = {p.name: p.read_bytes() for p in job.iterdir() if p.is_file() and p.name != "job.toml"}
    settings = job / "job.toml"
    settings.write_text(settings.read_text().replace("# height = 300.0", "height = 20.0 #"))
    one_sentence(twincell("plan", job), "part.ply", "above the top plane")
    assert {p.name: p.read_bytes() for p in job.iterdir() if p.is_file() and p.name != "job.toml"} == before


def edit(job, layer, factor):
    """Scale the curves of one layer, as a user would."""
    twin = Twin.from_toolpath(load_toolpath(job / "toolpath.json"))
    curves = twin.toolpath.layers[layer].curves
    twin.replace_layer(layer, [Curve(factor * curve.points) for curve in curves])
    save_toolpath(twin.toolpath, job / "toolpath.json")
    return twin.toolpath


def test_an_edited_toolpath_is_printed_and_never_lost(job, twincell, caplog):
    before = trimesh.load(job / "surface.ply", process=False)
    edited = edit(job, 2, 0.9)
    written = (job / "toolpath.json").read_bytes()
    assert twincell("plan", job)[0] == 0
    assert "edited" in caplog.text
    assert (job / "toolpath.json").read_bytes() == written
    assert twincell("check", job)[0] == 0
    summary = json.loads((job / "report" / "summary.json").read_text())
    assert summary["path_length_m"] == pytest.approx(edited.length / 1000.0, abs=1e-4)
    after = trimesh.load(job / "surface.ply", process=False)
    assert manifold_faults(after) == (0, 0)
    assert after.volume < before.volume
    assert twincell("slice", job)[0] == 0
    assert (job / "toolpath-edited-1.json").read_bytes() == written
    assert np.array_equal(trimesh.load(job / "surface.ply", process=False).vertices, before.vertices)


def test_a_job_can_begin_with_a_toolpath(tmp_path, job, twincell, one_sentence, caplog):
    first, job = job, tmp_path / "second"
    assert twincell("new", first / "toolpath.json", "-o", job)[0] == 0
    assert not (job / "part.ply").exists()
    code, out, _ = twincell("plan", job, "--json")
    assert code == 0
    # Nobody has edited anything, and there is no part to relax: its surface can become one.
    assert not caplog.text
    (finding,) = json.loads(out)["findings"]
    assert finding["kind"] == "overhang by ground"
    assert f"twincell new {job / 'surface.ply'}" in finding["remedy"]
    assert twincell("check", job)[0] == 0
    assert signed_volume(trimesh.load(job / "surface.ply", process=False)) > 0
    one_sentence(twincell("slice", job), "made from a toolpath", f"twincell plan {job}")
    one_sentence(twincell("new", job / "toolpath.json", "-o", tmp_path / "c", "--longest", 10), "as it is")


def test_gcode_of_a_scaled_model(job, twincell, one_sentence):
    code, out, err = twincell("gcode", job, "--scale", 12.5, "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["layers"] == 5
    assert ";LAYER:4" in (job / "model.gcode").read_text()
    one_sentence(twincell("gcode", job, "--scale", 0), "--scale", "above 0")
    one_sentence(twincell("gcode", job, "--printer", "none"), "none")


def test_layers_are_thinner_where_the_part_is_flat(tmp_path, part, twincell):
    job = tmp_path / "job"
    twincell("new", part, "-o", job, "--thickness", 8)
    settings = job / "job.toml"
    settings.write_text(settings.read_text().replace("# cusp = 2.0", "cusp = 4.0"))
    assert twincell("plan", job)[0] == 0
    toolpath = load_toolpath(job / "toolpath.json")
    heights = np.diff([0.0, *(layer.nozzle.origin[2] for layer in toolpath.layers)])
    _, out, _ = twincell("slice", job, "--json")
    assert json.loads(out)["local_height_mm"] == pytest.approx(
        {"least": heights.min(), "greatest": heights.max()}, abs=1e-4
    )
    assert heights.sum() == pytest.approx(50.0, abs=1e-6)
    assert (heights >= 4.0 - 1e-9).all()
    assert (heights <= 12.0 + 1e-9).all()
    # A lying torus is steep halfway up, and flat above and below.
    middle = len(heights) // 2
    assert heights[middle] > 1.5 * max(heights[0], heights[-1])
    program = Program.load(job / "program.npz")
    printing = program.layer >= 0
    assert program.height[printing].min() < 5.0
    assert program.height[printing].max() > 8.0
