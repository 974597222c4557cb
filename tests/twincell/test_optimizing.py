"""Measuring and optimising a job from the command line."""

import json

import numpy as np
import pytest
import trimesh
from shapes import manifold_faults, sphere

from twins import load_toolpath, local_overhang


@pytest.fixture
def job(tmp_path, twincell):
    """A ball on its flattened foot, 120 mm wide."""
    ball = sphere(60.0)
    vertices = np.asarray(ball.vertices).copy()
    vertices[:, 2] = np.maximum(vertices[:, 2], 8.0)
    trimesh.Trimesh(vertices, np.asarray(ball.faces)).export(tmp_path / "ball.stl")
    assert twincell("new", tmp_path / "ball.stl", "-o", tmp_path / "job", "--thickness", 8)[0] == 0
    return tmp_path / "job"


def figures(result):
    code, out, err = result
    assert code == 0, err
    return json.loads(out)


def test_overhang_of_a_job_and_its_part_side_by_side(tmp_path, job, twincell):
    picture = tmp_path / "o.png"
    found = figures(twincell("overhang", job, job / "part.ply", "-o", picture, "--limit", 1.0, "--json"))
    ours, surface = found[str(job)], found[str(job / "part.ply")]
    exact = local_overhang(load_toolpath(job / "toolpath.json"))
    assert ours["largest"] == pytest.approx(exact.maximum, abs=1e-4)
    assert ours["share_above_limit"] == pytest.approx(exact.share_above(1.0), abs=1e-6)
    # Half of the ball leans out by more than 45°, on a cap of height R (1 - 1/√2) less the foot.
    assert surface["area_m2"] == pytest.approx(4 * np.pi * 0.06**2, rel=0.05)
    assert picture.stat().st_size > 10_000


def test_relaxing_the_part_keeps_what_was_there(job, twincell):
    before = (job / "part.ply").read_bytes()
    found = figures(twincell("optimize", "surface", job, "--limit", 40, "--json"))
    assert found["area_over_limit_after_m2"] < 0.3 * found["area_over_limit_before_m2"]
    assert (job / found["kept"]).read_bytes() == before
    part = trimesh.load(job / "part.ply", process=False)
    assert manifold_faults(part) == (0, 0)
    assert twincell("plan", job)[0] in (0, 1)
    assert len(load_toolpath(job / "toolpath.json").layers) > 5


def test_by_layer_the_build_direction_turns_with_rotary_layers(job, twincell):
    settings = job / "job.toml"
    text = settings.read_text()
    tilted = "top = { origin = [0.0, 0.0, 130.0], normal = [-0.3, 0.0, 1.0] }"
    settings.write_text(text.replace("[slicing]", f"[slicing]\n{tilted}"))
    words = ("optimize", "surface", job, "--limit", 40, "--json", "--by")
    found = {by: figures(twincell(*words, by)) for by in ("layer", "ground")}
    # What leans out by 40° from where the layers point at the ball's top leans out by more from the vertical.
    assert found["layer"]["area_over_limit_after_m2"] < 0.3 * found["layer"]["area_over_limit_before_m2"]
    assert found["ground"]["worst_before_deg"] > 41.0 > found["ground"]["worst_after_deg"]


def test_optimising_the_toolpath_leaves_twins_and_zones(tmp_path, job, twincell):
    twincell("slice", job)
    sliced = load_toolpath(job / "toolpath.json")
    trimesh.creation.box(bounds=[[0, -100, -1], [100, 100, 200]]).export(tmp_path / "zone.stl")
    words = ("optimize", "toolpath", job, "--min-radius", 45, "--protect", tmp_path / "zone.stl", "--json")
    found = figures(twincell(*words))
    assert found["largest_turn_after_deg"] <= found["largest_turn_before_deg"]
    after = load_toolpath(job / "toolpath.json")
    for old, new in zip(sliced.layers, after.layers, strict=True):
        for a, b in zip(old.curves, new.curves, strict=True):
            kept = a.points[a.points[:, 0] > 0.0]
            assert set(map(tuple, kept)) <= set(map(tuple, b.points))
    assert manifold_faults(trimesh.load(job / "surface.ply", process=False)) == (0, 0)
    assert twincell("plan", job)[0] in (0, 1)
    assert load_toolpath(job / "toolpath.json").length == after.length


def test_wrong_arguments_change_nothing(tmp_path, job, twincell, one_sentence):
    twincell("slice", job)
    before = {path.name: path.read_bytes() for path in job.iterdir() if path.is_file()}
    one_sentence(twincell("optimize", "surface", job, "--limit", 95), "part.ply", "95")
    one_sentence(twincell("optimize", "toolpath", job, "--min-distance", -3), "toolpath.json", "-3")
    one_sentence(
        twincell("optimize", "toolpath", job, "--protect", tmp_path / "none.stl"), "none.stl", "no such file"
    )
    one_sentence(twincell("overhang", tmp_path / "none.stl"), "none.stl", "no such file")
    assert {path.name: path.read_bytes() for path in job.iterdir() if path.is_file()} == before
