"""Landmarks of one photo as a mesh over the picture, moved with Blender's own tools.

A photo that is being edited has two objects of its own, far from everything else: an
orthographic camera with the photo as background, and a mesh with one vertex per
landmark in the picture plane.  The longer side of the photo is one unit; pixel
centres are integers, y down, as in the core.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ..core.landmarks.landmarks import Landmarks, write_landmarks
from ..core.surface.template import load_template
from . import cameras

if TYPE_CHECKING:
    from ..core.images.photo import Photo

PHOTO = "bsface_landmarks_of"
SCHEME = "bsface_scheme"
START = "bsface_start"
WEIGHT = "bsface_weight"
BEFORE = "bsface_before"
PLACE = (0.0, 0.0, 100.0)
# A landmark that moved less than this, in pixels, was not moved by hand.
MOVED_PX = 0.05
# Detected landmarks weigh at most 1; one that a person placed outweighs them.
HAND_WEIGHT = 10.0
# Lines between the 68 points, so that one sees which is which.
CHAINS = (
    (range(0, 17), False),
    (range(17, 22), False),
    (range(22, 27), False),
    (range(27, 31), False),
    (range(31, 36), False),
    (range(36, 42), True),
    (range(42, 48), True),
    (range(48, 60), True),
    (range(60, 68), True),
)


def editor():
    """The mesh that is being edited, or None."""
    for obj in bpy.data.objects:
        if obj.type == "MESH" and PHOTO in obj:
            return obj
    return None


def open_editor(
    context: bpy.types.Context, photo: Photo, landmarks: Landmarks
) -> bpy.types.Object:
    """Show the landmarks of a photo over it, ready to be moved.

    Parameters
    ----------
    photo : Photo
        Its name, path and size are used.
    landmarks : Landmarks
    """
    collection = bpy.data.collections.new("BSface landmarks")
    context.scene.collection.children.link(collection)
    mesh = bpy.data.meshes.new(f"Landmarks {photo.name}")
    obj = bpy.data.objects.new(mesh.name, mesh)
    collection.objects.link(obj)
    plane = np.zeros((len(landmarks.points), 3))
    plane[:, :2] = to_plane(landmarks.points, photo.size)
    mesh.from_pydata(plane.tolist(), _edges(landmarks.scheme), [])
    obj.location = PLACE
    obj.show_in_front = True
    obj[PHOTO], obj[SCHEME] = photo.name, landmarks.scheme
    obj[START] = json.dumps(landmarks.points.tolist())
    obj[WEIGHT] = json.dumps(landmarks.weight.tolist())
    data = bpy.data.cameras.new(mesh.name)
    data.type, data.ortho_scale, data.sensor_fit = "ORTHO", 1.0, "AUTO"
    data.clip_start, data.clip_end, data.passepartout_alpha = 0.5, 2.0, 1.0
    cameras.background(data, photo)
    camera = bpy.data.objects.new(mesh.name, data)
    collection.objects.link(camera)
    camera.location = (PLACE[0], PLACE[1], PLACE[2] + 1)
    camera[cameras.SIZE_KEY] = [int(photo.size[0]), int(photo.size[1])]
    obj[BEFORE] = json.dumps(_view(context))
    cameras.look_through(context, camera)
    context.view_layer.update()
    for other in context.view_layer.objects:
        other.select_set(other == obj)
    context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    context.tool_settings.mesh_select_mode = (True, False, False)
    return obj


def edited(obj):
    """Points and weights as the user left them.

    Returns
    -------
    points : (f, 2) array
        Pixels of the turned photo.
    weight : (f,) array
        `HAND_WEIGHT` for the points that were moved.
    moved : (f,) bool array

    Raises
    ------
    ValueError
        Vertices were added or deleted.
    """
    obj.update_from_editmode()
    start, weight = np.array(json.loads(obj[START])), np.array(json.loads(obj[WEIGHT]))
    if len(obj.data.vertices) != len(start):
        raise ValueError(f"{len(obj.data.vertices)} points instead of {len(start)}")
    plane = np.empty(3 * len(start), np.float32)
    obj.data.vertices.foreach_get("co", plane)
    size = np.array(_camera(obj)[cameras.SIZE_KEY])
    points = to_pixels(plane.reshape(-1, 3)[:, :2].astype(float), size)
    moved = np.linalg.norm(points - start, axis=1) > MOVED_PX
    return (
        np.where(moved[:, None], points, start),
        np.where(moved, HAND_WEIGHT, weight),
        moved,
    )


def close_editor(context, obj):
    """Remove the editor's objects and look at the scene as before."""
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


def to_plane(points, size):
    """Pixels -> coordinates in the picture plane, (f, 2)."""
    size = np.asarray(size, float)
    return (np.asarray(points) - (size - 1) / 2) * (1, -1) / size.max()


def to_pixels(plane, size):
    """The reverse of `to_plane`."""
    size = np.asarray(size, float)
    return np.asarray(plane) * (1, -1) * size.max() + (size - 1) / 2


def write(path: Path, landmarks: Landmarks) -> None:
    """Write landmarks to a file; ``.pts`` takes the 68 points out of the 468."""
    if path.suffix.lower() == ".pts" and landmarks.scheme == "468":
        landmarks = landmarks.subset("68", _indices_of_68("468"))
    write_landmarks(path, landmarks)


def _indices_of_68(scheme: str) -> Sequence[int] | None:
    """Where the 68 points stand among the landmarks of a scheme, or None."""
    if scheme == "68":
        return range(68)
    return load_template().schemes["68"] if scheme == "468" else None


def _edges(scheme: str) -> list[tuple[int, int]]:
    """The lines between the 68 points, as pairs of landmarks."""
    lines = _indices_of_68(scheme)
    if lines is None:
        return []
    found = []
    for chain, closed in CHAINS:
        ends = list(chain)
        pairs = list(zip(ends, ends[1:], strict=False))
        if closed:
            pairs.append((ends[-1], ends[0]))
        found += [(int(lines[a]), int(lines[b])) for a, b in pairs]
    return found


def _camera(obj):
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
