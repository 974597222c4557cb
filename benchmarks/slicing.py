"""Slicing a gyroid brick into closed polygons: ours against manifold3d, and rotary against parallel, in one run.

Ours includes finding the mesh's adjacency; manifold3d is timed on a ready Manifold, and with its construction.
The two take turns, so that whatever else the machine does disturbs both.
"""

import os

os.environ.pop("OPENBLAS_CORETYPE", None)
os.environ.pop("OPENBLAS_L2_SIZE", None)

import statistics
import sys
import tempfile
import time
from pathlib import Path

import manifold3d
import numpy as np
import trimesh

from twins import Plane, layer_planes
from twins.cutter import SurfaceCutter

SIZE = 500.0
PERIOD = 200.0
WALL = 0.35
SMALL, LARGE = 66, 204
"""Grid cells along the brick: about 215 thousand and 2.06 million triangles."""
BED = Plane.horizontal()


def gyroid_brick(cells):
    """Vertices and faces of the largest body of |gyroid| <= WALL, closed by the brick's box."""
    stored = Path(tempfile.gettempdir()) / f"twincell_gyroid_brick_{cells}.npz"
    if stored.is_file():
        with np.load(stored) as mesh:
            return mesh["vertices"], mesh["faces"]
    from skimage.measure import marching_cubes  # noqa: PLC0415 - only to make the mesh

    step = SIZE / cells
    x = (np.arange(cells + 5) - 2 + 0.37) * step
    s, c = np.sin(2.0 * np.pi * x / PERIOD), np.cos(2.0 * np.pi * x / PERIOD)
    gyroid = s[:, None, None] * c[:, None] + s[:, None] * c + s * c[:, None, None]
    outside = np.maximum(-x, x - SIZE) * 2.0 * np.pi / PERIOD
    box = np.maximum(np.maximum(outside[:, None, None], outside[:, None]), outside)
    vertices, faces, _, _ = marching_cubes(np.maximum(np.abs(gyroid) - WALL, box), 0.0, spacing=(step,) * 3)
    mesh = trimesh.Trimesh(vertices.astype(np.float64) + x[0], faces, process=True)
    body = trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(mesh.faces))
    mesh.update_faces(body == np.argmax(np.bincount(body)))
    mesh.remove_unreferenced_vertices()
    if mesh.volume < 0:
        mesh.invert()
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)
    np.savez(stored, vertices=vertices, faces=faces)
    return vertices, faces


def signed_area(polygons):
    x, y = np.concatenate(polygons).T
    following = np.arange(1, len(x) + 1)
    ends = np.cumsum([len(polygon) for polygon in polygons])
    following[ends - 1] = np.r_[0, ends[:-1]]
    return 0.5 * float(x @ y[following] - y @ x[following])


def alternating(calls, runs):
    """Median seconds of each call, and its last result."""
    seconds = [[] for _ in calls]
    results = [call() for call in calls]
    for _ in range(runs):
        for k, call in enumerate(calls):
            begin = time.perf_counter()
            results[k] = call()
            seconds[k].append(time.perf_counter() - begin)
    return [statistics.median(s) for s in seconds], results


def row(name, seconds, ratio, polygons):
    flat = [polygon for layer in polygons for polygon in layer]
    area = signed_area(flat)
    print(f"{name:52} {seconds:9.4f} {ratio:7.2f} {len(flat):7d} {area:14.1f}", flush=True)
    return len(flat), area


def against_manifold(cells, thickness, runs):
    vertices, faces = gyroid_brick(cells)
    planes = layer_planes(BED, SIZE, thickness).slicing
    heights = [float(plane.origin[2]) for plane in planes]

    def construct():
        return manifold3d.Manifold(manifold3d.Mesh64(vertices, faces.astype(np.uint64)))

    ready = construct()
    print(f"{len(faces)} triangles, {len(planes)} planes, every {thickness:g} mm")
    times, polygons = alternating(
        [
            lambda: SurfaceCutter(vertices, faces).cut(planes),
            lambda: [ready.slice(z).to_polygons() for z in heights],
            lambda: (solid := construct()) and [solid.slice(z).to_polygons() for z in heights],
        ],
        runs,
    )
    names = (
        "twincell, adjacency included",
        "manifold3d, ready Manifold",
        "manifold3d, construction included",
    )
    counts = [row(f"  {name}", s, s / times[0], p) for name, s, p in zip(names, times, polygons, strict=True)]
    (loops, area), (peer_loops, peer_area) = counts[:2]
    if loops != peer_loops or abs(area - peer_area) > 1e-4 * abs(peer_area):
        print(f"  MISMATCH: {loops} loops against {peer_loops}, area {area:.1f} against {peer_area:.1f} mm²")
        return False
    return True


def rotary_against_parallel(cells, runs):
    vertices, faces = gyroid_brick(cells)
    parallel = layer_planes(BED, SIZE, 2.0).slicing
    bed = Plane(np.array([0.5 * SIZE, 0.5 * SIZE, 0.0]), BED.x_axis, BED.y_axis)
    tilt = np.radians(40.0)
    pivot = np.array(
        [SIZE - SIZE / np.tan(tilt) - 10.0, 0.0, 0.0]
    )  # the top plane clears the brick's top edge
    top = Plane(pivot, np.array([np.cos(tilt), 0.0, np.sin(tilt)]), BED.y_axis)
    arc = (bed.origin[0] - pivot[0]) * tilt
    rotary = layer_planes(bed, top, arc / len(parallel)).slicing
    print(f"{len(faces)} triangles, {len(rotary)} planes: a fan of 40° against parallel ones")
    times, polygons = alternating(
        [
            lambda: SurfaceCutter(vertices, faces).cut(parallel),
            lambda: SurfaceCutter(vertices, faces).cut(rotary),
        ],
        runs,
    )
    for name, s, p in zip(("twincell, parallel", "twincell, rotary"), times, polygons, strict=True):
        row(f"  {name}", s, s / times[0], p)


def main():
    print(f"{'':52} {'seconds':>9} {'ratio':>7} {'loops':>7} {'area mm²':>14}")
    agree = [
        against_manifold(SMALL, 10.0, 15),
        against_manifold(SMALL, 2.0, 9),
        against_manifold(LARGE, 2.0, 5),
    ]
    rotary_against_parallel(LARGE, 7)
    sys.exit(0 if all(agree) else 1)


if __name__ == "__main__":
    main()
