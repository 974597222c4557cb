"""Whatever goes wrong is answered by one sentence that names the place, and exit code 1."""

import os
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from shapes import box, sphere


def write(mesh, path):
    trimesh.Trimesh(np.asarray(mesh.vertices), np.asarray(mesh.faces), process=False).export(path)
    return path


@pytest.fixture
def job(tmp_path, twincell):
    write(box(80.0, 60.0, 40.0), tmp_path / "box.ply")
    assert twincell("new", tmp_path / "box.ply", "-o", tmp_path / "job")[0] == 0
    return tmp_path / "job"


def edit(job, old, new):
    path = job / "job.toml"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))


def test_parts_that_cannot_be_used(tmp_path, twincell, one_sentence):
    empty = tmp_path / "empty.stl"
    empty.write_bytes(b"\0" * 80 + b"\0\0\0\0")
    one_sentence(twincell("new", empty, "-o", tmp_path / "a"), "empty.stl")
    one_sentence(twincell("new", tmp_path / "none.stl", "-o", tmp_path / "a"), "none.stl: no such file")
    metres = write(box(0.2, 0.2, 0.3), tmp_path / "metres.ply")
    one_sentence(twincell("new", metres, "-o", tmp_path / "a"), "metres.ply", "0.3 mm", "--units m")
    one, two = box(), box()
    v = np.vstack([one.vertices, np.asarray(two.vertices) + [200.0, 200.0, 0.0]])
    f = np.vstack([one.faces, np.asarray(two.faces) + 8])
    points, index = np.unique(v, axis=0, return_inverse=True)
    write(trimesh.Trimesh(points, index.reshape(-1)[f], process=False), tmp_path / "pinched.ply")
    one_sentence(
        twincell("new", tmp_path / "pinched.ply", "-o", tmp_path / "a"), "pinched.ply", "not manifold"
    )
    assert not (tmp_path / "a").exists()
    assert twincell("new", metres, "-o", tmp_path / "a", "--units", "m")[0] == 0
    one_sentence(twincell("new", metres, "-o", tmp_path / "a", "--units", "m"), "already holds a job.toml")


def test_a_part_edited_by_hand(job, twincell, one_sentence):
    good = sphere(20.0, 3)
    below = trimesh.Trimesh(np.asarray(good.vertices) - [0, 0, 5.0], np.asarray(good.faces), process=False)
    write(below, job / "part.ply")
    one_sentence(twincell("plan", job), "part.ply", "5 mm below the bed")
    write(trimesh.Trimesh(good.vertices, np.asarray(good.faces)[:-2], process=False), job / "part.ply")
    one_sentence(twincell("slice", job), "part.ply", "the surface is open: 1 hole")
    (job / "part.ply").write_bytes(b"ply\nnonsense")
    one_sentence(twincell("slice", job), "part.ply")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("thickness = 10.0", "thicknes = 10.0", "did you mean 'thickness'"),
        ("thickness = 10.0", "", "key 'slicing.thickness' is missing"),
        ("thickness = 10.0", "thickness = -10.0", "slicing.thickness"),
        ("width = 20.0", 'width = "wide"', "print.width"),
        ('cell = "ur10e-demo"', 'cell = "ur99"', "ur10e-demo"),
        ('mix = "fresh-mortar"', "", "key 'mix' is missing"),
        ("[slicing]", "[slicing", "not valid TOML"),
        *(
            ("[print]", f"top = {{ origin = [{x}, 0.0, {z}], normal = [{tilt}, 0.0, {up}] }}\n[print]", says)
            for x, z, tilt, up, says in (
                (30.0, 0.0, 0.5, 1.0, "does not clear"),
                (0.0, -9.0, 0.1, 1.0, "below the bed"),
                (0.0, 45.0, 0.4, 1.0, "above the top plane"),
                (0.0, 45.0, 0.0, 0.0, "must not be zero"),
            )
        ),
    ],
)
def test_mistakes_in_the_job_file(job, twincell, one_sentence, old, new, says):
    edit(job, old, new)
    one_sentence(twincell("plan", job), says, str(job))
    assert not (job / "toolpath.json").exists()


def test_a_job_out_of_reach(job, tmp_path, twincell):
    cell = tmp_path / "far.toml"
    from planning.configuration import shipped_configurations

    shipped = (shipped_configurations() / "cells" / "ur10e-demo.toml").read_text()
    cell.write_text(shipped.replace("origin = [700.0", "origin = [1400.0"))
    edit(job, 'cell = "ur10e-demo"', f'cell = "{cell}"')
    code, out, _ = twincell("plan", job)
    assert code == 1
    assert "error: reach: waypoint" in out
    code, _, err = twincell("run", job, "--simulate")
    assert code == 1
    assert "not printable: error: reach" in err
    assert (job / "program.npz").exists()


def test_folders_without_a_job(tmp_path, twincell, one_sentence):
    for command in ("slice", "plan", "check", "run", "fea"):
        one_sentence(twincell(command, tmp_path), "no job.toml")
    (tmp_path / "notes.txt").write_text("mine")
    one_sentence(twincell("demo", "--out", tmp_path), "not empty")
    assert (tmp_path / "notes.txt").read_text() == "mine"
    one_sentence(twincell("reconstruct", tmp_path / "none.json"), "none.json: no such file")
    (tmp_path / "broken.json").write_text("{")
    one_sentence(twincell("reconstruct", tmp_path / "broken.json"), "broken.json")


def test_what_cannot_be_written_is_said(tmp_path, job, twincell, one_sentence):
    (tmp_path / "file").write_text("mine")
    part = tmp_path / "box.ply"
    one_sentence(twincell("new", part, "-o", tmp_path / "file"), "no folder can be made there")
    one_sentence(twincell("new", part, "-o", tmp_path / "file" / "job"), "no folder can be made there")
    one_sentence(twincell("demo", "--out", tmp_path / "file" / "job"), "cannot be read or written")


def test_run_before_plan(job, twincell, one_sentence):
    one_sentence(twincell("run", job), "no such program", "twincell plan")
    one_sentence(twincell("check", job), "no such program")


def test_wrong_words_are_usage(twincell):
    assert twincell("slize")[0] == 2
    assert twincell("run")[0] == 2


def test_a_foreign_package_of_the_same_name_is_named(tmp_path):
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot" / "__init__.py").write_text("")
    ended = subprocess.run(
        [sys.executable, "-c", "from twincell.__main__ import main; main()", "run", "job"],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        cwd=tmp_path,
        timeout=60,
    )
    assert ended.returncode == 1
    assert "environment of its own" in ended.stderr
    assert len(ended.stderr.splitlines()) == 1
