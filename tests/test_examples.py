"""The examples run, better what they say they better, and draw pictures."""

from __future__ import annotations

import importlib
import math
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from twins import check_surface, make_surface

EXAMPLES = Path(__file__).parents[1] / "examples"
SCRIPTS = sorted(
    path.stem
    for path in EXAMPLES.glob("*.py")
    if re.search(
        r"^def main\(out: Path, quick: bool = False\)", path.read_text(encoding="utf-8"), re.MULTILINE
    )
)


@pytest.fixture
def example(monkeypatch):
    """Modules of the examples' folder by name, as a script there imports them."""
    monkeypatch.syspath_prepend(str(EXAMPLES))
    return importlib.import_module


@pytest.mark.parametrize("script", SCRIPTS)
def test_example_runs_and_draws(script, example, tmp_path):
    figures = example(script).main(tmp_path, quick=True)
    assert all(math.isfinite(value) for value in figures.values())
    pictures = sorted(tmp_path.rglob("*.png"))
    assert pictures
    for picture in pictures:
        pixels = imread(picture)[..., :3]
        assert (pixels < 0.9).any(axis=2).mean() > 0.01, f"{picture.name} is blank"
        assert (np.ptp(pixels, axis=2) > 0.05).mean() > 1e-3, f"{picture.name} has no colour"
    CHECKS[script](figures)


def springer_is_better(figures):
    def ratio(what):
        before, after = figures[f"{what}, before"], figures[f"{what}, after"]
        assert before > 0.0
        return after / before

    assert ratio("area over 45°, cm²") < 0.1
    assert ratio("largest angle of overhang, °") < 0.9
    assert ratio("area with d/t > 1 by ground, %") < 0.1
    assert ratio("area with d/t > 1 by layer, %") < 0.5
    assert ratio("overfilled length, mm") < 0.1
    assert ratio("largest turning in 22 mm, °") < 0.9
    assert abs(figures["change of volume, %"]) < 6.0
    assert abs(figures["change of region area, %"]) < 3.0
    assert figures["largest displacement by relief, mm"] <= 22.0
    assert figures["rotary"] == 1.0
    assert figures["end layers unchanged"] == 1.0
    assert figures["layers"] > 10


def anchor_plates_hold(figures):
    turning = "largest turning in 20 mm, °"
    assert figures[f"{turning}, after"] < 0.5 * figures[f"{turning}, before"]
    assert figures["deepest point on the locked side, mm"] < 1e-6
    assert figures["holes and sills kept to the bit"] == figures["holes and sills"] > 0
    assert figures["largest |A∪B| + |A∩B| - |A| - |B|, mm²"] < 1e-6
    assert figures["bolt holes open in M'"] == 4
    assert figures["volume M' watertight"] == 1
    assert figures["largest overhang d/t, joint"] < figures["largest overhang d/t, united without sills"]


def sections_become_a_print(figures):
    assert figures["layers found"] == figures["sections"] == 4
    assert figures["Euler characteristic"] == 2
    assert figures["volume remeshed, l"] == pytest.approx(figures["volume of M, l"], rel=0.03)
    assert figures["layers sliced"] > 15


def node_is_an_assembly(figures):
    assert figures["parts"] == 4
    assert figures["Euler characteristic"] == 2
    assert figures["volume of its parts, l"] == pytest.approx(figures["volume of the node, l"], rel=0.005)
    assert figures["lowest point of a part, mm"] >= -1e-6
    # The node is a tube of radius 40 for most of its length, less what the sections' chords leave out.
    assert figures["volume of the node, l"] > 3.0


def slab_is_filled(figures):
    kinds = [figures[f"interior {kind}"] for kind in ("T31", "T22", "T13")]
    assert min(kinds) > 0
    assert sum(kinds) == figures["interior"] == figures["tetrahedra of the engine's slab"]
    assert sum(figures[f"f(T) = {f}"] for f in range(3)) == figures["tetrahedra"]
    assert figures["interior with f(T) = 0"] == figures["f(T) = 0"]
    # A region without holes has two triangles fewer to a curve than points, and all of them hold up a tetrahedron.
    assert figures["interior T31"] == figures["points below"] - 2 * figures["curves below"]
    assert figures["interior T13"] == figures["points above"] - 2 * figures["curves above"]
    # Slice and triangles of the layers close to a sphere: V - E + F = 2.
    faces = figures["faces of the slice"] + figures["interior T31"] + figures["interior T13"]
    assert faces == 2 * (figures["points below"] + figures["points above"]) - 4
    assert figures["volume of the interior, cm³"] == pytest.approx(figures["volume within the slice, cm³"])


def three_layers_become_a_print(figures):
    assert figures["layers"] == 3
    assert [figures[f"curves of layer {i}"] for i in range(3)] == [1, 1, 2]
    assert figures["M, M', M_vis watertight"] == 1
    assert figures["vertices of M"] >= figures["points of TP"]
    assert figures["vertices of M'"] >= figures["points of TP'"]
    assert figures["volume of M, l"] == pytest.approx(figures["volume of G, l"], rel=0.03)
    assert figures["volume of M', l"] == pytest.approx(figures["area of TP' times thickness, l"], rel=0.01)
    bead = figures["length of TP times width and thickness, l"]
    assert figures["volume of M', l"] <= bead
    # Both flanks are chords of half circles over the thickness of 10 mm; beads are 16 mm wide.
    assert 0.8 * bead < figures["volume of M_vis, l"] < bead * (1.0 - (1.0 - math.pi / 4.0) * 10.0 / 16.0)


def table_agrees(figures):
    parts = [name.removeprefix("layers, ") for name in figures if name.startswith("layers, ")]
    assert len(parts) == figures["parts"] == 5
    for part in parts:
        assert figures[f"layers, {part}"] > 8
        assert figures[f"largest layer height, {part}, mm"] <= 10.0 + 1e-9
        assert figures[f"vertices of M, {part}"] >= figures[f"vertices of TP, {part}"]
        assert figures[f"volume of M, {part}, l"] == pytest.approx(
            figures[f"volume of G, {part}, l"], rel=0.04
        )
        # Beads overlap in turns and where walls meet, and never print more than their length.
        bead = figures[f"length times width and thickness, {part}, l"]
        assert 0.85 * bead < figures[f"volume of M', {part}, l"] <= 1.01 * bead
        assert figures[f"seconds, {part}"] > 0.0
    for part in ("porous column", "branching springer", "gyroid brick", "porous panel"):
        assert figures[f"Euler characteristic of M, {part}"] == figures[f"Euler characteristic of G, {part}"]
    assert figures["Euler characteristic of G, porous column"] == -48  # 24 holes through the wall


def overfill_is_relieved(figures):
    assert figures["points within d_min of P_i"] > 2
    assert figures["difference to the engine's g_i / s_2, mm"] < 1e-9
    assert figures["overfilled length, before, mm"] > 20.0
    assert figures["overfilled length, after, mm"] == 0.0
    assert figures["least spacing, after, mm"] >= 0.95 * 20.0 > figures["least spacing, before, mm"]
    assert figures["least spacing, one step, s_2 = 0.5, mm"] < 0.95 * 20.0
    turning = "largest turning in 20 mm"
    assert figures[f"{turning}, after, °"] < figures[f"{turning}, one step, s_2 = 1, °"]
    assert figures["largest displacement, mm"] <= 20.0


def spindle_draws_normals(figures):
    assert figures["normals beyond θ, % of the area, before"] > 5.0
    assert (
        figures["normals beyond θ, % of the area, after"]
        < 0.3 * figures["normals beyond θ, % of the area, before"]
    )
    stands_as_before(figures, "")


def overhang_is_relaxed(figures):
    for name in ("porous column", "gyroid unit"):
        before, after = (figures[f"area over θ, cm², {stage}, {name}"] for stage in ("before", "after"))
        assert before > 0.0
        assert after <= 0.25 * before
        stands_as_before(figures, f", {name}")


def stands_as_before(figures, of):
    assert figures[f"locked vertices kept to the bit{of}"] == figures[f"locked vertices{of}"] > 0
    assert figures[f"Euler characteristic, after{of}"] == figures[f"Euler characteristic, before{of}"]
    assert abs(figures[f"change of volume, %{of}"]) < 6.0
    assert figures[f"faces turned over{of}"] == 0


def smoothing_keeps_its_side(figures):
    cases = [
        name.partition("after, ")[2] for name in figures if name.startswith("curvature over κ_max, after")
    ]
    assert len(cases) == 4
    for case in cases:
        assert figures[f"curvature over κ_max, before, {case}"] > 1.0
        assert figures[f"curvature over κ_max, after, {case}"] <= 1.0 + 1e-9
        assert figures[f"deepest on the locked side, mm, {case}"] < 1e-6
    # The gentler the bend, the farther the curve gets from where it was.
    ways = [figures[f"largest displacement, mm, right permitted, {radius} mm"] for radius in (5, 10, 20)]
    assert ways == sorted(ways)
    assert figures["one step: points held for the side"] > 0
    assert figures["one step: held displacements plus adjusted ones, mm"] < 1e-9
    assert figures["one step: against equation (1), mm"] < 1e-9


def zones_stay(figures):
    kept = figures["segments in the zones, kept to the bit"]
    assert kept == figures["segments in the zones"] == figures["segments in the zones, after"] > 0
    assert figures["outer curve kept"] == 1
    assert figures["overfilled length, mm, before"] > 100.0
    assert figures["overfilled length, mm, after"] < 0.02 * figures["overfilled length, mm, before"]
    assert figures["least distance of runs, mm, after"] > figures["least distance of runs, mm, before"]
    assert figures["points bent too sharply, before"] > figures["points bent too sharply that are protected"]
    assert figures["points bent too sharply, after"] == figures["points bent too sharply that are protected"]
    assert figures["smoothing finished"] == 1


CHECKS = {
    "fig02_slab": slab_is_filled,
    "fig05_three_layers": three_layers_become_a_print,
    "fig06_table": table_agrees,
    "fig07_spherical_analogy": spindle_draws_normals,
    "fig08_overhang": overhang_is_relaxed,
    "fig09_smoothing": smoothing_keeps_its_side,
    "fig12_overfill": overfill_is_relieved,
    "fig13_protected_zones": zones_stay,
    "fig14_springer": springer_is_better,
    "fig15_anchor_plates": anchor_plates_hold,
    "fig17_sparse_sections": sections_become_a_print,
    "fig18_branching_node": node_is_an_assembly,
}


def test_every_example_is_checked():
    assert sorted(CHECKS) == SCRIPTS


def test_catmull_clark_of_a_cube(example):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    points, finer = example("branching").catmull_clark(corners, quads)
    assert points.shape == (8 + 6 + 12, 3)
    assert finer.shape == (24, 4)
    assert np.allclose(points[:8], corners * 5 / 9)  # (F + 2 R + 0 P) / 3 with F = 1/3, R = 2/3
    assert np.allclose(np.abs(points[8:14]).sum(axis=1), 1.0)  # middles of faces
    assert np.allclose(np.sort(np.abs(points[14:]), axis=1), [0.0, 0.75, 0.75])
    a, b, c, d = points[finer].transpose(1, 0, 2)
    assert (np.einsum("ij,ij->i", np.cross(c - a, d - b), points[finer].mean(axis=1)) > 0).all()


def test_springer_stands_on_the_bed_and_ends_in_the_top_plane(example):
    surface, top = example("branching").branching_springer(3)
    check_surface(surface)
    assert surface.euler_number == 2
    vertices = np.asarray(surface.vertices)
    height = top.height_of(vertices)
    assert vertices[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    assert height.max() == pytest.approx(0.0, abs=1e-9)
    at_top = np.abs(height[np.asarray(surface.faces)]).max(axis=1) < 1e-6
    assert len(surface.submesh([np.flatnonzero(at_top)], append=True).split(only_watertight=False)) == 3
    assert np.allclose(surface.bounds[:, 1].sum(), 0.0)  # symmetric about the plane of its axis


def test_near_faces_hide_far_ones(example):
    pictures = example("pictures")
    view = pictures.View(30.0, 40.0)
    axes3 = view.axes
    assert np.allclose(axes3.T @ axes3, np.eye(3))
    assert np.linalg.det(axes3) == pytest.approx(1.0)
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    # The far square is drawn last; values 0 near, 1 far.
    corners = np.vstack([square + [0, 0, 5], 2 * square]) @ axes3.T
    faces = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]
    _, axes = pictures.panels(1, (2.0, 2.0))
    drawn = pictures.draw_surface(
        axes, make_surface(corners, faces), view, values=[0, 0, 1, 1], cmap="coolwarm", pixels=80
    )
    image = axes.images[0].get_array()
    middle, edge = image[image.shape[0] // 2, image.shape[1] // 2], image[image.shape[0] // 2, 10]
    assert middle[2] > middle[0]
    assert edge[0] > edge[2]
    assert image[..., 3].mean() > 0.7
    assert drawn.shows(corners[:4].mean(axis=0)[None]).all()
    assert not drawn.shows(corners[4:].mean(axis=0)[None]).any()
