"""How well M hangs together as the part does: with the surface known, and from the toolpath alone.

Every part is sliced as it stands and in twelve random attitudes, t = L_R = 10 mm. `exact` counts attitudes in which M
has the part's Euler characteristic and number of bodies (else their differences are listed); volume is the largest
deviation from the sum of region area x local thickness. Arguments are mesh files to be added, scaled to 300 mm.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from shapes import REFERENCE, manifold_faults, printed_volume, rotated

from twins import (
    Plane,
    TwinsError,
    layer_planes,
    make_surface,
    read_surface,
    repair_surface,
    signed_volume,
    slice_surface,
    toolpath_mesh,
)

BED = Plane.horizontal()
THICKNESS = 10.0


def loaded(path, size=300.0):
    surface, _ = repair_surface(read_surface(path))
    vertices = np.asarray(surface.vertices) * size / np.ptp(surface.vertices, axis=0).max()
    return make_surface(vertices - [0.0, 0.0, vertices[:, 2].min()], surface.faces)


def attitudes(surface, count):
    yield 0, surface
    for seed in range(1, count + 1):
        yield seed, rotated(surface, seed)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--rotations", type=int, default=12)
    arguments = parser.parse_args()
    parts = dict(REFERENCE)
    parts.update({path.stem: lambda path=path: loaded(path) for path in arguments.files})
    print(f"{'':24}{'surface known':^22}{'toolpath alone':^22}")
    print(
        f"{'part':24}{'exact':>10}{'volume':>10}{'exact':>12}{'volume':>10}   in the toolpath alone, by attitude",
        flush=True,
    )
    total = right = faults = 0
    for name, make in parts.items():
        exact, volume, misses = [0, 0], [0.0, 0.0], []
        for seed, surface in attitudes(make(), arguments.rotations):
            total += 1
            toolpath = slice_surface(
                surface, layer_planes(BED, float(surface.vertices[:, 2].max()), THICKNESS)
            )
            wanted = surface.euler_number, surface.body_count
            expected = printed_volume(toolpath)
            for k, source in enumerate((surface, None)):
                try:
                    mesh = toolpath_mesh(toolpath, THICKNESS, source)
                except TwinsError as error:
                    print(f"    {name}, attitude {seed}: {error}", flush=True)
                    continue
                found = mesh.surface.euler_number, mesh.surface.body_count
                faults += manifold_faults(mesh.surface) != (0, 0)
                exact[k] += found == wanted
                right += k == 0 and found == wanted
                deviation = signed_volume(mesh.surface) / expected - 1.0
                volume[k] = max(volume[k], deviation, key=abs)
                if k and found != wanted:
                    misses.append(f"{seed}: {found[0] - wanted[0]:+d}/{found[1] - wanted[1]:+d}")
                elif found != wanted:
                    print(
                        f"    {name}, attitude {seed}: {found} instead of {wanted}, gaps {mesh.unresolved}",
                        flush=True,
                    )
        count = arguments.rotations + 1
        print(f"{name:24}{exact[0]:>5} / {count:<3}{volume[0]:>9.2%}{exact[1]:>6} / {count:<3}{volume[1]:>10.2%}   "
              + ", ".join(misses), flush=True)  # fmt: skip
    print(
        f"\nsurface known: {right} of {total} exact ({right / total:.1%}); meshes that are not manifold: {faults}"
    )


if __name__ == "__main__":
    main()
