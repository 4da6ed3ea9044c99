"""GLB: what a reader written from the specification finds in it."""

import json
import struct

import numpy as np
import pytest
from bsface import formats
from bsface.drawing.pictures import encode_png, write_png
from bsface.errors import ReconstructionError
from bsface.formats.glb import glb_bytes
from bsface.rig.mesh import PARTS, quad_mesh
from bsface.rig.names import ARKIT_NAMES
from fake_face import average_reconstruction

SIZES = {5126: ("<f4", 4), 5125: ("<u4", 4), 5123: ("<u2", 2)}
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}


@pytest.fixture(scope="module")
def mesh():
    return quad_mesh(average_reconstruction(), "low")


class Reader:
    """Container and accessors of glTF 2.0, from the specification."""

    def __init__(self, data):
        magic, version, total = struct.unpack("<4sII", data[:12])
        assert (magic, version, total) == (b"glTF", 2, len(data))
        size, kind = struct.unpack("<I4s", data[12:20])
        assert kind == b"JSON" and size % 4 == 0
        self.json = json.loads(data[20 : 20 + size])
        more, kind = struct.unpack("<I4s", data[20 + size : 28 + size])
        assert kind == b"BIN\0" and 28 + size + more == total
        self.binary = data[28 + size :]
        assert self.json["buffers"] == [{"byteLength": more}]

    def view(self, index):
        view = self.json["bufferViews"][index]
        assert view["byteOffset"] % 4 == 0
        return self.binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]

    def accessor(self, index):
        a = self.json["accessors"][index]
        kind, _ = SIZES[a["componentType"]]
        width = WIDTH[a["type"]]
        if "bufferView" in a:
            value = np.frombuffer(self.view(a["bufferView"]), kind)
            value = value.reshape(a["count"], width).copy()
        else:
            value = np.zeros((a["count"], width), kind)
        if "sparse" in a:
            s = a["sparse"]
            index_kind, _ = SIZES[s["indices"]["componentType"]]
            at = np.frombuffer(self.view(s["indices"]["bufferView"]), index_kind)
            assert len(at) == s["count"] and (np.diff(at.astype(int)) > 0).all()
            new = np.frombuffer(self.view(s["values"]["bufferView"]), kind)
            value[at] = new.reshape(-1, width)
        if "min" in a:
            np.testing.assert_allclose(value.min(0), a["min"], atol=1e-7)
            np.testing.assert_allclose(value.max(0), a["max"], atol=1e-7)
        return value


def test_geometry_in_metres_without_turn_or_scale(mesh):
    file = Reader(glb_bytes(mesh, "somebody"))
    assert file.json["nodes"] == [{"mesh": 0, "name": "somebody"}]
    (made,) = file.json["meshes"]
    total = 0
    for primitive, part in zip(made["primitives"], range(len(PARTS)), strict=True):
        quads = mesh.quads[mesh.part == part]
        points = file.accessor(primitive["attributes"]["POSITION"])
        triangles = file.accessor(primitive["indices"]).reshape(-1, 3)
        normals = file.accessor(primitive["attributes"]["NORMAL"])
        assert triangles.max() == len(points) - 1
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
        np.testing.assert_allclose(
            points * 1000, mesh.points[np.unique(quads)], atol=1e-4
        )
        corner = points[triangles]
        face = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        along = (face * normals[triangles].mean(axis=1)).sum(axis=1)
        assert (along > 0).mean() > 0.95
        total += len(triangles)
    assert total == 2 * len(mesh.quads)
    uv = file.accessor(made["primitives"][0]["attributes"]["TEXCOORD_0"])
    # The first row of a glTF picture has v = 0, as the core's does.
    points = file.accessor(made["primitives"][0]["attributes"]["POSITION"])
    assert points[uv[:, 1].argmin(), 1] > 0.05


def test_keys_are_named_morph_targets(mesh):
    file = Reader(glb_bytes(mesh))
    (made,) = file.json["meshes"]
    assert made["extras"]["targetNames"] == list(ARKIT_NAMES)
    assert made["weights"] == [0.0] * 52
    for part, primitive in enumerate(made["primitives"]):
        used = np.unique(mesh.quads[mesh.part == part])
        assert len(primitive["targets"]) == 52
        for name, target in zip(ARKIT_NAMES, primitive["targets"], strict=True):
            moved = file.accessor(target["POSITION"])
            expected = mesh.keys[name][used] / 1000
            np.testing.assert_allclose(moved, expected, atol=2e-5)
            if name == "jawOpen" and part == 0:
                normals = file.accessor(primitive["attributes"]["NORMAL"])
                bent = normals + file.accessor(target["NORMAL"])
                assert np.abs(np.linalg.norm(bent, axis=1) - 1).max() < 0.01


def test_texture_is_embedded_as_it_is(mesh, tmp_path):
    picture = np.random.default_rng(0).integers(0, 255, (8, 8, 3), np.uint8)
    path = write_png(tmp_path / "skin.png", picture)
    bent = write_png(tmp_path / "normal.png", picture[::-1])
    file = Reader(glb_bytes(mesh, texture=path, normals=bent))
    skin = next(m for m in file.json["materials"] if m["name"] == "skin")
    texture = skin["pbrMetallicRoughness"]["baseColorTexture"]["index"]
    image = file.json["images"][file.json["textures"][texture]["source"]]
    assert file.view(image["bufferView"]) == encode_png(picture)
    assert image["mimeType"] == "image/png"
    texture = skin["normalTexture"]["index"]
    image = file.json["images"][file.json["textures"][texture]["source"]]
    assert file.view(image["bufferView"]) == bent.read_bytes()
    others = [m for m in file.json["materials"] if m["name"] != "skin"]
    assert others and not any("normalTexture" in m for m in others)
    (tmp_path / "skin.txt").write_text("no picture")
    for wrong, match in (("skin.txt", "no PNG or JPEG"), ("none.png", "cannot be")):
        with pytest.raises(ReconstructionError, match=match):
            glb_bytes(mesh, texture=tmp_path / wrong)


def test_export_by_ending_with_options(tmp_path):
    face = average_reconstruction()
    plain = formats.ExportOptions(density="low", keys=False, openings=False)
    path = formats.export(tmp_path / "face.glb", face, options=plain)
    file = Reader(path.read_bytes())
    assert [m["name"] for m in file.json["materials"]] == ["skin"]
    assert "targets" not in file.json["meshes"][0]["primitives"][0]
    again = formats.export(tmp_path / "again.glb", face, options=plain, name="face")
    assert again.read_bytes() == path.read_bytes()
    with pytest.raises(ReconstructionError, match="low, medium, high"):
        formats.export(
            tmp_path / "x.glb", face, options=formats.ExportOptions(density="fine")
        )
