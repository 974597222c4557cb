"""Anchor plates for a vault springer: drawn as curves, united with its toolpath, smoothed, and meshed for FEA.

Section 5.2 of the seed paper (Figure 15, points 7 to 11) on a springer of our own that branches into two arms:

1. The springer is sliced in rotary layers: one curve a layer below the fork, two above.
2. Four ears with a bolt hole each are drawn as curves in the planes of the lowest layers: a second toolpath. A bolt
   stands upright on the bed while the layers turn, so its hole is found anew in each layer's plane.
3. Both are united layer by layer. The wall of the layers above would hang over the mouths of the ears, so a narrow
   slot is taken away there: its two runs lie side by side, a sill for that wall.
4. What is sharp where ears meet the wall is smoothed to a least radius. Curves may move outwards only: nothing is taken
   from springer or ears. Holes and sills stay to the bit, layers above the ears the objects that they were.
5. The twin's surface follows; the printed volume M' and its tetrahedra, with the nodes at the bolts, are made.

Run `python examples/fig15_anchor_plates.py`; pictures and meshes land in out/examples/fig15_anchor_plates.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import shapely
import trimesh
from anchor_pictures import draw_layer, draw_tetrahedra, draw_toolpaths, draw_volume, outer
from shapely import affinity
from shapely.geometry.base import BaseGeometry

from analysis import TetMesh, base_nodes, write_mesh
from twins import (
    Curve,
    Layer,
    Plane,
    PlaneStack,
    Toolpath,
    Twin,
    Zones,
    clean,
    difference,
    extrude,
    intersection,
    largest_turning,
    layer_planes,
    layered_mesh,
    local_overhang,
    reconstruct,
    regions_of,
    resample,
    smooth,
    split_layers,
    union,
    visual_mesh,
)

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

RADIUS, ANGLE = 1000.0, np.radians(24.0)  # of the arc along which the springer leans
WIDTH = 20.0  # of the bead, mm
BORE = 12.0  # radius of a bolt hole: 24 mm for M20
HOLE = BORE + 0.5 * WIDTH  # of the curve around it
ZONE = HOLE + 2.0  # of what smoothing leaves alone around a bolt
EAR = HOLE + WIDTH  # of an ear: its bead lies beside the one around the hole
BOLTS_AT = np.radians([28.0, 152.0, 208.0, 332.0])  # from the section's long axis
LEAST_RADIUS = 30.0  # 1 / κ_max
PLATES = 40.0  # height of the ears


@dataclass(frozen=True)
class Bolt:
    """A bolt that stands upright on the bed.

    Attributes:
        place: (x, y) of its axis, mm.
        root: (x, y) of a place inside the springer that its ear reaches to, mm.
    """

    place: Array
    root: Array


def planes(thickness: float) -> PlaneStack:
    """Rotary layers from the bed to the plane in which the arms end."""
    c, s = float(np.cos(ANGLE)), float(np.sin(ANGLE))
    top = Plane(
        np.array([RADIUS * (c - 1.0), 0.0, RADIUS * s]), np.array([c, 0.0, s]), np.array([0.0, 1.0, 0.0])
    )
    return layer_planes(Plane.horizontal(), top, thickness)


def springer(spacing: float) -> trimesh.Trimesh:
    """The springer's surface, reconstructed from sections: two lobes that drift apart, with a fillet between them."""
    stack = planes(spacing)
    layers = []
    for i, (slicing, nozzle) in enumerate(zip(stack.slicing, stack.nozzle, strict=True)):
        share = (i + 0.5) / len(stack)
        eased = share * share * (3.0 - 2.0 * share)
        lobe = affinity.scale(
            shapely.Point(0.0, 0.0).buffer(1.0, quad_segs=24), 84.0 - 20.0 * eased, 78.0 - 18.0 * eased
        )
        lobes = [affinity.translate(lobe, 0.0, y) for y in (-48.0 - 82.0 * eased, 48.0 + 82.0 * eased)]
        region = shapely.union_all(lobes).buffer(45.0, quad_segs=16).buffer(-45.0, quad_segs=16)
        layers.append(Layer(slicing, nozzle, curves_around(region)))
    return reconstruct(Toolpath(stack.base, tuple(layers), stack.thickness), 1.5 * stack.thickness)


def curves_around(region: BaseGeometry) -> tuple[Curve, ...]:
    """The curves around a region, interior left."""
    parts = [shapely.geometry.polygon.orient(part) for part in shapely.get_parts(region.simplify(0.02))]
    return tuple(
        Curve(shapely.get_coordinates(ring)[:-1])
        for part in parts
        for ring in (part.exterior, *part.interiors)
    )


def bolts_around(layer: Layer) -> list[Bolt]:
    """Bolts beside the wall of the lowest layer, in the directions `BOLTS_AT`."""
    wall = shapely.LinearRing(layer.curves[0].points)
    bolts = []
    for angle in BOLTS_AT:
        ray = shapely.LineString([(0.0, 0.0), (500.0 * np.sin(angle), 500.0 * np.cos(angle))])
        at = float(wall.project(shapely.centroid(wall.intersection(ray))))
        here, ahead = (np.array(wall.interpolate(at + step).coords[0]) for step in (0.0, 1.0))
        along = (ahead - here) / np.hypot(*(ahead - here))
        out = np.array([along[1], -along[0]])  # the interior is on the left
        places = layer.slicing.to_world(np.array([here + EAR * out, here - EAR * out]))
        bolts.append(Bolt(places[0, :2], places[1, :2]))
    return bolts


def anchor_plates(toolpath: Toolpath, bolts: Sequence[Bolt], count: int) -> tuple[Toolpath, Toolpath]:
    """Ears with holes, and the slots of the sills, for the lowest `count` layers, each in that layer's planes."""
    plates, sills = [], []
    for layer in toolpath.layers[:count]:
        springer_there = shapely.union_all(regions_of(layer))
        rim = springer_there.difference(springer_there.buffer(-WIDTH))
        ears, holes, slots = [], [], []
        for bolt in bolts:
            place, root = meets(layer.slicing, bolt.place), meets(layer.slicing, bolt.root)
            ears.append(shapely.convex_hull(shapely.union(disc(place, EAR), disc(root, 0.8 * EAR))))
            holes.append(disc(place, HOLE))
            mouth = shapely.LineString([place, root]).buffer(EAR - 0.75 * WIDTH, cap_style="flat")
            slots.append(
                rim.intersection(mouth).buffer(-0.45 * WIDTH).buffer(0.45 * WIDTH, quad_segs=8).simplify(0.2)
            )
        plate = shapely.union_all(ears).difference(shapely.union_all(holes))
        plates.append(replace(layer, curves=curves_around(plate)))
        sills.append(replace(layer, curves=curves_around(shapely.union_all(slots))))
    return (
        Toolpath(toolpath.base, tuple(plates), toolpath.thickness),
        Toolpath(toolpath.base, tuple(sills), toolpath.thickness),
    )


def disc(center: shapely.Point, radius: float) -> shapely.Polygon:
    return center.buffer(radius, quad_segs=32)


def meets(plane: Plane, xy: Array) -> shapely.Point:
    """Where an upright line meets a plane, in the plane's frame."""
    foot = np.array([*xy, 0.0])
    lift = -plane.height_of(foot[None])[0] / plane.normal[2]
    return shapely.Point(plane.to_frame((foot + [0.0, 0.0, lift])[None])[0, :2])


def what_stays(joint: Toolpath, bolts: Sequence[Bolt], count: int) -> Zones:
    """A cylinder around each bolt, the curves of the sills, and the layers above the ears."""
    solids = []
    for bolt in bolts:
        solid = trimesh.creation.cylinder(radius=ZONE, height=4.0 * PLATES, sections=48)
        solids.append(solid.apply_translation([*bolt.place, 0.0]))
    sills = []
    for i, layer in enumerate(joint.layers[:count]):
        zones = shapely.union_all([disc(meets(layer.slicing, bolt.place), ZONE) for bolt in bolts])
        for j, curve in enumerate(layer.curves):
            if curve.signed_area < 0 and not shapely.intersects_xy(zones, *curve.points[0]):
                sills.append((i, j))
    return Zones(solids=solids, curves=sills, layers=range(count, len(joint.layers)))


def printed_volume(toolpath: Toolpath, count: int, resolution: float) -> trimesh.Trimesh:
    """M', the layers with ears and those above made apart and united in the nozzle plane between them.

    In one piece, the slab between both leads from the tops of the ears up to the wall and closes the bolt holes.
    """
    parts = [extrude(part, WIDTH, resolution) for part in split_layers(toolpath, count)]
    top = toolpath.layers[count - 1].nozzle
    for part in parts:  # in the plane's frame, where they meet at 0 and not within rounding
        there = top.to_frame(np.asarray(part.vertices))
        there[np.abs(there[:, 2]) < 1e-6, 2] = 0.0
        part.vertices = there
    whole: trimesh.Trimesh = trimesh.boolean.union(parts, engine="manifold")
    whole.vertices = top.to_world(np.asarray(whole.vertices))
    return whole


def open_holes(volume: trimesh.Trimesh, bolts: Sequence[Bolt]) -> int:
    """How many bolts can be put in from above the ears."""
    start = [[*bolt.place, 1.5 * PLATES] for bolt in bolts]
    struck = volume.ray.intersects_location(start, np.tile([0.0, 0.0, -1.0], (len(bolts), 1)))[1]
    return len(bolts) - len(np.unique(struck))


def without_bores(toolpath: Toolpath, bolts: Sequence[Bolt], resolution: float) -> tuple[TetMesh, int]:
    """The tetrahedra of M', without those across bolt holes (see `printed_volume`), and how many these were."""
    made = layered_mesh(toolpath, WIDTH, resolution)
    centre = made.points[made.tets].mean(axis=1)
    off = np.min([np.hypot(*(centre[:, :2] - bolt.place).T) for bolt in bolts], axis=0)
    across = (off < 0.9 * BORE) & (centre[:, 2] < 1.5 * PLATES)
    used, tets = np.unique(made.tets[~across], return_inverse=True)
    return TetMesh(made.points[used], tets.reshape(-1, 4), made.layer[~across]), int(across.sum())


def bore_nodes(mesh: TetMesh, toolpath: Toolpath, bolts: Sequence[Bolt], count: int) -> Indices:
    """The nodes on the walls of the bolt holes."""
    top = toolpath.layers[count - 1].nozzle.height_of(mesh.points)
    off = np.min([np.hypot(*(mesh.points[:, :2] - bolt.place).T) for bolt in bolts], axis=0)
    near = np.flatnonzero((off < BORE + 1.0) & (top < 1e-6))
    return np.intersect1d(near, mesh.boundary())


def deepest(before: Layer, after: Layer) -> float:
    """How far curves reach into what was enclosed before, mm."""
    enclosed = shapely.union_all(regions_of(before))
    lines = [shapely.LinearRing(curve.points).segmentize(0.5) for curve in after.curves]
    inside = shapely.get_coordinates(shapely.intersection(lines, enclosed))
    return float(shapely.distance(shapely.points(inside), enclosed.boundary).max(initial=0.0))


def sharpest(toolpath: Toolpath, count: int) -> float:
    """The largest turning of an outer curve within the width of a bead, degrees."""
    return float(
        np.degrees(max(largest_turning(c, WIDTH) for layer in toolpath.layers[:count] for c in outer(layer)))
    )


def main(out: Path, quick: bool = False) -> dict[str, float]:
    """Run all steps, draw them into `out`, print and return their figures; `quick` with layers of 20 mm, not 10."""
    out.mkdir(parents=True, exist_ok=True)
    # Of layers; of segments; L_R of M' and of its tetrahedra.
    thickness, length, fine, mesh_step = (20.0, 4.0, 9.0, 20.0) if quick else (10.0, 2.5, 5.0, 8.0)
    count = round(PLATES / thickness)
    clock = Clock()

    twin = Twin(springer(0.5 * thickness), planes(thickness))
    component = twin.toolpath
    clock("springer, sliced")

    bolts = bolts_around(component.layers[0])
    plates, sills = anchor_plates(component, bolts, count)
    clock("plates drawn")
    united = union(component, plates)
    shared = intersection(component, plates)
    joint = clean(difference(united.toolpath, sills).toolpath, apart=0.25)
    clock("united, sills, cleaned")

    zones = what_stays(joint.toolpath, bolts, count)
    even = resample(joint.toolpath, length, corner_deg=10.0, locked=zones)
    smoothed = smooth(even, -1, 1.0 / LEAST_RADIUS, window=WIDTH, locked=zones)
    clock("resampled, smoothed")

    twin.replace_layers({i: smoothed.toolpath.layers[i].curves for i in range(count)})
    surface = twin.surface
    clock("twin's surface follows")
    final = twin.toolpath
    volume = printed_volume(final, count, fine)
    clock("volume M'")
    in_one = extrude(final, WIDTH, fine)
    clock("volume M' in one piece")
    mesh, across = without_bores(final, bolts, mesh_step)
    clock("tetrahedra")
    bores = bore_nodes(mesh, final, bolts, count)
    write_mesh(mesh, base_nodes(mesh.points, final.base, 1e-3), out)
    rows = [", ".join(str(k + 1) for k in bores[i : i + 16]) for i in range(0, len(bores), 16)]
    (out / "bolts.inp").write_text("\n".join(["*NSET, NSET=BOLTS", *rows, ""]), encoding="ascii")
    clock("tetrahedra written")

    before, after = joint.toolpath.layers[:count], final.layers[:count]
    inner = [[c for c in layer.curves if c.signed_area < 0] for layer in before]
    kept = [
        any(np.array_equal(c.points, d.points) for d in layer.curves)
        for layer, curves in zip(after, inner, strict=True)
        for c in curves
    ]
    figures = {
        "layers": len(final.layers),
        "layers touched": sum(a is not b for a, b in zip(component.layers, final.layers, strict=True)),
        "curves in them, springer": sum(len(layer.curves) for layer in component.layers[:count]),
        "curves in them, plates": sum(len(layer.curves) for layer in plates.layers),
        "curves in them, joint": sum(len(layer.curves) for layer in after),
        "largest |A∪B| + |A∩B| - |A| - |B|, mm²": max(
            abs(u.areas[2] + s.areas[2] - u.areas[0] - u.areas[1])
            for u, s in zip(united.layers, shared.layers, strict=True)
        ),
        "faults cleaned": len(joint.found),
        f"largest turning in {WIDTH:g} mm, °, before": sharpest(joint.toolpath, count),
        f"largest turning in {WIDTH:g} mm, °, after": sharpest(final, count),
        "largest displacement, mm": max(f.largest_displacement for f in smoothed.layers),
        "deepest point on the locked side, mm": max(map(deepest, even.layers[:count], after)),
        "deepest point inside the union, resampling included, mm": max(map(deepest, before, after)),
        "holes and sills": len(kept),
        "holes and sills kept to the bit": sum(kept),
        "largest overhang d/t, springer": local_overhang(component, "layer").maximum,
        "largest overhang d/t, united without sills": local_overhang(united.toolpath, "layer").maximum,
        "largest overhang d/t, joint": local_overhang(final, "layer").maximum,
        "surface M watertight": float(surface.is_watertight),
        "volume M' watertight": float(volume.is_watertight),
        "volume M', L": 1e-6 * float(volume.volume),
        "bolt holes open in M'": open_holes(volume, bolts),
        "bolt holes open in M' made in one piece": open_holes(in_one, bolts),
        "bolt holes open in tetrahedra": open_holes(
            trimesh.Trimesh(mesh.points, mesh.boundary(), process=False), bolts
        ),
        "tetrahedra": len(mesh.tets),
        "tetrahedra across bolt holes, taken out": across,
        "nodes on bolt holes": len(bores),
        "quality of tetrahedra, median": float(np.median(mesh.quality)),
        "volume of tetrahedra, L": 1e-6 * mesh.volume,
    }
    clock("measured")
    dpi = 70 if quick else 140
    zone_of = [disc(meets(after[0].slicing, bolt.place), ZONE) for bolt in bolts]
    one, ears, old, new = (toolpath.layers[0] for toolpath in (component, plates, even, final))
    draw_layer(out / "layer.png", one, ears, old, new, zone_of, WIDTH, dpi)
    draw_toolpaths(out / "joint_toolpath.png", component, plates, final, dpi)
    looks = [] if quick else [visual_mesh(part, WIDTH, 7.0) for part in split_layers(final, count)]
    draw_volume(out / "volume.png", volume, looks, dpi)
    draw_tetrahedra(out / "tetrahedra.png", mesh, bores, np.array([bolt.place for bolt in bolts]), dpi)
    clock("pictures")
    figures |= {f"time: {what}, s": seconds for what, seconds in clock.taken.items()}
    for name, value in figures.items():
        print(f"{name:58} {value:12.6g}")
    return figures


class Clock:
    """Seconds that each step took."""

    def __init__(self) -> None:
        self.taken: dict[str, float] = {}
        self._last = time.perf_counter()

    def __call__(self, step: str) -> None:
        """A step is done."""
        now = time.perf_counter()
        self.taken[step], self._last = now - self._last, now


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/examples/fig15_anchor_plates"))
    parser.add_argument("--quick", action="store_true")
    arguments = parser.parse_args()
    main(arguments.out, arguments.quick)
