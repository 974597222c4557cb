"""Optimisation of toolpaths and of surfaces: seconds, and the tables of docs/overhang-relaxation.md.

    python benchmarks/optimisation.py            overfill and overhang
    python benchmarks/optimisation.py overfill   100,000 points x 30 steps of equation 4, beside an rtree
    python benchmarks/optimisation.py overhang   relaxation of 10 and 100 thousand vertices, and where its time goes
    python benchmarks/optimisation.py reference  relaxation of the reference shapes of tests/shapes.py, many minutes
    python benchmarks/optimisation.py plain      the same with the method as it was published

Overfill runs with segments d_min / 4 long, all in one layer, and as layers of a stack worked on side by side. The
peer finds the points within d_min of each by an rtree that is loaded in bulk anew in every step, as the paper does; it
runs a few steps, and its time is scaled to 30.

Overhang states CPU seconds beside those of the clock: on a machine that does other things only they compare.
"""

import os

# Kernels for the machine at hand, also where the environment asks for others.
os.environ.pop("OPENBLAS_CORETYPE", None)
os.environ.pop("OPENBLAS_L2_SIZE", None)

import argparse
import cProfile
import math
import pstats
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import rtree
from scipy.sparse.linalg import splu
from scipy.spatial import ConvexHull

from twins import Curve, Layer, Plane, Toolpath, make_surface, signed_volume
from twins.curves.close_points import ALONG, Runs
from twins.curves.overfill import relieve_overfill
from twins.overhang.cotangent import (
    cotangent_laplacian,
    cotangent_weights,
    face_edges,
    vertex_areas,
    vertex_normals,
)
from twins.overhang.energy import edge_covariances
from twins.overhang.inversions import inverted_faces
from twins.overhang.locks import lock_bounds
from twins.overhang.relaxation import relax_overhang
from twins.overhang.rotations import best_rotations
from twins.overhang.surfaces import surface_overhang

D_MIN = 20.0
POINTS, STEPS = 100_000, 30

STAGES = {
    "factorisation": ("gstrf",),
    "solves": ("'solve' of 'SuperLU'",),
    "local step (rotations)": ("turn_to_best", "edge_covariances"),
    "energy and gradient": ("shape_energy", "normal_energy", "volume_energy"),
    "walls": ("across_walls", "_cKDTree"),
    "quasi-Newton vectors": ("quasi_newton.py",),
}


def wavy(points, seed):
    """Pairs of wavy runs whose distance varies between 0.5 and 2 d_min, in segments of just below d_min / 4."""
    rng = np.random.default_rng(seed)
    n = min(points // 2, 2500)
    x = np.arange(0.0, n * D_MIN / 4, D_MIN / 40)
    along = 0.999 * D_MIN / 4 * np.arange(n)
    curves = []
    for pair in range(points // (2 * n)):
        middle = 8 * D_MIN * pair + 30.0 * np.sin(x / 400.0 + rng.uniform(0, 6))
        half = 0.5 * D_MIN * (1.25 + 0.75 * np.sin(x / 150.0 + rng.uniform(0, 6)))
        for y in (middle - half, middle + half):
            place = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))) - rng.uniform(0, D_MIN / 4)
            curves.append(
                Curve(np.column_stack([np.interp(along, place, x), np.interp(along, place, y)]), closed=False)
            )
    return curves


def stack(layers):
    planes = [
        (Plane.horizontal(10.0 * i + 5.0), Plane.horizontal(10.0 * i + 10.0)) for i in range(len(layers))
    ]
    return Toolpath(
        Plane.horizontal(),
        tuple(Layer(*pair, tuple(curves)) for pair, curves in zip(planes, layers, strict=True)),
        10.0,
    )


def with_rtree(curves, steps, strength):
    """Equation 4 with a query of an rtree for each point: seconds of `steps` steps, and of the queries among them."""
    runs = Runs.of(curves)
    points = runs.points.copy()
    place = np.concatenate([D_MIN / 4 * np.arange(len(curve.points)) for curve in curves])
    began = time.perf_counter()
    arithmetic = 0.0
    for _ in range(steps):
        index = rtree.index.Index((np.arange(len(points)), points, points))
        push = np.zeros_like(points)
        for i, (x, y) in enumerate(points):
            near = np.fromiter(index.intersection((x - D_MIN, y - D_MIN, x + D_MIN, y + D_MIN)), np.int64)
            found = time.perf_counter()
            away = points[i] - points[near]
            r = np.hypot(away[:, 0], away[:, 1])
            own = (runs.curve[near] == runs.curve[i]) & (np.abs(place[near] - place[i]) < ALONG * D_MIN)
            kept = (r < D_MIN) & (r > 0.0) & ~own
            if kept.any():
                push[i] = strength * np.mean(away[kept] * (D_MIN / r[kept] - 1.0)[:, None], axis=0)
            arithmetic += time.perf_counter() - found
        points += push
    whole = time.perf_counter() - began
    return whole, whole - arithmetic


def seconds(work):
    taken = []
    for _ in range(3):
        began = time.perf_counter()
        work()
        taken.append(time.perf_counter() - began)
    return min(taken)


def overfill(peer_steps):
    one = wavy(POINTS, 0)
    layers = [wavy(5_000, seed) for seed in range(20)]
    relieve_overfill(stack(layers[:1]), D_MIN, steps=2)  # compiles

    def ours(toolpath, executor=None):
        # So weak that none of the steps is the last.
        return relieve_overfill(toolpath, D_MIN, strength=0.1, steps=STEPS, executor=executor)

    result = ours(stack([one]))
    assert result.layers[0].steps == STEPS
    single = seconds(lambda: ours(stack([one])))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        many = seconds(lambda: ours(stack(layers), pool))
    print(f"overfill, {POINTS:,} points x {STEPS} steps, d_min {D_MIN:g}, segments {D_MIN / 4:g}")
    print(f"  {'one layer':42}{single:9.2f} s")
    print(f"  {f'20 layers, {os.cpu_count()} threads':42}{many:9.2f} s")
    before, after = result.before, result.after
    print(f"  length below 0.95 d_min {before.close:,.0f} -> {after.close:,.0f} mm of {before.length:,.0f}")
    if peer_steps:
        for name, taken in zip(("in all", "queries alone"), with_rtree(one, peer_steps, 0.1), strict=True):
            peer = taken * STEPS / peer_steps
            print(f"  {f'one layer, rtree, {name}':42}{peer:9.2f} s  {peer / single:6.0f} x")


def sphere(n):
    """A triangulated sphere of radius 150 with n even vertices on z = 0 and above."""
    k = np.arange(n) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * k / n), np.pi * (1.0 + math.sqrt(5.0)) * k
    points = np.column_stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)])
    faces = ConvexHull(points).simplices.astype(np.int64)
    a, b, c = points[faces].transpose(1, 0, 2)
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0.0
    faces[inwards] = faces[inwards, ::-1]
    return make_surface(150.0 * points + [0.0, 0.0, 150.0], faces)


def vase_radius(z):
    return 120.0 + 60.0 * np.sin(2.0 * np.pi * z / 400.0 + 0.6)


def vase(n, wall=12.0, floor=20.0):
    """The vase of facts/shapes.md with about n even vertices."""
    step = math.sqrt(9.0e5 / n)

    def straight(start, end):
        pieces = max(2, round(math.dist(start, end) / step))
        share = np.linspace(0.0, 1.0, pieces, endpoint=False)[:, None]
        return (1.0 - share) * np.array(start) + share * np.array(end)

    def swung(start, end, inwards):
        z = np.linspace(start, end, 4000)
        r = vase_radius(z) - inwards
        length = np.r_[0.0, np.hypot(np.diff(z), np.diff(r)).cumsum()]
        z = np.interp(np.linspace(0.0, length[-1], round(length[-1] / step), endpoint=False), length, z)
        return np.column_stack([vase_radius(z) - inwards, z])

    inner = vase_radius(floor) - wall
    profile = np.vstack(
        [
            straight((step, 0.0), (vase_radius(0.0), 0.0)),
            swung(0.0, 400.0, 0.0),
            straight((vase_radius(400.0), 400.0), (vase_radius(400.0) - wall, 400.0)),
            swung(400.0, floor, wall),
            straight((inner, floor), (step, floor)),
            [[step, floor]],
        ]
    )
    around = round(2.0 * np.pi * 130.0 / step)
    angle = 2.0 * np.pi * np.arange(around) / around
    rings = [np.column_stack([r * np.cos(angle), r * np.sin(angle), np.full(around, z)]) for r, z in profile]
    index = np.arange(len(profile) * around).reshape(len(profile), around)
    a, b, c, d = index[:-1], np.roll(index[:-1], -1, 1), np.roll(index[1:], -1, 1), index[1:]
    last = np.roll(index, -1, 1)
    under, over = index.size, index.size + 1
    faces = [
        np.stack([a, b, c], -1).reshape(-1, 3),
        np.stack([a, c, d], -1).reshape(-1, 3),
        np.column_stack([last[0], index[0], np.full(around, under)]),
        np.column_stack([index[-1], last[-1], np.full(around, over)]),
    ]
    return make_surface(np.vstack([*rings, [[0, 0, 0], [0, 0, floor]]]), np.vstack(faces))


def heights(surface):
    return np.asarray(surface.vertices)[:, 2]


def low_cap(surface):
    return heights(surface) <= 10.0


def floor_rim(surface):
    return heights(surface) <= 20.001


def both_rims(surface):
    return floor_rim(surface) | (heights(surface) >= 399.999)


def wide_rims(surface):
    return (heights(surface) <= 10.0) | (heights(surface) >= 390.0)


def bed(surface):
    return heights(surface) <= 1e-6


def plain(surface, limit_deg, locked, strength=20.0, inside_deg=5.0):
    """Liu & Jacobson's spherical analogy with a spindle: input vertex normals, an aim chosen beforehand."""
    old, faces = np.array(surface.vertices), np.array(surface.faces, dtype=np.int64)
    edges, weights = face_edges(old, faces), cotangent_weights(old, faces)
    normals, areas = vertex_normals(old, faces), vertex_areas(old, faces)
    aim = math.radians(limit_deg - inside_deg)
    target = normals.copy()
    over = normals[:, 2] < -math.sin(aim)
    across = np.maximum(np.hypot(*normals[over, :2].T), 1e-9)[:, None]
    target[over] = np.column_stack(
        [
            math.cos(aim) * normals[over, :2] / across,
            np.full(over.sum(), -math.sin(aim)),
        ]
    )
    free = np.flatnonzero(~locked)
    laplacian = cotangent_laplacian(faces, weights, len(old)).tocsr()
    factor = splu(
        laplacian[free][:, free].tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    pull = strength * areas[:, None, None] * np.einsum("ni,nj->nij", normals, target)
    no_ties = np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 3)), np.empty(0)
    new, R, S = old.copy(), None, np.empty((len(old), 3, 3))
    iterations, change = 0, math.inf
    while change >= 1e-4 and iterations < 200:
        iterations += 1
        edge_covariances(new, faces, edges, weights, *no_ties, S)
        R = best_rotations(S + pull, R)
        turn = R[faces].sum(axis=1) / 3.0
        wanted = weights[:, :, None] * np.einsum("fij,fej->fei", turn, edges)
        right = np.zeros_like(old)
        for e in range(3):
            np.add.at(right, faces[:, (e + 2) % 3], wanted[:, e])
            np.subtract.at(right, faces[:, (e + 1) % 3], wanted[:, e])
        fixed = np.where(locked[:, None], old, 0.0)
        after = old.copy()
        after[free] = factor.solve((right - laplacian @ fixed)[free])
        change = np.abs(after - new).max() / max(np.abs(after - old).max(), 1e-300)
        new = after
    return make_surface(new, faces), iterations


def over_area(surface, limit_deg, locked, side):
    found = surface_overhang(surface, side=side)
    counted = ~locked[np.asarray(surface.faces)].all(axis=1)
    return found.weights[counted & (found.values > math.tan(math.radians(limit_deg)) + 1e-8)].sum()


def report(name, surface, relaxed, limit_deg, locked, side, iterations, seconds):
    old, new = np.asarray(surface.vertices), np.asarray(relaxed.vertices)
    moved = np.linalg.norm(new - old, axis=1)
    diagonal = np.linalg.norm(np.ptp(old, axis=0))
    before, after = (over_area(mesh, limit_deg, locked, side) for mesh in (surface, relaxed))
    share = before / surface.area_faces[~locked[surface.faces].all(axis=1)].sum()
    volume = signed_volume(relaxed) / signed_volume(surface) - 1.0
    folds = inverted_faces(old, new, np.asarray(surface.faces)).sum()
    kept = relaxed.euler_number == surface.euler_number and not moved[locked].any()
    print(
        f"| {name} | {limit_deg:.0f}° | {side} | {len(old)} | {100 * share:.1f} % | {after / before:.3f} | "
        f"{100 * volume:+.1f} % | {100 * moved.mean() / diagonal:.2f} % | {moved.max():.0f} | {folds} | "
        f"{'yes' if kept else 'NO'} | {iterations} | {seconds:.1f} |",
        flush=True,
    )


def reference(method):
    sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
    from shapes import REFERENCE  # noqa: PLC0415 - needs scikit-image, which the timing does not

    relax_overhang(sphere(500), 45.0)
    cases = [
        ("sphere, z ≤ 10", "sphere", 45.0, low_cap),
        ("vase, floor z ≤ 20", "vase", 30.0, floor_rim),
        ("vase, bed only", "vase", 30.0, bed),
        ("vase, floor and top ring", "vase", 30.0, both_rims),
        ("vase, z ≤ 10 and z ≥ 390", "vase", 30.0, wide_rims),
        ("gyroid brick, outer box", "gyroid shell brick", 45.0, lock_bounds),
    ]
    print(
        "| case | θ | side | vertices | over before | after/before | volume | mean | max mm | folds | kept ",
        end="",
    )
    print("| iterations | CPU s |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|")
    for label, shape, limit, lock in cases:
        surface = REFERENCE[shape]()
        locked = lock(surface)
        for side in ("below", "both"):
            begin = time.process_time()
            if method == "plain":
                if side == "both":
                    continue
                relaxed, iterations = plain(surface, limit, locked)
            else:
                result = relax_overhang(surface, limit, locked=locked, side=side)
                relaxed, iterations = result.surface, result.iterations
            seconds = time.process_time() - begin
            report(label, surface, relaxed, limit, locked, side, iterations, seconds)


def overhang():
    relax_overhang(sphere(500), 45.0)  # compiles
    print("overhang relaxation, area over the limit as a share of what was over before")
    for n, runs in ((10_000, 3), (100_000, 1)):
        for name, make, limit, lock in (("sphere", sphere, 45.0, low_cap), ("vase", vase, 30.0, both_rims)):
            surface = make(n)
            locked = lock(surface)
            clock, cpu = [], []
            for _ in range(runs):
                start, used = time.perf_counter(), time.process_time()
                result = relax_overhang(surface, limit, locked=locked)
                clock.append(time.perf_counter() - start)
                cpu.append(time.process_time() - used)
            title = f"{name} {limit:.0f}°, {len(surface.vertices):,} vertices"
            print(
                f"  {title:42}{np.median(clock):9.2f} s  CPU {np.median(cpu):6.2f} s"
                f"  {result.iterations} iterations  over {result.remaining:.3f}"
            )
            print(
                "    "
                + ", ".join(f"{stage} {share:.0%}" for stage, share in profiled(surface, limit, locked))
            )


def profiled(surface, limit, locked):
    """Shares of the CPU time of one run, by stage."""
    profiler = cProfile.Profile(time.process_time)
    profiler.runcall(relax_overhang, surface, limit, locked=locked)
    own = [(file + name, row[2]) for (file, _, name), row in pstats.Stats(profiler).stats.items()]
    total = sum(seconds for _, seconds in own)
    shares = [
        (stage, sum(seconds for where, seconds in own if any(part in where for part in parts)) / total)
        for stage, parts in STAGES.items()
    ]
    return [*shares, ("the rest", 1.0 - sum(share for _, share in shares))]


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", nargs="?", choices=("overfill", "overhang", "reference", "plain"))
    parser.add_argument("--peer-steps", type=int, default=1, help="steps that the rtree runs; 0: none")
    asked = parser.parse_args()
    if asked.what in (None, "overfill"):
        overfill(asked.peer_steps)
    if asked.what in (None, "overhang"):
        overhang()
    if asked.what in ("reference", "plain"):
        reference(asked.what)


if __name__ == "__main__":
    main()
