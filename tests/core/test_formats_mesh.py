"""Triangle meshes: on the surface, within the tolerance, clean border; OBJ and PLY."""

import numpy as np
import pytest
from bsface import formats
from bsface.drawing.pictures import write_png
from bsface.errors import ReconstructionError
from bsface.formats import ExportOptions, mesh
from bsface.formats.clipping import signed_distance
from bsface.formats.tessellation import tessellate
from bsface.surface.template import load_template
from fake_face import bare_reconstruction, ellipse_outline, face_surface


@pytest.fixture(scope="module")
def surface():
    return face_surface()


@pytest.mark.parametrize("tolerance", [1.0, 0.1, 0.02])
def test_mesh_stays_within_the_tolerance(surface, tolerance):
    found = tessellate(surface, ellipse_outline(), tolerance)
    rng = np.random.default_rng(0)
    corner = found.vertices[found.triangles]
    weight = rng.dirichlet((1, 1, 1), len(corner))
    points = np.einsum("tc,tck->tk", weight, corner)
    assert surface.closest_point(points)[1].max() <= tolerance
    assert found.deviation <= tolerance
    on_surface = surface.evaluate(*found.uv.T)
    np.testing.assert_allclose(found.vertices, on_surface, atol=1e-9)


def test_mesh_is_a_disc_that_faces_outwards(surface):
    found = tessellate(surface, ellipse_outline(), 0.1)
    corner = found.vertices[found.triangles]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    outward = found.normals[found.triangles].sum(axis=1)
    assert ((normal * outward).sum(axis=1) > 0).all()
    edges = np.concatenate([found.triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    assert len(np.unique(edges, axis=0)) == len(edges), "an edge is used twice"
    undirected, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    euler = len(found.vertices) - len(undirected) + len(found.triangles)
    assert euler == 1 and count.max() == 2
    rim = np.unique(undirected[count == 1])
    off = signed_distance(ellipse_outline(), found.uv[rim])[0]
    assert np.abs(off).max() < 1e-6


def test_untrimmed_mesh_covers_the_square(surface):
    found = tessellate(surface, None, 0.5)
    side = found.uv[found.triangles]
    a, b = side[:, 1] - side[:, 0], side[:, 2] - side[:, 0]
    assert np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2 == pytest.approx(1)


def test_signed_distance_of_a_square():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    points = np.array([[0.5, 0.9], [0.5, 1.5], [2, 2], [-0.25, 0.5]])
    distance, nearest = signed_distance(square, points)
    np.testing.assert_allclose(distance, [0.1, -0.5, -np.sqrt(2), -0.25])
    np.testing.assert_allclose(nearest, [[0.5, 1], [0.5, 1], [1, 1], [0, 0.5]])


def test_unusable_tolerances_are_refused(surface):
    with pytest.raises(ValueError, match="positive length"):
        tessellate(surface, None, 0.0)
    with pytest.raises(ValueError, match="choose a larger one"):
        tessellate(surface, None, 1e-7)


def test_obj_holds_the_mesh_with_texture_coordinates(tmp_path, surface):
    picture = write_png(tmp_path / "skin.png", np.zeros((4, 4, 3), np.uint8))
    out = tmp_path / "out"
    path = mesh.write_mesh_obj(
        out / "my face.obj", surface, ellipse_outline(), texture=picture
    )
    expected = tessellate(surface, ellipse_outline(), 0.25)
    rows = [line.split() for line in path.read_text().splitlines()]
    points = np.array([r[1:] for r in rows if r[0] == "v"], float)
    texture = np.array([r[1:] for r in rows if r[0] == "vt"], float)
    faces = [[p.split("/") for p in r[1:]] for r in rows if r[0] == "f"]
    index = np.array(faces, int)
    assert np.array_equal(points, expected.vertices)
    np.testing.assert_allclose(texture, expected.uv * (1, -1) + (0, 1), atol=1e-15)
    assert np.array_equal(index[:, :, 0] - 1, expected.triangles)
    assert ["mtllib", "my_face.mtl"] in rows and ["usemtl", "skin"] in rows
    assert "map_Kd my_face.png\n" in (out / "my_face.mtl").read_text()
    assert (out / "my_face.png").read_bytes() == picture.read_bytes()
    mesh.write_mesh_obj(
        out / "bent.obj", surface, normals=picture, displacement=picture
    )
    text = (out / "bent.mtl").read_text()
    assert "norm bent_normal.png\nmap_Bump -bm 1 bent_normal.png\n" in text
    assert "disp bent_displacement.png\n" in text
    assert "map_Kd" not in text
    assert (out / "bent_normal.png").read_bytes() == picture.read_bytes()
    assert (out / "bent_displacement.png").read_bytes() == picture.read_bytes()
    with pytest.raises(ReconstructionError, match="no PNG or JPEG"):
        mesh.write_mesh_obj(out / "x.obj", surface, texture=path)
    picture.write_bytes(picture.read_bytes()[:40])
    with pytest.raises(ReconstructionError, match="damaged or cut short"):
        mesh.write_mesh_obj(out / "x.obj", surface, texture=picture)


def test_default_mesh_of_a_face_is_light():
    template = load_template()
    made = tessellate(template.surface, template.outline_uv, 0.25)
    assert ExportOptions().tolerance == 0.25 and len(made.triangles) < 20_000


def test_ply_header_describes_its_bytes(tmp_path, surface):
    path = mesh.write_mesh_ply(tmp_path / "face.ply", surface, None, tolerance=0.3)
    expected = tessellate(surface, None, 0.3)
    header, body = path.read_bytes().split(b"end_header\n", 1)
    kinds = {b"double": "<f8", b"float": "<f4"}
    lines = [line.split() for line in header.splitlines()]
    fields = [
        (r[2].decode(), kinds[r[1]])
        for r in lines
        if r[0] == b"property" and r[1] in kinds
    ]
    counts = [int(r[2]) for r in lines if r[0] == b"element"]
    vertex = np.frombuffer(body, fields, counts[0])
    face = np.frombuffer(
        body[vertex.nbytes :], [("n", "u1"), ("i", "<i4", 3)], counts[1]
    )
    assert vertex.nbytes + face.nbytes == len(body)
    found = np.stack([vertex[a] for a in "xyz"], axis=1)
    assert np.array_equal(found, expected.vertices)
    assert np.array_equal(face["i"], expected.triangles) and (face["n"] == 3).all()


def test_table_finds_the_writer_by_the_longest_ending(tmp_path):
    assert formats.ending("a/b.NURBS.obj") == ".nurbs.obj"
    assert formats.ending("a.obj") == ".obj" and formats.ending("x.txt") == ""
    face = bare_reconstruction()
    for name in formats.WRITERS:
        if name == ".3dm":
            continue
        path = formats.export(tmp_path / f"face{name}", face, tolerance=0.5)
        assert path.stat().st_size > 1000
    with pytest.raises(ReconstructionError, match="unknown ending"):
        formats.export(tmp_path / "face.doc", face)
    with pytest.raises(ReconstructionError, match="tolerance"):
        formats.export(tmp_path / "face.ply", face, tolerance=-1)
