"""A photo alone, to work on: with a camera of its own, far from everything else.

The longer side of the photo is one unit; y goes up, and the middle of the photo is the
stage's origin.  When the stage closes, the view is as it was before.
"""

from __future__ import annotations

import json

import bpy

from . import camera_views, cameras, selection, view_areas

# On the object that is worked on: what of the scene comes back, as JSON text; and
# pointers, which outlive a new name, to its scene, to the stage's camera and
# collection, and to the scene's camera of before.
BEFORE = "bsface_before"
SCENE = "bsface_stage_scene"
CAMERA = "bsface_stage_camera"
COLLECTION = "bsface_stage_collection"
CAMERA_BEFORE = "bsface_camera_before"
# On the scene: the object that is worked on.
OBJECT = "bsface_stage_object"
PLACE = (0.0, 0.0, 100.0)


def is_open() -> bool:
    """Whether a photo is being worked on."""
    return any(BEFORE in obj and not is_copy(obj) for obj in bpy.data.objects)


def is_copy(obj: bpy.types.Object) -> bool:
    """Whether the user has made it by duplicating the object that is worked on."""
    home = obj.get(SCENE)
    original = None if home is None else home.get(OBJECT)
    return original is not None and original != obj


def mesh_with(key: str) -> bpy.types.Object | None:
    """The mesh that has a property of this name, as an editor's has; or None."""
    for obj in bpy.data.objects:
        if obj.type == "MESH" and key in obj and not is_copy(obj):
            return obj
    return None


def open_stage(
    context: bpy.types.Context, obj: bpy.types.Object, size: tuple[int, int]
) -> bpy.types.Object:
    """Put an object on a stage, as the active and only selected one.

    Parameters
    ----------
    obj : bpy.types.Object
        Lies in the plane of the photo.
    size : (int, int)
        Width and height of the photo in pixels.

    Returns
    -------
    bpy.types.Object
        The camera, which every 3D view looks through.
    """
    selection.keep(obj, selection.current(context))
    selection.leave_edit_mode(context)
    collection = bpy.data.collections.new(f"BSface {obj.name}")
    context.scene.collection.children.link(collection)
    collection.objects.link(obj)
    obj.location = PLACE
    data = bpy.data.cameras.new(obj.name)
    data.type, data.ortho_scale, data.sensor_fit = "ORTHO", 1.0, "AUTO"
    data.clip_start, data.clip_end, data.passepartout_alpha = 0.5, 2.0, 1.0
    camera = bpy.data.objects.new(obj.name, data)
    collection.objects.link(camera)
    camera.location = (PLACE[0], PLACE[1], PLACE[2] + 1)
    camera[cameras.SIZE_KEY] = [int(size[0]), int(size[1])]
    obj[BEFORE] = json.dumps(_view(context))
    obj[SCENE], obj[CAMERA], obj[COLLECTION] = context.scene, camera, collection
    obj[cameras.SIZE_KEY], context.scene[OBJECT] = camera[cameras.SIZE_KEY], obj
    if context.scene.camera is not None:
        obj[CAMERA_BEFORE] = context.scene.camera
    camera_views.look_through(context, camera)
    context.view_layer.update()
    for space in view_areas.spaces(context):
        if space.local_view is not None:  # it shows only what it was opened with
            for part in (obj, camera):
                part.local_view_set(space, True)
    for other in context.view_layer.objects:
        other.select_set(other == obj)
    context.view_layer.objects.active = obj
    return camera


def elsewhere(context: bpy.types.Context, obj: bpy.types.Object | None) -> str:
    """Name of the scene whose stage an object is on, if that is another one than this.

    Empty for an object of this scene, for none, and where the scene was deleted.
    """
    home = None if obj is None else obj.get(SCENE)
    return home.name if home is not None and home != context.scene else ""


def close_stage(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Remove what the stage is made of and look at the scene as before.

    What the user has put there, copies included, stays.
    """
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    before, camera = json.loads(obj[BEFORE]), obj.get(CAMERA)
    home = obj.get(SCENE, context.scene)  # none where it was deleted
    then, chosen = obj.get(CAMERA_BEFORE), selection.kept(obj)
    collection = obj.get(COLLECTION)
    objects = [one for one in (obj, camera) if one is not None]
    data = [one.data for one in objects]
    images = [
        slot.image
        for block in data
        if isinstance(block, bpy.types.Camera)
        for slot in block.background_images
    ]
    for other in bpy.data.objects:
        if other != obj and BEFORE in other:
            _let_go(other)
    bpy.data.batch_remove(objects)
    if collection is not None and not (collection.objects or collection.children):
        bpy.data.collections.remove(collection)
    bpy.data.batch_remove([d for d in data if d.users == 0])
    bpy.data.batch_remove([i for i in images if i is not None and i.users == 0])
    if home is not None:
        home.pop(OBJECT, None)
        camera_views.set_frame(context, before["frame"], then)
        selection.restore(context, chosen)
        # Files of version 0.1 may hold an open editor that has not kept it.
        if "mesh_select_mode" in before:
            context.tool_settings.mesh_select_mode = before["mesh_select_mode"]
        for view, state in zip(
            view_areas.spaces(context), before["views"], strict=False
        ):
            camera_views.set_view(view, state)


def _let_go(copy: bpy.types.Object) -> None:
    """Make a copy of the object that is worked on an object like any other."""
    for key in list(copy.keys()):
        if key.startswith("bsface_"):
            del copy[key]


def _view(context):
    return {
        "frame": camera_views.frame(context),
        "mesh_select_mode": list(context.tool_settings.mesh_select_mode),
        "views": [camera_views.view_state(view) for view in view_areas.spaces(context)],
    }
