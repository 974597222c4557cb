import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis import MeshingError, assign_layers, base_nodes
from twins import Curve, Layer, Plane, Toolpath

CURVE = Curve(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]))
SMALL = 1e-3 * np.array([[1.0, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1]])


def around(centroids):
    """A small tetrahedron around each of the given points."""
    points = (np.asarray(centroids)[:, None] + SMALL).reshape(-1, 3)
    return points, np.arange(len(points)).reshape(-1, 4)


def fan(count, sweep, radius, curves=()):
    """Planes that turn about the y axis at distance `radius` from the part, from horizontal up to `sweep`."""

    def plane(angle):
        along = np.array([np.cos(angle), 0.0, np.sin(angle)])
        return Plane(radius * along, along, np.array([0.0, 1.0, 0.0]))

    assert plane(sweep / 2).normal @ [-np.sin(sweep / 2), 0, np.cos(sweep / 2)] == pytest.approx(1)
    step = sweep / count
    layers = tuple(Layer(plane((k + 0.5) * step), plane((k + 1) * step), curves) for k in range(count))
    return Toolpath(plane(0.0), layers, radius * step)


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 50), st.floats(0.5, 20), st.lists(st.floats(-0.2, 1.2), min_size=1, max_size=60))
def test_between_parallel_planes_a_layer_is_the_height_over_the_thickness(count, t, shares):
    height = count * t
    z = np.array(shares) * height
    on_plane = np.abs(z / t - np.round(z / t)) < 1e-6
    layers = tuple(
        Layer(Plane.horizontal((k + 0.5) * t), Plane.horizontal((k + 1) * t)) for k in range(count)
    )
    points, tets = around(np.column_stack([np.zeros_like(z), np.zeros_like(z), z]))
    found = assign_layers(points, tets, Toolpath(Plane.horizontal(0.0), layers, t))
    expected = np.clip(np.floor(z / t), 0, count - 1)
    assert np.array_equal(found[~on_plane], expected[~on_plane])
    assert ((found >= 0) & (found < count)).all()


@pytest.mark.parametrize("sweep_deg", [10.0, 60.0, 85.0, 170.0])
def test_between_turning_planes_a_layer_is_the_angle_over_the_step(sweep_deg):
    rng = np.random.default_rng(1)
    sweep = np.radians(sweep_deg)
    angle = rng.uniform(0.0, sweep, 2000)
    r = rng.uniform(20.0, 300.0, 2000)
    centroids = np.column_stack([r * np.cos(angle), rng.uniform(-50, 50, 2000), r * np.sin(angle)])
    points, tets = around(centroids)
    found = assign_layers(points, tets, fan(20, sweep, 150.0))
    clear = np.abs(angle * 20 / sweep - np.round(angle * 20 / sweep)) > 1e-3
    assert np.array_equal(found[clear], np.floor(angle * 20 / sweep)[clear])


def test_turning_the_part_and_its_planes_together_changes_no_layer(parallel_path):
    rng = np.random.default_rng(2)
    path = parallel_path(9, 90.0, curves=())
    points, tets = around(rng.uniform([-20, -20, 0], [20, 20, 90], (500, 3)))
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))

    def turned(plane):
        return Plane(turn @ plane.origin, turn @ plane.x_axis, turn @ plane.y_axis)

    other = Toolpath(
        turned(path.base),
        tuple(Layer(turned(x.slicing), turned(x.nozzle)) for x in path.layers),
        path.thickness,
    )
    assert np.array_equal(assign_layers(points, tets, path), assign_layers(points @ turn.T, tets, other))


def test_layers_with_curves_need_an_element_and_those_without_do_not(parallel_path):
    points, tets = around([[0, 0, 1.0], [0, 0, 5.0]])
    with pytest.raises(
        MeshingError, match=r"1 of 3 printed layers get no element \(layers 1\); reduce the edge"
    ):
        assign_layers(points, tets, parallel_path(3, 6.0))
    path = parallel_path(3, 6.0)
    bare = Layer(path.layers[1].slicing, path.layers[1].nozzle)
    path = Toolpath(path.base, (path.layers[0], bare, path.layers[2]), 2.0)
    assert assign_layers(points, tets, path).tolist() == [0, 2]


def test_many_missing_layers_are_named_but_not_all(parallel_path):
    points, tets = around([[0, 0, 0.05]])
    with pytest.raises(MeshingError, match=r"99 of 100 .*layers 1, 2, 3, 4, 5, 6, 7, 8, …"):
        assign_layers(points, tets, parallel_path(100, 10.0))


def test_a_toolpath_without_layers_is_refused():
    with pytest.raises(MeshingError, match="no layers"):
        assign_layers(*around([[0, 0, 0]]), Toolpath(Plane.horizontal(0.0), (), 1.0))


def test_base_nodes_are_those_within_tolerance_of_the_base(box_mesh):
    mesh = box_mesh((3, 3, 4), (30.0, 30.0, 40.0))
    wobbly = mesh.points + 0.1 * np.random.default_rng(3).uniform(-1, 1, mesh.points.shape)
    assert np.array_equal(
        base_nodes(wobbly, Plane.horizontal(0.0), 0.2), np.flatnonzero(mesh.points[:, 2] == 0)
    )
    tilted = fan(1, 0.3, 100.0).layers[0].nozzle
    assert np.array_equal(
        base_nodes(tilted.to_world(mesh.points), tilted, 0.2), np.flatnonzero(mesh.points[:, 2] == 0)
    )


@pytest.mark.parametrize(
    "moved",
    [lambda p: p + [0, 0, 5.0], lambda p: p[p[:, 0] == 0], lambda p: p[:1]],
    ids=["above the base", "an edge", "a corner"],
)
def test_a_part_that_does_not_stand_on_the_base_is_refused(box_mesh, moved):
    points = moved(box_mesh((3, 3, 4), (30.0, 30.0, 40.0)).points)
    with pytest.raises(MeshingError, match="does not stand on the toolpath's base plane"):
        base_nodes(points, Plane.horizontal(0.0), 0.2)
