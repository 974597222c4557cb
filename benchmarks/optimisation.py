"""Optimisation of toolpaths: seconds, and how much faster than the way the paper does it.

Overfill: 100,000 points x 30 steps of equation 4 with segments d_min / 4 long, all in one layer, and as layers of a
stack worked on side by side. The peer finds the points within d_min of each by an rtree that is loaded in bulk anew in
every step, as the paper does; it runs a few steps, and its time is scaled to 30.
"""

import os

# Kernels for the machine at hand, also where the environment asks for others.
os.environ.pop("OPENBLAS_CORETYPE", None)
os.environ.pop("OPENBLAS_L2_SIZE", None)

import argparse
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import rtree

from twins import Curve, Layer, Plane, Toolpath
from twins.curves.close_points import ALONG, Runs
from twins.curves.overfill import relieve_overfill

D_MIN = 20.0
POINTS, STEPS = 100_000, 30


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


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peer-steps", type=int, default=1, help="steps that the rtree runs; 0: none")
    overfill(parser.parse_args().peer_steps)


if __name__ == "__main__":
    main()
