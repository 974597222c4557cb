import re

import meshio
import numpy as np
import pytest

from analysis import base_nodes, write_mesh
from analysis.tetrahedra import EDGES, signed_volumes
from twins import Plane


@pytest.fixture
def written(box_mesh, tmp_path):
    mesh = box_mesh((2, 3, 10), (20.0, 30.0, 50.0), layers=5)
    mesh = type(mesh)(
        mesh.points + [1234.567, -0.001, 0.0], mesh.tets, np.where(mesh.layer == 3, 4, mesh.layer)
    )
    base = base_nodes(mesh.points, Plane.horizontal(0.0), 0.1)
    return mesh, base, write_mesh(mesh, base, tmp_path)


def test_abaqus_has_every_element_in_exactly_one_layer_set(written):
    mesh, _, (*_, inp) = written
    read = meshio.read(inp)
    (block,) = read.cells
    assert block.type == "tetra10"
    sets = {name: members[0] for name, members in read.cell_sets.items()}
    layers = {name: members for name, members in sets.items() if name.startswith("LAYER_")}
    assert set(layers) == {
        "LAYER_1",
        "LAYER_2",
        "LAYER_3",
        "LAYER_5",
    }  # no set for the layer without elements
    assert np.array_equal(np.sort(np.concatenate(list(layers.values()))), np.arange(len(mesh.tets)))
    for name, members in layers.items():
        assert (mesh.layer[members] == int(name.removeprefix("LAYER_")) - 1).all()


def test_abaqus_elements_are_positive_with_straight_edges_and_the_right_volume(written):
    mesh, _, (*_, inp) = written
    read = meshio.read(inp)
    tets = read.cells[0].data
    assert signed_volumes(read.points, tets[:, :4]).min() > 0
    assert signed_volumes(read.points, tets[:, :4]).sum() == pytest.approx(20 * 30 * 50)
    corners = read.points[tets[:, :4]]
    assert read.points[tets[:, 4:]] == pytest.approx(corners[:, EDGES].mean(axis=2), abs=1e-8)
    assert read.points[: len(mesh.points)] == pytest.approx(mesh.points, abs=1e-8)


def test_abaqus_base_set_is_all_nodes_of_the_base(written):
    *_, (*_, inp) = written
    read = meshio.read(inp)
    assert np.array_equal(np.sort(read.point_sets["BASE"]), np.flatnonzero(np.abs(read.points[:, 2]) < 1e-9))


def test_abaqus_fields_fit_calculix_and_units_are_told(written):
    *_, (*_, inp) = written
    text = inp.read_text()
    assert re.search(r"^\*\* units: mm, N, MPa", text, flags=re.MULTILINE)
    lines = [line for line in text.splitlines() if not line.startswith("*")]
    assert max(len(field.strip()) for line in lines for field in line.split(",")) <= 20
    assert max(len(line.split(",")) for line in lines) <= 16
    assert max(map(len, lines)) <= 132


def test_gmsh_has_a_physical_group_per_layer_and_the_base(written):
    mesh, _, (_, msh, _) = written
    assert msh.read_text().splitlines()[1].startswith("2.2 0")
    read = meshio.read(msh)
    groups = {name: tuple(map(int, value)) for name, value in read.field_data.items()}
    assert {name: dimension for name, (_, dimension) in groups.items()} == {
        "BASE": 2, "LAYER_1": 3, "LAYER_2": 3, "LAYER_3": 3, "LAYER_5": 3,
    }  # fmt: skip
    physical = read.cell_data_dict["gmsh:physical"]
    assert np.array_equal(physical["tetra"], mesh.layer + 1)
    assert all(groups[f"LAYER_{k + 1}"][0] == k + 1 for k in mesh.layers)
    assert (physical["triangle"] == groups["BASE"][0]).all()
    a, b, c = (read.points[read.cells_dict["triangle"][:, k]] for k in range(3))
    areas = 0.5 * np.cross(b - a, c - a)
    assert areas.sum(axis=0) == pytest.approx([0, 0, -600.0], abs=1e-6)  # the whole base, facing down
    assert signed_volumes(read.points, read.cells_dict["tetra"]).min() > 0


def test_vtk_has_the_layer_of_each_element(written):
    mesh, _, (vtu, *_) = written
    read = meshio.read(vtu)
    layer = read.cell_data_dict["layer"]["tetra"]
    assert np.issubdtype(layer.dtype, np.integer)
    assert np.array_equal(layer, mesh.layer)
    assert np.array_equal(read.cells_dict["tetra"], mesh.tets)
    assert read.cell_data_dict["quality"]["tetra"] == pytest.approx(mesh.quality)
