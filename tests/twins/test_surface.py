import numpy as np
import pytest
import trimesh
from shapes import box, sphere, torus

from twins import (
    FormatError,
    SurfaceError,
    check_surface,
    make_surface,
    read_surface,
    repair_surface,
    signed_volume,
)


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "3mf"])
def test_formats_come_back_closed(tmp_path, suffix):
    path = tmp_path / f"part.{suffix}"
    trimesh.Trimesh(*(np.asarray(a) for a in (torus().vertices, torus().faces))).export(path)
    surface = read_surface(path)
    check_surface(surface)
    assert signed_volume(surface) == pytest.approx(signed_volume(torus()), rel=1e-5)


def test_holes_are_closed_and_named():
    good = sphere(subdivisions=3)
    middle = np.asarray(good.vertices)[np.asarray(good.faces)].mean(axis=1)
    kept = np.asarray(good.faces)[(middle[:, 2] < 280) & (middle[:, 0] < 130)]
    repaired, said = repair_surface(make_surface(good.vertices, kept))
    check_surface(repaired)
    assert len(said) == 2
    assert all("closed a hole of" in sentence for sentence in said)
    assert signed_volume(repaired) == pytest.approx(signed_volume(good), rel=0.05)


def test_repair_turns_and_says():
    good = box()
    flipped = np.asarray(good.faces).copy()
    flipped[3] = flipped[3][::-1]
    repaired, said = repair_surface(
        make_surface(good.vertices, np.vstack([flipped[:, ::-1], flipped[0][::-1]]))
    )
    check_surface(repaired)
    assert signed_volume(repaired) == pytest.approx(8e6)
    assert any("duplicate" in sentence for sentence in said)


def test_what_cannot_be_repaired_is_refused():
    one, two = box(), box()
    v = np.vstack([one.vertices, np.asarray(two.vertices) + [200.0, 200.0, 0.0]])
    f = np.vstack([one.faces, np.asarray(two.faces) + len(one.vertices)])
    touching = np.unique(v, axis=0, return_inverse=True)
    with pytest.raises(SurfaceError, match="not manifold: 1 edges"):
        repair_surface(make_surface(touching[0], touching[1].reshape(-1)[f]))


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("part.step", b"ISO-10303-21;", "unknown ending"),
        ("part.stl", b"", "part.stl"),
        ("part.obj", b"v 0 0 0\n", "part.obj"),
        ("part.ply", b"not a ply", "part.ply"),
        ("part.3mf", b"PK broken", "part.3mf"),
    ],
)
def test_unreadable_files_are_named(tmp_path, name, content, says):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(FormatError, match=says):
        read_surface(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FormatError, match="no such file"):
        read_surface(tmp_path / "none.stl")
