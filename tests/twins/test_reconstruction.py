import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay
from shapes import SHAPES, fan_top, manifold_faults, sphere, torus

from twins import (
    Curve,
    Layer,
    Plane,
    Toolpath,
    ToolpathError,
    bead_outlines,
    extrude,
    layer_planes,
    reconstruct,
    signed_volume,
    slice_surface,
)

BED = Plane.horizontal()


def printed_volume(toolpath):
    """Σ region area × local thickness: the thickness of a layer between two planes is linear, so exact at centroids."""
    total = 0.0
    for i, _, layer, curve in toolpath.curves():
        centroid = layer.nozzle.to_world(curve.centroid[None])
        total += curve.signed_area * toolpath.floor_of(i).height_of(centroid)[0]
    return total


def stack(name, rotary, thickness=10.0):
    surface = SHAPES[name]()
    top = fan_top(surface) if rotary else float(surface.vertices[:, 2].max())
    return slice_surface(surface, layer_planes(BED, top, thickness))


@pytest.mark.parametrize("rotary", [False, True])
@pytest.mark.parametrize("name", SHAPES)
def test_M_is_a_closed_oriented_manifold_of_the_right_volume(name, rotary):
    toolpath = stack(name, rotary)
    surface = reconstruct(toolpath)
    assert manifold_faults(surface) == (0, 0)
    assert signed_volume(surface) == pytest.approx(printed_volume(toolpath), rel=0.02)


@pytest.mark.parametrize("width", [20.0, 30.0])
@pytest.mark.parametrize(
    ("name", "rotary"), [("torus standing", False), ("porous column", False), ("Y-branch", True)]
)
def test_M_prime_is_a_closed_oriented_manifold_of_the_right_volume(name, rotary, width):
    toolpath = stack(name, rotary)
    volume = extrude(toolpath, width)
    assert manifold_faults(volume) == (0, 0)
    beads = bead_outlines(toolpath, width, toolpath.thickness)
    assert signed_volume(volume) == pytest.approx(printed_volume(beads), rel=0.02)


@pytest.mark.parametrize(("surface", "chi"), [(sphere(), 2), (torus(), 0), (torus(standing=True), 0)])
def test_topology_of_simple_shapes_survives(surface, chi):
    planes = layer_planes(BED, float(surface.vertices[:, 2].max()), 10.0)
    assert reconstruct(slice_surface(surface, planes)).euler_number == chi


def test_slicing_M_gives_the_toolpath_back():
    toolpath = stack("torus lying", rotary=False)
    surface = reconstruct(toolpath)
    # Just above each slicing plane: M runs exactly through the curves there.
    from twins import custom_planes

    lifted = [Plane.horizontal(layer.slicing.origin[2] + 1e-7) for layer in toolpath.layers]
    planes = custom_planes(BED, lifted, [layer.nozzle for layer in toolpath.layers])
    from twins.slicing import cut

    for layer, polygons in zip(toolpath.layers, cut(surface, planes), strict=True):
        found = np.vstack(polygons)
        for curve in layer.curves:
            gap = np.linalg.norm(curve.points[:, None] - found[None], axis=2).min(axis=1)
            assert gap.max() < 1e-5


def test_slab_tetrahedra_are_a_general_delaunay_of_both_layers():
    """Of two convex regions with no cover of their own, every tetrahedron of the overlay is Delaunay."""
    from twins.overlay import slab_tetrahedra
    from twins.triangulation import triangulate

    rng = np.random.default_rng(3)

    def blob(seed, shift):
        angle = np.sort(np.random.default_rng(seed).uniform(0, 2 * np.pi, 60))
        radius = 40.0 + 4.0 * np.sin(3 * angle + seed)
        return shift + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])

    lower = triangulate([blob(1, rng.uniform(-3, 3, 2))], 4.0, 1, "layer 0")
    upper = triangulate([blob(2, rng.uniform(-3, 3, 2))], 4.0, 2, "layer 1")
    ours = {tuple(sorted(t)) for t in slab_tetrahedra(lower, upper, 4.0).tolist()}
    height = (
        0.01  # a flat slab: the tetrahedra of a Delaunay between two planes do not depend on their distance
    )
    points = np.vstack(
        [np.column_stack([r.jittered, np.full(len(r), z)]) for r, z in ((lower, 0.0), (upper, height))]
    )
    # Lifted by a bulge too small to matter, so that no four points of a plane are a face of the hull.
    square = (points[:, :2] ** 2).sum(axis=1)
    points[:, 2] += np.where(points[:, 2] > 0, -1, 1) * 1e-7 * square / square.max()
    everything = {tuple(sorted(t)) for t in Delaunay(points).simplices.tolist()}
    assert len(ours) > 200
    assert len(ours - everything) <= 0.01 * len(ours)


@st.composite
def curve_stacks(draw):
    count = draw(st.integers(1, 5))
    layers = []
    for k in range(count):
        curves = []
        for cx in draw(st.lists(st.sampled_from([-60.0, 0.0, 60.0]), max_size=3, unique=True)):
            n = draw(st.integers(6, 25))
            size = draw(st.floats(3.0, 22.0))
            wave = draw(st.floats(0.0, 0.3))
            angle = 2 * np.pi * np.arange(n) / n
            radius = size * (1 + wave * np.cos(3 * angle))
            ring = np.column_stack([np.cos(angle), np.sin(angle)])
            curves.append(Curve([cx, draw(st.floats(-10, 10))] + radius[:, None] * ring))
            if draw(st.booleans()):
                curves.append(Curve((curves[-1].points.mean(axis=0) + 0.4 * size * (1 - wave) * ring)[::-1]))
        layers.append(Layer(Plane.horizontal(10 * k + 5), Plane.horizontal(10 * k + 10), tuple(curves)))
    return Toolpath(BED, tuple(layers), 10.0)


@settings(max_examples=60, deadline=None)
@given(curve_stacks())
def test_any_stack_of_curves_gives_a_closed_manifold(toolpath):
    if not any(layer.curves for layer in toolpath.layers):
        with pytest.raises(ToolpathError, match="no curves"):
            reconstruct(toolpath)
        return
    surface = reconstruct(toolpath)
    assert manifold_faults(surface) == (0, 0)
    assert signed_volume(surface) > 0


def test_faulty_curves_are_refused_with_their_layer():
    def toolpath(*curves):
        return Toolpath(BED, (Layer(Plane.horizontal(5), Plane.horizontal(10), curves),), 10.0)

    ring = 30 * np.column_stack([np.cos(np.arange(12) / 2), np.sin(np.arange(12) / 2)])
    eight = np.array([[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]])
    with pytest.raises(ToolpathError, match="layer 0: curves touch or cross"):
        reconstruct(toolpath(Curve(eight)))
    with pytest.raises(ToolpathError, match="layer 0"):
        reconstruct(toolpath(Curve(ring[::-1])))
    with pytest.raises(ToolpathError, match="open curve"):
        reconstruct(toolpath(Curve(ring, closed=False)))
    with pytest.raises(ToolpathError, match="width"):
        extrude(toolpath(Curve(ring)), 0.0)
