import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

import analysis.tetwild_child
from analysis import MeshingError, MeshingTimeout, tetrahedralize
from analysis.child import run_child
from analysis.meshing import _check_end, mean_thickness
from analysis.tetrahedra import TetMesh


@pytest.fixture(scope="module")
def slow_surface():
    """A surface that takes the mesher far longer than a test may."""
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=100.0)
    return trimesh.Trimesh(sphere.vertices, sphere.faces, process=False)


def test_a_tube_is_filled_within_tolerance_of_its_surface(tube):
    surface = tube()
    points, tets = tetrahedralize(surface, edge=6.0, tolerance=0.5, time_limit_s=100)
    mesh = TetMesh(points, tets, np.zeros(len(tets)))  # checks orientation
    assert mesh.volume == pytest.approx(surface.volume, rel=0.02)
    assert np.array_equal(np.unique(tets), np.arange(len(points)))
    skin = trimesh.Trimesh(points, mesh.boundary(), process=False)
    assert skin.is_watertight
    assert skin.euler_number == surface.euler_number
    _, distance, _ = trimesh.proximity.closest_point(surface, points[np.unique(mesh.boundary())])
    assert distance.max() <= 0.5 + 1e-9
    _, distance, _ = trimesh.proximity.closest_point(skin, surface.vertices)
    assert distance.max() <= 2 * 0.5
    assert np.median(mesh.quality) > 0.6
    lengths = skin.edges_unique_length
    assert 3.0 < np.median(lengths) < 9.0


def test_far_from_the_origin_nothing_is_lost():
    box = trimesh.creation.box((20.0, 20.0, 20.0))
    box = trimesh.Trimesh(box.vertices + [1e6, -1e6, 3e5], box.faces, process=False)
    points, tets = tetrahedralize(box, edge=10.0, tolerance=0.2, time_limit_s=100)
    assert TetMesh(points, tets, np.zeros(len(tets))).volume == pytest.approx(8000.0, rel=5e-3)
    assert np.ptp(points, axis=0) == pytest.approx([20.0] * 3, abs=0.4)
    assert points.mean(axis=0) == pytest.approx([1e6, -1e6, 3e5], abs=5.0)


def test_mean_thickness_is_that_of_a_wide_plate_and_of_a_tubes_wall(tube):
    assert mean_thickness(trimesh.creation.box((2000.0, 2000.0, 4.0))) == pytest.approx(4.0, rel=0.01)
    assert mean_thickness(tube(height=4000.0)) == pytest.approx(8.0, rel=0.01)


def opened(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces[1:], process=False)


def with_nan(mesh):
    vertices = np.array(mesh.vertices)
    vertices[5, 1] = np.nan
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


@pytest.mark.parametrize(
    ("break_it", "says"),
    [
        (lambda _: trimesh.Trimesh(np.empty((0, 3)), np.empty((0, 3), dtype=int), process=False), "empty"),
        (opened, "not closed: 3 edges"),
        (with_nan, "vertex 5 is not finite"),
        (lambda m: trimesh.Trimesh(m.vertices * [1, 1, 0], m.faces, process=False), "is flat"),
        (lambda m: trimesh.Trimesh(m.vertices, m.faces[:, ::-1], process=False), "turn them around"),
        (
            lambda m: trimesh.Trimesh(m.vertices * [1, 1, 0.01], m.faces, process=False),
            r"reduce the tolerance.*in mm",
        ),
        (lambda m: trimesh.Trimesh(m.vertices * 1000, m.faces, process=False), "increase the edge length"),
    ],
    ids=["empty", "open", "nan", "flat", "inside out", "thinner than the tolerance", "too many elements"],
)
def test_a_surface_that_would_harm_the_mesher_does_not_reach_it(tube, marked, break_it, says):
    start = time.monotonic()
    with pytest.raises(MeshingError, match=says):
        tetrahedralize(break_it(tube()), edge=6.0, tolerance=0.5, time_limit_s=5)
    assert time.monotonic() - start < 2
    assert marked() == []


@pytest.mark.parametrize(
    ("edge", "tolerance"), [(6.0, 0.0), (6.0, 6.0), (-1.0, 0.5), (np.nan, 0.5), (6.0, np.inf)]
)
def test_sizes_that_never_end_are_refused(tube, edge, tolerance):
    with pytest.raises(MeshingError, match="0 < tolerance < edge"):
        tetrahedralize(tube(), edge, tolerance, time_limit_s=5)


def test_a_thin_part_that_the_tolerance_dissolves_is_noticed_by_its_volume():
    # A thick box and a plate that is thinner than the envelope, together thick enough on average.
    box = trimesh.creation.box((30.0, 30.0, 30.0))
    plate = trimesh.creation.box((60.0, 60.0, 0.6))
    plate.apply_translation([0, 0, 40.0])
    both = trimesh.util.concatenate([box, plate])
    with pytest.raises(MeshingError, match="reduce the tolerance"):
        tetrahedralize(both, edge=10.0, tolerance=2.0, time_limit_s=60)


def test_the_time_limit_kills_the_mesher_and_says_what_to_change(slow_surface, marked):
    start = time.monotonic()
    with pytest.raises(
        MeshingTimeout, match=r"within 0\.5 s; increase the edge length \(2\.5 mm\).*time limit"
    ):
        tetrahedralize(slow_surface, edge=2.5, tolerance=0.1, time_limit_s=0.5)
    assert time.monotonic() - start < 5
    assert marked() == []


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_when_the_caller_is_ended_the_mesher_ends_too(marked, how):
    caller = (
        "import signal\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "import trimesh\nfrom analysis import tetrahedralize\nprint('ready', flush=True)\n"
        "tetrahedralize(trimesh.creation.icosphere(5, 100.0), edge=2.5, tolerance=0.1, time_limit_s=60)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", caller], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    assert process.stdout.readline() == b"ready\n"
    end = time.monotonic() + 20
    while not any(b"tetwild_child" in command for _, command in marked()) and time.monotonic() < end:
        time.sleep(0.05)
    time.sleep(1.5)  # into the native code, which holds the interpreter's lock
    assert any(b"tetwild_child" in command for _, command in marked())
    process.send_signal(how)
    process.wait(timeout=10)
    process.stdout.close()
    assert marked(patience_s=5) == []


def test_a_crash_of_the_mesher_stays_in_its_child(tmp_path):
    # Straight to the child, past the checks that keep such input away from it.
    np.savez(
        tmp_path / "surface.npz",
        points=np.zeros((0, 3)),
        faces=np.zeros((0, 3)),
        edge=1.0,
        epsilon=1e-3,
        stop_energy=10.0,
        iterations=5,
        threads=1,
    )
    # What it does without any points is left to chance; it may ask for all the memory there is.
    limited = (
        "import resource, runpy, sys; resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30)); "
        "sys.argv.pop(0); runpy.run_path(sys.argv[0], run_name='__main__')"
    )
    ended = run_child(
        [sys.executable, "-P", "-c", limited, analysis.tetwild_child.__file__, "surface.npz", "tets.npz"],
        folder=Path(tmp_path),
        time_limit_s=120,  # a first import of the mesher can take half a minute
    )
    assert ended.code not in {0, None}
    with pytest.raises(MeshingError, match=r"the mesher (crashed \(SIG(SEGV|ABRT)\)|failed)") as error:
        _check_end(ended, 1.0, 0.1, 30)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "tets.npz").exists()
