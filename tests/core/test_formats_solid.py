"""Closed solids: manifold by trimesh, volumes by formulas, STL and 3MF read back."""

import io
import zipfile
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from bsface import formats
from bsface.drawing.pictures import encode_png
from bsface.errors import ReconstructionError
from bsface.formats.solid import border_edges, solid, volume
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import load_template
from fake_face import average_reconstruction, ellipse_outline, face_surface
from hypothesis import given, settings
from hypothesis import strategies as st

NAMESPACE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"


def checked(points, triangles):
    mesh = trimesh.Trimesh(points, triangles, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.is_volume
    assert volume(points, triangles) == pytest.approx(mesh.volume)
    return mesh


@given(st.floats(0.5, 8), st.floats(20, 90), st.floats(20, 90))
@settings(max_examples=10, deadline=None)
def test_plate_has_the_volume_of_a_box(thickness, width, height):
    u, v = (np.arange(8) - 1) / 5, (np.arange(9) - 1) / 6
    u, v = np.meshgrid(u, v, indexing="ij")
    flat = BSplineSurface(np.stack([width * u, -height * v, 0 * u], -1))
    points, triangles = solid(flat, None, thickness, 0.1)
    mesh = checked(points, triangles)
    assert mesh.volume == pytest.approx(width * height * thickness, rel=1e-9)


@pytest.mark.parametrize("thickness", [3.0])
@pytest.mark.parametrize("bundled", [False, True])
def test_volume_is_that_of_steiners_formula(thickness, bundled):
    """Volume between a surface and its offset: the integral of t - t^2 H + t^3 K/3."""
    template = load_template()
    surface = template.surface if bundled else face_surface()
    outline = template.outline_uv if bundled else ellipse_outline()
    points, triangles = solid(surface, outline, thickness, 0.3)
    mesh = checked(points, triangles)
    n = 160
    u, v = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n)
    uv = np.stack([u.ravel(), v.ravel()], 1)
    uv = uv[replace(template, outline_uv=outline).inside(uv)]
    d = {k: surface.evaluate(*uv.T, du=k[0], dv=k[1])
         for k in ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))}  # fmt: skip
    normal = surface.normals(*uv.T)
    dot = lambda a, b: (a * b).sum(1)  # noqa: E731
    e, f, g = dot(d[1, 0], d[1, 0]), dot(d[1, 0], d[0, 1]), dot(d[0, 1], d[0, 1])
    ll, mm, nn = (dot(d[k], normal) for k in ((2, 0), (1, 1), (0, 2)))
    area2 = e * g - f * f
    mean = (e * nn - 2 * f * mm + g * ll) / (2 * area2)
    gauss = (ll * nn - mm * mm) / area2
    # Inwards: convex places (mean < 0 with the outward normal) lose volume.
    t = thickness
    expected = (np.sqrt(area2) * (t + t**2 * mean + t**3 * gauss / 3)).sum() / n**2
    assert mesh.volume == pytest.approx(expected, rel=0.01)


def test_outer_side_is_the_face_and_inner_side_lies_behind_it():
    template = load_template()
    points, triangles = solid(template.surface, template.outline_uv, 2.0, 0.25)
    outer, inner = np.split(points, 2)
    assert template.surface.closest_point(outer[::40])[1].max() < 1e-6
    depth = template.surface.signed_distance(inner[::40])
    np.testing.assert_allclose(depth, -2.0, atol=0.05)
    assert len(border_edges(triangles)) == 0
    assert len(triangles) < 40_000


def test_a_thickness_that_folds_the_inside_is_smoothed_or_refused():
    """The nose of the made-up face has a radius of a few millimetres."""
    points, triangles = solid(face_surface(nose=25.0), ellipse_outline(), 6.0, 0.3)
    checked(points, triangles)
    with pytest.raises(ValueError, match="smaller thickness"):
        solid(face_surface(), ellipse_outline(), 400.0, 1.0)


@pytest.fixture(scope="module")
def face():
    return average_reconstruction()


def test_stl_and_3mf_hold_the_same_closed_solid(tmp_path, face):
    options = formats.ExportOptions(thickness=2.5, tolerance=1.5, name='a "b" <c>')
    points, triangles = solid(face.surface, face.template.outline_uv, 2.5, 1.5)
    stl = formats.export(tmp_path / "face.stl", face, options=options)
    read = trimesh.load_mesh(io.BytesIO(stl.read_bytes()), file_type="stl")
    assert read.is_volume and len(read.faces) == len(triangles)
    assert read.volume == pytest.approx(volume(points, triangles), rel=1e-4)
    assert not stl.read_bytes().startswith(b"solid")

    path = formats.export(tmp_path / "face.3mf", face, options=options)
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        root = ElementTree.fromstring(archive.read("3D/3dmodel.model"))
        for name in ("[Content_Types].xml", "_rels/.rels"):
            ElementTree.fromstring(archive.read(name))
    assert root.get("unit") == "millimeter"
    (thing,) = root.iter(f"{NAMESPACE}object")
    assert thing.get("name") == 'a "b" <c>'
    found = np.array([[float(v.get(k)) for k in "xyz"]
                      for v in root.iter(f"{NAMESPACE}vertex")])  # fmt: skip
    faces = np.array([[int(t.get(k)) for k in ("v1", "v2", "v3")]
                      for t in root.iter(f"{NAMESPACE}triangle")])  # fmt: skip
    np.testing.assert_allclose(found, points, atol=1e-3)
    assert np.array_equal(faces, triangles)
    checked(found, faces)
    again = formats.export(tmp_path / "again.3mf", face, options=options)
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.parametrize("field, value", [("thickness", 0.0), ("tolerance", -1.0),
                                          ("date", "yesterday")])  # fmt: skip
def test_unusable_options_are_refused_with_a_sentence(tmp_path, face, field, value):
    options = replace(formats.ExportOptions(), **{field: value})
    with pytest.raises(ReconstructionError, match=r"face\.stl: .*(length|date)"):
        formats.export(tmp_path / "face.stl", face, options=options)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", ["npz", "stl", "step"])
@pytest.mark.parametrize(
    "field, wrong",
    [
        ("trimmed", "no"),
        ("head", 1),
        ("keys", None),
        ("openings", "yes"),
        ("tolerance", True),
        ("thickness", "2"),
        ("name", 3),
        ("author", b"me"),
        ("author", None),
        ("date", 2026),
        ("density", 3),
        ("density", "fine"),
        ("texture", 99),
        ("normals", True),
        ("displacement", ["a.png"]),
        ("curves", None),
        ("curves", ("seal",)),
        ("curves", ((3, None),)),
        ("curves", (("seal", np.zeros((4, 2))),)),
    ],
)
def test_options_of_wrong_kinds_are_refused_by_name(
    tmp_path, face, ending, field, wrong
):
    options = formats.ExportOptions(**{field: wrong})
    with pytest.raises(
        (TypeError, ReconstructionError), match=rf"{field} must be .*\.$"
    ):
        formats.export(tmp_path / f"face.{ending}", face, options=options)
    assert not list(tmp_path.iterdir())


def test_options_count_for_the_face_file_too(tmp_path, face):
    with pytest.raises(ReconstructionError, match="positive length"):
        formats.export(tmp_path / "face.npz", face, tolerance=-1)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("head", [False, True])
@pytest.mark.parametrize("ending", ["glb", "obj"])
def test_pictures_may_be_in_memory(tmp_path, face, head, ending):
    texture = encode_png(np.full((16, 16, 3), 99, np.uint8))
    options = formats.ExportOptions(texture=texture, head=head, density="low")
    path = formats.export(tmp_path / f"face.{ending}", face, options=options)
    assert path.stat().st_size > 1000
