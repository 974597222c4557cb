"""The main job, end to end, on the demo: every figure is computed here from the files that the demo wrote."""

import json
import re
import shutil
import sqlite3
import subprocess
import sys

import meshio
import numpy as np
import pytest
import trimesh
from shapes import manifold_faults

from planning import Program, SegmentKind


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    out = tmp_path_factory.mktemp("demo") / "job"
    ended = subprocess.run(
        [sys.executable, "-m", "twincell", "demo", "--out", str(out)],
        capture_output=True,
        text=True,
        timeout=400,
    )
    assert ended.returncode == 0, ended.stderr
    return out, ended.stdout


@pytest.fixture(scope="module")
def program(demo):
    return Program.load(demo[0] / "program.npz")


@pytest.fixture(scope="module")
def toolpath(demo):
    return json.loads((demo[0] / "toolpath.json").read_text())


@pytest.fixture(scope="module")
def samples(demo):
    with sqlite3.connect(demo[0] / "journal.sqlite") as database:
        columns = "time, x, y, z, command, flow, segment"
        return np.array(database.execute(f"SELECT {columns} FROM samples ORDER BY time").fetchall()).T


def normal(plane):
    return np.cross(plane["x_axis"], plane["y_axis"])


def to_bed(program, demo):
    """Waypoints in part coordinates, from the cell file itself."""
    import tomllib

    from planning.configuration import shipped_configurations

    bed = tomllib.loads((shipped_configurations() / "cells" / "ur10e-demo.toml").read_text())["bed"]
    assert "x_axis" not in bed  # the shipped bed's axes are the robot's
    return program.positions - np.array(bed["origin"])


def printed_volume(program):
    """Σ width × local height × length."""
    total = 0.0
    for s in program.segments:
        if s.kind is SegmentKind.PRINT:
            length = np.linalg.norm(np.diff(program.positions[s.start : s.stop], axis=0), axis=1)
            section = (program.width * program.height)[s.start : s.stop]
            total += (0.5 * (section[1:] + section[:-1]) * length).sum()
    return total


def integral(values, time):
    return float((0.5 * (values[1:] + values[:-1]) * np.diff(time)).sum())


def test_the_robot_passed_the_waypoints(program, samples):
    _, x, y, z, *_ = samples
    path = np.column_stack([x, y, z])
    wanted = program.positions[program.of_kind(SegmentKind.PRINT)]
    start, step = path[:-1], np.diff(path, axis=0)
    size = np.maximum((step**2).sum(axis=1), 1e-12)
    nearest = np.empty(len(wanted))
    for i, point in enumerate(wanted):
        share = np.clip(((point - start) * step).sum(axis=1) / size, 0.0, 1.0)
        nearest[i] = np.linalg.norm(start + share[:, None] * step - point, axis=1).min()
    assert (nearest < 1.0).mean() >= 0.95


def test_what_left_the_nozzle_is_what_was_planned(program, samples):
    time, *_, flow, segment = samples
    assert integral(flow, time) == pytest.approx(printed_volume(program), rel=0.02)
    printing = np.array([s.kind is SegmentKind.PRINT for s in program.segments])
    inside = printing[np.clip(segment.astype(int), 0, len(printing) - 1)] & (segment >= 0)
    assert integral(np.where(inside, 0.0, flow), time) <= 0.005 * integral(flow, time)


def test_the_pump_was_told_over_modbus_and_the_arm_through_ur_rtde(samples, demo):
    _, *_, command, flow, _ = samples
    assert command.max() > 1000.0
    assert flow.max() > 1000.0
    lagged = np.corrcoef(command[:-5], flow[5:])[0, 1]
    assert lagged > 0.5  # what the pump measures follows what it was told
    with sqlite3.connect(demo[0] / "journal.sqlite") as database:
        (events,) = database.execute("SELECT count(*) FROM events").fetchone()
    assert events > 54


def test_local_height_is_the_distance_from_the_nozzle_plane_below(program, toolpath, demo):
    points = to_bed(program, demo)
    floors = [toolpath["base"]] + [layer["nozzle"] for layer in toolpath["layers"]]
    printing = program.of_kind(SegmentKind.PRINT)
    for k, floor in enumerate(floors[:-1]):
        here = printing & (program.layer == k)
        assert here.any()
        height = (points[here] - floor["origin"]) @ normal(floor)
        np.testing.assert_allclose(program.height[here], height, rtol=0.005)
    assert program.height[printing].min() < 3.01
    assert program.height[printing].max() > 3.65
    cruising = printing & (np.abs(program.speed - 50.0) < 1e-9)
    share = program.flow[cruising] / program.height[cruising]
    assert cruising.sum() > 2000
    assert np.ptp(share) < 1e-9 * share.mean()


def test_the_tool_axis_turns_from_bed_to_top(program, toolpath):
    top = toolpath["layers"][-1]["nozzle"]
    last = program.poses[program.of_kind(SegmentKind.PRINT)][-1, :3, 2]
    turned = np.degrees(np.arccos(last @ [0.0, 0.0, -1.0]))
    wanted = np.degrees(np.arccos(normal(top) @ normal(toolpath["base"])))
    assert turned == pytest.approx(wanted, abs=0.01)
    assert wanted == pytest.approx(28.0, abs=0.01)
    # And evenly: each layer by the same share.
    axes = [
        program.poses[program.of_kind(SegmentKind.PRINT) & (program.layer == k)][0, :3, 2] for k in range(44)
    ]
    tilt = np.degrees(np.arccos(np.array(axes) @ [0.0, 0.0, -1.0]))
    np.testing.assert_allclose(tilt, 28.0 / 44 * np.arange(1, 45), atol=0.01)


def test_M_and_M_prime_are_closed_manifolds(demo):
    for name in ("surface.ply", "volume.ply"):
        mesh = trimesh.load(demo[0] / name, process=False)
        assert manifold_faults(mesh) == (0, 0)
        assert mesh.volume > 0


def test_M_prime_has_the_volume_of_its_layers(demo, toolpath):
    import shapely

    total = 0.0
    floors = [toolpath["base"]] + [layer["nozzle"] for layer in toolpath["layers"]]
    for floor, layer in zip(floors[:-1], toolpath["layers"], strict=True):
        rings = [shapely.LinearRing(curve["points"]).buffer(4.0) for curve in layer["curves"]]
        region = shapely.union_all(rings)
        u, v = region.centroid.coords[0]
        plane = layer["nozzle"]
        place = plane["origin"] + u * np.array(plane["x_axis"]) + v * np.array(plane["y_axis"])
        total += region.area * ((place - floor["origin"]) @ normal(floor))
    volume = trimesh.load(demo[0] / "volume.ply", process=False).volume
    assert volume == pytest.approx(total, rel=0.02)


def test_the_finite_element_mesh_knows_its_layers(demo):
    mesh = meshio.read(demo[0] / "fea" / "mesh.inp")
    (block,) = mesh.cells
    count = np.zeros(len(block.data), dtype=int)
    layers = [name for name in mesh.cell_sets if name.startswith("LAYER_")]
    assert len(layers) == 44
    for name in layers:
        members = np.concatenate(
            [np.asarray(part) for part in mesh.cell_sets[name] if part is not None]
        ).astype(int)
        assert len(members)
        count[members] += 1
    assert (count == 1).all()
    a, b, c, d = (mesh.points[block.data[:, k]] for k in range(4))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) > 0).all()
    base = mesh.point_sets["BASE"]
    assert len(base) > 50
    assert np.abs(mesh.points[base][:, 2]).max() < 1.0


def test_calculix_finds_the_weight(demo):
    if shutil.which("ccx") is None:
        assert "not solved: ccx is not installed" in demo[1]
        pytest.skip("ccx is not installed")
    folder = demo[0] / "fea"
    ended = subprocess.run(
        ["ccx", "-i", "self_weight"], cwd=folder, capture_output=True, text=True, timeout=300
    )
    assert ended.returncode == 0
    assert "cannot be interpreted" not in re.sub(r"\s+", " ", ended.stdout)
    assert "cannotbeinterpreted" not in re.sub(r"\s+", "", ended.stdout)
    solved = json.loads((folder / "fea.json").read_text())["self_weight"]
    volume = trimesh.load(demo[0] / "volume.ply", process=False).volume
    weight = volume * 2070e-12 * 9810.0
    assert solved["weight_n"] == pytest.approx(weight, rel=0.01)
    assert solved["imbalance"] <= 0.005
    # The same from the solver's own file: its reactions leave out what acts on the fixed nodes themselves.
    total = re.findall(
        r"total force.*?\n\s*\n\s*(\S+)\s+(\S+)\s+(\S+)", (folder / "self_weight.dat").read_text()
    )
    mesh = meshio.read(folder / "mesh.inp")
    (block,) = mesh.cells
    a, b, c, d = (mesh.points[block.data[:, k]] for k in range(4))
    volumes = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0
    # Consistent loads of a straight 10-node tetrahedron: -1/20 of its weight at corners, 1/5 at mid-side nodes.
    lumped = np.zeros(len(mesh.points))
    np.add.at(lumped, block.data[:, :4], -volumes[:, None] / 20.0)
    np.add.at(lumped, block.data[:, 4:], volumes[:, None] / 5.0)
    on_base = lumped[mesh.point_sets["BASE"]].sum() * 2070e-12 * 9810.0
    assert float(total[-1][2]) + on_base == pytest.approx(volumes.sum() * 2070e-12 * 9810.0, rel=0.005)


def test_the_summary_and_the_pictures(demo, program):
    summary = json.loads((demo[0] / "report" / "summary.json").read_text())
    assert summary["layers"] == 44
    assert summary["starts"] == 54
    # Its opening has a flat top: the fresh mortar would sag there.
    assert [(f["kind"], f["severity"]) for f in summary["findings"]] == [("overhang by ground", "warning")]
    assert summary["bead_volume_l"] == pytest.approx(printed_volume(program) * 1e-6, rel=1e-4)
    assert summary["deposited_volume_l"] == pytest.approx(summary["bead_volume_l"], rel=0.02)
    for key in (
        "path_length_m", "volume_of_m_prime_l", "print_time_s", "travel_length_m", "local_height_min_mm",
        "local_height_max_mm", "worst_deviation_mm",
    ):  # fmt: skip
        assert summary[key] > 0
    for picture in ("layers", "height_and_flow", "joints"):
        assert (demo[0] / "report" / f"{picture}.png").read_bytes()[:4] == b"\x89PNG"
