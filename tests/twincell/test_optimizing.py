"""Measuring and optimising a job from the command line."""

import json

import numpy as np
import pytest
import trimesh
from shapes import manifold_faults, sphere

from twins import load_toolpath, local_overhang
from twins.curves.turning import curvature


@pytest.fixture
def job(tmp_path, twincell):
    """A ball on its flattened foot, 120 mm wide."""
    ball = sphere(60.0)
    vertices = np.asarray(ball.vertices).copy()
    vertices[:, 2] = np.maximum(vertices[:, 2], 8.0)
    trimesh.Trimesh(vertices, np.asarray(ball.faces)).export(tmp_path / "ball.stl")
    assert twincell("new", tmp_path / "ball.stl", "-o", tmp_path / "job", "--thickness", 8)[0] == 0
    return tmp_path / "job"


@pytest.fixture
def block(tmp_path, twincell):
    trimesh.creation.box((120.0, 100.0, 50.0)).export(tmp_path / "block.stl")
    assert twincell("new", tmp_path / "block.stl", "-o", tmp_path / "block")[0] == 0
    return tmp_path / "block"


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
    # A ball leans out by more than 45° below the height R (1 - 1/√2), of which the foot takes 8 mm.
    assert surface["area_m2"] == pytest.approx(4 * np.pi * 0.06**2, rel=0.05)
    over = surface["share_above_limit"] * surface["area_m2"]
    assert over >= 0.8 * 2 * np.pi * 0.06 * (0.06 * (1 - np.sqrt(0.5)) - 0.008)
    assert picture.stat().st_size > 10_000


def test_relaxing_the_part_keeps_what_was_there(job, twincell):
    before = (job / "part.ply").read_bytes()
    found = figures(twincell("optimize", "surface", job, "--limit", 40, "--json"))
    assert found["area_over_limit_after_m2"] < 0.3 * found["area_over_limit_before_m2"]
    assert (job / found["kept"]).read_bytes() == before
    part = trimesh.load(job / "part.ply", process=False)
    assert manifold_faults(part) == (0, 0)
    planned = figures(twincell("plan", job, "--json"))
    assert {f["severity"] for f in planned["findings"]} <= {"warning"}
    assert len(load_toolpath(job / "toolpath.json").layers) > 5


def test_where_there_is_nothing_to_better_no_file_is_touched(block, twincell):
    job = block
    assert twincell("slice", job)[0] == 0
    before = {path.name: path.read_bytes() for path in job.iterdir() if path.is_file()}
    assert figures(twincell("optimize", "surface", job, "--limit", 40, "--json"))["kept"] is None
    assert not figures(twincell("optimize", "toolpath", job, "--min-radius", 0, "--json"))["changed"]
    assert {path.name: path.read_bytes() for path in job.iterdir() if path.is_file()} == before


def test_zones_are_in_the_unit_of_the_part(tmp_path, job, twincell):
    def turned(size, unit):
        zone = tmp_path / f"{unit}.stl"
        trimesh.creation.box((size, size, size)).export(zone)
        settings = job / "job.toml"
        settings.write_text(settings.read_text().replace('units = "mm"', f'units = "{unit}"'))
        words = ("optimize", "toolpath", job, "--min-radius", 45, "--protect", zone, "--json")
        return figures(twincell(*words))

    part = trimesh.load(job / "part.ply", process=False)
    assert not turned(500.0, "mm")["changed"]
    part.apply_scale(1e-3)
    part.export(job / "part.ply", encoding="binary", vertex_normal=False)
    assert not turned(0.5, "m")["changed"]


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


def test_optimising_the_toolpath_leaves_twins_and_zones(tmp_path, block, twincell):
    twincell("slice", block)
    sliced = load_toolpath(block / "toolpath.json")
    trimesh.creation.box(bounds=[[0, -100, -1], [100, 100, 200]]).export(tmp_path / "zone.stl")
    words = ("optimize", "toolpath", block, "--min-radius", 15, "--protect", tmp_path / "zone.stl", "--json")
    assert figures(twincell(*words))["changed"]
    after = load_toolpath(block / "toolpath.json")
    for old, new in zip(sliced.layers, after.layers, strict=True):
        for a, b in zip(old.curves, new.curves, strict=True):
            assert curvature(a.points).max() > 0.1
            kept = a.points[a.points[:, 0] > 0.0]
            assert set(map(tuple, kept)) <= set(map(tuple, b.points))
            # Its two other corners are as round as was asked for.
            assert curvature(b.points)[b.points[:, 0] < -5.0].max() <= 1.0 / 15.0 * (1 + 1e-6)
    assert manifold_faults(trimesh.load(block / "surface.ply", process=False)) == (0, 0)
    figures(twincell("plan", block, "--json"))
    assert load_toolpath(block / "toolpath.json").length == after.length


def test_an_optimised_toolpath_is_kept_and_said_to_be_older_than_its_part(block, twincell):
    twincell("slice", block)
    before = (block / "toolpath.json").read_bytes()
    code, out, err = twincell("optimize", "toolpath", block, "--min-radius", 15, "--json")
    assert (code, err) == (0, "")
    assert (block / json.loads(out)["kept"]).read_bytes() == before
    assert not figures(twincell("plan", block, "--json"))["findings"]
    settings = block / "job.toml"
    settings.write_text(settings.read_text().replace("thickness = 10.0", "thickness = 12.5"))
    (finding,) = figures(twincell("plan", block, "--json"))["findings"]
    assert finding["kind"] == "toolpath"
    assert "twincell slice" in finding["remedy"]
    assert figures(twincell("check", block, "--json"))["findings"] == [finding]


def test_what_cannot_be_bettered_is_refused(tmp_path, block, twincell, one_sentence):
    one_sentence(twincell("optimize", "surface", block, "--lock-below", 500), "part.ply", "locked altogether")
    one_sentence(twincell("optimize", "surface", block, "--lock-above", "nan"), "--lock-above", "nan")
    one_sentence(
        twincell("optimize", "toolpath", block, "--min-radius", 0, "--min-distance", 0), "nothing to do"
    )
    for text in ("[[0, 0], [1, 0], [1, 1]]", '{"a": 1}', "[[[0, 0], [1]]]", '[["a", "b"]]'):
        (tmp_path / "zone.json").write_text(text)
        one_sentence(
            twincell("optimize", "toolpath", block, "--protect", tmp_path / "zone.json"), "zone.json"
        )
    twincell("slice", block)
    assert twincell("new", block / "toolpath.json", "-o", tmp_path / "other")[0] == 0
    one_sentence(twincell("optimize", "surface", tmp_path / "other"), "was made from a toolpath")
    for limit in (-1, 45, "nan"):
        one_sentence(twincell("overhang", block, "--limit", limit), "above 0 and below 20")
    one_sentence(twincell("overhang", block, "-o", tmp_path / "none" / "a.png"), "no folder")


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
