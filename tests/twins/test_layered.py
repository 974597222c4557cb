"""Laws of the layered mesh: elements within layers, that fit together, well shaped, and fill the printed volume."""

import numpy as np
import pytest
import shapely
from shapes import REFERENCE, SHAPES, fan_top, printed_volume

from twins import Curve, Layer, Plane, Toolpath, ToolpathError, bead_outlines, layer_planes, slice_surface
from twins.layered import layered_mesh

BED = Plane.horizontal()
FACES = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]


def boundary_faces(mesh):
    faces = mesh.tets[:, FACES].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    assert count.max() <= 2
    return faces[first[count == 1]]


def check_layers(mesh, toolpath):
    floor = np.empty(mesh.tets.shape)
    top = np.empty(mesh.tets.shape)
    for i, layer in enumerate(toolpath.layers):
        rows = mesh.layer == i
        corners = mesh.points[mesh.tets[rows]].reshape(-1, 3)
        floor[rows] = toolpath.floor_of(i).height_of(corners).reshape(-1, 4)
        top[rows] = layer.nozzle.height_of(corners).reshape(-1, 4)
    assert floor.min() > -1e-6
    assert top.max() < 1e-6
    assert (floor.mean(axis=1) > 0.0).all()
    assert (top.mean(axis=1) < 0.0).all()


def check_fit(mesh):
    """No face in three elements, no crack of no width, every interface closed: the boundary has no border."""
    boundary = boundary_faces(mesh)
    _, place = np.unique(np.round(mesh.points, 7), axis=0, return_inverse=True)
    rows = np.sort(place.ravel()[boundary], axis=1)
    assert len(np.unique(rows, axis=0)) == len(rows)
    pairs = np.concatenate([boundary[:, [0, 1]], boundary[:, [1, 2]], boundary[:, [2, 0]]])
    out, back = (
        np.unique(pairs, axis=0, return_counts=True),
        np.unique(pairs[:, ::-1], axis=0, return_counts=True),
    )
    assert np.array_equal(out[0], back[0])
    assert np.array_equal(out[1], back[1])


def check_all(toolpath, width, median=0.6):
    mesh = layered_mesh(toolpath, width)
    check_layers(mesh, toolpath)
    check_fit(mesh)
    assert mesh.volumes.min() > 0.0
    quality = mesh.quality()
    assert quality.min() > 0.02
    assert np.median(quality) >= median
    expected = printed_volume(bead_outlines(toolpath, width, toolpath.thickness))
    assert mesh.volume == pytest.approx(expected, rel=0.01)
    return mesh


def sliced(surface, thickness=10.0, top=None):
    top = float(surface.vertices[:, 2].max()) if top is None else top
    return slice_surface(surface, layer_planes(BED, top, thickness))


def wall(layers, radius=60.0, sides=40):
    """Layers of one polygon, all alike: the flattest slabs there are."""
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    curve = Curve(radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    stack = [
        Layer(Plane.horizontal(10.0 * i + 5.0), Plane.horizontal(10.0 * (i + 1)), (curve,))
        for i in range(layers)
    ]
    return Toolpath(BED, tuple(stack), 10.0)


@pytest.mark.parametrize("width", [20.0, 25.0])
def test_a_wall_of_equal_layers_has_the_volume_of_its_ring(width):
    toolpath = wall(4)
    mesh = check_all(toolpath, width, median=0.6)
    ring = shapely.LinearRing(toolpath.layers[0].curves[0].points).buffer(width / 2.0)
    assert mesh.volume == pytest.approx(40.0 * ring.area, rel=0.01)
    assert set(mesh.layer) == {0, 1, 2, 3}


@pytest.mark.parametrize("name", ["spiral vase", pytest.param("porous column", marks=pytest.mark.soak)])
def test_bars_of_the_reference_shapes(name):
    check_all(sliced(REFERENCE[name]()), 20.0)


@pytest.mark.parametrize("width", [30.0])
@pytest.mark.parametrize("name", ["sphere", "torus standing"])
def test_wider_beads(name, width):
    check_all(sliced(SHAPES[name](), 15.0), 1.5 * width, median=0.6)


def test_layers_of_a_fan_lie_between_their_own_planes():
    surface = SHAPES["box"]()
    check_all(sliced(surface, top=fan_top(surface)), 20.0, median=0.6)


def test_a_single_layer_of_one_open_bead():
    bead = Curve(np.array([[0.0, 0.0], [60.0, 5.0], [120.0, 0.0]]), closed=False)
    toolpath = Toolpath(BED, (Layer(Plane.horizontal(5.0), Plane.horizontal(10.0), (bead,)),), 10.0)
    mesh = check_all(toolpath, 20.0, median=0.6)
    assert mesh.volume == pytest.approx(10.0 * shapely.LineString(bead.points).buffer(10.0).area, rel=0.02)


def test_elements_know_the_curve_they_belong_to():
    toolpath = sliced(SHAPES["Y-branch"]())
    mesh = layered_mesh(toolpath, 20.0)
    layer = int(np.argmax([len(layer.curves) for layer in toolpath.layers]))
    curves = toolpath.layers[layer].curves
    assert len(curves) > 1
    rows = np.flatnonzero(mesh.layer == layer)
    centroids = shapely.points(mesh.points[mesh.tets[rows]].mean(axis=1)[:, :2])
    distance = np.stack([shapely.distance(shapely.LinearRing(c.points), centroids) for c in curves])
    assert np.allclose(distance[mesh.curve[rows], np.arange(len(rows))], distance.min(axis=0), atol=1e-9)
    assert (mesh.curve < np.array([max(len(l.curves), 1) for l in toolpath.layers])[mesh.layer]).all()


def test_the_same_input_gives_the_same_mesh():
    one, two = (layered_mesh(wall(3), 20.0) for _ in range(2))
    assert np.array_equal(one.points, two.points)
    assert np.array_equal(one.tets, two.tets)


def test_bad_input_is_refused():
    with pytest.raises(ToolpathError, match="width"):
        layered_mesh(wall(2), -1.0)
    with pytest.raises(ToolpathError, match="no curves"):
        layered_mesh(Toolpath(BED, (Layer(BED, Plane.horizontal(10.0)),), 10.0), 20.0)
