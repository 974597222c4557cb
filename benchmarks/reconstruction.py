"""Reconstruction: the Delaunay stage of a slab against Qhull and CGAL, slices to M, and the edit of one layer.

Ours counts both 2D triangulations, the overlay and the adjacency of its tetrahedra; the peers the triangulation of
the same points alone. Everything runs on one core. Qhull is left out where it takes minutes.
"""

import os

os.environ.pop("OPENBLAS_CORETYPE", None)
os.environ.pop("OPENBLAS_L2_SIZE", None)

import resource
import statistics
import time

import numpy as np
from CGAL.CGAL_Kernel import Point_3
from CGAL.CGAL_Triangulation_3 import Delaunay_triangulation_3
from scipy.spatial import Delaunay
from slicing import gyroid_brick

from twins import Curve, Layer, Plane, Toolpath, layer_planes, make_surface, slice_surface, toolpath_mesh
from twins.overlay import neighbours, overlay_tetrahedra
from twins.triangulation import Lattice, triangulate
from twins.twin import Twin

BED = Plane.horizontal()
THICKNESS = 10.0


def seconds(call, runs=5):
    call()
    times = []
    for _ in range(runs):
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


def memory_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def wavy_walls(n, phase):
    """Two concentric walls 25 mm thick, n points in all, about 10 mm apart."""
    per = n // 4
    radius = 10.0 * per / (2.0 * np.pi)
    angle = 2.0 * np.pi * np.arange(per) / per + 0.01 * phase
    waves = max(5, per // 25)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    swing = 6.0 * np.sin(waves * angle + phase)
    return [(radius + swing + offset)[:, None] * ring[:: -1 if hole else 1] if not hole
            else ((radius + swing + offset)[:, None] * ring)[::-1]
            for offset, hole in ((0.0, False), (-25.0, True), (-60.0, False), (-85.0, True))]  # fmt: skip


def delaunay_stage(lower, upper, lattice):
    regions = triangulate(lower, lattice, THICKNESS, "lower"), triangulate(upper, lattice, THICKNESS, "upper")
    tets, _ = overlay_tetrahedra(*regions)
    neighbours(tets, len(regions[0]) + len(regions[1]))
    return regions, tets


def compare(name, lower, upper, *, qhull):
    flat = np.vstack([*lower, *upper])
    lattice = Lattice.around(flat.min(axis=0), flat.max(axis=0))
    (one, two), tets = delaunay_stage(lower, upper, lattice)
    points = np.vstack([
        np.column_stack([region.points, np.full(len(region), z)]) for region, z in ((one, 0.0), (two, THICKNESS))
    ])  # fmt: skip
    ours = seconds(lambda: delaunay_stage(lower, upper, lattice))
    handles = [Point_3(*p) for p in points.tolist()]
    cgal = seconds(lambda: Delaunay_triangulation_3(handles), 3)
    theirs = f"{'-':>9} {'-':>7}"
    if qhull:
        begin = time.perf_counter()
        Delaunay(points)
        taken = time.perf_counter() - begin
        theirs = f"{taken:9.4f} {taken / ours:7.1f}"
    print(
        f"{name:34} {len(points) // 2:7} {len(tets):8} {ours:9.4f} {theirs} {cgal:9.4f} {cgal / ours:7.1f}",
        flush=True,
    )


def tower(layers, points):
    """A wavy double-walled tower: layers that differ a little from one to the next."""
    stack = []
    for k in range(layers):
        curves = tuple(Curve(c) for c in wavy_walls(points, 0.05 * k))
        z = THICKNESS * k
        stack.append(Layer(Plane.horizontal(z + 5.0), Plane.horizontal(z + 10.0), curves))
    return Toolpath(BED, tuple(stack), THICKNESS)


def main():
    print(f"{'Delaunay stage of one slab':34} {'points':>7} {'tets':>8} {'ours s':>9} {'Qhull s':>9} {'ratio':>7} "
          f"{'CGAL s':>9} {'ratio':>7}")  # fmt: skip
    for n in (500, 2000, 10000):
        compare("wavy double walls", wavy_walls(n, 0.0), wavy_walls(n, 0.3), qhull=n < 10000)
    brick = make_surface(*gyroid_brick(66))
    planes = layer_planes(BED, float(brick.vertices[:, 2].max()), THICKNESS)
    for step, qhull in ((20.0, True), (8.0, True), (1.2, False)):
        sliced = slice_surface(brick, planes, step).layers
        lower, upper = ([curve.points for curve in sliced[k].curves] for k in (20, 21))
        compare("gyroid brick, 500 mm, one slab", lower, upper, qhull=qhull)
    print()
    before = memory_mb()
    print(f"{'slices to M':34} {'points':>7} {'layers':>8} {'seconds':>9} {'us/point':>9} {'peak MB':>9}")
    for name, toolpath in (
        (
            "gyroid brick, 400 mm",
            slice_surface(make_surface(*scaled(brick, 0.8)), layer_planes(BED, 400.0, 10.0)),
        ),
        ("tower of double walls", tower(50, 500)),
        ("tower of double walls", tower(50, 2000)),
        ("tower of double walls", tower(50, 10000)),
    ):
        taken = seconds(lambda path=toolpath: toolpath_mesh(path, THICKNESS), 3)
        count = sum(len(curve.points) for *_, curve in toolpath.curves())
        print(f"{name:34} {count:7} {len(toolpath.layers):8} {taken:9.3f} {1e6 * taken / count:9.2f} "
              f"{memory_mb() - before:9.0f}", flush=True)  # fmt: skip
    print()
    print(f"{'one layer of 200 replaced':34} {'points':>7} {'rebuild s':>10} {'edit s':>9} {'share':>7}")
    for points in (500, 2000):
        path = tower(200, points)
        whole = seconds(lambda path=path: Twin.from_toolpath(path).mesh, 3)
        twin = Twin.from_toolpath(path)
        _ = twin.mesh
        times = []
        for k in range(21):
            curves = [Curve(curve.points * (1.0 - 1e-4 * (k + 1))) for curve in path.layers[90 + k].curves]
            begin = time.perf_counter()
            twin.replace_layer(90 + k, curves)
            times.append(time.perf_counter() - begin)
        again = Twin.from_toolpath(twin.toolpath).surface
        same = np.array_equal(again.vertices, twin.surface.vertices) and np.array_equal(
            again.faces, twin.surface.faces
        )
        edit = statistics.median(times)
        print(f"{'tower of double walls':34} {points * 200:7} {whole:10.3f} {edit:9.4f} {100 * edit / whole:6.2f} % "
              f"{'identical' if same else 'DIFFERENT'}", flush=True)  # fmt: skip


def scaled(surface, factor):
    return np.asarray(surface.vertices) * factor, surface.faces


if __name__ == "__main__":
    main()
