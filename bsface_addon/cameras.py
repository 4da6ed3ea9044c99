"""One Blender camera per photo, with the photo as its background.

The core's camera (`core/camera/camera.py`) projects a head point Q in millimetres
as ``X = R Q``, ``pixel = principal + (t + s (X_x, -X_y)) / (1 - kappa X_z)``: with
``kappa > 0`` a perspective camera at the distance ``1 / kappa`` whose focal length is
``s / kappa`` pixels, with ``kappa = 0`` a scaled orthographic one.  Blender's camera
axes (x right, y up, looking along -z) are the core's.
"""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np

from . import coordinates, photo_list, rig
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


def find_photo(view):
    """Let a camera show its photo where that was moved together with the .blend."""
    for slot in view.data.background_images:
        image = slot.image
        if image is None or image.packed_file or not image.is_editable:
            continue
        path = Path(bpy.path.abspath(image.filepath))
        now = photo_list.moved_along(path)
        if now != path:
            image.filepath = str(now)


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
