from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import trimesh
from shapes import SHAPES, box, torus

from twins import Curve, Plane, SurfaceError, ToolpathError, layer_planes, make_surface, slice_surface
from twins.assembly import BUNDLE
from twins.twin import Twin

BED = Plane.horizontal()


def twin_of(surface, thickness=10.0, **options):
    return Twin(surface, layer_planes(BED, float(surface.vertices[:, 2].max()), thickness), **options)


def same(one, two):
    return np.array_equal(one.vertices, two.vertices) and np.array_equal(one.faces, two.faces)


def shrunk(twin, layer, share=0.98):
    return [Curve(curve.points * share) for curve in twin.toolpath.layers[layer].curves]


def test_a_replaced_layer_gives_the_mesh_of_a_full_rebuild():
    twin = Twin.from_toolpath(twin_of(torus(standing=True)).toolpath)
    before = twin.surface
    twin.replace_layer(7, shrunk(twin, 7))
    twin.replace_layers({3: shrunk(twin, 3), 4: shrunk(twin, 4), 20: []})
    assert not same(twin.surface, before)
    assert same(twin.surface, Twin.from_toolpath(twin.toolpath).surface)


def test_edits_near_the_ends_of_bundles_and_after_refused_ones_give_the_mesh_of_a_full_rebuild():
    twin = Twin.from_toolpath(twin_of(SHAPES["nested cavity"]()).toolpath)
    assert len(twin.toolpath.layers) > BUNDLE + 1
    assert len(twin.mesh.joins)
    eight = Curve([[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]])
    for layer in (BUNDLE - 2, BUNDLE - 1, BUNDLE, 0, len(twin.toolpath.layers) - 1):
        with pytest.raises(ToolpathError):
            twin.replace_layers({layer: shrunk(twin, layer, 0.9), layer - 1 if layer else 1: [eight]})
        twin.replace_layer(layer, shrunk(twin, layer))
        assert same(twin.surface, Twin.from_toolpath(twin.toolpath).surface)


def test_layers_away_from_an_edit_keep_the_topology_of_the_surface():
    surface = SHAPES["porous column"]()
    twin = twin_of(surface)
    twin.replace_layer(2, shrunk(twin, 2, 0.999))
    assert twin.mesh.surface.euler_number == surface.euler_number


def test_the_twin_knows_which_side_was_edited_last():
    surface = torus()
    twin = twin_of(surface)
    assert twin.edited_last == "surface"
    assert same(twin.surface, surface)
    twin.replace_layer(1, shrunk(twin, 1))
    assert twin.edited_last == "toolpath"
    assert same(twin.surface, twin.mesh.surface)
    twin.replace_surface(surface)
    assert twin.edited_last == "surface"
    assert same(twin.surface, surface)
    assert same(twin.mesh.surface, twin_of(surface).mesh.surface)
    assert Twin.from_toolpath(twin.toolpath).edited_last == "toolpath"


def test_a_changed_surface_is_sliced_again_only_where_it_changed():
    surface = torus(standing=True)
    twin = twin_of(surface)
    layers = twin.toolpath.layers
    moved = np.array(surface.vertices)
    high = moved[:, 2] > 250.0
    moved[high, 0] *= 1.05
    changed = make_surface(moved, surface.faces)
    touched = twin.replace_surface(changed)
    assert 0 < len(touched) < 12
    for i, layer in enumerate(twin.toolpath.layers):
        assert (layer is layers[i]) == (i not in touched)
    whole = slice_surface(changed, layer_planes(BED, float(surface.vertices[:, 2].max()), 10.0))
    for mine, theirs in zip(twin.toolpath.layers, whole.layers, strict=True):
        for a, b in zip(mine.curves, theirs.curves, strict=True):
            assert np.array_equal(a.points, b.points)
    assert twin.replace_surface(make_surface(moved, surface.faces)) == frozenset()


def test_wrong_edits_change_nothing():
    twin = twin_of(torus())
    mesh = twin.mesh
    with pytest.raises(ToolpathError, match="no layer 99"):
        twin.replace_layer(99, [])
    eight = Curve([[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]])
    with pytest.raises(ToolpathError, match="layer 2"):
        twin.replace_layer(2, [eight])
    with pytest.raises(ToolpathError, match=r"layer 2.*open"):
        twin.replace_layer(2, [Curve([[0.0, 0.0], [10.0, 10.0]], closed=False)])
    assert twin.edited_last == "surface"
    assert twin.mesh is mesh
    with pytest.raises(ToolpathError, match="planes"):
        Twin.from_toolpath(twin.toolpath).replace_surface(torus())


def test_an_executor_gives_the_same_mesh():
    with ThreadPoolExecutor(2) as executor:
        side_by_side = twin_of(torus(standing=True), executor=executor).mesh.surface
    assert same(side_by_side, twin_of(torus(standing=True)).mesh.surface)


def test_a_surface_that_is_edited_in_place_is_seen_to_have_changed():
    twin = twin_of(torus(standing=True))
    edited = twin.surface
    edited.vertices = edited.vertices * [0.5, 0.5, 1.0]
    assert len(twin.replace_surface(edited)) == len(twin.toolpath.layers)
    assert same(twin.mesh.surface, twin_of(edited).mesh.surface)


def test_an_open_surface_is_refused_and_nothing_changes():
    surface = box()
    twin = twin_of(surface, 100.0)
    mesh = twin.mesh
    lid = np.asarray(surface.vertices)[np.asarray(surface.faces)][:, :, 2].min(axis=1) > 199.0
    with pytest.raises(SurfaceError, match="open"):
        twin.replace_surface(make_surface(surface.vertices, np.asarray(surface.faces)[~lid]))
    assert twin.mesh is mesh
    with pytest.raises(ToolpathError, match="Curve objects"):
        twin.replace_layer(0, [np.zeros((4, 2))])
    assert twin.mesh is mesh


def test_other_planes_bring_their_own_resolution():
    surface = torus()
    top = float(surface.vertices[:, 2].max())
    twin = twin_of(surface)
    twin.replace_surface(surface, layer_planes(BED, top, 3.0))
    fresh = twin_of(surface, 3.0)
    assert same(twin.mesh.surface, fresh.mesh.surface)


@pytest.mark.parametrize("lift", [0.0, -40.0])
def test_a_part_that_reaches_beyond_its_planes_is_cut_off_there(lift):
    """A tower with a window above the last plane, or below the base."""
    tower = trimesh.boolean.difference(
        [
            trimesh.creation.box(bounds=[[-20, -20, 0], [20, 20, 100]]),
            trimesh.creation.box(bounds=[[-50, -5, 10 if lift else 70], [50, 5, 20 if lift else 80]]),
        ],
        engine="manifold",
    )
    surface = make_surface(tower.vertices + [0.0, 0.0, lift], tower.faces)
    M = Twin(surface, layer_planes(BED, 50.0, 10.0)).mesh.surface
    assert M.is_watertight
    assert M.volume == pytest.approx(40 * 40 * 50, rel=1e-6)
    assert (M.bounds[0, 2], M.bounds[1, 2]) == pytest.approx((0.0, 50.0))
