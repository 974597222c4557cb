"""What `new` says of a file's size, unit and upright axis."""

import numpy as np
import pytest
import trimesh

from twincell.choices import Units
from twincell.new import UP, turn_up
from twins import read_surface
from twins.formats.lengths import MM


@pytest.fixture
def box(tmp_path):
    """A box that is longest along the file's z, in metres where the format is glTF."""

    def write(name, extents=(100.0, 200.0, 300.0)):
        trimesh.creation.box(extents).export(tmp_path / name)
        return tmp_path / name

    return write


def made_part(folder):
    return np.ptp(np.asarray(trimesh.load(folder / "part.ply", process=False).vertices), axis=0)


def test_size_and_unit_are_said(tmp_path, box, twincell):
    _, out, err = twincell("new", box("a.stl"), "-o", tmp_path / "a")
    assert "100 × 200 × 300 mm, read in mm (the file states no unit)" in out
    assert err == ""
    _, out, _ = twincell("new", box("b.stl", (4.0, 5.0, 10.0)), "-o", tmp_path / "b", "--units", "in")
    assert "101.6 × 127 × 254 mm, read in inches" in out
    _, out, _ = twincell("new", box("c.glb", (0.1, 0.2, 0.3)), "-o", tmp_path / "c")
    assert "read in m as the file states" in out
    _, out, _ = twincell("new", box("d.stl"), "-o", tmp_path / "d", "--longest", 150)
    assert "50 × 75 × 150 mm" not in out
    assert "50 × 100 × 150 mm" in out
    assert twincell("slice", tmp_path / "a")[0] == 0
    _, out, _ = twincell("new", tmp_path / "a" / "toolpath.json", "-o", tmp_path / "e")
    assert "30 layers, 100 × 200 × 300 mm" in out


@pytest.mark.parametrize(
    ("extents", "says"),
    [
        ((800.0, 200.0, 300.0), ["beyond the bed of ur10e-demo"]),
        ((200.0, 200.0, 700.0), ["beyond the bed of ur10e-demo"]),
        ((40.0, 200.0, 300.0), ["40 mm across, with beads of 20 mm"]),
        ((100.0, 200.0, 20.0), ["20 mm high, with layers of 10 mm"]),
        ((700.0, 700.0, 600.0), []),
    ],
)
def test_a_size_that_may_not_be_meant_is_said(tmp_path, box, twincell, extents, says):
    code, _, err = twincell("new", box("part.stl", extents), "-o", tmp_path / "job")
    assert code == 0
    assert len(err.splitlines()) == len(says)
    for text in says:
        assert text in err


def test_units_that_would_suit_are_proposed(tmp_path, box, twincell, one_sentence):
    small = box("small.stl", (0.1, 0.2, 0.3))
    one_sentence(twincell("new", small, "-o", tmp_path / "a"), "--units m (300 mm)", "--units ft (91.44 mm)")
    one_sentence(twincell("new", small, "-o", tmp_path / "a", "--units", "in"), "7.62 mm, read in inches")
    large = box("large.stl", (300.0, 200.0, 300.0))
    one_sentence(twincell("new", large, "-o", tmp_path / "a", "--units", "m"), "--units mm (300 mm)")


def test_the_axis_of_a_file_points_up_once(tmp_path, box, twincell):
    """glTF has y up by its standard, which its reader heeds: naming it changes nothing."""
    sizes = {}
    for name, extents in (("g.glb", (0.1, 0.2, 0.3)), ("s.stl", (100.0, 200.0, 300.0))):
        for up in ("", "x", "y", "z"):
            folder = tmp_path / f"job-{name}{up}"
            words = ["--up", up] if up else []
            assert twincell("new", box(name, extents), "-o", folder, *words)[0] == 0
            sizes[name, up] = made_part(folder)
            assert f"{up or ('y' if name == 'g.glb' else 'z')} up" in (folder / "job.toml").read_text()
    for name, ups in (("g.glb", "y"), ("s.stl", "z")):
        assert np.allclose(sizes[name, ""], sizes[name, ups])
        for up, height in (("x", 100.0), ("y", 200.0), ("z", 300.0)):
            assert sizes[name, up][2] == pytest.approx(height, rel=1e-6)


@pytest.mark.parametrize("name", ["p.stl", "p.glb"])
@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_turning_brings_the_axis_of_the_file_up(tmp_path, name, up):
    """A part is turned, never mirrored: of a corner with three arms that of the axis points up, the others lie."""
    lengths = {"x": 1.0, "y": 2.0, "z": 3.0}
    corners = np.vstack([np.zeros(3), np.diag(list(lengths.values()))])
    tetrahedron = trimesh.Trimesh(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], process=False)
    tetrahedron.export(tmp_path / name)
    read = np.asarray(read_surface(tmp_path / name).vertices)
    turn = turn_up(tmp_path / name, up)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    scale = 1000.0 if name == "p.glb" else 1.0  # metres
    assert np.sort((read @ turn.T)[:, 2]) == pytest.approx([0.0, 0.0, 0.0, scale * lengths[up]], abs=1e-3)


def test_all_units_can_be_named():
    assert {unit.value for unit in Units} == set(MM)
    assert all(np.allclose(turn @ turn.T, np.eye(3)) for turn in UP.values())
