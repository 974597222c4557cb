import time

import numpy as np
import pytest

from analysis import (
    DeckError,
    SolverError,
    SolverMissing,
    SolverTimeout,
    TetMesh,
    base_nodes,
    find_solver,
    solve,
    write_mesh,
    write_self_weight,
)
from twins import Plane

needs_ccx = pytest.mark.skipif(find_solver() is None, reason="ccx is not installed")
G = 9810.0


@pytest.fixture
def deck_of(tmp_path, mix):
    def make(mesh, down=(0.0, 0.0, -1.0), **material):
        base = base_nodes(mesh.points, Plane.horizontal(0.0), 1e-6)
        write_mesh(mesh, base, tmp_path)
        return write_self_weight(tmp_path, mesh, base, mix(**material), down)

    return make


@needs_ccx
def test_a_column_settles_and_is_pressed_as_the_closed_form_says(box_mesh, deck_of):
    height, E, rho = 1000.0, 1.0, 2.07e-9
    mesh = box_mesh((2, 2, 10), (100.0, 100.0, height))
    result = solve(deck_of(mesh, youngs_modulus=E, poisson=0.0), time_limit_s=60, threads=1)
    assert result.max_displacement == pytest.approx(rho * G * height**2 / (2 * E), rel=5e-3)
    # Stress is linear along the column, so an element's mean is the stress at its centroid.
    szz = np.bincount(result.elements, weights=result.stresses[:, 2]) / np.bincount(result.elements)
    expected = -rho * G * (height - mesh.centroids[:, 2])
    assert szz == pytest.approx(expected, abs=5e-3 * rho * G * height)
    assert result.max_von_mises == pytest.approx(rho * G * height, rel=0.03)


@needs_ccx
@pytest.mark.parametrize("down", [(0.0, 0.0, -1.0), (0.6, 0.0, -0.8), (0.0, 2.0, -1.0)])
def test_reactions_and_the_weight_on_the_base_carry_the_weight(box_mesh, deck_of, down):
    mesh = box_mesh((2, 3, 3), (50.0, 60.0, 40.0))
    result = solve(deck_of(mesh, down=down), time_limit_s=60, threads=1)
    direction = np.array(down) / np.linalg.norm(down)
    assert result.weight == pytest.approx(50 * 60 * 40 * 2070e-12 * G * direction)
    assert result.reaction - result.base_weight == pytest.approx(
        -result.weight, abs=5e-3 * np.linalg.norm(result.weight)
    )
    # What the solver leaves out is more than the tolerance, so the balance above is not met by chance.
    assert np.linalg.norm(result.base_weight) > 0.01 * np.linalg.norm(result.weight)
    assert result.imbalance < 5e-3
    assert result.rc == 0


@needs_ccx
def test_large_meshes_are_solved_iteratively_to_the_same_settlement(box_mesh, deck_of, monkeypatch):
    mesh = box_mesh((2, 3, 6), (50.0, 60.0, 120.0))
    deck = deck_of(mesh)
    assert "ITERATIVE" not in deck.path.read_text()
    direct = solve(deck, time_limit_s=60, threads=1)
    monkeypatch.setattr("analysis.self_weight._DIRECT_MAX", 10)
    deck = deck_of(mesh)
    assert "*STATIC, SOLVER=ITERATIVE CHOLESKY\n" in deck.path.read_text()
    assert solve(deck, time_limit_s=60, threads=1).max_displacement == pytest.approx(
        direct.max_displacement, rel=1e-3
    )


@needs_ccx
@pytest.mark.parametrize(
    ("known", "unknown", "named"),
    [
        ("*DENSITY", "*MOHR COULOMB\n20., 0.\n*DENSITY", r"\*MOHRCOULOMB"),
        ("*STATIC", "*STATIC, SOLVR=SPOOLES", "SOLVR=SPOOLES"),
    ],
)
def test_what_the_solver_ignores_is_an_error(box_mesh, deck_of, known, unknown, named):
    deck = deck_of(box_mesh((1, 1, 2), (10.0, 10.0, 20.0)))
    deck.path.write_text(deck.path.read_text().replace(known, unknown))
    with pytest.raises(SolverError, match=rf"self_weight\.inp.*cannot be interpreted: {named}"):
        solve(deck, time_limit_s=60, threads=1)


@needs_ccx
@pytest.mark.parametrize(
    ("right", "wrong"),
    [("ELSET=ALL, MATERIAL=FRESH", "ELSET=NONE, MATERIAL=FRESH"), ("mesh.inp", "absent.inp")],
)
def test_an_error_of_the_solver_is_told(box_mesh, deck_of, right, wrong):
    deck = deck_of(box_mesh((1, 1, 2), (10.0, 10.0, 20.0)))
    deck.path.write_text(deck.path.read_text().replace(right, wrong))
    with pytest.raises(SolverError, match=r"self_weight"):
        solve(deck, time_limit_s=60, threads=1)


@needs_ccx
def test_results_that_do_not_balance_are_refused(box_mesh, deck_of):
    deck = deck_of(box_mesh((1, 1, 2), (10.0, 10.0, 20.0)))
    deck.path.write_text(deck.path.read_text().replace("GRAV, 9810,", "GRAV, 4905,"))
    with pytest.raises(SolverError, match="differ by"):
        solve(deck, time_limit_s=60, threads=1)


@needs_ccx
def test_old_results_are_never_taken_for_new_ones(box_mesh, deck_of):
    deck = deck_of(box_mesh((1, 1, 2), (10.0, 10.0, 20.0)))
    solve(deck, time_limit_s=60, threads=1)
    deck.path.write_text("*HEADING\n")
    with pytest.raises(SolverError):
        solve(deck, time_limit_s=60, threads=1)
    assert not deck.path.with_suffix(".dat").exists() or not deck.path.with_suffix(".dat").read_text().strip()


@needs_ccx
def test_the_time_limit_ends_the_solver(box_mesh, deck_of, marked):
    deck = deck_of(box_mesh((8, 8, 30), (80.0, 80.0, 300.0)))
    start = time.monotonic()
    with pytest.raises(SolverTimeout, match=r"within 0\.2 s"):
        solve(deck, time_limit_s=0.2, threads=1)
    assert time.monotonic() - start < 5
    assert marked() == []


def test_without_a_solver_the_application_can_say_so(box_mesh, deck_of, monkeypatch, tmp_path):
    deck = deck_of(box_mesh((1, 1, 2), (10.0, 10.0, 20.0)))
    monkeypatch.setenv("PATH", str(tmp_path))
    assert find_solver() is None
    with pytest.raises(SolverMissing, match=r"^ccx is not installed$"):
        solve(deck)


def test_the_deck_tells_its_units_and_its_material(box_mesh, deck_of):
    text = deck_of(
        box_mesh((1, 1, 2), (10.0, 10.0, 20.0)), name="Mörtel\n*BOGUS", poisson=0.2
    ).path.read_text()
    assert "units: mm, N, MPa" in text
    assert "*ELASTIC\n0.078, 0.2\n" in text
    assert "*DENSITY\n2.07e-09\n" in text
    assert not any(line.startswith("*BOGUS") for line in text.splitlines())


def test_a_part_that_floats_is_named(box_mesh, deck_of):
    low, high = box_mesh((1, 1, 2), (10.0, 10.0, 20.0)), box_mesh((1, 1, 1), (10.0, 10.0, 10.0))
    both = TetMesh(
        np.vstack([low.points, high.points + [0, 0, 50.0]]),
        np.vstack([low.tets, high.tets + len(low.points)]),
        np.r_[low.layer, high.layer + 5],
    )
    with pytest.raises(DeckError, match=r"1 of 2 separate parts.*begins in layer 5"):
        deck_of(both)


@pytest.mark.parametrize("down", [(0.0, 0.0, 0.0), (0.0, 0.0, np.nan)])
def test_gravity_needs_a_direction(box_mesh, deck_of, down):
    with pytest.raises(DeckError, match="direction"):
        deck_of(box_mesh((1, 1, 2), (10.0, 10.0, 20.0)), down=down)


def test_a_deck_without_its_mesh_is_refused(box_mesh, mix, tmp_path):
    mesh = box_mesh((1, 1, 2), (10.0, 10.0, 20.0))
    with pytest.raises(DeckError, match=r"no mesh\.inp"):
        write_self_weight(tmp_path, mesh, np.arange(4), mix())
