"""Meshes, heads and ARKit keys made of a face: they lie where the face does."""

import bpy
import numpy as np
import pytest
from blender.checkout import load
from blender.faces import points

maps = load("bsface_addon.maps")
material = load("bsface_addon.material")
face_file = load("bsface_addon.face_file")
coordinates = load("bsface_addon.coordinates")
load_template = load("core.surface.template").load_template


@pytest.mark.parametrize("openings", [True, False])
def test_the_mesh_lies_on_the_surface_and_moves_with_its_keys(face, openings):
    bpy.ops.bsface.surface_to_mesh(density="LOW", openings=openings, keys=True)
    obj = bpy.data.objects["Ann mesh"]
    mesh = obj.data
    assert {len(polygon.vertices) for polygon in mesh.polygons} == {4}
    skin = np.array([p.material_index == 0 for p in mesh.polygons]).repeat(4)
    uv = np.empty(len(mesh.loops) * 2, np.float32)
    mesh.uv_layers["UVMap"].data.foreach_get("uv", uv)
    corner = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corner)
    local = np.array([v.co for v in mesh.vertices])[corner]
    xyz = coordinates.from_local(face, local)[skin]
    at = uv.reshape(-1, 2).astype(float)[skin]
    away = np.linalg.norm(xyz - face_file.surface(face).evaluate(*at.T), axis=1)
    # Only the rims of the lids leave the surface, for the eyeballs behind them.
    assert (away > 1e-3).mean() < (0.03 if openings else 1e-9)
    assert mesh.materials[0] == face.data.materials[0]
    assert len(mesh.materials) == (3 if openings else 1)
    assert obj.matrix_world == face.matrix_world
    assert np.mean([polygon.normal.y for polygon in mesh.polygons]) < -0.3
    assert {"forehead", "nose", "lip_upper"} <= {g.name for g in obj.vertex_groups}
    names = load("core.rig.names").ARKIT_NAMES
    blocks = mesh.shape_keys.key_blocks
    assert [key.name for key in blocks[1:]] == list(names)
    assert all(key.value == 0 for key in blocks[1:])
    moved = [
        np.ptp(
            [p.co - q.co for p, q in zip(blocks[k].data, blocks[0].data, strict=True)]
        )
        for k in ("jawOpen", "tongueOut")
    ]
    assert moved[0] > 0.003 and moved[1] == 0


@pytest.mark.parametrize("textured", [True, False])
def test_the_head_holds_the_face_and_its_picture(face, textured):
    if textured:
        stripes = np.zeros((64, 64, 3), np.uint8)
        stripes[:32] = (200, 100, 50)  # the forehead
        stripes[32:] = (50, 200, 100)
        painted = maps.painted(stripes, load_template().outline_uv)
        material.store_map(face, "SKIN", painted)
        material.store_map(face, material.DETAIL, painted)
    bpy.ops.bsface.full_head(density="LOW", keys=True)
    obj = bpy.data.objects["Ann head"]
    mesh = obj.data
    xyz = coordinates.from_local(face, np.array([v.co for v in mesh.vertices]))
    grid = face_file.surface(face).grid(60, 60).reshape(-1, 3)
    assert np.ptp(xyz[:, 2]) > 1.5 * np.ptp(grid[:, 2]), "no back of the head"
    assert obj.matrix_world == face.matrix_world
    assert {"ear_left", "scalp", "neck", "nose"} <= {g.name for g in obj.vertex_groups}
    assert len(mesh.shape_keys.key_blocks) == 53
    assert mesh.materials[0] not in list(face.data.materials)
    nodes = mesh.materials[0].node_tree.nodes
    pictures = [node.image for node in nodes if node.type == "TEX_IMAGE"]
    assert len(pictures) == 2 * textured
    assert ("Normal Map" in nodes) == textured
    if not textured:
        return
    bent = nodes["Normal Map"].inputs["Color"].links[0].from_node.image
    assert bent.colorspace_settings.name == "Non-Color"
    np.testing.assert_allclose(bent.pixels[:3], (0.5, 0.5, 1.0), atol=0.003)
    skin = nodes.active.image
    side = skin.size[0]
    pixels = np.array(skin.pixels[:]).reshape(side, side, -1)
    uv = np.empty(len(mesh.loops) * 2, np.float32)
    mesh.uv_layers["UVMap"].data.foreach_get("uv", uv)
    corner = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corner)
    index = (uv.reshape(-1, 2) * side).astype(int).clip(0, side - 1)
    colour = np.zeros((len(mesh.vertices), 3))
    # The picture's rows and the coordinates both run up from the lower border.
    colour[corner] = pixels[index[:, 1], index[:, 0], :3]
    groups = {g.name: g.index for g in obj.vertex_groups}
    for name, channel in (("forehead", 0), ("jaw", 1)):
        members = [
            v.index
            for v in mesh.vertices
            if any(g.group == groups[name] for g in v.groups)
        ]
        assert colour[members].mean(axis=0).argmax() == channel


def test_arkit_keys_add_up_on_the_surface(face):
    neutral = points(face)
    bpy.ops.bsface.arkit_keys()
    blocks = face.data.shape_keys.key_blocks
    keys = load("core.rig.arkit").arkit_keys(face_file.saved(face))
    assert [key.name for key in blocks[1:]] == list(keys)
    assert all(key.value == 0 for key in blocks[1:])
    np.testing.assert_array_equal(points(face), neutral)
    for name in ("jawOpen", "mouthSmileLeft"):
        np.testing.assert_allclose(points(face, name) - neutral, keys[name], atol=1e-4)
        assert np.abs(keys[name]).max() > 1
    # Once more: the same keys, not twice as many.
    bpy.ops.bsface.arkit_keys()
    assert len(blocks) == 53


def test_a_mesh_shows_the_skin_when_its_face_is_gone(face):
    grey = maps.painted(np.zeros((8, 8, 3), np.uint8), load_template().outline_uv)
    material.store_map(face, "SKIN", grey)
    bpy.ops.bsface.surface_to_mesh(density="LOW", keys=False)
    bpy.ops.bsface.surface_map(kind="NORMALS")
    bpy.ops.bsface.face_remove()
    (skin, *_) = bpy.data.objects["Ann mesh"].data.materials
    assert skin[material.KIND_KEY] == "SKIN"
    assert skin.node_tree.nodes["Skin"].inputs["Base Color"].is_linked
