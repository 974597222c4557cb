"""Tetrahedra that fill a closed surface, by fTetWild in a child process.

fTetWild crashes its process on input that is empty, flat or not finite, never ends with an envelope of zero, loses
precision far from the origin, and answers a plate thinner than its envelope with no tetrahedra and no error. So the
input is checked and recentred before, the child is bounded in time, and the result is measured after.
"""

from __future__ import annotations

import signal
import sys
import tempfile
import zipfile
from pathlib import Path

import manifold3d
import numpy as np
import numpy.typing as npt
import trimesh

from twins import signed_volume

from .child import Ended, run_child
from .errors import MeshingError, MeshingTimeout
from .settings import thread_count
from .tetrahedra import Array, Indices, oriented, signed_volumes

_SIMPLIFY = 0.2
"""Share of the tolerance that goes into a surface with fewer triangles, which halves fTetWild's time; its envelope
gets the rest."""

_STOP_ENERGY = 20.0
"""fTetWild improves elements until none is worse than this; its own default of 10 takes half as long again, for a
median quality that is higher by 0.01."""

_ITERATIONS = 20
_VOLUME_TOLERANCE = 0.02
_ELEMENTS_MAX = 5e6
_FILL = 12.0
"""Elements per V / edge³, measured on shells one to two edges thick."""


def tetrahedralize(
    volume: trimesh.Trimesh, edge: float, tolerance: float, time_limit_s: float, threads: int = 0
) -> tuple[Array, Indices]:
    """Tetrahedra that fill a closed surface; not the same ones on every run.

    Args:
        volume: a watertight surface, outside facing out, mm.
        edge: target edge length, mm.
        tolerance: largest distance between the tetrahedra's surface and the given one, mm.
        time_limit_s: after which the mesher is killed, s.
        threads: 0 for all cores.

    Returns:
        Points, shape (n, 3), mm, and positively oriented tetrahedra, shape (m, 4); every point is used.

    Raises:
        MeshingError: the surface cannot be meshed, or the tetrahedra do not have its volume.
        MeshingTimeout: the time is up.
    """
    _check_surface(volume, edge, tolerance)
    vertices = np.asarray(volume.vertices, dtype=np.float64)
    centre = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    points, faces = _simplified(
        vertices - centre, np.asarray(volume.faces, dtype=np.int64), _SIMPLIFY * tolerance
    )
    with tempfile.TemporaryDirectory(prefix="tetwild-") as name:
        folder = Path(name)
        np.savez(
            folder / "surface.npz",
            points=points,
            faces=faces,
            edge=edge,
            epsilon=(1.0 - _SIMPLIFY) * tolerance / float(np.linalg.norm(np.ptp(points, axis=0))),
            stop_energy=_STOP_ENERGY,
            iterations=_ITERATIONS,
            threads=thread_count(threads),
        )
        child = Path(__file__).with_name("tetwild_child.py")
        # -P: the child finds the standard library and installed packages, not the files beside it
        ended = run_child(
            [sys.executable, "-P", str(child), "surface.npz", "tets.npz"],
            folder=folder,
            time_limit_s=time_limit_s,
        )
        _check_end(ended, edge, tolerance, time_limit_s)
        points, tets = _read(folder / "tets.npz")
    points, tets = _checked(points, tets, signed_volume(volume), tolerance)
    return points + centre, tets


def mean_thickness(volume: trimesh.Trimesh) -> float:
    """2 V / A, mm: the thickness of a plate or a wall, somewhat less for compact bodies."""
    return 2.0 * signed_volume(volume) / float(volume.area)


def _check_surface(volume: trimesh.Trimesh, edge: float, tolerance: float) -> None:
    if len(volume.faces) == 0:
        raise MeshingError("the volume is empty: its surface has no triangles")
    finite = np.isfinite(np.asarray(volume.vertices)).all(axis=1)
    if not finite.all():
        raise MeshingError(f"the volume's surface is broken: vertex {int(np.argmin(finite))} is not finite")
    if not volume.is_watertight:
        _, count = np.unique(volume.edges_sorted, axis=0, return_counts=True)
        raise MeshingError(
            f"the volume's surface is not closed: {int((count != 2).sum())} edges do not join exactly two triangles; "
            "repair it first"
        )
    extent = float(np.ptp(volume.triangles.reshape(-1, 3), axis=0).min())
    if extent == 0.0:
        raise MeshingError("the volume is flat: it measures 0 mm along one of the axes")
    enclosed = signed_volume(volume)
    if not volume.is_winding_consistent or not enclosed > 0.0:
        raise MeshingError(
            f"the volume's surface encloses {enclosed:.6g} mm³: its triangles must all face out; turn them around"
        )
    if not (np.isfinite([edge, tolerance]).all() and 0.0 < tolerance < edge):
        raise MeshingError(
            f"the mesher needs 0 < tolerance < edge length, not a tolerance of {tolerance:.6g} mm "
            f"and an edge of {edge:.6g} mm"
        )
    thickness = min(extent, mean_thickness(volume))
    if thickness <= 2.0 * tolerance:
        raise MeshingError(
            f"the volume is {thickness:.3g} mm thick, which a tolerance of {tolerance:.3g} mm would dissolve; reduce "
            "the tolerance, or check that the volume is in mm"
        )
    expected = _FILL * enclosed / edge**3
    if expected > _ELEMENTS_MAX:
        raise MeshingError(
            f"an edge of {edge:.3g} mm makes about {expected:.1e} elements of this volume, more than "
            f"{_ELEMENTS_MAX:.0e}; increase the edge length"
        )


def _simplified(points: Array, faces: Indices, tolerance: float) -> tuple[Array, Indices]:
    """The surface with fewer triangles, nowhere further away than `tolerance`; itself where that does not work."""
    solid = manifold3d.Manifold(manifold3d.Mesh64(points, faces.astype(np.uint64)))
    if solid.status() != manifold3d.Error.NoError or solid.is_empty():
        return points, faces
    simple = solid.simplify(tolerance)
    if simple.is_empty() or abs(simple.volume() / solid.volume() - 1.0) > 0.25 * _VOLUME_TOLERANCE:
        return points, faces
    mesh = simple.to_mesh64()
    positions = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3]
    return positions, np.asarray(mesh.tri_verts, dtype=np.int64)


def _check_end(ended: Ended, edge: float, tolerance: float, time_limit_s: float) -> None:
    remedy = f"increase the edge length ({edge:.3g} mm) or the tolerance ({tolerance:.3g} mm)"
    if ended.code is None:
        raise MeshingTimeout(
            f"the mesher did not end within {time_limit_s:.6g} s; {remedy}, or raise the time limit"
        )
    if ended.code == -signal.SIGKILL:
        raise MeshingError(f"the mesher was killed from outside, as when memory runs out; {remedy}")
    if ended.code < 0:
        raise MeshingError(
            f"the mesher crashed ({signal.Signals(-ended.code).name}); check the volume for crossing or flat parts, "
            f"or {remedy}"
        )
    if ended.code > 0:
        last = next((line for line in reversed(ended.output.splitlines()) if line.strip()), "no message")
        raise MeshingError(f"the mesher failed: {last.strip()}")


def _read(path: Path) -> tuple[npt.NDArray[np.float64], Indices]:
    try:
        with np.load(path, allow_pickle=False) as made:
            return np.asarray(made["points"], dtype=np.float64), np.asarray(made["tets"], dtype=np.int64)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise MeshingError(f"the mesher ended without a readable result ({error}); run it again") from error


def _checked(points: Array, tets: Indices, wanted: float, tolerance: float) -> tuple[Array, Indices]:
    if len(tets) == 0:
        raise MeshingError(f"the mesher made no tetrahedra; reduce the tolerance ({tolerance:.3g} mm)")
    if not np.isfinite(points).all():
        raise MeshingError("the mesher made points that are not finite; run it again")
    used, compact = np.unique(tets, return_inverse=True)
    points, tets = points[used], compact.reshape(tets.shape).astype(np.int64)
    tets = oriented(points, tets)
    volumes = signed_volumes(points, tets)
    if volumes.min() <= 0.0:
        raise MeshingError(
            f"the mesher made {int((volumes <= 0).sum())} flat tetrahedra of {len(tets)}; run it again"
        )
    error = float(volumes.sum()) / wanted - 1.0
    if abs(error) > _VOLUME_TOLERANCE:
        raise MeshingError(
            f"the tetrahedra's volume differs by {100 * error:+.1f} % from the surface's {wanted:.6g} mm³; reduce the "
            f"tolerance ({tolerance:.3g} mm), and check that the volume's parts do not overlap"
        )
    return points, tets
