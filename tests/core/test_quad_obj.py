"""The quad OBJ, read back line by line."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from bsface import formats
from bsface.drawing.pictures import write_png
from bsface.formats.quad_obj import write_quads_obj
from bsface.rig.head import full_head
from bsface.rig.mesh import PARTS
from fake_face import average_reconstruction


@pytest.fixture(scope="module")
def face():
    return average_reconstruction()


def read(path):
    """Vertices, texture coordinates, and quads by material."""
    v, vt, quads, material = [], [], {}, ""
    for line in path.read_text().splitlines():
        word, *rest = line.split()
        if word == "v":
            v.append([float(x) for x in rest])
        elif word == "vt":
            vt.append([float(x) for x in rest])
        elif word == "usemtl":
            (material,) = rest
        elif word == "f":
            corners = [tuple(int(x) - 1 for x in c.split("/")) for c in rest]
            quads.setdefault(material, []).append(corners)
    return np.array(v), np.array(vt), {k: np.array(q) for k, q in quads.items()}


def test_everything_is_in_it(face, tmp_path):
    mesh = full_head(face, "low", keys=False)
    texture = write_png(tmp_path / "x.png", np.full((9, 9, 3), 99, np.uint8))
    path = write_quads_obj(tmp_path / "my head.obj", mesh, "Ann B", texture=texture)
    v, vt, quads = read(path)
    np.testing.assert_array_equal(v, mesh.points)
    np.testing.assert_allclose(vt, mesh.uv * (1, -1) + (0, 1), atol=1e-12)
    assert list(quads) == list(PARTS)
    for k, part in enumerate(PARTS):
        assert (quads[part][..., 0] == mesh.quads[mesh.part == k]).all()
        assert (quads[part][..., 1] == quads[part][..., 0]).all()
    text = path.read_text()
    assert "mtllib my_head.mtl" in text and "o Ann_B" in text
    material = (tmp_path / "my_head.mtl").read_text()
    assert "map_Kd my_head.png" in material and "map_Kd my_head_eyes.png" in material
    assert (tmp_path / "my_head.png").read_bytes() == texture.read_bytes()
    assert (tmp_path / "my_head_eyes.png").exists()


def test_head_as_an_option_of_the_export(face, tmp_path):
    texture = write_png(tmp_path / "x.png", np.full((64, 64, 3), 99, np.uint8))
    options = formats.ExportOptions(
        head=True, density="low", keys=False, texture=texture
    )
    made = formats.export(tmp_path / "head.obj", face, options=options)
    v, _, quads = read(made)
    assert np.ptp(v[:, 2]) > 180 and len(quads["skin"]) > 2800
    skin = (tmp_path / "head.png").read_bytes()
    binary = formats.export(tmp_path / "head.glb", face, options=options).read_bytes()
    assert skin in binary, "the same picture in both"
    plain = formats.export(
        tmp_path / "plain.obj", face, options=replace(options, texture=None)
    )
    assert "map_Kd plain_eyes.png" in plain.with_suffix(".mtl").read_text()
    assert not (tmp_path / "plain.png").exists()


def test_normal_map_and_displacement_of_the_head(face, tmp_path):
    rng = np.random.default_rng(3)
    noise = rng.integers(0, 255, (64, 64, 3)).astype(np.uint8)
    high = rng.integers(0, 65535, (64, 64)).astype(np.uint16)
    normals = write_png(tmp_path / "n.png", noise)
    displacement = write_png(tmp_path / "d.png", high)
    options = formats.ExportOptions(
        head=True,
        density="low",
        keys=False,
        normals=normals,
        displacement=displacement,
    )
    made = formats.export(tmp_path / "my head.obj", face, options=options)
    skin, _ = made.with_name("my_head.mtl").read_text().split("newmtl eyes")
    assert "norm my_head_normal.png" in skin and "map_Kd" not in skin
    assert "map_Bump -bm 1 my_head_normal.png" in skin
    assert "disp my_head_displacement.png" in skin
    flags = cv2.IMREAD_UNCHANGED
    turned = cv2.imread(str(tmp_path / "my_head_normal.png"), flags)[..., ::-1]
    assert (turned[0] == (128, 128, 255)).all()
    assert (turned[48:64, 40:56] == noise[24:40, 24:40]).all()
    moved = cv2.imread(str(tmp_path / "my_head_displacement.png"), flags)
    assert moved.dtype == np.uint16 and (moved[0] == 32768).all()
    assert (moved[48:64, 40:56] == high[24:40, 24:40]).all()
    binary = formats.export(tmp_path / "head.glb", face, options=options).read_bytes()
    assert (tmp_path / "my_head_normal.png").read_bytes() in binary
