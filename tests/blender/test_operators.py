"""All operators together: each is tested somewhere, and one undo takes it back."""

import json
import re
from pathlib import Path

import bpy
import pytest
from blender.checkout import load

scene = load("bsface_addon.scene")
surface_object = load("bsface_addon.surface_object")
photo_list = load("bsface_addon.photo_list")
# Those that leave the file as it is: they write other files, or the clipboard.
NO_UNDO = {
    "copy_information",
    "export",
    "job_cancel",
    "landmarks_export",
    "mask_brush",
    "mask_save",
    "preset_add",
    "texture_save",
}


def names():
    """Of all registered operators, without the prefix."""
    return {n.partition("_OT_")[2] for n in dir(bpy.types) if "BSFACE_OT_" in n}


def test_every_operator_is_called_by_a_test(addon):
    texts = [path.read_text() for path in Path(__file__).parent.glob("test_*.py")]
    called = set(re.findall(r"bpy\.ops\.bsface\.(\w+)\(", "\n".join(texts)))
    assert names() and names() <= called


def test_every_operator_that_changes_the_file_can_be_undone(addon):
    for name in names():
        options = getattr(bpy.types, f"BSFACE_OT_{name}").bl_options
        assert ("UNDO" in options) == (name not in NO_UNDO), name
        assert getattr(bpy.types, f"BSFACE_OT_{name}").__doc__, name


def contents():
    """What the file holds, as far as the operators change it."""
    found = {
        kind: sorted(d.name for d in getattr(bpy.data, kind))
        for kind in ("objects", "curves", "meshes", "cameras", "lights", "collections")
    }
    state = bpy.context.scene.bsface
    found["rows"] = [
        (r.name, r.use, r.status, r.expression, r.path, r.landmarks)
        for r in state.photos
    ]
    found["method"] = state.settings.method
    for face in scene.faces(bpy.context):
        keys = face.data.shape_keys
        found[face.name] = (
            face.mode,
            surface_object.read(face).tolist(),
            [block.name for block in keys.key_blocks] if keys else [],
            face.data.materials[0].get("bsface_map"),
            face.data.materials[0].get("bsface_whole", False),
        )
    camera = bpy.context.scene.camera
    found["camera"] = camera.name if camera else None
    found["hidden"] = sorted(o.name for o in bpy.data.objects if o.hide_viewport)
    return json.dumps(found)


@pytest.fixture
def face(addon, solved, tmp_path):
    """A face with edits, photos with words, and a state that undo goes back to."""
    bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"), name="Ann")
    state = bpy.context.scene.bsface
    points = surface_object.read(state.face)
    points[3, 4, 2] += 4
    surface_object.write(bpy.context, state.face, points)
    for row in list(state.photos)[:2]:
        row.expression = "Smile"
    state.settings.method = "motion"
    bpy.ops.ed.undo_push(message="before")
    return state.face


@pytest.mark.parametrize(
    "name, arguments",
    [
        ("reconstruct", {"separate": True}),
        ("surface_refit", {}),
        ("surface_resample", {"control_points_u": 20, "control_points_v": 20}),
        ("surface_symmetrise", {}),
        ("surface_to_mesh", {"density": "LOW", "keys": False}),
        ("full_head", {"density": "LOW", "keys": False}),
        ("arkit_keys", {}),
        ("coarse_edit", {}),
        ("surface_map", {"kind": "NORMALS"}),
        ("face_remove", {}),
        ("surface_trim", {"trim": False}),
        ("expression_key", {"expression": "Smile"}),
        ("expression_assign", {"expression": "Frown"}),
        ("view_photo", {}),
        ("view_show", {}),
        ("light_show", {"photo": "1.png"}),
        ("landmarks_clear", {"which": "ALL"}),
        ("landmarks_edit", {}),
        ("photos_use", {"which": "NONE"}),
        ("photos_remove", {}),
        ("photos_clear", {}),
        ("reset", {}),
    ],
)
def test_one_undo_takes_it_back(face, name, arguments):
    before = contents()
    # The last argument: push an undo step, as a click does.
    operator = getattr(bpy.ops.bsface, name)
    assert operator("EXEC_DEFAULT", True, **arguments) == {"FINISHED"}
    assert contents() != before
    bpy.ops.ed.undo()
    assert contents() == before
    bpy.ops.ed.redo()
    assert contents() != before
