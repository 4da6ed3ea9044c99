"""Looking through a photo's camera, and back to the view and frame of before."""

from __future__ import annotations

import json

import bpy

from . import cameras, rig, view_areas
from .rig import PHOTO_KEY

# What comes back when one leaves the cameras: on the scene its own frame as JSON text
# and its camera as a pointer, which outlives a new name, on the window manager how the
# views looked, JSON too.
FRAME_BEFORE = "bsface_frame_before"
CAMERA_BEFORE = "bsface_camera_before"
VIEWS_BEFORE = "bsface_views_before"


def look_through(context, camera, switch_views=True):
    """Make it the scene's camera; the frame gets the photo's proportions."""
    scene, render = context.scene, context.scene.render
    face = rig.face_of(camera)
    shown = face is not None and cameras.are_shown(context, face)
    first = scene.camera is None or not rig.is_own(scene.camera)
    size = [int(side) for side in camera[cameras.SIZE_KEY]]
    if PHOTO_KEY in camera:  # what a stage has changed, it keeps itself
        _remember_frame(context, first, size)
    render.resolution_x, render.resolution_y = size
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    scene.camera = camera
    if face is not None:
        cameras.set_shown(context, face, shown)
    if switch_views:
        _remember_views(context, first)
        for space in view_areas.spaces(context):
            space.region_3d.view_perspective = "CAMERA"
            if _has_own_camera(space):
                space.camera = camera


def leave_views(context):
    """Views, camera and frame as they were before `look_through`."""
    _restore_views(context)
    scene = context.scene
    camera, then = scene.camera, _frame_before(scene)
    if camera is not None and rig.is_own(camera):
        face = rig.face_of(camera)
        if face is not None:
            camera.hide_viewport = not cameras.are_shown(context, face)
        set_frame(context, then, scene.get(CAMERA_BEFORE))
    elif _is_still_framed(scene, then):
        # The user has taken another camera, or deleted that of the photo.
        set_frame(context, then, camera or scene.get(CAMERA_BEFORE))
    for key in (FRAME_BEFORE, CAMERA_BEFORE):
        scene.pop(key, None)


def _remember_frame(context, first, size):
    """Keep the user's camera and frame, not those of a photo."""
    scene = context.scene
    known = _frame_before(scene)
    if first:
        now = frame(context)
        if _is_still_framed(scene, known):
            now |= {name: known[name] for name in ("resolution", "aspect")}
        known = now
        scene.pop(CAMERA_BEFORE, None)
        if scene.camera is not None:
            scene[CAMERA_BEFORE] = scene.camera
    if known:
        scene[FRAME_BEFORE] = json.dumps(known | {"shown": size})


def _frame_before(scene):
    """What `frame` was; empty where nothing is kept, or the user has damaged it."""
    try:
        then = json.loads(scene[FRAME_BEFORE])
        sides = [*then["resolution"], *then["aspect"], *then.get("shown", ())]
        good = isinstance(then["camera"], str) and sum(sides) > 0 and len(sides) > 3
        return then if good else {}
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError):
        return {}


def _is_still_framed(scene, then):
    """Whether the frame is that of the photo that was looked at."""
    now = [scene.render.resolution_x, scene.render.resolution_y]
    return then.get("shown") == now


def follow_undo(context):
    """Views that undo has left behind the scene's own camera look as before.

    Undo takes the photo's camera away from the scene, but views are not part of it.
    """
    camera = context.scene.camera
    through_photo = camera is not None and cameras.SIZE_KEY in camera
    if not through_photo and VIEWS_BEFORE in context.window_manager:
        _restore_views(context)


def _restore_views(context):
    before = _views_before(context)
    for space, then in zip(view_areas.spaces(context), before, strict=True):
        if space.region_3d.view_perspective == "CAMERA":
            set_view(space, then)
        else:
            _set_own_camera(space, then)
    context.window_manager.pop(VIEWS_BEFORE, None)


def frame(context):
    """The scene's camera and the size of its pictures, as plain values."""
    scene, render = context.scene, context.scene.render
    return {
        "camera": scene.camera.name if scene.camera else "",
        "resolution": [render.resolution_x, render.resolution_y],
        "aspect": [render.pixel_aspect_x, render.pixel_aspect_y],
    }


def set_frame(context, then, camera=None):
    """Give the scene the frame of `frame`, and a camera; nothing where it is empty.

    Without the camera, or where it was deleted, the one of the name of then.
    """
    if not then:
        return
    scene, render = context.scene, context.scene.render
    there = camera is not None and camera.users_scene
    scene.camera = camera if there else scene.objects.get(then["camera"])
    render.resolution_x, render.resolution_y = then["resolution"]
    render.pixel_aspect_x, render.pixel_aspect_y = then["aspect"]


def view_state(space):
    """Where a view looks from, as plain values; a camera view hides it."""
    region = space.region_3d
    own = _has_own_camera(space) and space.camera is not None
    return {
        "camera": space.camera.name if own else "",
        "view_perspective": region.view_perspective,
        "view_location": list(region.view_location),
        "view_rotation": list(region.view_rotation),
        "view_distance": region.view_distance,
    }


def set_view(space, then):
    """Let a view look from where `view_state` was taken."""
    for name, value in then.items():
        if name != "camera":
            setattr(space.region_3d, name, value)
    _set_own_camera(space, then)


def _set_own_camera(space, then):
    if "camera" in then and _has_own_camera(space):
        scene = bpy.context.scene
        now = scene.camera
        space.camera = bpy.data.objects.get(then["camera"])
        # Blender gives the scene the camera of a view that follows the scene's.
        scene.camera = now


def _has_own_camera(space):
    """Whether a view does not follow the scene's camera: also one of a few objects."""
    return space.use_local_camera or space.local_view is not None


def _views_before(context):
    """One state a view; one of which nothing is known looks freely from its place."""
    found = list(view_areas.spaces(context))
    stored = json.loads(context.window_manager.get(VIEWS_BEFORE, "[]"))
    if len(stored) != len(found):
        stored = [None] * len(found)
    return [then or {"view_perspective": "PERSP"} for then in stored]


def _remember_views(context, first):
    """Keep how the views look; of those behind a photo's camera, how they looked."""
    states = [
        view_state(space)
        if first or space.region_3d.view_perspective != "CAMERA"
        else then
        for space, then in zip(
            view_areas.spaces(context), _views_before(context), strict=True
        )
    ]
    context.window_manager[VIEWS_BEFORE] = json.dumps(states)
