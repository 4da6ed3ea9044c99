"""A photo alone, to work on: with a camera of its own, far from everything else.

The longer side of the photo is one unit; y goes up, and the middle of the photo is the
stage's origin.  When the stage closes, the view is as it was before.
"""

from __future__ import annotations

import json

import bpy

from . import cameras

BEFORE = "bsface_before"
PLACE = (0.0, 0.0, 100.0)


def is_open() -> bool:
    """Whether a photo is being worked on."""
    return any(BEFORE in obj for obj in bpy.data.objects)


def mesh_with(key: str) -> bpy.types.Object | None:
    """The mesh that has a property of this name, as an editor's has; or None."""
    for obj in bpy.data.objects:
        if obj.type == "MESH" and key in obj:
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
    cameras.look_through(context, camera)
    context.view_layer.update()
    for other in context.view_layer.objects:
        other.select_set(other == obj)
    context.view_layer.objects.active = obj
    return camera


def close_stage(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Remove the stage's objects and look at the scene as before."""
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    before = json.loads(obj[BEFORE])
    collection = obj.users_collection[0]
    objects = list(collection.objects)
    data = [other.data for other in objects]
    images = [
        slot.image
        for camera in data
        if isinstance(camera, bpy.types.Camera)
        for slot in camera.background_images
    ]
    bpy.data.batch_remove([*objects, collection])
    bpy.data.batch_remove([d for d in data if d.users == 0])
    bpy.data.batch_remove([i for i in images if i is not None and i.users == 0])
    _restore(context, before)


def camera(obj: bpy.types.Object) -> bpy.types.Object:
    """The camera of the stage that an object is on."""
    return next(o for o in obj.users_collection[0].objects if o.type == "CAMERA")


def _view(context):
    active = context.view_layer.objects.active
    return {
        "frame": cameras.frame(context),
        "active": active.name if active else "",
        "views": [cameras.view_state(view) for view in cameras.views(context)],
    }


def _restore(context, before):
    cameras.set_frame(context, before["frame"])
    context.view_layer.update()
    active = context.view_layer.objects.get(before["active"])
    context.view_layer.objects.active = active
    if active is not None:
        active.select_set(True)
    for view, then in zip(cameras.views(context), before["views"], strict=False):
        cameras.set_view(view, then)
