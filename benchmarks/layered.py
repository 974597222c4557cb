"""The layered mesh of printed volumes: size, shape, volume and time; on one small shape against fTetWild.

fTetWild knows no layers: its row shows what a general mesher makes of the same boundary, and when.
"""

import os

os.environ.pop("OPENBLAS_CORETYPE", None)
os.environ.pop("OPENBLAS_L2_SIZE", None)

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from shapes import REFERENCE, box, printed_volume

from analysis import MeshingTimeout, tetrahedralize
from twincell.springer import springer_top
from twins import Plane, bead_outlines, extrude, layer_planes, slice_surface
from twins.layered import layered_mesh
from twins.tet_quality import mean_ratios

BED = Plane.horizontal()
T = 10.0
WIDTHS = (20.0, 25.0, 30.0)
SHAPES = ("sphere", "torus standing", "Y-branch", "spiral vase", "springer", "porous column")
ONCE = ("gyroid shell brick",)
"""At the first width only."""
LIMIT_S = 120.0


def sliced(name, surface):
    top = springer_top() if name == "springer" else float(surface.vertices[:, 2].max())
    return slice_surface(surface, layer_planes(BED, top, T), T)


def row(name, width, points, tets, deviation, seconds):
    quality = mean_ratios(points, tets)
    print(
        f"{name:20} {width:5.0f} {len(tets):9} {quality.min():8.4f} {np.quantile(quality, 0.01):8.3f} "
        f"{np.median(quality):8.3f} {100 * deviation:8.2f} {seconds:8.2f}",
        flush=True,
    )


def measure(name, toolpath, width):
    start = time.perf_counter()
    mesh = layered_mesh(toolpath, width, T)
    seconds = time.perf_counter() - start
    expected = printed_volume(bead_outlines(toolpath, width, T))
    row(name, width, mesh.points, mesh.tets, mesh.volume / expected - 1.0, seconds)


def against_tetwild():
    toolpath = sliced("box", box(120.0, 80.0, 40.0))
    measure("small box", toolpath, 20.0)
    volume = extrude(toolpath, 20.0, T)
    start = time.perf_counter()
    try:
        points, tets = tetrahedralize(volume, T, 0.02 * T, LIMIT_S)
    except MeshingTimeout as error:
        print(f"{'  fTetWild':20} {error}")
        return
    seconds = time.perf_counter() - start
    expected = printed_volume(bead_outlines(toolpath, 20.0, T))
    a, b, c, d = points[tets].transpose(1, 0, 2)
    total = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a).sum() / 6.0
    row("  fTetWild", 20.0, points, tets, total / expected - 1.0, seconds)


def main():
    layered_mesh(sliced("box", box(60.0, 60.0, 20.0)), 20.0)  # compiles the kernels
    print(
        f"{'shape':20} {'width':>5} {'elements':>9} {'min':>8} {'1 %':>8} {'median':>8} {'volume %':>8} {'seconds':>8}"
    )
    against_tetwild()
    for name in (*SHAPES, *ONCE):
        toolpath = sliced(name, REFERENCE[name]())
        for width in WIDTHS[:1] if name in ONCE else WIDTHS:
            measure(name, toolpath, width)


if __name__ == "__main__":
    main()
