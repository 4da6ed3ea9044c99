"""The artist's whole path on real photos: folder, face, coarse edit, mesh, GLB."""

import bpy
import numpy as np
import pytest
from blender.checkout import load

ARKIT_NAMES = load("core.rig.names").ARKIT_NAMES
coarse_editor = load("bsface_addon.coarse_editor")
material = load("bsface_addon.material")
surface_object = load("bsface_addon.surface_object")


@pytest.fixture
def folder(tmp_path, example_photos):
    """Three of the example photos."""
    return example_photos(tmp_path, (3, 8, 13))


def world(obj, key=None):
    """Vertices of a mesh object in metres, those of a shape key if it is named."""
    keys = obj.data.shape_keys
    data = obj.data.vertices if key is None else keys.key_blocks[key].data
    local = np.empty(3 * len(data), np.float32)
    data.foreach_get("co", local)
    matrix = np.array(obj.matrix_world)
    return local.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


def test_from_a_folder_to_a_mesh_that_another_program_opens(addon, folder):
    state = bpy.context.scene.bsface
    state.settings.method, state.texture_size = "motion", "512"
    state.settings.control_points_u, state.settings.control_points_v = 20, 22
    bpy.ops.bsface.photos_add(directory=str(folder))
    bpy.ops.bsface.reconstruct(name="Ann")
    face = state.face
    assert [row.status for row in state.photos] == ["used"] * 3
    before = surface_object.read(face)

    # The tip of the nose, 5 mm out by the coarse net; Mirror is on.
    bpy.ops.bsface.coarse_edit()
    net = coarse_editor.editor()
    coarse = surface_object.read(net)
    tip = np.unravel_index(coarse[3:-3, 3:-3, 2].argmax(), (6, 8))
    bpy.ops.curve.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    point = net.data.splines[0].points[(tip[1] + 3) * 12 + tip[0] + 3]
    point.co.y -= 0.005
    bpy.ops.bsface.coarse_done()
    moved = surface_object.read(face) - before
    assert 2 < moved[..., 2].max() < 5.5 and abs(moved[..., :2]).max() < 0.1
    assert (np.linalg.norm(moved, axis=2) > 0.1).mean() < 0.6

    bpy.ops.bsface.arkit_keys()
    blocks = face.data.shape_keys.key_blocks
    assert [block.name for block in blocks[1:]] == list(ARKIT_NAMES)
    assert len(blocks) == 53

    bpy.ops.bsface.surface_to_mesh()
    mesh = bpy.data.objects["Ann mesh"]
    assert [slot.name for slot in mesh.data.materials] == [
        "BSface Ann",
        "BSface eyes",
        "BSface mouth",
    ]
    names = [block.name for block in mesh.data.shape_keys.key_blocks[1:]]
    assert names == list(ARKIT_NAMES)
    bpy.context.view_layer.update()
    size = np.ptp(world(mesh), axis=0)
    count = len(mesh.data.polygons)

    path = folder / "Ann.glb"
    bpy.ops.bsface.export(filepath=str(path), kind=".glb")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.import_scene.gltf(filepath=str(path))
    bpy.context.view_layer.update()
    found = [obj for obj in bpy.data.objects if obj.type == "MESH"]
    (again,) = found
    blocks = again.data.shape_keys.key_blocks
    assert [block.name for block in blocks[1:]] == list(ARKIT_NAMES)
    # Two triangles a quad; a metre is a metre, and up is up.
    assert len(again.data.polygons) == 2 * count
    np.testing.assert_allclose(np.ptp(world(again), axis=0), size, atol=1e-5)
    assert 0.12 < size[0] < 0.26 and size[2] > size[1]
    chin = np.ptp(world(again, "jawOpen") - world(again), axis=0)
    assert 0.005 < chin[2] < 0.05 and chin[0] < 0.01
    assert len(again.data.materials) == 3
    pictures = [image for image in bpy.data.images if image.size[0] > 1]
    assert max(image.size[0] for image in pictures) == 512
