"""Surfaces: reading a mesh, and making sure that it bounds a solid.

Inside the package a surface is a `trimesh.Trimesh` made with `process=False`, in mm, whose vertices are distinct
points. This file is the doorway: whatever comes in leaves as such a surface, or is refused with the place.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from .errors import FormatError, SurfaceError

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

SUFFIXES = (".stl", ".ply", ".obj", ".3mf")


@dataclass(frozen=True)
class Hole:
    """A hole that was closed.

    Attributes:
        center: mean of its rim, shape (3,), mm.
        edges: number of edges of the rim.
        length: of the rim, mm.
    """

    center: tuple[float, float, float]
    edges: int
    length: float

    def __str__(self) -> str:
        x, y, z = self.center
        return f"hole of {self.edges} edges, {self.length:.1f} mm around, at ({x:.1f}, {y:.1f}, {z:.1f})"


def make_surface(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> trimesh.Trimesh:
    """A mesh of the given vertices, shape (n, 3), and triangles, shape (m, 3), left as they are."""
    return trimesh.Trimesh(
        np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64), process=False
    )


def read_surface(path: Path) -> trimesh.Trimesh:
    """The mesh in an STL, PLY, OBJ or 3MF file, in the file's unit, with equal vertices merged.

    Raises:
        FormatError: no such file, an unknown ending, or a file that holds no triangles.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise FormatError(
            f"{path}: unknown ending '{path.suffix}'; a part is read from {', '.join(SUFFIXES)}"
        )
    if not path.is_file():
        raise FormatError(f"{path}: no such file")
    try:
        loaded: Any = trimesh.load(path, process=False, force="mesh", skip_materials=True)
        vertices, faces = (
            np.asarray(loaded.vertices, dtype=np.float64),
            np.asarray(loaded.faces, dtype=np.int64),
        )
    except Exception as error:
        raise FormatError(
            f"{path}: cannot be read as {path.suffix[1:].upper()}: {_first_line(error)}"
        ) from error
    if len(faces) == 0 or len(vertices) == 0:
        raise FormatError(f"{path}: holds no triangles")
    if not np.isfinite(vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
        raise FormatError(f"{path}: vertex {bad} is not a finite point")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise FormatError(f"{path}: a face names vertex {faces.max()}, but there are {len(vertices)}")
    surface = welded(vertices, faces)
    if len(surface.faces) == 0:
        raise FormatError(f"{path}: all its triangles are degenerate")
    return surface


def welded(vertices: Array, faces: Faces) -> trimesh.Trimesh:
    """Vertices at exactly the same point merged; triangles that lose a corner by it dropped."""
    points, index = np.unique(vertices + 0.0, axis=0, return_inverse=True)
    corners = index.reshape(-1)[faces]
    proper = (
        (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]) & (corners[:, 2] != corners[:, 0])
    )
    return make_surface(points, corners[proper])


def check_surface(surface: trimesh.Trimesh) -> None:
    """Make sure that a mesh bounds a solid: closed, two faces an edge, outward normals.

    Raises:
        SurfaceError: it does not; the message counts the faults and names the place of the first.
    """
    faces = np.asarray(surface.faces)
    vertices = np.asarray(surface.vertices)
    if len(faces) == 0:
        raise SurfaceError("the surface is empty")
    if not np.isfinite(vertices).all():
        raise SurfaceError("the surface has a vertex that is not a finite point")
    open_edges, crowded, twisted = _faults(faces)
    if len(crowded):
        raise SurfaceError(
            f"the surface is not manifold: {len(crowded)} edges have more than two faces, the first at "
            f"{_place(vertices, crowded[0])}; make one solid of the bodies that touch there"
        )
    if len(open_edges):
        holes = boundary_loops(faces)
        places = "; ".join(str(_hole(vertices, rim)) for rim in holes[:5])
        more = f"; and {len(holes) - 5} more" if len(holes) > 5 else ""
        raise SurfaceError(
            f"the surface is open: {len(open_edges)} open edges in {len(holes)} holes: {places}{more}"
        )
    if len(twisted):
        raise SurfaceError(
            f"the surface is not consistently oriented: {len(twisted)} edges have two faces that turn the same way, "
            f"the first at {_place(vertices, twisted[0])}; flip the faces on one side"
        )
    size = float(np.ptp(vertices, axis=0).max())
    if abs(signed_volume(surface)) < 1e-12 * size**3:
        raise SurfaceError("the surface encloses no volume; make it a closed solid")
    if signed_volume(surface) < 0:
        raise SurfaceError("the surface is inside out: its normals point inwards; flip all faces")


def repair_surface(surface: trimesh.Trimesh) -> tuple[trimesh.Trimesh, list[str]]:
    """Put right what can be put right without a choice, and say so.

    Duplicate faces are dropped, faces of one body turned the same way, a body turned inside out flipped, holes
    closed by a fan to the middle of their rim.

    Returns:
        the surface, and one sentence for each thing that was changed.

    Raises:
        SurfaceError: what remains does not bound a solid.
    """
    said: list[str] = []
    faces = np.asarray(surface.faces, dtype=np.int64)
    vertices = np.asarray(surface.vertices, dtype=np.float64)
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    if len(first) < len(faces):
        said.append(f"dropped {len(faces) - len(first)} duplicate faces")
        faces = faces[np.sort(first)]
    _, _, twisted = _faults(faces)
    if len(twisted):
        mesh = make_surface(vertices, faces)
        trimesh.repair.fix_winding(mesh)  # type: ignore[no-untyped-call]
        faces = np.asarray(mesh.faces, dtype=np.int64)
        said.append(f"turned faces at {len(twisted)} edges to one orientation")
    rims = boundary_loops(faces)
    if rims:
        vertices, faces = _close(vertices, faces, rims)
        said.extend(f"closed a {_hole(vertices, rim)}" for rim in rims)
    repaired = make_surface(vertices, faces)
    if signed_volume(repaired) < 0:
        repaired = make_surface(vertices, faces[:, ::-1])
        said.append("flipped all faces: they pointed inwards")
    check_surface(repaired)
    return repaired, said


def signed_volume(surface: trimesh.Trimesh) -> float:
    """Enclosed volume, mm³; negative where the normals point inwards."""
    corners = np.asarray(surface.vertices)[np.asarray(surface.faces)]
    corners = corners - corners.reshape(-1, 3).mean(axis=0)
    return float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0)


def boundary_loops(faces: Faces) -> list[npt.NDArray[np.int64]]:
    """Rims of the holes of a mesh, each as vertex indices in the order that a closing face would have."""
    open_edges, _, _ = _faults(faces)
    following: dict[int, list[int]] = {}
    for start, end in open_edges:
        following.setdefault(int(end), []).append(int(start))
    loops: list[npt.NDArray[np.int64]] = []
    while following:
        # Walk until a vertex comes back: where holes touch in a vertex this splits them into simple rims.
        walk = [next(iter(following))]
        seen = {walk[0]: 0}
        while walk and following.get(walk[-1]):
            step = following[walk[-1]].pop()
            if step in seen:
                at = seen[step]
                loops.append(np.array(walk[at:], dtype=np.int64))
                for vertex in walk[at + 1 :]:
                    del seen[vertex]
                walk = walk[: at + 1]
            else:
                seen[step] = len(walk)
                walk.append(step)
        following = {vertex: ends for vertex, ends in following.items() if ends}
    return [loop for loop in loops if len(loop) >= 3]


def _faults(faces: Faces) -> tuple[Faces, Faces, Faces]:
    """Open edges (directed, as their face has them), edges of more than two faces, edges of two like-turned faces."""
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, index, count = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True)
    index = index.reshape(-1)
    forward = np.zeros(len(count), dtype=np.int64)
    np.add.at(forward, index, np.where(directed[:, 0] < directed[:, 1], 1, -1))
    first = np.full(len(count), len(directed))
    np.minimum.at(first, index, np.arange(len(directed)))
    return (
        directed[first[count == 1]],
        directed[first[count > 2]],
        directed[first[(count == 2) & (forward != 0)]],
    )


def _close(vertices: Array, faces: Faces, rims: list[npt.NDArray[np.int64]]) -> tuple[Array, Faces]:
    points, patches = [vertices], [faces]
    at = len(vertices)
    for rim in rims:
        if len(rim) == 3:
            patches.append(rim[None])
            continue
        points.append(vertices[rim].mean(axis=0)[None])
        patches.append(np.column_stack([rim, np.roll(rim, -1), np.full(len(rim), at)]))
        at += 1
    return np.concatenate(points), np.concatenate(patches)


def _hole(vertices: Array, rim: npt.NDArray[np.int64]) -> Hole:
    ring = vertices[rim]
    x, y, z = (float(value) for value in ring.mean(axis=0))
    return Hole((x, y, z), len(rim), float(np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum()))


def _place(vertices: Array, edge: npt.NDArray[np.int64]) -> str:
    x, y, z = vertices[edge].mean(axis=0)
    return f"({x:.3f}, {y:.3f}, {z:.3f})"


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]
