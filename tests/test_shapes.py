"""The reference shapes are what their definitions say."""

from functools import cache

import numpy as np
import pytest
import trimesh
from scipy.integrate import quad
from shapes import (
    EULER,
    REFERENCE,
    brick,
    fan_top,
    gyroid,
    manifold_faults,
    porous_column,
    rotated,
    schwarz_d,
    vase_radius,
    y_branch,
)

from twins import Plane, layer_planes, make_surface, signed_volume, slice_surface

BED = Plane.horizontal()
reference = cache(lambda name: REFERENCE[name]())


def trousers():
    legs = y_branch().apply_transform(trimesh.transformations.rotation_matrix(np.pi, [1, 0, 0], [0, 0, 165]))
    window = trimesh.creation.cylinder(25.0, 200.0, sections=96)
    window.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    return trimesh.boolean.difference([legs, window.apply_translation([0, 0, 180])], engine="manifold")


def sheet(minimal):
    """Share of a period in which |value| ≤ 0.35, on a lattice that no symmetry of the surface shares."""
    t = 2.0 * np.pi * (np.arange(97) + 0.31) / 97
    return (np.abs(minimal(*np.ix_(t, t, t))) <= 0.35).mean()


VOLUMES = {
    "sphere": lambda: 4 / 3 * np.pi * 150**3,
    "torus lying": lambda: 2 * np.pi**2 * 120 * 45**2,
    "torus standing": lambda: 2 * np.pi**2 * 120 * 45**2,
    "vase": lambda: (
        np.pi
        * quad(lambda z: vase_radius(z) ** 2 - (z > 20) * (vase_radius(z) - 12) ** 2, 0, 400, points=[20])[0]
    ),
    "spiral vase": lambda: np.pi * quad(lambda z: vase_radius(z) ** 2, 0, 400)[0],
    "Y-branch": lambda: signed_volume(y_branch()),
    "trousers with window": lambda: signed_volume(trousers()),
    "stepped box": lambda: 7 * 100**3,
    "nested cavity": lambda: 200**3 - 4 / 3 * np.pi * (60**3 - 25**3),
    "gyroid shell brick": lambda: 400**3 * sheet(gyroid),
    "Schwarz-D brick": lambda: 400**3 * sheet(schwarz_d),
    "porous column": lambda: signed_volume(porous_column()),
    # Pappus; the opening runs straight across.
    "springer": lambda: (180**2 - (4 - np.pi) * 30**2) * 900 * np.radians(28) - np.pi * 35 * 55 * 180,
    "layered tube": lambda: (500 + 420) * (500 - 420 + 4 * 0.75) * 300,  # 0.75: the mean of the bulge
}


@pytest.mark.parametrize("name", REFERENCE)
def test_a_reference_shape_is_a_closed_manifold_that_stands_on_the_bed(name):
    surface = reference(name)
    assert manifold_faults(surface) == (0, 0)
    assert surface.vertices[:, 2].min() == 0.0
    assert len(np.unique(surface.vertices, axis=0)) == len(surface.vertices)
    assert surface.area_faces.min() > 0.0


@pytest.mark.parametrize("name", REFERENCE)
def test_a_reference_shape_has_its_volume(name):
    faceted = name in {"Y-branch", "trousers with window", "porous column"}  # the compared mesh is coarse
    assert signed_volume(reference(name)) == pytest.approx(VOLUMES[name](), rel=0.012 if faceted else 0.005)


@pytest.mark.parametrize("name", EULER)
def test_a_reference_shape_has_its_topology(name):
    assert reference(name).euler_number == EULER[name]


@pytest.mark.parametrize(
    ("name", "minimal"), [("gyroid shell brick", gyroid), ("Schwarz-D brick", schwarz_d)]
)
def test_the_topology_of_a_brick_is_not_the_grids(name, minimal):
    assert reference(name).euler_number == brick(minimal, points=71).euler_number < -50


@pytest.mark.parametrize("name", REFERENCE)
def test_a_fan_covers_every_reference_shape(name):
    surface = reference(name)
    top = fan_top(surface)
    assert top.height_of(surface.vertices).max() < 1e-9
    layers = slice_surface(surface, layer_planes(BED, top, 10.0)).layers
    assert sum(len(layer.curves) for layer in layers) > 15


@pytest.mark.parametrize("seed", range(3))
def test_a_rotated_shape_stands_on_the_bed_and_is_congruent(seed):
    surface = reference("springer")
    turned = rotated(surface, seed)
    assert np.array_equal(turned.vertices, rotated(surface, seed).vertices)
    assert turned.bounds[0] == pytest.approx([*-turned.bounds[1, :2], 0.0], abs=1e-9)
    assert signed_volume(turned) == pytest.approx(signed_volume(surface))
    assert turned.edges_unique_length == pytest.approx(surface.edges_unique_length)
    assert slice_surface(turned, layer_planes(BED, fan_top(turned), 10.0)).layers


def test_manifold_faults_are_counted():
    corner = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])

    def faults(*faces):
        return manifold_faults(make_surface(np.zeros((7, 3)), np.vstack(faces)))

    assert faults(corner) == (0, 0)
    assert faults(corner[1:]) == (3, 3)
    assert faults(corner, np.array([0, 4, 5, 6])[corner]) == (0, 1)  # two bodies that share a vertex
    assert faults(corner, np.array([0, 1, 4, 5])[corner]) == (2, 2)  # an edge: both its directions
    assert faults(corner[1:], corner[:1, ::-1]) == (3, 3)
