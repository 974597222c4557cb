"""The scaled model of a job."""

import numpy as np
import pytest
import trimesh
from gcodeparser import parse_gcode_lines

from planning import ConfigurationError, PlanningError
from planning.configuration import shipped_configurations
from twincell.errors import JobError
from twincell.job import load_job
from twincell.scaled_model import gcode_job
from twincell.stages import plan_job


@pytest.fixture
def job(tmp_path, twincell):
    trimesh.creation.box((300.0, 200.0, 50.0)).export(tmp_path / "block.stl")
    assert twincell("new", tmp_path / "block.stl", "-o", tmp_path / "job")[0] == 0
    return load_job(tmp_path / "job")


def moves(path):
    place, points = np.zeros(3), []
    for line in parse_gcode_lines(path.read_text().split(";LAYER:0", 1)[1]):
        if line.command_str in ("G0", "G1"):
            for k, axis in enumerate("XYZ"):
                place[k] = line.params.get(axis, place[k])
            if "X" in line.params and "E" in line.params:
                points.append(place.copy())
    return np.array(points)


def test_a_job_is_written_at_its_scale(job):
    told = gcode_job(job)
    path = job.folder / "model.gcode"
    assert told["file"] == str(path)
    assert told["scale"] == "1:12.5"
    assert told["needs"] == "a 1.5 mm nozzle: beads 1.6 mm wide, 0.8 mm high"
    assert f"; needs {told['needs']}\n" in path.read_text()
    points = moves(path)
    assert np.ptp(points, axis=0)[:2] == pytest.approx([24.0, 16.0], abs=1e-3)
    assert points[:, 2].max() == pytest.approx(4.0, abs=1e-3)
    assert points.mean(axis=0)[:2] == pytest.approx([150.0, 150.0], abs=1.0)
    assert told["size_mm"] == pytest.approx([24.0 + 1.6, 16.0 + 1.6, 4.0], abs=0.051)
    program, *_ = plan_job(job)
    assert told["model_volume_mm3"] == pytest.approx(program.bead_volume / 12.5**3, rel=0.005)
    assert told["filament_m"] == pytest.approx(
        told["model_volume_mm3"] / (np.pi / 4 * 1.75**2) / 1000, abs=1e-3
    )
    assert told["print_time_s"] >= told["layers"] * 10.0 * (1 - 1e-6)  # the printer's layer_time_min
    assert not list(job.folder.glob("*partial*"))


def test_scale_printer_width_and_file_are_options(tmp_path, job):
    text = (shipped_configurations() / "printers" / "klipper-300.toml").read_text()
    (job.folder / "mine.toml").write_text(text.replace("diameter = 1.5", "diameter = 0.8", 1))
    out = tmp_path / "small.gcode"
    told = gcode_job(job, scale=25.0, printer="mine", width=24.0, out=out)
    assert np.ptp(moves(out), axis=0)[:2] == pytest.approx([12.0, 8.0], abs=1e-3)
    assert told["size_mm"][0] == pytest.approx(12.0 + 24.0 / 25.0, abs=0.051)
    assert told["needs"] == "a 0.8 mm nozzle: beads 0.96 mm wide, 0.4 mm high"
    assert not (job.folder / "model.gcode").exists()


@pytest.mark.parametrize(
    ("options", "error", "says"),
    [
        ({"scale": 0.0}, JobError, "scale must be above 0"),
        ({"scale": float("nan")}, JobError, "scale must be above 0"),
        ({"scale": 40.0}, PlanningError, r"toolpath.json: .*choose a scale of at least 1:16.6 and at most"),
        ({"printer": "ender"}, ConfigurationError, "shipped printers: cr10"),
        ({"width": -1.0}, PlanningError, "bead width .* above 0"),
        ({"out": "nowhere/model.gcode"}, JobError, "nowhere/model.gcode: cannot be written"),
        ({"out": "job"}, JobError, "job: cannot be written"),
    ],
)
def test_refusals_are_one_sentence_and_write_nothing(tmp_path, job, options, error, says):
    if "out" in options:
        options = {"out": tmp_path / options["out"]}
    with pytest.raises(error, match=says) as raised:
        gcode_job(job, **options)
    assert "\n" not in str(raised.value)
    assert not list(tmp_path.rglob("*.gcode*"))
    assert not list(tmp_path.rglob("*partial*"))
