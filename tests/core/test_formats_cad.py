"""CAD files, each read back by OpenCASCADE or rhino3dm and held against the core."""

import subprocess
import sys

import numpy as np
import pytest
from bsface.formats import obj, rhino, step
from bsface.formats.clipping import signed_distance
from bsface.formats.exchange import exchange_surface, open_curve, outline_curves
from bsface.formats.iges import write_iges
from bsface.formats.options import Stamp
from fake_face import ellipse_outline, face_surface
from scipy.interpolate import BSpline

WRITERS = {"step": step.write_step, "igs": write_iges}


@pytest.fixture(scope="module")
def surface():
    return face_surface()


@pytest.fixture(scope="module")
def outline():
    return ellipse_outline(200)


def parameters(count=400):
    return np.random.default_rng(3).uniform(0, 1, (2, count))


def relative_error(found, expected):
    return np.abs(found - expected).max() / np.abs(expected).max()


# ----------------------------------------------------------------- exchange
def test_clamped_surface_turned_upwards_is_the_same_surface(surface):
    face = exchange_surface(surface)
    u, v = parameters()
    basis_u = BSpline.design_matrix(u, face.knots_u, 3).toarray()
    basis_v = BSpline.design_matrix(1 - v, face.knots_v, 3).toarray()
    found = np.einsum("pi,pj,ijc->pc", basis_u, basis_v, face.control_points)
    assert relative_error(found, surface.evaluate(u, v)) < 1e-12


def test_outline_curve_is_closed_counter_clockwise_and_near_the_polygon(outline):
    for polygon in (outline, outline[::-1], np.vstack([outline, outline[:1]])):
        (curve,) = outline_curves(polygon)
        points = curve(np.linspace(0, 1, 1000))
        np.testing.assert_array_equal(curve.control_points[0], curve.control_points[-1])
        x, y = points.T
        assert (x[:-1] * y[1:] - x[1:] * y[:-1]).sum() > 0
        upwards = outline * (1, -1) + (0, 1)
        assert np.abs(signed_distance(upwards, points)[0]).max() < 2e-4


def test_outline_curve_stays_in_the_square_and_smooth_where_it_closes():
    wide = np.clip((ellipse_outline(200) - 0.5) * 1.3 + 0.5, 0, 1)
    (curve,) = outline_curves(wide)
    points = curve(np.linspace(0, 1, 2000))
    assert points.min() >= 0 and points.max() <= 1
    (smooth,) = outline_curves(ellipse_outline(200))
    spline = BSpline(smooth.knots, smooth.control_points, 3).derivative()
    np.testing.assert_allclose(spline(0.0), spline(1.0), atol=1e-9)


def test_outline_is_split_at_its_corners():
    square = np.array([[0, 0], [0.5, 0], [1, 0], [1, 0.3], [1, 1], [0, 1]], float)
    curves = outline_curves(square[::-1])
    assert len(curves) == 4 and {len(c.control_points) for c in curves} == {4}
    ends = np.array([c([0.0, 1.0]) for c in curves])
    assert np.array_equal(ends[:, 1], np.roll(ends[:, 0], -1, axis=0))
    assert sorted(ends[:, 0].tolist()) == [[0, 0], [0, 1], [1, 0], [1, 1]]


def half_moon(count=80):
    """Outline with two corners: half an ellipse and its chord."""
    angle = np.linspace(0, np.pi, count)
    return 0.5 + np.stack([0.4 * np.cos(angle), 0.4 * np.sin(angle)], axis=1)


def test_edges_lie_on_the_surface(surface, outline):
    t = np.linspace(0, 1, 3333)
    for polygon, pieces in ((outline, 1), (half_moon(), 2)):
        face = exchange_surface(surface, polygon)
        assert len(face.edges) == len(face.outline) == pieces
        for flat, edge in zip(face.outline, face.edges, strict=True):
            u, v = flat(t).T
            off = np.linalg.norm(edge(t) - surface.evaluate(u, 1 - v), axis=1)
            assert off.max() < 2e-4
    with pytest.raises(ValueError, match="outline must be"):
        outline_curves(np.zeros((2, 2)))


# -------------------------------------------------------------- OpenCASCADE
def read_cad(path):
    """The only face of a STEP or IGES file and its shape, by OpenCASCADE."""
    pytest.importorskip(
        "OCP", reason="cadquery-ocp-novtk, the independent reader, is not installed"
    )
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.IGESControl import IGESControl_Reader
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    kind = STEPControl_Reader if path.suffix == ".step" else IGESControl_Reader
    reader = kind()
    assert reader.ReadFile(str(path)) == IFSelect_RetDone
    reader.TransferRoots()
    shape = reader.OneShape()
    explorer = TopExp_Explorer(shape, TopAbs_FACE)
    faces = []
    while explorer.More():
        cast = getattr(TopoDS, "Face_s", None) or TopoDS.Face
        faces.append(cast(explorer.Current()))
        explorer.Next()
    assert len(faces) == 1
    return faces[0], shape


def area(shape):
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(shape, properties, 1e-6)
    return properties.Mass()


def grid_area(surface, outline, count=400):
    """Area of the trimmed surface by the midpoint rule."""
    at = (np.arange(count) + 0.5) / count
    u, v = (a.ravel() for a in np.meshgrid(at, at, indexing="ij"))
    size = np.linalg.norm(
        np.cross(surface.evaluate(u, v, du=1), surface.evaluate(u, v, dv=1)), axis=1
    )
    if outline is not None:
        size = size[signed_distance(outline, np.stack([u, v], 1))[0] > 0]
    return size.sum() / count**2


@pytest.mark.parametrize("trim", [ellipse_outline(200), half_moon(), None])
@pytest.mark.parametrize("kind", WRITERS)
def test_opencascade_reads_the_same_valid_face(tmp_path, surface, kind, trim):
    path = tmp_path / f"face.{kind}"
    WRITERS[kind](path, surface, trim)
    face, shape = read_cad(path)
    from OCP.BRep import BRep_Tool
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.gp import gp_Pnt, gp_Vec
    from OCP.TopAbs import TopAbs_FORWARD

    assert BRepCheck_Analyzer(shape).IsValid()
    assert face.Orientation() == TopAbs_FORWARD
    geometry = BRep_Tool.Surface_s(face)
    u, v = parameters()
    found, normals = [], []
    for a, b in zip(u, 1 - v, strict=True):
        point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()
        geometry.D1(float(a), float(b), point, along_u, along_v)
        normal = along_u.Crossed(along_v)
        found.append([point.X(), point.Y(), point.Z()])
        normals.append([normal.X(), normal.Y(), normal.Z()])
    assert relative_error(np.array(found), surface.evaluate(u, v)) < 1e-9
    # Orientation: the face's normals point out of the head.
    assert ((np.array(normals) * surface.normals(u, v)).sum(axis=1) > 0).all()
    expected = grid_area(surface, trim)
    assert area(shape) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("kind", WRITERS)
def test_trimming_edge_read_by_opencascade_lies_on_the_surface(
    tmp_path, surface, outline, kind
):
    path = tmp_path / f"face.{kind}"
    WRITERS[kind](path, surface, outline)
    face, _ = read_cad(path)
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.TopAbs import TopAbs_EDGE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    explorer = TopExp_Explorer(face, TopAbs_EDGE)
    points = []
    while explorer.More():
        cast = getattr(TopoDS, "Edge_s", None) or TopoDS.Edge
        curve = BRepAdaptor_Curve(cast(explorer.Current()))
        for t in np.linspace(curve.FirstParameter(), curve.LastParameter(), 60):
            point = curve.Value(float(t))
            points.append([point.X(), point.Y(), point.Z()])
        explorer.Next()
    uv, off = surface.closest_point(np.array(points))
    assert off.max() < 1e-3
    assert np.abs(signed_distance(outline, uv)[0]).max() < 1e-3


@pytest.mark.parametrize("kind", WRITERS)
def test_equal_faces_give_equal_bytes(tmp_path, surface, outline, kind):
    contents = [
        WRITERS[kind](tmp_path / f"{i}.{kind}", surface, outline, "a 'b").read_bytes()
        for i in range(2)
    ]
    assert contents[0] == contents[1]
    assert len(list(tmp_path.iterdir())) == 2


def test_author_and_date_are_written_where_they_are_given(tmp_path, surface):
    stamp = Stamp("J. O'Neill", "2026-11-22T10:30:00")
    text = step.write_step(tmp_path / "a.step", surface, stamp=stamp).read_text()
    assert "'2026-11-22T10:30:00',('J. O''Neill')" in text
    lines = write_iges(tmp_path / "a.igs", surface, stamp=stamp).read_text()
    text = "".join(x[:72].rstrip() for x in lines.splitlines() if x[72] == "G")
    assert "15H20261122.103000" in text and "10HJ. O'Neill" in text


def test_iges_lines_have_eighty_columns(tmp_path, surface, outline):
    path = write_iges(tmp_path / "face.igs", surface, outline)
    lines = path.read_text().splitlines()
    assert {len(line) for line in lines} == {80}
    assert "".join(dict.fromkeys(line[72] for line in lines)) == "SGDPT"


@pytest.mark.parametrize(
    "text, coded",
    [
        ("plain", "'plain'"),
        ("O'Neill", "'O''Neill'"),
        (r"a\b", r"'a\\b'"),
        ("Müller", "'M" + r"\X2\00FC\X0" + "\\ller'"),
        ("頬線", "'" + r"\X2\982C7DDA\X0" + "\\'"),
        ("😀", "'" + r"\X4\0001F600\X0" + "\\'"),
        ("a\nb", "'a" + r"\X2\000A\X0" + "\\b'"),
        ("\udc80", "'?'"),
    ],
)
def test_texts_are_coded_by_the_standard(text, coded):
    assert step._string(text) == coded


def test_names_in_any_script_stay_apart_and_are_read(tmp_path, surface):
    """OpenCASCADE decodes them; two curves keep two names."""
    line = open_curve(np.linspace(0, 1, 5), np.outer(np.arange(5.0), (1, 1, 1)))
    path = tmp_path / "a.step"
    step.write_step(path, surface, None, "頬's", curves=(("ж", line), ("ü", line)))
    text = path.read_text("ascii")
    assert r"\X2\0436\X0" in text and r"\X2\00FC\X0" in text
    read_cad(path)
    from OCP.STEPControl import STEPControl_Reader

    reader = STEPControl_Reader()
    reader.ReadFile(str(path))
    model = reader.StepModel()
    items = (model.Value(k + 1) for k in range(model.NbEntities()))
    found = [
        bytes(i.Name().ToCString(), "utf-8", "surrogateescape").decode()
        for i in items
        if type(i).__name__ == "StepGeom_BSplineCurveWithKnots"
    ]
    assert {"ж", "ü"} <= set(found)


def test_iges_keeps_long_names_and_tells_curves_apart(tmp_path, surface):
    line = open_curve(np.linspace(0, 1, 5), np.outer(np.arange(5.0), (1, 1, 1)))
    path, name = tmp_path / "a.igs", "a face with a long name"
    write_iges(path, surface, None, name, curves=(("жж", line), ("üü", line)))
    lines = path.read_text("ascii").splitlines()
    assert {len(line) for line in lines} == {80}
    text = "".join(x[:72].rstrip() for x in lines if x[72] == "G").replace(" ", "")
    assert text.count(f"{len(name)}H{name}".replace(" ", "")) == 2
    assert f"{len(name) + 4}H{name}.igs".replace(" ", "") in text
    labels = [x[56:72] for x in lines if x[72] == "D"][1::2]
    assert len(set(labels[-2:])) == 2 and "??" in labels[-1]


# -------------------------------------------------------------------- Rhino
@pytest.mark.parametrize("trimmed", [True, False])
def test_rhino3dm_reads_the_same_surface(tmp_path, surface, outline, trimmed):
    rhino3dm = pytest.importorskip("rhino3dm", reason="rhino3dm is not installed")
    path = rhino.write_3dm(tmp_path / "face.3dm", surface, outline if trimmed else None)
    model = rhino3dm.File3dm.Read(str(path))
    assert model.Settings.ModelUnitSystem == rhino3dm.UnitSystem.Millimeters
    geometries = [model.Objects[i].Geometry for i in range(len(model.Objects))]
    patch = geometries[0]
    if not isinstance(patch, rhino3dm.NurbsSurface):
        patch = patch.Surfaces[0].ToNurbsSurface()
    u, v = parameters(100)
    points = [patch.PointAt(float(a), float(b)) for a, b in zip(u, 1 - v, strict=True)]
    found = np.array([[p.X, p.Y, p.Z] for p in points])
    assert relative_error(found, surface.evaluate(u, v)) < 1e-9
    assert len(geometries) == 1 + trimmed
    layers = [
        model.Layers[model.Objects[i].Attributes.LayerIndex].Name
        for i in range(len(model.Objects))
    ]
    assert layers == ["surface", "outline"][: 1 + trimmed]
    if trimmed:
        domain = geometries[1].Domain
        points = [geometries[1].PointAt(t) for t in np.linspace(domain.T0, domain.T1)]
        _, off = surface.closest_point(np.array([[p.X, p.Y, p.Z] for p in points]))
        assert off.max() < 1e-3


def test_3dm_without_rhino3dm_says_what_to_install(tmp_path):
    program = """
import sys
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name == "rhino3dm":
            raise ImportError(name)
sys.meta_path.insert(0, Blocker())
from bsface.errors import ReconstructionError
from bsface.formats.rhino import write_3dm
from bsface.surface.template import load_template
try:
    write_3dm(sys.argv[1], load_template().surface)
except ReconstructionError as error:
    print(error)
"""
    run = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "face.3dm")],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert "bsface[cad]" in run.stdout, run.stderr
    assert not list(tmp_path.iterdir())


# ------------------------------------------------------------ free-form OBJ
def read_freeform(path):
    """A reader of the free-form part of OBJ, written from the format's manual."""
    text = path.read_text().replace("\\\n", " ")
    vertices, flat, body, curves = [], [], {}, []
    target = {}
    for line in text.splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            vertices.append([float(x) for x in rest])
        elif word == "vp":
            flat.append([float(x) for x in rest])
        elif word == "curv2":
            target = {"index": [int(x) - 1 for x in rest]}
            curves.append(target)
        elif word == "surf":
            target = body
            target["range"] = [float(x) for x in rest[:4]]
            target["index"] = [int(x) - 1 for x in rest[4:]]
        elif word == "parm":
            target[rest[0]] = np.array([float(x) for x in rest[1:]])
        elif word == "trim":
            target["trim"] = [int(x) for x in rest[2::3]]
    count_u, count_v = len(body["u"]) - 4, len(body["v"]) - 4
    net = np.array(vertices)[body["index"]].reshape(count_v, count_u, 3)
    return net, body, [BSpline(c["u"], np.array(flat)[c["index"]], 3) for c in curves]


def test_freeform_obj_read_from_the_manual_is_the_same_surface(
    tmp_path, surface, outline
):
    path = obj.write_freeform_obj(tmp_path / "face.obj", surface, outline)
    net, body, (loop,) = read_freeform(path)
    assert body["range"] == [0, 1, 0, 1] and body["trim"] == [1]
    u, v = parameters()
    along_v = BSpline(body["v"], net, 3)(1 - v)
    basis = BSpline.design_matrix(u, body["u"], 3).toarray()
    found = np.einsum("pi,pic->pc", basis, along_v)
    assert relative_error(found, surface.evaluate(u, v)) < 1e-9
    points = loop(np.linspace(0, 1, 300)) * (1, -1) + (0, 1)
    assert np.abs(signed_distance(outline, points)[0]).max() < 1e-3
    assert "trim" not in obj.obj_text(exchange_surface(surface))
    assert max(len(line) for line in path.read_text().splitlines()) <= 80
    corners = obj.write_freeform_obj(tmp_path / "corners.obj", surface, half_moon())
    _, body, loops = read_freeform(corners)
    assert body["trim"] == [1, 2]
    for one, other in zip(loops, loops[::-1], strict=True):
        np.testing.assert_allclose(one(1.0), other(0.0), atol=1e-12)
