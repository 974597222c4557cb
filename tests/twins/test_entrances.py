"""What is handed to a public function by mistake is named, and so is what to hand to it."""

import inspect
import pickle

import numpy as np
import pytest
import trimesh

import twins
from twins import Plane, Toolpath, layer_planes, slice_surface, union
from twins.entrances import checks_kinds

BOX = trimesh.creation.box((40.0, 40.0, 40.0))
PATH = slice_surface(BOX, layer_planes(Plane.horizontal(-20.0), 20.0, 10.0))
RESULT = union(PATH, PATH)
MESH = twins.toolpath_mesh(PATH)


def functions_of(kind):
    """Public functions whose first parameter is of a kind, with what their further parameters need."""
    for name in twins.__all__:
        function = getattr(twins, name)
        if inspect.isfunction(function):
            first = next(iter(inspect.signature(function).parameters.values()))
            if first.annotation == kind:
                yield name


OF_TOOLPATHS, OF_SURFACES = list(functions_of("Toolpath")), list(functions_of("trimesh.Trimesh"))


def call(name, given):
    """The function with the least that it needs; the first argument is looked at before all others."""
    function = getattr(twins, name)
    needed = [
        p
        for p in list(inspect.signature(function).parameters.values())[1:]
        if p.default is p.empty and p.kind not in {p.VAR_POSITIONAL, p.VAR_KEYWORD}
    ]
    others = {p.name: PATH if p.annotation == "Toolpath" else object() for p in needed}
    return function(given, **others)


def test_the_lists_are_not_empty():
    assert {"smooth", "union", "reconstruct", "save_toolpath"} <= set(OF_TOOLPATHS)
    assert {"slice_surface", "remesh", "check_surface"} <= set(OF_SURFACES)


@pytest.mark.parametrize("name", OF_TOOLPATHS)
@pytest.mark.parametrize(
    ("given", "says"),
    [
        (RESULT, r"not a BooleanResult; pass its \.toolpath"),
        (BOX, r"not a Trimesh; slice it first \(slice_surface\)"),
        ("part.json", r"not a str; read it first \(load_toolpath\)"),
        ([PATH, PATH], r"not a list; pass one of its items"),
        (None, r"not None$"),
        (3.0, r"not a float$"),
    ],
    ids=["result", "surface", "path", "list", "none", "number"],
)
def test_what_is_no_toolpath_is_named(name, given, says):
    with pytest.raises(TypeError, match=rf"^{name}: needs a Toolpath.*, {says}"):
        call(name, given)


@pytest.mark.parametrize("name", OF_SURFACES)
@pytest.mark.parametrize(
    ("given", "says"),
    [
        (PATH, r"not a Toolpath; reconstruct it first \(reconstruct\)"),
        (MESH, r"not a ToolpathMesh; pass its \.surface"),
        ("part.stl", r"not a str; read it first \(read_surface\)"),
    ],
    ids=["toolpath", "result", "path"],
)
def test_what_is_no_surface_is_named(name, given, says):
    with pytest.raises(TypeError, match=rf"^{name}: needs a Trimesh.*, {says}"):
        call(name, given)


def test_further_toolpaths_are_looked_at_and_named():
    with pytest.raises(TypeError, match=r"^union: needs a Toolpath as 'b', not a BooleanResult; pass its"):
        union(PATH, RESULT)
    with pytest.raises(TypeError, match=r"^union: needs a Toolpath as 'b'"):
        union(PATH, b=RESULT)
    with pytest.raises(TypeError, match=r"^join_layers: needs a Toolpath, not a BooleanResult"):
        twins.join_layers(PATH, PATH, RESULT)


def test_what_may_be_left_out_may_be_none_but_nothing_else():
    assert len(twins.reconstruct(PATH, None, None).faces)
    with pytest.raises(TypeError, match=r"^reconstruct: needs a Trimesh, not a Toolpath"):
        twins.reconstruct(PATH, surface=PATH)


def test_subclasses_count_and_functions_stay_what_they_are():
    class Own(Toolpath):
        pass

    own = Own(PATH.base, PATH.layers, PATH.thickness)
    assert twins.move(own, [1.0, 0.0, 0.0]).layers
    assert pickle.loads(pickle.dumps(twins.smooth)) is twins.smooth
    assert list(inspect.signature(twins.move).parameters) == ["toolpath", "by"]
    assert twins.smooth.__doc__


def test_a_missing_argument_is_left_to_python():
    @checks_kinds
    def length_of(toolpath: "Toolpath", times: float = 1.0) -> float:
        return times * toolpath.length

    assert length_of(toolpath=PATH, times=2.0) == pytest.approx(2.0 * PATH.length)
    with pytest.raises(TypeError, match="missing"):
        length_of()
    assert np.isfinite(length_of(PATH))
