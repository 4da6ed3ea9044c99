"""One Blender camera per photo, with the photo as its background.

The core's camera (`core/camera/camera.py`) projects a head point Q in millimetres
as ``X = R Q``, ``pixel = principal + (t + s (X_x, -X_y)) / (1 - kappa X_z)``: with
``kappa > 0`` a perspective camera at the distance ``1 / kappa`` whose focal length is
``s / kappa`` pixels, with ``kappa = 0`` a scaled orthographic one.  Blender's camera
axes (x right, y up, looking along -z) are the core's.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import bpy
import numpy as np

from . import coordinates, rig, view_areas
from .orientation import orientation
from .rig import PHOTO_KEY

# An orthographic camera has no place along its axis; it must stand before the face.
ORTHOGRAPHIC_DISTANCE_MM = 1000.0
SENSOR_MM = 36.0
# Distances of the face beyond which nothing is seen.
CLIP_END = 10
# What the projection of a photo fixes at a camera, and at the picture behind it.
LENS = ("type", "lens", "ortho_scale", "sensor_fit", "sensor_width")
LENS += ("shift_x", "shift_y")
PLACED = ("rotation", "use_flip_x", "scale", "frame_method")
SIZE_KEY = "bsface_photo_size"
# What was measured as skin in its photo, see `skin_pictures.measured`.
SKIN_KEY = "bsface_skin"
# What comes back when one leaves the cameras: on the scene its own frame as JSON text
# and its camera as a pointer, which outlives a new name, on the window manager how the
# views looked, JSON too.
FRAME_BEFORE = "bsface_frame_before"
CAMERA_BEFORE = "bsface_camera_before"
VIEWS_BEFORE = "bsface_views_before"


def camera_to_head(camera, size):
    """Where the camera stands in the head's axes.

    Parameters
    ----------
    camera : core Camera
    size : (int, int)
        Width and height of the photo in pixels.

    Returns
    -------
    (4, 4) array
        Camera axes -> head axes, millimetres.
    """
    R, t, s = np.asarray(camera.R, float), np.asarray(camera.t, float), float(camera.s)
    if camera.kappa > 0:
        centre = np.array([-t[0] / s, t[1] / s, 1.0 / camera.kappa])
    else:
        middle = (np.asarray(size, float) - 1) / 2 - camera.principal - t
        centre = np.array([middle[0] / s, -middle[1] / s, ORTHOGRAPHIC_DISTANCE_MM])
    pose = np.eye(4)
    pose[:3, :3] = R.T
    pose[:3, 3] = R.T @ centre
    return pose


def set_lens(data, camera, size, unit):
    """Give camera data the projection of a core camera.

    Parameters
    ----------
    data : bpy.types.Camera
    unit : float
        Blender units per millimetre.
    """
    longer = max(size)
    data.sensor_fit = "AUTO"
    data.sensor_width = SENSOR_MM
    if camera.kappa > 0:
        # Blender's shift is in parts of the longer side; pixel centres are integers.
        off = (np.asarray(size, float) - 1) / 2 - camera.principal
        data.type = "PERSP"
        data.lens = camera.s / camera.kappa * SENSOR_MM / longer
        data.shift_x, data.shift_y = off[0] / longer, -off[1] / longer
        distance = unit / camera.kappa
    else:
        data.type = "ORTHO"
        data.ortho_scale = longer / camera.s * unit
        data.shift_x = data.shift_y = 0.0
        distance = unit * ORTHOGRAPHIC_DISTANCE_MM
    data.clip_start, data.clip_end = distance / 100, distance * CLIP_END
    data.display_size = 20 * unit
    data.passepartout_alpha = 0.5


def add(parent, name, camera, photo, turn, collection):
    """Add the camera of one photo.

    It moves together with the face, but keeps scale 1.

    Parameters
    ----------
    parent : bpy.types.Object
        The face's rig.
    camera, photo : core Camera and Photo
    turn : orientation.Turn or None
        None to look at the photo's file.
    collection : bpy.types.Collection

    Returns
    -------
    bpy.types.Object
    """
    unit = abs(coordinates.world_frame(rig.face_of_rig(parent)).to_scale().x)
    data = bpy.data.cameras.new(name)
    set_lens(data, camera, photo.size, unit)
    obj = bpy.data.objects.new(name, data)
    collection.objects.link(obj)
    # Forty of them hide the face.
    obj.hide_viewport = True
    rig.attach(obj, parent, camera_to_head(camera, photo.size))
    obj[PHOTO_KEY] = photo.name
    obj[SIZE_KEY] = [int(photo.size[0]), int(photo.size[1])]
    background(data, photo, turn)
    return obj


def background(data, photo, turn=None):
    """Show the photo behind the camera, turned as the core has turned it."""
    image = photo_image(photo)
    if image is None:
        return
    data.show_background_images = True
    slot = data.background_images.new()
    slot.image = image
    slot.alpha = 1.0
    slot.display_depth = "BACK"
    slot.frame_method = "FIT"
    angle, flip = turn or orientation(photo.path)
    # Blender turns the background clockwise.
    slot.rotation, slot.use_flip_x = (2 * math.pi - angle) % (2 * math.pi), flip
    if round(math.degrees(angle)) % 180:
        # FIT fits the unturned picture into the frame; after a quarter turn its
        # longer side has to reach the frame's longer side again.
        slot.scale = max(photo.size) / min(photo.size)


def photo_image(photo):
    """The photo's image block: its file, linked once, or None."""
    if photo.path is None or not Path(photo.path).is_file():
        return None
    path = str(Path(photo.path).resolve())
    try:
        image = bpy.data.images.load(path, check_existing=True)
    except (RuntimeError, ValueError):
        # Blender cannot open paths of more than 1023 bytes or that are no text; the
        # core can, and the camera is right without the picture.
        return None
    image.name = photo.name
    return image


def of_face(face):
    """The face's cameras, in the order of their photos' names."""
    return [obj for obj in rig.members(face, "CAMERA") if _has_size(obj)]


def _has_size(camera):
    """Whether the size of its photo is still there; the user may write anything."""
    size = camera.get(SIZE_KEY)
    try:
        return all(0 < side < float("inf") for side in size) and len(size) == 2
    except (TypeError, ValueError):
        return False


def are_shown(context, face):
    """Whether the cameras are drawn in the view, besides the one looked through."""
    now = context.scene.camera
    return any(not view.hide_viewport for view in of_face(face) if view != now)


def set_shown(context, face, show):
    """Draw the cameras in the view or hide them; a hidden one shows no photo."""
    for view in of_face(face):
        view.hide_viewport = not show and view != context.scene.camera


def look_through(context, camera, switch_views=True):
    """Make it the scene's camera; the frame gets the photo's proportions."""
    scene, render = context.scene, context.scene.render
    face = rig.face_of(camera)
    shown = face is not None and are_shown(context, face)
    first = scene.camera is None or not rig.is_own(scene.camera)
    size = [int(side) for side in camera[SIZE_KEY]]
    if PHOTO_KEY in camera:  # what a stage has changed, it keeps itself
        _remember_frame(context, first, size)
    render.resolution_x, render.resolution_y = size
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    scene.camera = camera
    if face is not None:
        set_shown(context, face, shown)
    if switch_views:
        _remember_views(context, first)
        for space in spaces(context):
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
            camera.hide_viewport = not are_shown(context, face)
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
    through_photo = camera is not None and SIZE_KEY in camera
    if not through_photo and VIEWS_BEFORE in context.window_manager:
        _restore_views(context)


def _restore_views(context):
    before = _views_before(context)
    for space, then in zip(spaces(context), before, strict=True):
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
    found = list(spaces(context))
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
        for space, then in zip(spaces(context), _views_before(context), strict=True)
    ]
    context.window_manager[VIEWS_BEFORE] = json.dumps(states)


def renew(old, new):
    """Give a camera the place and projection that a newer run found for its photo.

    What the user set at it stays.
    """
    if old.data.users > 1:  # a copy that the user made keeps its lens
        old.data = old.data.copy()
    data, fresh = old.data, new.data
    for name in LENS:
        setattr(data, name, getattr(fresh, name))
    distance = fresh.clip_end / CLIP_END
    if not data.clip_start < distance < data.clip_end:
        data.clip_start, data.clip_end = fresh.clip_start, fresh.clip_end
    for photo in fresh.background_images[:1]:
        if not data.background_images:
            data.show_background_images = True
            data.background_images.new().display_depth = photo.display_depth
        for name in ("image", *PLACED):
            setattr(data.background_images[0], name, getattr(photo, name))
    old[SIZE_KEY] = list(new[SIZE_KEY])
    old.pop(SKIN_KEY, None)
    if SKIN_KEY in new:
        old[SKIN_KEY] = new[SKIN_KEY]


def in_front(face):
    """Whether the photos stand in front of the surface."""
    slots = [slot for view in of_face(face) for slot in view.data.background_images]
    return bool(slots) and slots[0].display_depth == "FRONT"


def put_photo(view, front, opacity=0.5):
    """The photo in front of the surface with an opacity, or opaque behind it."""
    for slot in view.data.background_images[:1]:  # the rest is `skin_overlay`'s
        slot.display_depth = "FRONT" if front else "BACK"
        slot.alpha = opacity if front else 1.0


def redraw(context: bpy.types.Context, kind: str) -> None:
    """Redraw the regions of one kind of all 3D views: "WINDOW", "UI"."""
    for area in view_areas.in_all_windows(context):
        for region in area.regions:
            if region.type == kind:
                region.tag_redraw()


def spaces(context):
    """All 3D views."""
    for area in view_areas.in_all_windows(context):
        yield area.spaces.active


def views(context):
    """Region data of all 3D views."""
    for space in spaces(context):
        yield space.region_3d
