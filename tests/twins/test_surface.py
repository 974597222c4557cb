import manifold3d
import numpy as np
import pytest
import trimesh
from shapes import box, nested_cavity, sphere, torus

from twins import (
    FormatError,
    SurfaceError,
    check_surface,
    make_surface,
    read_surface,
    repair_surface,
    signed_volume,
)
from twins.crossings import check_self_intersection


def joined(*meshes):
    """Meshes side by side in one, vertices of their own."""
    vertices, faces, at = [], [], 0
    for mesh in meshes:
        vertices.append(np.asarray(mesh.vertices))
        faces.append(np.asarray(mesh.faces) + at)
        at += len(mesh.vertices)
    return make_surface(np.concatenate(vertices), np.concatenate(faces))


def moved(mesh, *by):
    return make_surface(np.asarray(mesh.vertices) + by, mesh.faces)


def inside_out(mesh):
    return make_surface(mesh.vertices, np.asarray(mesh.faces)[:, ::-1])


def prism(outline, height):
    mesh = trimesh.creation.extrude_polygon(outline, height)
    return make_surface(mesh.vertices, mesh.faces)


def figure_of_eight(lift=0.0):
    """A tube of radius 8 around Gerono's lemniscate, whose halves cross at the origin or pass at a distance `lift`."""
    t = (np.arange(120) + 0.5) * 2.0 * np.pi / 120
    path = np.column_stack([100 * np.cos(t), 100 * np.sin(t) * np.cos(t), lift * 0.5 * np.sin(t)])
    along = np.column_stack([-100 * np.sin(t), 100 * np.cos(2 * t), np.zeros(120)])
    side = np.cross([0.0, 0.0, 1.0], along / np.linalg.norm(along, axis=1)[:, None])
    angle = np.arange(16) * np.pi / 8
    points = path[:, None] + 8.0 * (
        np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * np.array([0.0, 0.0, 1.0])
    )
    ring = torus(around=120, across=16)
    faces = np.asarray(ring.faces)
    return make_surface(points.reshape(-1, 3), faces)


def bodies(surface):
    return len(
        trimesh.graph.connected_components(surface.face_adjacency, nodes=np.arange(len(surface.faces)))
    )


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "3mf"])
def test_formats_come_back_closed(tmp_path, suffix):
    path = tmp_path / f"part.{suffix}"
    trimesh.Trimesh(*(np.asarray(a) for a in (torus().vertices, torus().faces))).export(path)
    surface = read_surface(path)
    check_surface(surface)
    assert signed_volume(surface) == pytest.approx(signed_volume(torus()), rel=1e-5)


def test_holes_are_closed_and_named():
    good = sphere(subdivisions=3)
    middle = np.asarray(good.vertices)[np.asarray(good.faces)].mean(axis=1)
    kept = np.asarray(good.faces)[(middle[:, 2] < 280) & (middle[:, 0] < 130)]
    repaired, said = repair_surface(make_surface(good.vertices, kept))
    check_surface(repaired)
    assert len(said) == 2
    assert all("closed a hole of" in sentence for sentence in said)
    assert signed_volume(repaired) == pytest.approx(signed_volume(good), rel=0.05)


def test_repair_turns_and_says():
    good = box()
    flipped = np.asarray(good.faces).copy()
    flipped[3] = flipped[3][::-1]
    repaired, said = repair_surface(
        make_surface(good.vertices, np.vstack([flipped[:, ::-1], flipped[0][::-1]]))
    )
    check_surface(repaired)
    assert signed_volume(repaired) == pytest.approx(8e6)
    assert any("duplicate" in sentence for sentence in said)


def test_what_cannot_be_repaired_is_refused():
    one, two = box(), box()
    v = np.vstack([one.vertices, np.asarray(two.vertices) + [200.0, 200.0, 0.0]])
    f = np.vstack([one.faces, np.asarray(two.faces) + len(one.vertices)])
    touching = np.unique(v, axis=0, return_inverse=True)
    for mesh in (make_surface(touching[0], touching[1].reshape(-1)[f]), make_surface(v, f)):
        with pytest.raises(SurfaceError, match=r"not manifold: 1 edges .* at \(100.000, 100.000, 100.000\)"):
            repair_surface(mesh)


TURNS = [np.eye(4), trimesh.transformations.rotation_matrix(0.83, [1.0, -2.0, 0.7], [30.0, 10.0, 50.0])]


def flush():
    """A box on another one, one side flush: two edges of four faces, and faces in one plane."""
    return joined(box(), moved(box(100.0, 200.0, 80.0), -50.0, 0.0, 200.0))


@pytest.mark.parametrize("turn", TURNS, ids=["straight", "turned"])
@pytest.mark.parametrize(
    ("make", "volume", "says"),
    [
        (lambda: joined(box(), moved(box(), 100.0, 50.0, 30.0)), 16e6 - 100 * 150 * 170, "united 2 bodies"),
        (
            lambda: joined(box(), moved(box(80.0, 80.0, 80.0), 10.0, 5.0, 200.0)),
            8e6 + 512e3,
            "united 2 bodies",
        ),
        (flush, 8e6 + 1.6e6, "united 2 bodies"),
        # The cavity 100 x 100 x 100 is filled to one half by the second box.
        (
            lambda: joined(
                box(), inside_out(moved(box(100, 100, 100), 0, 0, 50)), moved(box(200, 60, 60), 100, 0, 70)
            ),
            8e6 - 1e6 + 60 * 60 * 100 + 50 * 60 * 60,
            "united 2 bodies",
        ),
        (
            lambda: joined(box(), moved(box(50.0, 50.0, 50.0), 3.0, 1.0, 70.0)),
            8e6,
            "dropped the body of 12 faces",
        ),
        (
            lambda: joined(box(), moved(inside_out(box()), 500.0, 0.0, 0.0)),
            16e6,
            "flipped the body of 12 faces",
        ),
        (
            lambda: joined(
                box(),
                moved(
                    inside_out(joined(box(), inside_out(moved(box(50, 50, 50), 0, 0, 70)))), 500.0, 0.0, 0.0
                ),
            ),
            16e6 - 125e3,
            "flipped the body of 12 faces",
        ),
        (lambda: inside_out(joined(box(), moved(box(), 500.0, 0.0, 0.0))), 16e6, "flipped all faces"),
        (lambda: joined(box(), box(), inside_out(box())), 8e6, "duplicate"),
    ],
    ids=[
        "overlap",
        "on top",
        "flush",
        "into a cavity",
        "solid in solid",
        "one flipped",
        "nest",
        "all",
        "thrice",
    ],
)
def test_bodies_become_the_solid_that_they_cover(make, volume, says, turn):
    mesh = make()
    repaired, said = repair_surface(
        make_surface(trimesh.transform_points(np.asarray(mesh.vertices), turn), mesh.faces)
    )
    check_surface(repaired)
    assert signed_volume(repaired) == pytest.approx(volume, rel=1e-9)
    assert any(says in sentence for sentence in said), said
    again, silence = repair_surface(repaired)
    assert silence == []
    assert signed_volume(again) == pytest.approx(volume, rel=1e-9)


def test_good_surfaces_stay_as_they_are():
    apart = joined(sphere(), moved(sphere(20.0), 400.0, 0.0, 0.0))
    touching = joined(box(), moved(box(), 200.0, 200.0, 200.0))
    for mesh in (box(), torus(), nested_cavity(), apart, touching):
        repaired, said = repair_surface(mesh)
        assert said == ([] if mesh is not touching else ["merged vertices at equal points"])
        assert signed_volume(repaired) == pytest.approx(signed_volume(mesh), rel=1e-12)


def test_a_wall_between_two_bodies_is_taken_out():
    mirrored = make_surface([200.0, 0.0, 0.0] + np.asarray(box().vertices) * [-1, 1, 1], box().faces)
    repaired, said = repair_surface(joined(box(), inside_out(mirrored)))
    assert any("both sides of walls" in sentence for sentence in said)
    assert bodies(repaired) == 1
    assert signed_volume(repaired) == pytest.approx(16e6)


def test_both_sides_of_every_face_are_one_solid():
    good = sphere(subdivisions=2)
    repaired, said = repair_surface(make_surface(good.vertices, np.vstack([good.faces, good.faces[:, ::-1]])))
    assert signed_volume(repaired) == pytest.approx(signed_volume(good))
    assert any("duplicate" in sentence for sentence in said)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (
            lambda: joined(inside_out(box()), inside_out(moved(box(50, 50, 50), 0, 0, 70))),
            "cavity cannot be told",
        ),
        (lambda: joined(box(), inside_out(moved(box(), 100.0, 50.0, 30.0))), "cuts another body"),
        (figure_of_eight, "cuts itself"),
        (
            lambda: joined(
                box(), make_surface([[300, 0, 0], [400, 0, 0], [300, 90, 0]], [[0, 1, 2], [0, 2, 1]])
            ),
            "open|no volume|empty",
        ),
    ],
)
def test_what_has_two_readings_is_refused(make, says):
    with pytest.raises(SurfaceError, match=says):
        repair_surface(make())


@pytest.mark.parametrize("turn", TURNS, ids=["straight", "turned"])
def test_a_surface_that_cuts_itself_is_refused_where_it_does(turn):
    eight = figure_of_eight()
    eight = make_surface(trimesh.transform_points(np.asarray(eight.vertices), turn), eight.faces)
    with pytest.raises(SurfaceError, match=r"pairs of faces .* first at \(") as refused:
        check_self_intersection(eight)
    place = [float(v) for v in str(refused.value).split("first at (")[1].split(")")[0].split(",")]
    # Two tubes of radius 8 that cross at right angles meet within 8 √2 of the crossing.
    assert np.linalg.norm(np.array(place) - turn[:3, 3]) < 12.0
    check_self_intersection(figure_of_eight(lift=20.0))


def test_cuts_are_found_exactly_where_manifold_finds_an_overlap():
    rng = np.random.default_rng(5)
    found = {True: 0, False: 0}
    for _ in range(300):
        points = rng.uniform(-1.0, 1.0, (2, 4, 3)) + rng.uniform(0.0, 0.9, (2, 1, 3))
        hulls = [trimesh.convex.convex_hull(p) for p in points]
        a, b = (manifold3d.Manifold.hull_points(p) for p in points)
        common = (a ^ b).volume()
        cut = 1e-8 < common < min(a.volume(), b.volume()) - 1e-8
        if 0.0 < common <= 1e-8:
            continue  # perhaps within the tolerance
        try:
            check_self_intersection(joined(*hulls))
            raised = False
        except SurfaceError:
            raised = True
        assert raised == cut
        found[cut] += 1
    assert min(found.values()) > 30


def test_a_hole_whose_fan_would_cut_is_closed_flat():
    outline = trimesh.path.polygons.Polygon(
        [(0, 0), (90, 0), (90, 90), (80, 90), (80, 10), (10, 10), (10, 90), (0, 90)]
    )
    good = prism(outline, 50.0)
    kept = np.asarray(good.faces)[np.asarray(good.vertices)[good.faces][:, :, 2].max(axis=1) > 0]
    repaired, said = repair_surface(make_surface(good.vertices, kept))
    assert len(said) == 1
    check_self_intersection(repaired)
    assert signed_volume(repaired) == pytest.approx(outline.area * 50.0)


def test_slits_and_idle_faces():
    good = box()
    vertices, faces = np.asarray(good.vertices), np.asarray(good.faces)
    a, b = faces[0][:2]
    middle = len(vertices)
    split = np.vstack([faces[1:], [[a, middle, faces[0][2]], [middle, b, faces[0][2]]]])
    slit = make_surface(np.vstack([vertices, vertices[[a, b]].mean(axis=0)]), split)
    repaired, said = repair_surface(slit)
    assert "hole of 3 edges" in said[0]
    assert signed_volume(repaired) == pytest.approx(8e6)
    stray = make_surface(np.vstack([vertices, [[0, 0, 999.0]]]), faces)
    assert np.asarray(repair_surface(stray)[0].vertices)[:, 2].max() == 200.0
    fin = make_surface(np.vstack([vertices, [[0, 0, 999.0]]]), np.vstack([faces, [[a, b, 8], [b, a, 8]]]))
    repaired, said = repair_surface(fin)
    assert said == ["dropped both sides of walls without thickness: 1 pairs of faces"]
    assert np.asarray(repaired.vertices)[:, 2].max() == 200.0


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("part.dwg", b"AC1027", "unknown ending"),
        ("part.stl", b"", "part.stl"),
        ("part.obj", b"v 0 0 0\n", "part.obj"),
        ("part.ply", b"not a ply", "part.ply"),
        ("part.3mf", b"PK broken", "part.3mf"),
    ],
)
def test_unreadable_files_are_named(tmp_path, name, content, says):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(FormatError, match=says):
        read_surface(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FormatError, match="no such file"):
        read_surface(tmp_path / "none.stl")


@pytest.mark.parametrize(("value", "says"), [("1e30", "1e+30"), ("nan", "finite"), ("-2000000", "-2e+06")])
def test_points_that_no_cell_reaches_are_named(tmp_path, value, says):
    path = tmp_path / "part.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 {value} 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    with pytest.raises(FormatError, match="vertex 2") as refused:
        read_surface(path)
    assert says in str(refused.value)
