"""Deviation of points and of imported meshes; curves on the surface for CAD."""

import numpy as np
import pytest
from bsface import formats
from bsface.errors import ReconstructionError
from bsface.formats.curves import curve_on_surface, landmark_path
from bsface.formats.exchange import edge_in_space, open_curve
from bsface.formats.mesh import write_mesh_obj, write_mesh_ply
from bsface.formats.mesh_reader import read_mesh_vertices
from bsface.formats.printing import write_stl
from bsface.formats.tessellation import tessellate
from bsface.surface.deviation import deviation
from bsface.surface.template import load_template
from fake_face import bare_reconstruction, ellipse_outline, face_surface
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree


@given(st.floats(-3, 3))
@settings(max_examples=5, deadline=None)
def test_points_along_normals_have_their_distance(distance):
    surface = face_surface(nose=6.0)
    uv = np.random.default_rng(0).uniform(0.2, 0.8, (60, 2))
    points = surface.evaluate(*uv.T) + distance * surface.normals(*uv.T)
    found = deviation(surface, points)
    assert found.outside == 0
    np.testing.assert_allclose(found.distance, distance, atol=1e-6)
    assert "60 points" in found.summary()


def test_points_beside_the_face_are_counted_and_not_measured():
    surface, outline = face_surface(), ellipse_outline()
    inside = surface.evaluate(0.5, 0.5)
    corner = surface.evaluate(0.02, 0.02)
    beyond = surface.evaluate(1.0, 0.5) + (30, 0, 0)
    found = deviation(surface, [inside, corner, beyond], outline)
    assert found.outside == 2 and len(found.distance) == 1
    assert deviation(surface, [beyond]).summary() == "no point lies on the face"
    many = deviation(surface, np.tile(inside, (100, 1)), most=30)
    assert len(many.distance) == 25
    with pytest.raises(ValueError, match="finite"):
        deviation(surface, [[0, 0, np.nan]])


@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "text.stl", "ascii.ply"])
def test_meshes_of_other_programs_are_read(tmp_path, kind):
    surface, outline = face_surface(), ellipse_outline()
    made = tessellate(surface, outline, 0.5)
    path = tmp_path / f"scan.{kind}"
    if kind == "obj":
        write_mesh_obj(path, surface, outline, tolerance=0.5)
    elif kind == "ply":
        write_mesh_ply(path, surface, outline, tolerance=0.5)
    elif kind == "stl":
        write_stl(path, made.vertices, made.triangles)
    elif kind == "text.stl":
        rows = [f"  vertex {x} {y} {z}" for x, y, z in made.vertices]
        path.write_text("solid scan\n" + "\n".join(rows) + "\nendsolid\n")
    else:
        head = f"ply\nformat ascii 1.0\nelement vertex {len(made.vertices)}\n"
        head += "".join(f"property float {axis}\n" for axis in "xyz")
        rows = [f"{x} {y} {z}" for x, y, z in made.vertices]
        path.write_text(head + "end_header\n" + "\n".join(rows) + "\n")
    points = read_mesh_vertices(path)
    assert len(points) == len(made.vertices)
    # STL rounds to single precision.
    for a, b in ((points, made.vertices), (made.vertices, points)):
        assert cKDTree(a).query(b)[0].max() < 2e-5
    assert np.abs(deviation(surface, points[::9]).distance).max() < 1e-4


@given(st.binary(max_size=300), st.sampled_from([".obj", ".stl", ".ply"]))
@settings(max_examples=40, deadline=None)
def test_damaged_meshes_end_in_a_sentence(tmp_path_factory, data, ending):
    path = tmp_path_factory.mktemp("damaged") / f"scan{ending}"
    path.write_bytes(data)
    try:
        assert read_mesh_vertices(path).shape[1] == 3
    except ReconstructionError as error:
        assert str(path) in str(error)


def test_other_files_are_refused(tmp_path):
    for name, match in (("scan.fbx", "only .obj"), ("none.obj", "cannot be read")):
        with pytest.raises(ReconstructionError, match=match):
            read_mesh_vertices(tmp_path / name)


# -------------------------------------------------------------------- curves
RING = 0.5 + 0.2 * np.stack(
    [np.cos(np.arange(12) * np.pi / 6), np.sin(np.arange(12) * np.pi / 6)], 1
)


@pytest.mark.parametrize("closed", [True, False])
def test_curve_lies_on_the_surface_and_goes_through_its_points(closed):
    surface = face_surface()
    curve = curve_on_surface(surface, RING, closed=closed)
    along = curve(np.linspace(0, 1, 400))
    assert surface.closest_point(along)[1].max() < 2e-4
    dense = curve(np.linspace(0, 1, 20_000))
    for point in surface.evaluate(*RING.T):
        assert np.linalg.norm(dense - point, axis=1).min() < 0.05
    ends = curve.control_points[[0, -1]]
    assert bool((ends[0] == ends[1]).all()) is closed


def test_curve_on_a_large_surface_keeps_its_tolerance():
    large = face_surface(nose=6.0).transformed(1e4)
    flat = open_curve(np.linspace(0, 1, len(RING)), RING)
    t = np.linspace(0, 1, 9999)
    on = large.evaluate(flat(t)[:, 0], 1 - flat(t)[:, 1])
    edge = edge_in_space(large, flat, open_curve)
    assert np.linalg.norm(edge(t) - on, axis=1).max() < 2e-4
    with pytest.raises(ValueError, match="size of the face"):
        edge_in_space(large, flat, open_curve, most_points=100)


def test_curve_between_landmarks():
    """Round the nose and the mouth, as the seal of a mask."""
    template = load_template()
    marks = [6, 198, 205, 216, 212, 204, 18, 424, 432, 436, 425, 420]
    curve = curve_on_surface(template.surface, landmark_path(template, marks))
    dense = curve(np.linspace(0, 1, 20_000))
    for point in template.surface.evaluate(*template.landmark_uv[marks].T):
        assert np.linalg.norm(dense - point, axis=1).min() < 0.05
    with pytest.raises(ValueError, match="0 to 467"):
        landmark_path(template, [468])


def test_unusable_curves_are_refused():
    surface = face_surface()
    for uv, match in (
        (RING[:3], "at least 4"),
        (np.zeros((5, 2)) + 0.5, "the same"),
        ([[0.01, 0.01], [0.99, 0.02], [0.98, 0.99], [0.0, 0.98]], "leaves"),
        (np.zeros((5, 3)), "points"),
    ):
        with pytest.raises(ValueError, match=match):
            curve_on_surface(surface, uv)


def test_cad_files_hold_the_curve(tmp_path):
    """OpenCASCADE and rhino3dm find the face and the curve, at its place."""
    pytest.importorskip("OCP", reason="OpenCASCADE is not installed")
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib
    from OCP.IGESControl import IGESControl_Reader
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE
    from OCP.TopExp import TopExp_Explorer

    face = bare_reconstruction()
    curve = curve_on_surface(face.surface, RING)
    options = formats.ExportOptions(curves=(("seal", curve),))
    expected = curve(np.linspace(0, 1, 2000))

    def shapes(reader, path):
        assert int(reader.ReadFile(str(path))) == 1
        reader.TransferRoots()
        return [reader.Shape(i + 1) for i in range(reader.NbShapes())]

    def count(shape, kind):
        explorer, found = TopExp_Explorer(shape, kind), 0
        while explorer.More():
            found += 1
            explorer.Next()
        return found

    for kind, reader in ((".step", STEPControl_Reader), (".igs", IGESControl_Reader)):
        path = formats.export(tmp_path / f"face{kind}", face, options=options)
        found = shapes(reader(), path)
        assert sum(count(s, TopAbs_FACE) for s in found) == 1
        loose = [
            e for s in found for e in edges_without_face(s, TopAbs_EDGE, TopAbs_FACE)
        ]
        assert len(loose) == 1
        box = Bnd_Box()
        BRepBndLib.AddOptimal_s(loose[0], box)
        corners = np.array([box.CornerMin().Coord(), box.CornerMax().Coord()])
        np.testing.assert_allclose(
            corners, [expected.min(0), expected.max(0)], atol=0.01
        )
    assert "'seal'" in (tmp_path / "face.step").read_text()

    rhino3dm = pytest.importorskip("rhino3dm", reason="rhino3dm is not installed")
    path = formats.export(tmp_path / "face.3dm", face, options=options)
    model = rhino3dm.File3dm.Read(str(path))
    names = [model.Objects[i].Attributes.Name for i in range(len(model.Objects))]
    assert names == ["face", "face outline", "seal"]
    assert [layer.Name for layer in model.Layers] == ["surface", "outline", "curves"]


def edges_without_face(shape, edge, face):
    """Edges of a shape that bound no face."""
    from OCP.TopExp import TopExp_Explorer

    explorer, found = TopExp_Explorer(shape, edge, face), []
    while explorer.More():
        found.append(explorer.Current())
        explorer.Next()
    return found


CORNERS = np.array([[0.0, 1, 2], [3, 4.5, 5], [-6, 7, 8]])
HEADER = "ply\nformat {}\ncomment ü\n{}end_header\n"
VERTEX = "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 2\nproperty list uchar int vertex_indices\n"
TEXT = "\n".join(" ".join(map(str, row)) for row in CORNERS) + "\n"
FACES = "3 0 1 2\n3 2 1 0\n"
PACKED = (b"\x03" + np.arange(3, dtype="<i4").tobytes()) * 2


def stl(extra=b""):
    record = np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("extra", "<u2")])
    triangle = np.zeros(1, record)
    triangle["v"] = CORNERS
    return bytes(80) + (1).to_bytes(4, "little") + triangle.tobytes() + extra


def ply(form, *elements):
    return HEADER.format(form, "".join(elements)).encode("latin-1")


LINES = "".join(f"  v {row}\n" for row in TEXT.splitlines())
LOOP = "".join(f"vertex {row}\n" for row in TEXT.splitlines())
ASCII, BINARY = "ascii 1.0", "binary_little_endian 1.0"
ODD = {
    "crlf.ply": (ply(ASCII, VERTEX.format(3)) + TEXT.encode()).replace(b"\n", b"\r\n"),
    "crlf header.ply": ply(BINARY, VERTEX.format(3)).replace(b"\n", b"\r\n")
    + CORNERS.astype("<f4").tobytes(),
    "faces first.ply": ply(ASCII, FACE, VERTEX.format(3)) + (FACES + TEXT).encode(),
    "binary faces first.ply": ply(BINARY, FACE, VERTEX.format(3))
    + PACKED
    + CORNERS.astype("<f4").tobytes(),
    "cr.obj": LINES.replace("\n", "\r").encode(),
    "crlf.obj": LINES.replace("\n", "\r\n").encode(),
    "indented.obj": LINES.encode(),
    "byte behind.stl": stl(b"\n"),
    "upper.stl": ("solid A\n" + LOOP + "endsolid\n").upper().encode(),
    "cr.stl": ("solid a\n" + LOOP + "endsolid\n").replace("\n", "\r").encode(),
}


@pytest.mark.parametrize("name", ODD)
def test_unusual_meshes_are_read(tmp_path, name):
    (tmp_path / name).write_bytes(ODD[name])
    found = read_mesh_vertices(tmp_path / name)
    np.testing.assert_allclose(found, np.unique(CORNERS, axis=0))


@pytest.mark.parametrize(
    "name, content",
    [
        ("short.ply", ply(ASCII, VERTEX.format(4)) + TEXT.encode()),
        ("short binary.ply", ply(BINARY, VERTEX.format(4)) + bytes(40)),
        ("lists.ply", ply(BINARY, FACE, VERTEX.format(3)) + PACKED[:-2]),
        ("short.stl", stl()[:-1]),
    ],
)
def test_meshes_that_hold_less_than_they_say_are_refused(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ReconstructionError, match="no vertices can be read"):
        read_mesh_vertices(tmp_path / name)


@pytest.mark.parametrize("most", [0, -1, 1.5, True])
def test_the_most_points_are_a_positive_whole_number(most):
    with pytest.raises((TypeError, ValueError), match="most must be a whole number"):
        deviation(face_surface(), np.zeros((3, 3)), most=most)


@pytest.mark.parametrize("marks", [[1.5, 2], [], [True, False], 3, ["6"]])
def test_landmarks_of_a_path_are_whole_numbers(marks):
    with pytest.raises(ValueError, match="landmarks must be a list of whole numbers"):
        landmark_path(load_template(), marks)
