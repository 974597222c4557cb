"""Surfaces written: whole or not at all."""

import pytest
from shapes import box

from twins import FormatError, read_surface, write_surface
from twins.formats import writing

ENDINGS = ["stl", "ply", "obj", "3mf", "3dm", "glb", "gltf"]


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_folder_of_that_name_is_one_sentence_and_nothing_is_left(tmp_path, ending):
    path = tmp_path / f"part.{ending}"
    path.mkdir()
    with pytest.raises(FormatError, match=rf"part\.{ending}: cannot be written") as error:
        write_surface(box(), path)
    assert "\n" not in str(error.value)
    assert str(error.value).count(str(tmp_path)) == 1
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_was_there_is_replaced_whole(tmp_path, ending):
    path = tmp_path / f"part.{ending}"
    path.write_text("something else")
    write_surface(box(30.0, 20.0, 10.0), path)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert read_surface(path).extents == pytest.approx([30.0, 20.0, 10.0], rel=1e-6)


def test_a_disk_that_fills_up_leaves_what_was_there(tmp_path, monkeypatch):
    def fills(surface, path):
        path.write_bytes(b"half of")
        raise OSError(28, "No space left on device")

    path = tmp_path / "part.stl"
    path.write_text("before")
    monkeypatch.setitem(writing._WRITERS, ".stl", fills)
    with pytest.raises(FormatError, match=r"part\.stl: cannot be written: No space left on device"):
        write_surface(box(), path)
    assert [p.name for p in tmp_path.iterdir()] == ["part.stl"]
    assert path.read_text() == "before"
