import json

import meshio
import numpy as np
import pytest
import trimesh

from analysis import FeaSettings, MeshingError, export_fea, find_solver, solve
from analysis.fea import mesh_sizes
from planning import ConfigurationError
from planning.configuration import parse_table


@pytest.mark.skipif(find_solver() is None, reason="ccx is not installed")
def test_a_tube_from_surface_to_reactions(tube, parallel_path, mix, tmp_path):
    surface, stages = tube(side=40.0, wall=8.0, height=30.0), []
    report = export_fea(
        surface, parallel_path(6, 30.0), mix(), FeaSettings(time_limit_s=100), tmp_path / "fea", stages.append
    )
    assert report.layers == 6
    assert report.volume == pytest.approx(surface.volume, rel=0.02)
    assert {file.name for file in report.files} == {"mesh.vtu", "mesh.msh", "mesh.inp", "self_weight.inp"}
    assert all(file.is_file() for file in report.files)
    assert len(stages) == 3
    read = meshio.read(tmp_path / "fea" / "mesh.inp")
    sets = [members[0] for name, members in read.cell_sets.items() if name.startswith("LAYER_")]
    assert len(sets) == 6
    assert np.array_equal(np.sort(np.concatenate(sets)), np.arange(report.elements))
    values = json.loads(json.dumps(report.as_dict()))
    assert values["volume_mm3"] == pytest.approx(surface.volume, rel=0.02)

    result = solve(report.deck, time_limit_s=60)
    weight = surface.volume * 2070e-12 * 9810
    assert result.reaction[2] - result.base_weight[2] == pytest.approx(weight, rel=0.025)
    assert result.imbalance < 5e-3
    # The tube is a column: less than the closed form with its base free to spread, more than half of it.
    settled = 2070e-12 * 9810 * 30.0**2 / (2 * 0.078)
    assert 0.5 * settled < result.max_displacement < 1.5 * settled


def test_an_edge_too_long_for_the_layers_is_refused_by_name(tube, parallel_path, mix, tmp_path):
    with pytest.raises(
        MeshingError, match=r"printed layers get no element \(layers .*reduce the edge length"
    ):
        export_fea(
            tube(),
            parallel_path(600, 30.0),
            mix(),
            FeaSettings(edge=12.0, tolerance_mm=0.5),
            tmp_path / "fea",
        )
    assert not (tmp_path / "fea").exists()


def test_a_part_above_its_base_is_refused(tube, parallel_path, mix, tmp_path):
    surface = tube(height=10.0, rings=2)
    surface.apply_translation([0, 0, 5.0])
    with pytest.raises(MeshingError, match="does not stand"):
        export_fea(surface, parallel_path(1, 20.0), mix(), FeaSettings(edge=10.0), tmp_path)


@pytest.mark.parametrize(("stretch", "says"), [(np.nan, "not finite"), (0.0, "is flat"), (-1.0, "face out")])
@pytest.mark.parametrize("values", [{}, {"edge": 6.0, "tolerance_mm": 0.5}])
def test_sizes_of_a_broken_volume_do_not_hide_what_is_wrong(
    tube, parallel_path, mix, tmp_path, stretch, says, values
):
    whole = tube()
    surface = trimesh.Trimesh(whole.vertices * [1, 1, stretch], whole.faces, process=False)
    with pytest.raises(MeshingError, match=says):
        export_fea(surface, parallel_path(6, 30.0), mix(), FeaSettings(**values), tmp_path / "fea")


def test_sizes_follow_wall_and_layer_unless_given(tube, parallel_path):
    high = tube(height=4000.0)
    edge, tolerance = mesh_sizes(high, parallel_path(400, 4000.0), FeaSettings())
    assert edge == pytest.approx(0.75 * 8.0, rel=0.01)
    assert tolerance == pytest.approx(edge / 12)
    edge, _ = mesh_sizes(high, parallel_path(4000, 4000.0), FeaSettings())
    assert edge == pytest.approx(2.0)  # twice the layer thickness
    assert mesh_sizes(high, parallel_path(40, 4000.0), FeaSettings(edge=9.0, tolerance_mm=0.3)) == (9.0, 0.3)


@pytest.mark.parametrize(
    ("values", "says"),
    [({"egde": 5.0}, "did you mean 'edge'"), ({"edge": -1.0}, "edge"), ({"time_limit_s": 0}, "time_limit_s")],
)
def test_mistakes_in_the_table_are_told(values, says):
    with pytest.raises(ConfigurationError, match=says):
        parse_table(FeaSettings, values, "job.toml: [fea]")
