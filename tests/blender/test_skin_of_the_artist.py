"""What an artist does to the face's material and pictures is kept and exported."""

import bpy
import cv2
import numpy as np
import pytest
from blender import faces
from blender.checkout import load

material = load("bsface_addon.material")
session = load("bsface_addon.session")
Map = load("bsface_addon.maps").Map
Outcome = load("bsface_addon.solving").Outcome
encode_png = load("core.drawing.pictures").encode_png


def picture(level):
    return Map(encode_png(np.full((8, 8, 3), level, np.uint8)))


@pytest.fixture
def skin(face, solver, tmp_path):
    """The skin's picture of a face whose runs find one."""
    found = {"SKIN": picture(50), "DETAIL": picture(128)}
    solver.answer = Outcome.of(faces.reconstruction(tmp_path / "photos"), found)
    bpy.ops.bsface.reconstruct()
    return material.stored_map(face, "SKIN")


def paint(image):
    """As a brush does: the upper half of the picture white."""
    pixels = np.empty(4 * 64, np.float32)
    image.pixels.foreach_get(pixels)
    pixels.reshape(8, 8, 4)[4:] = 1.0
    image.pixels.foreach_set(pixels)
    assert image.is_dirty


@pytest.mark.parametrize("saved", [False, True])
def test_paint_goes_into_the_files(skin, tmp_path, saved):
    paint(skin)
    if saved:
        skin.pack()
    path = tmp_path / "skin.png"
    bpy.ops.bsface.texture_save(filepath=str(path))
    written = cv2.imread(str(path))
    # The forehead, v = 0, is Blender's bottom and the file's top.
    assert (written[:4] == 50).all() and (written[4:] == 255).all()


@pytest.mark.parametrize("saved", [False, True])
def test_a_new_run_keeps_the_painted_picture(face, skin, saved):
    paint(skin)
    if saved:
        skin.pack()
    bpy.ops.bsface.surface_refit()
    assert skin.name == "Ann Skin Painted" and skin.use_fake_user
    assert material.stored_map(face, "SKIN").name == "Ann Skin"
    bpy.ops.bsface.surface_refit()
    assert [i.name for i in bpy.data.images if i.name.startswith("Ann Skin")] == [
        "Ann Skin",
        "Ann Skin Painted",
    ]


def test_pictures_that_were_unpacked_are_exported(skin, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    skin = bpy.data.images["Ann Skin"]
    skin.unpack(method="WRITE_LOCAL")
    assert skin.packed_file is None
    bpy.ops.bsface.texture_save(filepath=str(tmp_path / "skin.png"))
    assert (cv2.imread(str(tmp_path / "skin.png")) == 50).all()
    for path in (tmp_path / "textures").iterdir():
        path.unlink()
    with pytest.raises(RuntimeError, match="Ann Skin is not at .*textures"):
        bpy.ops.bsface.texture_save(filepath=str(tmp_path / "skin.png"))


def test_nodes_of_the_artist_stay(face, skin):
    nodes = face.data.materials[0].node_tree.nodes
    nodes.new("ShaderNodeValToRGB").name = "Ramp"
    nodes["Skin"].inputs["Roughness"].default_value = 0.9
    nodes.remove(nodes["Flat"])
    bpy.ops.bsface.surface_map(kind="NORMALS")
    assert "Ramp" in nodes and "Flat" in nodes
    assert nodes["Skin"].inputs["Roughness"].default_value == pytest.approx(0.9)
    nodes.remove(nodes["Skin"])
    bpy.ops.bsface.surface_map(kind="SKIN")
    assert nodes["Skin"].inputs["Base Color"].is_linked
    assert nodes["Skin"].inputs["Normal"].is_linked
    assert nodes["Skin"].outputs[0].is_linked


def test_a_run_without_maps_after_their_pictures_were_deleted(face, skin, solver):
    bpy.data.batch_remove([skin, material.stored_map(face, "DETAIL")])
    solver.answer = Outcome.of(solver.answer.result)
    assert bpy.ops.bsface.surface_refit() == {"FINISHED"}


def test_a_copy_gets_its_own_pictures_with_its_own_run(face, skin, solver):
    copy = face.copy()
    copy.data = face.data.copy()  # as Shift D, which shares the material
    bpy.context.scene.collection.objects.link(copy)
    bpy.context.view_layer.objects.active = copy
    solver.answer = Outcome.of(solver.answer.result, {"SKIN": picture(90)})
    bpy.ops.bsface.surface_refit()
    assert material.stored_map(face, "SKIN") == skin
    assert material.packed_map(face, "SKIN") == picture(50).png
    assert material.packed_map(copy, "SKIN") == picture(90).png


def test_a_node_between_picture_and_shader_comes_back(face, skin):
    tree = face.data.materials[0].node_tree
    nodes, links = tree.nodes, tree.links
    hue, colour = nodes.new("ShaderNodeHueSaturation"), nodes["Skin"].inputs[0]
    links.new(nodes["SKIN"].outputs["Color"], hue.inputs["Color"])
    bpy.ops.bsface.surface_map(kind="SKIN")
    links.new(hue.outputs["Color"], colour)
    for _ in range(2):
        for kind in ("NORMALS", "PLAIN", "NORMALS", "SKIN"):
            bpy.ops.bsface.surface_map(kind=kind)
            if kind == "PLAIN":
                assert not colour.is_linked
        assert colour.links[0].from_node == hue
    nodes.remove(hue)
    bpy.ops.bsface.surface_map(kind="PLAIN")
    bpy.ops.bsface.surface_map(kind="SKIN")
    assert colour.links[0].from_node == nodes["SKIN"]
