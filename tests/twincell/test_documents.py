"""What the documents tell a user to type works, in their order."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import rhino3dm
import trimesh
from shapes import manifold_faults

from planning import PlanningError, load_printer
from planning.scaled import scaled_model
from twins import Curve, Layer, Plane, Toolpath, read_surface

DOCUMENTS = Path(__file__).parents[2]


def blocks(document, language=""):
    """Code blocks of a document."""
    text = (DOCUMENTS / document).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def vase(path):
    """Eight sections of a vase, in Rhino's polylines, in mm."""
    turn = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    model = rhino3dm.File3dm()
    model.Settings.ModelUnitSystem = rhino3dm.UnitSystem.Millimeters
    for z in np.arange(10.0, 90.0, 10.0):
        radius = 80.0 + 8.0 * np.sin(z / 30.0)
        points = [(radius * np.cos(a), radius * np.sin(a), z) for a in turn]
        model.Objects.AddPolyline(rhino3dm.Polyline([rhino3dm.Point3d(*p) for p in [*points, points[0]]]))
    model.Write(str(path), 7)


def test_from_sections_in_rhino_and_back(tmp_path, monkeypatch, twincell):
    (block,) = [block for block in blocks("README.md") if "twincell wrap" in block]
    monkeypatch.chdir(tmp_path)
    vase(Path("sections.3dm"))
    for line in block.splitlines():
        program, *words = shlex.split(line, comments=True)
        assert program == ".venv/bin/twincell"
        code, _, err = twincell(*words)
        assert code == 0, (line, err)
    for name in ("vase.3dm", "printed.3dm"):
        surface = read_surface(name)
        assert manifold_faults(surface) == (0, 0)
        # From the bed to the last section.
        assert surface.bounds[:, 2] == pytest.approx([0.0, 80.0], abs=1e-6)
    curves = [thing.Geometry for thing in rhino3dm.File3dm.Read("curves.3dm").Objects]
    assert len(curves) == 8
    assert all(curve.IsClosed for curve in curves)


def test_scales_for_nozzles():
    """The scales that the table names are those that a nozzle prints, to the table's digits."""
    text = (DOCUMENTS / "docs" / "scaled-model.md").read_text(encoding="utf-8")
    table = re.findall(
        r"^\| ([\d.]+) \| 1:([\d.]+) to 1:([\d.]+) \| 1:([\d.]+) \| ([\d.]+) × ([\d.]+) \|",
        text,
        re.MULTILINE,
    )
    assert len(table) == 5
    square = [[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]]
    planes = [Plane.horizontal(z) for z in (5.0, 10.0, 15.0, 20.0)]
    layers = tuple(Layer(*planes[k : k + 2], (Curve(square),)) for k in (0, 2))
    toolpath = Toolpath(Plane.horizontal(), layers, 10.0)
    shipped = load_printer("cr10")
    for bore, largest, smallest, advised, *bead in ([float(cell) for cell in row] for row in table):
        nozzle = shipped.nozzle.model_copy(update={"diameter": bore})
        printer = shipped.model_copy(update={"nozzle": nozzle})
        for n in (largest, smallest):
            assert scaled_model(toolpath, printer, 1.0 / n, 20.0).beads
        for n in (0.98 * largest, 1.02 * smallest):
            with pytest.raises(PlanningError):
                scaled_model(toolpath, printer, 1.0 / n, 20.0)
        model = scaled_model(toolpath, printer, 1.0 / advised, 20.0)
        assert [*model.bead_width, *model.bead_height] == pytest.approx(
            [bead[0]] * 2 + [bead[1]] * 2, rel=0.01
        )


def test_shaping_in_python(tmp_path, monkeypatch):
    (block,) = blocks("docs/shaping.md", "python")
    monkeypatch.chdir(tmp_path)
    part = trimesh.creation.cylinder(60.0, height=200.0, sections=48)
    part.apply_translation((0.0, 0.0, 100.0))
    part.export("part.stl")
    exec(compile(block, "shaping.md", "exec"), {})
    whole = read_surface("low.stl").volume
    assert whole == pytest.approx(0.75 * part.volume, rel=1e-6)
    pieces = [read_surface(f"piece-{k}.3dm").volume for k in (0, 1)]
    assert sum(pieces) == pytest.approx(whole, rel=1e-6)
    assert read_surface("even.obj").volume == pytest.approx(whole, rel=0.02)
    assert Path("piece-1.json").exists()
