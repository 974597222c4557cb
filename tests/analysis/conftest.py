"""Shapes with known volumes, meshes without a mesher, and a look at what processes are left."""

import os
import time
import uuid
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
import trimesh

from analysis import TetMesh
from planning import Mix
from twins import Curve, Layer, Plane, Toolpath

CURVE = Curve(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]))


@pytest.fixture
def box_mesh():
    """A box of six tetrahedra per cell (Kuhn), base on z = 0; layers of equal height along z."""

    def make(cells, size, layers=1):
        axes = [np.linspace(0.0, s, n + 1) for s, n in zip(size, cells, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        index = np.arange(len(points)).reshape([n + 1 for n in cells])
        corner = np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), axis=-1).reshape(-1, 3)
        tets = []
        for order in permutations(range(3)):
            step = np.zeros((4, 3), dtype=int)
            for k, axis in enumerate(order):
                step[k + 1 :, axis] += 1
            odd = np.linalg.det(step[1:].astype(float)) < 0
            walk = step[[0, 2, 1, 3]] if odd else step
            tets.append(np.stack([index[tuple((corner + s).T)] for s in walk], axis=1))
        tets = np.vstack(tets)
        height = points[tets].mean(axis=1)[:, 2]
        return TetMesh(points, tets, np.clip((height / size[2] * layers).astype(int), 0, layers - 1))

    return make


@pytest.fixture
def parallel_path():
    """A toolpath of horizontal layers up to a height."""

    def make(count, height, curves=(CURVE,)):
        t = height / count
        layers = tuple(
            Layer(Plane.horizontal((k + 0.5) * t), Plane.horizontal((k + 1) * t), tuple(curves))
            for k in range(count)
        )
        return Toolpath(Plane.horizontal(0.0), layers, t)

    return make


@pytest.fixture
def tube():
    """A square tube on z = 0, watertight by construction: side, wall and height in mm, rings of its sides."""

    def make(side=40.0, wall=8.0, height=30.0, rings=4):
        square = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        rows = [
            np.column_stack([square * width, np.full(4, z)])
            for z in np.linspace(0.0, height, rings)
            for width in (side, side - 2 * wall)
        ]
        faces = []

        def quad(a, b, c, d):
            faces.extend([[a, b, c], [a, c, d]])

        def at(ring, inner, k):
            return 8 * ring + 4 * inner + k % 4

        for k in range(4):
            for r in range(rings - 1):
                quad(at(r, 0, k), at(r, 0, k + 1), at(r + 1, 0, k + 1), at(r + 1, 0, k))
                quad(at(r, 1, k + 1), at(r, 1, k), at(r + 1, 1, k), at(r + 1, 1, k + 1))
            quad(at(0, 0, k + 1), at(0, 0, k), at(0, 1, k), at(0, 1, k + 1))
            top = rings - 1
            quad(at(top, 0, k), at(top, 0, k + 1), at(top, 1, k + 1), at(top, 1, k))
        mesh = trimesh.Trimesh(np.vstack(rows), faces, process=False)
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx((side**2 - (side - 2 * wall) ** 2) * height)
        return mesh

    return make


@pytest.fixture
def mix():
    """A mix; what is not given is that of a fresh mortar."""

    def make(**values):
        fresh = {
            "name": "test",
            "density_kg_m3": 2070.0,
            "youngs_modulus": 0.078,
            "poisson": 0.24,
            "layer_interval_max_s": 360.0,
            "open_time_s": 7200.0,
        }
        return Mix(**{**fresh, **values})

    return make


@pytest.fixture
def marked(monkeypatch):
    """Marks all child processes started from here on; call it for the list of those that exist, dead or alive."""
    if not Path("/proc/self/environ").exists():
        pytest.skip("needs /proc to look for processes")
    mark = f"MARK_{uuid.uuid4().hex}"
    monkeypatch.setenv(mark, "1")
    me = os.getpid()

    def find(patience_s=0.0):
        end = time.monotonic() + patience_s
        while (found := _with_mark(mark, me)) and time.monotonic() < end:
            time.sleep(0.02)
        return found

    return find


def _with_mark(mark, me):
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or int(entry.name) == me:
            continue
        try:
            zombie_of_mine = (entry / "stat").read_text().rpartition(")")[2].split()[:2] == ["Z", str(me)]
            if zombie_of_mine or mark.encode() in (entry / "environ").read_bytes():
                found.append((int(entry.name), (entry / "cmdline").read_bytes()))
        except OSError:  # it ended while we looked
            continue
    return found
