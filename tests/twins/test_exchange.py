import json

import numpy as np
import pytest
import trimesh
from shapes import fan_top, torus

from twins import (
    Curve,
    FormatError,
    Plane,
    ToolpathError,
    inputs_of,
    layer_planes,
    load_toolpath,
    save_surface,
    save_toolpath,
    slice_surface,
)


@pytest.fixture(scope="module")
def toolpath():
    return slice_surface(torus(), layer_planes(Plane.horizontal(), fan_top(torus()), 15.0))


def test_a_toolpath_comes_back_bit_for_bit(tmp_path, toolpath):
    path = tmp_path / "toolpath.json"
    save_toolpath(toolpath, path, {"part": "abc"})
    back = load_toolpath(path)
    assert back.thickness == toolpath.thickness
    for one, two in zip(toolpath.layers, back.layers, strict=True):
        np.testing.assert_allclose(one.nozzle.rotation, two.nozzle.rotation, atol=1e-15)
        for a, b in zip(one.curves, two.curves, strict=True):
            np.testing.assert_array_equal(a.points, b.points)
    assert inputs_of(path) == {"part": "abc"}
    assert not list(tmp_path.glob("*.partial"))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d.update(version=7), "version 7"),
        (lambda d: d.update(format="other"), "not a twincell-toolpath"),
        (lambda d: d["layers"][3]["nozzle"].pop("origin"), "layer 3: key 'origin'"),
        (lambda d: d["layers"][2]["curves"][0]["points"].append([1.0]), "layer 2, curve 0"),
        (
            lambda d: d["layers"][2]["curves"][0].update(points=[[0, 0], [1, 1]]),
            "layer 2, curve 0: .*at least 3",
        ),
        (lambda d: d.update(thickness=-1), "thickness"),
        (lambda d: d.pop("base"), "'base'"),
    ],
)
def test_damaged_files_are_answered_with_the_place(tmp_path, toolpath, change, says):
    path = tmp_path / "toolpath.json"
    save_toolpath(toolpath, path)
    values = json.loads(path.read_text())
    change(values)
    path.write_text(json.dumps(values))
    with pytest.raises(FormatError, match=says):
        load_toolpath(path)


def test_surfaces_keep_double_precision(tmp_path):
    surface = torus()
    save_surface(surface, tmp_path / "a.ply", ["a comment\nof two lines"])
    back = trimesh.load(tmp_path / "a.ply", process=False)
    np.testing.assert_array_equal(np.asarray(back.vertices), np.asarray(surface.vertices))
    np.testing.assert_array_equal(np.asarray(back.faces), np.asarray(surface.faces))


def test_curves_and_planes_are_frozen():
    curve = Curve(np.eye(3)[:, :2])
    with pytest.raises(ValueError, match="read-only"):
        curve.points[0, 0] = 5.0
    with pytest.raises(ToolpathError, match="not parallel"):
        Plane(np.zeros(3), np.array([1.0, 0, 0]), np.array([-2.0, 0, 0]))
