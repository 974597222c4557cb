"""Solids in 3DM files: closed, outward and within the chord tolerance, also at the seams and poles of their faces."""

from pathlib import Path

import numpy as np
import pytest
import rhino3dm
import shapely
from rhino3dm import Point3d
from shapely import LineString
from shapes import box

from twins import FormatError, check_surface, read_curves, read_surface, signed_volume
from twins.formats.brep import mesh_of_brep
from twins.formats.brep_refining import Patch, pulled_apart
from twins.formats.nurbs import Nurbs
from twins.formats.rhino_subd import mesh_of_subd
from twins.mesh_edges import arrays_of, edge_faults
from twins.surface import welded

AXIS = rhino3dm.Line(Point3d(0, 0, 0), Point3d(0, 0, 1))


def turned(profile):
    """The solid of revolution of a curve in the plane y = 0, about z."""
    surface = rhino3dm.RevSurface.Create(profile, AXIS, 0.0, 2 * np.pi)
    return rhino3dm.Brep.CreateFromRevSurface(surface, True, True)


def spline(*corners):
    return rhino3dm.NurbsCurve.Create(False, min(3, len(corners) - 1), [Point3d(x, 0, z) for x, z in corners])


def arc(*places):
    return rhino3dm.Arc(*(Point3d(x, 0, z) for x, z in places)).ToNurbsCurve()


def ring():
    circle = rhino3dm.Circle(30.0)
    circle.Plane = rhino3dm.Plane(Point3d(100, 0, 0), rhino3dm.Vector3d(0, 1, 0))
    return circle.ToNurbsCurve()


# The profile (r, z) of a solid of revolution, and how many holes it has.
PROFILES = {
    "sphere": (arc((0, -100), (100, 0), (0, 100)), 0),
    "cap of a sphere": (arc((60, -80), (100, 0), (0, 100)), 0),
    "cone": (spline((50, 0), (0, 200)), 0),
    "cone on its tip": (spline((0, 0), (50, 200)), 0),
    "needle": (spline((1, 0), (0, 200)), 0),
    "double cone": (
        rhino3dm.Polyline([Point3d(0, 0, -80), Point3d(60, 0, 0), Point3d(0, 0, 120)]).ToNurbsCurve(),
        0,
    ),
    "drop": (spline((0, 0), (60, 20), (80, 120), (0, 200)), 0),
    "cusps": (spline((0, 0), (0, 60), (120, 100), (0, 140), (0, 200)), 0),
    "onion": (spline((0, 0), (150, 0), (150, 150), (0, 100), (0, 250)), 0),
    "dented": (spline((0, 60), (60, -20), (120, 100), (60, 260), (0, 140)), 0),
    "vase": (spline((50, 0), (90, 60), (30, 120), (70, 200)), 0),
    "torus": (ring(), 1),
}


def line_of(profile):
    """(r, z) along a profile, shape (n, 2)."""
    at = np.linspace(profile.Domain.T0, profile.Domain.T1, 4001)
    return np.array([(p.X, p.Z) for p in map(profile.PointAt, at)])


def inside(surface, n=4):
    """Points all over every triangle, shape (k, 3)."""
    corners = np.asarray(surface.vertices)[np.asarray(surface.faces)]
    weights = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    return np.einsum("kc,fcd->kfd", weights, corners).reshape(-1, 3)


def solid_of(brep, chord):
    mesh = mesh_of_brep(brep, chord, Path("part.3dm"))
    surface = welded(mesh.vertices, mesh.triangles())
    check_surface(surface)
    assert surface.is_watertight
    return surface


@pytest.mark.parametrize("name", PROFILES)
def test_solids_of_revolution_are_closed_and_within_the_tolerance(name):
    profile, holes = PROFILES[name]
    brep = turned(profile)
    assert brep.IsSolid
    line = line_of(profile)
    r, (dr, dz) = 0.5 * (line[1:, 0] + line[:-1, 0]), np.diff(line, axis=0).T
    volume = abs(np.pi * (r**2 * dz).sum())
    area = (2 * np.pi * r * np.hypot(dr, dz)).sum() + np.pi * (line[[0, -1], 0] ** 2).sum()
    outline = LineString(line if holes else np.vstack([[0, line[0, 1]], line, [0, line[-1, 1]]]))
    for chord in (20.0, 3.0, 0.6):
        surface = solid_of(brep, chord)
        assert surface.euler_number == 2 - 2 * holes
        assert abs(signed_volume(surface) - volume) <= chord * area
        points = inside(surface)
        points = points[:: max(1, len(points) // 2000)]
        flat = shapely.points(np.hypot(points[:, 0], points[:, 1]), points[:, 2])
        assert shapely.distance(flat, outline).max() <= chord + 1e-3


def test_spheres_cones_and_cylinders_have_their_volume():
    middle = Point3d(5, 6, 7)
    circle = rhino3dm.Circle(50.0)
    circle.Plane = rhino3dm.Plane(middle, rhino3dm.Vector3d(1, 2, 3))
    sphere = rhino3dm.Sphere(middle, 50.0)
    solids = [
        (rhino3dm.Brep.CreateFromSphere(sphere), 4 / 3 * np.pi * 50**3),
        (rhino3dm.Brep.CreateQuadSphere(sphere), 4 / 3 * np.pi * 50**3),
        (turned(spline((50, 0), (0, 80))), np.pi / 3 * 50**2 * 80),
        (
            rhino3dm.Brep.CreateFromCylinder(rhino3dm.Cylinder(circle, 80.0), True, True),
            np.pi * 50**2 * 80,
        ),
    ]
    for brep, volume in solids:
        misses = [1 - signed_volume(solid_of(brep, chord)) / volume for chord in (1.0, 0.25, 0.0625)]
        # Corners on a convex solid: the mesh lies inside it, and what is missing goes down with the tolerance.
        assert 0 < misses[2] < misses[1] < misses[0] < 0.06
        assert misses[2] < 0.004


def test_a_solid_that_is_inside_out_is_turned():
    brep = rhino3dm.Brep.CreateFromCylinder(rhino3dm.Cylinder(rhino3dm.Circle(50.0), 80.0), True, True)
    outward = signed_volume(solid_of(brep, 1.0))
    brep.Flip()
    assert signed_volume(solid_of(brep, 1.0)) == outward > 0


def test_edges_that_fall_together_at_a_pole_are_pulled_apart():
    # A cone's tip is the side v = 0 of the parameters; x is joined to it on both sides of y.
    control = np.array([[[0, 0, 50, 1], [-100, 0, 0, 1]], [[0, 0, 50, 1], [100, 80, 0, 1.0]]])
    line = np.array([0.0, 0.0, 1.0, 1.0])
    surface = Nurbs((1, 1), (line, line), control)
    uv = np.array([[0, 0], [0.5, 0], [1, 0], [0.5, 0.3], [0.5, 0.6], [0, 1], [1, 1]])
    p, q, r, y, x, a, b = range(7)
    triangles = np.array([(p, q, y), (q, r, y), (p, y, x), (y, r, x), (p, x, a), (x, r, b), (a, x, b)])
    number = np.array([0, 0, 0, 1, 2, 3, 4])
    patch = Patch(surface, uv, surface.points(uv), number, triangles)
    assert len(edge_faults(patch.corners())[1]) == 1
    (apart,) = pulled_apart([patch], 5)
    corners = apart.corners()
    open_edges, crowded, twisted = edge_faults(corners)
    assert len(crowded) == len(twisted) == 0
    assert {tuple(edge) for edge in np.sort(open_edges, axis=1).tolist()} == {(0, 3), (3, 4), (0, 4)}
    # A disc: one more than its edges are its corners and triangles.
    edges = np.unique(np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    assert len(np.unique(corners)) - len(edges) + len(corners) == 1


def test_faces_that_share_two_points_do_not_share_an_edge_inside_both():
    line = np.array([0.0, 0.0, 1.0, 1.0])
    patches, number = [], np.array([0, 1, 2, 3])
    for height in (10.0, -10.0):
        corners = [[[0, 0, 0, 1], [0, 100, height, 1]], [[100, 0, height, 1], [100, 100, 0, 1.0]]]
        surface = Nurbs((1, 1), (line, line), np.array(corners))
        uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
        turn = 1 if height > 0 else -1
        triangles = np.array([(0, 1, 2), (0, 2, 3)])[:, ::turn]
        patches.append(Patch(surface, uv, surface.points(uv), number, triangles))
    assert len(edge_faults(np.concatenate([patch.corners() for patch in patches]))[1]) == 1
    faces = np.concatenate([patch.corners() for patch in pulled_apart(patches, 4)])
    assert [len(faults) for faults in edge_faults(faces)] == [0, 0, 0]


def extruded(profile, height=100.0):
    extrusion = rhino3dm.Extrusion.Create(profile, height, True)
    assert extrusion is not None
    return extrusion.ToBrep(True)


def test_edges_that_cross_their_chord_in_the_middle_are_followed():
    # A rectangle with one side an S: half way it is where the straight line is.
    side = rhino3dm.NurbsCurve.Create(
        False, 3, [Point3d(*p, 0) for p in ((0, 0), (90, 80), (10, -80), (100, 0))]
    )
    rest = rhino3dm.Polyline([Point3d(100, 0, 0), Point3d(100, 200, 0), Point3d(0, 200, 0), Point3d(0, 0, 0)])
    profile = rhino3dm.PolyCurve()
    profile.Append(side)
    profile.Append(rest.ToNurbsCurve())
    surface = solid_of(extruded(profile), 0.5)
    at = np.linspace(side.Domain.T0, side.Domain.T1, 2001)
    drawn = LineString([(p.X, p.Y) for p in map(side.PointAt, at)])
    points = inside(surface)
    low, high = surface.bounds[:, 2]
    x, y, z = points.T
    wall = points[(y < 60) & (x > 1e-6) & (x < 100 - 1e-6) & (z > low + 10) & (z < high - 10)]
    assert len(wall) > 20
    assert shapely.distance(shapely.points(wall[:, 0], wall[:, 1]), drawn).max() <= 0.5
    # The S adds as much as it takes.
    assert signed_volume(surface) == pytest.approx(100 * 200 * 100, rel=2e-3)


@pytest.mark.parametrize("thickness", [30.0, 3.0, 0.3])
def test_edges_with_the_same_ends_stay_apart_below_the_tolerance(thickness):
    a, b = Point3d(0, 0, 0), Point3d(100, 0, 0)
    profile = rhino3dm.PolyCurve()
    profile.Append(rhino3dm.Arc(a, Point3d(50, thickness / 2, 0), b))
    profile.Append(rhino3dm.Arc(b, Point3d(50, -thickness / 2, 0), a))
    brep = extruded(profile)
    assert brep.IsSolid
    for chord in (10.0, 1.0):
        surface = solid_of(brep, chord)
        assert surface.euler_number == 2
        assert surface.bounds[:, 1] == pytest.approx([-thickness / 2, thickness / 2], abs=chord)


def test_twisted_patches_of_straight_lines_are_followed(tmp_path):
    surface = rhino3dm.NurbsSurface.Create(3, False, 2, 2, 2, 2)
    for knots in (surface.KnotsU, surface.KnotsV):
        knots[0], knots[1] = 0.0, 1.0
    for i, j, z in ((0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, 100)):
        surface.Points[i, j] = rhino3dm.Point4d(100 * i, 100 * j, z, 1)
    model = rhino3dm.File3dm()
    model.Settings.ModelUnitSystem = rhino3dm.UnitSystem.Millimeters
    model.Objects.AddSurface(surface)
    assert model.Write(str(tmp_path / "part.3dm"), 7)
    for chord in (5.0, 0.5):
        points = inside(read_surface(tmp_path / "part.3dm", chord=chord))
        # The patch is z = x y / 100; its slope is at most that of (1, 1).
        assert np.abs(points[:, 2] - points[:, 0] * points[:, 1] / 100).max() <= 3**0.5 * chord


def inserted(path, placings, inner=None):
    """A file of one box and one ball in a block, inserted as the matrices say; in a block in a block with `inner`."""
    model = rhino3dm.File3dm()
    model.Settings.ModelUnitSystem = rhino3dm.UnitSystem.Millimeters
    ball = rhino3dm.Brep.CreateFromSphere(rhino3dm.Sphere(Point3d(300, 0, 0), 50.0))
    mesh = rhino3dm.Mesh()
    vertices, faces = arrays_of(box(100.0, 200.0, 300.0))
    for vertex in vertices.tolist():
        mesh.Vertices.Add(*vertex)
    for face in faces.tolist():
        mesh.Faces.AddFace(*face)
    parts, attributes = [ball, mesh], [rhino3dm.ObjectAttributes(), rhino3dm.ObjectAttributes()]
    model.InstanceDefinitions.Add("parts", "", "", "", Point3d(0, 0, 0), tuple(parts), tuple(attributes))
    block = model.InstanceDefinitions[0]
    if inner is not None:
        nested = rhino3dm.InstanceReference(block.Id, inner)
        model.InstanceDefinitions.Add(
            "nested", "", "", "", Point3d(0, 0, 0), (nested,), (rhino3dm.ObjectAttributes(),)
        )
        block = model.InstanceDefinitions[1]
    for placing in placings:
        model.Objects.AddInstanceObject(rhino3dm.InstanceReference(block.Id, placing))
    assert model.Write(str(path), 7)
    return path


MIRROR = rhino3dm.Transform.Mirror(Point3d(0, 0, 0), rhino3dm.Vector3d(1, 0, 0))


def test_mirrored_blocks_face_outwards(tmp_path):
    up = rhino3dm.Transform.Translation(0.0, 0.0, 1000.0)
    plain = read_surface(inserted(tmp_path / "plain.3dm", [up]), chord=0.5)
    mirrored = read_surface(
        inserted(tmp_path / "mirrored.3dm", [rhino3dm.Transform.Multiply(MIRROR, up)]), chord=0.5
    )
    twice = read_surface(
        inserted(tmp_path / "twice.3dm", [rhino3dm.Transform.Multiply(MIRROR, up)], MIRROR), chord=0.5
    )
    for surface in (plain, mirrored, twice):
        check_surface(surface)
        assert signed_volume(surface) == pytest.approx(signed_volume(plain), rel=1e-9)
        # Each body on its own faces outwards: two wrongs could hide in the sum.
        assert all(body.volume > 0 for body in surface.split(only_watertight=True))
    assert mirrored.bounds == pytest.approx(
        plain.bounds[[1, 0]] * [-1, 0, 0] + plain.bounds * [0, 1, 1], abs=1e-9
    )
    assert twice.bounds == pytest.approx(plain.bounds, abs=1e-9)


def test_stretched_blocks_hold_the_tolerance_where_they_stand(tmp_path):
    larger = rhino3dm.Transform.Scale(Point3d(0, 0, 0), 20.0)
    surface = read_surface(inserted(tmp_path / "part.3dm", [larger]), chord=2.0)
    ball = max(surface.split(only_watertight=True), key=lambda body: len(body.faces))
    assert np.abs(np.linalg.norm(inside(ball) - [6000, 0, 0], axis=1) - 1000).max() <= 2.0


def test_what_is_hidden_in_blocks_is_left_out(tmp_path):
    model = rhino3dm.File3dm()
    model.Settings.ModelUnitSystem = rhino3dm.UnitSystem.Millimeters
    layer = rhino3dm.Layer()
    layer.Name, layer.Visible = "off", False
    hidden = rhino3dm.ObjectAttributes()
    hidden.LayerIndex = model.Layers.Add(layer)
    shown = rhino3dm.ObjectAttributes()
    other = rhino3dm.Layer()
    other.Name = "on"
    shown.LayerIndex = model.Layers.Add(other)
    balls = tuple(rhino3dm.Brep.CreateFromSphere(rhino3dm.Sphere(Point3d(x, 0, 0), 50.0)) for x in (0, 300))
    model.InstanceDefinitions.Add("two", "", "", "", Point3d(0, 0, 0), balls, (shown, hidden))
    still = rhino3dm.Transform.Translation(0.0, 0.0, 0.0)
    model.Objects.AddInstanceObject(rhino3dm.InstanceReference(model.InstanceDefinitions[0].Id, still), shown)
    assert model.Write(str(tmp_path / "part.3dm"), 7)
    surface = read_surface(tmp_path / "part.3dm", chord=1.0)
    assert surface.bounds[1, 0] == pytest.approx(50.0, abs=1.0)


def test_a_subd_of_nothing_is_refused(tmp_path):
    with pytest.raises(FormatError, match=r"part.3dm: holds a SubD that is not valid"):
        mesh_of_subd(rhino3dm.SubD(), 1.0, tmp_path / "part.3dm")


@pytest.mark.parametrize("unit", ["Microns", "Mils", "Inches", "Kilometers"])
def test_curves_and_surfaces_of_a_file_are_in_one_unit(tmp_path, unit):
    model = rhino3dm.File3dm()
    model.Settings.ModelUnitSystem = getattr(rhino3dm.UnitSystem, unit)
    corners = [Point3d(0, 0, 0), Point3d(0.01, 0, 0), Point3d(0.01, 0.02, 0.03)]
    model.Objects.AddCurve(rhino3dm.PolylineCurve(corners))
    mesh = rhino3dm.Mesh()
    for corner in corners:
        mesh.Vertices.Add(corner.X, corner.Y, corner.Z)
    mesh.Faces.AddFace(0, 1, 2)
    model.Objects.AddMesh(mesh)
    assert model.Write(str(tmp_path / "part.3dm"), 7)
    (curve,) = read_curves(tmp_path / "part.3dm")
    factor = {"Microns": 1e-3, "Mils": 0.0254, "Inches": 25.4, "Kilometers": 1e6}[unit]
    assert np.ptp(curve.points, axis=0) == pytest.approx(factor * np.array([0.01, 0.02, 0.03]), rel=1e-6)
    assert np.ptp(read_surface(tmp_path / "part.3dm").vertices, axis=0) == pytest.approx(
        np.ptp(curve.points, axis=0), rel=1e-6
    )
