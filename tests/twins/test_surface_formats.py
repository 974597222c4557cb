import signal
import zipfile

import numpy as np
import pytest
import rhino3dm
import trimesh
from rhino3dm import Point3d
from scipy.interpolate import BSpline
from scipy.spatial import cKDTree
from shapes import SHAPES, box, nested_cavity, torus

from twins import (
    FormatError,
    SurfaceError,
    TwinsError,
    check_surface,
    make_surface,
    read_surface,
    signed_volume,
)
from twins.formats.polygons import Polygons
from twins.formats.reading import unit_of
from twins.formats.subdivision import subdivide
from twins.formats.writing import write_surface
from twins.mesh_edges import arrays_of, edge_faults
from twins.surface import welded

try:
    import gmsh
except (ImportError, OSError):  # OSError: a library of the system is missing
    gmsh = None

SINGLE = 2.0**-23

# Format, and how far a coordinate of size 1 may come back from where it was.
PRECISION = {"stl": SINGLE, "ply": 0.0, "obj": 0.0, "3mf": 0.0, "3dm": 0.0, "glb": SINGLE, "gltf": SINGLE}


def matched(surface, other):
    """Corners of all triangles of two meshes, in an order that does not depend on that of vertices."""
    return [np.asarray(m.vertices)[np.asarray(m.faces)] for m in (surface, other)]


@pytest.mark.parametrize("suffix", PRECISION)
@pytest.mark.parametrize("name", SHAPES)
def test_surfaces_come_back_as_they_were(tmp_path, name, suffix):
    surface = welded(*arrays_of(SHAPES[name]()))
    path = tmp_path / f"part.{suffix}"
    write_surface(surface, path)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    back = read_surface(path)
    check_surface(back)
    before, after = matched(surface, back)
    assert before.shape == after.shape
    size = np.abs(before).max()
    # glTF is in metres: the factor rounds once more.
    slack = PRECISION[suffix] + (4e-16 if suffix not in {"ply", "obj", "3mf", "3dm"} else 0.0)
    assert np.abs(before - after).max() <= slack * size


@pytest.mark.parametrize(
    ("suffix", "unit"),
    [("3mf", "mm"), ("3dm", "mm"), ("glb", "m"), ("gltf", "m"), ("stl", None), ("obj", None)],
)
def test_units_are_told(tmp_path, suffix, unit):
    path = tmp_path / f"part.{suffix}"
    write_surface(box(), path)
    assert unit_of(path) == unit
    if unit is None:
        assert np.ptp(read_surface(path, unit="in").vertices, axis=0) == pytest.approx([5080.0] * 3)
    else:
        assert np.ptp(read_surface(path, unit=unit).vertices, axis=0) == pytest.approx([200.0] * 3)
        with pytest.raises(FormatError, match=f"is in {unit} as the file itself says, not in ft"):
            read_surface(path, unit="ft")


def test_gltf_is_in_metres_with_y_up(tmp_path):
    surface = box(100.0, 200.0, 300.0)
    write_surface(surface, tmp_path / "part.glb")
    seen = trimesh.load(tmp_path / "part.glb", force="mesh")
    assert seen.bounds == pytest.approx(np.array([[-0.05, 0.0, -0.1], [0.05, 0.3, 0.1]]))
    assert seen.volume == pytest.approx(6e-3, rel=1e-6)


@pytest.mark.parametrize(("unit", "factor"), [("inch", 25.4), ("meter", 1e3), ("centimeter", 10.0)])
def test_3mf_states_its_unit(tmp_path, unit, factor):
    path, other = tmp_path / "part.3mf", tmp_path / "other.3mf"
    write_surface(torus(), path)
    with zipfile.ZipFile(path) as given, zipfile.ZipFile(other, "w") as made:
        for name in given.namelist():
            made.writestr(name, given.read(name).replace(b'unit="millimeter"', f'unit="{unit}"'.encode()))
    before, after = matched(read_surface(path), read_surface(other))
    assert np.abs(after - factor * before).max() <= 1e-15 * np.abs(after).max() * 4
    assert unit_of(other) == {25.4: "in", 1e3: "m", 10.0: "cm"}[factor]


def step(path, draw):
    if gmsh is None:
        pytest.skip("gmsh cannot be loaded here: it needs libGLU, libXft and libXinerama of the system")
    pipe = signal.getsignal(signal.SIGPIPE)
    gmsh.initialize(["", "-nopopup"], False, False)
    # It puts the signal back to its default, which ends a process that writes to a socket closed by its peer.
    signal.signal(signal.SIGPIPE, pipe)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        draw(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return path


def inside(surface, n=5):
    """Points all over every triangle, shape (k, 3)."""
    corners = np.asarray(surface.vertices)[np.asarray(surface.faces)]
    weights = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    return np.einsum("kc,fcd->kfd", weights, corners).reshape(-1, 3)


def off_sphere(p, radius=100.0, middle=(5.0, 6.0, 7.0)):
    return np.linalg.norm(p - middle, axis=1) - radius


def off_torus(p):
    return np.hypot(np.hypot(p[:, 0], p[:, 1]) - 100.0, p[:, 2]) - 30.0


def off_cylinder(p, radius=50.0, height=200.0):
    """Distance from the surface of a cylinder on z = 0, from inside it."""
    return -np.minimum(radius - np.hypot(p[:, 0], p[:, 1]), np.minimum(p[:, 2], height - p[:, 2]))


SOLIDS = {
    "sphere": (lambda occ: occ.addSphere(5, 6, 7, 100), off_sphere, 4e6 / 3 * np.pi),
    "torus": (lambda occ: occ.addTorus(0, 0, 0, 100, 30), off_torus, 2 * np.pi**2 * 100 * 900),
    "cylinder": (lambda occ: occ.addCylinder(0, 0, 0, 0, 0, 200, 50), off_cylinder, np.pi * 2500 * 200),
}


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("chord", [1.0, 0.2])
def test_step_holds_the_chord_tolerance(tmp_path, name, chord):
    draw, off, volume = SOLIDS[name]
    surface = read_surface(step(tmp_path / "part.step", draw), chord=chord)
    check_surface(surface)
    assert np.abs(off(inside(surface))).max() <= chord
    assert signed_volume(surface) == pytest.approx(volume, rel=0.05 * chord)


def test_step_of_several_bodies_in_metres(tmp_path):
    def draw(occ):
        occ.cut(
            [(3, occ.addBox(0, 0, 0, 200, 200, 200))], [(3, occ.addCylinder(100, 100, -10, 0, 0, 300, 50))]
        )
        occ.addBox(300, 0, 0, 50, 50, 50)

    path = step(tmp_path / "part.stp", draw)
    surface = read_surface(path, chord=0.5)
    check_surface(surface)
    assert len(surface.split(only_watertight=True)) == 2
    assert signed_volume(surface) == pytest.approx(8e6 - np.pi * 2500 * 200 + 125e3, rel=1e-2)
    assert unit_of(path) == "mm"
    metres = tmp_path / "metres.STEP"
    text = path.read_text()
    assert ".MILLI.,.METRE." in text
    metres.write_text(text.replace(".MILLI.,.METRE.", "$,.METRE."))
    assert unit_of(metres) == "m"
    assert read_surface(metres, chord=500.0).bounds == pytest.approx(1e3 * surface.bounds, rel=1e-6)


def rhino(path, draw, unit=rhino3dm.UnitSystem.Millimeters):
    model = rhino3dm.File3dm()
    model.Settings.ModelUnitSystem = unit
    draw(model)
    assert model.Write(str(path), 7)
    return path


def ball():
    return rhino3dm.Sphere(Point3d(5, 6, 7), 100.0)


def vase():
    profile = rhino3dm.NurbsCurve.Create(
        False, 3, [Point3d(50, 0, 0), Point3d(90, 0, 60), Point3d(30, 0, 120), Point3d(70, 0, 200)]
    )
    axis = rhino3dm.Line(Point3d(0, 0, 0), Point3d(0, 0, 1))
    return profile, rhino3dm.RevSurface.Create(profile, axis, 0.0, 2 * np.pi)


def cylinder():
    return rhino3dm.Cylinder(rhino3dm.Circle(50.0), 200.0)


BREPS = {
    "sphere": (lambda: rhino3dm.Brep.CreateFromSphere(ball()), off_sphere, 4e6 / 3 * np.pi),
    "quad sphere": (lambda: rhino3dm.Brep.CreateQuadSphere(ball()), off_sphere, 4e6 / 3 * np.pi),
    "cylinder": (
        lambda: rhino3dm.Brep.CreateFromCylinder(cylinder(), True, True),
        off_cylinder,
        np.pi * 2500 * 200,
    ),
}


@pytest.mark.parametrize("name", BREPS)
@pytest.mark.parametrize("chord", [2.0, 0.4])
def test_3dm_holds_the_chord_tolerance(tmp_path, name, chord):
    make, off, volume = BREPS[name]
    path = rhino(tmp_path / "part.3dm", lambda model: model.Objects.AddBrep(make()))
    surface = read_surface(path, chord=chord)
    check_surface(surface)
    assert np.abs(off(inside(surface))).max() <= chord
    assert signed_volume(surface) == pytest.approx(volume, rel=0.05 * chord)


def test_3dm_revolved_surface(tmp_path):
    profile, turned = vase()
    at = np.linspace(profile.Domain.T0, profile.Domain.T1, 2001)
    r, z = np.array([(p.X, p.Z) for p in map(profile.PointAt, at)]).T
    volume = np.pi * np.trapezoid(r**2, z)
    path = rhino(
        tmp_path / "part.3dm",
        lambda model: model.Objects.AddBrep(rhino3dm.Brep.CreateFromRevSurface(turned, True, True)),
    )
    solid = read_surface(path, chord=0.2)
    check_surface(solid)
    assert signed_volume(solid) == pytest.approx(volume, rel=5e-3)
    side = rhino(tmp_path / "side.3dm", lambda model: model.Objects.AddSurface(turned))
    wall = read_surface(side, chord=0.5)
    points = inside(wall)
    expected = np.interp(points[:, 2], z, r)
    assert np.abs(np.hypot(points[:, 0], points[:, 1]) - expected).max() <= 0.6
    open_edges, crowded, twisted = edge_faults(np.asarray(wall.faces))
    assert len(crowded) == len(twisted) == 0
    assert set(np.round(wall.vertices[open_edges.reshape(-1)][:, 2], 6)) == {0.0, 200.0}


def test_3dm_extrusions_and_planes(tmp_path):
    corners = rhino3dm.Box(rhino3dm.BoundingBox(Point3d(0, 0, 0), Point3d(100, 200, 300)))
    path = rhino(
        tmp_path / "box.3dm",
        lambda model: model.Objects.AddExtrusion(rhino3dm.Extrusion.CreateBoxExtrusion(corners, True)),
    )
    surface = read_surface(path)
    check_surface(surface)
    assert len(surface.faces) == 12
    assert signed_volume(surface) == pytest.approx(6e6)
    pipe = rhino3dm.Extrusion.CreatePipeExtrusion(cylinder(), 30.0, True, True)
    path = rhino(tmp_path / "pipe.3dm", lambda model: model.Objects.AddExtrusion(pipe))
    surface = read_surface(path)
    check_surface(surface)
    assert surface.euler_number == 0
    radii = sorted((50.0, 30.0))
    assert signed_volume(surface) == pytest.approx(np.pi * (radii[1] ** 2 - radii[0] ** 2) * 200, rel=1e-2)
    disc = rhino3dm.Brep.CreateTrimmedPlane(rhino3dm.Plane.WorldXY(), rhino3dm.Circle(100.0).ToNurbsCurve())
    path = rhino(tmp_path / "disc.3dm", lambda model: model.Objects.AddBrep(disc))
    assert read_surface(path, chord=0.05).area == pytest.approx(np.pi * 1e4, rel=1e-3)


@pytest.mark.parametrize(("unit", "factor"), [("Inches", 25.4), ("Meters", 1e3), ("Feet", 304.8)])
def test_3dm_states_its_unit(tmp_path, unit, factor):
    path = rhino(
        tmp_path / "part.3dm",
        lambda model: model.Objects.AddBrep(rhino3dm.Brep.CreateFromSphere(ball())),
        getattr(rhino3dm.UnitSystem, unit),
    )
    surface = read_surface(path, chord=factor)
    assert np.abs(off_sphere(inside(surface) / factor)).max() <= 1.0
    assert np.ptp(surface.vertices[:, 2]) == pytest.approx(200.0 * factor)


def control_cube(model):
    mesh = rhino3dm.Mesh()
    for x, y, z in np.ndindex(2, 2, 2):
        mesh.Vertices.Add(100 * x, 100 * y, 100 * z)
    for quad in CUBE:
        mesh.Faces.AddFace(*quad)
    model.Objects.AddMesh(mesh)


CUBE = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
CORNERS = 100.0 * np.array(list(np.ndindex(2, 2, 2)), dtype=float)


def test_3dm_leaves_out_what_is_hidden(tmp_path):
    def draw(model):
        control_cube(model)
        hidden = rhino3dm.ObjectAttributes()
        hidden.Visible = False
        model.Objects.AddBrep(rhino3dm.Brep.CreateFromSphere(ball()), hidden)

    surface = read_surface(rhino(tmp_path / "part.3dm", draw))
    check_surface(surface)
    assert len(surface.faces) == 12
    assert signed_volume(surface) == pytest.approx(1e6)


def test_3dm_blocks_stand_where_they_are_inserted(tmp_path):
    def draw(model):
        brep = rhino3dm.Brep.CreateFromCylinder(cylinder(), True, True)
        origin, attributes = Point3d(0, 0, 0), rhino3dm.ObjectAttributes()
        model.InstanceDefinitions.Add("column", "", "", "", origin, (brep,), (attributes,))
        block = model.InstanceDefinitions[0]
        for x in (0.0, 300.0):
            shift = rhino3dm.Transform.Translation(x, 0.0, 0.0)
            model.Objects.AddInstanceObject(rhino3dm.InstanceReference(block.Id, shift))

    surface = read_surface(rhino(tmp_path / "part.3dm", draw), chord=0.2)
    check_surface(surface)
    assert surface.bounds == pytest.approx(np.array([[-50, -50, 0], [350, 50, 200]]), abs=0.2)
    assert signed_volume(surface) == pytest.approx(2 * np.pi * 2500 * 200, rel=1e-2)


def test_gltf_nodes_stand_where_the_scene_puts_them(tmp_path):
    scene = trimesh.Scene()
    cube = trimesh.creation.box((0.1, 0.2, 0.3))
    for i in range(2):
        scene.add_geometry(cube, transform=trimesh.transformations.translation_matrix([i, 0.0, 0.0]))
    scene.export(tmp_path / "part.glb")
    surface = read_surface(tmp_path / "part.glb")
    check_surface(surface)
    assert surface.bounds == pytest.approx(np.array([[-50, -150, -100], [1050, 150, 100]]), abs=1e-3)
    assert signed_volume(surface) == pytest.approx(2 * 6e6, rel=1e-6)


def quad_obj(path):
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS]
    lines += ["f " + " ".join(f"{i + 1}//1" for i in quad) for quad in CUBE]
    path.write_text("\n".join(lines))


def quad_ply(path):
    lines = ["ply", "format ascii 1.0", "element vertex 8", "property float x", "property float y"]
    lines += ["property float z", "element face 6", "property list uchar int vertex_indices", "end_header"]
    lines += [f"{x} {y} {z}" for x, y, z in CORNERS] + ["4 " + " ".join(map(str, quad)) for quad in CUBE]
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("suffix", ["obj", "ply", "3dm"])
def test_quads_are_read_and_subdivided_from_every_format(tmp_path, suffix):
    path = tmp_path / f"cage.{suffix}"
    {"obj": quad_obj, "ply": quad_ply, "3dm": lambda path: rhino(path, control_cube)}[suffix](path)
    assert signed_volume(read_surface(path)) == pytest.approx(1e6)
    smooth = read_surface(path, subdivide="catmull-clark", levels=3)
    check_surface(smooth)
    assert len(smooth.faces) == 2 * 6 * 4**3
    # One turn about a diagonal and one about an axis make all of the cube's own turns.
    centred = np.asarray(smooth.vertices) - 50.0
    for turned in (centred[:, [1, 2, 0]], centred[:, [1, 0, 2]] * [-1, 1, 1]):
        gap = np.abs(np.sort(turned.round(6), axis=0) - np.sort(centred.round(6), axis=0)).max()
        assert gap <= 1e-6
    assert 0.2e6 < signed_volume(smooth) < 1e6
    loop = read_surface(path, subdivide="loop", levels=2)
    check_surface(loop)
    assert len(loop.faces) == 12 * 4**2


def ring_of_quads(n, m):
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    index = lambda a, b: (a % n) * m + b % m  # noqa: E731
    return np.stack([index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)], axis=-1).reshape(
        -1, 4
    )


def test_catmull_clark_tends_to_the_bicubic_spline_on_a_regular_net():
    n, m = 7, 6
    net = np.random.default_rng(2).normal(size=(n, m, 3)) * 50.0

    def spline(values, at, count):
        return BSpline(np.arange(-3.0, count + 4.0), np.concatenate([values, values[:3]]), 3)(at % count)

    def miss(levels):
        refined = subdivide(Polygons(net.reshape(-1, 3), (ring_of_quads(n, m),)), "catmull-clark", levels)
        u, v = np.arange(n * 2**levels) / 2**levels, np.arange(m * 2**levels) / 2**levels
        exact = spline(np.moveaxis(spline(net, u, n), 1, 0), v, m).reshape(-1, 3)
        assert len(refined.vertices) == len(exact)
        return cKDTree(exact).query(refined.vertices)[0].max()

    # The net lies the square of the edge length off the spline: a quarter at each level.
    misses = [miss(levels) for levels in (3, 4, 5)]
    assert misses[-1] < 0.1
    assert misses[0] / misses[1] == pytest.approx(4.0, rel=0.15)
    assert misses[1] / misses[2] == pytest.approx(4.0, rel=0.15)


def test_open_catmull_clark_borders_are_cubic_splines_and_planes_stay_plane():
    x, y = np.meshgrid(np.arange(5.0), np.arange(4.0), indexing="ij")
    points = np.column_stack([x.reshape(-1), y.reshape(-1), np.zeros(20)])
    i, j = np.meshgrid(np.arange(4), np.arange(3), indexing="ij")
    quads = np.stack([i * 4 + j, (i + 1) * 4 + j, (i + 1) * 4 + j + 1, i * 4 + j + 1], axis=-1).reshape(-1, 4)
    one = subdivide(Polygons(points, (quads,)), "catmull-clark", 1)
    assert len(one.faces[0]) == 4 * len(quads)
    assert np.abs(one.vertices[:, 2]).max() == 0.0
    # Inside an even net, and along its straight borders, the rule reproduces what is linear.
    for wanted in ([2.0, 2.0], [1.5, 1.5], [2.0, 0.0], [2.5, 0.0]):
        assert np.linalg.norm(one.vertices[:, :2] - wanted, axis=1).min() <= 1e-12
    # At its corner the border turns as the cubic spline does: an eighth of both neighbours.
    assert np.linalg.norm(one.vertices[:, :2] - [0.125, 0.125], axis=1).min() <= 1e-12


def test_subdivision_keeps_topology_and_moves_with_the_net():
    for scheme in ("catmull-clark", "loop"):
        for shape in (torus(around=12, across=8), nested_cavity()):
            net = Polygons(np.asarray(shape.vertices), (np.asarray(shape.faces),))
            fine = subdivide(net, scheme, 1)
            made = make_surface(fine.vertices, fine.triangles())
            check_surface(made)
            assert made.euler_number == shape.euler_number
            matrix = np.array([[2.0, 0.3, 0.0], [0.0, 1.0, -0.5], [0.1, 0.0, 3.0]])
            sheared = subdivide(Polygons(net.vertices @ matrix, net.faces), scheme, 1)
            gap, nearest = cKDTree(sheared.vertices).query(fine.vertices @ matrix)
            assert gap.max() <= 1e-9
            assert len(np.unique(nearest)) == len(sheared.vertices)


def noise(seed, start, size=4000):
    return start + np.random.default_rng(seed).bytes(size)


def cut(path, share):
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])


def written(tmp_path, suffix):
    path = tmp_path / f"part.{suffix}"
    if suffix == "step":
        step(path, lambda occ: occ.addTorus(0, 0, 0, 100, 30))
    else:
        write_surface(torus(), path)
    return path


@pytest.mark.parametrize("suffix", ["stl", "3mf", "3dm", "glb", "gltf", "step", "ply"])
@pytest.mark.parametrize("share", [0.0, 0.04, 0.5])
def test_files_that_are_cut_off_are_refused_in_one_sentence(tmp_path, suffix, share):
    path = written(tmp_path, suffix)
    cut(path, share)
    refused_in_one_sentence(path)


@pytest.mark.parametrize("suffix", ["stl", "3mf", "3dm", "glb", "gltf", "step", "ply", "obj"])
@pytest.mark.parametrize(
    "start", [b"", b"ISO-10303-21;", b"glTF\x02\x00\x00\x00", b"3D Geometry File Format        4"]
)
def test_noise_is_refused_in_one_sentence(tmp_path, suffix, start):
    path = tmp_path / f"part.{suffix}"
    path.write_bytes(noise(3, start))
    refused_in_one_sentence(path)


def refused_in_one_sentence(path, says=None, **options):
    with pytest.raises(TwinsError, match=says) as refused:
        read_surface(path, **options)
    sentence = str(refused.value)
    assert path.name in sentence
    assert "\n" not in sentence
    assert "Traceback" not in sentence


def only_curves(path):
    if path.suffix == ".step":
        step(path, lambda occ: occ.addCircle(0, 0, 0, 50))
    else:
        rhino(path, lambda model: model.Objects.AddCircle(rhino3dm.Circle(50.0)))


def empty_3dm(path):
    rhino(path, lambda _: None)


def stellar(path):
    rhino(path, control_cube, rhino3dm.UnitSystem.Parsecs)


def with_text(text):
    return lambda path: path.write_text(text)


def fathoms(path):
    write_surface(box(), path)
    with zipfile.ZipFile(path) as given:
        parts = {name: given.read(name).replace(b"millimeter", b"fathom") for name in given.namelist()}
    with zipfile.ZipFile(path, "w") as made:
        for name, content in parts.items():
            made.writestr(name, content)


def not_a_number(path):
    mesh = box()
    vertices = np.asarray(mesh.vertices).copy()
    vertices[3, 1] = np.nan
    trimesh.Trimesh(vertices, mesh.faces, process=False).export(path)


def only_lines(path):
    trimesh.Scene(trimesh.load_path([[0, 0, 0], [1, 0, 0], [1, 1, 0]])).export(path)


def three_at_an_edge(path):
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 -1 0\nf 1 2 3\nf 1 2 4\nf 1 2 5\n")


BAD = [
    ("part.step", only_curves, "holds no surfaces", {}),
    ("part.3dm", only_curves, "holds no meshes, surfaces.*it holds", {}),
    ("part.3dm", empty_3dm, "holds no meshes", {}),
    ("part.3dm", stellar, "unit is 'Parsecs'", {}),
    ("part.3mf", fathoms, "unknown unit 'fathom'", {}),
    ("part.stl", not_a_number, "not a finite point", {}),
    ("part.glb", only_lines, "part.glb", {}),
    ("part.obj", with_text(""), "part.obj", {}),
    ("part.obj", with_text("v 0 0 0\nv 1 0 0\nf 1 2 x\n"), "part.obj", {"subdivide": "catmull-clark"}),
    (
        "part.obj",
        with_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
        "names vertex 8",
        {"subdivide": "catmull-clark"},
    ),
    (
        "part.obj",
        with_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n"),
        "three corners",
        {"subdivide": "catmull-clark"},
    ),
    ("part.obj", three_at_an_edge, "edge of 3 faces at", {"subdivide": "catmull-clark"}),
    ("part.obj", three_at_an_edge, "edge of 3 faces at", {"subdivide": "loop"}),
    ("part.obj", quad_obj, "unknown subdivision 'doo-sabin'", {"subdivide": "doo-sabin"}),
    ("part.obj", quad_obj, "levels .* from 0 to 8, not 40", {"subdivide": "loop", "levels": 40}),
    ("part.obj", quad_obj, "unknown unit 'parsec'", {"unit": "parsec"}),
    ("part.obj", quad_obj, "chord tolerance must be above 0 mm", {"chord": 0.0}),
    ("part.obj", quad_obj, "chord tolerance must be above 0 mm", {"chord": float("nan")}),
    (
        "part.ply",
        with_text("ply\nformat ascii 1.0\nend_header\n"),
        "part.ply",
        {"subdivide": "catmull-clark"},
    ),
    ("part.dwg", with_text("AC1027"), "unknown ending '.dwg'", {}),
]


@pytest.mark.parametrize(("name", "make", "says", "options"), BAD, ids=range(len(BAD)))
def test_what_cannot_be_a_surface_is_refused_in_one_sentence(tmp_path, name, make, says, options):
    make(tmp_path / name)
    refused_in_one_sentence(tmp_path / name, says, **options)


def test_smooth_surfaces_are_no_control_meshes(tmp_path):
    path = rhino(
        tmp_path / "part.3dm", lambda model: model.Objects.AddBrep(rhino3dm.Brep.CreateFromSphere(ball()))
    )
    refused_in_one_sentence(path, "holds smooth surfaces", subdivide="catmull-clark", chord=5.0)


def test_what_cannot_be_written_is_refused(tmp_path):
    with pytest.raises(FormatError, match=r"unknown ending '.dae'; .* \.3dm"):
        write_surface(box(), tmp_path / "part.dae")
    with pytest.raises(FormatError, match="there is no folder"):
        write_surface(box(), tmp_path / "none" / "part.stl")
    with pytest.raises(SurfaceError, match="empty"):
        write_surface(make_surface(np.empty((0, 3)), np.empty((0, 3), dtype=int)), tmp_path / "part.stl")
    spoiled = np.asarray(box().vertices).copy()
    spoiled[0, 0] = np.inf
    with pytest.raises(SurfaceError, match="finite"):
        write_surface(make_surface(spoiled, box().faces), tmp_path / "part.3dm")
    assert list(tmp_path.iterdir()) == []
